/*
 * The agent of lib/onebit.h in each arithmetic: what it refuses and how, what each verb computes
 * (against the paper's formulas in double precision), and what it leaves alone.
 */
#include "onebit.h"

#include "onebit_arithmetic.h"
#include "onebit_random.h"

#include "numbers.h"

#include <float.h>
#include <string.h>

/* Formats of q31; the other arithmetics ignore them. */
#define ROW_BITS 28
#define STATE_BITS 26
#define CONTROL_BITS 26

/* Half a unit in the last place of a number about 1, for the two arithmetics that have one. */
#define ROUNDING (ONEBIT_ARITHMETIC == ONEBIT_F32 ? 0x1p-24 : 0x1p-53)

#if ONEBIT_ARITHMETIC == ONEBIT_F32
#define LARGEST FLT_MAX
#elif ONEBIT_ARITHMETIC == ONEBIT_F64
#define LARGEST DBL_MAX
#endif

#define OWN 4u
#define STATES 3u
#define NEIGHBOURS 3u
#define START 10u

static uint32_t neighbours[ONEBIT_NEIGHBOURS_MAX + 1];
static onebit_real stabilizing[ONEBIT_STATES_MAX + 1];
static onebit_real compression[ONEBIT_STATES_MAX + 1];
static onebit_config config;

/* Agent and estimates as one piece of memory, to be compared as a whole. */
static struct memory {
    onebit_agent agent;
    onebit_estimate estimates[ONEBIT_NEIGHBOURS_MAX];
} memory;

/* Agent 4 with neighbours 2, 5, 9 and three states, in payload form; a step of the estimator is
 * small enough at the first clock to stay inside the bound. */
void setUp(void)
{
    static const double first[STATES] = {-0.5, 0.25, 0.125};
    static const double second[STATES] = {0.5, -0.25, 1.0};
    memset(neighbours, 0, sizeof neighbours);
    neighbours[0] = 2;
    neighbours[1] = 5;
    neighbours[2] = 9;
    memset(stabilizing, 0, sizeof stabilizing);
    memset(compression, 0, sizeof compression);
    for (unsigned k = 0; k < STATES; ++k) {
        stabilizing[k] = number_in(first[k], ROW_BITS);
        compression[k] = number_in(second[k], ROW_BITS);
    }
    memset(&config, 0, sizeof config);
    config.agent = OWN;
    config.neighbours = neighbours;
    config.neighbour_count = NEIGHBOURS;
    config.state_count = STATES;
    config.format = (onebit_format)ONEBIT_FORMAT_BROADCAST_PAYLOAD;
    config.stabilizing = stabilizing;
    config.compression = compression;
    config.threshold = number(-0.5);
    config.bound = number(0.5);
    config.estimator_gain = coefficient(3.7);
    config.control_gain = coefficient(4.3);
    config.start = START;
    config.first_link = 1;
    config.fraction_bits.stabilizing = ROW_BITS;
    config.fraction_bits.compression = ROW_BITS;
    config.fraction_bits.state = STATE_BITS;
    config.fraction_bits.control = CONTROL_BITS;
    memset(&memory, 0xA5, sizeof memory);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
}

void tearDown(void)
{
}

static void fill_states(onebit_real *x, double a, double b, double c)
{
    x[0] = number_in(a, STATE_BITS);
    x[1] = number_in(b, STATE_BITS);
    x[2] = number_in(c, STATE_BITS);
}

static onebit_message message_from(uint32_t sender, bool bit)
{
    onebit_message message = {sender, OWN, (uint8_t)(memory.agent.clock % 128u), true, bit};
    return message;
}

static onebit_frame frame_from(uint32_t sender, bool bit)
{
    onebit_message message = message_from(sender, bit);
    onebit_frame frame;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&config.format, &message, &frame));
    return frame;
}

static void receive(uint32_t sender, bool bit)
{
    onebit_frame frame = frame_from(sender, bit);
    TEST_ASSERT_EQUAL(ONEBIT_OK,
                      onebit_receive(&config, &memory.agent, &frame, ONEBIT_ALL_LINKED, NULL));
}

/* ---- onebit_check and onebit_start ---- */

/* Refused by onebit_check and, with nothing touched, by onebit_start. */
static void check_config(onebit_status expected)
{
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    TEST_ASSERT_EQUAL(expected, onebit_check(&config));
    if (expected != ONEBIT_OK) {
        TEST_ASSERT_EQUAL(expected, onebit_start(&config, &memory.agent, memory.estimates, NULL));
        TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
    }
}

/* Gives one field of the sound configuration another value and expects `status`. */
#define WITH(field, value, status)                                                                 \
    do {                                                                                           \
        setUp();                                                                                   \
        config.field = (value);                                                                    \
        check_config(status);                                                                      \
    } while (0)

static void test_check_takes_a_sound_configuration(void)
{
    check_config(ONEBIT_OK);
    WITH(start, 1, ONEBIT_OK);
    WITH(start, UINT32_MAX - 1u, ONEBIT_OK);
    WITH(format.mode, ONEBIT_MODE_LINK, ONEBIT_OK);
    WITH(format.encoding, ONEBIT_ENCODING_IDENTIFIER, ONEBIT_OK);
    WITH(state_count, ONEBIT_STATES_MAX, ONEBIT_OK);
}

static void test_check_pointers(void)
{
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_check(NULL));
    WITH(neighbours, NULL, ONEBIT_NULL);
    WITH(stabilizing, NULL, ONEBIT_NULL);
    WITH(compression, NULL, ONEBIT_NULL);
}

static void test_check_agent_and_neighbours(void)
{
    WITH(agent, 0, ONEBIT_CONFIG_AGENT);
    WITH(neighbour_count, 0, ONEBIT_CONFIG_NEIGHBOURS);
    WITH(neighbour_count, ONEBIT_NEIGHBOURS_MAX + 1, ONEBIT_CONFIG_NEIGHBOURS);
    WITH(neighbour_count, 255, ONEBIT_CONFIG_NEIGHBOURS);
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        WITH(agent, neighbours[k], ONEBIT_CONFIG_NEIGHBOURS);
    }
    static const uint32_t wrong[][NEIGHBOURS] = {{0, 5, 9}, {2, 2, 9}, {2, 9, 9},
                                                 {5, 2, 9}, {2, 9, 5}, {9, 5, 2}};
    for (unsigned k = 0; k < sizeof wrong / sizeof *wrong; ++k) {
        setUp();
        memcpy(neighbours, wrong[k], sizeof wrong[k]);
        check_config(ONEBIT_CONFIG_NEIGHBOURS);
    }
    /* As many as there is room for. */
    setUp();
    for (uint32_t k = 0; k <= ONEBIT_NEIGHBOURS_MAX; ++k) {
        neighbours[k] = OWN + 1u + k;
    }
    config.neighbour_count = ONEBIT_NEIGHBOURS_MAX;
    check_config(ONEBIT_OK);
    config.neighbour_count = ONEBIT_NEIGHBOURS_MAX + 1;
    check_config(ONEBIT_CONFIG_NEIGHBOURS);
}

static void test_check_states_and_rows(void)
{
    WITH(state_count, 0, ONEBIT_CONFIG_STATES);
    WITH(state_count, ONEBIT_STATES_MAX + 1, ONEBIT_CONFIG_STATES);
    WITH(state_count, 255, ONEBIT_CONFIG_STATES);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    const onebit_real wrong[] = {INT32_MIN, INT32_MAX, -INT32_MAX};
#else
    const onebit_real wrong[] = {(onebit_real)NAN, (onebit_real)INFINITY, (onebit_real)-INFINITY};
#endif
    for (unsigned k = 0; k < STATES; ++k) {
        for (unsigned w = 0; w < sizeof wrong / sizeof *wrong; ++w) {
            setUp();
            stabilizing[k] = wrong[w];
            check_config(ONEBIT_CONFIG_STABILIZING);
            setUp();
            compression[k] = wrong[w];
            check_config(ONEBIT_CONFIG_COMPRESSION);
        }
    }
    /* Behind the row's end anything may stand. */
    setUp();
    stabilizing[STATES] = wrong[0];
    compression[STATES] = wrong[0];
    check_config(ONEBIT_OK);
}

static void test_check_threshold_and_bound(void)
{
    WITH(threshold, number(4), ONEBIT_CONFIG_THRESHOLD);
    WITH(threshold, number(-4), ONEBIT_CONFIG_THRESHOLD);
    WITH(threshold, number(7.5), ONEBIT_CONFIG_THRESHOLD);
    WITH(threshold, number(-7.5), ONEBIT_CONFIG_THRESHOLD);
    WITH(bound, 0, ONEBIT_CONFIG_BOUND);
    WITH(bound, number(-0.5), ONEBIT_CONFIG_BOUND);
    WITH(bound, number(3.50001), ONEBIT_CONFIG_BOUND);
    WITH(bound, number(3.5), ONEBIT_OK); /* |c| + M = 4 */
    config.threshold = number(0.5);
    check_config(ONEBIT_OK);
    config.threshold = number(0.50001);
    check_config(ONEBIT_CONFIG_BOUND);
    config.threshold = number(-0.50001);
    check_config(ONEBIT_CONFIG_BOUND);
    WITH(threshold, number(-3.75), ONEBIT_CONFIG_BOUND);
    config.bound = number(0.25);
    check_config(ONEBIT_OK);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    WITH(threshold, INT32_MIN, ONEBIT_CONFIG_THRESHOLD);
    WITH(threshold, INT32_MAX, ONEBIT_CONFIG_THRESHOLD);
    WITH(bound, INT32_MIN, ONEBIT_CONFIG_BOUND);
    WITH(bound, INT32_MAX, ONEBIT_CONFIG_BOUND);
#else
    const onebit_real wrong[] = {(onebit_real)NAN, (onebit_real)INFINITY, (onebit_real)-INFINITY};
    for (unsigned w = 0; w < sizeof wrong / sizeof *wrong; ++w) {
        WITH(threshold, wrong[w], ONEBIT_CONFIG_THRESHOLD);
        WITH(bound, wrong[w], ONEBIT_CONFIG_BOUND);
    }
#endif
}

