/* Files that sim/scenario.c accepts, with the right values. Refusals: test_bad_input.py. */
#include "onebit_limits.h"
#include "scenario.h"

#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>
#include <unity.h>

static struct scenario scenario;
static struct problem problem;

void setUp(void)
{
    memset(&scenario, 0, sizeof scenario);
    problem.text[0] = '\0';
}

void tearDown(void)
{
    scenario_free(&scenario);
}

static bool load_text(const char *text)
{
    char path[] = "/tmp/onebit-scenario-XXXXXX";
    int descriptor = mkstemp(path);
    TEST_ASSERT_NOT_EQUAL(-1, descriptor);
    TEST_ASSERT_EQUAL_INT64(strlen(text), write(descriptor, text, strlen(text)));
    close(descriptor);
    bool loaded = scenario_load(&scenario, path, &problem);
    remove(path);
    return loaded;
}

static void load(const char *name)
{
    char path[512];
    snprintf(path, sizeof path, "%s/sim/scenarios/%s.yaml", ONEBIT_SOURCE_DIR, name);
    TEST_ASSERT_TRUE_MESSAGE(scenario_load(&scenario, path, &problem), problem.text);
    TEST_ASSERT_EQUAL_STRING(path, scenario.path);
    TEST_ASSERT_EQUAL_STRING(name, scenario.name);
}

/* The parts that no test here changes. */
#define PLANT "plant: {A: [[1]], B: [1]}\n"
#define GAINS "gains: {stabilizing: [0], compression: [1], beta: 24, gamma: 1, t0: 10}\n"
#define NOISE "quantizer: {threshold: 0, bound: 1}\nnoise: {sigma: 1}\n"
#define TOPOLOGY "topology: {graphs: [{edges: [[1, 2]]}]}\n"
#define INITIAL "initial: {states: [[-1], [1]], estimates: 0}\n"
#define LOOP "name: two\n" PLANT GAINS NOISE
#define BUS "bus: {model: ideal, bitrate: 500000, encoding: payload}\n"
#define END "period: 1\nsteps: 5\n"

static void aircraft_have_the_papers_constants(void)
{
    load("aircraft-fixed");
    const double A[] = {0.7358, 0.1839, 0, 0,   -0.7358, 0,      0, 0,
                        0.7073, 0.0777, 1, 0.5, 2.6891,  0.3964, 0, 1};
    const double B[] = {0.1982, 0.5518, -0.093, -0.2668};
    const double altitudes[] = {5, 2, 4, 3, 1.5, 2.5, 1};
    TEST_ASSERT_EQUAL_UINT32(4, scenario.state_count);
    TEST_ASSERT_EQUAL_MEMORY(A, scenario.A, sizeof A);
    TEST_ASSERT_EQUAL_MEMORY(B, scenario.B, sizeof B);
    TEST_ASSERT_FALSE(scenario.integer_plant);
    TEST_ASSERT_EQUAL_UINT32(7, scenario.topology.agent_count);
    for (size_t agent = 0; agent < 7; agent++) {
        const double state[] = {0, 0, altitudes[agent], 0};
        TEST_ASSERT_EQUAL_MEMORY(state, scenario.initial_states + agent * 4, sizeof state);
    }
    TEST_ASSERT_EQUAL_DOUBLE(0, scenario.initial_estimate);
    TEST_ASSERT_EQUAL_DOUBLE(1500, scenario.beta);
    TEST_ASSERT_EQUAL_DOUBLE(1, scenario.gamma);
    TEST_ASSERT_EQUAL_UINT32(10, scenario.t0);
    TEST_ASSERT_EQUAL_DOUBLE(-2, scenario.threshold);
    TEST_ASSERT_EQUAL_DOUBLE(2, scenario.bound);
    TEST_ASSERT_EQUAL_DOUBLE(4, scenario.sigma);
    TEST_ASSERT_EQUAL_UINT32(20, scenario.topology.link_count);
    TEST_ASSERT_EQUAL_UINT8(ONEBIT_MODE_LINK, scenario.format.mode);
    TEST_ASSERT_EQUAL_UINT8(ONEBIT_ENCODING_PAYLOAD, scenario.format.encoding);
    TEST_ASSERT_EQUAL_INT(BUS_IDEAL, scenario.bus_model);
    TEST_ASSERT_EQUAL_DOUBLE(500000, scenario.bitrate);
    TEST_ASSERT_FALSE(scenario.has_fixed);
    TEST_ASSERT_EQUAL_DOUBLE(0.5, scenario.period);
    TEST_ASSERT_EQUAL_UINT32(300000, scenario.steps);
}

