/*
 * The frame codec of lib/onebit_frame.h against its own table: literal examples of every row, every
 * message of the broadcast forms, every 11-bit frame, and the edges of the 29-bit identifiers.
 */
#include "onebit_frame.h"

#include "numbers.h"

#include <string.h>

#define SYNC ONEBIT_SYNC_IDENTIFIER

static const onebit_format payload_form = {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x100,
                                           SYNC};
static const onebit_format identifier_form = {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER,
                                              0x400, SYNC};
static const onebit_format link_payload_form = {ONEBIT_MODE_LINK, ONEBIT_ENCODING_PAYLOAD, 0, SYNC};
static const onebit_format link_identifier_form = {ONEBIT_MODE_LINK, ONEBIT_ENCODING_IDENTIFIER, 0,
                                                   SYNC};

/* Both encodings, with the default base, the lowest, and the highest that leave one agent. */
static const onebit_format broadcast_forms[] = {
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x100, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x080, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x7EE, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x400, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x080, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x7EC, SYNC},
};
#define BROADCAST_FORMS (sizeof broadcast_forms / sizeof *broadcast_forms)

static const onebit_format invalid_forms[] = {
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x07F, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x07F, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x7EF, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x7F0, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0xFFFF, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x7EF, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x7EE, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x7ED, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x800, SYNC},
    {ONEBIT_MODE_BROADCAST, 2, 0x100, SYNC},
    {ONEBIT_MODE_LINK, 2, 0x100, SYNC},
    {ONEBIT_MODE_LINK, 255, 0x100, SYNC},
    {2, ONEBIT_ENCODING_PAYLOAD, 0x100, SYNC},
    {255, ONEBIT_ENCODING_IDENTIFIER, 0x400, SYNC},
    /* Formats without frames, and SYNC that does not win over all messages. */
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_NONE, 0x100, SYNC},
    {ONEBIT_MODE_LINK, ONEBIT_ENCODING_NONE, 0x100, SYNC},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x100, 0},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x100, 0x101},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x400, 0x401},
    {ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x400, 0xFFFF},
    {ONEBIT_MODE_LINK, ONEBIT_ENCODING_PAYLOAD, 0, 0},
    {ONEBIT_MODE_LINK, ONEBIT_ENCODING_IDENTIFIER, 0, 0x400},
};
#define INVALID_FORMS (sizeof invalid_forms / sizeof *invalid_forms)

void setUp(void)
{
}

void tearDown(void)
{
}

/* Equal in everything a message means; compared by field, for structures may have padding. */
static bool same_message(const onebit_message *a, const onebit_message *b)
{
    return a->sender == b->sender && a->receiver == b->receiver && a->step == b->step &&
           a->has_step == b->has_step && a->bit == b->bit;
}

/* Equal on the wire. */
static bool same_frame(const onebit_frame *a, const onebit_frame *b)
{
    return a->identifier == b->identifier && a->flags == b->flags && a->length == b->length &&
           memcmp(a->data, b->data, a->length) == 0;
}

static void check_example(const onebit_format *format, uint32_t sender, uint32_t receiver,
                          uint8_t step, bool bit, const onebit_frame *expected)
{
    onebit_message message = {sender, receiver, step, false, bit};
    onebit_frame frame;
    memset(&frame, 0xA5, sizeof frame);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(format, &message, &frame));
    TEST_ASSERT_EQUAL_HEX32(expected->identifier, frame.identifier);
    TEST_ASSERT_EQUAL_HEX8(expected->flags, frame.flags);
    TEST_ASSERT_EQUAL_UINT8(expected->length, frame.length);
    /* All eight: what a controller may copy holds nothing of the caller's memory. */
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected->data, frame.data, 8);

    bool payload = format->encoding == ONEBIT_ENCODING_PAYLOAD;
    onebit_message wanted = {sender, receiver, payload ? step : 0, payload, bit};
    onebit_message decoded;
    memset(&decoded, 0, sizeof decoded);
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_decode(format, &frame, &decoded));
    TEST_ASSERT_TRUE(same_message(&wanted, &decoded));
}

