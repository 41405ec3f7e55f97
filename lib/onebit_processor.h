/*
 * Integer operations for which processors differ too much to leave them to the compiler. Each has
 * one meaning, an exact one, so the results are the same everywhere; what differs is the way. The
 * ways that this host does not take are functions too, so that tests compare them here. Included by
 * onebit_cdf.h and onebit_fixed.h.
 *
 * What a processor can do is said by four macros, each 0 or 1, worked out below from what GCC and
 * compilers like it define. For a compiler that defines none of it they are to be set with -D; a
 * wrong one costs time and flash, never a bit of a result.
 */
#ifndef ONEBIT_PROCESSOR_H
#define ONEBIT_PROCESSOR_H

#include <limits.h>
#include <stdbool.h>
#include <stdint.h>

/* The first instruction set of Thumb: Cortex-M0, M0+, M1 and M23 have no other. */
#if defined(__thumb__) && !defined(__thumb2__)
#define ONEBIT_THUMB_1 1
#else
#define ONEBIT_THUMB_1 0
#endif

/* An instruction multiplies 32 by 32 bits into 64, or into the upper 32. */
#ifndef ONEBIT_HAS_WIDE_PRODUCT
#if ONEBIT_THUMB_1 || UINT_MAX == 0xFFFFu || (defined(__riscv) && !defined(__riscv_mul))
#define ONEBIT_HAS_WIDE_PRODUCT 0
#else
#define ONEBIT_HAS_WIDE_PRODUCT 1
#endif
#endif

/* An instruction counts leading zeros, and the compiler has GCC's __builtin_clzl for it. */
#ifndef ONEBIT_HAS_LEADING_ZEROS
#if defined(__GNUC__) && !ONEBIT_THUMB_1 &&                                                        \
    (defined(__ARM_FEATURE_CLZ) || UINTPTR_MAX > 0xFFFFFFFFu)
#define ONEBIT_HAS_LEADING_ZEROS 1
#else
#define ONEBIT_HAS_LEADING_ZEROS 0
#endif
#endif

/* A shift takes an instruction a place and byte, as on 8-bit processors. */
#ifndef ONEBIT_SHIFTS_BY_ONE
#if UINT_MAX == 0xFFFFu
#define ONEBIT_SHIFTS_BY_ONE 1
#else
#define ONEBIT_SHIFTS_BY_ONE 0
#endif
#endif

/* So few registers that a long inline function costs more than its call: Thumb has eight. */
#ifndef ONEBIT_FEW_REGISTERS
#define ONEBIT_FEW_REGISTERS ONEBIT_THUMB_1
#endif

/* A function that is then better not made a part of others; in GCC's words. */
#if ONEBIT_FEW_REGISTERS && defined(__GNUC__)
#define ONEBIT_LONG_FUNCTION static __attribute__((noinline, unused))
#else
#define ONEBIT_LONG_FUNCTION static inline
#endif

/*
 * One half of a word, as a number that the compiler sees to have 16 bits. Shifts need to know
 * nothing of the order of bytes. They lead avr-gcc to multiply 32 by 32 bits, 280 cycles more in an
 * estimator update, so an AVR, which is little-endian, takes a union.
 */
enum { ONEBIT_LOWER = 0, ONEBIT_UPPER = 1 };
static inline uint16_t onebit_half(uint32_t word, unsigned half)
{
#if defined(__AVR__)
    union {
        uint32_t word;
        uint16_t half[2];
    } both;
    both.word = word;
    return both.half[half];
#else
    return (uint16_t)(half == ONEBIT_UPPER ? word >> 16 : word);
#endif
}

/*
 * word / 2^5. By a byte to the right and three places to the left for processors that shift one
 * place at a time: an AVR takes 15 cycles less so.
 */
static inline uint32_t onebit_over_32_by_steps(uint32_t word)
{
    return ((word >> 8) << 3) | ((uint8_t)word >> 5);
}

static inline uint32_t onebit_over_32(uint32_t word)
{
    return ONEBIT_SHIFTS_BY_ONE ? onebit_over_32_by_steps(word) : word >> 5;
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
    return ONEBIT_HAS_WIDE_PRODUCT ? (uint32_t)(((uint64_t)value * ((uint32_t)factor << 16)) >> 32)
                                   : onebit_scaled_by_halves(value, factor);
}

