/*
 * The standard normal distribution function in fixed point, for q31 and f32 (f64 takes erfc from
 * libm). A pure function over a constant table of 324 bytes. Arithmetic-independent.
 */
#ifndef ONEBIT_CDF_H
#define ONEBIT_CDF_H

#include "onebit_processor.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/*
 * Two words a segment of width 1/8: F where it begins, Q0.31, and its bend, whose upper half is the
 * curvature, Q0.25, and whose lower half is the skew for 2^-16 of the segment, signed. Then F where
 * the last segment ends. Written by tools/cdf_table.py, where the fit is explained.
 */
#define ONEBIT_CDF_SEGMENTS 40
extern const uint32_t onebit_cdf_table[2 * ONEBIT_CDF_SEGMENTS + 1];

/* Largest |u| that the table covers, Q4.27: half a rounding cell of the one below 5. */
#define ONEBIT_CDF_END (((int32_t)ONEBIT_CDF_SEGMENTS << 24) - 256)

/*
 * F(u) - bit for |u| <= ONEBIT_CDF_END; u in Q4.27, the result in Q0.31 modulo 2^32. One look into
 * the table, three products (four where they are made by halves), no branch, no division.
 *
 * |u| is rounded to 2^-19, which makes most of the error (2^-20 times the density 0.399 is 3.8e-7)
 * and leaves the place in a segment 16 bits. F is cut to an integer, and so are bend and slope;
 * that the slope then falls in steps never outweighs the step of the place, so F does not fall.
 */
ONEBIT_LONG_FUNCTION uint32_t onebit_cdf_minus(int32_t u, uint32_t bit)
{
    uint32_t sign = (uint32_t)(u >> 31); /* all ones for u < 0: exclusive-or and minus negate */
    uint32_t magnitude = (((uint32_t)u ^ sign) - sign) + 128u;
    const uint32_t *segment = &onebit_cdf_table[2u * (magnitude >> 24)];
    uint16_t place = onebit_half(magnitude << 8, ONEBIT_UPPER);

    /*
     * With t the place in [0, 1): F = value + (rise + bow - (curvature + skew t) t) t, where
     * bow = curvature + skew makes it end at the next value. The skew's own bits below the
     * curvature are a constant, which the fit takes into account.
     */
    uint32_t bend = segment[1];
    int16_t skew = (int16_t)onebit_half(bend, ONEBIT_LOWER);
    uint16_t bent = onebit_half(bend + (uint32_t)((int32_t)skew * (int32_t)place), ONEBIT_UPPER);
    uint32_t bow = bend + (bend << 16) - (uint32_t)bent * place;
    uint32_t slope = ((segment[2] - segment[0]) << 5) + onebit_over_32(bow); /* Q0.36 */
    uint32_t upper = segment[0] + onebit_scaled_over_32(slope, place);
    /* F(u) = 2^31 - F(-u): for u < 0 and for a bit of 1, but not for both, 2^31 more. */
    return ((upper ^ sign) - sign) ^ ((sign ^ bit) << 31);
}

/*
 * F(u) in Q0.31 for any u. Over all 2^32 inputs (tests/test_cdf_sweep.c checks each): error at most
 * 4.2e-7, monotone, F(u) + F(-u) = 2^31 exactly, 1 <= F <= 2^31 - 1. Beyond |u| = 5 the end of the
 * table stands (2.9e-7 from 1).
 */
static inline uint32_t onebit_cdf(int32_t u)
{
    const int32_t end = ONEBIT_CDF_END;
    return onebit_cdf_minus(u > end ? end : (u < -end ? -end : u), 0);
}

#ifdef __cplusplus
}
#endif

#endif
