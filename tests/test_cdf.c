/*
 * The fixed-point CDF of lib/onebit_cdf.h, quickly: a coarse sweep and every edge of its table.
 * test_cdf_sweep.c takes all 2^32 inputs.
 */
#include "onebit_cdf.h"

#include "numbers.h"

#define ERROR_LIMIT 4.2e-7 /* as the header says */

static double largest_error;

void setUp(void)
{
}

void tearDown(void)
{
}

/* Range, symmetry and error of one input. */
static uint32_t check(int32_t u)
{
    uint32_t value = onebit_cdf(u);
    REQUIRE(value >= 1 && value <= 0x7FFFFFFFu, "F(%ld) = %lu", (long)u, (unsigned long)value);
    if (u != INT32_MIN) {
        REQUIRE(value + onebit_cdf(-u) == 0x80000000u, "F(%ld) + F(%ld) is not 2^31", (long)u,
                -(long)u);
    }
    double error =
        fabs(value * 0x1p-31 - 0.5 * erfc(-(double)u * 0x1p-27 * 0.70710678118654752440));
    REQUIRE(error <= ERROR_LIMIT, "F(%ld) is %.3g off", (long)u, error);
    if (error > largest_error) {
        largest_error = error;
    }
    return value;
}

static void test_half_at_zero(void)
{
    TEST_ASSERT_EQUAL_HEX32(0x40000000u, onebit_cdf(0));
}

/* Steps of a prime number, so that places within segments differ. */
static void test_coarse_sweep(void)
{
    uint32_t previous = 0;
    for (int64_t u = INT32_MIN; u <= INT32_MAX; u += 4093) {
        uint32_t value = check((int32_t)u);
        REQUIRE(value >= previous, "falls at %ld", (long)u);
        previous = value;
    }
}

/*
 * Every boundary between segments on both sides, the ends of the table and of the range: three
 * rounding cells of 256 inputs each way, without a gap.
 */
static void test_around_every_boundary(void)
{
    for (int32_t boundary = -41; boundary <= 41; ++boundary) {
        int32_t middle = boundary * (int32_t)(1 << 24);
        uint32_t previous = 0;
        for (int32_t u = middle - 800; u <= middle + 800; ++u) {
            uint32_t value = check(u);
            REQUIRE(value >= previous, "falls at %ld", (long)u);
            previous = value;
        }
    }
    uint32_t lowest = onebit_cdf(INT32_MIN);
    for (int32_t u = INT32_MIN; u < INT32_MIN + 800; ++u) {
        TEST_ASSERT_EQUAL_HEX32(lowest, check(u));
    }
    for (int32_t u = INT32_MAX; u > INT32_MAX - 800; --u) {
        TEST_ASSERT_EQUAL_HEX32(0x80000000u - lowest, check(u));
    }
}

/* "Beyond |u| = 5 the end of the table stands (2.9e-7 from 1)." */
static void test_end_of_the_table(void)
{
    uint32_t end = onebit_cdf(5 * (1 << 27));
    TEST_ASSERT_EQUAL_HEX32(end, onebit_cdf(5 * (1 << 27) - 256));
    TEST_ASSERT_EQUAL_HEX32(end, onebit_cdf(INT32_MAX));
    TEST_ASSERT_DOUBLE_WITHIN(0.05e-7, 2.9e-7, 1.0 - end * 0x1p-31);
}

static void test_table_size(void)
{
    TEST_ASSERT_EQUAL_UINT(324, sizeof onebit_cdf_table);
}

/*
 * What the header's unsigned arithmetic relies on: the bend, the bow less it, and the slope stay
 * within 0..2^32 - 1 over every segment. All are monotone in the place or bend once, so a place of
 * each 16 tells.
 */
static void test_terms_stay_positive(void)
{
    for (unsigned k = 0; k < ONEBIT_CDF_SEGMENTS; ++k) {
        const uint32_t *segment = &onebit_cdf_table[2 * k];
        int64_t skew = (int16_t)segment[1];
        int64_t bow = segment[1] + skew * 65536;
        int64_t rise = (int64_t)segment[2] - segment[0];
        for (int64_t place = 0; place < 65536; place += place < 65520 ? 16 : 1) {
            int64_t bend = segment[1] + skew * place;
            REQUIRE(bend >= 0 && bend <= UINT32_MAX, "bend of segment %u", k);
            int64_t inner = bow - (bend >> 16) * place;
            REQUIRE(inner >= 0 && inner <= UINT32_MAX, "bow of segment %u", k);
            int64_t slope = rise * 32 + (inner >> 5);
            REQUIRE(slope >= 0 && slope <= UINT32_MAX, "slope of segment %u", k);
        }
    }
}

/* F - bit, as the estimator asks for it: the same number for both bits, but for 2^31. */
static void test_minus(void)
{
    for (int64_t u = -ONEBIT_CDF_END; u <= ONEBIT_CDF_END; u += 4099) {
        uint32_t value = onebit_cdf((int32_t)u);
        TEST_ASSERT_TRUE(onebit_cdf_minus((int32_t)u, 0) == value);
        TEST_ASSERT_TRUE(onebit_cdf_minus((int32_t)u, 1) == value - 0x80000000u);
    }
}

static void test_report(void)
{
    printf("largest error met: %.4g\n", largest_error);
    /* The stated limit is tight enough to mean something. */
    TEST_ASSERT_TRUE(largest_error > 0.8 * ERROR_LIMIT);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_half_at_zero);
    RUN_TEST(test_coarse_sweep);
    RUN_TEST(test_around_every_boundary);
    RUN_TEST(test_end_of_the_table);
    RUN_TEST(test_table_size);
    RUN_TEST(test_terms_stay_positive);
    RUN_TEST(test_minus);
    RUN_TEST(test_report);
    return UNITY_END();
}
