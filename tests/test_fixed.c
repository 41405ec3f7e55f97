/*
 * The fixed-point primitives of lib/onebit_fixed.h against exact arithmetic in 128 bits. Extreme
 * inputs stand among the random ones: under the asan preset an overflow or a bad shift ends the
 * test.
 */
#include "onebit_arithmetic.h"

#include "numbers.h"

#include <limits.h>

#if ONEBIT_ARITHMETIC != ONEBIT_Q31
#error "these are the primitives of q31"
#endif

__extension__ typedef __int128 wide;

static const int64_t edges_64[] = {0,
                                   1,
                                   -1,
                                   2,
                                   -2,
                                   3,
                                   -3,
                                   INT32_MAX,
                                   (int64_t)INT32_MAX + 1,
                                   (int64_t)INT32_MAX - 1,
                                   INT32_MIN,
                                   (int64_t)INT32_MIN - 1,
                                   (int64_t)INT32_MIN + 1,
                                   (int64_t)1 << 61,
                                   ((int64_t)1 << 61) - 1,
                                   -((int64_t)1 << 61),
                                   ((int64_t)1 << 62) - 1,
                                   (int64_t)1 << 62,
                                   -((int64_t)1 << 62)};
#define EDGES_64 (sizeof edges_64 / sizeof *edges_64)

static const int32_t edges_32[] = {0,
                                   1,
                                   -1,
                                   2,
                                   -2,
                                   255,
                                   256,
                                   32767,
                                   32768,
                                   -32768,
                                   65535,
                                   65536,
                                   -65536,
                                   (1 << 29),
                                   -(1 << 29),
                                   (1 << 30) - 1,
                                   INT32_MAX,
                                   INT32_MIN,
                                   INT32_MAX - 1,
                                   INT32_MIN + 1,
                                   (1 << 27),
                                   -(1 << 27),
                                   (1 << 30),
                                   12345678};
#define EDGES_32 (sizeof edges_32 / sizeof *edges_32)

void setUp(void)
{
}

void tearDown(void)
{
}

static wide power(int exponent)
{
    return (wide)1 << exponent;
}

static wide magnitude(wide value)
{
    return value < 0 ? -value : value;
}

/* The gain is mantissa * 2^-exponent. */
static int exponent_of(onebit_gain gain)
{
    return gain.places + 13;
}

static int32_t clamped(wide value)
{
    if (value > INT32_MAX) {
        return INT32_MAX;
    }
    return value < INT32_MIN ? INT32_MIN : (int32_t)value;
}

/* A number with about as many bits as any other: 1 to `bits`, of either sign. */
static int64_t random_size(uint64_t *seed, unsigned bits)
{
    unsigned width = 1u + random_word(seed) % bits;
    int64_t value = (int64_t)(random_bits(seed) >> (64u - width));
    return random_word(seed) & 1u ? -value : value;
}

static void test_saturate(void)
{
    for (unsigned k = 0; k < EDGES_64; ++k) {
        TEST_ASSERT_EQUAL_INT32(clamped(edges_64[k]), onebit_saturate(edges_64[k]));
    }
    TEST_ASSERT_EQUAL_INT32(INT32_MAX, onebit_saturate(INT64_MAX));
    TEST_ASSERT_EQUAL_INT32(INT32_MIN, onebit_saturate(INT64_MIN));
}

/*
 * value * 2^-shift "to the nearest": a result within the range is off by half a unit at most; one
 * at the range's end stands for a value that is there or beyond.
 */
static void check_rescale(int64_t value, int shift)
{
    int32_t result = onebit_rescale(value, shift);
    /* Further than 64 places everything has left the range or is nearer to 0 than to 1. */
    int places = shift > 64 ? 64 : (shift < -60 ? -60 : shift);
    bool right;
    if (places <= 0) {
        right = result == clamped((wide)value * power(-places));
    } else {
        wide off = (wide)result * power(places) - value;
        right = 2 * magnitude(off) <= power(places) || (result == INT32_MAX && off < 0) ||
                (result == INT32_MIN && off > 0);
    }
    REQUIRE(right, "rescale(%lld, %d) = %ld", (long long)value, shift, (long)result);
}

