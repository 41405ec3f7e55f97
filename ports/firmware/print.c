/* The text of print.h. */
#include "print.h"

#include "platform.h"

void print_text(const char *text)
{
    while (*text != '\0') {
        platform_put(*text++);
    }
}

/* Tens are taken off by subtraction: a Cortex-M0 would link a division routine. */
void print_decimal(uint32_t number)
{
    uint32_t unit = 1000000000u;
    while (unit > number && unit > 1) {
        unit /= 10;
    }
    for (; unit > 0; unit /= 10) {
        char digit = '0';
        while (number >= unit) {
            number -= unit;
            ++digit;
        }
        platform_put(digit);
    }
}

void print_hexadecimal(uint32_t number)
{
    for (unsigned digit = 0; digit < 8; ++digit) {
        platform_put("0123456789abcdef"[number >> 28]);
        number <<= 4;
    }
}
