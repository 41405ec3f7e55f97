/* What was wrong, for a person: one line that says what, where and what would be right. */
#ifndef PROBLEM_H
#define PROBLEM_H

#include <stdbool.h>

struct problem {
    char text[512]; /* without newline; empty while there is none */
};

/* Writes the line, cut to fit, and returns false, so that a check can end with it. */
__attribute__((format(printf, 2, 3))) bool problem_set(struct problem *problem, const char *format,
                                                       ...);

#endif
