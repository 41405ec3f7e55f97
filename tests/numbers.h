/*
 * What the library's tests share: numbers of the arithmetic under test from and to double, seeded
 * random numbers, and a check whose message costs nothing while it holds.
 */
#ifndef ONEBIT_TESTS_NUMBERS_H
#define ONEBIT_TESTS_NUMBERS_H

#include <unity.h>

#include <math.h>
#include <stdbool.h>
#include <stdint.h>
#include <stdio.h>

/* Fails the running test with a formatted message; for loops of millions of checks. */
#define REQUIRE(condition, ...)                                                                    \
    do {                                                                                           \
        if (!(condition)) {                                                                        \
            char require_text[256];                                                                \
            (void)snprintf(require_text, sizeof require_text, __VA_ARGS__);                        \
            TEST_FAIL_MESSAGE(require_text);                                                       \
        }                                                                                          \
    } while (0)

/* SplitMix64 (Steele, Lea, Flood 2014); independent of the library's own random words. */
static inline uint64_t random_bits(uint64_t *seed)
{
    uint64_t word = *seed += UINT64_C(0x9E3779B97F4A7C15);
    word = (word ^ (word >> 30)) * UINT64_C(0xBF58476D1CE4E5B9);
    word = (word ^ (word >> 27)) * UINT64_C(0x94D049BB133111EB);
    return word ^ (word >> 31);
}

static inline uint32_t random_word(uint64_t *seed)
{
    return (uint32_t)(random_bits(seed) >> 32);
}

/* Uniform in [0, 1). */
static inline double random_unit(uint64_t *seed)
{
    return (double)(random_bits(seed) >> 11) * 0x1p-53;
}

static inline double random_between(uint64_t *seed, double low, double high)
{
    return low + (high - low) * random_unit(seed);
}

/* The normal distribution function, by libm in extended precision; the library has no long double.
 */
static inline double normal_distribution(double u)
{
    return (double)(0.5L * erfcl(-(long double)u * 0.70710678118654752440084436210485L));
}

static inline double normal_density(double u)
{
    return exp(-0.5 * u * u) * 0.39894228040143267794;
}

#ifdef ONEBIT_ARITHMETIC
#include "onebit.h"
#include "onebit_arithmetic.h"

/*
 * The largest error of the library's F. f64: erfc, and the roundings of its argument u, each worth
 * 2^-53 |u| phi(u) <= 2^-55. f32: that of the table; half an ulp of u times phi(u), most in [1, 2):
 * 2^-24 * 0.242; and u cut to 2^-27. q31: that of the table, tests/test_cdf_sweep.c.
 */
#if ONEBIT_ARITHMETIC == ONEBIT_F64
#define DISTRIBUTION_ERROR 0x1p-51
#elif ONEBIT_ARITHMETIC == ONEBIT_F32
#define DISTRIBUTION_ERROR (4.2e-7 + 0x1p-26 + 0x1p-28)
#else
#define DISTRIBUTION_ERROR 4.2e-7
#endif

#if ONEBIT_ARITHMETIC == ONEBIT_Q31

/* Largest relative error of a gain: its rounding to 16 bits, and the reciprocal. */
#define GAIN_ERROR (0x1p-16 + 0x1p-23)

/* To the nearest, with `bits` fraction bits; the caller keeps within range. */
static inline onebit_real number_in(double value, int bits)
{
    return (onebit_real)llrint(ldexp(value, bits));
}

static inline double value_in(onebit_real number, int bits)
{
    return ldexp((double)number, -bits);
}

static inline onebit_real number(double value)
{
    return number_in(value, ONEBIT_NOISE_FRACTION_BITS);
}

static inline double value_of(onebit_real number)
{
    return value_in(number, ONEBIT_NOISE_FRACTION_BITS);
}

/* Normalised: 32 bits of the number. */
static inline onebit_coefficient coefficient(double value)
{
    int exponent;
    double fraction = frexp(value, &exponent);
    onebit_coefficient result = {(uint32_t)ldexp(fraction, 32), (uint16_t)(32 - exponent)};
    return result;
}

static inline double coefficient_value(onebit_coefficient coefficient)
{
    return ldexp((double)coefficient.value, -coefficient.fraction_bits);
}

static inline double gain_value(onebit_gain gain)
{
    return ldexp((double)gain.mantissa, -(gain.places + 13));
}

/* With the carry: 2^-59 is exact in a double below 2^-6, and to 2^-51 up to 4. */
static inline double estimate_value(const onebit_estimate *estimate)
{
    return ldexp((double)estimate->value, -27) + ldexp((double)estimate->carry, -59);
}

#else

#define GAIN_ERROR (ONEBIT_ARITHMETIC == ONEBIT_F32 ? 0x1p-23 : 0x1p-52)

static inline onebit_real number(double value)
{
    return (onebit_real)value;
}

static inline double value_of(onebit_real number)
{
    return (double)number;
}

static inline onebit_real number_in(double value, int bits)
{
    (void)bits;
    return number(value);
}

static inline double value_in(onebit_real number, int bits)
{
    (void)bits;
    return value_of(number);
}

static inline onebit_coefficient coefficient(double value)
{
    return (onebit_coefficient)value;
}

static inline double coefficient_value(onebit_coefficient coefficient)
{
    return (double)coefficient;
}

static inline double gain_value(onebit_gain gain)
{
    return (double)gain;
}

static inline double estimate_value(const onebit_estimate *estimate)
{
    return (double)estimate->value + (double)estimate->carry;
}

#endif

static inline onebit_gain onebit_gain_at(onebit_coefficient coefficient, uint32_t t)
{
    return onebit_gain_of(coefficient, onebit_reciprocal_of(t));
}

#endif

#endif
