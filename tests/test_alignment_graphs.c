/*
 * Groups under the rule of ports/alignment.h: whatever restarts gathers, on every small graph; with
 * SYNC's counter at once; and a node whose frames are always late costs the others next to nothing.
 */
#include "clock_group.h"

#include "unity.h"

#include <string.h>

#define BIT(number) (UINT64_C(1) << ((number)-1u))

static struct clock_group group;
static uint32_t cases = 1; /* generator of first steps, clocks, subsets and graphs */

void setUp(void)
{
}

void tearDown(void)
{
}

/* No edges yet, 5 % of frames lost. */
static void make_nodes(uint32_t size)
{
    group = (struct clock_group){.size = size, .random = 1, .loss = LOSS_5_PERCENT};
}

static void connect(const uint32_t (*edges)[2], size_t count)
{
    for (size_t k = 0; k < count; ++k) {
        group_connect(&group, edges[k][0] - 1u, edges[k][1] - 1u);
    }
}

static void make_ring(uint32_t size)
{
    make_nodes(size);
    for (uint32_t k = 0; k < size; ++k) {
        group_connect(&group, k, (k + 1u) % size);
    }
}

static void make_complete(uint32_t size)
{
    make_nodes(size);
    for (uint32_t one = 0; one < size; ++one) {
        for (uint32_t other = 0; other < one; ++other) {
            group_connect(&group, one, other);
        }
    }
}

/* Between a path and a complete graph. */
static void make_random(uint32_t size)
{
    do {
        make_nodes(size);
        uint32_t probability = group_random(&cases);
        for (uint32_t one = 0; one < size; ++one) {
            for (uint32_t other = 0; other < one; ++other) {
                if (group_random(&cases) < probability) {
                    group_connect(&group, one, other);
                }
            }
        }
    } while (!group_is_connected(&group));
}

/* The ring of seven with chords, as in the example. */
static void make_seven(void)
{
    static const uint32_t chords[][2] = {{1, 5}, {2, 6}, {4, 7}};
    make_ring(7);
    connect(chords, 3);
}

static void make_two_triangles(void)
{
    static const uint32_t edges[][2] = {{1, 2}, {1, 3}, {2, 3}, {4, 5}, {4, 6}, {5, 6}, {3, 4}};
    make_nodes(6);
    connect(edges, 7);
}

static uint64_t random_subset(void)
{
    uint64_t low = group_random(&cases);
    return (low | (uint64_t)group_random(&cases) << 32) & ((UINT64_C(1) << group.size) - 1u);
}

static void test_all_graphs_of_up_to_five_nodes_gather(void)
{
    for (uint32_t size = 2; size <= 5; ++size) {
        group_assert_all_graphs_gather(size);
    }
}

static void test_all_graphs_of_up_to_five_nodes_follow_sync(void)
{
    for (uint32_t size = 2; size <= 5; ++size) {
        group_assert_all_graphs_follow_sync(size);
    }
}

/* The lowest number of a neighbourhood is not that of the group: 1-3-2-4, 2 and 4 restarted. */
static void test_path_1_3_2_4(void)
{
    static const uint32_t edges[][2] = {{1, 3}, {3, 2}, {2, 4}};
    make_nodes(4);
    connect(edges, 3);
    for (int run = 0; run < 10000; ++run) {
        group_begin(&group, &cases);
        group_restart(&group, BIT(2) | BIT(4));
        group_assert_gathers(&group);
    }
}

static void test_rings_of_eight(void)
{
    make_ring(8);
    for (uint64_t nodes = 0; nodes < 256; ++nodes) {
        for (int run = 0; run < 8; ++run) {
            group_begin(&group, &cases);
            group_restart(&group, nodes);
            group_assert_gathers(&group);
        }
    }
}

static void test_random_graphs(void)
{
    for (uint32_t run = 0; run < 3000; ++run) {
        make_random(3u + run % 8u);
        group_begin(&group, &cases);
        group_restart(&group, random_subset());
        group_assert_gathers(&group);
        /* And every node somewhere else. */
        group_begin(&group, &cases);
        group_restart(&group, random_subset());
        for (uint32_t k = 0; k < group.size; ++k) {
            group.clock[k] += group_random(&cases) % 500u;
        }
        group_assert_gathers(&group);
    }
}

/* Each a majority of its own, established, by any number of steps apart. */
static void test_two_triangles(void)
{
    make_two_triangles();
    for (uint32_t apart = 1; apart < ONEBIT_STEP_MODULUS; ++apart) {
        for (int run = 0; run < 20; ++run) {
            group_begin(&group, &cases);
            group_miss(&group, BIT(1) | BIT(2) | BIT(3), apart);
            group_assert_gathers(&group);
            group_begin(&group, &cases);
            group_restart(&group, BIT(1) | BIT(2) | BIT(3));
            group_assert_gathers(&group);
        }
    }
}

/* As many neighbours as a node can have. */
static void test_33_nodes_that_all_hear_each_other(void)
{
    make_complete(33);
    for (int run = 0; run < 200; ++run) {
        group_begin(&group, &cases);
        group_restart(&group, random_subset());
        group_assert_gathers(&group);
        group_begin(&group, &cases);
        group_miss(&group, random_subset(), 1);
        group_assert_gathers(&group);
        group_begin(&group, &cases);
        group_miss(&group, BIT(1 + (uint32_t)run % 33u), 1);
        group_assert_gathers(&group);
    }
}

