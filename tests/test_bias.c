/*
 * The paired bias test for f32 and q31: one million steps of the library's estimator
 * and of a twin in double precision, on the same bits, from late clocks. The twin takes libm's erfc
 * and rounds to 2^-53, 1e-10 over a run at worst, so it needs no carry. After t1 the two differ by
 * at most
 *
 *     (eps / phi(u)) (1 - (t0/t1)^(b phi(u)))  +  2^-16 (way moved)  +  4 units,   u = c - z.
 *
 * - An error eps of the CDF makes the estimator settle where F is off by as much: eps / phi(u)
 * away. Of the difference e left, each step takes the share b phi(u) / t, so that e falls as t^-(b
 * phi(u)). (The project's design first had 1 for the exponent. Runs that begin at z show
 * that it is too little: they pass that bound by a factor of up to 1.6 from t0 = 1e8, where b phi
 * is above 100.)
 * - Each gain is rounded to 2^-16 of itself (2^-23 in f32), and with it the way that the gains have
 *   moved the estimate: the distance between the first and the last.
 * - A unit is what rounding leaves of an estimate when no carry goes with it: 2^-27 in q31, half an
 *   ulp in f32.
 *
 * The first two argue with the mean; the seeds are fixed. Sampling noise, common to both, is a
 * thousand times larger: unpaired runs show nothing.
 *
 * Without the carry (estimate->carry = 0 after each step) 93 of the 96 runs fail in q31, all of
 * those from 1e8 and 4e9 among them, by up to 230,000 times the limit; in f32 59 runs fail, 45 of
 * the 48 from 1e8 and 4e9, by up to 102,000 times.
 */
#include "onebit.h"

#include "onebit_estimator.h"

#include "numbers.h"

#if ONEBIT_ARITHMETIC == ONEBIT_F64
#error "the twin is no more precise than f64"
#endif

#define STEPS 1000000u

void setUp(void)
{
}

void tearDown(void)
{
}

struct setting {
    double gain, threshold, bound; /* beta/sigma, c/sigma, M/sigma */
};

/* Half an ulp of f32 at a value. */
static double unit_at(double value)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    (void)value;
    return 0x1p-27;
#else
    int exponent;
    (void)frexp(value, &exponent);
    return ldexp(1.0, exponent - 25);
#endif
}

static double largest_share;

static void check_run(const struct setting *setting, double first, double z, uint32_t t0,
                      uint64_t seed)
{
    onebit_estimate estimate = {number(first), 0};
    const onebit_real threshold = number(setting->threshold);
    const onebit_real bound = number(setting->bound);
    const onebit_coefficient coefficient_over_t = coefficient(setting->gain);
    const double probability = normal_distribution(setting->threshold - z);
    double twin = value_of(estimate.value);
    first = twin;
    uint32_t t = t0;
    for (unsigned step = 0; step < STEPS; ++step) {
        ++t;
        bool bit = random_unit(&seed) < probability;
        onebit_gain gain = onebit_gain_at(coefficient_over_t, t);
        onebit_update(&estimate, &gain, threshold, &bound, bit);
        double distribution = 0.5 * erfc((twin - setting->threshold) * 0.70710678118654752440);
        twin += setting->gain / (double)t * (distribution - (bit ? 1.0 : 0.0));
        twin = fmin(fmax(twin, -setting->bound), setting->bound);
    }
    double off = fabs(value_of(estimate.value) - twin);
    double density = normal_density(setting->threshold - z);
    double settled = 1.0 - pow((double)t0 / (double)t, setting->gain * density);
    double limit =
        DISTRIBUTION_ERROR / density * settled + 0x1p-16 * fabs(twin - first) + 4 * unit_at(twin);
    largest_share = fmax(largest_share, off / limit);
    REQUIRE(off <= limit, "b %g, c %g, M %g, z %g, %g from %lu: %.4g off, at most %.4g",
            setting->gain, setting->threshold, setting->bound, z, first, (unsigned long)t0, off,
            limit);
}

static void check_settings(uint32_t t0)
{
    /* Both examples of the paper, and a wide one with a threshold above zero. */
    static const struct setting settings[] = {
        {1500.0 / 4, -0.5, 0.5}, {10000.0 / 4, -0.5, 0.5}, {20, 1, 2}};
    static const double places[] = {-0.9, -0.4, 0.2, 0.8}; /* of z, in bounds */
    uint64_t seed = t0;
    for (unsigned s = 0; s < sizeof settings / sizeof *settings; ++s) {
        for (unsigned p = 0; p < sizeof places / sizeof *places; ++p) {
            double z = places[p] * settings[s].bound;
            check_run(&settings[s], 0, z, t0, ++seed);
            check_run(&settings[s], z, z, t0, ++seed);
        }
    }
    printf("from %lu: at most %.2f of the limit\n", (unsigned long)t0, largest_share);
    largest_share = 0;
}

static void test_from_1e4(void)
{
    check_settings(10000u);
}

static void test_from_1e6(void)
{
    check_settings(1000000u);
}

static void test_from_1e8(void)
{
    check_settings(100000000u);
}

static void test_from_4e9(void)
{
    check_settings(4000000000u);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_from_1e4);
    RUN_TEST(test_from_1e6);
    RUN_TEST(test_from_1e8);
    RUN_TEST(test_from_4e9);
    return UNITY_END();
}
