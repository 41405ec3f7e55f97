/*
 * The two ends of a slcan line (channel.h) over lines of any capacity: what a device answers, in
 * the manual's words; that frames pass in order, both ways, and never stop, however little room
 * there is.
 */
#include "byte_queue.h"
#include "channel.h"

#include <unity.h>

#include <string.h>

/* A line in one direction: a queue of bytes; `capacity` may be less than its room. */
struct wire {
    uint8_t bytes[256];
    unsigned capacity;
    unsigned count;
    uint64_t time; /* told of each byte */
};

/* One end's hooks: it puts on one wire and takes from another. */
struct end {
    struct wire *out;
    struct wire *in;
    struct channel channel;
    struct transport transport;
};

static bool put(void *context, uint8_t byte)
{
    struct wire *wire = ((struct end *)context)->out;
    if (wire->count >= wire->capacity) {
        return false;
    }
    wire->bytes[wire->count++] = byte;
    return true;
}

static bool take(void *context, uint8_t *byte, uint64_t *nanoseconds)
{
    struct wire *wire = ((struct end *)context)->in;
    if (wire->count == 0) {
        return false;
    }
    *byte = wire->bytes[0];
    *nanoseconds = wire->time;
    memmove(wire->bytes, wire->bytes + 1, --wire->count);
    return true;
}

static struct wire to_device;
static struct wire to_host;
static struct end device;
static struct end host;
static onebit_frame frame;
static uint64_t nanoseconds;

static void begin(unsigned capacity)
{
    to_device = (struct wire){.capacity = capacity};
    to_host = (struct wire){.capacity = capacity};
    device = (struct end){.out = &to_host, .in = &to_device};
    host = (struct end){.out = &to_device, .in = &to_host};
    const struct channel_hooks device_hooks = {&device, put, take};
    const struct channel_hooks host_hooks = {&host, put, take};
    channel_begin_device(&device.channel, &device_hooks);
    channel_begin_host(&host.channel, &host_hooks);
    device.transport = channel_transport(&device.channel);
    host.transport = channel_transport(&host.channel);
}

void setUp(void)
{
    begin(sizeof to_device.bytes);
}

void tearDown(void)
{
}

static enum transport_status send(struct end *end, const onebit_frame *sent)
{
    return end->transport.send(end->transport.context, sent);
}

static enum transport_status receive(struct end *end)
{
    return end->transport.receive(end->transport.context, &frame, &nanoseconds);
}

static void type(struct wire *wire, const char *text)
{
    while (*text != '\0') {
        wire->bytes[wire->count++] = (uint8_t)*text++;
    }
}

/* What a person at a terminal sees of the device: its answer to a text. */
static void check_answer(const char *text, const char *answer)
{
    type(&to_device, text);
    while (receive(&device) == TRANSPORT_DONE) {
    }
    char seen[sizeof to_host.bytes + 1] = {0};
    memcpy(seen, to_host.bytes, to_host.count);
    to_host.count = 0;
    TEST_ASSERT_EQUAL_STRING_MESSAGE(answer, seen, text);
}

static void check_frame(const onebit_frame *expected)
{
    TEST_ASSERT_EQUAL_HEX32(expected->identifier, frame.identifier);
    TEST_ASSERT_EQUAL_HEX8(expected->flags, frame.flags);
    TEST_ASSERT_EQUAL(expected->length, frame.length);
    TEST_ASSERT_EQUAL_HEX8_ARRAY(expected->data, frame.data, 8);
}

/* --- the device --- */

static void test_a_closed_device_takes_settings_and_no_frames(void)
{
    check_answer("\r\r\r", "");
    check_answer("V\r", "V0101\r");
    check_answer("N\r", "N0001\r");
    check_answer("S0\rS6\rS8\r", "\r\r\r");
    check_answer("S9\r", "\a");
    check_answer("s031C\r", "\r");
    check_answer("X1\rX0\r", "\r\a");
    check_answer("Z0\rZ1\rZ\r", "\r\a\a");
    check_answer("M00000000\rmFFFFFFFF\r", "\r\r");
    check_answer("M00000001\rmFFFFFFFE\r", "\a\a");
    check_answer("P\rA\rW0\rU1\rQ0\rz\r", "\a\a\a\a\a\a");
    check_answer("F\rF00\rV1013\r", "\a\a\a");
    check_answer("C\r", "\a");
    check_answer("t1001AB\rT000001000\rr1000\rR000001000\r", "\a\a\a\a");
    check_answer("nonsense\r", "\a");
    check_answer("\a", "");
    TEST_ASSERT_FALSE(device.channel.open);
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, receive(&device));
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, send(&device, &(onebit_frame){.identifier = 0x101}));
    TEST_ASSERT_EQUAL(21, device.channel.counts.refused);
    TEST_ASSERT_EQUAL(0, device.channel.counts.full);
}