/* The gains in the files are those of the paper, of the printed A and B, with the eigenvalue 1. */
static void aircraft_have_exact_gains(void)
{
    const double printed_K1[] = {-0.9224, -0.1825, 0, -0.1788};
    const double printed_K2[] = {3.8734, 0.9054, 0.3575, 0.8773};
    const char *names[] = {"aircraft-fixed", "aircraft-fixed-broadcast", "aircraft-markov",
                           "aircraft-markov-broadcast"};
    for (int file = 0; file < 4; file++) {
        load(names[file]);
        double unit = 0;
        for (size_t k = 0; k < 4; k++) {
            TEST_ASSERT_DOUBLE_WITHIN(5.01e-5, printed_K1[k], scenario.stabilizing[k]);
            TEST_ASSERT_DOUBLE_WITHIN(5.01e-5, printed_K2[k], scenario.compression[k]);
            unit += scenario.compression[k] * scenario.B[k];
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-15, 1, unit);
        for (size_t k = 0; k < 4; k++) {
            double kept = unit * scenario.stabilizing[k];
            for (size_t row = 0; row < 4; row++) {
                kept += scenario.compression[row] * scenario.A[row * 4 + k];
            }
            TEST_ASSERT_DOUBLE_WITHIN(2e-15, scenario.compression[k], kept);
        }
        scenario_free(&scenario);
    }
}

static void markov_has_three_graphs(void)
{
    const double transition[] = {0.5, 0.3, 0.2, 0.2, 0.5, 0.3, 0.3, 0.2, 0.5};
    const uint32_t links[] = {8, 6, 6};
    load("aircraft-markov");
    TEST_ASSERT_EQUAL_UINT32(3, scenario.topology.graph_count);
    TEST_ASSERT_EQUAL_UINT32(20, scenario.topology.link_count);
    TEST_ASSERT_EQUAL_MEMORY(transition, scenario.topology.transition, sizeof transition);
    for (uint32_t graph = 0; graph < 3; graph++) {
        uint32_t count = 0;
        for (uint32_t agent = 1; agent <= 7; agent++) {
            count += topology_degree(&scenario.topology, graph, agent);
        }
        TEST_ASSERT_EQUAL_UINT32(links[graph], count);
    }
    TEST_ASSERT_EQUAL_DOUBLE(10000, scenario.beta);
    TEST_ASSERT_EQUAL_DOUBLE(2.4, scenario.gamma);
    TEST_ASSERT_EQUAL_UINT32(1000000, scenario.steps);
}

static void broadcast_files_differ_in_the_mode_alone(void)
{
    const char *names[][2] = {{"aircraft-fixed", "aircraft-fixed-broadcast"},
                              {"aircraft-markov", "aircraft-markov-broadcast"}};
    for (int pair = 0; pair < 2; pair++) {
        struct scenario link;
        load(names[pair][0]);
        link = scenario;
        load(names[pair][1]);
        TEST_ASSERT_EQUAL_UINT8(ONEBIT_MODE_BROADCAST, scenario.format.mode);
        TEST_ASSERT_EQUAL_UINT16(0x100, scenario.format.base);
        TEST_ASSERT_EQUAL_MEMORY(link.A, scenario.A, 16 * sizeof(double));
        TEST_ASSERT_EQUAL_MEMORY(link.B, scenario.B, 4 * sizeof(double));
        TEST_ASSERT_EQUAL_MEMORY(link.compression, scenario.compression, 4 * sizeof(double));
        TEST_ASSERT_EQUAL_MEMORY(link.initial_states, scenario.initial_states, 28 * sizeof(double));
        TEST_ASSERT_EQUAL_MEMORY(link.topology.linked, scenario.topology.linked,
                                 link.topology.graph_count * 20);
        TEST_ASSERT_EQUAL_DOUBLE(link.beta, scenario.beta);
        TEST_ASSERT_EQUAL_DOUBLE(link.gamma, scenario.gamma);
        TEST_ASSERT_EQUAL_UINT32(link.steps, scenario.steps);
        scenario_free(&link);
        scenario_free(&scenario);
    }
}

