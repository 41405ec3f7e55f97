/*
 * One step of the estimator (lib/onebit_estimator.h) in each arithmetic: projection, and the
 * paper's formula in double precision.
 */
#include "onebit.h"

#include "onebit_estimator.h"

#include "numbers.h"

void setUp(void)
{
}

void tearDown(void)
{
}

/* A setting that onebit_check would take: |c| + M <= 4, gain over clock of every size. */
struct setting {
    onebit_real threshold, bound;
    onebit_coefficient gain;
    uint32_t t;
};

static struct setting random_setting(uint64_t *seed)
{
    double threshold = random_between(seed, -3.9, 3.9);
    double bound = random_between(seed, 0.001, 4.0 - fabs(threshold) - 0.001);
    /* Even in the logarithm. */
    double gain = exp2(random_between(seed, -10, 16));
    uint32_t t = random_word(seed) >> random_word(seed) % 32u;
    struct setting setting = {number(threshold), number(bound), coefficient(gain), t | (t == 0)};
    return setting;
}

static onebit_real negated(onebit_real value)
{
    return -value;
}

/* Never outside [-M, M], for any bits, gains, thresholds; and the projection clears the carry. */
static void test_estimate_never_leaves_the_bound(void)
{
    uint64_t seed = 21;
    unsigned projected = 0;
    for (unsigned trial = 0; trial < 200000; ++trial) {
        struct setting setting = random_setting(&seed);
        onebit_estimate estimate = {number(value_of(setting.bound) * random_between(&seed, -1, 1)),
                                    0};
        for (unsigned step = 0; step < 10; ++step) {
            onebit_gain gain = onebit_gain_at(setting.gain, setting.t);
            onebit_update(&estimate, &gain, setting.threshold, &setting.bound,
                          (random_word(&seed) & 1u) != 0);
            REQUIRE(estimate.value <= setting.bound && estimate.value >= negated(setting.bound),
                    "%.17g outside %.17g", value_of(estimate.value), value_of(setting.bound));
            projected +=
                estimate.value == setting.bound || estimate.value == negated(setting.bound);
        }
    }
    TEST_ASSERT_TRUE(projected > 100000); /* it was put to the test */
}

static void test_projection(void)
{
    uint64_t seed = 22;
    for (unsigned trial = 0; trial < 1000000; ++trial) {
        onebit_real bound = number(random_between(&seed, 0.001, 4));
        onebit_estimate a = {number(random_between(&seed, -15, 15) * random_unit(&seed)), 1};
        onebit_estimate b = {number(random_between(&seed, -15, 15) * random_unit(&seed)), 1};
        double before = fabs(value_of(a.value) - value_of(b.value));
        bool outside = a.value > bound || a.value < negated(bound);
        onebit_real inside = a.value;
        onebit_project(&a, bound);
        onebit_project(&b, bound);
        TEST_ASSERT_TRUE(a.value <= bound && a.value >= negated(bound));
        /* Non-expansive; both differences are of numbers below 16, exact in double. */
        TEST_ASSERT_TRUE(fabs(value_of(a.value) - value_of(b.value)) <= before);
        /* Only what lies outside moves, to the nearer bound, and loses its carry. */
        TEST_ASSERT_TRUE(a.carry == (outside ? 0 : 1));
        TEST_ASSERT_TRUE(outside ? (inside > 0 ? a.value == bound : a.value == negated(bound))
                                 : a.value == inside);
        /* Idempotent. */
        onebit_estimate again = a;
        onebit_project(&again, bound);
        TEST_ASSERT_TRUE(again.value == a.value && again.carry == a.carry);
    }
}

static void test_projection_leaves_the_bounds_themselves(void)
{
    onebit_real bound = number(1.5);
    onebit_estimate estimate = {bound, 1};
    onebit_project(&estimate, bound);
    TEST_ASSERT_TRUE(estimate.value == bound && estimate.carry == 1);
    estimate.value = negated(bound);
    onebit_project(&estimate, bound);
    TEST_ASSERT_TRUE(estimate.value == negated(bound) && estimate.carry == 1);
}

/*
 * zhat' = project(zhat + carry + (b/t)(F(c - zhat) - bit)) in double precision. The library's
 * result may differ by
 *
 * - the error of F, times the gain;
 * - roundings relative to the increment: the gain's, and three of f32 or f64 (F - bit, the product,
 *   the sum with the carry); in q31 the product's cut to 2^-30 of the gain;
 * - the estimate's own rounding: 2^-27 (floor), or half an ulp;
 * - in q31, where a step saturates at 8 units of noise, 2^-27 beside the bound;
 * - the double precision of this reference, 2^-52 of each number that it adds.
 */