static void test_rescale(void)
{
    static const int far[] = {INT_MIN, -1000, -65, -64, -63, 63, 64, 65, 109, 1000, INT_MAX};
    for (unsigned k = 0; k < EDGES_64; ++k) {
        for (int shift = -70; shift <= 130; ++shift) {
            check_rescale(edges_64[k], shift);
        }
        for (unsigned f = 0; f < sizeof far / sizeof *far; ++f) {
            check_rescale(edges_64[k], far[f]);
        }
    }
    uint64_t seed = 11;
    for (unsigned trial = 0; trial < 2000000; ++trial) {
        check_rescale(random_size(&seed, 62), (int)(random_word(&seed) % 140u) - 60);
    }
}

/* Halves go up, on every shift: written down so that a change shows (bit-identity). */
static void test_rescale_of_halves(void)
{
    for (int shift = 1; shift <= 61; ++shift) {
        int64_t half = (int64_t)1 << (shift - 1);
        TEST_ASSERT_EQUAL_INT32(1, onebit_rescale(half, shift));
        TEST_ASSERT_EQUAL_INT32(0, onebit_rescale(half - 1, shift));
        TEST_ASSERT_EQUAL_INT32(0, onebit_rescale(-half, shift));
        TEST_ASSERT_EQUAL_INT32(-1, onebit_rescale(-half - 1, shift));
    }
}

/* Whatever z is: F of the exact difference, brought to 32 bits. */
static void check_distribution(int32_t threshold, int32_t z)
{
    REQUIRE(onebit_distribution(threshold, z) == onebit_cdf(clamped((wide)threshold - z)),
            "F(%ld - %ld)", (long)threshold, (long)z);
}

static void test_distribution(void)
{
    static const int32_t thresholds[] = {1 - (1 << 29), -1, 0, 1, 1 << 27, (1 << 29) - 1};
    uint64_t seed = 20;
    for (unsigned k = 0; k < sizeof thresholds / sizeof *thresholds; ++k) {
        for (unsigned m = 0; m < EDGES_32; ++m) {
            check_distribution(thresholds[k], edges_32[m]);
        }
        for (int32_t around = -600; around <= 600; ++around) {
            check_distribution(thresholds[k], thresholds[k] - ONEBIT_CDF_END + around);
            check_distribution(thresholds[k], thresholds[k] + ONEBIT_CDF_END + around);
        }
        for (unsigned trial = 0; trial < 300000; ++trial) {
            check_distribution(thresholds[k], (int32_t)random_word(&seed));
        }
    }
}

static void check_leading_zeros(uint32_t word)
{
    unsigned places = 0;
    while ((word << places) >> 31 == 0) {
        ++places;
    }
    REQUIRE(onebit_leading_zeros(word) == places && onebit_leading_zeros_by_steps(word) == places,
            "leading zeros of %lu", (unsigned long)word);
}

static void test_leading_zeros(void)
{
    uint64_t seed = 12;
    for (unsigned bit = 0; bit < 32; ++bit) {
        uint32_t word = (uint32_t)1 << bit;
        check_leading_zeros(word);
        check_leading_zeros(word | 1u);
        check_leading_zeros(word | (word - 1u));
        for (unsigned trial = 0; trial < 1000; ++trial) {
            check_leading_zeros(word | (random_word(&seed) & (word - 1u)));
        }
    }
}

static void test_row_valid(void)
{
    int32_t row[ONEBIT_STATES_MAX] = {0};
    TEST_ASSERT_TRUE(onebit_row_valid(row, ONEBIT_STATES_MAX));
    row[0] = INT32_MAX;
    TEST_ASSERT_TRUE(onebit_row_valid(row, 1));
    row[0] = -INT32_MAX;
    TEST_ASSERT_TRUE(onebit_row_valid(row, 2));
    row[1] = 1;
    TEST_ASSERT_FALSE(onebit_row_valid(row, 2));
    TEST_ASSERT_TRUE(onebit_row_valid(row, 1)); /* what lies behind the row does not count */
    row[1] = -1;
    TEST_ASSERT_FALSE(onebit_row_valid(row, 2));
    row[0] = INT32_MIN;
    TEST_ASSERT_FALSE(onebit_row_valid(row, 1));
    for (unsigned k = 0; k < ONEBIT_STATES_MAX; ++k) {
        row[k] = k % 2 == 0 ? INT32_MIN : INT32_MAX;
    }
    TEST_ASSERT_FALSE(onebit_row_valid(row, ONEBIT_STATES_MAX));
    for (unsigned k = 0; k < ONEBIT_STATES_MAX; ++k) {
        row[k] = k % 2 == 0 ? 134217727 : -134217727; /* 2^27 - 1: 16 of them are 2^31 - 16 */
    }
    TEST_ASSERT_TRUE(onebit_row_valid(row, ONEBIT_STATES_MAX));
    row[3] -= 15;
    TEST_ASSERT_TRUE(onebit_row_valid(row, ONEBIT_STATES_MAX));
    row[3] -= 1;
    TEST_ASSERT_FALSE(onebit_row_valid(row, ONEBIT_STATES_MAX));
}

