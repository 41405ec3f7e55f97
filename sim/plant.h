/* The machines: x(t+1) = A x(t) + B u(t) for each agent, in double or in fixed point. */
#ifndef PLANT_H
#define PLANT_H

#include "formats.h"
#include "integer_plant.h"
#include "scenario.h"

/* Stays where it was built: the integer plant points into it. */
struct plant {
    uint32_t state_count;
    const double *A; /* of the scenario */
    const double *B;
    bool integer;
    struct integer_plant fixed; /* where integer; its A and B are these: */
    int32_t fixed_A[ONEBIT_STATES_MAX * ONEBIT_STATES_MAX];
    int32_t fixed_B[ONEBIT_STATES_MAX];
};

void plant_build(struct plant *plant, const struct scenario *scenario,
                 const struct formats *formats);

/* Brings an initial state into what the plant can hold: rounded to its format where integer. */
void plant_begin(const struct plant *plant, double *x);

/* One step in place; x and u in the paper's units. */
void plant_step(const struct plant *plant, double *x, double u);

#endif
