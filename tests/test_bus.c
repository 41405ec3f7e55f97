/* sim/bus.c: each promise of bus.h on its own, then random traffic against a bit-by-bit model. */
#include "bus.h"
#include "unity.h"
#include "wire.h"
#include "wire_reference.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

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

static onebit_frame standard(uint32_t identifier, uint8_t length)
{
    onebit_frame frame = {0};
    frame.identifier = identifier;
    frame.length = length;
    return frame;
}

/* The bus carries any frame as SYNC; this one without a counter has the same length in every step.
 */
static const onebit_frame sync_frame = {.identifier = 0x080};

static uint32_t sync_bits(void)
{
    return wire_bits(&sync_frame);
}

/* Receives all; the tags as decimal digits, so that orders can be written down. */
static uint32_t receive_all(struct bus *bus)
{
    uint32_t tags = 0;
    const onebit_frame *frame;
    uint32_t tag;
    while (bus_receive(bus, &frame, &tag)) {
        tags = 10u * tags + tag;
    }
    return tags;
}

static void send(struct bus *bus, onebit_frame frame, uint32_t tag)
{
    bus_send(bus, &frame, tag);
}

static void test_ideal_keeps_the_order_sent(void)
{
    struct bus *bus = bus_create(BUS_IDEAL, 500000, 1e-6, 4, NULL);
    uint32_t bits = 0;
    for (uint32_t step = 0; step < 3; step++) {
        bus_begin_step(bus, &sync_frame);
        send(bus, standard(0x300, 1), 1);
        send(bus, standard(0x100, 0), 2);
        send(bus, standard(0x200, 8), 3);
        TEST_ASSERT_EQUAL_UINT32(123, receive_all(bus));
        TEST_ASSERT_EQUAL_UINT32(0, receive_all(bus));
        onebit_frame frames[3] = {standard(0x300, 1), standard(0x100, 0), standard(0x200, 8)};
        bits += sync_bits() + wire_bits(&frames[0]) + wire_bits(&frames[1]) + wire_bits(&frames[2]);
    }
    const struct bus_traffic *traffic = bus_traffic(bus);
    TEST_ASSERT_EQUAL_UINT64(12, traffic->frames);
    TEST_ASSERT_EQUAL_UINT64(9, traffic->messages);
    TEST_ASSERT_EQUAL_UINT64(0, traffic->late_frames);
    TEST_ASSERT_EQUAL_UINT64(bits, traffic->wire_bits);
    TEST_ASSERT_EQUAL_DOUBLE(0, traffic->latency_sum);
    TEST_ASSERT_EQUAL_DOUBLE(0, traffic->latency_max);
    bus_free(bus);
}

static void test_frame_and_tag_come_back_unchanged(void)
{
    for (int model = BUS_IDEAL; model <= BUS_CAN; model++) {
        struct bus *bus = bus_create((enum bus_model)model, 500000, 1, 1, NULL);
        onebit_frame sent = {0x1ABCDEF5, ONEBIT_FRAME_EXTENDED, 8, {1, 2, 3, 4, 5, 6, 7, 8}};
        onebit_frame copy = sent;
        bus_begin_step(bus, &sync_frame);
        bus_send(bus, &copy, 0xFEDCBA98u);
        memset(&copy, 0, sizeof copy);
        const onebit_frame *frame;
        uint32_t tag;
        TEST_ASSERT_TRUE(bus_receive(bus, &frame, &tag));
        TEST_ASSERT_EQUAL_HEX32(0xFEDCBA98u, tag);
        TEST_ASSERT_EQUAL_HEX32(sent.identifier, frame->identifier);
        TEST_ASSERT_EQUAL_HEX8(sent.flags, frame->flags);
        TEST_ASSERT_EQUAL_UINT8(sent.length, frame->length);
        TEST_ASSERT_EQUAL_HEX8_ARRAY(sent.data, frame->data, 8);
        TEST_ASSERT_FALSE(bus_receive(bus, &frame, &tag));
        bus_free(bus);
    }
}