/* By hand from the README's frame table. */
static void test_examples_of_each_row(void)
{
    /* Broadcast, payload: 0x100 + 7; step 100 is 0x64, shifted 0xC8. */
    onebit_frame frame = {0x107, 0, 1, {0xC8}};
    check_example(&payload_form, 7, 0, 100, false, &frame);
    frame.data[0] = 0xC9;
    check_example(&payload_form, 7, 0, 100, true, &frame);
    /* The last agent, the last step. */
    frame = (onebit_frame){0x7EF, 0, 1, {0xFF}};
    check_example(&payload_form, 1775, 0, 127, true, &frame);

    /* Broadcast, identifier: 0x400 + 2 * 7. */
    frame = (onebit_frame){0x40E, 0, 0, {0}};
    check_example(&identifier_form, 7, 0, 100, false, &frame);
    frame.identifier = 0x40F;
    check_example(&identifier_form, 7, 0, 100, true, &frame);
    frame.identifier = 0x7EF;
    check_example(&identifier_form, 503, 0, 0, true, &frame);

    /* Link: 0x10000000 + (3 << 14) + (5 << 1). */
    frame = (onebit_frame){0x1000C00A, 0x01, 1, {0x02}};
    check_example(&link_payload_form, 3, 5, 1, false, &frame);
    frame.data[0] = 0x03;
    check_example(&link_payload_form, 3, 5, 1, true, &frame);
    frame = (onebit_frame){0x1000C00A, 0x01, 0, {0}};
    check_example(&link_identifier_form, 3, 5, 1, false, &frame);
    frame.identifier = 0x1000C00B;
    check_example(&link_identifier_form, 3, 5, 1, true, &frame);
    /* The largest numbers: all bits below the base's. */
    frame.identifier = 0x17FFFFFF;
    check_example(&link_identifier_form, 8191, 8191, 0, true, &frame);
}

static void test_step_is_taken_modulo_128_and_has_step_is_ignored(void)
{
    onebit_frame frame;
    onebit_message message = {1, 0, 128 + 5, false, true};
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&payload_form, &message, &frame));
    TEST_ASSERT_EQUAL_HEX8(0x0B, frame.data[0]);
    message.has_step = true;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&identifier_form, &message, &frame));
    TEST_ASSERT_EQUAL_UINT8(0, frame.length);
}

static void test_agent_limits(void)
{
    static const struct {
        onebit_format format;
        uint32_t limit;
    } rows[] = {
        {{ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x100, SYNC}, 1775}, /* 0x7EF - 0x100 */
        {{ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x080, SYNC}, 1903},
        {{ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, 0x7EE, SYNC}, 1},
        {{ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x400, SYNC},
         503}, /* 0x400 + 2 * 503 + 1 = 0x7EF */
        {{ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x401, SYNC},
         502}, /* 504 with bit 1 would be 0x7F0 */
        {{ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x080, SYNC}, 951},
        {{ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, 0x7EC, SYNC}, 1},
        {{ONEBIT_MODE_LINK, ONEBIT_ENCODING_PAYLOAD, 0, SYNC}, 8191},
        {{ONEBIT_MODE_LINK, ONEBIT_ENCODING_IDENTIFIER, 0xFFFF, SYNC},
         8191}, /* the base is not used */
    };
    for (unsigned k = 0; k < sizeof rows / sizeof *rows; ++k) {
        TEST_ASSERT_EQUAL_UINT32(rows[k].limit, onebit_frame_agent_limit(&rows[k].format));
    }
    for (unsigned k = 0; k < INVALID_FORMS; ++k) {
        TEST_ASSERT_EQUAL_UINT32(0, onebit_frame_agent_limit(&invalid_forms[k]));
    }
    TEST_ASSERT_EQUAL_UINT32(0, onebit_frame_agent_limit(NULL));
}

/* The limit is the largest number whose identifiers stay in 0x081..0x7EF, whatever the base. */
static void test_limit_of_every_base(void)
{
    for (unsigned encoding = 0; encoding < 2; ++encoding) {
        for (uint32_t base = 0; base <= UINT16_MAX; ++base) {
            onebit_format format = {ONEBIT_MODE_BROADCAST, (uint8_t)encoding, (uint16_t)base, 1};
            uint32_t count = 0;
            for (;;) {
                uint32_t next = count + 1u;
                uint32_t first = base + (encoding == ONEBIT_ENCODING_PAYLOAD ? next : 2u * next);
                uint32_t last = encoding == ONEBIT_ENCODING_PAYLOAD ? first : first + 1u;
                if (first < 0x081 || last > 0x7EF) {
                    break;
                }
                count = next;
            }
            /* A base below SYNC's would only waste agents: refused as a mistake. */
            if (base < 0x080) {
                count = 0;
            }
            REQUIRE(onebit_frame_agent_limit(&format) == count, "encoding %u base %x: %u, not %u",
                    encoding, (unsigned)base, (unsigned)onebit_frame_agent_limit(&format),
                    (unsigned)count);
        }
    }
}

