/*
 * The port to a CAN controller (ports/can-controller/) on a controller made here: three receive
 * places, a few mailboxes, a bus where the lowest identifier wins, and a receive interrupt that
 * comes between any two calls of its hooks, or waits while it is locked out.
 */
#include "can_controller.h"
#include "onebit_random.h"
#include "step_loop.h"

#include <string.h>
#include <unity.h>

#define RECEIVE_PLACES 3u
#define MAILBOXES 3u
#define QUEUE 8u
#define TICK 1000u /* nanoseconds */

struct chip {
    struct can_controller *can;
    uint32_t ticks;
    bool off;
    bool stuck; /* says for ever that a frame waits */

    onebit_frame received[RECEIVE_PLACES];
    unsigned received_count;
    uint32_t overrun;
    bool stamps;    /* has a clock of its own for frames ... */
    uint32_t stamp; /* ... which said this */
    bool locked;
    bool pending;
    bool in_interrupt;

    onebit_frame mailbox[MAILBOXES]; /* in the order in which they were filled */
    unsigned mailbox_count;
    unsigned mailboxes; /* there are at most */
    bool first_on_wire;

    /* A frame that arrives during hook call number `due`. */
    unsigned calls;
    unsigned due;
    onebit_frame surprise;
};

static struct chip chip;
static struct can_controller can;
static struct frame_queue_entry entries[QUEUE];
static struct transport transport;

static void interrupt(void)
{
    if (chip.locked) {
        chip.pending = true;
    } else {
        chip.in_interrupt = true;
        can_controller_interrupt(&can);
        chip.in_interrupt = false;
    }
}

static void arrive(const onebit_frame *frame)
{
    if (chip.received_count == RECEIVE_PLACES) {
        ++chip.overrun;
    } else {
        chip.received[chip.received_count++] = *frame;
    }
    interrupt();
}

/* Between any two things that the step loop does with the controller. */
static void between(void)
{
    if (++chip.calls == chip.due) {
        arrive(&chip.surprise);
    }
}

/* --- the hooks --- */

static bool chip_send(void *context, const onebit_frame *frame)
{
    TEST_ASSERT_EQUAL_PTR(&chip, context);
    between();
    bool room = chip.mailbox_count < chip.mailboxes;
    if (room) {
        chip.mailbox[chip.mailbox_count++] = *frame;
    }
    between();
    return room;
}

static uint32_t chip_withdraw(void *context)
{
    (void)context;
    between();
    unsigned kept = chip.first_on_wire && chip.mailbox_count != 0 ? 1 : 0;
    unsigned count = chip.mailbox_count - kept;
    chip.mailbox_count = kept;
    between();
    return count;
}

static bool chip_bus_off(void *context)
{
    (void)context;
    between();
    return chip.off;
}

static bool chip_receive(void *context, onebit_frame *frame, uint32_t *ticks)
{
    TEST_ASSERT_EQUAL_PTR(&chip, context);
    if (chip.stuck) {
        *frame = (onebit_frame){.identifier = 0x101};
        return true;
    }
    if (chip.received_count == 0) {
        return false;
    }
    *frame = chip.received[0];
    memmove(chip.received, chip.received + 1, --chip.received_count * sizeof *chip.received);
    if (chip.stamps) {
        *ticks = chip.stamp;
    }
    return true;
}

static uint32_t chip_overrun(void *context)
{
    (void)context;
    uint32_t count = chip.overrun;
    chip.overrun = 0;
    return count;
}

static uint32_t chip_ticks(void *context)
{
    (void)context;
    if (!chip.in_interrupt) {
        between();
    }
    return chip.ticks;
}

static void chip_lock(void *context)
{
    (void)context;
    TEST_ASSERT_FALSE(chip.locked); /* not nested */
    between();
    chip.locked = true;
    between();
}

static void chip_unlock(void *context)
{
    (void)context;
    between();
    TEST_ASSERT_TRUE(chip.locked);
    chip.locked = false;
    if (chip.pending) {
        chip.pending = false;
        interrupt();
    }
}

static const struct controller controller = {
    .context = &chip,
    .send = chip_send,
    .withdraw = chip_withdraw,
    .bus_off = chip_bus_off,
    .receive = chip_receive,
    .overrun = chip_overrun,
    .ticks = chip_ticks,
    .nanoseconds_per_tick = TICK,
    .lock = chip_lock,
    .unlock = chip_unlock,
};

void setUp(void)
{
    chip = (struct chip){.mailboxes = MAILBOXES, .ticks = 0xFFFFFF00u};
    TEST_ASSERT_TRUE(can_controller_start(&can, &controller, entries, QUEUE));
    transport = can_controller_transport(&can);
}

