/*
 * The rule of ports/alignment.h for one node: where it goes, with which probability, when at the
 * earliest, and what SYNC's counter does. Groups are in test_alignment_graphs.c.
 */
#include "alignment.h"
#include "clock_group.h"

#include "unity.h"

#include <math.h>

#define OWN 5u
#define FIRST 11u

/*
 * Shares of draws are held against the probability that the header states, within 5 standard errors
 * and the 2^-16 to which the rule compares: with words drawn anew a comparison would fail once in
 * 1.7 million.
 */
#define STANDARD_ERRORS 5.0

void setUp(void)
{
}

void tearDown(void)
{
}

/* An established node that has had a message off in 7 steps in a row and moves in the next. */
static struct alignment doubting(void)
{
    struct alignment alignment = group_established();
    for (uint32_t t = 100; t < 107; ++t) {
        group_hear(&alignment, t, 1, t);
        group_hear(&alignment, t, 2, t - 1u);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, OWN, t + 1u, FIRST));
    }
    return alignment;
}

/* The move of a node at clock t that hears only one other clock. */
static int32_t only_move(struct alignment *alignment, uint32_t t, uint32_t its_clock,
                         uint32_t first)
{
    for (int step = 0; step < 100; ++step) { /* 8^-100 */
        group_hear(alignment, t, 2, its_clock);
        int32_t move = alignment_end_step(alignment, OWN, t + 1u, first);
        if (move != 0) {
            return move;
        }
    }
    return 0;
}

static void assert_nearest(int32_t move, uint32_t next, uint32_t error, uint32_t first)
{
    uint32_t above = next - first; /* modulo 2^32 */
    bool back = error >= 64 && above >= ONEBIT_STEP_MODULUS - error;
    TEST_ASSERT_EQUAL_INT32(back ? (int32_t)error - 128 : (int32_t)error, move);
    TEST_ASSERT_TRUE((int64_t)above + move >= 0);
    TEST_ASSERT_EQUAL_UINT32((next + error) % ONEBIT_STEP_MODULUS,
                             (next + (uint32_t)move) % ONEBIT_STEP_MODULUS);
}

/* By frames and by SYNC; near the first step, far from it, and around the clock's end. */
static void test_goes_to_the_nearest_step_not_below_the_first(void)
{
    static const uint32_t firsts[] = {1, FIRST, UINT32_MAX - 127u, UINT32_MAX - 126u, UINT32_MAX};
    for (unsigned k = 0; k < sizeof firsts / sizeof *firsts; ++k) {
        for (uint32_t above = 0; above < 300; ++above) {
            for (uint32_t error = 0; error < ONEBIT_STEP_MODULUS; ++error) {
                struct alignment alignment = {0};
                uint32_t t = firsts[k] + above;
                assert_nearest(only_move(&alignment, t, t + error, firsts[k]), t + 1u, error,
                               firsts[k]);
                uint8_t residue = (uint8_t)((t + error) % ONEBIT_STEP_MODULUS);
                assert_nearest(alignment_sync(&alignment, residue, t, firsts[k]), t, error,
                               firsts[k]);
            }
        }
    }
    /* The clock has run through 2^32 and is below its first step: the way back is open. */
    struct alignment alignment = {0};
    TEST_ASSERT_EQUAL_INT32(-3, only_move(&alignment, 2, UINT32_MAX, FIRST));
    TEST_ASSERT_EQUAL_INT32(-3, alignment_sync(&alignment, 127, 2, FIRST));
    TEST_ASSERT_EQUAL_INT32(5, only_move(&alignment, UINT32_MAX - 1u, 3, FIRST));
}

/* How often a node like `like` moves that hears so much of its own clock and of one off by error.
 */
