/*
 * The clock alignment of ports/alignment.h: restarted nodes find the group, and two that hear only
 * each other end aligned however they began.
 */
#include "alignment.h"

#include "unity.h"

#define FIRST 11u

void setUp(void)
{
}

void tearDown(void)
{
}

static void hear(struct alignment *alignment, uint32_t clock, uint32_t sender, uint32_t its_clock)
{
    const onebit_message message = {
        .sender = sender, .step = (uint8_t)(its_clock % ONEBIT_STEP_MODULUS), .has_step = true};
    alignment_hear(alignment, clock, &message);
}

/* The first mismatch of a node that has just started, agent 5 at clock t, by one of sender 2. */
static int32_t first_move(uint32_t t, uint32_t its_clock)
{
    struct alignment alignment = {0};
    hear(&alignment, t, 2, its_clock);
    return alignment_end_step(&alignment, 5, t + 1, FIRST);
}

static void test_moves_to_the_nearest_step(void)
{
    TEST_ASSERT_EQUAL_INT32(0, first_move(1000, 1000));
    TEST_ASSERT_EQUAL_INT32(1, first_move(1000, 1001));
    TEST_ASSERT_EQUAL_INT32(63, first_move(1000, 1063));
    TEST_ASSERT_EQUAL_INT32(-64, first_move(1000, 1064));
    TEST_ASSERT_EQUAL_INT32(-1, first_move(1000, 999));
    TEST_ASSERT_EQUAL_INT32(-1, first_move(1000, 999 + 128 * 5));
}

static void test_never_goes_below_the_first_step(void)
{
    for (uint32_t t = FIRST; t < FIRST + 200; ++t) {
        for (uint32_t error = 1; error < ONEBIT_STEP_MODULUS; ++error) {
            int64_t next = (int64_t)t + 1 + first_move(t, t + error);
            TEST_ASSERT_TRUE(next >= FIRST);
            TEST_ASSERT_EQUAL_INT64((t + 1 + error) % ONEBIT_STEP_MODULUS,
                                    next % ONEBIT_STEP_MODULUS);
            /* Back where there is room, otherwise forward, and never further than it must. */
            bool room = t + 1 - FIRST >= ONEBIT_STEP_MODULUS - error;
            bool back = error >= 64 && room;
            TEST_ASSERT_EQUAL_INT64((int64_t)t + 1 + error - (back ? ONEBIT_STEP_MODULUS : 0),
                                    next);
        }
    }
    /* A clock near its end: the result moves beyond 2^32 - 1, and the library returns there. */
    TEST_ASSERT_EQUAL_INT32(5, first_move(UINT32_MAX - 1u, UINT32_MAX - 124u));
}

static void test_stays_where_not_all_are_off_by_the_same(void)
{
    struct alignment alignment = {0};
    for (int step = 0; step < 100; ++step) {
        hear(&alignment, 100, 6, 103);
        hear(&alignment, 100, 7, 104);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
        hear(&alignment, 100, 2, 100);
        hear(&alignment, 100, 3, 103);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
    }
}

static void test_follows_the_lowest_number_after_a_while(void)
{
    struct alignment alignment = {0};
    for (int message = 1; message <= 16; ++message) {
        hear(&alignment, 100, 3, 100);
        hear(&alignment, 100, 2, 107);
        TEST_ASSERT_EQUAL_INT32(message == 16 ? 7 : 0,
                                alignment_end_step(&alignment, 5, 101, FIRST));
        /* Steps in which the lowest is silent neither count nor break the row. */
        hear(&alignment, 100, 3, 100);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
    }
    for (uint32_t message = 0; message < 100; ++message) {
        hear(&alignment, 100, 3, 100);
        hear(&alignment, 100, 2, message % 16 == 0 ? 100 : 107);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
    }
}

static void test_silence_and_messages_without_step_say_nothing(void)
{
    struct alignment alignment = {0};
    const onebit_message message = {.sender = 2, .step = 0, .has_step = false};
    for (int step = 0; step < 10; ++step) {
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
        alignment_hear(&alignment, 100, &message);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
    }
}

/* The table of the header: the step at which a node moves, settled or not, lowest or not. */
static void test_patience(void)
{
    for (int settled = 0; settled <= 1; ++settled) {
        for (uint32_t sender = 2; sender <= 8; sender += 6) {
            struct alignment alignment = {0};
            if (settled) {
                hear(&alignment, 100, sender, 100);
                alignment_end_step(&alignment, 5, 101, FIRST);
            }
            int patience = (settled ? 3 : 1) + (sender > 5 ? 1 : 0);
            for (int step = 1; step <= patience; ++step) {
                hear(&alignment, 100, sender, 107);
                /* Silence in between changes nothing. */
                int32_t move = alignment_end_step(&alignment, 5, 101, FIRST);
                TEST_ASSERT_EQUAL_INT32(step == patience ? 7 : 0, move);
                TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
            }
        }
    }
}