void tearDown(void)
{
}

static onebit_frame frame_of(uint32_t identifier)
{
    return (onebit_frame){.identifier = identifier, .length = 1, .data = {(uint8_t)identifier}};
}

static void arrive_identifier(uint32_t identifier)
{
    onebit_frame frame = frame_of(identifier);
    arrive(&frame);
}

/* The identifier of the next frame out of the port; its status where there is none. */
static uint32_t next_identifier(uint64_t *time)
{
    onebit_frame frame = {.identifier = 0xDEAD};
    uint64_t ignored = 0xDEAD;
    time = time == NULL ? &ignored : time;
    uint64_t before = *time;
    enum transport_status status = transport.receive(transport.context, &frame, time);
    if (status != TRANSPORT_DONE) {
        TEST_ASSERT_EQUAL_HEX32(0xDEAD, frame.identifier);
        TEST_ASSERT_EQUAL_UINT64(before, *time);
        return status;
    }
    TEST_ASSERT_EQUAL_UINT8((uint8_t)frame.identifier, frame.data[0]);
    return frame.identifier;
}

/* --- the queue --- */

static void test_queue_sizes(void)
{
    struct frame_queue_entry one;
    struct frame_queue queue;
    for (unsigned count = 0; count <= 300; ++count) {
        bool power = count == 1 || count == 2 || count == 4 || count == 8 || count == 16 ||
                     count == 32 || count == 64 || count == 128;
        TEST_ASSERT_EQUAL(power, frame_queue_start(&queue, &one, count));
        TEST_ASSERT_EQUAL(power, can_controller_start(&can, &controller, &one, count));
    }
}

/* Against a count of what went in and out: order, contents, room; round the index many times. */
static void test_queue_keeps_order(void)
{
    static struct frame_queue_entry many[FRAME_QUEUE_MAX];
    for (unsigned count = 1; count <= FRAME_QUEUE_MAX; count *= 2) {
        struct frame_queue queue;
        uint32_t in = 0;
        uint32_t out = 0;
        TEST_ASSERT_TRUE(frame_queue_start(&queue, many, count));
        for (uint32_t k = 0; k < 5000; ++k) {
            uint32_t word = onebit_random_word(1, count, 0, k);
            for (uint32_t puts = word % (2 * count + 1); puts != 0; --puts) {
                struct frame_queue_entry *entry = frame_queue_room(&queue);
                TEST_ASSERT_EQUAL(in - out < count, entry != NULL);
                if (entry != NULL) {
                    entry->ticks = in;
                    entry->frame.identifier = ~in++;
                    frame_queue_put(&queue);
                }
            }
            for (uint32_t takes = (word >> 16) % (2 * count + 1); takes != 0; --takes) {
                const struct frame_queue_entry *entry = frame_queue_oldest(&queue);
                TEST_ASSERT_EQUAL(in != out, entry != NULL);
                if (entry != NULL) {
                    TEST_ASSERT_EQUAL_UINT32(out, entry->ticks);
                    TEST_ASSERT_EQUAL_HEX32(~out++, entry->frame.identifier);
                    frame_queue_drop(&queue);
                }
            }
        }
        TEST_ASSERT_TRUE(out > 1000);
    }
}

/* --- the port --- */

static void test_frames_come_in_order_and_as_they_were(void)
{
    TEST_ASSERT_EQUAL_HEX32(TRANSPORT_LATER, next_identifier(NULL));
    for (uint32_t k = 0; k < QUEUE; ++k) {
        TEST_ASSERT_EQUAL(k != 0, can_controller_waiting(&can));
        arrive_identifier(0x100 + k);
    }
    for (uint32_t k = 0; k < QUEUE; ++k) {
        TEST_ASSERT_EQUAL_HEX32(0x100 + k, next_identifier(NULL));
    }
    TEST_ASSERT_FALSE(can_controller_waiting(&can));
    const onebit_frame odd = {
        .identifier = 0x1ABCDEF0,
        .flags = ONEBIT_FRAME_EXTENDED | ONEBIT_FRAME_REMOTE,
        .length = 8,
        .data = {1, 2, 3, 4, 5, 6, 7, 8},
    };
    onebit_frame frame;
    uint64_t time;
    arrive(&odd);
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, transport.receive(transport.context, &frame, &time));
    TEST_ASSERT_EQUAL_MEMORY(&odd, &frame, sizeof frame);
}

