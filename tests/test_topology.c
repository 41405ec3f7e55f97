/* Graphs, links and chain of sim/topology.c, against brute force and known chains. */
#include "onebit_random.h"
#include "topology.h"

#include <stdlib.h>
#include <string.h>
#include <unity.h>

#define COUNT(array) ((uint32_t)(sizeof(array) / sizeof *(array)))

static struct topology topology;
static struct topology_place place;
static struct problem problem;

void setUp(void)
{
    memset(&topology, 0, sizeof topology);
    memset(&problem, 0, sizeof problem);
}

void tearDown(void)
{
    topology_free(&topology);
}

/* One graph. */
static bool build_one(uint32_t agents, const struct edge *edges, uint32_t count)
{
    return topology_build(&topology, agents, 1, &edges, &count, NULL, &place, &problem);
}

/* Graphs of a single edge each, so that only the chain matters. */
static bool build_chain(uint32_t graphs, const double *transition)
{
    static const struct edge edge = {1, 2};
    const struct edge *edges[16];
    uint32_t counts[16];
    for (uint32_t graph = 0; graph < graphs; graph++) {
        edges[graph] = &edge;
        counts[graph] = 1;
    }
    return topology_build(&topology, 2, graphs, edges, counts, transition, &place, &problem);
}

static void links_of_two_graphs_are_sorted(void)
{
    const struct edge first[] = {{3, 1}, {1, 2}};
    const struct edge second[] = {{2, 1}, {4, 3}};
    const struct edge *edges[] = {first, second};
    const uint32_t counts[] = {2, 2};
    const double transition[] = {0.5, 0.5, 0.5, 0.5};
    TEST_ASSERT_TRUE(topology_build(&topology, 4, 2, edges, counts, transition, NULL, &problem));
    TEST_ASSERT_EQUAL_STRING("", problem.text);

    const uint32_t senders[] = {1, 1, 2, 3, 3, 4};
    const uint32_t receivers[] = {2, 3, 1, 1, 4, 3};
    const uint32_t first_links[] = {0, 2, 3, 5, 6};
    const uint8_t linked[] = {1, 1, 1, 1, 0, 0, 1, 0, 1, 0, 1, 1};
    TEST_ASSERT_EQUAL_UINT32(6, topology.link_count);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(senders, topology.link_sender, 6);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(receivers, topology.link_receiver, 6);
    TEST_ASSERT_EQUAL_UINT32_ARRAY(first_links, topology.first_link, 5);
    TEST_ASSERT_EQUAL_UINT8_ARRAY(linked, topology.linked, 12);
    TEST_ASSERT_EQUAL_UINT32(1, topology.components);
    TEST_ASSERT_EQUAL_UINT32(2, topology_degree(&topology, 0, 1));
    TEST_ASSERT_EQUAL_UINT32(1, topology_degree(&topology, 1, 1));
    TEST_ASSERT_EQUAL_UINT32(0, topology_degree(&topology, 0, 4));
}

/* Random graphs against the adjacency matrix; components by spreading labels. */
static void random_graphs_match_brute_force(void)
{
    enum { AGENTS = 12, GRAPHS = 3 };
    for (uint32_t trial = 0; trial < 200; trial++) {
        static uint8_t joined[GRAPHS][AGENTS][AGENTS];
        struct edge lists[GRAPHS][AGENTS * AGENTS];
        const struct edge *edges[GRAPHS] = {lists[0], lists[1], lists[2]};
        uint32_t counts[GRAPHS] = {0};
        double transition[GRAPHS * GRAPHS];
        memset(joined, 0, sizeof joined);
        for (uint32_t graph = 0; graph < GRAPHS; graph++) {
            for (uint32_t pair = 0; pair < AGENTS * AGENTS; pair++) {
                uint32_t a = pair / AGENTS;
                uint32_t b = pair % AGENTS;
                uint32_t word = (uint32_t)onebit_threefry(1, trial, graph, pair);
                if (a < b && word % 16 == 0) {
                    joined[graph][a][b] = joined[graph][b][a] = 1;
                    bool turned = (word >> 8) % 2 == 0;
                    lists[graph][counts[graph]++] =
                        (struct edge){(turned ? b : a) + 1, (turned ? a : b) + 1};
                }
            }
        }
        for (uint32_t k = 0; k < GRAPHS * GRAPHS; k++) {
            transition[k] = 1.0 / GRAPHS;
        }
        TEST_ASSERT_TRUE(
            topology_build(&topology, AGENTS, GRAPHS, edges, counts, transition, &place, &problem));
        uint32_t link = 0;
        uint32_t label[AGENTS];
        for (uint32_t a = 0; a < AGENTS; a++) {
            label[a] = a;
            TEST_ASSERT_EQUAL_UINT32(link, topology.first_link[a]);
            for (uint32_t b = 0; b < AGENTS; b++) {
                if (joined[0][a][b] | joined[1][a][b] | joined[2][a][b]) {
                    TEST_ASSERT_EQUAL_UINT32(a + 1, topology.link_sender[link]);
                    TEST_ASSERT_EQUAL_UINT32(b + 1, topology.link_receiver[link]);
                    for (uint32_t graph = 0; graph < GRAPHS; graph++) {
                        TEST_ASSERT_EQUAL_UINT8(
                            joined[graph][a][b],
                            topology.linked[graph * topology.link_count + link]);
                    }
                    link++;
                }
            }
        }
        TEST_ASSERT_EQUAL_UINT32(link, topology.link_count);
        for (uint32_t round = 0; round < AGENTS; round++) {
            for (uint32_t k = 0; k < link; k++) {
                uint32_t *sender = &label[topology.link_sender[k] - 1];
                uint32_t receiver = label[topology.link_receiver[k] - 1];
                *sender = receiver < *sender ? receiver : *sender;
            }
        }
        uint32_t components = 0;
        for (uint32_t a = 0; a < AGENTS; a++) {
            components += label[a] == a;
        }
        TEST_ASSERT_EQUAL_UINT32(components, topology.components);
        topology_free(&topology);
    }
}