static void assert_probability(const struct alignment *like, unsigned on, unsigned off,
                               uint32_t error, double expected)
{
    const uint32_t draws = 100000;
    struct alignment heard = *like;
    for (unsigned k = 0; k < on; ++k) {
        group_hear(&heard, 0, 1, 0);
    }
    for (unsigned k = 0; k < off; ++k) {
        group_hear(&heard, 0, 2, error);
    }
    uint32_t moved = 0;
    for (uint32_t draw = 0; draw < draws; ++draw) {
        struct alignment alignment = heard;
        uint32_t next = ONEBIT_STEP_MODULUS * (10u + draw) + 64u; /* bit 6 is set */
        moved += alignment_end_step(&alignment, OWN, next, FIRST) != 0;
    }
    double margin = STANDARD_ERRORS * sqrt(expected * (1 - expected) / draws) + 0x1p-16;
    TEST_ASSERT_DOUBLE_WITHIN(margin, expected, (double)moved / draws);
}

/* As many as 32 neighbours send, and a flood from whoever disturbs the bus: no count wraps. */
static void test_probability(void)
{
    static const unsigned counts[][2] = {{0, 1},   {0, 32},  {1, 1},    {1, 2},   {2, 1},
                                         {1, 31},  {16, 16}, {31, 1},   {32, 32}, {0, 256},
                                         {256, 1}, {1, 256}, {256, 256}};
    const struct alignment new = {0};
    const struct alignment established = doubting();
    for (unsigned k = 0; k < sizeof counts / sizeof *counts; ++k) {
        double on = fmin(counts[k][0], 63);
        double off = fmin(counts[k][1], 63);
        /* An established node takes one that was on time lately for one now. */
        double ahead = 0.875 * off / (off + 4 * fmax(on, 1));
        double behind = 0.875 * off / (off + 1024 * fmax(on, 1));
        for (uint32_t error = 1; error < ONEBIT_STEP_MODULUS; error += 9) {
            assert_probability(&new, counts[k][0], counts[k][1], error, 0.875 * off / (off + on));
            assert_probability(&established, counts[k][0], counts[k][1], error,
                               error < 64 ? ahead : behind);
        }
    }
}

/* Of two clocks 64 apart one is ahead for both, and from every step to the next the same but 64. */
static void test_of_two_clocks_64_apart_one_is_ahead(void)
{
    const struct alignment like = doubting();
    uint32_t moved[2] = {0};
    for (uint32_t step = 0; step < 4000; ++step) {
        for (uint32_t bit = 0; bit < 2; ++bit) {
            struct alignment alignment = like;
            uint32_t next = 128u * (8u + step) + 64u * bit + step % 64u;
            group_hear(&alignment, next - 1u, 1, next - 1u);
            group_hear(&alignment, next - 1u, 2, next - 1u + 64u);
            moved[bit] += alignment_end_step(&alignment, OWN, next, FIRST) != 0;
        }
    }
    TEST_ASSERT_TRUE(moved[0] > 500); /* 700 +- 24 of probability 7/40 */
    TEST_ASSERT_TRUE(moved[1] < 30);  /* 3.4 of probability 7/8200 */
}

/* Any of 32 messages off is as likely to be followed, whatever its place. */
static void test_follows_any_that_is_off(void)
{
    const uint32_t steps = 320000;
    uint32_t followed[33] = {0};
    struct alignment alignment = {0};
    for (uint32_t step = 0; step < steps; ++step) {
        uint32_t t = 1000u + step;
        for (uint32_t k = 1; k <= 32; ++k) {
            group_hear(&alignment, t, k, t + k);
        }
        int32_t move = alignment_end_step(&alignment, OWN, t + 1u, FIRST);
        TEST_ASSERT_TRUE(move >= 0 && move <= 32);
        ++followed[move];
    }
    TEST_ASSERT_DOUBLE_WITHIN(STANDARD_ERRORS * sqrt(steps * 0.125 * 0.875), steps * 0.125,
                              followed[0]);
    double expected = steps * 0.875 / 32;
    for (uint32_t k = 1; k <= 32; ++k) {
        TEST_ASSERT_DOUBLE_WITHIN(STANDARD_ERRORS * sqrt(expected), expected, followed[k]);
    }
}

