/* The theorems' figures of sim/conditions.c: published numbers, explicit matrices, warnings. */
#include "conditions.h"
#include "onebit_random.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unity.h>

static struct scenario scenario;
static struct problem problem;
static char warnings[4096];

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

/* Warnings of the scenario; their number. */
static int warn(void)
{
    warnings[0] = '\0'; /* fmemopen leaves it as it was if nothing is written */
    FILE *stream = fmemopen(warnings, sizeof warnings, "w");
    TEST_ASSERT_NOT_NULL(stream);
    conditions_warn(&scenario, stream);
    fclose(stream);
    int lines = 0;
    for (char *line = warnings; *line != '\0'; line = strchr(line, '\n') + 1) {
        TEST_ASSERT_EQUAL_STRING_LEN("warning: ", line, 9);
        lines++;
    }
    return lines;
}

static void expect_warning(const char *key, const char *says)
{
    TEST_ASSERT_EQUAL_INT_MESSAGE(1, warn(), warnings);
    TEST_ASSERT_EQUAL_STRING_LEN_MESSAGE(key, warnings + 9, strlen(key), warnings);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(warnings, says), warnings);
}

static void example_1_has_its_numbers(void)
{
    struct conditions figures;
    const char *names[] = {"aircraft-fixed", "aircraft-fixed-broadcast"};
    for (int k = 0; k < 2; k++) {
        load(names[k]);
        TEST_ASSERT_TRUE(conditions_compute(&scenario, &figures));
        TEST_ASSERT_DOUBLE_WITHIN(5e-6, 1.58579, figures.lambda_2);
        TEST_ASSERT_DOUBLE_WITHIN(1e-12, 3, figures.lambda_G);
        TEST_ASSERT_DOUBLE_WITHIN(5e-5, 58.1032, figures.alpha);
        TEST_ASSERT_DOUBLE_WITHIN(5e-8, 0.0604927, figures.f_M);
        TEST_ASSERT_DOUBLE_WITHIN(5e-4, 498.904, figures.beta_consensus);
        TEST_ASSERT_DOUBLE_WITHIN(5e-4, 539.014, figures.beta_rate);
        TEST_ASSERT_EQUAL_DOUBLE(1, figures.pi_min);
        TEST_ASSERT_EQUAL_DOUBLE(2, figures.t0_min);
        TEST_ASSERT_EQUAL_UINT32(3, figures.d_max);
        scenario_free(&scenario);
    }
}

static void example_2_has_its_numbers(void)
{
    struct conditions figures;
    load("aircraft-markov");
    TEST_ASSERT_TRUE(conditions_compute(&scenario, &figures));
    TEST_ASSERT_DOUBLE_WITHIN(5e-7, 0.528595, figures.lambda_2);
    TEST_ASSERT_DOUBLE_WITHIN(5e-7, 1.857143, figures.lambda_G);
    TEST_ASSERT_DOUBLE_WITHIN(5e-7, 9.977195, figures.alpha);
    TEST_ASSERT_DOUBLE_WITHIN(5e-8, 0.0604927, figures.f_M);
    TEST_ASSERT_DOUBLE_WITHIN(5e-3, 1983.45, figures.beta_consensus);
    TEST_ASSERT_DOUBLE_WITHIN(5e-3, 7181.54, figures.beta_rate);
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, 1.0 / 3, figures.pi_min);
    TEST_ASSERT_DOUBLE_WITHIN(1e-14, 3.8, figures.t0_min);
    TEST_ASSERT_EQUAL_UINT32(2, figures.d_max);
}

/* ||left right||^2 of dense row-major matrices, by powers. */
static double squared_norm(const double *left, size_t rows, size_t inner, const double *right,
                           size_t columns)
{
    double product[64 * 64];
    double vector[64];
    double image[64];
    double size = 0;
    for (size_t row = 0; row < rows; row++) {
        for (size_t k = 0; k < columns; k++) {
            product[row * columns + k] = 0;
            for (size_t m = 0; m < inner; m++) {
                product[row * columns + k] += left[row * inner + m] * right[m * columns + k];
            }
        }
    }
    for (size_t k = 0; k < columns; k++) {
        vector[k] = 1 + sin((double)(k + 1));
    }
    for (int power = 0; power < 5000; power++) {
        size = 0;
        for (size_t row = 0; row < rows; row++) {
            image[row] = 0;
            for (size_t k = 0; k < columns; k++) {
                image[row] += product[row * columns + k] * vector[k];
            }
        }
        for (size_t k = 0; k < columns; k++) {
            vector[k] = 0;
            for (size_t row = 0; row < rows; row++) {
                vector[k] += product[row * columns + k] * image[row];
            }
            size += vector[k] * vector[k];
        }
        size = sqrt(size);
        for (size_t k = 0; k < columns; k++) {
            vector[k] /= size;
        }
    }
    return size;
}