static void test_formula(void)
{
    uint64_t seed = 23;
    unsigned inside = 0;
    for (unsigned trial = 0; trial < 300000; ++trial) {
        struct setting setting = random_setting(&seed);
        onebit_estimate estimate = {number(value_of(setting.bound) * random_between(&seed, -1, 1)),
                                    0};
        for (unsigned step = 0; step < 4; ++step) {
            bool bit = (random_word(&seed) & 1u) != 0;
            double gain = coefficient_value(setting.gain) / (double)setting.t;
            double bound = value_of(setting.bound);
            double innovation =
                normal_distribution(value_of(setting.threshold) - value_of(estimate.value)) -
                (bit ? 1.0 : 0.0);
            double increment = gain * innovation;
            double expected = estimate_value(&estimate) + increment;
            expected = fmin(fmax(expected, -bound), bound);

            onebit_gain rounded = onebit_gain_at(setting.gain, setting.t);
            onebit_update(&estimate, &rounded, setting.threshold, &setting.bound, bit);
            double tolerance = gain * DISTRIBUTION_ERROR + 0x1p-52 * (fabs(increment) + 4);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
            tolerance += fabs(increment) * GAIN_ERROR + gain * 0x1p-30 + 0x1p-27;
#elif ONEBIT_ARITHMETIC == ONEBIT_F32
            tolerance += fabs(increment) * (GAIN_ERROR + 3 * 0x1p-24) + fabs(expected) * 0x1p-24;
#else
            tolerance += fabs(increment) * (GAIN_ERROR + 3 * 0x1p-53) + fabs(expected) * 0x1p-53;
#endif
            REQUIRE(fabs(value_of(estimate.value) - expected) <= tolerance,
                    "gain %g: %.12g instead of %.12g, tolerance %.3g", gain,
                    value_of(estimate.value), expected, tolerance);
            inside += fabs(expected) < bound;
        }
    }
    TEST_ASSERT_TRUE(inside > 300000); /* and not all of it at the bounds */
}

/* A 0 never lowers the estimate and a 1 never raises it; a gain worth a unit does move it. */
static void test_direction(void)
{
    uint64_t seed = 24;
    for (unsigned trial = 0; trial < 500000; ++trial) {
        struct setting setting = random_setting(&seed);
        onebit_gain gain = onebit_gain_at(setting.gain, setting.t);
        onebit_real start = number(value_of(setting.bound) * random_between(&seed, -0.9, 0.9));
        onebit_estimate zero = {start, 0};
        onebit_estimate one = {start, 0};
        onebit_update(&zero, &gain, setting.threshold, &setting.bound, false);
        onebit_update(&one, &gain, setting.threshold, &setting.bound, true);
        TEST_ASSERT_TRUE(zero.value >= start);
        TEST_ASSERT_TRUE(one.value <= start);
        /* F and 1 - F are at least F(-4) = 3.2e-5; an ulp of f32 below 4 is 2^-22. */
        if (gain_value(gain) * 3e-5 > 0x1p-22) {
            TEST_ASSERT_TRUE(zero.value > start);
            TEST_ASSERT_TRUE(one.value < start);
        }
    }
}

/* At a bound, the bit that pushes outward changes nothing and the other one leads back inside. */
static void test_bits_at_the_extremes(void)
{
    static const double thresholds[] = {-3, -1, 0, 1, 3};
    for (unsigned k = 0; k < sizeof thresholds / sizeof *thresholds; ++k) {
        onebit_real threshold = number(thresholds[k]);
        onebit_real bound = number(4 - fabs(thresholds[k]));
        onebit_gain gain = onebit_gain_at(coefficient(100), 1000);
        onebit_estimate high = {bound, 0};
        onebit_update(&high, &gain, threshold, &bound, false);
        TEST_ASSERT_TRUE(high.value == bound && high.carry == 0);
        onebit_update(&high, &gain, threshold, &bound, true);
        TEST_ASSERT_TRUE(high.value < bound);
        onebit_estimate low = {negated(bound), 0};
        onebit_update(&low, &gain, threshold, &bound, true);
        TEST_ASSERT_TRUE(low.value == negated(bound) && low.carry == 0);
        onebit_update(&low, &gain, threshold, &bound, false);
        TEST_ASSERT_TRUE(low.value > negated(bound));
        /* The largest gain there is takes it from one bound to the other, or, where the saturated
         * step of q31 is meant, to 2^-27 beside it. */
        gain = onebit_gain_at(coefficient(65536), 1);
        onebit_update(&high, &gain, threshold, &bound, true);
        TEST_ASSERT_TRUE(value_of(high.value) <= -value_of(bound) + 0x1p-27);
        onebit_update(&high, &gain, threshold, &bound, false);
        TEST_ASSERT_TRUE(value_of(high.value) >= value_of(bound) - 0x1p-27);
    }
}

