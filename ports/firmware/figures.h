/*
 * What the parts of the measuring image (figures.c) share. Each prints lines of text:
 *
 *     q31 update mean 50.3 worst 72        instructions, or cycles on AVR
 *     q31 memory 56                        bytes of RAM of an agent with three neighbours
 */
#ifndef FIGURES_H
#define FIGURES_H

#include <stdbool.h>
#include <stdint.h>

/* What an operation's calls cost. */
struct figure {
    uint32_t calls, total; /* with realistic inputs */
    uint32_t worst;        /* with those and the search's */
};

void figure_take(struct figure *figure, uint32_t cost);
void figure_print(const char *name, const char *operation, const struct figure *figure);

/* Random words for bits and for the search: the same in every image. */
uint32_t figure_random(void);

/* The library's operations, an arithmetic each; false if the library refused something. */
bool onebit_f64_figures(void);
bool onebit_f32_figures(void);
bool onebit_q31_figures(void);

/* The estimator update that people write today. */
void today_double_figures(void);
void today_float_figures(void);

#endif
