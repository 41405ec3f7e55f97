/* sim/wire.c: the README's numbers, and equality with a bit-by-bit reference on frames of every
 * kind.
 */
#include "unity.h"
#include "wire.h"
#include "wire_reference.h"

static uint64_t random_state;

static uint32_t random_word(void)
{
    random_state = random_state * 6364136223846793005u + 1442695040888963407u;
    return (uint32_t)(random_state >> 32);
}

void setUp(void)
{
    random_state = 1;
}

void tearDown(void)
{
}

struct spread {
    uint64_t count;
    uint64_t sum;
    uint32_t least;
    uint32_t most;
};

static void spread_add(struct spread *spread, uint32_t bits)
{
    if (spread->count == 0 || bits < spread->least) {
        spread->least = bits;
    }
    if (bits > spread->most) {
        spread->most = bits;
    }
    spread->count++;
    spread->sum += bits;
}

static double spread_mean(const struct spread *spread)
{
    return (double)spread->sum / (double)spread->count;
}

static void test_standard_length_0_all_identifiers(void)
{
    struct spread spread = {0, 0, 0, 0};
    onebit_frame frame = {0};
    for (frame.identifier = 0; frame.identifier < 2048; frame.identifier++) {
        spread_add(&spread, wire_bits(&frame));
    }
    TEST_ASSERT_EQUAL_UINT32(48, spread.least);
    TEST_ASSERT_EQUAL_UINT32(53, spread.most);
    TEST_ASSERT_DOUBLE_WITHIN(0.0005, 48.969, spread_mean(&spread));
}

static void test_standard_length_1_all_identifiers_and_payloads(void)
{
    struct spread spread = {0, 0, 0, 0};
    onebit_frame frame = {0};
    frame.length = 1;
    for (frame.identifier = 0; frame.identifier < 2048; frame.identifier++) {
        for (uint32_t payload = 0; payload < 256; payload++) {
            frame.data[0] = (uint8_t)payload;
            spread_add(&spread, wire_bits(&frame));
        }
    }
    TEST_ASSERT_EQUAL_UINT32(56, spread.least);
    TEST_ASSERT_EQUAL_UINT32(62, spread.most);
    TEST_ASSERT_DOUBLE_WITHIN(0.0005, 57.018, spread_mean(&spread));
}

static void test_standard_remote_length_0_all_identifiers(void)
{
    struct spread spread = {0, 0, 0, 0};
    onebit_frame frame = {0};
    frame.flags = ONEBIT_FRAME_REMOTE;
    for (frame.identifier = 0; frame.identifier < 2048; frame.identifier++) {
        spread_add(&spread, wire_bits(&frame));
    }
    TEST_ASSERT_EQUAL_UINT32(48, spread.least);
    TEST_ASSERT_EQUAL_UINT32(52, spread.most);
}

/* All 2^29 identifiers of length 0 are in test_wire_long.c. */
static void test_extended_sampled(void)
{
    struct spread empty = {0, 0, 0, 0};
    struct spread one = {0, 0, 0, 0};
    onebit_frame frame = {0};
    frame.flags = ONEBIT_FRAME_EXTENDED;
    for (uint32_t k = 0; k < 2000000; k++) {
        frame.identifier = random_word() >> 3;
        frame.length = 0;
        spread_add(&empty, wire_bits(&frame));
        frame.length = 1;
        frame.data[0] = (uint8_t)(random_word() >> 24);
        spread_add(&one, wire_bits(&frame));
    }
    /* The standard deviation is about 1.4 bits, that of the means therefore 0.001. */
    TEST_ASSERT_DOUBLE_WITHIN(0.005, 69.738, spread_mean(&empty));
    TEST_ASSERT_DOUBLE_WITHIN(0.05, 77.8, spread_mean(&one));
}

/* A float32 in a standard frame: 79 bits and its stuff bits. Some frames have none. */
static void test_standard_length_4_is_79_before_stuffing(void)
{
    struct spread spread = {0, 0, 0, 0};
    for (uint32_t k = 0; k < 100000; k++) {
        onebit_frame frame = {0};
        struct wire_reference reference;
        frame.identifier = random_word() >> 21;
        frame.length = 4;
        for (uint32_t j = 0; j < 4; j++) {
            frame.data[j] = (uint8_t)(random_word() >> 24);
        }
        wire_reference_build(&reference, &frame);
        TEST_ASSERT_EQUAL_UINT32(79 + reference.stuffed, wire_bits(&frame));
        spread_add(&spread, wire_bits(&frame));
    }
    TEST_ASSERT_EQUAL_UINT32(79, spread.least);
}