static void test_lowest_identifier_wins(void)
{
    struct bus *bus = bus_create(BUS_CAN, 500000, 1, 8, NULL);
    bus_begin_step(bus, &sync_frame);
    send(bus, standard(0x300, 1), 3);
    send(bus, standard(0x100, 1), 1);
    send(bus, standard(0x7EF, 1), 4);
    send(bus, standard(0x200, 1), 2);
    TEST_ASSERT_EQUAL_UINT32(1234, receive_all(bus));
    bus_begin_step(bus, &sync_frame);
    send(bus, standard(0x100, 1), 1);
    send(bus, standard(0x200, 1), 2);
    TEST_ASSERT_EQUAL_UINT32(12, receive_all(bus));
    bus_free(bus);
}

/* Of frames with the same 11 bits: standard data, standard remote, extended data, extended remote.
 */
static void test_standard_wins_over_extended_and_data_over_remote(void)
{
    struct bus *bus = bus_create(BUS_CAN, 500000, 1, 8, NULL);
    onebit_frame frame = {0};
    bus_begin_step(bus, &sync_frame);
    frame.identifier = 0x123u << 18;
    frame.flags = ONEBIT_FRAME_EXTENDED | ONEBIT_FRAME_REMOTE;
    bus_send(bus, &frame, 5);
    frame.flags = ONEBIT_FRAME_EXTENDED;
    bus_send(bus, &frame, 4);
    frame.identifier = 0x123;
    frame.flags = ONEBIT_FRAME_REMOTE;
    bus_send(bus, &frame, 3);
    frame.flags = 0;
    bus_send(bus, &frame, 2);
    frame.identifier = (0x122u << 18) + 0x3FFFF;
    frame.flags = ONEBIT_FRAME_EXTENDED;
    bus_send(bus, &frame, 1);
    TEST_ASSERT_EQUAL_UINT32(12345, receive_all(bus));
    bus_free(bus);
}

static void test_equal_identifiers_go_in_the_order_sent(void)
{
    struct bus *bus = bus_create(BUS_CAN, 500000, 1, 8, NULL);
    bus_begin_step(bus, &sync_frame);
    for (uint32_t tag = 1; tag <= 8; tag++) {
        send(bus, standard(tag == 1 ? 0x101 : 0x100, 0), tag);
    }
    TEST_ASSERT_EQUAL_UINT32(23456781, receive_all(bus));
    bus_free(bus);
}

/*
 * A frame that would start at the period's last bit time starts; one bit later it is withdrawn.
 * Bit rate 1000: a period of k/1000 s has k bit times.
 */
static void test_period_ends_before_the_next_begins(void)
{
    onebit_frame first = standard(0x100, 1);
    uint32_t before = sync_bits() + wire_bits(&first); /* the second frame's start */
    for (uint32_t late = 0; late <= 1; late++) {
        double period = (before + (late ? 0u : 1u)) / 1000.0;
        struct bus *bus = bus_create(BUS_CAN, 1000, period, 8, NULL);
        bus_begin_step(bus, &sync_frame);
        send(bus, first, 1);
        send(bus, standard(0x101, 1), 2);
        send(bus, standard(0x102, 1), 3);
        TEST_ASSERT_EQUAL_UINT32(late ? 1 : 12, receive_all(bus));
        TEST_ASSERT_EQUAL_UINT64(late ? 2 : 1, bus_traffic(bus)->late_frames);
        TEST_ASSERT_EQUAL_UINT64(late ? 1 : 2, bus_traffic(bus)->messages);
        TEST_ASSERT_EQUAL_UINT64(late ? 2 : 3, bus_traffic(bus)->frames);
        bus_free(bus);
    }
}

static void test_what_is_not_received_is_withdrawn_once(void)
{
    struct bus *bus = bus_create(BUS_CAN, 500000, 1, 8, NULL);
    const onebit_frame *frame;
    uint32_t tag;
    bus_begin_step(bus, &sync_frame);
    send(bus, standard(0x100, 1), 1);
    send(bus, standard(0x101, 1), 2);
    TEST_ASSERT_TRUE(bus_receive(bus, &frame, &tag));
    bus_begin_step(bus, &sync_frame);
    TEST_ASSERT_EQUAL_UINT64(1, bus_traffic(bus)->late_frames);
    TEST_ASSERT_FALSE(bus_receive(bus, &frame, &tag));
    TEST_ASSERT_FALSE(bus_receive(bus, &frame, &tag));
    TEST_ASSERT_EQUAL_UINT64(1, bus_traffic(bus)->late_frames);
    bus_free(bus);
}

/* A message on the wire at the period's end completes; SYNC waits for it, and so do its messages.
 */
