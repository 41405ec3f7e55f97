/*
 * The primitives of q31; the same names for f64 and f32 stand in onebit_floating.h. Included by
 * onebit_arithmetic.h only. Everything in units of the noise (estimates, threshold, bound, K2 x) is
 * Q4.27. No operation overflows or shifts by an undefined amount, whatever its input; each says
 * why. Signed values are shifted right arithmetically, as every compiler for two's complement does.
 */
#ifndef ONEBIT_FIXED_H
#define ONEBIT_FIXED_H

#include "onebit_cdf.h"
#include "onebit_processor.h"
#include "onebit_types.h"

#include <stdbool.h>
#include <stdint.h>

/* 1 / t: mantissa * 2^(leading_zeros - 63), the leading zeros those of t. */
typedef struct onebit_reciprocal {
    uint32_t mantissa;
    uint8_t leading_zeros;
} onebit_reciprocal;

/*
 * A sum of at most 32 differences, upper * 2^16 + lower, in words that small processors add in one
 * instruction: each term's parts are within 2^15 and 2^16, doubled.
 */
typedef struct onebit_sum {
    int32_t upper;
    int32_t lower;
} onebit_sum;
typedef uint32_t onebit_probability; /* Q0.31 */

/*
 * F(threshold - z) for any z: it is brought within the CDF's table first, where the difference does
 * not overflow, |threshold| < 4 (onebit_check) and the table's end 5.
 */
static inline onebit_probability onebit_distribution(onebit_real threshold, onebit_real z)
{
    const onebit_real least = threshold - ONEBIT_CDF_END;
    const onebit_real most = threshold + ONEBIT_CDF_END;
    return onebit_cdf_minus(threshold - (z < least ? least : (z > most ? most : z)), 0);
}

/*
 * F(u) - bit in Q0.31; 1 <= F <= 2^31 - 1 keeps it within +-(2^31 - 1). |u| <= 4, which
 * |threshold| + bound <= 4 and the projection see to: the table needs no guard.
 */
static inline int32_t onebit_innovation(onebit_real u, bool bit)
{
    return (int32_t)onebit_cdf_minus(u, bit);
}

static inline bool onebit_finite(onebit_real value)
{
    (void)value;
    return true;
}

/* |value| > limit, in one comparison; |value| <= 2^30 + 2^29 and 0 < limit <= 2^29. */
static inline bool onebit_beyond(onebit_real value, onebit_real limit)
{
    return (uint32_t)value + (uint32_t)limit > 2u * (uint32_t)limit;
}

static inline int32_t onebit_saturate(int64_t value)
{
    int32_t lower = (int32_t)value;
    return lower == value ? lower : (int32_t)(value >> 63) ^ INT32_MAX; /* either end */
}

/* value * 2^-shift to the nearest, saturated; |value| <= 2^62, any shift. */
ONEBIT_LONG_FUNCTION int32_t onebit_rescale(int64_t value, int shift)
{
    if (shift > 0) {
        /* One place is left to round by; from 64 on it is 0 or -1, and the result 0. */
        value >>= shift > 64 ? 63 : shift - 1;
        return onebit_saturate((value + 1) >> 1);
    }
    /* Any other number than 0 saturates from 31 on. */
    int places = shift < -31 ? 31 : -shift;
    int32_t result = onebit_saturate(value);
    int32_t moved = (int32_t)((uint32_t)result << places);
    return moved >> places == result ? moved : (result >> 31) ^ INT32_MAX;
}

static inline bool onebit_coefficient_valid(onebit_coefficient coefficient)
{
    return coefficient.value >> 31 != 0 && coefficient.fraction_bits <= 62;
}

/* A valid coefficient is at most 2^power, power < 32. */
static inline bool onebit_coefficient_within(onebit_coefficient coefficient, unsigned power)
{
    unsigned places = coefficient.fraction_bits + power;
    return places > 31 || (places == 31 && coefficient.value == 0x80000000u);
}

/* A row is valid when its entries' magnitudes add to less than 2^31: see onebit_dot. */
static inline bool onebit_row_valid(const onebit_real *row, unsigned count)
{
    uint32_t room = INT32_MAX;
    for (unsigned k = 0; k < count; ++k) {
        uint32_t magnitude = (uint32_t)(row[k] < 0 ? -(int64_t)row[k] : row[k]);
        if (magnitude > room) {
            return false;
        }
        room -= magnitude;
    }
    return true;
}

/* Whether a number stands at an end of its range, as one does that was saturated. */
static inline bool onebit_at_end(onebit_real value)
{
    return (uint32_t)value - (uint32_t)INT32_MAX <= 1u;
}

static inline bool onebit_gain_valid(onebit_gain gain, onebit_gain expected)
{
    return gain.mantissa == expected.mantissa && gain.places == expected.places;
}

/*
 * 2^63 / divisor for a divisor from 2^31 on: too small by less than 2^-24 of it, too large by less
 * than 2^-30 (tests/test_reciprocal_sweep.c takes every divisor). A division without a division,
 * which 8-bit and small 32-bit processors would have to link: the polynomial of second degree whose
 * error is largest at four places, 1/99 (1 - x p(x) is Chebyshev's of third degree), and two of
 * Newton's steps, each of which squares the error.
 *
 * x is the divisor's upper half, Q0.16 in [1/2, 1). Errors are signed and small: |error| < 2^29 /
 * 90 in the first step, less than 2^-15 + 2^-13 in the second, so no product leaves 32 bits.
 */
