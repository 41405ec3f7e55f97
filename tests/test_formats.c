/* Worst-case ranges and fixed-point formats of sim/formats.c. */
#include "formats.h"
#include "onebit_random.h"

#include <math.h>
#include <stdio.h>
#include <string.h>
#include <unity.h>

static struct scenario scenario;
static struct formats formats;
static struct problem problem;

void setUp(void)
{
    memset(&scenario, 0, sizeof scenario);
}

void tearDown(void)
{
    scenario_free(&scenario);
}

static void load(const char *name)
{
    char path[512];
    snprintf(path, sizeof path, "%s/sim/scenarios/%s.yaml", ONEBIT_SOURCE_DIR, name);
    TEST_ASSERT_TRUE_MESSAGE(scenario_load(&scenario, path, &problem), problem.text);
}

static void choose(void)
{
    TEST_ASSERT_TRUE_MESSAGE(formats_choose(&scenario, &formats, &problem), problem.text);
}

static void expect_refusal(const char *key)
{
    TEST_ASSERT_FALSE(formats_choose(&scenario, &formats, &problem));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(problem.text, key), problem.text);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(problem.text, "two-agents.yaml: "), problem.text);
}

/* Two agents whose only state is moved by u itself: x stays within M, u within gamma 2 M/(t0+2). */
static void make_integrator(double bound, uint32_t t0)
{
    load("two-agents");
    scenario.state_count = 1;
    scenario.A[0] = scenario.B[0] = scenario.compression[0] = 1;
    scenario.stabilizing[0] = 0;
    scenario.initial_states[0] = scenario.initial_states[1] = 0;
    scenario.bound = bound;
    scenario.t0 = t0;
}

static void integrator_by_hand(void)
{
    make_integrator(1, 10);
    choose();
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, 1, formats.state_range);
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, 1.0 / 6, formats.control_range);
    TEST_ASSERT_EQUAL_INT(30, formats.state);       /* 2 in 2^1 */
    TEST_ASSERT_EQUAL_INT(31, formats.control);     /* 1/3 in 2^0, no more than 31 bits */
    TEST_ASSERT_EQUAL_INT(46, formats.stabilizing); /* zeros */
    TEST_ASSERT_EQUAL_INT(30, formats.compression); /* 2^31 is one too many */
    scenario_free(&scenario);

    make_integrator(1.001, 10);
    choose();
    TEST_ASSERT_EQUAL_INT(29, formats.state);
}

/*
 * The carts of two-agents.yaml, cart 1 moving: v1 = [2 0], S = [0 -3/4; 0 1/2],
 * I - v1 K2 = [0 -3/2; 0 1]. The first range: v1 gives 2 and 0, the velocity 0.4 gives 0.6 and 0.4,
 * and |v| <= 1/6 gives 1/6 (3/2 + 3/4 + ..) = 1/2 and 1/6 (1 + 1/2 + ..) = 1/3.
 */
static void double_integrator_by_hand(void)
{
    load("two-agents");
    scenario.initial_states[1] = 0.4;
    choose();
    TEST_ASSERT_DOUBLE_WITHIN(1e-8, 2 + 0.6 + 0.5, formats.state_range);
    TEST_ASSERT_DOUBLE_WITHIN(1e-8, 0.5 * (0.4 + 1.0 / 3) + 1.0 / 6, formats.control_range);
    TEST_ASSERT_EQUAL_INT(28, formats.state);       /* 6.2 in 2^3 */
    TEST_ASSERT_EQUAL_INT(30, formats.control);     /* 1.07 in 2^1 */
    TEST_ASSERT_EQUAL_INT(31, formats.stabilizing); /* 1/2 */
    TEST_ASSERT_EQUAL_INT(30, formats.compression); /* 5/4 */
}

/* A too early start: K2 x leaves M before the gain is small enough, a = 2 and then 4/3. */
static void early_start_by_hand(void)
{
    make_integrator(1, 1);
    scenario.gamma = 6;
    choose();
    /* t = 2: |K2 x| to (2 - 1) 1 + 2 = 3, |v| to 4; t = 3: a = 3/2: 3/2 + 3/2, 6; t = 4: 6/5, 4.8
     */
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 3, formats.state_range);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, 6, formats.control_range);
}