static void two_agents_are_two(void)
{
    load("two-agents");
    TEST_ASSERT_EQUAL_UINT32(2, scenario.topology.agent_count);
    TEST_ASSERT_EQUAL_UINT32(200, scenario.steps);
}

/* Any order of keys, aliases, numbers in their various writings. */
static void yaml_is_read_as_yaml(void)
{
    TEST_ASSERT_TRUE_MESSAGE(
        load_text("# upside down\n"
                  "steps: 4294967283\n"
                  "period: .25\n"
                  "fixed: {control_fraction_bits: 0, state_fraction_bits: 31}\n"
                  "bus: {base: 0x7dF, encoding: identifier, bitrate: 5e5, model: can}\n"
                  "channel: {mode: broadcast}\n"
                  "topology:\n"
                  "  transition: [&half [0.5, +5.0E-1], *half]\n"
                  "  graphs: [{edges: [[1, 2], [2, 3]]}, {edges: []}]\n"
                  "initial: {states: [&x [-0.5], [0.25], *x], estimates: -1}\n"
                  "noise: {sigma: 1.}\n"
                  "quantizer: {threshold: -3, bound: 1}\n"
                  "gains:\n"
                  "  {stabilizing: [-0], compression: [1e0], beta: 65536, gamma: 1.5, t0: 11}\n"
                  "plant: {arithmetic: q31, B: [1], A: [[1]]}\n"
                  "name: \"upside down: \\u00e9\"\n"
                  "...\n"),
        problem.text);
    TEST_ASSERT_EQUAL_STRING("upside down: \xC3\xA9", scenario.name);
    TEST_ASSERT_TRUE(scenario.integer_plant);
    TEST_ASSERT_EQUAL_DOUBLE(65536, scenario.beta);
    TEST_ASSERT_EQUAL_DOUBLE(1.5, scenario.gamma);
    TEST_ASSERT_EQUAL_UINT32(11, scenario.t0);
    TEST_ASSERT_EQUAL_DOUBLE(-3, scenario.threshold);
    TEST_ASSERT_EQUAL_DOUBLE(-1, scenario.initial_estimate);
    const double states[] = {-0.5, 0.25, -0.5};
    const double transition[] = {0.5, 0.5, 0.5, 0.5};
    TEST_ASSERT_EQUAL_MEMORY(states, scenario.initial_states, sizeof states);
    TEST_ASSERT_EQUAL_UINT32(2, scenario.topology.graph_count);
    TEST_ASSERT_EQUAL_MEMORY(transition, scenario.topology.transition, sizeof transition);
    TEST_ASSERT_EQUAL_UINT32(0, topology_degree(&scenario.topology, 1, 2));
    TEST_ASSERT_EQUAL_UINT8(ONEBIT_MODE_BROADCAST, scenario.format.mode);
    TEST_ASSERT_EQUAL_UINT8(ONEBIT_ENCODING_IDENTIFIER, scenario.format.encoding);
    TEST_ASSERT_EQUAL_UINT16(0x7DF, scenario.format.base);
    TEST_ASSERT_EQUAL_INT(BUS_CAN, scenario.bus_model);
    TEST_ASSERT_EQUAL_DOUBLE(500000, scenario.bitrate);
    TEST_ASSERT_TRUE(scenario.has_fixed);
    TEST_ASSERT_EQUAL_INT(31, scenario.state_fraction_bits);
    TEST_ASSERT_EQUAL_INT(0, scenario.control_fraction_bits);
    TEST_ASSERT_EQUAL_DOUBLE(0.25, scenario.period);
    TEST_ASSERT_EQUAL_UINT32(4294967283u, scenario.steps);
}

static void defaults_are_the_frames(void)
{
    TEST_ASSERT_TRUE_MESSAGE(load_text(LOOP TOPOLOGY INITIAL
                                       "channel: {mode: broadcast}\n"
                                       "bus: {model: can, bitrate: 1, encoding: identifier}\n" END),
                             problem.text);
    TEST_ASSERT_EQUAL_UINT16(0x400, scenario.format.base);
    TEST_ASSERT_FALSE(scenario.has_fixed);
    TEST_ASSERT_FALSE(scenario.integer_plant);
    TEST_ASSERT_EQUAL_UINT32(1, scenario.topology.graph_count);
    TEST_ASSERT_EQUAL_DOUBLE(1, scenario.topology.transition[0]);
    TEST_ASSERT_EQUAL_DOUBLE(1, scenario.topology.stationary[0]);
}