static void test_check_gains(void)
{
    WITH(estimator_gain, coefficient(65536), ONEBIT_OK);
    WITH(estimator_gain, coefficient(65536.01), ONEBIT_CONFIG_ESTIMATOR_GAIN);
    WITH(estimator_gain, coefficient(1e-6), ONEBIT_OK);
    WITH(estimator_gain, coefficient(131072), ONEBIT_CONFIG_ESTIMATOR_GAIN);
    WITH(estimator_gain, coefficient(65535.99), ONEBIT_OK);
    WITH(control_gain, coefficient(1e9), ONEBIT_OK);
    WITH(control_gain, coefficient(1e-6), ONEBIT_OK);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    /* Bit 31 not set, and fraction bits out of range. */
    const onebit_coefficient wrong[] = {{0, 0},           {0, 62},           {0x7FFFFFFF, 20},
                                        {0x80000000, 63}, {0x80000000, 255}, {0xFFFFFFFF, 128}};
#else
    const onebit_coefficient wrong[] = {0, -1, (onebit_real)NAN, (onebit_real)INFINITY,
                                        (onebit_real)-INFINITY};
#endif
    for (unsigned w = 0; w < sizeof wrong / sizeof *wrong; ++w) {
        WITH(estimator_gain, wrong[w], ONEBIT_CONFIG_ESTIMATOR_GAIN);
        WITH(control_gain, wrong[w], ONEBIT_CONFIG_CONTROL_GAIN);
    }
}

static void test_check_start_and_format(void)
{
    WITH(start, 0, ONEBIT_CONFIG_START);
    WITH(start, UINT32_MAX, ONEBIT_CONFIG_START);
    WITH(format.mode, 2, ONEBIT_CONFIG_FORMAT);
    WITH(format.encoding, 3, ONEBIT_CONFIG_FORMAT);
    WITH(format.base, 0x7F, ONEBIT_CONFIG_FORMAT);
    WITH(format.base, 0x7F0, ONEBIT_CONFIG_FORMAT);
    WITH(format.sync, 0, ONEBIT_CONFIG_FORMAT);
    WITH(format.sync, 0x101, ONEBIT_CONFIG_FORMAT);
    WITH(first_link, 0, ONEBIT_OK); /* in broadcast the agent's number is its link's */
    config.format.mode = ONEBIT_MODE_LINK;
    check_config(ONEBIT_CONFIG_FIRST_LINK);
}

/* An agent that could not send, or not hear, is refused; without frames any number will do. */
static void test_check_numbers_against_the_format(void)
{
    static const struct {
        onebit_format format;
        uint32_t limit;
    } rows[] = {{ONEBIT_FORMAT_BROADCAST_PAYLOAD, 1775},
                {ONEBIT_FORMAT_BROADCAST_IDENTIFIER, 503},
                {ONEBIT_FORMAT_LINK_PAYLOAD, 8191},
                {ONEBIT_FORMAT_LINK_IDENTIFIER, 8191}};
    for (unsigned k = 0; k < sizeof rows / sizeof *rows; ++k) {
        setUp();
        config.format = rows[k].format;
        config.agent = rows[k].limit;
        check_config(ONEBIT_OK);
        config.agent = rows[k].limit + 1u;
        check_config(ONEBIT_CONFIG_AGENT);
        config.format.encoding = ONEBIT_ENCODING_NONE;
        check_config(ONEBIT_OK);
        setUp();
        config.format = rows[k].format;
        neighbours[2] = rows[k].limit;
        check_config(ONEBIT_OK);
        neighbours[2] = rows[k].limit + 1u;
        check_config(ONEBIT_CONFIG_NEIGHBOURS);
        config.format.encoding = ONEBIT_ENCODING_NONE;
        check_config(ONEBIT_OK);
        neighbours[2] = UINT32_MAX;
        check_config(ONEBIT_OK);
        config.format.mode = 2;
        check_config(ONEBIT_CONFIG_FORMAT);
    }
}

/* The lists by neighbour, each entry of each; behind their ends anything may stand. */
static void test_check_thresholds_by_neighbour(void)
{
    for (unsigned list = 0; list < 2; ++list) {
        onebit_real thresholds[NEIGHBOURS + 1] = {number(3.5), number(-3.5), 0, number(9)};
        setUp();
        const onebit_real **field = list == 0 ? &config.heard_thresholds : &config.sent_thresholds;
        *field = thresholds;
        check_config(ONEBIT_OK);
        for (unsigned k = 0; k < NEIGHBOURS; ++k) {
            onebit_real sound = thresholds[k];
            thresholds[k] = number(4);
            check_config(ONEBIT_CONFIG_THRESHOLD);
            thresholds[k] = number(-3.6);
            check_config(ONEBIT_CONFIG_BOUND);
            thresholds[k] = sound;
        }
    }
}

#if ONEBIT_ARITHMETIC == ONEBIT_Q31

static void test_check_fraction_bits(void)
{
    for (int bits = -128; bits <= 127; ++bits) {
        int8_t value = (int8_t)bits;
        onebit_status of_gains = bits >= 0 && bits <= 46 ? ONEBIT_OK : ONEBIT_CONFIG_FRACTION_BITS;
        onebit_status of_signals =
            bits >= 0 && bits <= 31 ? ONEBIT_OK : ONEBIT_CONFIG_FRACTION_BITS;
        WITH(fraction_bits.stabilizing, value, of_gains);
        WITH(fraction_bits.compression, value, of_gains);
        WITH(fraction_bits.state, value, of_signals);
        WITH(fraction_bits.control, value, of_signals);
    }
}

#endif

static void test_start(void)
{
    const onebit_real estimates[NEIGHBOURS] = {number(0.5), number(-0.5), number(0.125)};
    memset(&memory, 0xA5, sizeof memory);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, estimates));
    TEST_ASSERT_TRUE(memory.agent.estimates == memory.estimates);
    TEST_ASSERT_EQUAL_UINT32(START + 1u, memory.agent.clock);
    TEST_ASSERT_EQUAL_HEX32(0, memory.agent.heard);
    TEST_ASSERT_DOUBLE_WITHIN(3.7 / (START + 1) * 2 * GAIN_ERROR, 3.7 / (START + 1),
                              gain_value(memory.agent.gain));
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        TEST_ASSERT_EQUAL_UINT16(0, memory.agent.refused[k]);
    }
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        TEST_ASSERT_TRUE(memory.estimates[k].value == estimates[k] &&
                         memory.estimates[k].carry == 0);
    }
    /* Estimates beyond neighbour_count are not the agent's. */
    TEST_ASSERT_EACH_EQUAL_HEX8(0xA5, &memory.estimates[NEIGHBOURS],
                                (ONEBIT_NEIGHBOURS_MAX - NEIGHBOURS) * sizeof(onebit_estimate));

    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        TEST_ASSERT_TRUE(memory.estimates[k].value == 0 && memory.estimates[k].carry == 0);
    }
}

static void test_start_refuses(void)
{
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_start(NULL, &memory.agent, memory.estimates, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_start(&config, NULL, memory.estimates, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_start(&config, &memory.agent, NULL, NULL));
    const onebit_real wrong[] = {
        number(0.5000001),
        number(-0.5000001),
        number(7),
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
        INT32_MIN,
#else
        (onebit_real)NAN,
        (onebit_real)INFINITY,
#endif
    };
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        for (unsigned w = 0; w < sizeof wrong / sizeof *wrong; ++w) {
            onebit_real estimates[NEIGHBOURS] = {0, 0, 0};
            estimates[k] = wrong[w];
            TEST_ASSERT_EQUAL(ONEBIT_ESTIMATE,
                              onebit_start(&config, &memory.agent, memory.estimates, estimates));
        }
    }
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

/* ---- onebit_encode ---- */

static double row_times(const onebit_real *row, const onebit_real *x)
{
    long double sum = 0;
    for (unsigned k = 0; k < config.state_count; ++k) {
        sum += (long double)value_in(row[k], ROW_BITS) * (long double)value_in(x[k], STATE_BITS);
    }
    return (double)sum;
}

/* Rounding of a dot product: half a unit of the result, or one rounding a product and a sum. */
static double row_error(const onebit_real *row, const onebit_real *x, int result_bits)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    (void)row;
    (void)x;
    return ldexp(0.5, -result_bits);
#else
    (void)result_bits;
    double size = 0;
    for (unsigned k = 0; k < config.state_count; ++k) {
        size += fabs(value_of(row[k]) * value_of(x[k]));
    }
    return (STATES + 0.01) * ROUNDING * size;
#endif
}