static inline uint32_t onebit_inverse(uint32_t divisor)
{
    uint16_t x = onebit_half(divisor, ONEBIT_UPPER);
    /* (420 - (576 - 256 x) x) / 99 in Q3.13 */
    uint16_t inner = (uint16_t)(47663u - onebit_half((uint32_t)x * 21183u, ONEBIT_UPPER));
    uint16_t first = (uint16_t)(34754u - onebit_half((uint32_t)inner * x, ONEBIT_UPPER));
    int32_t error = ((int32_t)1 << 29) - (int32_t)((uint32_t)x * first); /* Q29 */
    uint16_t second = (uint16_t)((uint32_t)first * 4u +                  /* Q1.15 */
                                 (uint32_t)(((int32_t)first * (int16_t)(error >> 14)) >> 13));
    error = (int32_t)(0x80000000u - onebit_scaled(divisor, second)); /* Q31 */
    return ((uint32_t)second << 16) + (uint32_t)(((int32_t)second * (int16_t)(error >> 4)) >> 11);
}

/* 1 / t, t > 0, as exact as onebit_inverse. */
static inline onebit_reciprocal onebit_reciprocal_of(uint32_t t)
{
    unsigned leading_zeros = onebit_leading_zeros(t);
    onebit_reciprocal reciprocal = {onebit_inverse(t << leading_zeros), (uint8_t)leading_zeros};
    return reciprocal;
}

/*
 * coefficient / t, rounded to 16 bits. Relative error less than 2^-16 + 2^-23: half a unit of the
 * mantissa, which is 2^15 or more, the reciprocal's error, and 2^-30 that the product loses.
 *
 * The reciprocal's mantissa is at least 2^31 - 2^7, so the product is at least 2^30 - 2^6 - 1 and,
 * moved up, rounds to 2^15 or more.
 */
static inline onebit_gain onebit_gain_of(onebit_coefficient coefficient,
                                         onebit_reciprocal reciprocal)
{
    uint32_t product = onebit_upper(coefficient.value, reciprocal.mantissa);
    int places = 2 + (int)coefficient.fraction_bits - (int)reciprocal.leading_zeros;
    if (product < 0x80000000u) {
        product <<= 1;
        ++places;
    }
    uint32_t mantissa = (product >> 16) + (product >> 15 & 1u);
    uint16_t excess = onebit_half(mantissa, ONEBIT_UPPER); /* rounded up to 2^16 */
    onebit_gain gain = {(uint16_t)(mantissa >> excess), (int16_t)(places - (int)excess)};
    return gain;
}

/*
 * estimate += gain * innovation, short of the exact sum by less than 2^-30 of the gain or, where
 * that is more, 2^-59. |estimate| <= 2^29 (the bound with the threshold is at most 4). A step
 * beyond 8 units of noise saturates there: twice the largest bound, so that the projection still
 * finds it outside or 2^-27 beside it.
 */
static inline void onebit_accumulate(onebit_estimate *estimate, onebit_gain gain,
                                     int32_t innovation)
{
    uint32_t fraction;
    int32_t product = onebit_scaled_signed(innovation, gain.mantissa);

    /* Q0.31 times 2^(3 - places) into Q4.27: the step is product / 2^(places + 1). */
    int places = gain.places;
    if ((unsigned)places > 31u) { /* one comparison for both ends, which are rare */
        if (places < 0) {
            /* Gains up to 2^16 (onebit_check) have places from -14 on. */
            int32_t limit = INT32_MAX >> -places;
            if (product > limit || product < -limit) {
                product = product < 0 ? -INT32_MAX : INT32_MAX;
            } else {
                product *= (int32_t)1 << -places;
            }
            places = 0;
        } else {
            product = onebit_shifted(product, places > 62 ? 31 : (unsigned)places - 32u, &fraction);
            places = 31;
        }
    }
    /* |step| <= 2^30 added to 2^29 fits, and so does the carry. */
    int32_t step = onebit_shifted(product, (unsigned)places, &fraction);
    onebit_add(&estimate->value, &estimate->carry, step, fraction);
}

/*
 * row x * 2^-shift to the nearest, saturated. The row's magnitudes add to less than 2^31
 * (onebit_row_valid), so the sum stays within 2^62 for any x.
 */
ONEBIT_LONG_FUNCTION onebit_real onebit_dot(const onebit_real *row, const onebit_real *x,
                                            unsigned count, int shift)
{
    return onebit_rescale(onebit_products(row, x, count), shift);
}

/* sum += value - z. */
static inline void onebit_add_difference(onebit_sum *sum, onebit_real value, onebit_real z)
{
    sum->upper += (value >> 16) - (z >> 16);
    sum->lower += (int32_t)onebit_half((uint32_t)value, ONEBIT_LOWER) -
                  (int32_t)onebit_half((uint32_t)z, ONEBIT_LOWER);
}

/*
 * stabilizing + gain * sum * 2^-shift, each rounded to the nearest, saturated; a consensus term
 * that stands at an end of the range is the result. |sum| < 2^37 (32 neighbours, each within 2^29 +
 * 2^31), times 16 bits of mantissa: below 2^53.
 */
static inline onebit_real onebit_combine(onebit_real stabilizing, onebit_gain gain, onebit_sum sum,
                                         int shift)
{
    int64_t product =
        onebit_product(sum.upper, gain.mantissa) * 65536 + onebit_product(sum.lower, gain.mantissa);
    int32_t term = onebit_rescale(product, gain.places + 13 + shift);
    return onebit_at_end(term) ? term : onebit_saturate((int64_t)stabilizing + term);
}

#endif