static void test_every_broadcast_message_returns(void)
{
    for (unsigned k = 0; k < BROADCAST_FORMS; ++k) {
        const onebit_format *format = &broadcast_forms[k];
        bool payload = format->encoding == ONEBIT_ENCODING_PAYLOAD;
        uint32_t limit = onebit_frame_agent_limit(format);
        for (uint32_t sender = 1; sender <= limit; ++sender) {
            for (unsigned rest = 0; rest < 256; ++rest) {
                uint8_t step = (uint8_t)(rest >> 1);
                bool bit = (rest & 1u) != 0;
                onebit_message message = {sender, 0, step, payload, bit};
                onebit_frame frame;
                onebit_message decoded = {0, 1, 0, false, false};
                REQUIRE(onebit_frame_encode(format, &message, &frame) == ONEBIT_OK &&
                            onebit_frame_decode(format, &frame, &decoded) == ONEBIT_OK,
                        "form %u agent %u refused", k, (unsigned)sender);
                message.step = payload ? step : 0;
                REQUIRE(same_message(&message, &decoded), "form %u agent %u step %u", k,
                        (unsigned)sender, step);
                REQUIRE(frame.identifier >= 0x081 && frame.identifier <= 0x7EF &&
                            frame.flags == 0 && frame.length == (payload ? 1 : 0),
                        "form %u agent %u: frame outside its range", k, (unsigned)sender);
            }
        }
    }
}

/* "The bit is the lowest of the identifier, so that it never decides arbitration between agents."
 */
static void test_the_bit_never_decides_arbitration(void)
{
    onebit_frame before = {0};
    for (uint32_t sender = 1; sender <= 503; ++sender) {
        onebit_message message = {sender, 0, 0, false, false};
        onebit_frame zero;
        onebit_frame one;
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&identifier_form, &message, &zero));
        message.bit = true;
        TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&identifier_form, &message, &one));
        TEST_ASSERT_TRUE(before.identifier < zero.identifier);
        TEST_ASSERT_TRUE(zero.identifier < one.identifier);
        before = one;
    }
}

static onebit_status expected_refusal(uint8_t flags, bool identifier_known, bool extended,
                                      unsigned length, unsigned wanted_length)
{
    if (flags & ONEBIT_FRAME_ERROR) {
        return ONEBIT_REFUSED_ERROR_FRAME;
    }
    if (((flags & ONEBIT_FRAME_EXTENDED) != 0) != extended || !identifier_known) {
        return ONEBIT_REFUSED_FOREIGN;
    }
    if (flags & ONEBIT_FRAME_REMOTE) {
        return ONEBIT_REFUSED_REMOTE;
    }
    if (flags & ONEBIT_FRAME_FLEXIBLE) {
        return ONEBIT_REFUSED_FLEXIBLE;
    }
    return length == wanted_length ? ONEBIT_OK : ONEBIT_REFUSED_LENGTH;
}

/* The status is as expected; what decodes encodes to the same frame, what does not changes nothing.
 */
static void check_frame(const onebit_format *format, const onebit_frame *frame,
                        onebit_status expected)
{
    onebit_message message;
    onebit_message untouched;
    memset(&message, 0xA5, sizeof message);
    memcpy(&untouched, &message, sizeof message);
    onebit_status status = onebit_frame_decode(format, frame, &message);
    REQUIRE(status == expected, "mode %u encoding %u: %08x flags %x length %u: status %d, not %d",
            format->mode, format->encoding, (unsigned)frame->identifier, frame->flags,
            frame->length, (int)status, (int)expected);
    if (status != ONEBIT_OK) {
        REQUIRE(memcmp(&message, &untouched, sizeof message) == 0, "%08x: message touched",
                (unsigned)frame->identifier);
        return;
    }
    onebit_frame again;
    REQUIRE(onebit_frame_encode(format, &message, &again) == ONEBIT_OK && same_frame(frame, &again),
            "mode %u encoding %u: %08x does not return", format->mode, format->encoding,
            (unsigned)frame->identifier);
}