static void bad_edges_are_refused(void)
{
    static const struct {
        struct edge edges[3];
        const char *says;
        uint32_t edge;
    } cases[] = {
        {{{1, 2}, {2, 2}, {2, 3}}, "itself", 1},
        {{{1, 2}, {2, 3}, {3, 4}}, "agent 4 does not exist", 2},
        {{{0, 2}, {2, 3}, {3, 1}}, "agent 0 does not exist", 0},
        {{{1, 2}, {2, 3}, {1, 2}}, "repeats edge 1", 2},
        {{{1, 2}, {3, 2}, {2, 3}}, "repeats edge 2", 2},
    };
    for (uint32_t k = 0; k < COUNT(cases); k++) {
        TEST_ASSERT_FALSE(build_one(3, cases[k].edges, 3));
        TEST_ASSERT_NOT_NULL_MESSAGE(strstr(problem.text, cases[k].says), problem.text);
        TEST_ASSERT_EQUAL_INT(TOPOLOGY_EDGE, place.part);
        TEST_ASSERT_EQUAL_UINT32(0, place.graph);
        TEST_ASSERT_EQUAL_UINT32(cases[k].edge, place.edge);
        TEST_ASSERT_NULL(topology.first_link);
    }
}

static void the_same_edge_in_two_graphs_is_one_link(void)
{
    const double transition[] = {0.5, 0.5, 0.5, 0.5};
    TEST_ASSERT_TRUE(build_chain(2, transition));
    TEST_ASSERT_EQUAL_UINT32(2, topology.link_count);
}

static void reducible_chains_are_refused(void)
{
    const double absorbing[] = {0.5, 0.5, 0, 1}; /* never back to 1 */
    const double closed[] = {1, 0, 0.5, 0.5};    /* never out of 1 */
    const double split[] = {0, 1, 0, 1, 0, 0, 0, 0, 1};
    TEST_ASSERT_FALSE(build_chain(2, absorbing));
    TEST_ASSERT_NOT_NULL(strstr(problem.text, "from graph 2 it never comes to graph 1"));
    TEST_ASSERT_EQUAL_INT(TOPOLOGY_TRANSITION, place.part);
    TEST_ASSERT_EQUAL_UINT32(1, place.graph);
    TEST_ASSERT_FALSE(build_chain(2, closed));
    TEST_ASSERT_NOT_NULL(strstr(problem.text, "from graph 1 it never comes to graph 2"));
    TEST_ASSERT_EQUAL_UINT32(0, place.graph);
    TEST_ASSERT_FALSE(build_chain(3, split));
    TEST_ASSERT_NULL(topology.transition);
}

static void periods_are_found(void)
{
    const double cycle[] = {0, 1, 0, 0, 0, 1, 1, 0, 0};
    const double stays[] = {0.1, 0.9, 0, 0, 0, 1, 1, 0, 0};
    const double there_and_back[] = {0, 1, 0, 0.5, 0, 0.5, 0, 1, 0};
    /* Closed walks of 2 and of 3 steps. */
    const double mixed[] = {0, 1, 0, 0.5, 0, 0.5, 1, 0, 0};
    const struct {
        const double *transition;
        uint32_t period;
    } cases[] = {{cycle, 3}, {stays, 1}, {there_and_back, 2}, {mixed, 1}};
    for (uint32_t k = 0; k < COUNT(cases); k++) {
        TEST_ASSERT_TRUE(build_chain(3, cases[k].transition));
        TEST_ASSERT_EQUAL_UINT32(cases[k].period, topology.period);
        topology_free(&topology);
    }
    const double one[] = {1};
    TEST_ASSERT_TRUE(build_chain(1, one));
    TEST_ASSERT_EQUAL_UINT32(1, topology.period);
}