/* The time is when the frame came, whenever it is asked for, and does not wrap with the ticks. */
static void test_time(void)
{
    uint64_t begun = can_controller_now(&can);
    uint64_t time = 0;
    chip.ticks += 200;
    arrive_identifier(0x101);
    chip.ticks += 100; /* past 2^32 */
    arrive_identifier(0x102);
    chip.ticks += 4000000000u;
    TEST_ASSERT_EQUAL_HEX32(0x101, next_identifier(&time));
    TEST_ASSERT_EQUAL_UINT64(begun + 200u * TICK, time);
    TEST_ASSERT_EQUAL_HEX32(0x102, next_identifier(&time));
    TEST_ASSERT_EQUAL_UINT64(begun + 300u * TICK, time);
    for (unsigned k = 0; k < 5; ++k) {
        chip.ticks += 4000000000u;
        TEST_ASSERT_EQUAL_HEX32(TRANSPORT_LATER, next_identifier(NULL));
    }
    TEST_ASSERT_EQUAL_UINT64(begun + (6 * 4000000000ull + 300u) * TICK, can_controller_now(&can));

    /* A chip that stamps frames itself knows better than the interrupt, even from before it ran. */
    chip.stamps = true;
    chip.stamp = chip.ticks - 70;
    arrive_identifier(0x103);
    TEST_ASSERT_EQUAL_HEX32(0x103, next_identifier(&time));
    TEST_ASSERT_EQUAL_UINT64(can_controller_now(&can) - 70u * TICK, time);
}

static void test_time_of_a_frame_older_than_the_start(void)
{
    uint64_t time = 0;
    chip.stamps = true;
    chip.stamp = chip.ticks - 5;
    arrive_identifier(0x101);
    TEST_ASSERT_EQUAL_HEX32(0x101, next_identifier(&time));
    TEST_ASSERT_EQUAL_UINT64(can_controller_now(&can) - 5u * TICK, time);
    TEST_ASSERT_TRUE(time < can_controller_now(&can)); /* nor does it wrap below 0 */
}

static void test_full_queue_keeps_what_is_older_and_counts(void)
{
    struct can_controller_counts counts;
    for (uint32_t k = 0; k < QUEUE + 5; ++k) {
        arrive_identifier(0x100 + k);
    }
    TEST_ASSERT_EQUAL_HEX32(0x100, next_identifier(NULL));
    arrive_identifier(0x200);
    for (uint32_t k = 1; k < QUEUE; ++k) {
        TEST_ASSERT_EQUAL_HEX32(0x100 + k, next_identifier(NULL));
    }
    TEST_ASSERT_EQUAL_HEX32(0x200, next_identifier(NULL));
    TEST_ASSERT_EQUAL_HEX32(TRANSPORT_LATER, next_identifier(NULL));
    can_controller_counts(&can, &counts);
    TEST_ASSERT_EQUAL_UINT32(QUEUE + 1, counts.received);
    TEST_ASSERT_EQUAL_UINT32(5, counts.lost);
}

static void test_what_the_chip_lost_is_counted(void)
{
    struct can_controller_counts counts;
    chip.locked = true;
    for (uint32_t k = 0; k < RECEIVE_PLACES + 4; ++k) {
        arrive_identifier(0x100 + k);
    }
    TEST_ASSERT_FALSE(can_controller_waiting(&can));
    chip_unlock(&chip);
    for (uint32_t k = 0; k < RECEIVE_PLACES; ++k) {
        TEST_ASSERT_EQUAL_HEX32(0x100 + k, next_identifier(NULL));
    }
    can_controller_counts(&can, &counts);
    TEST_ASSERT_EQUAL_UINT32(RECEIVE_PLACES, counts.received);
    TEST_ASSERT_EQUAL_UINT32(4, counts.lost);
}

static void test_interrupt_ends_whatever_the_chip_says(void)
{
    struct can_controller_counts counts;
    chip.stuck = true;
    can_controller_interrupt(&can);
    can_controller_interrupt(&can);
    can_controller_counts(&can, &counts);
    TEST_ASSERT_EQUAL_UINT32(QUEUE, counts.received);
    TEST_ASSERT_EQUAL_UINT32(QUEUE, counts.lost);
}

static void test_reports_of_the_controller(void)
{
    struct can_controller_counts counts;
    onebit_frame report = {.identifier = 0x20, .flags = ONEBIT_FRAME_ERROR, .length = 8};
    onebit_frame frame;
    uint64_t time;
    arrive(&report);
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, transport.receive(transport.context, &frame, &time));
    TEST_ASSERT_EQUAL_MEMORY(&report, &frame, sizeof frame);
    can_controller_counts(&can, &counts);
    TEST_ASSERT_EQUAL_UINT32(1, counts.error_frames);
    TEST_ASSERT_EQUAL_UINT32(1, counts.received);
}

