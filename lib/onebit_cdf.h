/*
 * The standard normal distribution function in fixed point, for q31 and f32 (f64 takes erfc from
 * libm). A pure function over a constant table of 480 bytes. Arithmetic-independent.
 */
#ifndef ONEBIT_CDF_H
#define ONEBIT_CDF_H

#include "onebit_processor.h"

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* One segment of width 1/8: written by tools/cdf_table.py, where the fit is explained. */
typedef struct onebit_cdf_segment {
    uint32_t bend;  /* upper half: curvature, Q0.25; lower half: skew for 2^-16 of it, signed */
    uint32_t slope; /* of F over the segment, Q0.36 */
    uint32_t value; /* F where it begins, Q0.31 */
} onebit_cdf_segment;

#define ONEBIT_CDF_SEGMENTS 40
extern const onebit_cdf_segment onebit_cdf_segments[ONEBIT_CDF_SEGMENTS];

/* Largest |u| that the table covers, Q4.27: half a rounding cell of the one below 5. */
#define ONEBIT_CDF_END (((int32_t)ONEBIT_CDF_SEGMENTS << 24) - 256)

/*
 * F(u) - bit for |u| <= ONEBIT_CDF_END; u in Q4.27, the result in Q0.31 modulo 2^32. One look into
 * the table, three products (five where they are made by halves), no branch, no division.
 *
 * |u| is rounded to 2^-19, which makes most of the error (2^-20 times the density 0.399 is 3.8e-7)
 * and leaves the place in a segment 16 bits. F is cut to an integer, and so is the slope; that the
 * slope then falls in steps never outweighs the step of the place, so F does not fall.
 */
static inline uint32_t onebit_cdf_minus(int32_t u, uint32_t bit)
{
    uint32_t sign = (uint32_t)(u >> 31); /* all ones for u < 0: exclusive-or and minus negate */
    uint32_t magnitude = (((uint32_t)u ^ sign) - sign) + 128u;
    const onebit_cdf_segment *segment = &onebit_cdf_segments[magnitude >> 24];
    uint16_t place = onebit_half(magnitude >> 8, ONEBIT_LOWER);

    /* The skew's own bits below the curvature are a constant, which the fit takes into account. */
    int16_t skew = (int16_t)onebit_half(segment->bend, ONEBIT_LOWER);
    uint32_t bend = segment->bend + (uint32_t)((int32_t)skew * (int32_t)place);
    uint32_t slope = segment->slope - (onebit_scaled(bend, place) >> 5);
    uint32_t upper = segment->value + (onebit_scaled(slope, place) >> 5);
    /* F(u) = 2^31 - F(-u): for u < 0 and for a bit of 1, but not for both, 2^31 more. */
    return ((upper ^ sign) - sign) + ((sign ^ bit) << 31);
}

/*
 * F(u) in Q0.31 for any u. Over all 2^32 inputs (tests/test_cdf_sweep.c checks each): error at most
 * 4.1e-7, monotone, F(u) + F(-u) = 2^31 exactly, 1 <= F <= 2^31 - 1. Beyond |u| = 5 the end of the
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