static void test_an_open_device_takes_frames_and_no_settings(void)
{
    check_answer("O\r", "\r");
    TEST_ASSERT_TRUE(device.channel.open);
    check_answer("O\rL\r", "\a\a");
    check_answer("S6\rs031C\rX1\rZ0\rM00000000\rmFFFFFFFF\r", "\a\a\a\a\a\a");
    check_answer("F\rV\rN\r", "F00\rV0101\rN0001\r");
    check_answer("t1001AB\rr1000\r", "z\rz\r");
    check_answer("T000001000\rR000001000\r", "Z\rZ\r");
    check_answer("t8000\r", "\a");
    check_answer("C\r", "\r");
    TEST_ASSERT_FALSE(device.channel.open);
    check_answer("t1001AB\r", "\a");
    check_answer("O\rt1001AB\r", "\rz\r");
}

static void test_a_device_opened_to_listen_refuses_frames(void)
{
    check_answer("L\r", "\r");
    check_answer("t1001AB\r", "\a");
    check_answer("O\r", "\a"); /* and stays so */
    check_answer("t1001AB\r", "\a");
    TEST_ASSERT_EQUAL(TRANSPORT_DONE,
                      send(&device, &(onebit_frame){.identifier = 0x101, .length = 1}));
    check_answer("", "t101100\r");
    check_answer("C\rO\rt1001AB\r", "\r\rz\r");
}

static void test_a_frame_comes_with_the_time_of_its_last_byte(void)
{
    type(&to_device, "O\rt0801A");
    to_device.time = 5;
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, receive(&device));
    type(&to_device, "B\r");
    to_device.time = 7;
    nanoseconds = 0;
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, receive(&device));
    TEST_ASSERT_EQUAL(7, nanoseconds);
    check_frame(&(onebit_frame){.identifier = 0x080, .length = 1, .data = {0xAB}});
    /* Nothing waits: neither is touched. */
    nanoseconds = 3;
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, receive(&device));
    TEST_ASSERT_EQUAL(3, nanoseconds);
    check_frame(&(onebit_frame){.identifier = 0x080, .length = 1, .data = {0xAB}});
}

static void test_what_finds_no_room_is_told_and_counted(void)
{
    const onebit_frame sync = {.identifier = 0x080};
    begin(3);
    device.channel.open = true;
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, send(&device, &sync)); /* six characters, three still here */
    TEST_ASSERT_FALSE(channel_flush(&device.channel));
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, send(&device, &sync));
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, send(&device, &sync));
    TEST_ASSERT_EQUAL(2, device.channel.counts.full);
    to_host.count = 0;
    TEST_ASSERT_TRUE(channel_flush(&device.channel));
    TEST_ASSERT_EQUAL_MEMORY("00\r", to_host.bytes, 3);
    to_host.count = 0;
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, send(&device, &sync));
    to_host.count = 0;
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, send(&device, &(onebit_frame){.identifier = 0x800}));
    TEST_ASSERT_EQUAL(1, device.channel.counts.unsayable);
    TEST_ASSERT_EQUAL(2, device.channel.counts.full);
}

/* --- the host --- */