/*
 * All 2048 identifiers, lengths 0..8, 16 combinations of flags; all 256 payloads where a frame may
 * be taken (no flag that refuses it), four where the payload cannot matter.
 */
static void test_every_11_bit_frame(void)
{
    for (unsigned k = 0; k < BROADCAST_FORMS; ++k) {
        const onebit_format *format = &broadcast_forms[k];
        bool payload = format->encoding == ONEBIT_ENCODING_PAYLOAD;
        for (uint32_t identifier = 0; identifier < 2048; ++identifier) {
            int32_t place = (int32_t)identifier - format->base;
            bool known;
            if (payload) {
                known = place >= 1 && identifier <= 0x7EF;
            } else {
                /* An agent's two identifiers differ in the lowest bit, the bases being even. */
                known = place >= 2 && (identifier | 1u) <= 0x7EF;
            }
            for (unsigned flags = 0; flags < 16; ++flags) {
                for (unsigned length = 0; length <= 8; ++length) {
                    onebit_frame frame = {identifier, (uint8_t)flags, (uint8_t)length, {0}};
                    onebit_status expected =
                        expected_refusal((uint8_t)flags, known, false, length, payload ? 1 : 0);
                    unsigned stride = flags == 0 && length == 1 ? 1 : 85;
                    for (unsigned data = 0; data < 256; data += stride) {
                        memset(frame.data, (int)data, sizeof frame.data);
                        check_frame(format, &frame, expected);
                    }
                }
            }
        }
    }
}

/* Identifiers no 11-bit frame can have; a decoder that masks them would take some. */
static void test_wild_identifiers_in_broadcast(void)
{
    uint64_t seed = 1;
    for (unsigned k = 0; k < BROADCAST_FORMS; ++k) {
        for (unsigned trial = 0; trial < 200000; ++trial) {
            uint32_t identifier = random_word(&seed) >> (trial % 21u);
            if (identifier > 0x7EF) {
                onebit_frame frame = {identifier, 0, 1, {0}};
                check_frame(&broadcast_forms[k], &frame, ONEBIT_REFUSED_FOREIGN);
            }
        }
        onebit_frame frame = {0x10000107, ONEBIT_FRAME_EXTENDED, 1, {0}};
        check_frame(&broadcast_forms[k], &frame, ONEBIT_REFUSED_FOREIGN);
    }
}

static void test_link_messages_return(void)
{
    static const uint32_t receivers[] = {1, 2, 127, 128, 4095, 4096, 8190, 8191};
    static const uint8_t steps[] = {0, 1, 63, 64, 127};
    const onebit_format *formats[] = {&link_payload_form, &link_identifier_form};
    for (unsigned k = 0; k < 2; ++k) {
        bool payload = formats[k]->encoding == ONEBIT_ENCODING_PAYLOAD;
        for (uint32_t sender = 1; sender <= 8191; ++sender) {
            for (unsigned r = 0; r < sizeof receivers / sizeof *receivers; ++r) {
                for (unsigned rest = 0; rest < 2 * sizeof steps; ++rest) {
                    onebit_message message = {sender, receivers[r], steps[rest / 2], payload,
                                              rest % 2 != 0};
                    onebit_frame frame;
                    onebit_message decoded = {0, 0, 0, false, false};
                    REQUIRE(onebit_frame_encode(formats[k], &message, &frame) == ONEBIT_OK &&
                                onebit_frame_decode(formats[k], &frame, &decoded) == ONEBIT_OK,
                            "link %u -> %u refused", (unsigned)sender, (unsigned)receivers[r]);
                    message.step = payload ? message.step : 0;
                    REQUIRE(same_message(&message, &decoded), "link %u -> %u", (unsigned)sender,
                            (unsigned)receivers[r]);
                    REQUIRE(frame.identifier < (uint32_t)1 << 29 &&
                                frame.flags == ONEBIT_FRAME_EXTENDED,
                            "link %u -> %u: not a 29-bit identifier", (unsigned)sender,
                            (unsigned)receivers[r]);
                }
            }
        }
    }
}