/* The closed loop under estimates that try to drive it out; largest use of the ranges. */
static void drive(double *state_use, double *control_use)
{
    const struct topology *topology = &scenario.topology;
    size_t n = scenario.state_count;
    choose();
    *state_use = *control_use = 0;
    for (uint32_t trial = 0; trial < 300; trial++) {
        double states[7 * 4];
        double next[7 * 4];
        memcpy(states, scenario.initial_states, sizeof *states * topology->agent_count * n);
        for (uint32_t step = 0; step < 60; step++) {
            uint32_t t = scenario.t0 + 1 + step;
            uint32_t graph = (uint32_t)onebit_threefry(3, trial, t, 0) % topology->graph_count;
            for (uint32_t agent = 0; agent < topology->agent_count; agent++) {
                const double *x = states + agent * n;
                double compressed = 0;
                double u = 0;
                double v = 0;
                for (size_t k = 0; k < n; k++) {
                    compressed += scenario.compression[k] * x[k];
                    u += scenario.stabilizing[k] * x[k];
                }
                for (uint32_t link = topology->first_link[agent];
                     link < topology->first_link[agent + 1]; link++) {
                    uint32_t word = (uint32_t)onebit_threefry(4, trial, t, link);
                    /* Mostly one side for some steps, then the other. */
                    double side = (t / (1 + trial % 7)) % 2 == 0 ? 1 : -1;
                    double estimate = word % 8 == 0 ? (word >> 3) * 0x1p-28 - 1 : side;
                    if (topology->linked[graph * topology->link_count + link] && word % 16 != 8) {
                        v += estimate * scenario.bound - compressed;
                    }
                }
                u += scenario.gamma / (t + 1.0) * v;
                *control_use = fmax(*control_use, fabs(u) / formats.control_range);
                for (size_t row = 0; row < n; row++) {
                    double sum = scenario.B[row] * u;
                    for (size_t k = 0; k < n; k++) {
                        sum += scenario.A[row * n + k] * x[k];
                    }
                    next[agent * n + row] = sum;
                }
            }
            memcpy(states, next, sizeof *states * topology->agent_count * n);
            for (size_t k = 0; k < topology->agent_count * n; k++) {
                *state_use = fmax(*state_use, fabs(states[k]) / formats.state_range);
            }
        }
    }
}

static void closed_loops_stay_within_their_ranges(void)
{
    const struct {
        const char *name;
        uint32_t t0;
        double gamma;
        double state_use; /* at least: the range is not wastefully wide */
        double control_use;
    } cases[] = {
        {"aircraft-fixed", 10, 1, 0.25, 0.25}, {"aircraft-markov", 10, 2.4, 0.15, 0.25},
        {"aircraft-fixed", 1, 3, 0.02, 0.2},   {"two-agents", 10, 1, 0.6, 0.4},
        {"two-agents", 1, 4, 0.2, 0.7},
    };
    for (size_t k = 0; k < sizeof cases / sizeof *cases; k++) {
        double state_use;
        double control_use;
        load(cases[k].name);
        scenario.t0 = cases[k].t0;
        scenario.gamma = cases[k].gamma;
        drive(&state_use, &control_use);
        char text[80];
        snprintf(text, sizeof text, "case %zu: %.3f and %.3f of the range", k, state_use,
                 control_use);
        TEST_ASSERT_TRUE_MESSAGE(state_use <= 1 && control_use <= 1, text);
        TEST_ASSERT_TRUE_MESSAGE(
            state_use >= cases[k].state_use && control_use >= cases[k].control_use, text);
        scenario_free(&scenario);
    }
}

static void examples_have_their_formats(void)
{
    load("aircraft-fixed");
    choose();
    TEST_ASSERT_DOUBLE_WITHIN(1e-4, 19.3198, formats.state_range);
    TEST_ASSERT_EQUAL_INT(25, formats.state);
    TEST_ASSERT_EQUAL_INT(28, formats.control);
    TEST_ASSERT_EQUAL_INT(30, formats.stabilizing); /* 1.28 */
    TEST_ASSERT_EQUAL_INT(30, formats.compression); /* 6.01 / 4 */
}