static void test_equals_reference_on_every_kind(void)
{
    uint32_t kinds[4][9] = {{0}};
    for (uint32_t k = 0; k < 1000000; k++) {
        onebit_frame frame = wire_reference_frame(random_word);
        struct wire_reference reference;
        wire_reference_build(&reference, &frame);
        kinds[frame.flags][frame.length]++;
        if (reference.count != wire_bits(&frame)) {
            char text[128];
            snprintf(text, sizeof text, "identifier %08X, flags %u, length %u",
                     (unsigned)frame.identifier, frame.flags, frame.length);
            TEST_ASSERT_EQUAL_UINT32_MESSAGE(reference.count, wire_bits(&frame), text);
        }
    }
    for (uint32_t flags = 0; flags < 4; flags++) {
        for (uint32_t length = 0; length <= 8; length++) {
            TEST_ASSERT_GREATER_THAN_UINT32(10000, kinds[flags][length]);
        }
    }
}

/* Five equal bits at the very end of the CRC sequence still make a stuff bit. */
static void test_stuff_bit_behind_the_crc(void)
{
    uint32_t found = 0;
    onebit_frame frame = {0};
    for (frame.identifier = 0; frame.identifier < 2048; frame.identifier++) {
        struct wire_reference reference;
        wire_reference_build(&reference, &frame);
        /* The 13 bits of fixed form follow the stuff bit, the CRC's last bit precedes it. */
        uint32_t last = reference.count - 14;
        if (reference.bits[last] != reference.plain[reference.plain_count - 1]) {
            found++;
        }
        TEST_ASSERT_EQUAL_UINT32(reference.count, wire_bits(&frame));
    }
    TEST_ASSERT_GREATER_THAN_UINT32(0, found);
}

/* What wire.h says of frames that do not fit: they are cut, and nothing outside is read. */
static void test_excess_is_left_out(void)
{
    for (uint32_t k = 0; k < 10000; k++) {
        onebit_frame frame = wire_reference_frame(random_word);
        onebit_frame excess = frame;
        if (frame.length == 8) {
            excess.length = (uint8_t)(8u + random_word() % 248u);
        }
        excess.identifier |=
            random_word() & (frame.flags & ONEBIT_FRAME_EXTENDED ? 0xE0000000u : 0xFFFFF800u);
        excess.flags |= (uint8_t)(random_word() & (ONEBIT_FRAME_ERROR | ONEBIT_FRAME_FLEXIBLE));
        TEST_ASSERT_EQUAL_UINT32(wire_bits(&frame), wire_bits(&excess));
        TEST_ASSERT_EQUAL_HEX32(wire_arbitration(&frame), wire_arbitration(&excess));
    }
}

/* -1 if the first frame wins arbitration, 1 if the second does, 0 if nothing decides. */
static int reference_winner(const onebit_frame *first, const onebit_frame *second)
{
    struct wire_reference a;
    struct wire_reference b;
    wire_reference_build(&a, first);
    wire_reference_build(&b, second);
    for (uint32_t k = 0; k < a.arbitration && k < b.arbitration; k++) {
        if (a.plain[k] != b.plain[k]) {
            return a.plain[k] < b.plain[k] ? -1 : 1;
        }
    }
    return 0;
}

static void test_arbitration_equals_reference(void)
{
    uint32_t results[3] = {0, 0, 0};
    for (uint32_t k = 0; k < 300000; k++) {
        onebit_frame first = wire_reference_frame(random_word);
        onebit_frame second = wire_reference_frame(random_word);
        /* Make late bits decide often: same base identifier, then nearly the same extension. */
        uint32_t near = random_word();
        if (near & 3u) {
            uint32_t base =
                first.flags & ONEBIT_FRAME_EXTENDED ? first.identifier >> 18 : first.identifier;
            if (second.flags & ONEBIT_FRAME_EXTENDED) {
                second.identifier = base << 18 | (second.identifier & 0x3FFFFu);
                if ((near & 2u) && (first.flags & ONEBIT_FRAME_EXTENDED)) {
                    second.identifier = first.identifier ^ (near >> 31);
                }
            } else {
                second.identifier = base;
            }
        }
        uint32_t a = wire_arbitration(&first);
        uint32_t b = wire_arbitration(&second);
        int expected = reference_winner(&first, &second);
        TEST_ASSERT_EQUAL_INT(expected, (a > b) - (a < b));
        results[expected + 1]++;
    }
    for (uint32_t k = 0; k < 3; k++) {
        TEST_ASSERT_GREATER_THAN_UINT32(1000, results[k]);
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_standard_length_0_all_identifiers);
    RUN_TEST(test_standard_length_1_all_identifiers_and_payloads);
    RUN_TEST(test_standard_remote_length_0_all_identifiers);
    RUN_TEST(test_extended_sampled);
    RUN_TEST(test_standard_length_4_is_79_before_stuffing);
    RUN_TEST(test_equals_reference_on_every_kind);
    RUN_TEST(test_stuff_bit_behind_the_crc);
    RUN_TEST(test_excess_is_left_out);
    RUN_TEST(test_arbitration_equals_reference);
    return UNITY_END();
}
