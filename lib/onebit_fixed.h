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

#include <stdbool.h>
#include <stdint.h>

typedef int32_t onebit_real;
#define ONEBIT_REAL(number) ((onebit_real)((number)*134217728.0)) /* into Q4.27 */

/* A positive constant with its own format: value * 2^-fraction_bits. */
typedef struct onebit_coefficient {
    uint32_t value;
    int8_t fraction_bits; /* -16..62 */
} onebit_coefficient;

/* A coefficient over t: mantissa * 2^-exponent, 2^15 <= mantissa < 2^16. */
typedef struct onebit_gain {
    uint16_t mantissa;
    int16_t exponent;
} onebit_gain;

typedef int64_t onebit_sum;
typedef uint32_t onebit_probability; /* Q0.31 */

/*
 * One neighbour's estimate in Q4.27, and in `carry` the 32 bits that follow it: together Q4.59.
 * Without them a step that shrinks as 1/t meets rounding that does not, and the estimate drifts.
 */
typedef struct onebit_link {
    int32_t estimate;
    uint32_t carry;
} onebit_link;

static inline onebit_probability onebit_distribution(onebit_real u)
{
    return onebit_cdf(u);
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

static inline int32_t onebit_saturate(int64_t value)
{
    int32_t lower = (int32_t)value;
    return lower == value ? lower : (int32_t)(value >> 63) ^ INT32_MAX; /* either end */
}

/* value * 2^-shift to the nearest, saturated; |value| <= 2^62, any shift. */
static inline int32_t onebit_rescale(int64_t value, int shift)
{
    if (shift > 0) {
        /* One place is left to round by; from 64 on it is 0 or -1, and the result 0. */
        value >>= shift > 64 ? 63 : shift - 1;
        return onebit_saturate((value + 1) >> 1);
    }
    /* Any other number than 0 saturates from 31 on. */
    int places = shift < -31 ? 31 : -shift;
    int32_t result = onebit_saturate(value);
    if (result > INT32_MAX >> places || result < INT32_MIN >> places) {
        return (result >> 31) ^ INT32_MAX;
    }
    return (int32_t)((uint32_t)result << places);
}

static inline int32_t onebit_difference(onebit_real minuend, onebit_real subtrahend)
{
    return onebit_saturate((int64_t)minuend - subtrahend);
}

/* In (0, limit]; a limit of 0 is none. */
static inline bool onebit_coefficient_valid(onebit_coefficient coefficient, uint32_t limit)
{
    int bits = coefficient.fraction_bits;
    if (coefficient.value == 0 || bits < -16 || bits > 62) {
        return false;
    }
    if (limit == 0) {
        return true;
    }
    return bits < 0 ? coefficient.value <= limit >> -bits
                    : bits > 31 || (coefficient.value - 1u) >> bits < limit;
}

/* A row is valid when its entries' magnitudes add to less than 2^31: see onebit_dot. */
static inline bool onebit_row_valid(const onebit_real *row, unsigned count)
{
    uint32_t room = INT32_MAX;
    for (unsigned k = 0; k < count; ++k) {
        uint32_t magnitude = row[k] < 0 ? 0u - (uint32_t)row[k] : (uint32_t)row[k];
        if (magnitude > room) {
            return false;
        }
        room -= magnitude;
    }
    return true;
}

/* coefficient / t, t > 0, correctly rounded to 16 bits: relative error at most 2^-16. */
static inline onebit_gain onebit_gain_at(onebit_coefficient coefficient, uint32_t t)
{
    unsigned dividend_places = onebit_leading_zeros(coefficient.value);
    unsigned divisor_places = onebit_leading_zeros(t);
    uint32_t dividend = coefficient.value << dividend_places;
    uint32_t divisor = t << divisor_places;
    int exponent = 15 + coefficient.fraction_bits + (int)dividend_places - (int)divisor_places;

    /* Both are in [2^31, 2^32), so either this bit of the quotient or the next one is set. */
    if (dividend >= divisor) {
        dividend -= divisor;
    } else {
        dividend += dividend - divisor; /* 2 dividend - divisor < divisor, modulo 2^32 */
        ++exponent;
    }
    /* 17 bits, of which the last one rounds. */
    uint32_t mantissa = (0x10001u + onebit_quotient(dividend, divisor)) >> 1;
    if (mantissa == 0x10000u) {
        mantissa = 0x8000u;
        --exponent;
    }
    onebit_gain gain = {(uint16_t)mantissa, (int16_t)exponent};
    return gain;
}

/*
 * estimate += gain * innovation, short of the exact sum by less than 2^-30 of the gain or, where
 * that is more, 2^-59. |estimate| <= 2^29 (the bound with the threshold is at most 4). A step
 * beyond 8 units of noise saturates there: twice the largest bound, so that the projection still
 * finds it outside or 2^-27 beside it.
 */
static inline void onebit_accumulate(onebit_link *link, onebit_gain gain, int32_t innovation)
{
    uint32_t fraction;
    int32_t product = onebit_scaled_signed(innovation, gain.mantissa);

    /* Q0.31 times 2^(16 - exponent) into Q4.27: the step is product / 2^(places + 1). */
    int places = gain.exponent - 13;
    if ((unsigned)places > 31u) { /* one comparison for both ends, which are rare */
        if (places < 0) {
            /* Gains up to 2^16 (onebit_check) have exponents from -1, so -places is at most 14. */
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
    link->carry += fraction;
    link->estimate += step + (link->carry < fraction);
}

/*
 * row x * 2^-shift to the nearest, saturated. The row's magnitudes add to less than 2^31
 * (onebit_row_valid), so the sum stays within 2^62 for any x.
 */
static inline onebit_real onebit_dot(const onebit_real *row, const onebit_real *x, unsigned count,
                                     int shift)
{
    int64_t sum = 0;
    for (unsigned k = 0; k < count; ++k) {
        sum += (int64_t)row[k] * x[k];
    }
    return onebit_rescale(sum, shift);
}

/*
 * stabilizing + gain * sum * 2^-shift, each rounded to the nearest, saturated. |sum| < 2^37 (32
 * neighbours, each within 2^29 + 2^31), times 16 bits of mantissa: below 2^53.
 */
static inline onebit_real onebit_combine(onebit_real stabilizing, onebit_gain gain, onebit_sum sum,
                                         int shift)
{
    return onebit_saturate((int64_t)stabilizing +
                           onebit_rescale(sum * gain.mantissa, gain.exponent + shift));
}

#endif
