/* The text and the end of platform.h by semihosting.h. */
#include "semihosting.h"

#include "platform.h"

#define SYS_WRITEC 0x03u        /* argument: the character */
#define SYS_EXIT_EXTENDED 0x20u /* argument: reason, status */
#define APPLICATION_EXIT 0x20026u

void platform_put(char character)
{
    semihosting_call(SYS_WRITEC, &character);
}

void platform_exit(int status)
{
    const uint32_t argument[2] = {APPLICATION_EXIT, (uint32_t)status};
    semihosting_call(SYS_EXIT_EXTENDED, argument);
    for (;;) {
        /* A debugger that goes on after the end finds the processor here. */
    }
}
