/*
 * One run of a scenario: every agent a library instance, every message a frame on the virtual bus.
 * simulation.c is compiled once for each arithmetic, as the library is, so that the step's inner
 * loops call it directly.
 */
#ifndef SIMULATION_H
#define SIMULATION_H

#include "bus.h"
#include "formats.h"
#include "log.h"
#include "scenario.h"

#include <stdint.h>

enum arithmetic { ARITHMETIC_F64, ARITHMETIC_F32, ARITHMETIC_Q31, ARITHMETIC_COUNT };

extern const char *const arithmetic_names[ARITHMETIC_COUNT]; /* f64 f32 q31 */

/* The group after some completed steps. */
struct sample {
    double mse;           /* mean over agents of ||x_i - xbar||^2 */
    double estimate_mse;  /* mean over the union's directed links of (zhat_ij - K2 x_j)^2 */
    double average_error; /* mean over agents of ||x_i - (A + B K1)^k xbar(0)||^2 */
};

struct run {
    uint32_t seed;
    uint32_t number;      /* of the run: with the seed the key of its random words */
    const uint32_t *rows; /* completed steps at which to sample, ascending; the last ends the run */
    uint32_t row_count;
    struct log_writer *log; /* may be null */

    struct sample *samples;     /* row_count, written */
    double *trajectory;         /* row_count x agent_count x n, written; may be null */
    struct bus_traffic traffic; /* written */
};

/* Runs; false and *problem when memory is short or the library refuses the scenario. */
bool simulate(enum arithmetic arithmetic, const struct scenario *scenario,
              const struct formats *formats, struct run *run, struct problem *problem);

/* The same in one arithmetic; simulate chooses. */
typedef bool simulate_function(const struct scenario *scenario, const struct formats *formats,
                               struct run *run, struct problem *problem);
simulate_function onebit_f64_simulate;
simulate_function onebit_f32_simulate;
simulate_function onebit_q31_simulate;

#endif