static void check_dot(const int32_t *row, const int32_t *x, unsigned count, int shift)
{
    wide exact = 0;
    for (unsigned k = 0; k < count; ++k) {
        exact += (wide)row[k] * x[k];
    }
    TEST_ASSERT_TRUE(magnitude(exact) <= power(62)); /* the header's argument */
    int32_t result = onebit_dot(row, x, count, shift);
    bool right;
    if (shift <= 0) {
        right = result == clamped(exact * power(-shift));
    } else {
        wide off = (wide)result * power(shift) - exact;
        right = 2 * magnitude(off) <= power(shift) || (result == INT32_MAX && off < 0) ||
                (result == INT32_MIN && off > 0);
    }
    REQUIRE(right, "dot of %u, shift %d: %ld", count, shift, (long)result);
}

/* Shifts -31..77: all that valid fraction bits can make. */
static void test_dot(void)
{
    uint64_t seed = 13;
    int32_t row[ONEBIT_STATES_MAX];
    int32_t x[ONEBIT_STATES_MAX];
    for (unsigned trial = 0; trial < 500000; ++trial) {
        unsigned count = 1u + random_word(&seed) % ONEBIT_STATES_MAX;
        int64_t room = INT32_MAX;
        for (unsigned k = 0; k < count; ++k) {
            int64_t entry = random_size(&seed, 31);
            /* As large as the rule for rows allows. */
            entry = entry > room ? room : (entry < -room ? -room : entry);
            room -= entry < 0 ? -entry : entry;
            row[k] = (int32_t)entry;
            x[k] = trial % 3u == 0 ? edges_32[random_word(&seed) % EDGES_32]
                                   : (int32_t)random_word(&seed);
        }
        TEST_ASSERT_TRUE(onebit_row_valid(row, count));
        check_dot(row, x, count, (int)(random_word(&seed) % 109u) - 31);
    }
    for (unsigned k = 0; k < ONEBIT_STATES_MAX; ++k) {
        row[k] = k == 0 ? 134217727 + 15 : 134217727;
        x[k] = INT32_MIN;
    }
    for (int shift = -31; shift <= 77; ++shift) {
        check_dot(row, x, ONEBIT_STATES_MAX, shift);
    }
}

static void test_coefficient_valid(void)
{
    static const uint32_t values[] = {0,          1,     2,          3,          65535,
                                      65536,      65537, 0x7FFFFFFF, 0x80000000, 0x80000001,
                                      0xFFFFFFFF, 1000,  2097152,    2097153};
    for (unsigned v = 0; v < sizeof values / sizeof *values; ++v) {
        for (int bits = 0; bits <= 255; ++bits) {
            onebit_coefficient candidate = {values[v], (uint16_t)bits};
            bool formed = values[v] >= 0x80000000u && bits <= 62;
            TEST_ASSERT_EQUAL(formed, onebit_coefficient_valid(candidate));
            for (int limit = 0; formed && limit <= 31; ++limit) {
                bool within = values[v] <= power(limit) * power(bits);
                REQUIRE(onebit_coefficient_within(candidate, (unsigned)limit) == within,
                        "%lu with %d bits against 2^%d", (unsigned long)values[v], bits, limit);
            }
        }
    }
}

/*
 * "Relative error less than 2^-16 + 2^-23", in whole numbers: with both sides times t,
 * |mantissa t 2^(bits - exponent) - value| < value (2^8 + 2) 2^-24.
 */
static void check_gain(uint32_t value, int bits, uint32_t t)
{
    onebit_coefficient given = {value, (uint16_t)bits};
    onebit_gain gain = onebit_gain_of(given, onebit_reciprocal_of(t));
    REQUIRE(gain.mantissa >= 0x8000u, "gain %lu / %lu is not normalised", (unsigned long)value,
            (unsigned long)t);
    /* value / t lies between 2^-1 and 2^32, so the exponent between bits - 18 and bits + 16. */
    int shift = exponent_of(gain) - bits;
    REQUIRE(shift >= -17 && shift <= 16, "exponent of %lu / %lu", (unsigned long)value,
            (unsigned long)t);
    wide exact = (wide)value * power(17 + shift);
    wide actual = (wide)gain.mantissa * t * power(17);
    REQUIRE(magnitude(actual - exact) * power(24) < exact * 258,
            "gain %lu / %lu is off by 2^-16 + 2^-23 or more", (unsigned long)value,
            (unsigned long)t);
}