static void test_mailboxes(void)
{
    struct can_controller_counts counts;
    for (uint32_t k = 0; k < MAILBOXES + 2; ++k) {
        onebit_frame frame = frame_of(0x300 - k);
        TEST_ASSERT_EQUAL(k < MAILBOXES ? TRANSPORT_DONE : TRANSPORT_LATER,
                          transport.send(transport.context, &frame));
    }
    for (uint32_t k = 0; k < MAILBOXES; ++k) {
        TEST_ASSERT_EQUAL_HEX32(0x300 - k, chip.mailbox[k].identifier);
    }
    chip.first_on_wire = true;
    TEST_ASSERT_EQUAL_UINT32(MAILBOXES - 1, transport.withdraw(transport.context));
    TEST_ASSERT_EQUAL_UINT(1, chip.mailbox_count);
    can_controller_counts(&can, &counts);
    TEST_ASSERT_EQUAL_UINT32(MAILBOXES, counts.sent);
    TEST_ASSERT_EQUAL_UINT32(2, counts.mailbox_full);
    TEST_ASSERT_EQUAL_UINT32(MAILBOXES - 1, counts.withdrawn);
}

static void test_bus_off(void)
{
    struct can_controller_counts counts;
    onebit_frame frame = frame_of(0x101);
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, transport.send(transport.context, &frame));
    arrive_identifier(0x102);
    chip.off = true;
    /* What came before is still heard. */
    TEST_ASSERT_EQUAL_HEX32(0x102, next_identifier(NULL));
    TEST_ASSERT_EQUAL_HEX32(TRANSPORT_DOWN, next_identifier(NULL));
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, transport.send(transport.context, &frame));
    TEST_ASSERT_EQUAL_UINT(0, chip.mailbox_count); /* it would leave in another step */
    chip.off = false;
    TEST_ASSERT_EQUAL_HEX32(TRANSPORT_LATER, next_identifier(NULL));
    TEST_ASSERT_EQUAL(TRANSPORT_DONE, transport.send(transport.context, &frame));
    chip.off = true;
    TEST_ASSERT_EQUAL(TRANSPORT_DOWN, transport.send(transport.context, &frame));
    can_controller_counts(&can, &counts);
    TEST_ASSERT_EQUAL_UINT32(2, counts.went_off);
    TEST_ASSERT_EQUAL_UINT32(2, counts.sent);
    TEST_ASSERT_EQUAL_UINT32(2, counts.withdrawn);
    TEST_ASSERT_EQUAL_UINT32(0, counts.mailbox_full);
}

/* A frame that comes during any of its hook calls is neither in one counter nor in the other. */
static void test_counters_belong_to_one_moment(void)
{
    for (unsigned due = 1; due <= 3; ++due) {
        struct can_controller_counts counts;
        setUp();
        chip.calls = 0;
        chip.due = due;
        chip.surprise =
            (onebit_frame){.identifier = 0x20, .flags = ONEBIT_FRAME_ERROR, .length = 8};
        can_controller_counts(&can, &counts);
        TEST_ASSERT_EQUAL_UINT32(due == 1, counts.received);
        TEST_ASSERT_EQUAL_UINT32(counts.received, counts.error_frames);
        TEST_ASSERT_TRUE(can_controller_waiting(&can));
    }
}

/* --- the loop --- */

#define OWN 2u
#define STEP 1000u /* ticks */

static const uint32_t neighbours[] = {1, 3, 4};
static const int32_t stabilizing[] = {ONEBIT_REAL(-0.25, 30)};
static const int32_t compression[] = {ONEBIT_REAL(1.0, 30)};
static onebit_config config;
static onebit_estimate estimates[3];
static onebit_agent agent;
static onebit_estimate twin_estimates[3];
static onebit_agent twin; /* the same agent, its calls written out here */
static struct step_loop loop;
static int32_t state;
static int32_t driven;
static unsigned drives;
static unsigned holds;

static void measure(void *context, onebit_real *x)
{
    TEST_ASSERT_EQUAL_PTR(&state, context);
    between();
    x[0] = state;
}

static void drive(void *context, onebit_real u)
{
    TEST_ASSERT_EQUAL_PTR(&state, context);
    between();
    driven = u;
    state += u;
    ++drives;
}

static void hold(void *context)
{
    TEST_ASSERT_EQUAL_PTR(&state, context);
    between();
    ++holds;
}

static void run(void)
{
    step_loop_run(&loop, can_controller_now(&can));
}