static bool encode(const onebit_real *x, uint32_t word)
{
    bool bit = false;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_encode(&config, x, 0, word, &bit));
    return bit;
}

/* How many of the 2^31 upper parts of a word give a 1: they are the smallest ones. */
static uint32_t ones(const onebit_real *x)
{
    uint32_t low = 0;
    uint32_t high = 0x80000000u;
    while (low < high) {
        uint32_t middle = low + (high - low) / 2u;
        bool bit = encode(x, middle << 1);
        TEST_ASSERT_EQUAL(bit, encode(x, middle << 1 | 1u)); /* the lowest bit does not count */
        if (bit) {
            low = middle + 1u;
        } else {
            high = middle;
        }
    }
    return low;
}

/*
 * The probability of a 1 is F((c - K2 x)/sigma): exactly, by the number of words that give a 1; and
 * on 1e5 consecutive words of the library's generator within 5 standard deviations of the binomial,
 * which a sound generator misses once in 1.7 million times (41 times tried here: once in 42,000;
 * the seeds are fixed).
 */
static void test_encode_probability(void)
{
    for (int place = -20; place <= 20; ++place) {
        onebit_real x[STATES];
        fill_states(x, 0.21 * place, 0.4, -0.037 * place);
        double z = row_times(compression, x);
        double u = value_of(config.threshold) - z;
        double probability = normal_distribution(u);
        /* F's density is 0.399 at most; the last term is for the words' grain. */
        double tolerance = DISTRIBUTION_ERROR + 0.399 * row_error(compression, x, 27) + 0x1p-31;
#if ONEBIT_ARITHMETIC != ONEBIT_Q31
        tolerance += 0.399 * ROUNDING * fabs(u); /* c - z */
#endif
        REQUIRE(fabs(ones(x) * 0x1p-31 - probability) <= tolerance,
                "P(1) at z = %g: %.9g, not %.9g", z, ones(x) * 0x1p-31, probability);

        unsigned count = 0;
        const unsigned words = 100000;
        for (uint32_t t = 1; t <= words; ++t) {
            count += encode(x, onebit_random_word(7, (uint32_t)(place + 20), OWN, t));
        }
        double deviation = sqrt(probability * (1 - probability) / words);
        REQUIRE(fabs((double)count / words - probability) <= 5 * deviation + 1.0 / words,
                "%u ones of %u at z = %g", count, words, z);
    }
}

/* A larger K2 x never turns a 0 into a 1. */
static void test_encode_is_monotone(void)
{
    uint64_t seed = 31;
    for (unsigned trial = 0; trial < 2000; ++trial) {
        onebit_real x[STATES];
        double first = random_between(&seed, -8, 8);
        fill_states(x, first, 0, 0);
        uint32_t before = ones(x);
        fill_states(x, first + random_unit(&seed) * random_unit(&seed), 0, 0);
        TEST_ASSERT_TRUE(ones(x) <= before);
    }
}

static void test_encode_extreme_words(void)
{
    for (int place = -3; place <= 3; ++place) {
        onebit_real x[STATES];
        fill_states(x, 0, 0, place); /* |c - K2 x| <= 3.5 */
        TEST_ASSERT_TRUE(encode(x, 0));
        TEST_ASSERT_TRUE(encode(x, 1));
        TEST_ASSERT_FALSE(encode(x, UINT32_MAX));
        TEST_ASSERT_FALSE(encode(x, UINT32_MAX - 1u));
    }
}

/* States at the ends of their range: nothing overflows, and the bit is the sure one. */
static void test_encode_extreme_states(void)
{
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    const onebit_real large = INT32_MAX;
    const onebit_real small = INT32_MIN;
#else
    const onebit_real large = (onebit_real)1e37;
    const onebit_real small = (onebit_real)-1e37;
#endif
    onebit_real x[STATES] = {large, small, large};
    TEST_ASSERT_FALSE(encode(x, 0x00010000u));
    TEST_ASSERT_TRUE(ones(x) <= 617); /* 2.9e-7 of 2^31 */
    x[0] = small;
    x[1] = large;
    x[2] = small;
    TEST_ASSERT_TRUE(encode(x, 0xFFFF0000u));
    TEST_ASSERT_TRUE(ones(x) >= 0x80000000u - 617u);
}

static void test_encode_refuses(void)
{
    onebit_real x[STATES] = {0, 0, 0};
    bool bit = true;
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_encode(NULL, x, 0, UINT32_MAX, &bit));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_encode(&config, NULL, 0, UINT32_MAX, &bit));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_encode(&config, x, 0, UINT32_MAX, NULL));
    TEST_ASSERT_TRUE(bit);
#if ONEBIT_ARITHMETIC != ONEBIT_Q31
    const onebit_real wrong[] = {(onebit_real)NAN, (onebit_real)INFINITY, (onebit_real)-INFINITY};
    for (unsigned k = 0; k < STATES; ++k) {
        for (unsigned w = 0; w < sizeof wrong / sizeof *wrong; ++w) {
            x[k] = wrong[w];
            TEST_ASSERT_EQUAL(ONEBIT_STATE, onebit_encode(&config, x, 0, UINT32_MAX, &bit));
            TEST_ASSERT_TRUE(bit);
            /* An infinite state shows even where the row is zero. */
            onebit_real entry = compression[k];
            compression[k] = 0;
            TEST_ASSERT_EQUAL(ONEBIT_STATE, onebit_encode(&config, x, 0, UINT32_MAX, &bit));
            compression[k] = entry;
            x[k] = 0;
        }
    }
#endif
}

/* ---- onebit_receive ---- */

/* The frame is refused with `expected`; one counter moves by one, and nothing else. */
static void check_refused(const onebit_frame *frame, onebit_status expected)
{
    struct memory wanted;
    memcpy(&wanted, &memory, sizeof memory);
    TEST_ASSERT_EQUAL(expected,
                      onebit_receive(&config, &memory.agent, frame, ONEBIT_ALL_LINKED, NULL));
    ++wanted.agent.refused[expected - ONEBIT_REFUSED_FIRST];
    TEST_ASSERT_EQUAL_MEMORY(&wanted, &memory, sizeof memory);
}

/* One link moves, as the paper's equation says; the mask gains one bit; the rest stays. */
static void test_receive_updates_one_link(void)
{
    static const uint32_t senders[] = {5, 9, 2};
    static const unsigned places[] = {1, 2, 0};
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        bool bit = k % 2u != 0;
        struct memory wanted;
        memcpy(&wanted, &memory, sizeof memory);
        receive(senders[k], bit);

        double innovation = normal_distribution(-0.5) - (bit ? 1 : 0);
        double gain = coefficient_value(config.estimator_gain) / (START + 1);
        /* As in test_estimator.c, from an estimate of 0. */
        double tolerance =
            gain * (DISTRIBUTION_ERROR + (GAIN_ERROR + 3 * ROUNDING) * fabs(innovation)) + 0x1p-52;
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
        tolerance += 0x1p-27;
#else
        tolerance += ROUNDING * gain * fabs(innovation);
#endif
        TEST_ASSERT_DOUBLE_WITHIN(tolerance, gain * innovation,
                                  value_of(memory.estimates[places[k]].value));
        wanted.estimates[places[k]] = memory.estimates[places[k]];
        wanted.agent.heard |= (uint32_t)1 << places[k];
        TEST_ASSERT_EQUAL_MEMORY(&wanted, &memory, sizeof memory);
    }
    TEST_ASSERT_EQUAL_HEX32(7, memory.agent.heard);
}

static void test_receive_unknown(void)
{
    static const uint32_t strangers[] = {1, 3, OWN, 6, 8, 10, 1775};
    for (unsigned k = 0; k < sizeof strangers / sizeof *strangers; ++k) {
        onebit_frame frame = frame_from(strangers[k], true);
        check_refused(&frame, ONEBIT_REFUSED_UNKNOWN);
    }
    TEST_ASSERT_EQUAL_UINT16(7,
                             memory.agent.refused[ONEBIT_REFUSED_UNKNOWN - ONEBIT_REFUSED_FIRST]);
    /* Other protocols' frames have a counter of their own. */
    onebit_frame foreign;
    onebit_frame_sync(&config.format, memory.agent.clock, &foreign);
    check_refused(&foreign, ONEBIT_REFUSED_FOREIGN);
    foreign.identifier = 0x7F0;
    check_refused(&foreign, ONEBIT_REFUSED_FOREIGN);
    TEST_ASSERT_EQUAL_UINT16(2, memory.agent.refused[0]);
}