static void test_overrun_delays_sync_and_latency_counts_from_it(void)
{
    onebit_frame message = standard(0x100, 8);
    uint32_t sync = sync_bits();
    uint32_t bits = wire_bits(&message);
    uint32_t period = sync + 10; /* the message starts 10 bits before the end */
    struct bus *bus = bus_create(BUS_CAN, 1000, period / 1000.0, 1, NULL);
    bus_begin_step(bus, &sync_frame);
    bus_send(bus, &message, 1);
    TEST_ASSERT_EQUAL_UINT32(1, receive_all(bus));
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, (bits - 3) / 1000.0, bus_traffic(bus)->latency_max);

    /* Free again at sync + bits > 2 periods - 1: this SYNC has no bit time to start at. */
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(2 * period, sync + bits);
    bus_begin_step(bus, &sync_frame);
    bus_send(bus, &message, 1);
    TEST_ASSERT_EQUAL_UINT32(0, receive_all(bus));
    TEST_ASSERT_EQUAL_UINT64(2, bus_traffic(bus)->late_frames); /* SYNC and the message */

    /* The third starts late, and its message finds no time left. */
    uint32_t start = sync + bits;
    TEST_ASSERT_LESS_THAN_UINT32(3 * period, start);
    TEST_ASSERT_GREATER_OR_EQUAL_UINT32(3 * period, start + sync);
    bus_begin_step(bus, &sync_frame);
    bus_send(bus, &message, 1);
    TEST_ASSERT_EQUAL_UINT32(0, receive_all(bus));
    TEST_ASSERT_EQUAL_UINT64(3, bus_traffic(bus)->late_frames);
    TEST_ASSERT_EQUAL_UINT64(3, bus_traffic(bus)->frames);
    TEST_ASSERT_EQUAL_UINT64(2u * sync + bits, bus_traffic(bus)->wire_bits);
    bus_free(bus);
}

/* From the end of SYNC's interframe space to the end of each frame, without its interframe space.
 */
static void test_latency(void)
{
    onebit_frame frames[3] = {standard(0x100, 1), standard(0x200, 8), standard(0x300, 0)};
    struct bus *bus = bus_create(BUS_CAN, 250000, 0.25, 3, NULL);
    double sum = 0;
    double end = 0;
    for (uint32_t step = 0; step < 5; step++) {
        bus_begin_step(bus, &sync_frame);
        end = 0;
        for (uint32_t k = 0; k < 3; k++) {
            bus_send(bus, &frames[k], k + 1);
            end += wire_bits(&frames[k]);
            sum += end - 3;
        }
        TEST_ASSERT_EQUAL_UINT32(123, receive_all(bus));
    }
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, sum / 250000, bus_traffic(bus)->latency_sum);
    TEST_ASSERT_DOUBLE_WITHIN(1e-12, (end - 3) / 250000, bus_traffic(bus)->latency_max);
    bus_free(bus);
}

/* A bus that always has more to send than fits is never idle: every bit time is in wire_bits. */
static void test_load_of_a_full_bus_is_one(void)
{
    uint32_t steps = 1000;
    uint32_t period = 1000;
    struct bus *bus = bus_create(BUS_CAN, 10000, period / 10000.0, 30, NULL);
    for (uint32_t step = 0; step < steps; step++) {
        bus_begin_step(bus, &sync_frame);
        for (uint32_t k = 0; k < 30; k++) {
            send(bus, standard(0x100 + random_word() % 512u, 1), 0);
        }
        receive_all(bus);
    }
    const struct bus_traffic *traffic = bus_traffic(bus);
    TEST_ASSERT_TRUE(traffic->wire_bits >= (uint64_t)steps * period);
    TEST_ASSERT_TRUE(traffic->wire_bits < (uint64_t)steps * period + 63u);
    TEST_ASSERT_EQUAL_UINT64(31u * steps, traffic->frames + traffic->late_frames);
    bus_free(bus);
}

/* Where period times bit rate is no whole number, steps begin at the nearest bit time, for ever. */
static void test_period_of_a_fraction_of_bits(void)
{
    onebit_frame message = standard(0x100, 1);
    uint32_t before = sync_bits();
    /* Room for SYNC and a third of a bit: steps begin at 0, S, 2 S + 1, 3 S + 1 of S bits of SYNC.
     */
    double period = (before + 1.0 / 3) / 1000;
    struct bus *bus = bus_create(BUS_CAN, 1000, period, 1, NULL);
    for (uint32_t step = 0; step < 3; step++) {
        bus_begin_step(bus, &sync_frame);
        bus_send(bus, &message, 1);
        /* So in the second step alone there is a bit time left for the message to start. */
        TEST_ASSERT_EQUAL_UINT32(step == 1 ? 1 : 0, receive_all(bus));
    }
    bus_free(bus);
}