/*
 * One restarted in an established group. It stays a tick with probability 1/8, or 0.127 where it
 * may have heard nothing of its two neighbours; that 12 ticks do not suffice, and that another is
 * drawn to it (after 8 ticks at the earliest), is expected less than 0.01 times in these runs.
 */
static void test_a_restarted_node_joins_soon_and_disturbs_nobody(void)
{
    make_seven();
    for (int run = 0; run < 2000; ++run) {
        for (uint32_t node = 1; node <= 7; ++node) {
            group_begin(&group, &cases);
            group_restart(&group, BIT(node));
            TEST_ASSERT_TRUE(group_gather(&group, 13) <= 12);
            for (uint32_t k = 1; k <= 7; ++k) {
                TEST_ASSERT_TRUE(k == node || group.moves[k - 1u] == 0);
            }
        }
    }
}

/* No case for chance: where all is on time nobody draws, whatever is lost. */
static void test_a_gathered_group_stays(void)
{
    for (uint32_t run = 0; run < 100; ++run) {
        make_random(3u + run % 8u);
        group_begin(&group, &cases);
        for (int tick = 0; tick < 1000; ++tick) {
            group_tick(&group);
        }
        for (uint32_t k = 0; k < group.size; ++k) {
            TEST_ASSERT_EQUAL_UINT32(0, group.moves[k]);
            TEST_ASSERT_EQUAL_UINT32(0, group.alignment[k].draws);
        }
    }
}

/*
 * A node's frames always come one tick late, to everybody. On every link between the others at
 * least 95 % of the frames that arrive are on time; the rule makes it about 99 %.
 */
static void assert_late_node_costs_little(uint32_t late, uint32_t ticks)
{
    static struct group_counts counts;
    memset(&counts, 0, sizeof counts);
    group.late = BIT(late);
    group.counts = &counts;
    group_begin(&group, &cases);
    for (uint32_t tick = 0; tick < ticks; ++tick) {
        group_tick(&group);
    }
    for (uint32_t k = 0; k < group.size; ++k) {
        for (uint32_t j = 0; j < group.size; ++j) {
            if (k != late - 1u && j != late - 1u) {
                TEST_ASSERT_TRUE(counts.on_time[k][j] >= 0.95 * counts.arrived[k][j]);
            }
        }
    }
    group.late = 0;
    group.counts = NULL;
}

static void test_a_late_node_on_all_graphs_of_up_to_five_nodes(void)
{
    for (uint32_t size = 3; size <= 5; ++size) {
        uint32_t edges = 0;
        make_nodes(size);
        while (group_next_graph(&group, size, &edges)) {
            group.loss = 0;
            assert_late_node_costs_little(1, 10000);
            group.loss = LOSS_5_PERCENT;
            assert_late_node_costs_little(1, 10000);
        }
    }
}

static void test_a_late_node_in_larger_groups(void)
{
    for (uint32_t loss = 0; loss <= LOSS_5_PERCENT; loss += LOSS_5_PERCENT) {
        make_seven();
        group.loss = loss;
        assert_late_node_costs_little(1, 100000);
        make_ring(8);
        group.loss = loss;
        assert_late_node_costs_little(1, 100000);
        make_complete(33);
        group.loss = loss;
        assert_late_node_costs_little(1, 5000);
    }
}

/* The group's clock, or the first step of those that restart, near 2^32: moves are modulo 2^32. */
static void test_near_the_end_of_the_clock(void)
{
    make_seven();
    for (uint32_t before = 0; before < 300; ++before) {
        for (int run = 0; run < 10; ++run) {
            group.first = 11;
            group_establish(&group, UINT32_MAX - before);
            group_restart(&group, random_subset());
            group_assert_gathers(&group);

            group.first = UINT32_MAX - before;
            group_establish(&group, group.first + 128u + group_random(&cases) % 1000u);
            group_restart(&group, random_subset());
            group_assert_gathers(&group);
            for (uint32_t k = 0; k < group.size; ++k) {
                /* 128 for every tick and more: far from being below the first. */
                TEST_ASSERT_TRUE(group.clock[k] - group.first < 128u * GATHERING_TICKS);
            }
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_all_graphs_of_up_to_five_nodes_gather);
    RUN_TEST(test_all_graphs_of_up_to_five_nodes_follow_sync);
    RUN_TEST(test_path_1_3_2_4);
    RUN_TEST(test_rings_of_eight);
    RUN_TEST(test_random_graphs);
    RUN_TEST(test_two_triangles);
    RUN_TEST(test_33_nodes_that_all_hear_each_other);
    RUN_TEST(test_a_restarted_node_joins_soon_and_disturbs_nobody);
    RUN_TEST(test_a_gathered_group_stays);
    RUN_TEST(test_a_late_node_on_all_graphs_of_up_to_five_nodes);
    RUN_TEST(test_a_late_node_in_larger_groups);
    RUN_TEST(test_near_the_end_of_the_clock);
    return UNITY_END();
}