/* Coefficients whose mantissas are small numbers, ends and neighbours of a power of two. */
static void check_gains_at(uint32_t t)
{
    static const uint32_t values[] = {0x80000000, 0x80000001, 0x8000FFFF, 0xBB800000,
                                      0xC8000000, 0xFFFE8000, 0xFFFFFFFE, 0xFFFFFFFF};
    for (unsigned v = 0; v < sizeof values / sizeof *values; ++v) {
        check_gain(values[v], 31, t);
    }
}

static void test_gain_of(void)
{
    /*
     * The divisor's upper half decides all but the last of Newton's steps. So each of its 2^15
     * patterns, with the lower half at its ends and in the middle.
     */
    for (uint32_t upper = 0x8000; upper <= 0xFFFF; ++upper) {
        check_gains_at(upper << 16);
        check_gains_at(upper << 16 | 0x7FFF);
        check_gains_at(upper << 16 | 0xFFFF);
    }
    /* Every t of a run's beginning, and the neighbours of every power of two. */
    for (uint32_t t = 1; t <= 300000; ++t) {
        check_gains_at(t);
    }
    for (unsigned bit = 0; bit < 32; ++bit) {
        check_gains_at((uint32_t)1 << bit);
        check_gains_at(((uint32_t)1 << bit) + 1u);
        check_gains_at(0xFFFFFFFFu >> bit);
    }
    uint64_t seed = 14;
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        uint32_t t = random_word(&seed) >> random_word(&seed) % 32u;
        int bits = (int)(random_word(&seed) % 63u);
        check_gain(random_word(&seed) | 0x80000000u, bits, t | (t == 0));
    }
    onebit_coefficient largest = {0x80000000u, 15};
    TEST_ASSERT_EQUAL_INT16(-14, onebit_gain_of(largest, onebit_reciprocal_of(1)).places);
    TEST_ASSERT_EQUAL_HEX16(0x8000, onebit_gain_of(largest, onebit_reciprocal_of(1)).mantissa);
}

/* "Too small by less than 2^-24 of it, too large by less than 2^-30". */
static void check_inverse(uint32_t divisor)
{
    wide product = (wide)onebit_inverse(divisor) * divisor;
    REQUIRE(product < power(63) + power(33) && product > power(63) - power(39), "2^63 / %lu",
            (unsigned long)divisor);
}

static void test_inverse(void)
{
    static const uint32_t lower[] = {0, 1, 0x7FFF, 0x8000, 0xFFFE, 0xFFFF};
    for (uint32_t upper = 0x8000; upper <= 0xFFFF; ++upper) {
        for (unsigned k = 0; k < sizeof lower / sizeof *lower; ++k) {
            check_inverse(upper << 16 | lower[k]);
        }
    }
    uint64_t seed = 15;
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        check_inverse(random_word(&seed) | 0x80000000u);
    }
}

static void check_upper(uint32_t left, uint32_t right)
{
    uint32_t exact = (uint32_t)((wide)left * right >> 32);
    REQUIRE(onebit_upper(left, right) == exact && onebit_upper_by_halves(left, right) == exact,
            "%lu times %lu / 2^32", (unsigned long)left, (unsigned long)right);
}

static void test_upper(void)
{
    uint64_t seed = 22;
    for (unsigned k = 0; k < EDGES_32; ++k) {
        for (unsigned m = 0; m < EDGES_32; ++m) {
            check_upper((uint32_t)edges_32[k], (uint32_t)edges_32[m]);
        }
    }
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        check_upper(random_word(&seed), random_word(&seed));
    }
}

/* The way of processors without a product of 64 bits, too. */
static void check_product(int32_t left, int32_t right)
{
    int64_t exact = (int64_t)left * right;
    REQUIRE(onebit_product(left, right) == exact && onebit_product_by_halves(left, right) == exact,
            "%ld times %ld", (long)left, (long)right);
}