static void read_file(const char *path, char *text, size_t size)
{
    FILE *file = fopen(path, "r");
    TEST_ASSERT_NOT_NULL(file);
    size_t length = fread(text, 1, size - 1, file);
    text[length] = '\0';
    fclose(file);
}

/* Completed frames alone stand in the log: can with the time of their end, ideal with the step's.
 */
static void test_log_has_completed_frames_with_their_times(void)
{
    for (int model = BUS_IDEAL; model <= BUS_CAN; model++) {
        char folder[] = "/tmp/test_bus.XXXXXX";
        char path[64];
        char text[1024];
        char expected[1024];
        struct problem problem;
        TEST_ASSERT_NOT_NULL(mkdtemp(folder));
        snprintf(path, sizeof path, "%s/bus.log", folder);
        struct log_writer *log = log_writer_open(path, &problem);
        TEST_ASSERT_NOT_NULL(log);
        onebit_frame message = standard(0x101, 1);
        message.data[0] = 0x2B;
        uint32_t sync = sync_bits();
        uint32_t bits = wire_bits(&message);
        uint32_t period = 2 * sync;
        struct bus *bus = bus_create((enum bus_model)model, 1000, period / 1000.0, 2, log);
        bus_begin_step(bus, &sync_frame);
        bus_send(bus, &message, 1);
        send(bus, standard(0x102, 0), 2); /* can: too late */
        receive_all(bus);
        bus_begin_step(bus, &sync_frame);
        receive_all(bus);
        bus_free(bus);
        TEST_ASSERT_TRUE(log_writer_commit(log, &problem));
        read_file(path, text, sizeof text);
        if (model == BUS_IDEAL) {
            snprintf(expected, sizeof expected,
                     "(0000000000.000000) vcan0 080#\n(0000000000.000000) vcan0 101#2B\n"
                     "(0000000000.000000) vcan0 102#\n(0000000000.%06u) vcan0 080#\n",
                     (unsigned)period * 1000u);
        } else {
            snprintf(expected, sizeof expected,
                     "(0000000000.%06u) vcan0 080#\n(0000000000.%06u) vcan0 101#2B\n"
                     "(0000000000.%06u) vcan0 080#\n",
                     (unsigned)(sync - 3) * 1000u, (unsigned)(sync + bits - 3) * 1000u,
                     (unsigned)(sync + bits + sync - 3) * 1000u);
        }
        TEST_ASSERT_EQUAL_STRING(expected, text);
        unlink(path);
        rmdir(folder);
    }
}

/*
 * The model to compare with: time goes on bit by bit; at each one the period may end, then, if the
 * wire is free, the best of the frames that are waiting goes onto it.
 */
#define MODEL_MESSAGES 8u
#define MODEL_STEPS 200u

struct model_step {
    onebit_frame frames[MODEL_MESSAGES];
    uint32_t count;
    uint32_t heard[MODEL_MESSAGES];
    uint32_t heard_count;
};

struct model {
    struct model_step steps[MODEL_STEPS];
    uint64_t frames, late, bits, messages;
    double latency_sum, latency_max;
};