/* Nothing on time for 4 steps, or something off for 8: not a step sooner, and soon after. */
static void test_patience_of_an_established_node(void)
{
    uint32_t earliest[2] = {100, 100};
    for (uint32_t on = 0; on < 2; ++on) {
        for (uint32_t start = 1000; start < 2000; ++start) {
            struct alignment alignment = group_established();
            uint32_t t = start;
            for (uint32_t step = 1; step < earliest[on]; ++step, ++t) {
                if (on != 0) {
                    group_hear(&alignment, t, 1, t);
                }
                group_hear(&alignment, t, 2, t + 5u);
                if (alignment_end_step(&alignment, OWN, t + 1u, FIRST) != 0) {
                    earliest[on] = step;
                }
                /* Steps without a message neither count nor break a row. */
                ++t;
                TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, OWN, t + 1u, FIRST));
            }
        }
    }
    TEST_ASSERT_EQUAL_UINT32(4, earliest[0]);
    TEST_ASSERT_EQUAL_UINT32(8, earliest[1]);
}

/* A row ends with the first step in which all is on time, or one is. */
static void test_rows_end(void)
{
    struct alignment alignment = group_established();
    for (uint32_t t = 1000; t < 9000; ++t) {
        bool all_off = t % 4u != 0;
        bool some_off = t % 8u != 0;
        if (!all_off) {
            group_hear(&alignment, t, 1, t);
        }
        if (some_off) {
            group_hear(&alignment, t, 2, t + 5u);
        }
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, OWN, t + 1u, FIRST));
    }
}

/* New are the first 16 steps with a message on time, whatever is heard between them. */
static void test_a_node_is_new_for_16_steps(void)
{
    for (uint32_t steps = 0; steps < 20; ++steps) {
        uint32_t moved = 0;
        for (uint32_t start = 1000; start < 1400; ++start) {
            struct alignment alignment = {0};
            uint32_t t = start;
            for (uint32_t step = 0; step < steps; ++step, ++t) {
                group_hear(&alignment, t, 1, t);
                TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, OWN, t + 1u, FIRST));
            }
            group_hear(&alignment, t, 2, t + 5u);
            moved += alignment_end_step(&alignment, OWN, t + 1u, FIRST) != 0;
        }
        if (steps < 16) {
            TEST_ASSERT_TRUE(moved > 300); /* 350 +- 7 */
        } else {
            TEST_ASSERT_EQUAL_UINT32(0, moved);
        }
    }
}

static void test_silence_and_messages_without_step_say_nothing(void)
{
    struct alignment alignment = {0};
    const onebit_message message = {.sender = 2, .step = 0, .has_step = false};
    for (uint32_t t = 100; t < 300; ++t) {
        alignment_hear(&alignment, t, &message);
        TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, OWN, t + 1u, FIRST));
    }
    TEST_ASSERT_EQUAL_UINT32(0, alignment.draws);
}

/*
 * A word is that of number, clock and count of words: 32 nodes alike but for one of them, which
 * move with probability 7/16, all decide the same once in 10^8 times.
 */
static void test_every_node_draws_for_itself(void)
{
    struct alignment heard = {0};
    group_hear(&heard, 0, 1, 0);
    group_hear(&heard, 0, 2, 5);
    for (uint32_t round = 0; round < 1000; ++round) {
        uint32_t moved[3] = {0};
        for (uint32_t k = 1; k <= 32; ++k) {
            const uint32_t word[3][3] = {{k, 1000, 0}, {OWN, 1000 + k, 0}, {OWN, 1000, k}};
            for (unsigned which = 0; which < 3; ++which) {
                struct alignment alignment = heard;
                alignment.draws = word[which][2] + 100u * round;
                moved[which] += alignment_end_step(&alignment, word[which][0],
                                                   word[which][1] + 100u * round, FIRST) != 0;
            }
        }
        for (unsigned which = 0; which < 3; ++which) {
            TEST_ASSERT_TRUE(moved[which] > 0 && moved[which] < 32);
        }
    }
}