static void test_a_host_opens_and_closes(void)
{
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, send(&host, &(onebit_frame){.identifier = 0x080}));
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, receive(&host));
    TEST_ASSERT_TRUE(channel_open(&host.channel, 4));
    TEST_ASSERT_EQUAL(9, to_device.count);
    TEST_ASSERT_EQUAL_MEMORY("\r\rC\rS4\rO\r", to_device.bytes, 9);
    TEST_ASSERT_FALSE(host.channel.heard);
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, receive(&device));
    TEST_ASSERT_TRUE(device.channel.open);
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, receive(&host));
    TEST_ASSERT_TRUE(host.channel.heard);
    TEST_ASSERT_EQUAL(1, host.channel.counts.refused); /* C of a closed channel */
    /* A device that was open before is open again. */
    TEST_ASSERT_TRUE(channel_open(&host.channel, 6));
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, receive(&device));
    TEST_ASSERT_TRUE(device.channel.open);
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, receive(&host));
    TEST_ASSERT_EQUAL(1, host.channel.counts.refused);
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, send(&host, &(onebit_frame){.identifier = 0x080}));
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, send(&host, &(onebit_frame){.identifier = 0x80,
                                                                  .flags = ONEBIT_FRAME_EXTENDED}));
    TEST_ASSERT_TRUE(channel_ask_version(&host.channel));
    TEST_ASSERT_TRUE(channel_close(&host.channel));
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, receive(&device));
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, receive(&device));
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, receive(&device));
    TEST_ASSERT_FALSE(device.channel.open);
    type(&to_host, "t1011AB\r"); /* it was on its way */
    TEST_ASSERT_FALSE(host.channel.version_told);
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, receive(&host));
    TEST_ASSERT_EQUAL(0, to_host.count);
    TEST_ASSERT_TRUE(host.channel.version_told);
    TEST_ASSERT_TRUE(channel_ask_version(&host.channel));
    TEST_ASSERT_FALSE(host.channel.version_told);
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, send(&host, &(onebit_frame){.identifier = 0x080}));
}

static void test_a_host_that_cannot_speak_says_so(void)
{
    begin(4);
    TEST_ASSERT_TRUE(channel_open(&host.channel, 6));
    TEST_ASSERT_FALSE(channel_open(&host.channel, 6));
    TEST_ASSERT_FALSE(channel_close(&host.channel));
    TEST_ASSERT_FALSE(channel_ask_version(&host.channel));
    TEST_ASSERT_TRUE(host.channel.open);
}

static void test_a_host_takes_whatever_adapters_say(void)
{
    TEST_ASSERT_TRUE(channel_open(&host.channel, 6));
    /* Answers in the manual's form and others', a time stamp, an error report of newer ones. */
    type(&to_host, "\a\r\rV1013\rCANable-8f3a1 github.com/normaldotcom\rz\rZ\r\n");
    type(&to_host, "s0a000000\rt1011ABEA5F\r");
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, receive(&host));
    check_frame(&(onebit_frame){.identifier = 0x101, .length = 1, .data = {0xAB}});
    TEST_ASSERT_EQUAL(TRANSPORT_LATER, receive(&host));
    TEST_ASSERT_EQUAL(1, host.channel.counts.refused);
}

/* --- both --- */

/* xorshift32: a fixed sequence of test data. */
static uint32_t noise = 0x9E3779B9;
static uint32_t random_below(uint32_t limit)
{
    noise ^= noise << 13;
    noise ^= noise >> 17;
    noise ^= noise << 5;
    return noise % limit;
}

/* The k-th frame of a direction: every kind, length and many identifiers. */
static onebit_frame frame_number(uint32_t k, uint32_t direction)
{
    uint32_t word = (k + 1u) * 2654435761u + direction * 40503u;
    onebit_frame made = {.flags = (uint8_t)(word >> 30), .length = (uint8_t)(k % 9)};
    made.identifier = word & (made.flags & ONEBIT_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu);
    for (uint8_t byte = 0; byte < made.length && !(made.flags & ONEBIT_FRAME_REMOTE); ++byte) {
        made.data[byte] = (uint8_t)(word >> byte);
    }
    return made;
}

/*
 * Both ends are called in an order that is not fixed; a frame that is not taken is offered again.
 * In 64 calls a frame of either side makes its way or the two wait for each other.
 */