static void stationary_laws_are_known_ones(void)
{
    const double paper[] = {0.5, 0.3, 0.2, 0.2, 0.5, 0.3, 0.3, 0.2, 0.5};
    TEST_ASSERT_TRUE(build_chain(3, paper));
    for (int k = 0; k < 3; k++) {
        TEST_ASSERT_DOUBLE_WITHIN(1e-15, 1.0 / 3, topology.stationary[k]);
    }
    topology_free(&topology);

    /* Of two graphs left with probabilities a and b: b/(a+b), a/(a+b), however small. */
    const double rare[] = {1 - 0x1p-40, 0x1p-40, 0x1p-20, 1 - 0x1p-20};
    TEST_ASSERT_TRUE(build_chain(2, rare));
    double expected = 0x1p-40 / (0x1p-40 + 0x1p-20);
    TEST_ASSERT_DOUBLE_WITHIN(1e-15 * expected, expected, topology.stationary[1]);
    topology_free(&topology);

    for (uint32_t trial = 0; trial < 100; trial++) {
        double transition[16 * 16];
        for (uint32_t row = 0; row < 16; row++) {
            double sum = 0;
            for (uint32_t k = 0; k < 16; k++) {
                uint32_t word = (uint32_t)onebit_threefry(2, trial, row, k);
                transition[row * 16 + k] = word % 3 == 0 || k == (row + 1) % 16 ? word * 1e-9 : 0;
                sum += transition[row * 16 + k];
            }
            for (uint32_t k = 0; k < 16; k++) {
                transition[row * 16 + k] /= sum;
            }
        }
        TEST_ASSERT_TRUE(build_chain(16, transition));
        double total = 0;
        for (uint32_t k = 0; k < 16; k++) {
            double next = 0;
            for (uint32_t row = 0; row < 16; row++) {
                next += topology.stationary[row] * transition[row * 16 + k];
            }
            TEST_ASSERT_DOUBLE_WITHIN(1e-14, topology.stationary[k], next);
            total += topology.stationary[k];
        }
        TEST_ASSERT_DOUBLE_WITHIN(1e-14, 1, total);
        topology_free(&topology);
    }
}

static void draw_follows_its_words(void)
{
    const double transition[] = {0.25, 0.5, 0.25, 0.25, 0.5, 0.25, 0.25, 0.5, 0.25};
    const double short_law[] = {0.25, 0.5, 0.2499999999}; /* rounded: sums to less than one */
    TEST_ASSERT_TRUE(build_chain(3, transition));
    const struct {
        uint32_t word;
        uint32_t graph;
    } cases[] = {
        {0, 0}, {0x3FFFFFFF, 0}, {0x40000000, 1}, {0xBFFFFFFF, 1}, {0xC0000000, 2}, {0xFFFFFFFF, 2},
    };
    for (uint32_t k = 0; k < COUNT(cases); k++) {
        TEST_ASSERT_EQUAL_UINT32(cases[k].graph,
                                 topology_draw(&topology, transition, cases[k].word));
        TEST_ASSERT_EQUAL_UINT32(cases[k].graph,
                                 topology_draw(&topology, short_law, cases[k].word));
    }
}

/* A ring of a million agents with as many chords, in an order far from sorted. */
static void a_million_agents_are_built(void)
{
    enum { AGENTS = 1000000 };
    struct edge *edges = malloc(2 * AGENTS * sizeof *edges);
    TEST_ASSERT_NOT_NULL(edges);
    for (uint32_t k = 0; k < AGENTS; k++) {
        uint32_t here = (uint32_t)((uint64_t)k * 611953 % AGENTS);
        edges[2 * k] = (struct edge){here + 1, (here + 1) % AGENTS + 1};
        edges[2 * k + 1] = (struct edge){(here + 1000) % AGENTS + 1, here + 1};
    }
    bool built = build_one(AGENTS, edges, 2 * AGENTS);
    free(edges);
    TEST_ASSERT_TRUE(built);
    TEST_ASSERT_EQUAL_UINT32(4 * AGENTS, topology.link_count);
    TEST_ASSERT_EQUAL_UINT32(1, topology.components);
    TEST_ASSERT_EQUAL_UINT32(4, topology_degree(&topology, 0, AGENTS));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(links_of_two_graphs_are_sorted);
    RUN_TEST(random_graphs_match_brute_force);
    RUN_TEST(bad_edges_are_refused);
    RUN_TEST(the_same_edge_in_two_graphs_is_one_link);
    RUN_TEST(reducible_chains_are_refused);
    RUN_TEST(periods_are_found);
    RUN_TEST(stationary_laws_are_known_ones);
    RUN_TEST(draw_follows_its_words);
    RUN_TEST(a_million_agents_are_built);
    return UNITY_END();
}
