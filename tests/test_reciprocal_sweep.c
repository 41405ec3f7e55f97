/*
 * The sentence of lib/onebit_fixed.h about onebit_inverse, over all 2^31 divisors: 2^63 / divisor,
 * too small by less than 2^-24 of it, too large by less than 2^-30. With it the header argues for
 * the error of every gain.
 */
#include "onebit.h"

#include "numbers.h"

#define CHUNK ((int64_t)1 << 20)
#define CHUNKS ((int64_t)1 << 11)

void setUp(void)
{
}

void tearDown(void)
{
}

/* inverse * divisor - 2^63: exact modulo 2^64, and far from wrapping. */
static int64_t excess(uint32_t divisor)
{
    return (int64_t)((uint64_t)onebit_inverse(divisor) * divisor - ((uint64_t)1 << 63));
}

static void test_all_divisors(void)
{
    int64_t most = 0;
    int64_t least = 0;
#pragma omp parallel for schedule(dynamic) reduction(max : most) reduction(min : least)
    for (int64_t chunk = 0; chunk < CHUNKS; ++chunk) {
        for (int64_t k = 0; k < CHUNK; ++k) {
            int64_t off = excess((uint32_t)(((int64_t)1 << 31) + chunk * CHUNK + k));
            most = off > most ? off : most;
            least = off < least ? off : least;
        }
    }
    printf("too small by at most %.4g, too large by at most %.4g\n", -(double)least * 0x1p-63,
           (double)most * 0x1p-63);
    TEST_ASSERT_TRUE(least > -((int64_t)1 << 39));
    TEST_ASSERT_TRUE(most < (int64_t)1 << 33);
    /* The stated limits are tight enough to mean something. */
    TEST_ASSERT_TRUE(least < -((int64_t)1 << 38));
    TEST_ASSERT_TRUE(most > (int64_t)1 << 31);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_all_divisors);
    return UNITY_END();
}
