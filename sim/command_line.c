/* The values of command_line.h. Writes on standard error only. */
#include "command_line.h"

#include <errno.h>
#include <stdarg.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

int command_line_complain(const char *program, int status, const char *format, ...)
{
    va_list arguments;
    fprintf(stderr, "%s: ", program);
    va_start(arguments, format);
    vfprintf(stderr, format, arguments);
    va_end(arguments);
    fputc('\n', stderr);
    return status;
}

bool command_line_number(const char **text, uint32_t least, uint32_t most, uint32_t *number)
{
    char *end;
    if (**text < '0' || **text > '9') {
        return false; /* strtoull would take a sign, and spaces before it */
    }
    errno = 0;
    unsigned long long value = strtoull(*text, &end, 10);
    if (errno != 0 || value < least || value > most) {
        return false;
    }
    *number = (uint32_t)value;
    *text = end;
    return true;
}

int command_line_option(const char *program, const char *name, const char *text, uint32_t least,
                        uint32_t most, uint32_t *number)
{
    const char *rest = text;
    uint32_t value;
    if (!command_line_number(&rest, least, most, &value) || *rest != '\0') {
        return command_line_complain(program, BAD_USE,
                                     "--%s %s: must be a whole number from %lu to %lu", name, text,
                                     (unsigned long)least, (unsigned long)most);
    }
    *number = value;
    return DONE;
}

int command_line_arithmetic(const char *program, const char *text, enum arithmetic *arithmetic)
{
    for (int k = 0; k < ARITHMETIC_COUNT; ++k) {
        if (strcmp(text, arithmetic_names[k]) == 0) {
            *arithmetic = (enum arithmetic)k;
            return DONE;
        }
    }
    return command_line_complain(program, BAD_USE, "--arith %s: must be f64, f32 or q31", text);
}
