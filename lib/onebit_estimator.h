/*
 * The projected recursive estimator of one neighbour's compressed state (paper, equation for
 * zhat_ij(t) in Algorithm 1, step 2.1), in units of the noise: one text for all arithmetics.
 * Private to the library.
 */
#ifndef ONEBIT_ESTIMATOR_H
#define ONEBIT_ESTIMATOR_H

#include "onebit_arithmetic.h"

/*
 * Projection on [-bound, bound]; nearest point, so it never widens a distance. It clears the carry:
 * what was rounded away belongs to a place that has been left.
 */
static inline void onebit_project(onebit_estimate *estimate, onebit_real bound)
{
    if (onebit_beyond(estimate->value, bound)) {
        estimate->value = estimate->value < 0 ? -bound : bound;
        estimate->carry = 0;
    }
}

/*
 * zhat(t) = project(zhat(t-1) + gain (F(threshold - zhat(t-1)) - bit)), gain = (beta/sigma)/t.
 * |threshold| + bound <= 4 and |zhat| <= bound (onebit_check, onebit_start). Reentrant; one CDF.
 */
static inline void onebit_update(onebit_estimate *estimate, const onebit_gain *gain,
                                 onebit_real threshold, const onebit_real *bound, bool bit)
{
    onebit_accumulate(estimate, *gain, onebit_innovation(threshold - estimate->value, bit));
    onebit_project(estimate, *bound);
}

#endif