/* The largest plant, and an agent with the most neighbours, which all fit on an ideal bus. */
static void limits_are_reached(void)
{
    static char text[16384];
    size_t length = 0;
#define ADD(...) length += (size_t)snprintf(text + length, sizeof text - length, __VA_ARGS__)
    ADD("name: large\nplant:\n  A:\n");
    for (int row = 0; row < ONEBIT_STATES_MAX; row++) {
        ADD("  - [");
        for (int k = 0; k < ONEBIT_STATES_MAX; k++) {
            ADD("%s%d", k > 0 ? ", " : "", row * 100 + k);
        }
        ADD("]\n");
    }
    const char *row = "[1, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0, 0]";
    ADD("  B: %s\ngains: {stabilizing: %s, compression: %s, beta: 1, gamma: 1, t0: 4294967293}\n",
        row, row, row);
    ADD(NOISE "topology:\n  graphs:\n  - edges:\n");
    for (int agent = 2; agent <= ONEBIT_NEIGHBOURS_MAX + 1; agent++) {
        ADD("    - [1, %d]\n", agent);
    }
    ADD("initial:\n  estimates: 1\n  states:\n");
    for (int agent = 1; agent <= ONEBIT_NEIGHBOURS_MAX + 1; agent++) {
        ADD("  - %s\n", row);
    }
    ADD("channel: {mode: broadcast}\nperiod: 1\nsteps: 1\n"
        "bus: {model: ideal, base: 0x7D0, bitrate: 1, encoding: payload}\n");
    TEST_ASSERT_TRUE_MESSAGE(load_text(text), problem.text);
    TEST_ASSERT_EQUAL_UINT32(ONEBIT_STATES_MAX, scenario.state_count);
    TEST_ASSERT_EQUAL_DOUBLE(1514, scenario.A[15 * ONEBIT_STATES_MAX + 14]);
    TEST_ASSERT_EQUAL_UINT32(ONEBIT_NEIGHBOURS_MAX, topology_degree(&scenario.topology, 0, 1));
    TEST_ASSERT_EQUAL_UINT32(4294967293u, scenario.t0);
}

/* K2 x of exactly M, up to the rounding of its sum. */
static void the_bound_itself_is_allowed(void)
{
    TEST_ASSERT_TRUE_MESSAGE(
        load_text(
            "name: edge\nplant: {A: [[1, 0], [0, 1]], B: [1, 1]}\n"
            "gains: {stabilizing: [0, 0], compression: [0.1, 0.2], beta: 1, gamma: 1, t0: 1}\n"
            "quantizer: {threshold: 0.9, bound: 0.3}\nnoise: {sigma: 0.3}\n" TOPOLOGY
            "initial: {states: [[1, 1], [-1, -1]], estimates: 0.3}\n"
            "channel: {mode: link}\n" BUS END),
        problem.text); /* 0.1 + 0.2 > 0.3 in binary */
}

static void a_refusal_leaves_nothing(void)
{
    static const struct scenario empty;
    TEST_ASSERT_FALSE(
        load_text(LOOP TOPOLOGY INITIAL "channel: {mode: link}\n" BUS "period: 1\nsteps: 0\n"));
    TEST_ASSERT_NOT_NULL_MESSAGE(strstr(problem.text, ":11: steps: "), problem.text);
    TEST_ASSERT_EQUAL_MEMORY(&empty, &scenario, sizeof empty);
    TEST_ASSERT_FALSE(scenario_load(&scenario, "/nowhere/at/all.yaml", &problem));
    TEST_ASSERT_EQUAL_STRING("/nowhere/at/all.yaml: cannot be opened: No such file or directory",
                             problem.text);
    TEST_ASSERT_EQUAL_MEMORY(&empty, &scenario, sizeof empty);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(aircraft_have_the_papers_constants);
    RUN_TEST(aircraft_have_exact_gains);
    RUN_TEST(markov_has_three_graphs);
    RUN_TEST(broadcast_files_differ_in_the_mode_alone);
    RUN_TEST(two_agents_are_two);
    RUN_TEST(yaml_is_read_as_yaml);
    RUN_TEST(defaults_are_the_frames);
    RUN_TEST(limits_are_reached);
    RUN_TEST(the_bound_itself_is_allowed);
    RUN_TEST(a_refusal_leaves_nothing);
    return UNITY_END();
}