static void rows_take_the_most_bits_that_add_up(void)
{
    load("aircraft-fixed");
    for (double scale = 1e-9; scale < 1e8; scale *= 3.7) {
        double sums[2] = {0};
        for (size_t k = 0; k < 4; k++) {
            scenario.stabilizing[k] = scale * (1 + (double)k);
        }
        scenario.has_fixed = true; /* such gains have no range */
        choose();
        for (int more = 0; more < 2; more++) {
            for (size_t k = 0; k < 4; k++) {
                sums[more] +=
                    fabs(round(ldexp(scenario.stabilizing[k], formats.stabilizing + more)));
            }
        }
        TEST_ASSERT_TRUE(sums[0] <= 2147483647.0);
        TEST_ASSERT_TRUE(formats.stabilizing == 46 || sums[1] > 2147483647.0);
    }
    scenario.stabilizing[0] = 3e9;
    TEST_ASSERT_FALSE(formats_choose(&scenario, &formats, &problem));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(problem.text, "gains.stabilizing: "), problem.text);
    scenario.stabilizing[0] = 0;
    scenario.compression[0] = 1e10;
    TEST_ASSERT_FALSE(formats_choose(&scenario, &formats, &problem));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(problem.text, "gains.compression: "), problem.text);
}

static void chosen_formats_are_taken(void)
{
    load("aircraft-fixed");
    scenario.has_fixed = true;
    scenario.state_fraction_bits = 20;
    scenario.control_fraction_bits = 19;
    choose();
    TEST_ASSERT_EQUAL_INT(20, formats.state);
    TEST_ASSERT_EQUAL_INT(19, formats.control);
}

static void unbounded_loops_are_refused(void)
{
    /* K1 and K2 of the root -1, then of -1.5, then a free double integrator, then not finite. */
    const double gains[][4] = {
        {0, -2, 2, 0}, {0, -2.5, 2.5, -0.25}, {0, 0, 0, 1}, {HUGE_VAL, 0, 0, 1}};
    for (size_t k = 0; k < sizeof gains / sizeof *gains; k++) {
        load("two-agents");
        memcpy(scenario.stabilizing, gains[k], 2 * sizeof(double));
        memcpy(scenario.compression, gains[k] + 2, 2 * sizeof(double));
        expect_refusal("gains.stabilizing: ");
        scenario_free(&scenario);
    }
}

static void ranges_beyond_q31_are_refused(void)
{
    /* States and controls in units a billion times smaller. */
    load("two-agents");
    for (size_t k = 0; k < 2; k++) {
        scenario.B[k] *= 1e9;
        scenario.stabilizing[k] /= 1e9;
        scenario.compression[k] /= 1e9;
    }
    expect_refusal("plant: states ");
    scenario_free(&scenario);
    load("two-agents");
    for (size_t k = 0; k < 2; k++) {
        scenario.B[k] /= 1e10;
        scenario.stabilizing[k] *= 1e10;
        scenario.compression[k] *= 1e10;
        scenario.initial_states[k] /= 1e10;
        scenario.initial_states[2 + k] /= 1e10;
    }
    scenario.sigma = 1;
    scenario.gamma = 1;
    /* K2 B = 1 still, but u = v / B's scale: |v| <= 1/6 stays; a larger M makes it too large. */
    scenario.bound = 1e10;
    expect_refusal("plant.B: controls ");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(integrator_by_hand);
    RUN_TEST(double_integrator_by_hand);
    RUN_TEST(early_start_by_hand);
    RUN_TEST(closed_loops_stay_within_their_ranges);
    RUN_TEST(examples_have_their_formats);
    RUN_TEST(rows_take_the_most_bits_that_add_up);
    RUN_TEST(chosen_formats_are_taken);
    RUN_TEST(unbounded_loops_are_refused);
    RUN_TEST(ranges_beyond_q31_are_refused);
    return UNITY_END();
}