static void start_loop(uint8_t mode, uint8_t encoding)
{
    static const uint16_t bases[] = {ONEBIT_PAYLOAD_BASE, ONEBIT_IDENTIFIER_BASE};
    setUp();
    config = (onebit_config){
        .agent = OWN,
        .neighbours = neighbours,
        .neighbour_count = 3,
        .state_count = 1,
        .format = {mode, encoding, mode == ONEBIT_MODE_LINK ? 0 : bases[encoding],
                   ONEBIT_SYNC_IDENTIFIER},
        .stabilizing = stabilizing,
        .compression = compression,
        .threshold = 0,
        .bound = ONEBIT_NOISE(2.0),
        .estimator_gain = ONEBIT_COEFFICIENT(25.0),
        .control_gain = ONEBIT_COEFFICIENT(1.0),
        .start = 20,
        .fraction_bits = {30, 30, 26, 26},
        .seed = 7,
        .first_link = 5,
    };
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &agent, estimates, NULL));
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &twin, twin_estimates, NULL));
    state = ONEBIT_REAL(0.75, 26);
    driven = 0;
    drives = 0;
    holds = 0;
    loop = (struct step_loop){
        .config = &config,
        .agent = &agent,
        .transport = transport,
        .plant = {.context = &state, .measure = measure, .drive = drive, .hold = hold},
        .period = STEP * TICK,
    };
}

/* As masters send it that do not count; test_step_loop.c has the counter. */
static onebit_frame sync_frame(void)
{
    return (onebit_frame){.identifier = ONEBIT_SYNC_IDENTIFIER};
}

static onebit_frame message_frame(uint32_t sender, uint32_t clock, bool bit)
{
    const onebit_message message = {.sender = sender,
                                    .receiver = config.format.mode == ONEBIT_MODE_LINK ? OWN : 0,
                                    .step = (uint8_t)(clock % ONEBIT_STEP_MODULUS),
                                    .bit = bit};
    onebit_frame frame;
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_frame_encode(&config.format, &message, &frame));
    return frame;
}

static bool some_bit(uint32_t sender, uint32_t clock)
{
    return (onebit_random_word(3, 0, sender, clock) & 1u) != 0;
}

/* SYNC comes, a step after the last. */
static void come_sync(void)
{
    onebit_frame sync = sync_frame();
    chip.ticks += STEP;
    arrive(&sync);
    run();
}

static void come_message(uint32_t sender, uint32_t clock)
{
    onebit_frame frame = message_frame(sender, clock, some_bit(sender, clock));
    arrive(&frame);
    run();
}

/* The bus carries what stands in the mailboxes; the chip does not receive it itself. */
static void carry_own(void)
{
    chip.mailbox_count = 0;
}

/* What the step that now ends must have done, by calls of the library in their order. */
static int32_t twin_step(int32_t x)
{
    int32_t u;
    for (unsigned k = 0; k < 3; ++k) {
        onebit_frame frame =
            message_frame(neighbours[k], twin.clock, some_bit(neighbours[k], twin.clock));
        TEST_ASSERT_EQUAL(ONEBIT_OK,
                          onebit_receive(&config, &twin, &frame, ONEBIT_ALL_LINKED, NULL));
    }
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_control(&config, &twin, &x, ONEBIT_ALL_LINKED, &u));
    return u;
}

static void check_twin(void)
{
    TEST_ASSERT_EQUAL_UINT32(twin.clock, agent.clock);
    for (unsigned k = 0; k < 3; ++k) {
        TEST_ASSERT_EQUAL_INT32(twin_estimates[k].value, estimates[k].value);
        TEST_ASSERT_EQUAL_UINT32(twin_estimates[k].carry, estimates[k].carry);
    }
}

/* The own message of clock t: drawn with the own number's word, from the state at its SYNC. */
static void check_own_message(uint32_t t, int32_t x)
{
    bool bit;
    onebit_encode(&config, &x, 0, onebit_random_word(7, 0, OWN, t), &bit);
    onebit_frame frame = message_frame(OWN, t, bit);
    TEST_ASSERT_EQUAL_UINT(1, chip.mailbox_count);
    TEST_ASSERT_EQUAL_MEMORY(&frame, &chip.mailbox[0], sizeof frame);
}

/* The step that began with x has ended just now. */
static void check_ended(int32_t x)
{
    TEST_ASSERT_EQUAL_INT32(twin_step(x), driven);
    check_twin();
}