/* F in units of 2^-31 and F - bit, over the arguments that encode and estimate can meet. */
static void test_distribution(void)
{
    for (double u = -15.999; u < 15.999; u += 0.00137) {
        double argument = value_of(number(u));
        double exact = normal_distribution(argument);
        /* Beyond 5 the table ends, 2.9e-7 from 0 and 1. */
        REQUIRE(fabs((double)onebit_distribution(0, number(-u)) * 0x1p-31 - exact) <=
                    DISTRIBUTION_ERROR,
                "F(%g)", u);
        /* One rounding of f32 on top, 2^-25 of a number up to 1. */
        double rounding = ONEBIT_ARITHMETIC == ONEBIT_F32 ? 0x1p-25 : 0;
        double scale = ONEBIT_ARITHMETIC == ONEBIT_Q31 ? 0x1p-31 : 1;
        for (int bit = 0; bit <= 1 && fabs(u) <= 4; ++bit) { /* as far as the estimator asks */
            double innovation = scale * (double)onebit_innovation(number(u), bit != 0);
            REQUIRE(fabs(innovation - (exact - bit)) <= DISTRIBUTION_ERROR + rounding, "F(%g) - %d",
                    u, bit);
        }
    }
}

#if ONEBIT_ARITHMETIC == ONEBIT_F32

/* Beyond what Q4.27 holds the ends of the table stand, NaN among them: no undefined conversion. */
static void test_distribution_of_anything(void)
{
    uint32_t end = onebit_cdf(INT32_MAX);
    const float large[] = {15.98f, 15.99f, 16.0f, 1e10f, 3.4e38f, INFINITY, NAN};
    for (unsigned k = 0; k < sizeof large / sizeof *large; ++k) {
        TEST_ASSERT_EQUAL_HEX32(end, onebit_distribution(large[k], 0));
        if (large[k] == large[k]) {
            TEST_ASSERT_EQUAL_HEX32(0x80000000u - end, onebit_distribution(-large[k], 0));
        }
    }
}

#endif

#if ONEBIT_ARITHMETIC != ONEBIT_Q31

static void test_finite(void)
{
    TEST_ASSERT_TRUE(onebit_finite(0));
    TEST_ASSERT_TRUE(onebit_finite((onebit_real)-3.4e38));
    TEST_ASSERT_FALSE(onebit_finite((onebit_real)INFINITY));
    TEST_ASSERT_FALSE(onebit_finite((onebit_real)-INFINITY));
    TEST_ASSERT_FALSE(onebit_finite((onebit_real)NAN));
}

static void test_coefficient_valid(void)
{
    TEST_ASSERT_TRUE(onebit_coefficient_valid((onebit_real)1e-30));
    TEST_ASSERT_TRUE(onebit_coefficient_valid((onebit_real)1e30));
    TEST_ASSERT_TRUE(onebit_coefficient_within(65536, 16));
    TEST_ASSERT_FALSE(onebit_coefficient_within((onebit_real)65536.01, 16));
    const onebit_real wrong[] = {0, -1, (onebit_real)INFINITY, (onebit_real)-INFINITY,
                                 (onebit_real)NAN};
    for (unsigned k = 0; k < sizeof wrong / sizeof *wrong; ++k) {
        TEST_ASSERT_FALSE(onebit_coefficient_valid(wrong[k]));
    }
}

/* What the addition rounds away is kept: estimate + carry is the sum to twice the precision. */
static void test_carry_keeps_the_remainder(void)
{
    const double half_ulp = ONEBIT_ARITHMETIC == ONEBIT_F32 ? 0x1p-24 : 0x1p-53;
    onebit_estimate estimate = {1, 0};
    onebit_accumulate(&estimate, number(half_ulp), number(0.25));
    TEST_ASSERT_TRUE(estimate.value == 1);
    TEST_ASSERT_TRUE(estimate.carry == number(half_ulp * 0.25));
    for (unsigned step = 0; step < 3; ++step) {
        onebit_accumulate(&estimate, number(half_ulp), number(0.75));
    }
    /* 2.5 half ulps in all: one ulp and half of a half one. */
    TEST_ASSERT_TRUE(value_of(estimate.value) == 1 + 2 * half_ulp);
    TEST_ASSERT_TRUE(value_of(estimate.carry) == half_ulp * 0.5);
}

#endif

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_estimate_never_leaves_the_bound);
    RUN_TEST(test_projection);
    RUN_TEST(test_projection_leaves_the_bounds_themselves);
    RUN_TEST(test_formula);
    RUN_TEST(test_direction);
    RUN_TEST(test_bits_at_the_extremes);
    RUN_TEST(test_distribution);
#if ONEBIT_ARITHMETIC == ONEBIT_F32
    RUN_TEST(test_distribution_of_anything);
#endif
#if ONEBIT_ARITHMETIC != ONEBIT_Q31
    RUN_TEST(test_finite);
    RUN_TEST(test_coefficient_valid);
    RUN_TEST(test_carry_keeps_the_remainder);
#endif
    return UNITY_END();
}
