/*
 * The fixed-point CDF of lib/onebit_cdf.h, quickly: a coarse sweep and every edge of its table.
 * test_cdf_sweep.c takes all 2^32 inputs.
 */
#include "onebit_cdf.h"

#include "numbers.h"

#define ERROR_LIMIT 4.5e-7 /* as the header says */

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
    size_t size = sizeof onebit_cdf_value + sizeof onebit_cdf_curvature + sizeof onebit_cdf_skew +
                  sizeof onebit_cdf_scale;
    TEST_ASSERT_EQUAL_UINT(364, size);
    TEST_ASSERT_TRUE(size <= 512);
}

/* What the header's arithmetic relies on: rise < 2^31 and |bend| < 2^15 in every segment. */
static void test_scales_leave_room(void)
{
    for (unsigned segment = 0; segment < 40; ++segment) {
        uint64_t rise = (uint64_t)(onebit_cdf_value[segment + 1] - onebit_cdf_value[segment])
                        << onebit_cdf_scale[segment];
        TEST_ASSERT_TRUE(onebit_cdf_value[segment + 1] > onebit_cdf_value[segment]);
        TEST_ASSERT_TRUE(rise < (uint64_t)1 << 31);
        /* Linear in the place, so extreme at the ends. */
        int32_t end = onebit_cdf_curvature[segment] + onebit_cdf_skew[segment];
        TEST_ASSERT_TRUE(end > -32768 && end < 32768);
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
    RUN_TEST(test_scales_leave_room);
    RUN_TEST(test_report);
    return UNITY_END();
}