/* Random identifiers of 29 bits and of 32, with the fields read by division instead of masks. */
static void test_wild_identifiers_in_link_mode(void)
{
    const onebit_format *formats[] = {&link_payload_form, &link_identifier_form};
    uint64_t seed = 2;
    for (unsigned k = 0; k < 2; ++k) {
        bool payload = formats[k]->encoding == ONEBIT_ENCODING_PAYLOAD;
        for (unsigned trial = 0; trial < 1000000; ++trial) {
            uint32_t identifier = random_word(&seed);
            if (trial % 8u != 0) {
                /* Most of them plausible: the base's bits in place, one field forced to an edge. */
                identifier = 0x10000000u + identifier % 0x08000000u;
                identifier = trial % 8u == 1 ? identifier - identifier % 16384u + identifier % 2u
                                             : identifier;
                identifier = trial % 8u == 2 ? 0x10000000u + identifier % 16384u : identifier;
            } else if (trial % 16u == 0) {
                identifier %= 0x20000000u;
            }
            uint8_t flags = trial % 3u == 0 ? (uint8_t)(random_word(&seed) % 16u)
                                            : (uint8_t)ONEBIT_FRAME_EXTENDED;
            uint8_t length =
                trial % 5u == 0 ? (uint8_t)(random_word(&seed) % 9u) : (uint8_t)(payload ? 1 : 0);
            onebit_frame frame = {identifier, flags, length, {(uint8_t)random_word(&seed)}};
            bool known = identifier / 0x08000000u == 2 && identifier / 16384u % 8192u != 0 &&
                         identifier / 2u % 8192u != 0 && !(payload && identifier % 2u != 0);
            check_frame(formats[k], &frame,
                        expected_refusal(flags, known, true, length, payload ? 1 : 0));
        }
    }
}

/* ERROR_FRAME, FOREIGN, REMOTE, FLEXIBLE, LENGTH: one fault is taken away after the other. */
static void test_order_of_refusals(void)
{
    const onebit_format *formats[] = {&payload_form, &link_identifier_form};
    static const uint32_t known[] = {0x101, 0x1000C00A};
    for (unsigned k = 0; k < 2; ++k) {
        uint8_t kind = (uint8_t)(k == 0 ? 0 : ONEBIT_FRAME_EXTENDED);
        onebit_frame frame = {0, (uint8_t)(kind | 0x0Eu), 8, {0}};
        check_frame(formats[k], &frame, ONEBIT_REFUSED_ERROR_FRAME);
        frame.flags = (uint8_t)(frame.flags - ONEBIT_FRAME_ERROR);
        check_frame(formats[k], &frame, ONEBIT_REFUSED_FOREIGN);
        frame.identifier = known[k];
        frame.flags ^= ONEBIT_FRAME_EXTENDED;
        check_frame(formats[k], &frame, ONEBIT_REFUSED_FOREIGN);
        frame.flags ^= ONEBIT_FRAME_EXTENDED;
        check_frame(formats[k], &frame, ONEBIT_REFUSED_REMOTE);
        frame.flags = (uint8_t)(frame.flags - ONEBIT_FRAME_REMOTE);
        check_frame(formats[k], &frame, ONEBIT_REFUSED_FLEXIBLE);
        frame.flags = kind;
        check_frame(formats[k], &frame, ONEBIT_REFUSED_LENGTH);
        frame.length = k == 0 ? 1 : 0;
        check_frame(formats[k], &frame, ONEBIT_OK);
    }
}

static void check_encode_refused(const onebit_format *format, const onebit_message *message,
                                 onebit_status expected)
{
    onebit_frame frame;
    onebit_frame untouched;
    memset(&frame, 0xA5, sizeof frame);
    memcpy(&untouched, &frame, sizeof frame);
    TEST_ASSERT_EQUAL(expected, onebit_frame_encode(format, message, &frame));
    TEST_ASSERT_EQUAL_MEMORY(&untouched, &frame, sizeof frame);
}

