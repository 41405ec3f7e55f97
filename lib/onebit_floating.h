/*
 * The primitives of f64 and f32; the same names for q31 stand in onebit_fixed.h. Included by
 * onebit_arithmetic.h only. Compiled with -ffp-contract=off: fused multiply-adds do no harm to the
 * carry below, but results would differ between processors that have them and those that have not.
 */
#ifndef ONEBIT_FLOATING_H
#define ONEBIT_FLOATING_H

#include "onebit_types.h"

#if ONEBIT_ARITHMETIC == ONEBIT_F64
#include <math.h>
#else
#include "onebit_cdf.h"
#endif

/*
 * Under -ffast-math and its parts compilers take it that no number is infinite or NaN, so that
 * states which are not finite are no longer refused, and that sums may be ordered anew, so that the
 * carry below is gone (measured: 22,807 units of drift in f32 where 7 are normal). gcc defines a
 * macro for each part of it, clang only for the whole and for -ffinite-math-only.
 */
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__ > 0) ||       \
    defined(__ASSOCIATIVE_MATH__) || defined(_M_FP_FAST)
#error "onebit: compile f64 and f32 without -ffast-math, -Ofast, -ffinite-math-only, \
-fassociative-math, /fp:fast"
#endif

typedef uint32_t onebit_reciprocal; /* 1 / t, given as t: one division serves each gain */

#if ONEBIT_ARITHMETIC == ONEBIT_F64

/* F times 2^31. */
typedef double onebit_probability;

/* F(threshold - z). */
static inline onebit_probability onebit_distribution(onebit_real threshold, onebit_real z)
{
    return 1073741824.0 * erfc((z - threshold) * 0.70710678118654752440);
}

/* F(u) - bit. */
static inline onebit_real onebit_innovation(onebit_real u, bool bit)
{
    return onebit_distribution(u, 0) / 2147483648.0 - (bit ? 1.0 : 0.0);
}

#else

typedef uint32_t onebit_probability;

/* F(threshold - z). */
static inline onebit_probability onebit_distribution(onebit_real threshold, onebit_real z)
{
    onebit_real u = threshold - z;
    /* 15.99 is far beyond the table's end and, times 2^27, within int32_t. A NaN ends there too. */
    if (!(u < 15.99f)) {
        u = 15.99f;
    } else if (u < -15.99f) {
        u = -15.99f;
    }
    return onebit_cdf((int32_t)(u * 134217728.0f));
}

/* |u| <= 4, which |threshold| + bound <= 4 and the projection see to: the table needs no guard. */
static inline onebit_real onebit_innovation(onebit_real u, bool bit)
{
    /* Subtracted as integers: near F = 1 a float has no digits left for F - 1. */
    int32_t innovation = (int32_t)onebit_cdf_minus((int32_t)(u * 134217728.0f), bit);
    return (onebit_real)innovation / 2147483648.0f;
}

#endif

/* Infinities and NaN minus themselves are NaN. */
static inline bool onebit_finite(onebit_real value)
{
    return value - value == 0;
}

/* |value| > limit. */
static inline bool onebit_beyond(onebit_real value, onebit_real limit)
{
    return value > limit || value < -limit;
}

static inline bool onebit_coefficient_valid(onebit_coefficient coefficient)
{
    return onebit_finite(coefficient) && coefficient > 0;
}

/* A valid coefficient is at most 2^power, 16 <= power < 32. */
static inline bool onebit_coefficient_within(onebit_coefficient coefficient, unsigned power)
{
    return coefficient <= (onebit_real)((uint32_t)1 << power);
}

/* A row of gains is valid when it is finite. */
static inline bool onebit_row_valid(const onebit_real *row, unsigned count)
{
    for (unsigned k = 0; k < count; ++k) {
        if (!onebit_finite(row[k])) {
            return false;
        }
    }
    return true;
}

/* Numbers have no end where they saturate: they become infinite, and are refused. */
static inline bool onebit_at_end(onebit_real value)
{
    (void)value;
    return false;
}

/* Whether a gain is the one that belongs to a clock. */
static inline bool onebit_gain_valid(onebit_gain gain, onebit_gain expected)
{
    return gain == expected;
}

static inline onebit_reciprocal onebit_reciprocal_of(uint32_t t)
{
    return t;
}

static inline onebit_gain onebit_gain_of(onebit_coefficient coefficient,
                                         onebit_reciprocal reciprocal)
{
    return coefficient / (onebit_real)reciprocal;
}

/*
 * estimate += gain * innovation, keeping what the addition rounds away and adding it next time
 * (Kahan): without it a step that shrinks as 1/t meets rounding that does not.
 */
static inline void onebit_accumulate(onebit_estimate *estimate, onebit_gain gain,
                                     onebit_real innovation)
{
    onebit_real increment = gain * innovation + estimate->carry;
    onebit_real value = estimate->value + increment;
    estimate->carry = increment - (value - estimate->value);
    estimate->value = value;
}

/* Of differences between estimates. */
typedef struct onebit_sum {
    onebit_real value;
} onebit_sum;

/* sum += value - z. */
static inline void onebit_add_difference(onebit_sum *sum, onebit_real value, onebit_real z)
{
    sum->value += value - z;
}

/* row x, the products added in the order of the states; the shift is for fixed point. */
static inline onebit_real onebit_dot(const onebit_real *row, const onebit_real *x, unsigned count,
                                     int shift)
{
    (void)shift;
    onebit_real sum = 0;
    for (unsigned k = 0; k < count; ++k) {
        sum += row[k] * x[k];
    }
    return sum;
}

/* stabilizing + gain * sum. */
static inline onebit_real onebit_combine(onebit_real stabilizing, onebit_gain gain, onebit_sum sum,
                                         int shift)
{
    (void)shift;
    return stabilizing + gain * sum.value;
}

#endif
