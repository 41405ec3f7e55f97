/*
 * Integer operations for which processors differ too much to leave them to the compiler. Each has
 * one meaning, an exact one, so the results are the same everywhere; what differs is the way. The
 * ways that this host does not take are functions too, so that tests compare them here. Included by
 * onebit_cdf.h and onebit_fixed.h.
 */
#ifndef ONEBIT_PROCESSOR_H
#define ONEBIT_PROCESSOR_H

#include <stdbool.h>
#include <stdint.h>

/* Cortex-M0 and AVR have no instruction for the upper half of a 32-bit product. */
#if defined(__ARM_ARCH_6M__) || __SIZEOF_INT__ == 2
#define ONEBIT_PRODUCT_BY_HALVES 1
#else
#define ONEBIT_PRODUCT_BY_HALVES 0
#endif

/*
 * One half of a word, as a number that the compiler sees to have 16 bits. A mask or shift in place
 * of the union leads avr-gcc to multiply 32 by 32 bits: 280 cycles more in an estimator update.
 */
enum { ONEBIT_LOWER = 0, ONEBIT_UPPER = 1 };
static inline uint16_t onebit_half(uint32_t word, unsigned half)
{
    union {
        uint32_t word;
        uint16_t half[2];
    } both;
    both.word = word;
#if defined(__BYTE_ORDER__) && __BYTE_ORDER__ == __ORDER_BIG_ENDIAN__
    half = 1 - half;
#endif
    return both.half[half];
}

/* floor(value factor / 2^16), which is below 2^32. */
static inline uint32_t onebit_scaled_by_halves(uint32_t value, uint16_t factor)
{
    uint32_t least = (uint32_t)onebit_half(value, ONEBIT_LOWER) * onebit_half(factor, ONEBIT_LOWER);
    return (uint32_t)onebit_half(value, ONEBIT_UPPER) * onebit_half(factor, ONEBIT_LOWER) +
           onebit_half(least, ONEBIT_UPPER);
}

static inline uint32_t onebit_scaled(uint32_t value, uint16_t factor)
{
    /* The factor is moved up, so that the result is the upper word alone: one instruction. */
    return ONEBIT_PRODUCT_BY_HALVES
               ? onebit_scaled_by_halves(value, factor)
               : (uint32_t)(((uint64_t)value * ((uint32_t)factor << 16)) >> 32);
}

/* floor(value factor / 2^16) for a signed value. */
static inline int32_t onebit_scaled_signed_by_halves(int32_t value, uint16_t factor)
{
    uint32_t least =
        (uint32_t)onebit_half((uint32_t)value, ONEBIT_LOWER) * onebit_half(factor, ONEBIT_LOWER);
    return (int32_t)(int16_t)onebit_half((uint32_t)value, ONEBIT_UPPER) *
               (int32_t)onebit_half(factor, ONEBIT_LOWER) +
           onebit_half(least, ONEBIT_UPPER);
}

static inline int32_t onebit_scaled_signed(int32_t value, uint16_t factor)
{
    return ONEBIT_PRODUCT_BY_HALVES ? onebit_scaled_signed_by_halves(value, factor)
                                    : (int32_t)(((int64_t)value * ((uint32_t)factor << 16)) >> 32);
}

/*
 * value / 2^(places + 1), places 0..31: the floor, and in *fraction the 32 bits that follow it. By
 * bytes, then bits, for processors that shift one place at a time: an AVR takes 110 cycles less so.
 */
static inline int32_t onebit_shifted_by_steps(int32_t value, unsigned places, uint32_t *fraction)
{
    uint32_t lower = (uint32_t)value << 31;
    value >>= 1;
    for (; places >= 8; places -= 8) {
        lower = (lower >> 8) | ((uint32_t)value << 24);
        value >>= 8;
    }
    for (; places > 0; --places) {
        lower = (lower >> 1) | ((uint32_t)value << 31);
        value >>= 1;
    }
    *fraction = lower;
    return value;
}

static inline int32_t onebit_shifted(int32_t value, unsigned places, uint32_t *fraction)
{
#if __SIZEOF_INT__ == 2
    return onebit_shifted_by_steps(value, places, fraction);
#else
    *fraction = (uint32_t)value << (places ^ 31u); /* 31 - places, in one instruction of RISC-V */
    return (value >> places) >> 1;
#endif
}

/* Places that bring the highest set bit of a non-zero word to bit 31. */
static inline unsigned onebit_leading_zeros(uint32_t word)
{
#if defined(__GNUC__) && __SIZEOF_INT__ == 4
    return (unsigned)__builtin_clz(word);
#else
    unsigned places = 0;
    while (word < 0x80000000u) {
        word <<= 1;
        ++places;
    }
    return places;
#endif
}

/*
 * floor(2^16 dividend / divisor), dividend < divisor. Long division by shifting: 16 rounds, and no
 * division routine, which 8-bit and small 32-bit processors would have to link.
 */
static inline uint32_t onebit_quotient_by_shifting(uint32_t dividend, uint32_t divisor)
{
    uint32_t quotient = 0;
    for (unsigned round = 0; round < 16; ++round) {
        bool wraps =
            (dividend >> 31) != 0; /* then 2 dividend - divisor < divisor undoes the wrap */
        dividend <<= 1;
        quotient <<= 1;
        if (wraps || dividend >= divisor) {
            dividend -= divisor;
            quotient |= 1u;
        }
    }
    return quotient;
}

/* The same number by the divider that 64-bit processors have (5 times faster in onebit-bench). */
static inline uint32_t onebit_quotient(uint32_t dividend, uint32_t divisor)
{
#if UINTPTR_MAX > 0xFFFFFFFFu
    return (uint32_t)(((uint64_t)dividend << 16) / divisor);
#else
    return onebit_quotient_by_shifting(dividend, divisor);
#endif
}

#endif