/* floor(value factor / 2^21). */
static inline uint32_t onebit_scaled_over_32(uint32_t value, uint16_t factor)
{
    return ONEBIT_HAS_WIDE_PRODUCT ? (uint32_t)(((uint64_t)value * ((uint32_t)factor << 11)) >> 32)
                                   : onebit_over_32(onebit_scaled_by_halves(value, factor));
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
    return ONEBIT_HAS_WIDE_PRODUCT ? (int32_t)(((int64_t)value * ((uint32_t)factor << 16)) >> 32)
                                   : onebit_scaled_signed_by_halves(value, factor);
}

/*
 * The sum of left[k] right[k], |sum| <= 2^62, count at most 16. By halves: those of the four
 * partial products are added by their weight, 2^0, 2^16 and 2^32, where 48 halves do not overflow;
 * on Cortex-M0 12 instructions a product less than adding numbers of 64 bits, and 50 bytes more.
 */
static inline int64_t onebit_products_by_halves(const int32_t *left, const int32_t *right,
                                                unsigned count)
{
    uint32_t lower = 0;
    uint32_t middle = 0;
    int32_t upper = 0;
    for (; count > 0; --count) {
        uint32_t a = (uint32_t)*left++;
        uint32_t b = (uint32_t)*right++;
        int32_t a_upper = (int16_t)onebit_half(a, ONEBIT_UPPER);
        int32_t b_upper = (int16_t)onebit_half(b, ONEBIT_UPPER);
        uint32_t least = (uint32_t)onebit_half(a, ONEBIT_LOWER) * onebit_half(b, ONEBIT_LOWER);
        int32_t first = a_upper * (int32_t)onebit_half(b, ONEBIT_LOWER);
        int32_t second = b_upper * (int32_t)onebit_half(a, ONEBIT_LOWER);
        lower += onebit_half(least, ONEBIT_LOWER);
        middle += onebit_half(least, ONEBIT_UPPER);
        middle += onebit_half((uint32_t)first, ONEBIT_LOWER);
        middle += onebit_half((uint32_t)second, ONEBIT_LOWER);
        upper += (int16_t)onebit_half((uint32_t)first, ONEBIT_UPPER);
        upper += (int16_t)onebit_half((uint32_t)second, ONEBIT_UPPER);
        upper += a_upper * b_upper;
    }
    middle += onebit_half(lower, ONEBIT_UPPER);
    upper += onebit_half(middle, ONEBIT_UPPER);
    return (int64_t)((uint64_t)(uint32_t)upper << 32 | middle << 16 |
                     onebit_half(lower, ONEBIT_LOWER));
}

/* floor(left right / 2^32). */
static inline uint32_t onebit_upper_by_halves(uint32_t left, uint32_t right)
{
    uint32_t left_lower = onebit_half(left, ONEBIT_LOWER);
    uint32_t right_upper = onebit_half(right, ONEBIT_UPPER);
    uint32_t middle = onebit_scaled_by_halves(left, onebit_half(right, ONEBIT_LOWER));
    uint32_t second = left_lower * right_upper + onebit_half(middle, ONEBIT_LOWER);
    return (uint32_t)onebit_half(left, ONEBIT_UPPER) * right_upper +
           onebit_half(middle, ONEBIT_UPPER) + onebit_half(second, ONEBIT_UPPER);
}

static inline uint32_t onebit_upper(uint32_t left, uint32_t right)
{
    return ONEBIT_HAS_WIDE_PRODUCT ? (uint32_t)(((uint64_t)left * right) >> 32)
                                   : onebit_upper_by_halves(left, right);
}

/*
 * left right in 64 bits. By halves for Cortex-M0, where the compiler calls a routine of 92 bytes
 * for 64 by 64 bits; an 8-bit processor's own way is quicker than this one by 200 cycles.
 */
static inline int64_t onebit_product_by_halves(int32_t left, int32_t right)
{
    int32_t left_lower = onebit_half((uint32_t)left, ONEBIT_LOWER);
    uint16_t right_lower = onebit_half((uint32_t)right, ONEBIT_LOWER);
    int32_t right_upper = (int16_t)onebit_half((uint32_t)right, ONEBIT_UPPER);
    int32_t middle = onebit_scaled_signed_by_halves(left, right_lower);
    int32_t second = left_lower * right_upper + onebit_half((uint32_t)middle, ONEBIT_LOWER);
    int32_t upper = (left >> 16) * right_upper + (middle >> 16) + (second >> 16);
    return (int64_t)((uint64_t)upper << 32 | (uint32_t)left * (uint32_t)right);
}