static void test_another_error_begins_a_new_row(void)
{
    struct alignment alignment = {0};
    hear(&alignment, 100, 2, 100);
    alignment_end_step(&alignment, 5, 101, FIRST);
    for (uint32_t step = 0; step < 20; ++step) {
        hear(&alignment, 100, 2, 103 + step / 2);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, 5, 101, FIRST));
    }
}

struct pair_node {
    struct alignment alignment;
    uint32_t clock;
};

/* Two that hear only each other, either of them settled or not, off by anything. */
static void test_a_pair_ends_aligned(void)
{
    for (uint32_t error = 1; error < 2 * ONEBIT_STEP_MODULUS; ++error) {
        for (uint32_t settled = 0; settled < 4; ++settled) {
            struct pair_node nodes[2] = {{.clock = FIRST + error}, {.clock = FIRST}};
            nodes[0].alignment.settled = settled & 1u;
            nodes[1].alignment.settled = settled >> 1;
            int moves = 0;
            for (int step = 0; step < 10; ++step) {
                uint32_t clocks[2] = {nodes[0].clock, nodes[1].clock};
                for (uint32_t k = 0; k < 2; ++k) {
                    hear(&nodes[k].alignment, clocks[k], 2 - k, clocks[1 - k]);
                    int32_t move =
                        alignment_end_step(&nodes[k].alignment, k + 1, clocks[k] + 1, FIRST);
                    nodes[k].clock = (uint32_t)((int64_t)clocks[k] + 1 + move);
                    TEST_ASSERT_TRUE(nodes[k].clock >= FIRST);
                    moves += move != 0;
                }
            }
            TEST_ASSERT_EQUAL_UINT32(nodes[0].clock % ONEBIT_STEP_MODULUS,
                                     nodes[1].clock % ONEBIT_STEP_MODULUS);
            TEST_ASSERT_EQUAL_INT(error % ONEBIT_STEP_MODULUS != 0, moves);
        }
    }
}

/* Seven in the ring with chords of the example, each begun somewhere else. */
static void test_a_scattered_group_gathers(void)
{
    static const uint32_t edges[][2] = {{1, 2}, {2, 3}, {3, 4}, {4, 5}, {5, 6},
                                        {6, 7}, {7, 1}, {1, 5}, {2, 6}, {4, 7}};
    uint32_t random = 1;
    for (int round = 0; round < 2000; ++round) {
        struct pair_node nodes[8] = {{.clock = 0}};
        for (uint32_t k = 1; k <= 7; ++k) {
            random = random * 1664525u + 1013904223u;
            /* Also clusters that are aligned within. */
            nodes[k].clock = FIRST + (random >> 16) % (round % 2 == 0 ? 3u : 500u);
            nodes[k].alignment.settled = random >> 31;
        }
        for (int step = 0; step < 120; ++step) {
            uint32_t clocks[8];
            for (uint32_t k = 1; k <= 7; ++k) {
                clocks[k] = nodes[k].clock;
            }
            for (uint32_t edge = 0; edge < sizeof edges / sizeof *edges; ++edge) {
                uint32_t one = edges[edge][0];
                uint32_t other = edges[edge][1];
                hear(&nodes[one].alignment, clocks[one], other, clocks[other]);
                hear(&nodes[other].alignment, clocks[other], one, clocks[one]);
            }
            for (uint32_t k = 1; k <= 7; ++k) {
                int32_t move = alignment_end_step(&nodes[k].alignment, k, clocks[k] + 1, FIRST);
                nodes[k].clock = (uint32_t)((int64_t)clocks[k] + 1 + move);
            }
        }
        for (uint32_t k = 2; k <= 7; ++k) {
            TEST_ASSERT_EQUAL_UINT32(nodes[1].clock % ONEBIT_STEP_MODULUS,
                                     nodes[k].clock % ONEBIT_STEP_MODULUS);
        }
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_moves_to_the_nearest_step);
    RUN_TEST(test_never_goes_below_the_first_step);
    RUN_TEST(test_stays_where_not_all_are_off_by_the_same);
    RUN_TEST(test_silence_and_messages_without_step_say_nothing);
    RUN_TEST(test_patience);
    RUN_TEST(test_another_error_begins_a_new_row);
    RUN_TEST(test_follows_the_lowest_number_after_a_while);
    RUN_TEST(test_a_pair_ends_aligned);
    RUN_TEST(test_a_scattered_group_gathers);
    return UNITY_END();
}