/* Whole steps, ended by the next SYNC or before it, are the library's calls in their order. */
static void test_steps(void)
{
    for (uint64_t control_after = 0; control_after < STEP * TICK;
         control_after += STEP / 4 * TICK) {
        for (uint8_t encoding = ONEBIT_ENCODING_PAYLOAD; encoding <= ONEBIT_ENCODING_IDENTIFIER;
             ++encoding) {
            int32_t x = 0;
            start_loop(ONEBIT_MODE_BROADCAST, encoding);
            loop.control_after = control_after;
            for (unsigned step = 0; step < 300; ++step) {
                come_sync();
                TEST_ASSERT_EQUAL_UINT(step, drives);
                if (control_after == 0 && step != 0) {
                    check_ended(x);
                }
                uint32_t t = twin.clock;
                x = state;
                check_own_message(t, x);
                carry_own();
                for (unsigned k = 0; k < 3; ++k) {
                    come_message(neighbours[k], t);
                }
                if (control_after != 0) {
                    chip.ticks += (uint32_t)(control_after / TICK) - 1;
                    run();
                    TEST_ASSERT_EQUAL_UINT(step, drives);
                    ++chip.ticks;
                    run();
                    check_ended(x);
                    run();
                    TEST_ASSERT_EQUAL_UINT(step + 1, drives); /* and no more */
                }
            }
            come_sync();
            TEST_ASSERT_EQUAL_UINT32(900, loop.counts.taken);
            TEST_ASSERT_EQUAL_UINT32(300, loop.counts.steps);
            TEST_ASSERT_EQUAL_UINT32(0, loop.counts.late + loop.counts.outside +
                                            loop.counts.sync_refused + loop.counts.aligned +
                                            loop.counts.duplicates + loop.counts.held +
                                            loop.counts.refused);
            TEST_ASSERT_EQUAL_UINT(0, holds);
        }
    }
}

/* Three steps in which one frame, the k-th, comes during hook call `due`, of however many. */
static unsigned steps_with_surprise(unsigned surprise, unsigned due)
{
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD);
    unsigned frame_number = 0;
    unsigned calls = 0;
    for (unsigned step = 0; step < 3; ++step) {
        for (unsigned k = 0; k < 4; ++k, ++frame_number) {
            uint32_t t = config.start + 1u + step;
            onebit_frame frame =
                k == 0 ? sync_frame()
                       : message_frame(neighbours[k - 1], t, some_bit(neighbours[k - 1], t));
            chip.ticks += k == 0 ? STEP : 1;
            if (frame_number == surprise) {
                /* It comes while the loop is busy with what came before. */
                chip.surprise = frame;
                chip.calls = 0;
                chip.due = due;
                run();
                calls = chip.calls;
                if (chip.calls < due) {
                    arrive(&frame);
                }
            } else {
                arrive(&frame);
                /* Not yet looked at: the surprise follows it. */
                if (frame_number + 1 == surprise) {
                    continue;
                }
            }
            run();
            if (k == 0) {
                carry_own();
            }
        }
    }
    onebit_frame sync = sync_frame();
    chip.ticks += STEP;
    arrive(&sync);
    run();
    return calls;
}

/* Wherever the interrupt falls, the loop sees the same frames in the same order. */
static void test_interrupt_between_any_two_hook_calls(void)
{
    steps_with_surprise(1000, 0);
    int32_t expected_state = state;
    onebit_estimate expected[3];
    memcpy(expected, estimates, sizeof estimates);
    TEST_ASSERT_EQUAL_UINT32(9, loop.counts.taken);
    unsigned tried = 0;
    for (unsigned surprise = 1; surprise < 12; ++surprise) {
        unsigned calls = 1;
        for (unsigned due = 1; due <= calls; ++due, ++tried) {
            calls = steps_with_surprise(surprise, due);
            TEST_ASSERT_EQUAL_INT32(expected_state, state);
            TEST_ASSERT_EQUAL_MEMORY(expected, estimates, sizeof estimates);
            TEST_ASSERT_EQUAL_UINT32(9, loop.counts.taken);
            TEST_ASSERT_EQUAL_UINT32(3, loop.counts.steps);
        }
    }
    TEST_ASSERT_TRUE(tried > 40);
}

/* SYNC wins the arbitration; what the step before it did not get out is withdrawn and not heard. */
static void test_what_is_late_is_withdrawn(void)
{
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER);
    come_sync();
    TEST_ASSERT_EQUAL_UINT(1, chip.mailbox_count);
    onebit_frame sync = sync_frame();
    TEST_ASSERT_TRUE(sync.identifier < chip.mailbox[0].identifier);
    int32_t x = state;
    come_sync(); /* the first message still stands in its mailbox */
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.late);
    TEST_ASSERT_NOT_EQUAL(x, state);
    check_own_message(config.start + 2u, state);

    /* Mailboxes full of others' frames: the message is given up with its step. */
    carry_own();
    chip.mailboxes = 0;
    come_sync();
    run();
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.late);
    chip.mailboxes = 1;
    come_sync();
    TEST_ASSERT_EQUAL_UINT32(2, loop.counts.late);
    check_own_message(config.start + 4u, state);
}