static inline int64_t onebit_product(int32_t left, int32_t right)
{
    return ONEBIT_HAS_WIDE_PRODUCT || ONEBIT_SHIFTS_BY_ONE ? (int64_t)left * right
                                                           : onebit_product_by_halves(left, right);
}

/* As onebit_products_by_halves where that is quicker, and little space is not what is asked for. */
static inline int64_t onebit_products(const int32_t *left, const int32_t *right, unsigned count)
{
#if ONEBIT_HAS_WIDE_PRODUCT || ONEBIT_SHIFTS_BY_ONE || defined(__OPTIMIZE_SIZE__)
    int64_t sum = 0;
    for (unsigned k = 0; k < count; ++k) {
        sum += onebit_product(left[k], right[k]);
    }
    return sum;
#else
    return onebit_products_by_halves(left, right, count);
#endif
}

/*
 * value / 2^(places + 1), places 0..31: the floor, and in *fraction the 32 bits that follow it. By
 * bits, then bytes, for processors that shift one place at a time: an AVR takes 170 cycles less so.
 */
static inline int32_t onebit_shifted_by_steps(int32_t value, unsigned places, uint32_t *fraction)
{
    uint8_t bits = (uint8_t)((places + 1u) & 7u);
    uint8_t bytes = (uint8_t)((places + 1u) >> 3);
    uint32_t lower = (uint32_t)(uint8_t)((unsigned)(uint8_t)value << (8u - bits)) << 24;
    value >>= bits;
    for (; bytes > 0; --bytes) {
        lower = (lower >> 8) | ((uint32_t)value << 24);
        value >>= 8;
    }
    *fraction = lower;
    return value;
}

static inline int32_t onebit_shifted(int32_t value, unsigned places, uint32_t *fraction)
{
#if ONEBIT_SHIFTS_BY_ONE
    return onebit_shifted_by_steps(value, places, fraction);
#else
    *fraction = (uint32_t)value << (places ^ 31u); /* 31 - places, in one instruction of RISC-V */
    return (value >> places) >> 1;
#endif
}

/*
 * A word rotated to the right, places 1..31. By bytes, then at most four bits to the nearer side,
 * for processors that shift one place at a time: a random word takes an AVR 3,000 cycles less so.
 */
static inline uint32_t onebit_rotated_by_steps(uint32_t word, unsigned places)
{
    uint8_t bits = (uint8_t)(places & 7u);
    uint8_t bytes = (uint8_t)((places + 3u) >> 3 & 3u);
    for (; bytes > 0; --bytes) {
        word = word >> 8 | word << 24;
    }
    if (bits > 4) {
        for (; bits < 8; ++bits) {
            word = word << 1 | word >> 31;
        }
    } else {
        for (; bits > 0; --bits) {
            word = word >> 1 | word << 31;
        }
    }
    return word;
}

static inline uint32_t onebit_rotated(uint32_t word, unsigned places)
{
    return ONEBIT_SHIFTS_BY_ONE ? onebit_rotated_by_steps(word, places)
                                : word >> places | word << (32u - places);
}

/*
 * Adds a step and its fraction to a value and its fraction. With a branch where a comparison's
 * result has to be made of four bytes: 8 cycles less on an AVR, 3 instructions more elsewhere.
 */
static inline void onebit_add(int32_t *value, uint32_t *fraction, int32_t step,
                              uint32_t step_fraction)
{
    *fraction += step_fraction;
#if ONEBIT_SHIFTS_BY_ONE
    if (*fraction < step_fraction) {
        ++step;
    }
    *value += step;
#else
    *value += step + (*fraction < step_fraction);
#endif
}

/*
 * Places that bring the highest set bit of a non-zero word to bit 31. By bytes, then bits, where
 * there is no instruction for it: the compiler's routine takes 60 bytes on Cortex-M0, 290 on RV32.
 */
static inline unsigned onebit_leading_zeros_by_steps(uint32_t word)
{
    unsigned places = 0;
    for (; word < 0x01000000u; word <<= 8) {
        places += 8;
    }
    for (; word < 0x80000000u; word <<= 1) {
        ++places;
    }
    return places;
}

static inline unsigned onebit_leading_zeros(uint32_t word)
{
#if ONEBIT_HAS_LEADING_ZEROS
    /* Of a long, which has 32 bits or more everywhere. */
    return (unsigned)__builtin_clzl(word) - 8u * (unsigned)(sizeof(long) - sizeof word);
#else
    return onebit_leading_zeros_by_steps(word);
#endif
}

#endif
