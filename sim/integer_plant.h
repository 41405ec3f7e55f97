/*
 * A plant in 32-bit fixed point, x(t+1) = A x(t) + B u(t), for runs that must give the same bits on
 * every processor (scenario key plant.arithmetic: q31). Needs no C library, so firmware can run it.
 */
#ifndef INTEGER_PLANT_H
#define INTEGER_PLANT_H

#include "onebit_limits.h"

#include <stdint.h>

struct integer_plant {
    unsigned state_count; /* n, 1..ONEBIT_STATES_MAX */
    int A_fraction_bits;
    int B_fraction_bits;
    int state_fraction_bits;
    int control_fraction_bits;
    const int32_t *A; /* n x n, row-major; magnitudes of a row add to < 2^31 */
    const int32_t *B; /* n */
};

/*
 * One step in place. For each state the dot product with A's row is rounded to the nearest, then
 * B's product, and their sum saturates.
 */
void integer_plant_step(const struct integer_plant *plant, int32_t *x, int32_t u);

#endif