static void test_receive_wrong_kinds(void)
{
    onebit_frame frame = frame_from(5, true);
    frame.flags = ONEBIT_FRAME_REMOTE;
    check_refused(&frame, ONEBIT_REFUSED_REMOTE);
    frame.flags = ONEBIT_FRAME_ERROR;
    check_refused(&frame, ONEBIT_REFUSED_ERROR_FRAME);
    frame.flags = ONEBIT_FRAME_FLEXIBLE;
    check_refused(&frame, ONEBIT_REFUSED_FLEXIBLE);
    frame.flags = ONEBIT_FRAME_EXTENDED;
    check_refused(&frame, ONEBIT_REFUSED_FOREIGN);
    frame.flags = 0;
    frame.length = 0;
    check_refused(&frame, ONEBIT_REFUSED_LENGTH);
    frame.length = 2;
    check_refused(&frame, ONEBIT_REFUSED_LENGTH);
    /* Each has its own counter, in the order of the codes. */
    static const uint16_t counters[ONEBIT_REFUSALS] = {1, 2, 1, 1, 1};
    TEST_ASSERT_EQUAL_UINT16_ARRAY(counters, memory.agent.refused, ONEBIT_REFUSALS);
}

/* Second bit of a sender in a step: the first wins, whatever the second says. */
static void test_receive_repeated(void)
{
    receive(5, true);
    onebit_frame same = frame_from(5, true);
    check_refused(&same, ONEBIT_REFUSED_REPEATED);
    onebit_frame other = frame_from(5, false);
    check_refused(&other, ONEBIT_REFUSED_REPEATED);
    receive(9, false); /* another sender is not concerned */
    /* In the next step it is heard again. */
    onebit_real x[STATES] = {0, 0, 0};
    onebit_real u;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    receive(5, false);
}

/* e = (s - t) mod 128: 1..63 early, 64..127 stale, at clocks around the residue's turn. */
static void test_receive_every_residue(void)
{
    static const uint32_t starts[] = {10, 125, 126, 127, 1000000, UINT32_MAX - 1u};
    for (unsigned s = 0; s < sizeof starts / sizeof *starts; ++s) {
        setUp();
        config.start = starts[s];
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
        for (unsigned error = 1; error < 128; ++error) {
            onebit_message message = message_from(5, true);
            message.step = (uint8_t)((message.step + error) % 128u);
            onebit_frame frame;
            TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&config.format, &message, &frame));
            check_refused(&frame, error <= 63 ? ONEBIT_REFUSED_EARLY : ONEBIT_REFUSED_STALE);
        }
        TEST_ASSERT_EQUAL_UINT16(64,
                                 memory.agent.refused[ONEBIT_REFUSED_STALE - ONEBIT_REFUSED_FIRST]);
        TEST_ASSERT_EQUAL_UINT16(63,
                                 memory.agent.refused[ONEBIT_REFUSED_EARLY - ONEBIT_REFUSED_FIRST]);
        receive(5, true);
    }
}

/* A wrong step number is told before a repetition: the frame is of another step. */
static void test_receive_stale_after_heard(void)
{
    receive(5, true);
    onebit_message message = message_from(5, true);
    message.step = (uint8_t)(message.step - 1);
    onebit_frame frame;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&config.format, &message, &frame));
    check_refused(&frame, ONEBIT_REFUSED_STALE);
}

static void test_identifier_form_has_no_step(void)
{
    config.format.encoding = ONEBIT_ENCODING_IDENTIFIER;
    config.format.base = ONEBIT_IDENTIFIER_BASE;
    onebit_message message = message_from(5, true);
    message.step = (uint8_t)(message.step + 77);
    onebit_frame frame;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&config.format, &message, &frame));
    TEST_ASSERT_EQUAL(ONEBIT_OK,
                      onebit_receive(&config, &memory.agent, &frame, ONEBIT_ALL_LINKED, NULL));
    TEST_ASSERT_EQUAL_HEX32(2, memory.agent.heard);
    TEST_ASSERT_TRUE(memory.estimates[1].value < 0);
    check_refused(&frame, ONEBIT_REFUSED_REPEATED);
    frame.identifier = 0x400 + 2 * 9; /* agent 9, bit 0 */
    TEST_ASSERT_EQUAL(ONEBIT_OK,
                      onebit_receive(&config, &memory.agent, &frame, ONEBIT_ALL_LINKED, NULL));
    TEST_ASSERT_TRUE(memory.estimates[2].value > 0);
}

static void test_link_mode(void)
{
    for (unsigned encoding = 0; encoding < 2; ++encoding) {
        setUp();
        config.format.mode = ONEBIT_MODE_LINK;
        config.format.encoding = (uint8_t)encoding;
        static const uint32_t others[] = {1, 3, 5, 8191};
        for (unsigned k = 0; k < sizeof others / sizeof *others; ++k) {
            onebit_message message = message_from(5, true);
            message.receiver = others[k];
            onebit_frame frame;
            TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&config.format, &message, &frame));
            check_refused(&frame, ONEBIT_REFUSED_UNKNOWN);
        }
        receive(5, true);
        TEST_ASSERT_EQUAL_HEX32(2, memory.agent.heard);
        onebit_frame frame = frame_from(6, true);
        check_refused(&frame, ONEBIT_REFUSED_UNKNOWN);
    }
}

static void test_counters_stop_at_65535(void)
{
    receive(5, true);
    onebit_frame frames[ONEBIT_REFUSALS];
    onebit_status codes[ONEBIT_REFUSALS];
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        codes[k] = (onebit_status)(ONEBIT_REFUSED_FIRST + k);
        frames[k] = frame_from(codes[k] == ONEBIT_REFUSED_UNKNOWN    ? 6
                               : codes[k] == ONEBIT_REFUSED_UNLINKED ? 9
                                                                     : 5,
                               true);
        switch (codes[k]) {
        case ONEBIT_REFUSED_FOREIGN:
            frames[k].identifier = 0x081;
            break;
        case ONEBIT_REFUSED_LENGTH:
            frames[k].length = 8;
            break;
        case ONEBIT_REFUSED_REMOTE:
            frames[k].flags = ONEBIT_FRAME_REMOTE;
            break;
        case ONEBIT_REFUSED_ERROR_FRAME:
            frames[k].flags = ONEBIT_FRAME_ERROR;
            break;
        case ONEBIT_REFUSED_FLEXIBLE:
            frames[k].flags = ONEBIT_FRAME_FLEXIBLE;
            break;
        case ONEBIT_REFUSED_STALE:
            frames[k].data[0] = (uint8_t)(frames[k].data[0] - 2u);
            break;
        case ONEBIT_REFUSED_EARLY:
            frames[k].data[0] = (uint8_t)(frames[k].data[0] + 2u);
            break;
        default:
            break;
        }
    }
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        for (uint32_t count = 1; count <= 65540; ++count) {
            /* All but neighbour 9 are linked. */
            REQUIRE(onebit_receive(&config, &memory.agent, &frames[k], ~4u, NULL) == codes[k],
                    "code %u", k);
            REQUIRE(memory.agent.refused[k] == (count < 65535 ? count : 65535), "counter %u: %u", k,
                    memory.agent.refused[k]);
        }
    }
}

