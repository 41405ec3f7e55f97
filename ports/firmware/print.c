/* The text of print.h. */
#include "print.h"

#include "platform.h"

#include <stdbool.h>

void print_text(const char *text)
{
    while (*text != '\0') {
        platform_put(*text++);
    }
}

/* By subtraction: a Cortex-M0 would link a routine for division. */
void print_decimal(uint32_t number)
{
    static const uint32_t units[] = {1000000000u, 100000000u, 10000000u, 1000000u, 100000u,
                                     10000u,      1000u,      100u,      10u,      1u};
    bool begun = false;
    for (unsigned place = 0; place < 10; ++place) {
        char digit = '0';
        while (number >= units[place]) {
            number -= units[place];
            ++digit;
        }
        begun = begun || digit != '0' || units[place] == 1;
        if (begun) {
            platform_put(digit);
        }
    }
}

void print_hexadecimal(uint32_t number)
{
    for (unsigned digit = 0; digit < 8; ++digit) {
        platform_put("0123456789abcdef"[number >> 28]);
        number <<= 4;
    }
}