static void test_product(void)
{
    uint64_t seed = 21;
    for (unsigned k = 0; k < EDGES_32; ++k) {
        for (unsigned m = 0; m < EDGES_32; ++m) {
            check_product(edges_32[k], edges_32[m]);
        }
    }
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        check_product((int32_t)random_word(&seed), (int32_t)random_word(&seed));
    }
}

/* As many products of as large halves as a row may have: no sum of halves overflows. */
static void test_products(void)
{
    uint64_t seed = 24;
    int32_t left[ONEBIT_STATES_MAX];
    int32_t right[ONEBIT_STATES_MAX];
    for (unsigned trial = 0; trial < 200000; ++trial) {
        unsigned count = trial % (ONEBIT_STATES_MAX + 1u);
        int64_t exact = 0;
        for (unsigned k = 0; k < count; ++k) {
            bool edge = random_word(&seed) % 4u == 0;
            left[k] = edge ? edges_32[random_word(&seed) % EDGES_32] : (int32_t)random_word(&seed);
            left[k] /= ONEBIT_STATES_MAX; /* magnitudes add to at most 2^31 */
            right[k] = edge ? edges_32[random_word(&seed) % EDGES_32] : (int32_t)random_word(&seed);
            exact += (int64_t)left[k] * right[k];
        }
        REQUIRE(onebit_products(left, right, count) == exact &&
                    onebit_products_by_halves(left, right, count) == exact,
                "a sum of %u products", count);
    }
    for (unsigned k = 0; k < ONEBIT_STATES_MAX; ++k) {
        left[k] = k == 0 ? 0x07FFFFFF + 15 : 0x07FFFFFF; /* lower halves of 2^16 - 1 */
        right[k] = k % 2 == 0 ? INT32_MIN + 0xFFFF : INT32_MAX;
    }
    TEST_ASSERT_TRUE(onebit_products(left, right, ONEBIT_STATES_MAX) ==
                     onebit_products_by_halves(left, right, ONEBIT_STATES_MAX));
}

/* Both ways of processors without the upper half of a product, against 128 bits. */
static void check_scaled(uint32_t value, uint16_t factor)
{
    uint32_t exact = (uint32_t)(((wide)value * factor) >> 16);
    int32_t exact_signed = (int32_t)(((wide)(int32_t)value * factor) >> 16);
    REQUIRE(onebit_scaled(value, factor) == exact &&
                onebit_scaled_by_halves(value, factor) == exact &&
                onebit_scaled_signed((int32_t)value, factor) == exact_signed &&
                onebit_scaled_signed_by_halves((int32_t)value, factor) == exact_signed,
            "%lu times %u / 2^16", (unsigned long)value, factor);
}

static void test_scaled(void)
{
    static const uint16_t factors[] = {0, 1, 2, 255, 256, 0x7FFF, 0x8000, 0x8001, 0xFFFE, 0xFFFF};
    uint64_t seed = 18;
    for (unsigned f = 0; f < sizeof factors / sizeof *factors; ++f) {
        for (unsigned k = 0; k < EDGES_32; ++k) {
            check_scaled((uint32_t)edges_32[k], factors[f]);
        }
    }
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        check_scaled(random_word(&seed), (uint16_t)random_word(&seed));
    }
}

static void check_over_32(uint32_t value, uint16_t factor)
{
    uint32_t exact = (uint32_t)(((wide)value * factor) >> 21);
    REQUIRE(onebit_scaled_over_32(value, factor) == exact &&
                onebit_over_32_by_steps(onebit_scaled_by_halves(value, factor)) == exact &&
                onebit_over_32(value) == value / 32 && onebit_over_32_by_steps(value) == value / 32,
            "%lu times %u / 2^21", (unsigned long)value, factor);
}

static void test_over_32(void)
{
    uint64_t seed = 23;
    for (unsigned k = 0; k < EDGES_32; ++k) {
        check_over_32((uint32_t)edges_32[k], 0xFFFF);
    }
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        check_over_32(random_word(&seed), (uint16_t)random_word(&seed));
    }
}

/* "|value| > limit, in one comparison", to the ends of its range. */
static void test_beyond(void)
{
    static const int32_t limits[] = {1, 2, 1 << 26, (1 << 29) - 1, 1 << 29};
    const int32_t end = (1 << 30) + (1 << 29);
    for (unsigned k = 0; k < sizeof limits / sizeof *limits; ++k) {
        TEST_ASSERT_TRUE(onebit_beyond(end, limits[k]) && onebit_beyond(-end, limits[k]));
        for (int32_t around = -1; around <= 1; ++around) {
            TEST_ASSERT_EQUAL(around > 0, onebit_beyond(limits[k] + around, limits[k]));
            TEST_ASSERT_EQUAL(around < 0, onebit_beyond(-limits[k] + around, limits[k]));
        }
        TEST_ASSERT_FALSE(onebit_beyond(0, limits[k]));
    }
}