static void test_receive_message(void)
{
    onebit_message message = message_from(5, true);
    message.receiver = 77; /* not looked at in broadcast */
    TEST_ASSERT_EQUAL(ONEBIT_OK,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    TEST_ASSERT_EQUAL(ONEBIT_REFUSED_REPEATED,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    message.sender = UINT32_MAX;
    TEST_ASSERT_EQUAL(ONEBIT_REFUSED_UNKNOWN,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    message.sender = 0;
    TEST_ASSERT_EQUAL(ONEBIT_REFUSED_UNKNOWN,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    message = message_from(9, true);
    ++message.step;
    TEST_ASSERT_EQUAL(ONEBIT_REFUSED_EARLY,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    message.has_step = false;
    TEST_ASSERT_EQUAL(ONEBIT_OK,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    config.format.mode = ONEBIT_MODE_LINK;
    message = message_from(2, false);
    message.receiver = 5;
    TEST_ASSERT_EQUAL(ONEBIT_REFUSED_UNKNOWN,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    message.receiver = OWN;
    TEST_ASSERT_EQUAL(ONEBIT_OK,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    static const uint16_t counters[ONEBIT_REFUSALS] = {
        [ONEBIT_REFUSED_UNKNOWN - ONEBIT_REFUSED_FIRST] = 3,
        [ONEBIT_REFUSED_REPEATED - ONEBIT_REFUSED_FIRST] = 1,
        [ONEBIT_REFUSED_EARLY - ONEBIT_REFUSED_FIRST] = 1};
    TEST_ASSERT_EQUAL_UINT16_ARRAY(counters, memory.agent.refused, ONEBIT_REFUSALS);
}

/* Every mask of three neighbours, in receive and in control; the masks' other bits mean nothing. */
static void test_linked(void)
{
    for (uint32_t mask = 0; mask < 64; ++mask) {
        uint32_t linked = (mask % 8u) | (mask < 8 ? 0 : 0xFFFFFFF8u);
        setUp();
        for (unsigned k = 0; k < NEIGHBOURS; ++k) {
            onebit_frame frame = frame_from(neighbours[k], true);
            onebit_status expected = linked >> k & 1u ? ONEBIT_OK : ONEBIT_REFUSED_UNLINKED;
            TEST_ASSERT_EQUAL(expected,
                              onebit_receive(&config, &memory.agent, &frame, linked, NULL));
        }
        TEST_ASSERT_EQUAL_HEX32(linked & 7u, memory.agent.heard);
        /* Of those heard the sum takes those linked at the end: the same as having heard only them.
         */
        uint32_t summed = mask >> 3;
        struct memory twin = memory;
        twin.agent.estimates = twin.estimates;
        twin.agent.heard &= summed;
        onebit_real x[STATES];
        onebit_real u = 0;
        onebit_real expected_u = 0;
        fill_states(x, 0.3, -0.7, 0.11);
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config, &memory.agent, x, summed, &u));
        TEST_ASSERT_EQUAL(ONEBIT_OK,
                          onebit_control(&config, &twin.agent, x, ONEBIT_ALL_LINKED, &expected_u));
        TEST_ASSERT_TRUE(u == expected_u);
    }
}

/* What a frame says comes back wherever it is a message, taken or not. */
static void test_receive_gives_the_message(void)
{
    onebit_message untouched;
    memset(&untouched, 0xA5, sizeof untouched);
    static const uint32_t senders[] = {5, 5, 9, 6};
    static const onebit_status codes[] = {ONEBIT_OK, ONEBIT_REFUSED_REPEATED,
                                          ONEBIT_REFUSED_UNLINKED, ONEBIT_REFUSED_UNKNOWN};
    for (unsigned k = 0; k < sizeof senders / sizeof *senders; ++k) {
        onebit_frame frame = frame_from(senders[k], true);
        onebit_message message;
        memcpy(&message, &untouched, sizeof message);
        TEST_ASSERT_EQUAL(codes[k], onebit_receive(&config, &memory.agent, &frame, ~4u, &message));
        TEST_ASSERT_EQUAL_UINT32(senders[k], message.sender);
        TEST_ASSERT_EQUAL_UINT8(memory.agent.clock % 128u, message.step);
        TEST_ASSERT_TRUE(message.has_step && message.bit && message.receiver == 0);
    }
    onebit_frame frame = frame_from(5, true);
    frame.length = 0;
    onebit_message message;
    memcpy(&message, &untouched, sizeof message);
    TEST_ASSERT_EQUAL(ONEBIT_REFUSED_LENGTH,
                      onebit_receive(&config, &memory.agent, &frame, ONEBIT_ALL_LINKED, &message));
    TEST_ASSERT_EQUAL_MEMORY(&untouched, &message, sizeof message);
}

/* ---- onebit_send ---- */

/* One call is word, bit, number, step and frame; link mode has a message for each neighbour. */
static void test_send(void)
{
    onebit_real x[STATES];
    fill_states(x, -0.5, 0.25, 0.125);
    config.seed = 7;
    config.run = 3;
    config.first_link = 100;
    for (unsigned form = 0; form < 4; ++form) {
        static const onebit_format formats[] = {
            ONEBIT_FORMAT_BROADCAST_PAYLOAD, ONEBIT_FORMAT_BROADCAST_IDENTIFIER,
            ONEBIT_FORMAT_LINK_PAYLOAD, ONEBIT_FORMAT_LINK_IDENTIFIER};
        config.format = formats[form];
        bool link_mode = form >= 2;
        unsigned count = onebit_message_count(&config);
        TEST_ASSERT_EQUAL_UINT(link_mode ? NEIGHBOURS : 1, count);
        for (unsigned trial = 0; trial < 200; ++trial) {
            for (unsigned k = 0; k < count; ++k) {
                uint32_t t = memory.agent.clock;
                uint32_t word = (uint32_t)onebit_threefry(7, 3, link_mode ? 100 + k : OWN, t);
                onebit_message expected = {.sender = OWN,
                                           .receiver = link_mode ? neighbours[k] : 0,
                                           .step = (uint8_t)(t % 128u)};
                TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_encode(&config, x, k, word, &expected.bit));
                onebit_frame wanted;
                onebit_frame frame;
                memset(&wanted, 0, sizeof wanted); /* padding, which nobody writes */
                memset(&frame, 0, sizeof frame);
                TEST_ASSERT_EQUAL(ONEBIT_OK,
                                  onebit_frame_encode(&config.format, &expected, &wanted));
                TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_send(&config, &memory.agent, x, k, &frame));
                TEST_ASSERT_EQUAL_MEMORY(&wanted, &frame, sizeof frame);
                onebit_message message;
                TEST_ASSERT_EQUAL(ONEBIT_OK,
                                  onebit_send_message(&config, &memory.agent, x, k, &message));
                TEST_ASSERT_TRUE(message.sender == OWN && message.bit == expected.bit &&
                                 message.receiver == expected.receiver &&
                                 message.step == expected.step && message.has_step);
            }
            TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_advance(&config, &memory.agent, 1));
        }
    }
}

static void test_send_refuses(void)
{
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    onebit_real x[STATES] = {0, 0, 0};
    onebit_frame frame;
    onebit_frame untouched;
    onebit_message message;
    memset(&frame, 0xA5, sizeof frame);
    memcpy(&untouched, &frame, sizeof frame);
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_send(NULL, &memory.agent, x, 0, &frame));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_send(&config, NULL, x, 0, &frame));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_send(&config, &memory.agent, NULL, 0, &frame));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_send(&config, &memory.agent, x, 0, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_send_message(&config, &memory.agent, x, 0, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_MESSAGE, onebit_send(&config, &memory.agent, x, 1, &frame));
    config.format.mode = ONEBIT_MODE_LINK;
    TEST_ASSERT_EQUAL(ONEBIT_MESSAGE, onebit_send(&config, &memory.agent, x, NEIGHBOURS, &frame));
    config.format.encoding = ONEBIT_ENCODING_NONE;
    TEST_ASSERT_EQUAL(ONEBIT_CONFIG_FORMAT, onebit_send(&config, &memory.agent, x, 0, &frame));
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_send_message(&config, &memory.agent, x, 0, &message));
#if ONEBIT_ARITHMETIC != ONEBIT_Q31
    x[1] = (onebit_real)NAN;
    TEST_ASSERT_EQUAL(ONEBIT_STATE, onebit_send(&config, &memory.agent, x, 0, &frame));
#endif
    TEST_ASSERT_EQUAL_MEMORY(&untouched, &frame, sizeof frame);
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

/* c_ij: what a bit is compared with where it is made, and F's argument where it is heard. */
static void test_thresholds_by_neighbour(void)
{
    const onebit_real heard[NEIGHBOURS] = {number(-1.5), number(0.25), number(1)};
    const onebit_real sent[NEIGHBOURS] = {number(2), number(0), number(-2)};
    onebit_real x[STATES] = {0, 0, 0};
    config.format = (onebit_format)ONEBIT_FORMAT_LINK_PAYLOAD;
    config.heard_thresholds = heard;
    config.sent_thresholds = sent;
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        /* z = 0: the bit is 1 for words below F(c) 2^32, give or take the CDF's error. */
        static const double places[] = {2, 0, -2};
        double F = normal_distribution(places[k]) * 4294967296.0;
        bool bit = false;
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_encode(&config, x, k, (uint32_t)(F - 4096), &bit));
        TEST_ASSERT_TRUE(bit);
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_encode(&config, x, k, (uint32_t)(F + 4096), &bit));
        TEST_ASSERT_FALSE(bit);
        /* An estimator whose own threshold is that of neighbour k moves as neighbour k's. */
        onebit_config scalar = config;
        struct memory twin;
        scalar.heard_thresholds = NULL;
        scalar.threshold = heard[k];
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&scalar, &twin.agent, twin.estimates, NULL));
        onebit_message message = message_from(neighbours[k], true);
        TEST_ASSERT_EQUAL(
            ONEBIT_OK, onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
        TEST_ASSERT_EQUAL(
            ONEBIT_OK, onebit_receive_message(&scalar, &twin.agent, &message, ONEBIT_ALL_LINKED));
        TEST_ASSERT_TRUE(memory.estimates[k].value == twin.estimates[k].value &&
                         memory.estimates[k].value != 0);
    }
    /* In broadcast the one bit is compared with the threshold, whatever the list says. */
    config.format = (onebit_format)ONEBIT_FORMAT_BROADCAST_PAYLOAD;
    double F = normal_distribution(-0.5) * 4294967296.0;
    bool bit = false;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_encode(&config, x, 0, (uint32_t)(F - 4096), &bit));
    TEST_ASSERT_TRUE(bit);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_encode(&config, x, 0, (uint32_t)(F + 4096), &bit));
    TEST_ASSERT_FALSE(bit);
}

/* ---- an agent that was not started, memory that was written upon ---- */