/* A message that found no mailbox leaves in a later call of the same step, once. */
static void test_full_mailboxes_are_tried_again(void)
{
    struct can_controller_counts counts;
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD);
    chip.mailboxes = 0;
    come_sync();
    run();
    chip.mailboxes = 1;
    run();
    check_own_message(config.start + 1u, state);
    carry_own();
    run();
    TEST_ASSERT_EQUAL_UINT(0, chip.mailbox_count);
    can_controller_counts(&can, &counts);
    TEST_ASSERT_EQUAL_UINT32(1, counts.sent);
    TEST_ASSERT_EQUAL_UINT32(2, counts.mailbox_full); /* an attempt a call */
    TEST_ASSERT_EQUAL_UINT32(0, loop.counts.late);
}

/* Bus off in a step: the message waits; back in the same step it leaves. */
static void test_bus_off_in_a_step(void)
{
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD);
    onebit_frame sync = sync_frame();
    chip.ticks += STEP;
    arrive(&sync);
    chip.off = true;
    run();
    TEST_ASSERT_TRUE(loop.in_step);
    TEST_ASSERT_EQUAL_UINT(0, chip.mailbox_count);
    run();
    chip.off = false;
    run();
    check_own_message(config.start + 1u, state);
}

/* Link mode: one message a neighbour, each with its own link's random word, by one mailbox. */
static void test_link_mode(void)
{
    start_loop(ONEBIT_MODE_LINK, ONEBIT_ENCODING_PAYLOAD);
    chip.mailboxes = 1;
    for (uint32_t t = config.start + 1u; t < config.start + 50u; ++t) {
        onebit_frame sync = sync_frame();
        chip.ticks += STEP;
        arrive(&sync);
        for (unsigned k = 0; k < 3; ++k) {
            run();
            onebit_message message;
            bool bit;
            TEST_ASSERT_EQUAL_UINT(1, chip.mailbox_count);
            TEST_ASSERT_EQUAL(ONEBIT_OK,
                              onebit_frame_decode(&config.format, &chip.mailbox[0], &message));
            onebit_encode(&config, &state, k, onebit_random_word(7, 0, 5 + k, t), &bit);
            TEST_ASSERT_EQUAL_UINT32(OWN, message.sender);
            TEST_ASSERT_EQUAL_UINT32(neighbours[k], message.receiver);
            TEST_ASSERT_EQUAL_UINT32(t % 128, message.step);
            TEST_ASSERT_EQUAL(bit, message.bit);
            carry_own();
        }
        run();
        TEST_ASSERT_EQUAL_UINT(0, chip.mailbox_count);
        come_message(1, t);
    }
    TEST_ASSERT_EQUAL_UINT32(0, loop.counts.late);
    TEST_ASSERT_EQUAL_UINT32(49, loop.counts.taken);
}

/* Frames that are not of this step, not a neighbour's, under the own number, or no message. */
static void test_frames_that_do_not_count(void)
{
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER);
    loop.control_after = STEP / 2 * TICK;
    come_message(1, 21); /* before the first SYNC */
    come_sync();
    come_message(OWN, 21);
    come_message(9, 21);
    onebit_frame report = {.flags = ONEBIT_FRAME_ERROR, .length = 8};
    arrive(&report);
    run();
    come_message(1, 21);
    come_message(1, 21);
    chip.ticks += STEP / 2;
    run();
    come_message(3, 21); /* without a step number it would count for the next */
    come_sync();
    TEST_ASSERT_EQUAL_UINT32(2, loop.counts.outside);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.duplicates);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.taken);
    TEST_ASSERT_EQUAL_UINT16(2, agent.refused[ONEBIT_REFUSED_UNKNOWN - ONEBIT_REFUSED_FIRST]);
    TEST_ASSERT_EQUAL_UINT16(1, agent.refused[ONEBIT_REFUSED_ERROR_FRAME - ONEBIT_REFUSED_FIRST]);
    TEST_ASSERT_EQUAL_UINT16(1, agent.refused[ONEBIT_REFUSED_REPEATED - ONEBIT_REFUSED_FIRST]);
    TEST_ASSERT_EQUAL_HEX32(0, agent.heard);
}

