/*
 * The standard normal distribution function in fixed point, for q31 and f32 (f64 takes erfc from
 * libm). A pure function over a constant table of 364 bytes. Arithmetic-independent.
 */
#ifndef ONEBIT_CDF_H
#define ONEBIT_CDF_H

#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

/* Written by tools/cdf_table.py, where the fit is explained. */
extern const uint32_t onebit_cdf_value[41];
extern const int16_t onebit_cdf_curvature[40];
extern const int16_t onebit_cdf_skew[40];
extern const uint8_t onebit_cdf_scale[40];

/*
 * F(u): u in Q4.27, result in Q0.31. Over all 2^32 inputs (tests/test_cdf_sweep.c checks each):
 * error at most 4.5e-7, monotone, F(u) + F(-u) = 2^31 exactly, 1 <= F <= 2^31 - 1.
 * No division, five 32-bit products, no branch but for the sign and the end of the table.
 *
 * |u| is rounded to 2^-19, which makes most of the error (2^-20 times the density 0.399 is 3.8e-7)
 * and lets every product fit 32 bits. Beyond |u| = 5 the end of the table stands (2.9e-7 from 1).
 */
static inline uint32_t onebit_cdf(int32_t u)
{
    /* Magnitude in Q4.19, rounded; 2^31 for the one input without a positive twin. */
    uint32_t magnitude = ((u < 0 ? 0u - (uint32_t)u : (uint32_t)u) + 128u) >> 8;
    if (magnitude >= ((uint32_t)5 << 19)) {
        magnitude = ((uint32_t)5 << 19) - 1u;
    }
    uint32_t segment = magnitude >> 16; /* width 1/8 */
    uint32_t place = magnitude & 0xFFFFu;
    uint32_t scale = onebit_cdf_scale[segment];
    uint32_t value = onebit_cdf_value[segment];

    /* rise < 2^31 by the choice of scale; its upper half times place < 2^15 2^16. */
    uint32_t rise = (onebit_cdf_value[segment + 1u] - value) << scale;
    uint32_t line = (rise >> 16) * place + (((rise & 0xFFFFu) * place) >> 16);

    /* place (1 - place) <= 2^30, so 14 bits are left; |bend| < 2^15 by the choice of scale. */
    int32_t arch = (int32_t)((place * (0x10000u - place)) >> 16);
    int32_t bend =
        onebit_cdf_curvature[segment] + (((int32_t)place * onebit_cdf_skew[segment]) >> 16);
    uint32_t upper = value + ((line + (uint32_t)((arch * bend) >> 9)) >> scale);
    return u < 0 ? 0x80000000u - upper : upper;
}

#ifdef __cplusplus
}
#endif

#endif