/* The paper's Q, W, J and L written out, on an uneven switching topology. */
static void norms_are_those_of_the_explicit_matrices(void)
{
    enum { AGENTS = 6, GRAPHS = 2 };
    const struct edge first[] = {{1, 2}, {1, 3}, {1, 4}, {5, 6}};
    const struct edge second[] = {{2, 3}, {4, 5}, {1, 4}, {1, 6}, {3, 6}};
    const struct edge *edges[] = {first, second};
    const uint32_t counts[] = {4, 5};
    const double transition[] = {0.9, 0.1, 0.3, 0.7};
    scenario.beta = scenario.gamma = scenario.bound = scenario.sigma = 1;
    struct topology *topology = &scenario.topology;
    TEST_ASSERT_TRUE(
        topology_build(topology, AGENTS, GRAPHS, edges, counts, transition, NULL, &problem));
    size_t links = topology->link_count;
    TEST_ASSERT_LESS_OR_EQUAL(64, links);

    double J[AGENTS * AGENTS];
    double Q[64 * AGENTS] = {0};
    double lambda_G = 0;
    double lambda_QW = 0;
    double lambda_QL = 0;
    for (size_t k = 0; k < AGENTS * AGENTS; k++) {
        J[k] = (k % (AGENTS + 1) == 0 ? 1 : 0) - 1.0 / AGENTS;
    }
    for (size_t link = 0; link < links; link++) {
        Q[link * AGENTS + topology->link_sender[link] - 1] = 1;
    }
    for (size_t graph = 0; graph < GRAPHS; graph++) {
        double W[AGENTS * 64] = {0};
        double L[AGENTS * AGENTS] = {0};
        for (size_t k = 0; k < counts[graph]; k++) {
            size_t a = edges[graph][k].first - 1;
            size_t b = edges[graph][k].second - 1;
            L[a * AGENTS + a]++;
            L[b * AGENTS + b]++;
            L[a * AGENTS + b]--;
            L[b * AGENTS + a]--;
        }
        for (size_t link = 0; link < links; link++) {
            size_t sender = topology->link_sender[link] - 1;
            size_t receiver = topology->link_receiver[link] - 1;
            W[receiver * links + link] = L[receiver * AGENTS + sender] < 0 ? 1 : 0;
        }
        /* T is orthonormal and leaves the norm of Q L alone. */
        lambda_G = fmax(lambda_G, squared_norm(J, AGENTS, AGENTS, W, links));
        lambda_QW = fmax(lambda_QW, squared_norm(Q, links, AGENTS, W, links));
        lambda_QL = fmax(lambda_QL, squared_norm(Q, links, AGENTS, L, AGENTS));
    }
    struct conditions figures;
    TEST_ASSERT_TRUE(conditions_compute(&scenario, &figures));
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, lambda_G, figures.lambda_G);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, lambda_QW, figures.lambda_QW);
    TEST_ASSERT_DOUBLE_WITHIN(1e-9, lambda_QL, figures.lambda_QL);
    TEST_ASSERT_DOUBLE_WITHIN(1e-15, 0.25, figures.pi_min);
    TEST_ASSERT_EQUAL_UINT32(3, figures.d_max);
}

static void our_scenarios_meet_every_condition(void)
{
    const char *names[] = {"aircraft-fixed", "aircraft-markov", "aircraft-fixed-broadcast",
                           "aircraft-markov-broadcast", "two-agents"};
    for (int k = 0; k < 5; k++) {
        load(names[k]);
        TEST_ASSERT_EQUAL_INT_MESSAGE(0, warn(), warnings);
        scenario_free(&scenario);
    }
}

static void beta_is_compared_with_both_bounds(void)
{
    load("aircraft-fixed");
    scenario.beta = 539.02;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, warn(), warnings);
    scenario.beta = 539.01;
    expect_warning("gains.beta: ", "of 539.014, the rate 1/t needs more");
    scenario.beta = 498.91;
    expect_warning("gains.beta: ", "of 539.014, the rate 1/t needs more");
    scenario.beta = 249.45;
    expect_warning("gains.beta: 249.45 is 0.5 ", "consensus needs more: raise it above 539.014");
    scenario.gamma = 0.5; /* no beta gives the rate 1/t */
    scenario.beta = 1;
    TEST_ASSERT_EQUAL_INT_MESSAGE(2, warn(), warnings);
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(warnings, "raise it above that\n"), warnings);
}

static void gamma_is_compared_with_lambda_2(void)
{
    load("aircraft-fixed");
    scenario.gamma = 0.631;
    scenario.beta = 65536;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, warn(), warnings);
    scenario.gamma = 0.63;
    expect_warning("gains.gamma: ", "1/lambda_2 = 0.630602");
}

static void t0_is_compared_with_the_degree(void)
{
    load("aircraft-markov");
    scenario.t0 = 4;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, warn(), warnings);
    scenario.t0 = 3;
    expect_warning("gains.t0: 3 ", "raise it to 4");
}