static void test_rotated(void)
{
    uint64_t seed = 25;
    for (unsigned trial = 0; trial < 100000; ++trial) {
        uint32_t word = random_word(&seed);
        unsigned places = 1u + trial % 31u;
        uint32_t exact = (uint32_t)((((uint64_t)word << 32) | word) >> places);
        REQUIRE(onebit_rotated(word, places) == exact &&
                    onebit_rotated_by_steps(word, places) == exact,
                "%lu rotated by %u", (unsigned long)word, places);
    }
}

/* The way of processors that shift one place at a time, too. */
static void check_shifted(int32_t value, unsigned places)
{
    wide exact = (wide)value * power(32) >> (places + 1); /* with 32 bits of fraction */
    uint32_t fraction;
    uint32_t fraction_by_steps;
    wide result = onebit_shifted(value, places, &fraction) * power(32);
    wide by_steps = onebit_shifted_by_steps(value, places, &fraction_by_steps) * power(32);
    REQUIRE(result + fraction == exact && by_steps + fraction_by_steps == exact, "%ld / 2^(%u + 1)",
            (long)value, places);
}

static void test_shifted(void)
{
    uint64_t seed = 19;
    for (unsigned places = 0; places < 32; ++places) {
        for (unsigned k = 0; k < EDGES_32; ++k) {
            check_shifted(edges_32[k], places);
        }
        for (unsigned trial = 0; trial < 100000; ++trial) {
            check_shifted((int32_t)random_word(&seed), places);
        }
    }
}

/* What one step of the estimator may do with the bits of an extreme configuration. */
static void check_accumulate(int32_t value, uint32_t carry, onebit_gain gain, int32_t innovation)
{
    onebit_estimate estimate = {value, carry};
    onebit_accumulate(&estimate, gain, innovation);

    /* In units of 2^-59, times 2^down so that the exact step is whole. */
    wide before = (wide)value * power(32) + carry;
    wide after = (wide)estimate.value * power(32) + estimate.carry;
    int down = exponent_of(gain) > 28 ? exponent_of(gain) - 28 : 0;
    wide exact = (wide)innovation * gain.mantissa * power(28 - exponent_of(gain) + down);
    wide step = (after - before) * power(down);
    /* Two floors: the product loses its lowest 16 bits, worth 2^(44 - exponent) here and at most
     * 2^-30 of the gain, then what is below 2^-59. The step is short by less than the larger. */
    wide grain = exponent_of(gain) < 44 ? power(44 - exponent_of(gain)) : 1;
    wide limit = power(62); /* 8 units of noise */
    bool right;
    if (magnitude(exact) < limit * power(down)) {
        /* 2^31 where -8 exactly, the floor of a little more, is taken for too large. */
        right = exact - step < grain * power(down) &&
                (step <= exact || (step == -(limit - power(31)) && exact - grain <= -limit));
    } else {
        right = step == (exact < 0 ? -1 : 1) * (limit - power(31)); /* 2^-28 less than 8 */
    }
    REQUIRE(right, "estimate %ld carry %lu gain %u 2^%d innovation %ld", (long)value,
            (unsigned long)carry, gain.mantissa, -exponent_of(gain), (long)innovation);
}

static void test_accumulate(void)
{
    static const uint16_t mantissas[] = {0x8000, 0x8001, 0xFFFF, 0xC3A5};
    static const uint32_t carries[] = {0, 1, 0x7FFFFFFF, 0x80000000, 0xFFFFFFFF};
    static const int32_t estimates[] = {0, 1, -1, 1 << 29, -(1 << 29), 12345678};
    /* Exponents from -1 (gain 2^16) to 62 + 31 + 31 (the smallest that a format can make). */
    for (int exponent = -1; exponent <= 124; ++exponent) {
        for (unsigned m = 0; m < sizeof mantissas / sizeof *mantissas; ++m) {
            onebit_gain gain = {mantissas[m], (int16_t)(exponent - 13)};
            for (unsigned i = 0; i < EDGES_32; ++i) {
                for (unsigned c = 0; c < sizeof carries / sizeof *carries; ++c) {
                    for (unsigned e = 0; e < sizeof estimates / sizeof *estimates; ++e) {
                        if (edges_32[i] != INT32_MIN && exponent <= 90) {
                            check_accumulate(estimates[e], carries[c], gain, edges_32[i]);
                        }
                    }
                }
            }
        }
    }
    uint64_t seed = 16;
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        onebit_gain gain = {(uint16_t)(0x8000u | random_word(&seed)),
                            (int16_t)(random_word(&seed) % 92u - 14u)};
        int32_t estimate = (int32_t)(random_word(&seed) % ((1u << 30) + 1u)) - (1 << 29);
        check_accumulate(estimate, random_word(&seed), gain, (int32_t)random_size(&seed, 31));
    }
}