static void exchange(unsigned capacity, uint32_t count)
{
    struct end *ends[2] = {&device, &host};
    uint32_t sent[2] = {0, 0};
    uint32_t received[2] = {0, 0};
    begin(capacity);
    TEST_ASSERT_TRUE(channel_open(&host.channel, 6));
    for (uint32_t calls = 0; received[0] < count || received[1] < count; ++calls) {
        TEST_ASSERT_TRUE_MESSAGE(calls < 64 * 8 * (count + 16), "no frame gets through any more");
        uint32_t side = random_below(2);
        onebit_frame next = frame_number(sent[side], side);
        if (random_below(2) != 0) {
            /* A host speaks when it knows that the device is there, a device when it is open. */
            bool may = sent[side] < count && (side == 0 || device.channel.open);
            sent[side] += may && send(ends[side], &next) == TRANSPORT_DONE;
        } else if (receive(ends[side]) == TRANSPORT_DONE) {
            onebit_frame expected = frame_number(received[side], 1 - side);
            check_frame(&expected);
            ++received[side];
        }
    }
    for (int k = 0; k < SLCAN_DROPS; ++k) {
        TEST_ASSERT_EQUAL(0, device.channel.parser.dropped[k]);
        TEST_ASSERT_EQUAL(0, host.channel.parser.dropped[k]);
    }
    TEST_ASSERT_EQUAL(1, host.channel.counts.refused); /* C of a closed channel */
}

static void test_frames_pass_in_order_whatever_room_the_line_has(void)
{
    for (unsigned capacity = 1; capacity <= 40; ++capacity) {
        exchange(capacity, 500);
    }
    exchange(sizeof to_device.bytes, 20000);
}

/* After any noise, what is whole comes through, and what is not is answered by BEL. */
static void test_a_line_recovers_after_noise(void)
{
    check_answer("O\r", "\r");
    for (int round = 0; round < 2000; ++round) {
        for (uint32_t length = random_below(60); length > 0; --length) {
            /* No C among it, which would close the channel. */
            to_device.bytes[to_device.count++] = (uint8_t)(0x80u + random_below(0x80));
        }
        type(&to_device, "\rt1011AB\r");
        TEST_ASSERT_EQUAL(TRANSPORT_DONE, receive(&device));
        check_frame(&(onebit_frame){.identifier = 0x101, .length = 1, .data = {0xAB}});
        to_host.count = 0;
    }
}

/* --- what feeds them --- */

static void test_a_byte_queue_keeps_order_and_says_when_it_is_full(void)
{
    static struct byte_queue queue;
    uint8_t byte = 0xEE;
    uint8_t written = 0;
    uint8_t read = 0;
    TEST_ASSERT_FALSE(byte_queue_take(&queue, &byte));
    TEST_ASSERT_EQUAL_HEX8(0xEE, byte);
    /* From every place of the ring: fill it, then empty it. */
    for (unsigned round = 0; round < 2 * BYTE_QUEUE_SIZE; ++round) {
        for (unsigned k = 0; k < BYTE_QUEUE_SIZE - 1; ++k) {
            TEST_ASSERT_TRUE(byte_queue_put(&queue, written++));
        }
        TEST_ASSERT_FALSE(byte_queue_put(&queue, 0));
        for (unsigned k = 0; k < BYTE_QUEUE_SIZE - 1; ++k) {
            TEST_ASSERT_TRUE(byte_queue_take(&queue, &byte));
            TEST_ASSERT_EQUAL_HEX8(read++, byte);
        }
        TEST_ASSERT_FALSE(byte_queue_take(&queue, &byte));
    }
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_a_closed_device_takes_settings_and_no_frames);
    RUN_TEST(test_an_open_device_takes_frames_and_no_settings);
    RUN_TEST(test_a_device_opened_to_listen_refuses_frames);
    RUN_TEST(test_a_frame_comes_with_the_time_of_its_last_byte);
    RUN_TEST(test_what_finds_no_room_is_told_and_counted);
    RUN_TEST(test_a_host_opens_and_closes);
    RUN_TEST(test_a_host_that_cannot_speak_says_so);
    RUN_TEST(test_a_host_takes_whatever_adapters_say);
    RUN_TEST(test_frames_pass_in_order_whatever_room_the_line_has);
    RUN_TEST(test_a_line_recovers_after_noise);
    RUN_TEST(test_a_byte_queue_keeps_order_and_says_when_it_is_full);
    return UNITY_END();
}
