/* The step of integer_plant.h, with the library's fixed-point primitives. */
#include "integer_plant.h"

#define ONEBIT_ARITHMETIC ONEBIT_Q31
#include "onebit_arithmetic.h"

void integer_plant_step(const struct integer_plant *plant, int32_t *x, int32_t u)
{
    int32_t next[ONEBIT_STATES_MAX];
    int shift = plant->B_fraction_bits + plant->control_fraction_bits - plant->state_fraction_bits;
    for (unsigned k = 0; k < plant->state_count; ++k) {
        int64_t free = onebit_dot(plant->A + k * plant->state_count, x, plant->state_count,
                                  plant->A_fraction_bits);
        int64_t driven = onebit_rescale((int64_t)plant->B[k] * u, shift);
        next[k] = onebit_saturate(free + driven);
    }
    for (unsigned k = 0; k < plant->state_count; ++k) {
        x[k] = next[k];
    }
}