/* Gains too small for 2^-59 leave 0 or, for the floor of a negative step, one unit of 2^-59. */
static void test_accumulate_with_tiny_gains(void)
{
    for (int exponent = 75; exponent <= 124; ++exponent) {
        onebit_gain gain = {0xFFFF, (int16_t)(exponent - 13)};
        onebit_estimate estimate = {5, 7};
        onebit_accumulate(&estimate, gain, INT32_MAX);
        TEST_ASSERT_EQUAL_INT32(5, estimate.value);
        TEST_ASSERT_EQUAL_UINT32(7, estimate.carry);
        onebit_accumulate(&estimate, gain, -INT32_MAX);
        TEST_ASSERT_EQUAL_INT32(5, estimate.value);
        TEST_ASSERT_EQUAL_UINT32(6, estimate.carry);
    }
}

/* "Twice the largest bound, so that the projection still finds it outside or 2^-27 beside it." */
static void test_too_large_a_step_ends_at_the_bound(void)
{
    static const int32_t innovations[] = {INT32_MAX, -INT32_MAX, INT32_MAX / 3, -INT32_MAX / 3};
    onebit_gain gain = {0x8000, -14};
    for (int32_t bound = 1 << 20; bound <= 1 << 29; bound <<= 1) {
        for (unsigned k = 0; k < sizeof innovations / sizeof *innovations; ++k) {
            bool rises = innovations[k] > 0;
            onebit_estimate estimate = {rises ? -bound : bound, 0};
            onebit_accumulate(&estimate, gain, innovations[k]);
            TEST_ASSERT_TRUE(rises ? estimate.value >= bound - 1 : estimate.value <= 1 - bound);
        }
    }
}

static void test_innovation(void)
{
    for (int64_t u = -(1 << 29); u <= 1 << 29; u += 9973) {
        int64_t probability = onebit_cdf((int32_t)u);
        TEST_ASSERT_TRUE(onebit_innovation((int32_t)u, false) == probability);
        TEST_ASSERT_TRUE(onebit_innovation((int32_t)u, true) == probability - 0x80000000LL);
    }
    /* "Within +-(2^31 - 1)" as far as the table goes. */
    TEST_ASSERT_TRUE(onebit_innovation(-ONEBIT_CDF_END, true) >= -INT32_MAX);
    TEST_ASSERT_TRUE(onebit_innovation(ONEBIT_CDF_END, false) > 0);
}

static void check_combine(int32_t stabilizing, onebit_gain gain, int64_t sum, int shift)
{
    /* The lower part need not be within 16 bits, nor positive. */
    const onebit_sum parts = {(int32_t)((sum + 0x5A5A5) >> 16),
                              (int32_t)(sum - (((sum + 0x5A5A5) >> 16) * 65536))};
    int32_t result = onebit_combine(stabilizing, gain, parts, shift);
    wide product = (wide)sum * gain.mantissa;
    int places = exponent_of(gain) + shift;
    places = places > 64 ? 64 : (places < -60 ? -60 : places);
    /* The consensus term is rounded and saturated by itself; at an end it is the result, else the
     * sum saturates. */
    wide lowest;
    wide highest;
    if (places <= 0) {
        lowest = highest = clamped(product * power(-places));
    } else {
        wide half = power(places - 1);
        /* The integers within half a unit: one, or two at a tie. */
        highest = clamped((product + half) >> places);
        lowest = clamped(-((half - product) >> places));
    }
    wide least =
        lowest >= INT32_MAX || lowest <= INT32_MIN ? lowest : clamped(stabilizing + lowest);
    wide most =
        highest >= INT32_MAX || highest <= INT32_MIN ? highest : clamped(stabilizing + highest);
    REQUIRE(result == least || result == most, "combine(%ld, %u 2^%d, %lld, %d) = %ld",
            (long)stabilizing, gain.mantissa, -exponent_of(gain), (long long)sum, shift,
            (long)result);
}

