/* Text through platform_put, for firmware that has no printf. */
#ifndef PRINT_H
#define PRINT_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

void print_text(const char *text);
void print_decimal(uint32_t number);
void print_hexadecimal(uint32_t number); /* eight digits */

#ifdef __cplusplus
}
#endif

#endif
