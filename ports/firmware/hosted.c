/* The text and the end of platform.h on anything with a C library. */
#include "platform.h"

#include <stdio.h>
#include <stdlib.h>

void platform_put(char character)
{
    putchar(character);
}

void platform_exit(int status)
{
    exit(status);
}