/* Sums of 32 differences, each of an estimate and any z, are exact. */
static void test_add_difference(void)
{
    uint64_t seed = 23;
    for (unsigned trial = 0; trial < 20000; ++trial) {
        onebit_sum sum = {0};
        wide exact = 0;
        for (unsigned k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
            int32_t z = trial % 3u == 0 ? edges_32[random_word(&seed) % EDGES_32]
                                        : (int32_t)random_word(&seed);
            int32_t value = (int32_t)random_size(&seed, 29);
            onebit_add_difference(&sum, value, z);
            exact += (wide)value - z;
            REQUIRE((wide)sum.upper * 65536 + sum.lower == exact, "sum of %u", k + 1u);
        }
    }
}

/* |sum| < 2^37, exponents of every coefficient and clock, shifts of every control format. */
static void test_combine(void)
{
    uint64_t seed = 17;
    for (unsigned trial = 0; trial < 3000000; ++trial) {
        onebit_gain gain = {(uint16_t)(0x8000u | random_word(&seed)),
                            (int16_t)((int)(random_word(&seed) % 160u) - 46)};
        int32_t stabilizing = trial % 4u == 0 ? edges_32[random_word(&seed) % EDGES_32]
                                              : (int32_t)random_size(&seed, 31);
        check_combine(stabilizing, gain, random_size(&seed, 37),
                      (int)(random_word(&seed) % 32u) - 4);
    }
    int64_t largest = ((int64_t)1 << 37) - 1;
    for (int exponent = -33; exponent <= 126; ++exponent) {
        onebit_gain gain = {0xFFFF, (int16_t)(exponent - 13)};
        for (int shift = -4; shift <= 27; ++shift) {
            for (unsigned k = 0; k < EDGES_32; ++k) {
                check_combine(edges_32[k], gain, largest, shift);
                check_combine(edges_32[k], gain, -largest, shift);
            }
        }
    }
}

static void test_everything_is_finite(void)
{
    TEST_ASSERT_TRUE(onebit_finite(INT32_MIN));
    TEST_ASSERT_TRUE(onebit_finite(INT32_MAX));
}

/* In an initializer, to the nearest, on both sides of zero. */
static void test_constants(void)
{
    static const int32_t constants[] = {
        ONEBIT_REAL(-0.5, 27),     ONEBIT_REAL(3.9999999, 27), ONEBIT_REAL(0.7, 4),
        ONEBIT_REAL(-0.7, 4),      ONEBIT_REAL(0, 31),         ONEBIT_REAL(1e-9, 46),
        ONEBIT_REAL(-0.9224, 31),  ONEBIT_REAL(2, 0),          ONEBIT_REAL(0.46875, 4),
        ONEBIT_REAL(1 - 0.25, 20),
    };
    static const int32_t expected[] = {-67108864, 536870899,   11, -11, 0,
                                       70369,     -1980838917, 2,  8,   786432};
    TEST_ASSERT_EQUAL_INT32_ARRAY(expected, constants, sizeof expected / sizeof *expected);
    TEST_ASSERT_EQUAL_INT32(1 << 29, ONEBIT_NOISE(4.0));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_saturate);
    RUN_TEST(test_rescale);
    RUN_TEST(test_rescale_of_halves);
    RUN_TEST(test_distribution);
    RUN_TEST(test_leading_zeros);
    RUN_TEST(test_row_valid);
    RUN_TEST(test_dot);
    RUN_TEST(test_coefficient_valid);
    RUN_TEST(test_gain_of);
    RUN_TEST(test_inverse);
    RUN_TEST(test_upper);
    RUN_TEST(test_product);
    RUN_TEST(test_products);
    RUN_TEST(test_scaled);
    RUN_TEST(test_over_32);
    RUN_TEST(test_beyond);
    RUN_TEST(test_rotated);
    RUN_TEST(test_shifted);
    RUN_TEST(test_accumulate);
    RUN_TEST(test_accumulate_with_tiny_gains);
    RUN_TEST(test_too_large_a_step_ends_at_the_bound);
    RUN_TEST(test_innovation);
    RUN_TEST(test_add_difference);
    RUN_TEST(test_combine);
    RUN_TEST(test_everything_is_finite);
    RUN_TEST(test_constants);
    return UNITY_END();
}
