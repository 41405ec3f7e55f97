/*
 * What the programs' command lines have in common: exit statuses, the one line on standard error
 * that says what is wrong, and the values that options hold.
 */
#ifndef COMMAND_LINE_H
#define COMMAND_LINE_H

#include "simulation.h"

#include <stdbool.h>
#include <stdint.h>

enum { DONE = 0, FAILURE = 1, BAD_USE = 2 };

/* Writes `program: ...` on a line; returns `status`, to end with. */
__attribute__((format(printf, 3, 4))) int command_line_complain(const char *program, int status,
                                                                const char *format, ...);

/* A decimal number in [least, most] at *text, which moves behind it; false and nothing if none. */
bool command_line_number(const char **text, uint32_t least, uint32_t most, uint32_t *number);

/* The whole of an option's text as a number: DONE, or BAD_USE after a line. */
int command_line_option(const char *program, const char *name, const char *text, uint32_t least,
                        uint32_t most, uint32_t *number);

/* The text of --arith: DONE, or BAD_USE after a line. */
int command_line_arithmetic(const char *program, const char *text, enum arithmetic *arithmetic);

#endif