static void model_run(struct model *model, uint32_t period)
{
    struct model_step *step = NULL;
    bool waiting[MODEL_MESSAGES] = {false};
    bool sync_waiting = false;
    bool sync_done = false;
    uint32_t idle_at = 0;
    uint32_t sync_over = 0;
    for (uint32_t now = 0; now <= MODEL_STEPS * period; now++) {
        if (now % period == 0) {
            model->late += sync_waiting;
            for (uint32_t k = 0; step != NULL && k < step->count; k++) {
                model->late += waiting[k];
            }
            if (now == MODEL_STEPS * period) {
                return;
            }
            step = &model->steps[now / period];
            for (uint32_t k = 0; k < step->count; k++) {
                waiting[k] = true;
            }
            sync_waiting = true;
            sync_done = false;
        }
        if (now < idle_at) {
            continue;
        }
        if (sync_waiting) {
            sync_waiting = false;
            sync_done = true;
            idle_at = now + wire_bits(&sync_frame);
            sync_over = idle_at;
            model->frames++;
            model->bits += wire_bits(&sync_frame);
            continue;
        }
        uint32_t best = MODEL_MESSAGES;
        for (uint32_t k = 0; sync_done && k < step->count; k++) {
            if (waiting[k] &&
                (best == MODEL_MESSAGES ||
                 wire_arbitration(&step->frames[k]) < wire_arbitration(&step->frames[best]))) {
                best = k;
            }
        }
        if (best < MODEL_MESSAGES) {
            waiting[best] = false;
            idle_at = now + wire_bits(&step->frames[best]);
            double latency = idle_at - 3 - sync_over;
            model->latency_sum += latency;
            model->latency_max = fmax(model->latency_max, latency);
            model->frames++;
            model->messages++;
            model->bits += wire_bits(&step->frames[best]);
            step->heard[step->heard_count++] = best;
        }
    }
}

static void test_equals_bit_by_bit_model(void)
{
    static struct model model;
    uint64_t late = 0;
    uint64_t heard = 0;
    for (uint32_t round = 0; round < 300; round++) {
        memset(&model, 0, sizeof model);
        uint32_t period = 20u + random_word() % (round % 3u == 0 ? 100u : 900u);
        for (uint32_t s = 0; s < MODEL_STEPS; s++) {
            model.steps[s].count = random_word() % (MODEL_MESSAGES + 1u);
            for (uint32_t k = 0; k < model.steps[s].count; k++) {
                model.steps[s].frames[k] = wire_reference_frame(random_word);
            }
        }
        model_run(&model, period);
        struct bus *bus = bus_create(BUS_CAN, 8000, period / 8000.0, MODEL_MESSAGES, NULL);
        for (uint32_t s = 0; s < MODEL_STEPS; s++) {
            struct model_step *step = &model.steps[s];
            bus_begin_step(bus, &sync_frame);
            for (uint32_t k = 0; k < step->count; k++) {
                bus_send(bus, &step->frames[k], k);
            }
            const onebit_frame *frame;
            uint32_t tag;
            for (uint32_t k = 0; k < step->heard_count; k++) {
                TEST_ASSERT_TRUE(bus_receive(bus, &frame, &tag));
                TEST_ASSERT_EQUAL_UINT32(step->heard[k], tag);
                TEST_ASSERT_EQUAL_HEX32(step->frames[tag].identifier, frame->identifier);
            }
            TEST_ASSERT_FALSE(bus_receive(bus, &frame, &tag));
        }
        const struct bus_traffic *traffic = bus_traffic(bus);
        TEST_ASSERT_EQUAL_UINT64(model.frames, traffic->frames);
        TEST_ASSERT_EQUAL_UINT64(model.late, traffic->late_frames);
        TEST_ASSERT_EQUAL_UINT64(model.bits, traffic->wire_bits);
        TEST_ASSERT_EQUAL_UINT64(model.messages, traffic->messages);
        TEST_ASSERT_DOUBLE_WITHIN(1e-6, model.latency_sum / 8000, traffic->latency_sum);
        TEST_ASSERT_DOUBLE_WITHIN(1e-9, model.latency_max / 8000, traffic->latency_max);
        late += model.late;
        heard += model.messages;
        bus_free(bus);
    }
    /* The random traffic was of use only if much of it was heard and much was late. */
    TEST_ASSERT_TRUE(late > 30000);
    TEST_ASSERT_TRUE(heard > 30000);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_ideal_keeps_the_order_sent);
    RUN_TEST(test_frame_and_tag_come_back_unchanged);
    RUN_TEST(test_lowest_identifier_wins);
    RUN_TEST(test_standard_wins_over_extended_and_data_over_remote);
    RUN_TEST(test_equal_identifiers_go_in_the_order_sent);
    RUN_TEST(test_period_ends_before_the_next_begins);
    RUN_TEST(test_what_is_not_received_is_withdrawn_once);
    RUN_TEST(test_overrun_delays_sync_and_latency_counts_from_it);
    RUN_TEST(test_latency);
    RUN_TEST(test_load_of_a_full_bus_is_one);
    RUN_TEST(test_period_of_a_fraction_of_bits);
    RUN_TEST(test_log_has_completed_frames_with_their_times);
    RUN_TEST(test_equals_bit_by_bit_model);
    return UNITY_END();
}
