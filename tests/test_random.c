/* The random words of lib/onebit_random.h against answers from elsewhere. */
#include "onebit_random.h"

#include <unity.h>

void setUp(void)
{
}

void tearDown(void)
{
}

/*
 * Random123's published known answers (its file kat_vectors, threefry2x32 with 20 rounds). The
 * third has four different words, so it also fixes the order of the arguments.
 */
static void test_known_answers(void)
{
    static const struct {
        uint32_t counter[2], key[2], output[2];
    } answers[] = {
        {{0, 0}, {0, 0}, {0x6b200159u, 0x99ba4efeu}},
        {{0xffffffffu, 0xffffffffu}, {0xffffffffu, 0xffffffffu}, {0x1cb996fcu, 0xbb002be7u}},
        {{0x243f6a88u, 0x85a308d3u}, {0x13198a2eu, 0x03707344u}, {0xc4923a9cu, 0x483df7a0u}},
    };
    for (unsigned k = 0; k < sizeof answers / sizeof *answers; ++k) {
        uint64_t words = onebit_threefry(answers[k].key[0], answers[k].key[1],
                                         answers[k].counter[0], answers[k].counter[1]);
        TEST_ASSERT_EQUAL_HEX32(answers[k].output[0], (uint32_t)words);
        TEST_ASSERT_EQUAL_HEX32(answers[k].output[1], (uint32_t)(words >> 32));
    }
}

/* Key (seed, run), counter (link, t), first word: the third known answer again. */
static void test_word_takes_seed_run_link_clock(void)
{
    TEST_ASSERT_EQUAL_HEX32(0xc4923a9cu,
                            onebit_random_word(0x13198a2eu, 0x03707344u, 0x243f6a88u, 0x85a308d3u));
}

/* Small numbers as a simulation uses them; computed by threefry2x32 of tests/oracle.py. */
static void test_words_of_small_numbers(void)
{
    static const uint32_t words[][5] = {
        {0u, 0u, 0u, 11u, 0x0f3769d2u}, {1u, 0u, 1u, 11u, 0x340ccd2cu},
        {1u, 0u, 2u, 11u, 0x798190ceu}, {1u, 1u, 1u, 11u, 0xfbb644b7u},
        {2u, 0u, 1u, 12u, 0xa7961d2du}, {4294967295u, 999u, 8191u, 4294967295u, 0xe7af31b4u},
    };
    for (unsigned k = 0; k < sizeof words / sizeof *words; ++k) {
        TEST_ASSERT_EQUAL_HEX32(
            words[k][4], onebit_random_word(words[k][0], words[k][1], words[k][2], words[k][3]));
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_known_answers);
    RUN_TEST(test_word_takes_seed_run_link_clock);
    RUN_TEST(test_words_of_small_numbers);
    return UNITY_END();
}