static void test_agents_that_have_no_identifier(void)
{
    static const uint32_t beyond[] = {0, 1776, 8192, 0x80000001u, UINT32_MAX};
    for (unsigned k = 0; k < sizeof beyond / sizeof *beyond; ++k) {
        onebit_message message = {beyond[k], 0, 0, false, false};
        check_encode_refused(&payload_form, &message, ONEBIT_IDENTIFIER);
        check_encode_refused(&identifier_form, &message, ONEBIT_IDENTIFIER);
    }
    onebit_message message = {504, 0, 0, false, false};
    check_encode_refused(&identifier_form, &message, ONEBIT_IDENTIFIER);
    static const uint32_t beyond_links[] = {0, 8192, UINT32_MAX};
    for (unsigned k = 0; k < sizeof beyond_links / sizeof *beyond_links; ++k) {
        message = (onebit_message){beyond_links[k], 1, 0, false, false};
        check_encode_refused(&link_payload_form, &message, ONEBIT_IDENTIFIER);
        message = (onebit_message){1, beyond_links[k], 0, false, false};
        check_encode_refused(&link_payload_form, &message, ONEBIT_IDENTIFIER);
        check_encode_refused(&link_identifier_form, &message, ONEBIT_IDENTIFIER);
    }
}

static void test_nulls(void)
{
    onebit_message message = {1, 1, 0, false, false};
    onebit_frame frame = {0x101, 0, 1, {0}};
    check_encode_refused(NULL, &message, ONEBIT_NULL);
    check_encode_refused(&payload_form, NULL, ONEBIT_NULL);
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_frame_encode(&payload_form, &message, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_frame_decode(NULL, &frame, &message));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_frame_decode(&payload_form, NULL, &message));
    TEST_ASSERT_EQUAL(ONEBIT_NULL, onebit_frame_decode(&payload_form, &frame, NULL));
}

static void test_invalid_formats(void)
{
    onebit_message message = {1, 1, 0, false, false};
    onebit_frame frame = {0x101, ONEBIT_FRAME_ERROR, 1, {0}};
    for (unsigned k = 0; k < INVALID_FORMS; ++k) {
        check_encode_refused(&invalid_forms[k], &message, ONEBIT_CONFIG_FORMAT);
        check_frame(&invalid_forms[k], &frame, ONEBIT_CONFIG_FORMAT);
    }
}

/* CAN FD lengths go up to 64; nothing beyond data[7] may be read. */
static void test_lengths_beyond_eight(void)
{
    for (unsigned length = 0; length < 256; ++length) {
        onebit_frame frame = {0x101, 0, (uint8_t)length, {0}};
        onebit_message message;
        TEST_ASSERT_EQUAL(length == 1 ? ONEBIT_OK : ONEBIT_REFUSED_LENGTH,
                          onebit_frame_decode(&payload_form, &frame, &message));
        frame.flags = ONEBIT_FRAME_FLEXIBLE;
        TEST_ASSERT_EQUAL(ONEBIT_REFUSED_FLEXIBLE,
                          onebit_frame_decode(&payload_form, &frame, &message));
    }
}

static void check_sync_told(const onebit_format *format, const onebit_frame *frame, bool is_sync,
                            uint8_t expected)
{
    uint8_t step = 77;
    TEST_ASSERT_EQUAL(is_sync, onebit_frame_is_sync(format, frame, &step));
    TEST_ASSERT_EQUAL_UINT8(is_sync ? expected : 77, step);
}

/* Every residue, around the clock's end too: 1..128, of which 128 stands for 0. */
static void test_sync_tells_the_step(void)
{
    static const uint32_t firsts[] = {1, 1000000, UINT32_MAX - 200u};
    for (unsigned k = 0; k < sizeof firsts / sizeof *firsts; ++k) {
        for (uint32_t t = firsts[k]; t != firsts[k] + 300u; ++t) {
            onebit_frame frame;
            memset(&frame, 0xA5, sizeof frame);
            onebit_frame_sync(&payload_form, t, &frame);
            onebit_frame expected = {0x080, 0, 1, {(uint8_t)((t + 127u) % 128u + 1u)}};
            TEST_ASSERT_TRUE(same_frame(&expected, &frame));
            TEST_ASSERT_EACH_EQUAL_HEX8(0, frame.data + 1, 7);
            check_sync_told(&payload_form, &frame, true, (uint8_t)(t % 128u));
        }
    }
}

