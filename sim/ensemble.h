/* Many runs of a scenario over several threads; the result is the same for any number of them. */
#ifndef ENSEMBLE_H
#define ENSEMBLE_H

#include "simulation.h"

#include <stdbool.h>
#include <stdint.h>

struct ensemble {
    enum arithmetic arithmetic;
    uint32_t runs;
    uint32_t steps;
    uint32_t seed;
    int threads;
    bool progress;          /* a line on standard error */
    struct log_writer *log; /* of run 0; may be null */

    /* Written. */
    uint32_t row_count;
    uint32_t *rows;             /* completed steps: 0, round(10^(j/20)), steps */
    struct sample *means;       /* row_count, over runs */
    double *mse_se;             /* row_count: standard error of the mean mse; 0 for one run */
    double *trajectory;         /* run 0: row_count x agent_count x n */
    struct bus_traffic traffic; /* sums over runs, largest latency */
};

/* False and *problem when memory is short or the library refuses the scenario. */
bool ensemble_run(struct ensemble *ensemble, const struct scenario *scenario,
                  const struct formats *formats, struct problem *problem);

void ensemble_free(struct ensemble *ensemble);

/*
 * Least-squares slope of log10(mse) against log10(t) over the rows with first <= step <= last and
 * mse > 0; NaN with fewer than two of them.
 */
double ensemble_slope(const struct ensemble *ensemble, uint32_t t0, uint32_t first, uint32_t last);

#endif