/*
 * Two that hear only each other, whatever their numbers: they never go on changing places, as they
 * would for ever if a word depended on number and clock alone. They part with probability 7/32 a
 * step if both are new, which leaves one of these 124,000 pairs after 150 steps once in 10^11
 * times.
 */
static void test_a_pair_joins(void)
{
    for (uint32_t one = 1; one <= 32; ++one) {
        for (uint32_t other = one + 1; other <= 32; ++other) {
            for (uint32_t error = 1; error < 2 * ONEBIT_STEP_MODULUS; ++error) {
                struct alignment alignment[2] = {{0}, {0}};
                uint32_t clock[2] = {FIRST + error, FIRST};
                uint32_t steps = 0;
                for (; (clock[0] - clock[1]) % ONEBIT_STEP_MODULUS != 0; ++steps) {
                    TEST_ASSERT_TRUE(steps < 150);
                    group_hear(&alignment[0], clock[0], other, clock[1]);
                    group_hear(&alignment[1], clock[1], one, clock[0]);
                    for (uint32_t k = 0; k < 2; ++k) {
                        ++clock[k];
                        clock[k] += (uint32_t)alignment_end_step(
                            &alignment[k], k == 0 ? one : other, clock[k], FIRST);
                    }
                }
            }
        }
    }
}

/* SYNC tells the time at once, whatever was heard and believed. */
static void test_sync_tells_the_time_at_once(void)
{
    struct alignment alignment = doubting();
    group_hear(&alignment, 107, 1, 107);
    TEST_ASSERT_EQUAL_INT32(0, alignment_sync(&alignment, 108, 108, FIRST));
    TEST_ASSERT_EQUAL_INT32(20, alignment_sync(&alignment, 0, 108, FIRST));
    TEST_ASSERT_EQUAL_INT32(-8, alignment_sync(&alignment, 100, 108, FIRST));
}

/*
 * While it does, what neighbours say moves nobody: not beside a SYNC in every step, not where up to
 * 7 steps in between began without one. Without any, frames move a node from the 9th step on.
 */
static void test_what_frames_say_while_sync_tells_the_time(void)
{
    for (uint32_t gap = 1; gap <= 8; ++gap) {
        struct alignment alignment = {0};
        for (uint32_t step = 0; step < 500; ++step) {
            uint32_t t = 1000u + step;
            if (step % gap == 0) {
                TEST_ASSERT_EQUAL_INT32(0, alignment_sync(&alignment, t % 128u, t, FIRST));
            }
            group_hear(&alignment, t, 2, t + 5u);
            TEST_ASSERT_EQUAL_INT32(0, alignment_end_step(&alignment, OWN, t + 1u, FIRST));
        }
    }
    uint32_t earliest = 100;
    for (uint32_t start = 1000; start < 1100; ++start) {
        struct alignment alignment = {0};
        alignment_sync(&alignment, start % 128u, start, FIRST);
        for (uint32_t step = 1; step < earliest; ++step) {
            uint32_t t = start + step - 1u;
            group_hear(&alignment, t, 2, t + 5u);
            if (alignment_end_step(&alignment, OWN, t + 1u, FIRST) != 0) {
                earliest = step;
            }
        }
    }
    TEST_ASSERT_EQUAL_UINT32(9, earliest);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_goes_to_the_nearest_step_not_below_the_first);
    RUN_TEST(test_probability);
    RUN_TEST(test_of_two_clocks_64_apart_one_is_ahead);
    RUN_TEST(test_follows_any_that_is_off);
    RUN_TEST(test_patience_of_an_established_node);
    RUN_TEST(test_rows_end);
    RUN_TEST(test_a_node_is_new_for_16_steps);
    RUN_TEST(test_silence_and_messages_without_step_say_nothing);
    RUN_TEST(test_every_node_draws_for_itself);
    RUN_TEST(test_a_pair_joins);
    RUN_TEST(test_sync_tells_the_time_at_once);
    RUN_TEST(test_what_frames_say_while_sync_tells_the_time);
    return UNITY_END();
}