static void test_sync_and_what_is_none(void)
{
    onebit_frame frame = {0x080, 0, 0, {5}};
    check_sync_told(&payload_form, &frame, true,
                    ONEBIT_NO_STEP); /* no counter, whatever lies there */
    frame.length = 1;
    for (unsigned counter = 0; counter < 256; ++counter) {
        frame.data[0] = (uint8_t)counter;
        bool told = counter >= 1 && counter <= 128;
        check_sync_told(&payload_form, &frame, true,
                        told ? (uint8_t)(counter % 128u) : ONEBIT_NO_STEP);
        for (unsigned k = 0; k < BROADCAST_FORMS; ++k) {
            check_frame(&broadcast_forms[k], &frame, ONEBIT_REFUSED_FOREIGN);
        }
    }
    for (unsigned length = 2; length < 256; ++length) {
        frame.length = (uint8_t)length;
        check_sync_told(&payload_form, &frame, false, 0);
    }
    frame.length = 1;
    for (unsigned flags = 1; flags < 16; ++flags) {
        frame.flags = (uint8_t)flags;
        check_sync_told(&payload_form, &frame, false, 0);
    }
    frame.flags = 0;
    onebit_format other = payload_form;
    for (uint32_t identifier = 0; identifier < 4096; ++identifier) {
        frame.identifier = identifier;
        check_sync_told(&payload_form, &frame, identifier == 0x080, ONEBIT_NO_STEP);
        other.sync = (uint16_t)identifier;
        TEST_ASSERT_EQUAL(identifier >= 1 && identifier <= 0x100,
                          onebit_frame_agent_limit(&other) != 0);
        check_sync_told(&other, &frame, true, ONEBIT_NO_STEP);
        onebit_frame own;
        onebit_frame_sync(&other, 1, &own);
        TEST_ASSERT_EQUAL_HEX32(identifier, own.identifier);
    }
    uint8_t step;
    TEST_ASSERT_FALSE(onebit_frame_is_sync(NULL, &frame, &step));
    TEST_ASSERT_FALSE(onebit_frame_is_sync(&payload_form, NULL, &step));
    TEST_ASSERT_FALSE(onebit_frame_is_sync(&payload_form, &frame, NULL));
}

/* Each code has a name, its own; the counters of refused frames are those from the first to the
 * end. */
static void test_names_of_the_codes(void)
{
    const char *names[ONEBIT_STATUS_COUNT];
    for (int code = 0; code < ONEBIT_STATUS_COUNT; ++code) {
        names[code] = onebit_status_name((onebit_status)code);
        TEST_ASSERT_EQUAL_MEMORY("ONEBIT_", names[code], 7);
        for (int other = 0; other < code; ++other) {
            TEST_ASSERT_TRUE(strcmp(names[code], names[other]) != 0);
        }
        bool refused = strncmp(names[code], "ONEBIT_REFUSED_", 15) == 0;
        TEST_ASSERT_EQUAL(refused, code >= ONEBIT_REFUSED_FIRST);
    }
    TEST_ASSERT_EQUAL_STRING("ONEBIT_REFUSED_EARLY", names[ONEBIT_REFUSED_EARLY]);
    TEST_ASSERT_EQUAL_STRING("?", onebit_status_name(ONEBIT_STATUS_COUNT));
    TEST_ASSERT_EQUAL_STRING("?", onebit_status_name((onebit_status)-1));
    TEST_ASSERT_TRUE(onebit_is_message(ONEBIT_OK) && onebit_is_message(ONEBIT_REFUSED_UNKNOWN) &&
                     onebit_is_message(ONEBIT_REFUSED_EARLY));
    TEST_ASSERT_FALSE(onebit_is_message(ONEBIT_REFUSED_FLEXIBLE) || onebit_is_message(ONEBIT_NULL));
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_examples_of_each_row);
    RUN_TEST(test_step_is_taken_modulo_128_and_has_step_is_ignored);
    RUN_TEST(test_agent_limits);
    RUN_TEST(test_limit_of_every_base);
    RUN_TEST(test_every_broadcast_message_returns);
    RUN_TEST(test_the_bit_never_decides_arbitration);
    RUN_TEST(test_every_11_bit_frame);
    RUN_TEST(test_wild_identifiers_in_broadcast);
    RUN_TEST(test_link_messages_return);
    RUN_TEST(test_wild_identifiers_in_link_mode);
    RUN_TEST(test_order_of_refusals);
    RUN_TEST(test_agents_that_have_no_identifier);
    RUN_TEST(test_nulls);
    RUN_TEST(test_invalid_formats);
    RUN_TEST(test_lengths_beyond_eight);
    RUN_TEST(test_sync_tells_the_step);
    RUN_TEST(test_sync_and_what_is_none);
    RUN_TEST(test_names_of_the_codes);
    return UNITY_END();
}