static void test_sync_too_soon_is_refused(void)
{
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD);
    onebit_frame sync = sync_frame();
    come_sync();
    chip.ticks += STEP / 2 - 1;
    arrive(&sync);
    run();
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.sync_refused);
    TEST_ASSERT_EQUAL_UINT32(0, loop.counts.steps);
    /* Half a period after the last that was taken, though the loop was away for a while. */
    chip.ticks += 1;
    arrive(&sync);
    chip.ticks += 5 * STEP;
    run();
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.sync_refused);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.steps);
}

/* Another transport: SYNC at the times of a list, nothing to withdraw. */
struct times {
    const uint64_t *list;
    unsigned count;
};

static enum transport_status receive_time(void *context, onebit_frame *frame, uint64_t *nanoseconds)
{
    struct times *times = context;
    if (times->count == 0) {
        return TRANSPORT_LATER;
    }
    --times->count;
    *frame = sync_frame();
    *nanoseconds = *times->list++;
    return TRANSPORT_DONE;
}

static enum transport_status send_nothing(void *context, const onebit_frame *frame)
{
    (void)context;
    (void)frame;
    return TRANSPORT_LATER;
}

static void test_any_transport(void)
{
    static const uint64_t list[] = {0, 1, STEP * TICK, 2 * STEP * TICK};
    struct times times = {list, 4};
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD);
    loop.transport =
        (struct transport){.context = &times, .send = send_nothing, .receive = receive_time};
    step_loop_run(&loop, 2 * STEP * TICK);
    TEST_ASSERT_EQUAL_UINT32(2, loop.counts.steps);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.sync_refused);
    TEST_ASSERT_EQUAL_UINT32(2, loop.counts.late);
    TEST_ASSERT_TRUE(loop.in_step);
}

/* A flooded bus takes a bounded time a call, and the rest later. */
static void test_a_call_is_bounded(void)
{
    static struct frame_queue_entry many[FRAME_QUEUE_MAX];
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD);
    TEST_ASSERT_TRUE(can_controller_start(&can, &controller, many, FRAME_QUEUE_MAX));
    come_sync();
    for (unsigned k = 0; k < STEP_LOOP_FRAMES + 10; ++k) {
        onebit_frame frame = frame_of(0x7E0);
        arrive(&frame);
    }
    run();
    TEST_ASSERT_EQUAL_UINT16(STEP_LOOP_FRAMES,
                             agent.refused[ONEBIT_REFUSED_UNKNOWN - ONEBIT_REFUSED_FIRST]);
    TEST_ASSERT_TRUE(can_controller_waiting(&can));
    run();
    TEST_ASSERT_EQUAL_UINT16(STEP_LOOP_FRAMES + 10,
                             agent.refused[ONEBIT_REFUSED_UNKNOWN - ONEBIT_REFUSED_FIRST]);
}

/* A node that starts into a group 40 steps ahead finds its clock (ports/alignment.h). */
static void test_alignment(void)
{
    start_loop(ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD);
    uint32_t group = config.start + 41u;
    for (unsigned step = 0; step < 20; ++step, ++group) {
        come_sync();
        carry_own();
        come_message(1, group);
        come_message(3, group);
    }
    come_sync();
    TEST_ASSERT_EQUAL_UINT32(group, agent.clock);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.aligned);
    TEST_ASSERT_TRUE(loop.counts.taken >= 24);
}

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_queue_sizes);
    RUN_TEST(test_queue_keeps_order);
    RUN_TEST(test_frames_come_in_order_and_as_they_were);
    RUN_TEST(test_time);
    RUN_TEST(test_time_of_a_frame_older_than_the_start);
    RUN_TEST(test_full_queue_keeps_what_is_older_and_counts);
    RUN_TEST(test_what_the_chip_lost_is_counted);
    RUN_TEST(test_interrupt_ends_whatever_the_chip_says);
    RUN_TEST(test_reports_of_the_controller);
    RUN_TEST(test_mailboxes);
    RUN_TEST(test_bus_off);
    RUN_TEST(test_counters_belong_to_one_moment);
    RUN_TEST(test_steps);
    RUN_TEST(test_interrupt_between_any_two_hook_calls);
    RUN_TEST(test_what_is_late_is_withdrawn);
    RUN_TEST(test_full_mailboxes_are_tried_again);
    RUN_TEST(test_bus_off_in_a_step);
    RUN_TEST(test_link_mode);
    RUN_TEST(test_frames_that_do_not_count);
    RUN_TEST(test_sync_too_soon_is_refused);
    RUN_TEST(test_any_transport);
    RUN_TEST(test_a_call_is_bounded);
    RUN_TEST(test_alignment);
    return UNITY_END();
}