static void rebuild(uint32_t graphs, const struct edge *const *edges, const uint32_t *counts,
                    const double *transition)
{
    uint32_t agents = scenario.topology.agent_count;
    topology_free(&scenario.topology);
    TEST_ASSERT_TRUE_MESSAGE(topology_build(&scenario.topology, agents, graphs, edges, counts,
                                            transition, NULL, &problem),
                             problem.text);
}

static void parts_of_the_union_are_counted(void)
{
    load("aircraft-fixed");
    const struct edge edges[] = {{1, 4}, {4, 6}, {6, 1}, {2, 3}, {3, 5}, {5, 7}};
    const struct edge *list = edges;
    const uint32_t count = 6;
    rebuild(1, &list, &count, NULL);
    expect_warning("topology.graphs: ", "2 parts");
    struct conditions figures;
    TEST_ASSERT_TRUE(conditions_compute(&scenario, &figures));
    TEST_ASSERT_EQUAL_DOUBLE(0, figures.lambda_2);
    TEST_ASSERT_TRUE(isinf(figures.beta_consensus));
}

static void a_periodic_chain_is_told(void)
{
    load("aircraft-fixed");
    const struct edge ring[] = {{1, 2}, {2, 3}, {3, 4}, {4, 5}, {5, 6}, {6, 7}, {7, 1}};
    const struct edge *edges[] = {ring, ring};
    const uint32_t counts[] = {7, 7};
    const double transition[] = {0, 1, 1, 0};
    rebuild(2, edges, counts, transition);
    scenario.beta = 1e5;
    scenario.gamma = 2;
    expect_warning("topology.transition: ", "period 2");
}

static void gains_that_do_not_belong_to_the_plant_are_told(void)
{
    /* K2 keeps K2 B = 1 but is no left eigenvector. */
    load("two-agents");
    scenario.compression[0] += 1e-5;
    scenario.compression[1] -= 0.5e-5;
    expect_warning("gains: K2 (A + B K1) ", "of its size");
    scenario_free(&scenario);

    load("two-agents");
    scenario.compression[0] *= 1.001;
    scenario.compression[1] *= 1.001;
    expect_warning("gains.compression: K2 B is 1.001", "not 1");
    scenario_free(&scenario);

    /* K1 and K2 of the root -1.5. */
    load("two-agents");
    scenario.stabilizing[1] = -2.5;
    scenario.compression[0] = 2.5;
    scenario.compression[1] = -0.25;
    expect_warning("gains.stabilizing: ", "magnitude 1.5");
    scenario_free(&scenario);

    load("two-agents");
    scenario.A[0] = HUGE_VAL;
    warn();
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(warnings, "cannot be computed"), warnings);
}

static void the_horizon_of_a_plant_error_is_told(void)
{
    /* A scalar integrator that leaks by e: lambda_2 = 2 and gamma = 1 make the horizon 2/e. */
    load("two-agents");
    scenario.state_count = 1;
    scenario.A[0] = 1 - 1e-7;
    scenario.B[0] = scenario.compression[0] = 1;
    scenario.stabilizing[0] = 0;
    scenario.t0 = 10;
    scenario.steps = 19999980;
    TEST_ASSERT_EQUAL_INT_MESSAGE(0, warn(), warnings);
    scenario.steps = 20000000;
    expect_warning("gains.stabilizing: the eigenvalue 1 ", "off by 1e-07, so from about t = 2e+07");
}

static void large_groups_are_told_in_one_line(void)
{
    load("two-agents");
    uint32_t agents = CONDITIONS_AGENTS_MAX + 1;
    struct edge *path = calloc(agents, sizeof *path);
    TEST_ASSERT_NOT_NULL(path);
    for (uint32_t k = 1; k < agents; k++) {
        path[k - 1] = (struct edge){k, k + 1};
    }
    const struct edge *list = path;
    const uint32_t count = agents - 1;
    scenario.topology.agent_count = agents;
    rebuild(1, &list, &count, NULL);
    free(path);
    struct conditions figures;
    TEST_ASSERT_FALSE(conditions_compute(&scenario, &figures));
    expect_warning("gains: ", "not computed for 1001 agents");
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(example_1_has_its_numbers);
    RUN_TEST(example_2_has_its_numbers);
    RUN_TEST(norms_are_those_of_the_explicit_matrices);
    RUN_TEST(our_scenarios_meet_every_condition);
    RUN_TEST(beta_is_compared_with_both_bounds);
    RUN_TEST(gamma_is_compared_with_lambda_2);
    RUN_TEST(t0_is_compared_with_the_degree);
    RUN_TEST(parts_of_the_union_are_counted);
    RUN_TEST(a_periodic_chain_is_told);
    RUN_TEST(gains_that_do_not_belong_to_the_plant_are_told);
    RUN_TEST(the_horizon_of_a_plant_error_is_told);
    RUN_TEST(large_groups_are_told_in_one_line);
    return UNITY_END();
}