static void test_not_started(void)
{
    struct memory before;
    memset(&memory, 0, sizeof memory);
    memcpy(&before, &memory, sizeof memory);
    onebit_real x[STATES] = {0, 0, 0};
    onebit_real u = number(0.25);
    onebit_message message = message_from(5, true);
    /* In identifier form no step number keeps the frame out. */
    config.format = (onebit_format)ONEBIT_FORMAT_BROADCAST_IDENTIFIER;
    onebit_frame frame = {0x40A, 0, 0, {0}};
    TEST_ASSERT_EQUAL(ONEBIT_NOT_STARTED,
                      onebit_receive(&config, &memory.agent, &frame, ONEBIT_ALL_LINKED, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NOT_STARTED,
                      onebit_receive_message(&config, &memory.agent, &message, ONEBIT_ALL_LINKED));
    TEST_ASSERT_EQUAL(ONEBIT_NOT_STARTED, onebit_send(&config, &memory.agent, x, 0, &frame));
    TEST_ASSERT_EQUAL(ONEBIT_NOT_STARTED,
                      onebit_send_message(&config, &memory.agent, x, 0, &message));
    TEST_ASSERT_EQUAL(ONEBIT_NOT_STARTED,
                      onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    TEST_ASSERT_EQUAL(ONEBIT_NOT_STARTED, onebit_advance(&config, &memory.agent, 0));
    TEST_ASSERT_FALSE(onebit_valid(&config, &memory.agent));
    TEST_ASSERT_TRUE(u == number(0.25));
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

/* One bit of `heard` that no neighbour has: the sum does not walk beyond the estimates. */
static void test_control_stays_within_the_estimates(void)
{
    onebit_real x[STATES];
    onebit_real u = 0;
    onebit_real spoilt = 0;
    fill_states(x, 0.3, -0.7, 0.11);
    receive(5, true);
    struct memory twin = memory;
    twin.agent.estimates = twin.estimates;
    twin.agent.heard |= 0xFFFFFFF8u;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    TEST_ASSERT_EQUAL(ONEBIT_OK,
                      onebit_control(&config, &twin.agent, x, ONEBIT_ALL_LINKED, &spoilt));
    TEST_ASSERT_TRUE(u == spoilt);
}

static void test_valid(void)
{
    onebit_real x[STATES];
    onebit_real u;
    fill_states(x, 0.3, -0.7, 0.11);
    TEST_ASSERT_FALSE(onebit_valid(NULL, &memory.agent));
    TEST_ASSERT_FALSE(onebit_valid(&config, NULL));
    config.start = UINT32_MAX - 20u; /* over the clock's end */
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    for (unsigned step = 0; step < 100; ++step) {
        TEST_ASSERT_TRUE(onebit_valid(&config, &memory.agent));
        receive(5, step % 3u == 0);
        TEST_ASSERT_TRUE(onebit_valid(&config, &memory.agent));
        TEST_ASSERT_EQUAL(ONEBIT_OK,
                          onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    }
    /* Each invariant, one after the other. */
    setUp();
    memory.agent.heard = 8;
    TEST_ASSERT_FALSE(onebit_valid(&config, &memory.agent));
    setUp();
    memory.agent.clock = START;
    TEST_ASSERT_FALSE(onebit_valid(&config, &memory.agent));
    setUp();
    memory.agent.clock += 100; /* the gain is another's */
    TEST_ASSERT_FALSE(onebit_valid(&config, &memory.agent));
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        setUp();
        memory.estimates[k].value = number(0.5000001);
        TEST_ASSERT_FALSE(onebit_valid(&config, &memory.agent));
        memory.estimates[k].value = number(-0.5000001);
        TEST_ASSERT_FALSE(onebit_valid(&config, &memory.agent));
    }
    setUp();
    memory.estimates[NEIGHBOURS].value = number(3); /* not the agent's */
    TEST_ASSERT_TRUE(onebit_valid(&config, &memory.agent));
    for (uint32_t k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        neighbours[k] = OWN + 1u + k;
    }
    config.neighbour_count = ONEBIT_NEIGHBOURS_MAX;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    memory.agent.heard = UINT32_MAX;
    TEST_ASSERT_TRUE(onebit_valid(&config, &memory.agent));
}

static void test_receive_nulls(void)
{
    onebit_message message = message_from(5, true);
    onebit_frame frame = frame_from(5, true);
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    TEST_ASSERT_EQUAL(ONEBIT_NULL,
                      onebit_receive(NULL, &memory.agent, &frame, ONEBIT_ALL_LINKED, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_receive(&config, NULL, &frame, ONEBIT_ALL_LINKED, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NULL,
                      onebit_receive(&config, &memory.agent, NULL, ONEBIT_ALL_LINKED, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NULL,
                      onebit_receive_message(NULL, &memory.agent, &message, ONEBIT_ALL_LINKED));
    TEST_ASSERT_EQUAL(ONEBIT_NULL,
                      onebit_receive_message(&config, NULL, &message, ONEBIT_ALL_LINKED));
    TEST_ASSERT_EQUAL(ONEBIT_NULL,
                      onebit_receive_message(&config, &memory.agent, NULL, ONEBIT_ALL_LINKED));
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

/* The last place of the mask. */
static void test_thirty_two_neighbours(void)
{
    for (uint32_t k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        neighbours[k] = OWN + 1u + 3u * k;
    }
    config.neighbour_count = ONEBIT_NEIGHBOURS_MAX;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    for (uint32_t k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        receive(neighbours[k], k % 3u == 0);
        TEST_ASSERT_EQUAL_HEX32((uint32_t)(((uint64_t)2 << k) - 1u), memory.agent.heard);
    }
    for (uint32_t k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        onebit_frame frame = frame_from(neighbours[k], true);
        check_refused(&frame, ONEBIT_REFUSED_REPEATED);
        frame = frame_from(neighbours[k] + 1u, true);
        check_refused(&frame, ONEBIT_REFUSED_UNKNOWN);
        TEST_ASSERT_TRUE(k % 3u == 0 ? memory.estimates[k].value < 0
                                     : memory.estimates[k].value > 0);
    }
}

/* ---- onebit_control ---- */

/*
 * u = K1 x + gamma/(t+1) sum over heard (zhat - K2 x), with the roundings that are stated: each dot
 * product, the gain, the consensus term; in floating point each difference and sum as well.
 */
static void check_control(const onebit_real *x, uint32_t next_clock)
{
    double z = row_times(compression, x);
    double sum = 0;
    double size = 0;
    unsigned heard = 0;
    for (unsigned k = 0; k < config.neighbour_count; ++k) {
        if (memory.agent.heard >> k & 1u) {
            double estimate = value_of(memory.estimates[k].value);
            sum += estimate - z;
            size += fabs(estimate) + fabs(z);
            ++heard;
        }
    }
    uint64_t divisor = memory.agent.wrapped ? (uint64_t)1 << 32 : (uint64_t)memory.agent.clock + 1u;
    double gain = coefficient_value(config.control_gain) / (double)divisor;
    double expected = row_times(stabilizing, x) + gain * sum;
    double tolerance = row_error(stabilizing, x, CONTROL_BITS) +
                       gain * heard * row_error(compression, x, 27) + gain * fabs(sum) * GAIN_ERROR;
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    (void)size;
    tolerance += ldexp(0.5, -CONTROL_BITS);
    tolerance *= 1 + 0x1p-15; /* products of errors */
#else
    tolerance +=
        gain * (heard + 1.0) * ROUNDING * size + ROUNDING * (gain * fabs(sum) + fabs(expected));
    tolerance *= 1 + 0x1p-15;
    tolerance += 0x1p-51 * (size * gain + fabs(expected)); /* this reference's own double */
#endif
    if (divisor > UINT32_MAX) {
        tolerance += gain * fabs(sum) * 0x1p-32; /* the last clock's own number stands for t + 1 */
    }

    struct memory wanted;
    memcpy(&wanted, &memory, sizeof memory);
    onebit_real u;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    REQUIRE(fabs(value_in(u, CONTROL_BITS) - expected) <= tolerance,
            "u = %.12g, not %.12g, at clock %lu with %u heard", value_in(u, CONTROL_BITS), expected,
            (unsigned long)(next_clock - 1u), heard);

    /* The step has ended: nothing heard, the next clock, its gain, and no other change. */
    wanted.agent.heard = 0;
    wanted.agent.wrapped = wanted.agent.wrapped || next_clock == 0;
    wanted.agent.clock = next_clock;
    wanted.agent.gain =
        onebit_gain_at(config.estimator_gain, wanted.agent.wrapped ? UINT32_MAX : next_clock);
    TEST_ASSERT_EQUAL_MEMORY(&wanted, &memory, sizeof memory);
}

static void test_control(void)
{
    uint64_t seed = 33;
    static const uint32_t clocks[] = {11, 12, 100, 99999, 123456789, 0xFFFFFFF0u};
    for (unsigned c = 0; c < sizeof clocks / sizeof *clocks; ++c) {
        for (unsigned trial = 0; trial < 2000; ++trial) {
            config.start = clocks[c] - 1u;
            onebit_real estimates[NEIGHBOURS];
            for (unsigned k = 0; k < NEIGHBOURS; ++k) {
                estimates[k] = number(random_between(&seed, -0.5, 0.5));
            }
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_start(&config, &memory.agent, memory.estimates, estimates));
            for (unsigned k = 0; k < NEIGHBOURS; ++k) {
                if ((trial >> k & 1u) != 0) { /* every set of neighbours */
                    receive(neighbours[k], (random_word(&seed) & 1u) != 0);
                }
            }
            onebit_real x[STATES];
            fill_states(x, random_between(&seed, -3, 3), random_between(&seed, -3, 3),
                        random_between(&seed, -3, 3));
            check_control(x, clocks[c] + 1u);
        }
    }
}

/* By hand: K2 = 1 only, three estimates of 1/2 heard, x = 0: u = gamma/(t+1) 3/2. */
static void test_control_by_hand(void)
{
    config.control_gain = coefficient(8);
    config.estimator_gain = coefficient(0.001);
    config.start = 14; /* t = 15, gamma/(t+1) = 1/2 */
    const onebit_real estimates[NEIGHBOURS] = {config.bound, config.bound, config.bound};
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, estimates));
    for (unsigned k = 0; k < NEIGHBOURS; ++k) {
        receive(neighbours[k], false); /* pushes outward: the estimate stays at the bound */
    }
    onebit_real x[STATES] = {0, 0, 0};
    onebit_real u;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    TEST_ASSERT_TRUE(u == number_in(0.75, CONTROL_BITS));
    /* In the next step none is heard: no consensus term. */
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    TEST_ASSERT_TRUE(u == 0);
}

/* A format without frames: no counter stands for that. */
static void test_receive_without_frames(void)
{
    onebit_frame frame = frame_from(5, true);
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    config.format.encoding = ONEBIT_ENCODING_NONE;
    TEST_ASSERT_EQUAL(ONEBIT_CONFIG_FORMAT,
                      onebit_receive(&config, &memory.agent, &frame, ONEBIT_ALL_LINKED, NULL));
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

static void test_control_refuses(void)
{
    receive(5, true);
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    onebit_real x[STATES] = {0, 0, 0};
    onebit_real u = number(0.25);
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_control(NULL, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_control(&config, NULL, x, ONEBIT_ALL_LINKED, &u));
    TEST_ASSERT_EQUAL(ONEBIT_NULL,
                      onebit_control(&config, &memory.agent, NULL, ONEBIT_ALL_LINKED, &u));
    TEST_ASSERT_EQUAL(ONEBIT_NULL,
                      onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, NULL));
#if ONEBIT_ARITHMETIC != ONEBIT_Q31
    const onebit_real wrong[] = {(onebit_real)NAN, (onebit_real)INFINITY, (onebit_real)-INFINITY};
    for (unsigned k = 0; k < STATES; ++k) {
        for (unsigned w = 0; w < sizeof wrong / sizeof *wrong; ++w) {
            x[k] = wrong[w];
            TEST_ASSERT_EQUAL(ONEBIT_STATE,
                              onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
            x[k] = 0;
        }
    }
    /* Finite states whose products are not, in one row and in the other. */
    const onebit_real large = LARGEST;
    x[1] = large;
    stabilizing[1] = 4;
    TEST_ASSERT_EQUAL(ONEBIT_STATE,
                      onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    stabilizing[1] = 0;
    compression[1] = 4;
    TEST_ASSERT_EQUAL(ONEBIT_STATE,
                      onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
    /* Both products finite, and the control that follows not. */
    x[1] = -large / 8;
    config.control_gain = large;
    TEST_ASSERT_EQUAL(ONEBIT_STATE,
                      onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
#endif
    TEST_ASSERT_TRUE(u == number(0.25));
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

#if ONEBIT_ARITHMETIC == ONEBIT_Q31

/* Formats at their ends with states at theirs: saturated in the right direction, counted, no
 * overflow. */
static void test_control_saturates(void)
{
    static const int8_t row_bits[] = {0, 1, 27, 46};
    static const int8_t signal_bits[] = {0, 1, 26, 31};
    for (unsigned trial = 0; trial < 4u * 4u * 4u * 4u; ++trial) {
        setUp();
        config.fraction_bits.stabilizing = row_bits[trial & 3u];
        config.fraction_bits.compression = row_bits[trial >> 2 & 3u];
        config.fraction_bits.state = signal_bits[trial >> 4 & 3u];
        config.fraction_bits.control = signal_bits[trial >> 6 & 3u];
        config.control_gain = (onebit_coefficient){0xFFFFFFFFu, 0};
        config.start = 1;
        stabilizing[0] = INT32_MAX;
        compression[0] = INT32_MAX;
        stabilizing[1] = stabilizing[2] = compression[1] = compression[2] = 0;
        for (int side = 0; side < 2; ++side) {
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_start(&config, &memory.agent, memory.estimates, NULL));
            onebit_real x[STATES] = {side == 0 ? INT32_MAX : INT32_MIN, 0, 0};
            onebit_real u = 0;
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
            /* Nothing heard: u is the rounded row, in the format of the control. */
            double exact = (double)INT32_MAX * x[0];
            exact = ldexp(exact, config.fraction_bits.control - config.fraction_bits.stabilizing -
                                     config.fraction_bits.state);
            double expected = fmin(fmax(exact, INT32_MIN), INT32_MAX);
            TEST_ASSERT_DOUBLE_WITHIN(0.5, expected, (double)u);
            double z = (double)INT32_MAX * x[0];
            z = ldexp(z, 27 - config.fraction_bits.compression - config.fraction_bits.state);
            z = fmin(fmax(z, INT32_MIN), INT32_MAX);
            bool at_end = rint(expected) >= INT32_MAX || rint(expected) <= INT32_MIN ||
                          rint(z) >= INT32_MAX || rint(z) <= INT32_MIN;
            TEST_ASSERT_EQUAL_UINT16(at_end, memory.agent.saturated);
            /* All heard: the consensus term pulls the other way, with all its weight. */
            for (unsigned k = 0; k < NEIGHBOURS; ++k) {
                receive(neighbours[k], side == 0);
            }
            double sum = 0;
            for (unsigned k = 0; k < NEIGHBOURS; ++k) {
                sum += (double)memory.estimates[k].value - rint(z);
            }
            double gain = coefficient_value(config.control_gain) / (memory.agent.clock + 1u);
            exact = gain * ldexp(sum, config.fraction_bits.control - 27);
            expected = fmin(fmax(exact, INT32_MIN), INT32_MAX);
            stabilizing[0] = 0;
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
            TEST_ASSERT_DOUBLE_WITHIN(fabs(expected) * GAIN_ERROR + 0.5, expected, (double)u);
            stabilizing[0] = INT32_MAX;
        }
    }
}

#endif

/* All six orders of three frames: the same bits in agent, links and control. */
static void test_order_of_receiving_does_not_matter(void)
{
    static const unsigned orders[6][NEIGHBOURS] = {{0, 1, 2}, {0, 2, 1}, {1, 0, 2},
                                                   {1, 2, 0}, {2, 0, 1}, {2, 1, 0}};
    struct memory first;
    onebit_real first_u = 0;
    for (unsigned order = 0; order < 6; ++order) {
        setUp();
        onebit_real x[STATES];
        fill_states(x, 0.3, -0.7, 0.11);
        onebit_real u = 0;
        for (unsigned step = 0; step < 50; ++step) {
            for (unsigned k = 0; k < NEIGHBOURS; ++k) {
                unsigned place = orders[order][k];
                receive(neighbours[place], (step * 7u + place) % 3u == 0);
            }
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_control(&config, &memory.agent, x, ONEBIT_ALL_LINKED, &u));
        }
        if (order == 0) {
            memcpy(&first, &memory, sizeof memory);
            first_u = u;
        }
        TEST_ASSERT_EQUAL_MEMORY(&first, &memory, sizeof memory);
        TEST_ASSERT_TRUE(u == first_u);
    }
}

/* ---- the clock ---- */

static void check_advance(int32_t steps, uint32_t expected, bool wrapped)
{
    struct memory wanted;
    memcpy(&wanted, &memory, sizeof memory);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_advance(&config, &memory.agent, steps));
    TEST_ASSERT_EQUAL_UINT32(expected, memory.agent.clock);
    TEST_ASSERT_EQUAL(wrapped, memory.agent.wrapped);
    wanted.agent.clock = expected;
    wanted.agent.wrapped = wrapped;
    wanted.agent.heard = 0;
    wanted.agent.gain = onebit_gain_at(config.estimator_gain, wrapped ? UINT32_MAX : expected);
    TEST_ASSERT_EQUAL_MEMORY(&wanted, &memory, sizeof memory);
}

static void check_advance_refused(int32_t steps)
{
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    TEST_ASSERT_EQUAL(ONEBIT_CLOCK, onebit_advance(&config, &memory.agent, steps));
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

static void test_advance(void)
{
    receive(5, true);
    check_advance(0, 11, false); /* nothing but forgetting what was heard */
    receive(5, true);
    check_advance(1, 12, false);
    receive(9, true);
    check_advance(100, 112, false);
    check_advance(-101, 11, false);
    check_advance(INT32_MAX, 11u + INT32_MAX, false);
    check_advance(-INT32_MAX, 11, false);
    check_advance_refused(-1);
    check_advance_refused(-12);
    check_advance_refused(INT32_MIN);
    struct memory before;
    memcpy(&before, &memory, sizeof memory);
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_advance(NULL, &memory.agent, 1));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_advance(&config, NULL, 1));
    TEST_ASSERT_EQUAL_MEMORY(&before, &memory, sizeof memory);
}

/*
 * Over the end of 32 bits: residues run on, random words too, gains stay those of 2^32 - 1.
 * Stepping by control, advancing by one and advancing at once reach the same clock.
 */
static void test_clock_wraps(void)
{
    config.start = UINT32_MAX - 200u;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    const uint32_t first = memory.agent.clock;
    uint64_t t = first;
    onebit_real x[STATES];
    fill_states(x, 0.3, -0.7, 0.11);
    double gain = coefficient_value(config.estimator_gain) / 4294967295.0;
    for (int32_t step = 1; step <= 1000; ++step) {
        ++t;
        receive(5, step % 3 == 0);
        check_control(x, (uint32_t)t);
        TEST_ASSERT_EQUAL(t > UINT32_MAX, memory.agent.wrapped);
        if (t >= UINT32_MAX) {
            TEST_ASSERT_TRUE(fabs(gain_value(memory.agent.gain) - gain) <= gain * GAIN_ERROR);
        }
        struct memory stepped;
        memcpy(&stepped, &memory, sizeof memory);
        memory.agent.clock = first;
        memory.agent.wrapped = false;
        check_advance(step, (uint32_t)t, t > UINT32_MAX);
        memcpy(&memory, &stepped, sizeof memory);
        /* And back: a number below the first step's is not below it once t was beyond 2^32. */
        check_advance(-step, first, t > UINT32_MAX);
        if (t > UINT32_MAX) {
            check_advance(-1, first - 1u, true);
        } else {
            check_advance_refused(-1);
        }
        memcpy(&memory, &stepped, sizeof memory);
    }
    /* Once round is enough: whatever comes after it, t is beyond 2^32. */
    memory.agent.wrapped = true;
    memory.agent.clock = 5;
    check_advance(INT32_MAX, 5u + INT32_MAX, true);
    check_advance(INT32_MAX, 3, true);
    check_advance(INT32_MAX, 2u + UINT32_C(0x80000000), true);
    check_advance(-INT32_MAX, 3, true);
    check_advance(-4, UINT32_MAX, true);
}

/* Start beside the end: the steps behind it are not below the first one. */
static void test_start_beside_the_end(void)
{
    config.start = UINT32_MAX - 127u;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    check_advance(127, 0, true);
    check_advance(50, 50, true);
    check_advance(-177, UINT32_MAX - 126u, true);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    check_advance_refused(-1);
}

/* The largest start there is. */
static void test_last_start(void)
{
    config.start = UINT32_MAX - 1u;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    TEST_ASSERT_EQUAL_UINT32(UINT32_MAX, memory.agent.clock);
}

/* ---- the whole ---- */

/*
 * |K2 x| <= M from t0 > gamma d - 1, for any bits and any set of heard neighbours. Plant x' = x + u
 * with K1 = 0, K2 = 1: then z' = z + rho (mean of heard zhat - z) with rho = gamma h/(t+1) < 1.
 *
 * No tolerance is needed: rho is below 1 by 1/(t0 + 2) at least, far more than the roundings of
 * gain and sum, which are relative; so the exact u is at most M - z, and M - z is itself a number
 * of u's format (q31: z, M and u have even multiples of 2^-27; floating: x + u is rounded to the
 * nearest and M is a number), so that rounding cannot pass it.
 */
static void check_closed_loop(double gamma, uint32_t start, unsigned strategy, double first)
{
    uint64_t seed = 100u * strategy + start;
    for (uint32_t k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
        neighbours[k] = OWN + 1u + k;
    }
    config.neighbour_count = ONEBIT_NEIGHBOURS_MAX;
    config.state_count = 1;
    stabilizing[0] = 0;
    compression[0] = number_in(1, ROW_BITS);
    config.estimator_gain = coefficient(1000);
    config.control_gain = coefficient(gamma);
    config.start = start;
    TEST_ASSERT_TRUE(start > gamma * ONEBIT_NEIGHBOURS_MAX - 1);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &memory.agent, memory.estimates, NULL));
    onebit_real x = number_in(first, STATE_BITS);
    const onebit_real limit = number_in(0.5, STATE_BITS);
    bool up = first > 0;
    for (unsigned step = 0; step < 1500; ++step) {
        /* 0: always outward; 1: always one way; 2: at random; 3: turns when a bound is reached. */
        if (strategy == 0) {
            up = x > 0;
        } else if (strategy == 3 && (x == limit || x == -limit)) {
            up = x < 0;
        }
        for (uint32_t k = 0; k < ONEBIT_NEIGHBOURS_MAX; ++k) {
            bool hears = strategy < 2 || random_word(&seed) % 8u != 0;
            bool bit = strategy == 2 ? (random_word(&seed) & 1u) != 0 : !up;
            if (hears) {
                onebit_message message = message_from(neighbours[k], bit);
                REQUIRE(onebit_receive_message(&config, &memory.agent, &message,
                                               ONEBIT_ALL_LINKED) == ONEBIT_OK,
                        "message refused");
            }
        }
        onebit_real u = 0;
        REQUIRE(onebit_control(&config, &memory.agent, &x, ONEBIT_ALL_LINKED, &u) == ONEBIT_OK,
                "control refused");
        x += u;
        REQUIRE(x <= limit && x >= -limit, "gamma %g t0 %lu strategy %u: x = %.9g after %u steps",
                gamma, (unsigned long)start, strategy, value_in(x, STATE_BITS), step + 1u);
    }
}

static void test_compressed_state_stays_within_the_bound(void)
{
    static const double firsts[] = {0.5, -0.5, 0.4999999, 0, 0.25};
    for (unsigned strategy = 0; strategy < 4; ++strategy) {
        for (unsigned f = 0; f < sizeof firsts / sizeof *firsts; ++f) {
            setUp();
            check_closed_loop(3.5, 112, strategy, firsts[f]); /* gamma d - 1 = 111 */
            setUp();
            check_closed_loop(0.1, 3, strategy, firsts[f]); /* 2.2 */
            setUp();
            check_closed_loop(0.06, 1, strategy, firsts[f]); /* 0.92 */
        }
    }
}

/* 40 bytes and 8 a neighbour on a 32-bit target, in f32 and q31; test_library_build.py compiles for
 * one. Here: nothing but the pointer depends on the target. */
static void test_memory(void)
{
#if ONEBIT_ARITHMETIC != ONEBIT_F64
    size_t size = sizeof(uint32_t) + sizeof(memory.agent.clock) + sizeof(memory.agent.heard) +
                  sizeof(memory.agent.gain) + sizeof(memory.agent.refused) +
                  sizeof(memory.agent.saturated) + sizeof(memory.agent.wrapped);
    TEST_ASSERT_TRUE(size <= 40);
    TEST_ASSERT_EQUAL_UINT(8, sizeof(onebit_estimate));
#endif
    TEST_ASSERT_TRUE(sizeof(onebit_agent) <= (ONEBIT_ARITHMETIC == ONEBIT_F64 ? 56 : 48));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_check_takes_a_sound_configuration);
    RUN_TEST(test_check_pointers);
    RUN_TEST(test_check_agent_and_neighbours);
    RUN_TEST(test_check_states_and_rows);
    RUN_TEST(test_check_threshold_and_bound);
    RUN_TEST(test_check_gains);
    RUN_TEST(test_check_start_and_format);
    RUN_TEST(test_check_numbers_against_the_format);
    RUN_TEST(test_check_thresholds_by_neighbour);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    RUN_TEST(test_check_fraction_bits);
#endif
    RUN_TEST(test_start);
    RUN_TEST(test_start_refuses);
    RUN_TEST(test_encode_probability);
    RUN_TEST(test_encode_is_monotone);
    RUN_TEST(test_encode_extreme_words);
    RUN_TEST(test_encode_extreme_states);
    RUN_TEST(test_encode_refuses);
    RUN_TEST(test_receive_updates_one_link);
    RUN_TEST(test_receive_unknown);
    RUN_TEST(test_receive_wrong_kinds);
    RUN_TEST(test_receive_repeated);
    RUN_TEST(test_receive_every_residue);
    RUN_TEST(test_receive_stale_after_heard);
    RUN_TEST(test_identifier_form_has_no_step);
    RUN_TEST(test_link_mode);
    RUN_TEST(test_counters_stop_at_65535);
    RUN_TEST(test_receive_message);
    RUN_TEST(test_linked);
    RUN_TEST(test_receive_gives_the_message);
    RUN_TEST(test_send);
    RUN_TEST(test_send_refuses);
    RUN_TEST(test_thresholds_by_neighbour);
    RUN_TEST(test_not_started);
    RUN_TEST(test_control_stays_within_the_estimates);
    RUN_TEST(test_valid);
    RUN_TEST(test_receive_nulls);
    RUN_TEST(test_receive_without_frames);
    RUN_TEST(test_thirty_two_neighbours);
    RUN_TEST(test_control);
    RUN_TEST(test_control_by_hand);
    RUN_TEST(test_control_refuses);
#if ONEBIT_ARITHMETIC == ONEBIT_Q31
    RUN_TEST(test_control_saturates);
#endif
    RUN_TEST(test_order_of_receiving_does_not_matter);
    RUN_TEST(test_advance);
    RUN_TEST(test_clock_wraps);
    RUN_TEST(test_start_beside_the_end);
    RUN_TEST(test_last_start);
    RUN_TEST(test_compressed_state_stays_within_the_bound);
    RUN_TEST(test_memory);
    return UNITY_END();
}
