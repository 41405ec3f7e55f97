/*
 * The sentence of lib/onebit_cdf.h, over all 2^32 inputs:
 *
 *   error at most 4.2e-7, monotone, F(u) + F(-u) = 2^31 exactly, 1 <= F <= 2^31 - 1.
 *
 * The reference is libm's erfc, called for u >= 0 only: with the symmetry exact, the error at -u is
 * that at u with its sign turned. Nor is it called inside a run of inputs with the same F: the CDF
 * rises there, so the error is largest at one of the run's ends. INT32_MIN has no twin and is taken
 * by itself.
 */
#include "onebit_cdf.h"

#include "numbers.h"

#define ERROR_LIMIT 4.2e-7
#define CHUNK ((int64_t)1 << 20)
#define CHUNKS ((int64_t)1 << 11) /* of non-negative inputs */

void setUp(void)
{
}

void tearDown(void)
{
}

/* What the sweep found; an input of -1 says that there is none. */
struct findings {
    double error;
    int64_t where;
    int64_t falls, asymmetric, out_of_range;
};

static void take_error(struct findings *found, int64_t u)
{
    double upper_tail = 0.5 * erfc((double)u * (0x1p-27 * 0.70710678118654752440));
    /* 2^31 - F is exact, so the error keeps its digits where F is near 1. */
    double error = fabs((0x80000000u - onebit_cdf((int32_t)u)) * 0x1p-31 - upper_tail);
    if (error > found->error) {
        found->error = error;
        found->where = u;
    }
}

static struct findings sweep_chunk(int64_t first)
{
    struct findings found = {0, first, -1, -1, -1};
    /* The input before the chunk joins it to its neighbour; F(-1) joins the halves. */
    uint32_t previous = onebit_cdf((int32_t)(first - 1));
    uint32_t previous_mirror = onebit_cdf((int32_t)(1 - first));
    for (int64_t u = first; u < first + CHUNK; ++u) {
        uint32_t value = onebit_cdf((int32_t)u);
        uint32_t mirror = onebit_cdf((int32_t)-u);
        if (value < previous || mirror > previous_mirror) {
            found.falls = u;
        }
        if (value + mirror != 0x80000000u) {
            found.asymmetric = u;
        }
        if (value < 1 || value > 0x7FFFFFFFu || mirror < 1 || mirror > 0x7FFFFFFFu) {
            found.out_of_range = u;
        }
        if (value != previous) {
            take_error(&found, u);
            if (u > 0) {
                take_error(&found, u - 1);
            }
        }
        previous = value;
        previous_mirror = mirror;
    }
    /* A run may go on in the next chunk: its part here has its own ends. */
    take_error(&found, first);
    take_error(&found, first + CHUNK - 1);
    return found;
}

static void test_all_inputs(void)
{
    struct findings all = {0, 0, -1, -1, -1};
#pragma omp parallel for schedule(dynamic)
    for (int64_t chunk = 0; chunk < CHUNKS; ++chunk) {
        struct findings found = sweep_chunk(chunk * CHUNK);
#pragma omp critical
        {
            if (found.error > all.error) {
                all.error = found.error;
                all.where = found.where;
            }
            all.falls = found.falls >= 0 ? found.falls : all.falls;
            all.asymmetric = found.asymmetric >= 0 ? found.asymmetric : all.asymmetric;
            all.out_of_range = found.out_of_range >= 0 ? found.out_of_range : all.out_of_range;
        }
    }
    printf("error at most %.4g (at u = %.9f and %.9f; the header says %.2g)\n", all.error,
           (double)all.where * 0x1p-27, -(double)all.where * 0x1p-27, ERROR_LIMIT);
    REQUIRE(all.falls < 0, "not monotone at +-%lld", (long long)all.falls);
    REQUIRE(all.asymmetric < 0, "F(u) + F(-u) is not 2^31 at %lld", (long long)all.asymmetric);
    REQUIRE(all.out_of_range < 0, "outside 1..2^31-1 at +-%lld", (long long)all.out_of_range);
    REQUIRE(all.error <= ERROR_LIMIT, "error %.4g", all.error);
}

static void test_the_input_without_a_twin(void)
{
    uint32_t value = onebit_cdf(INT32_MIN);
    TEST_ASSERT_TRUE(value >= 1 && value <= onebit_cdf(-INT32_MAX));
    TEST_ASSERT_TRUE(value * 0x1p-31 <= ERROR_LIMIT); /* F(-16) is 6e-58 */
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_all_inputs);
    RUN_TEST(test_the_input_without_a_twin);
    return UNITY_END();
}
