/*
 * What ports/step_loop.h does when steps do not come one after the other: no SYNC, none any more,
 * stopped and started by the master, a SYNC that tells another time, a state that is not finite.
 * Over a bus made here, at times made here, in each arithmetic. (test_can_controller.c has the
 * steps themselves, over a controller.)
 */
#include "step_loop.h"

#include "canopen.h"

#include <math.h>
#include <string.h>
#include <unity.h>

#define OWN 2u
#define NODE 77u /* CANopen's node-ID: not the agent's number */
#define PERIOD UINT64_C(10000000)
#define FIRST 21u /* t of the first step */

static const uint32_t neighbours[] = {1, 3};
static const onebit_real stabilizing[] = {ONEBIT_REAL(-0.25, 30)};
static const onebit_real compression[] = {ONEBIT_REAL(1.0, 30)};
static const onebit_config config = {
    .agent = OWN,
    .neighbours = neighbours,
    .neighbour_count = 2,
    .state_count = 1,
    .format = ONEBIT_FORMAT_BROADCAST_PAYLOAD,
    .stabilizing = stabilizing,
    .compression = compression,
    .threshold = ONEBIT_NOISE(0.0),
    .bound = ONEBIT_NOISE(2.0),
    .estimator_gain = ONEBIT_COEFFICIENT(25.0),
    .control_gain = ONEBIT_COEFFICIENT(1.0),
    .start = FIRST - 1,
    .fraction_bits = {30, 30, 26, 26},
    .seed = 7,
};
static onebit_estimate estimates[2];
static onebit_agent agent;
static struct step_loop loop;

/* The bus: one frame that waits; what was sent. */
static onebit_frame waiting;
static uint64_t waiting_time;
static bool waits;
static onebit_frame sent;
static unsigned sends;

/* The machine. */
static onebit_real state;
static onebit_real driven;
static unsigned drives;
static unsigned holds;

static enum transport_status receive(void *context, onebit_frame *frame, uint64_t *nanoseconds)
{
    (void)context;
    if (!waits) {
        return TRANSPORT_LATER;
    }
    waits = false;
    *frame = waiting;
    *nanoseconds = waiting_time;
    return TRANSPORT_DONE;
}

static enum transport_status send(void *context, const onebit_frame *frame)
{
    (void)context;
    sent = *frame;
    ++sends;
    return TRANSPORT_DONE;
}

static void measure(void *context, onebit_real *x)
{
    (void)context;
    x[0] = state;
}

static void drive(void *context, onebit_real u)
{
    (void)context;
    driven = u;
    ++drives;
}

static void hold(void *context)
{
    TEST_ASSERT_EQUAL_PTR(&state, context);
    ++holds;
}

void setUp(void)
{
    TEST_ASSERT_EQUAL(ONEBIT_OK, onebit_start(&config, &agent, estimates, NULL));
    loop = (struct step_loop){
        .config = &config,
        .agent = &agent,
        .transport = {.send = send, .receive = receive},
        .plant = {.context = &state, .measure = measure, .drive = drive, .hold = hold},
        .node = NODE,
        .period = PERIOD,
    };
    waits = false;
    state = ONEBIT_REAL(0.75, 26);
    driven = 0;
    drives = 0;
    holds = 0;
    sends = 0;
}

void tearDown(void)
{
}

/* A frame that came at `time`, and a call then. */
static void come(const onebit_frame *frame, uint64_t time)
{
    waiting = *frame;
    waiting_time = time;
    waits = true;
    step_loop_run(&loop, time);
}

static void come_sync(uint64_t time)
{
    const onebit_frame frame = {.identifier = ONEBIT_SYNC_IDENTIFIER};
    come(&frame, time);
}

/* SYNC with CiA 301's counter for the step of clock t. */
static void come_sync_of(uint32_t t, uint64_t time)
{
    const uint8_t counter = (uint8_t)(t % 128 == 0 ? 128 : t % 128);
    const onebit_frame frame = {
        .identifier = ONEBIT_SYNC_IDENTIFIER, .length = 1, .data = {counter}};
    come(&frame, time);
}

static void come_command(uint8_t command, uint8_t node, uint64_t time)
{
    const onebit_frame frame = {.identifier = 0, .length = 2, .data = {command, node}};
    come(&frame, time);
}

static void check(unsigned expected_drives, unsigned expected_holds)
{
    TEST_ASSERT_EQUAL_UINT(expected_drives, drives);
    TEST_ASSERT_EQUAL_UINT32(expected_drives, loop.counts.steps);
    TEST_ASSERT_EQUAL_UINT(expected_holds, holds);
    TEST_ASSERT_EQUAL_UINT32(expected_holds, loop.counts.held);
}

/* --- network management --- */

/* Every command to every node, by CiA 301's numbers. */
static void test_commands(void)
{
    for (unsigned own = 0; own <= 300; ++own) {
        for (unsigned node = 0; node <= 255; ++node) {
            bool meant = node == 0 || (node == own && node <= 127);
            for (unsigned command = 0; command <= 255; ++command) {
                const onebit_frame frame = {.length = 2, .data = {(uint8_t)command, (uint8_t)node}};
                bool stop = meant && (command == 0x02 || command == 0x80);
                bool start = meant && command == 0x01;
                if (canopen_is_stop(&frame, own) != stop ||
                    canopen_is_start(&frame, own) != start) {
                    TEST_FAIL_MESSAGE("a command is not understood");
                }
            }
        }
    }
}

static void test_frames_that_are_no_commands(void)
{
    for (uint8_t command = 1; command <= 2; ++command) {
        const onebit_frame frame = {.length = 2, .data = {command, 0}};
        for (unsigned k = 0; k < 10; ++k) {
            onebit_frame other = frame;
            other.identifier = k == 0 ? 1u : k == 1 ? 0x700u : 0;
            other.length = (uint8_t)(k == 2 ? 1 : k == 3 ? 3 : 2);
            other.flags = (uint8_t)(k >= 4 && k < 8 ? 1u << (k - 4) : 0);
            TEST_ASSERT_EQUAL(k >= 8 && command == 2, canopen_is_stop(&other, 5));
            TEST_ASSERT_EQUAL(k >= 8 && command == 1, canopen_is_start(&other, 5));
        }
    }
}

static void test_the_masters_frame_stops_all(void)
{
    const onebit_frame stop = {.length = 2, .data = {0x02, 0}};
    onebit_frame frame;
    memset(&frame, 0xFF, sizeof frame);
    canopen_stop_all(&frame);
    TEST_ASSERT_EQUAL_MEMORY(&stop, &frame, sizeof frame);
}

/* Stop (02) and pre-operational (80) end the step and hold; 81 and 82 do nothing; 01 resumes. */
static void test_stop_and_start(void)
{
    static const struct {
        uint8_t command;
        uint8_t node;
        bool stops;
    } cases[] = {
        {0x02, 0, true},     {0x02, NODE, true},  {0x02, OWN, false},  {0x02, NODE + 1, false},
        {0x80, 0, true},     {0x80, NODE, true},  {0x80, OWN, false},  {0x81, 0, false},
        {0x81, NODE, false}, {0x82, NODE, false}, {0x01, NODE, false}, {0x01, 0, false},
    };
    for (unsigned k = 0; k < sizeof cases / sizeof *cases; ++k) {
        uint64_t time = 0;
        setUp();
        come_sync(time);
        come_command(cases[k].command, cases[k].node, time + 1);
        TEST_ASSERT_EQUAL(cases[k].stops, loop.stopped);
        check(cases[k].stops, cases[k].stops);
        TEST_ASSERT_EQUAL(!cases[k].stops, loop.in_step);
        if (!cases[k].stops) {
            continue;
        }

        /* Nothing happens, whatever comes; and the machine is on hold already. */
        const uint32_t t = agent.clock;
        unsigned before = sends;
        for (unsigned step = 1; step < 10; ++step) {
            onebit_frame frame = {.identifier = 0x101, .length = 1};
            time += PERIOD;
            come_sync(time);
            come(&frame, time + 1);
            come_command(0x02, 0, time + 2);
            come_command(0x01, OWN, time + 3); /* another's */
        }
        step_loop_run(&loop, time + 100 * PERIOD);
        check(1, 1);
        TEST_ASSERT_EQUAL_UINT(before, sends);
        TEST_ASSERT_EQUAL_UINT32(t, agent.clock);
        TEST_ASSERT_EQUAL_UINT32(0, loop.counts.outside + loop.counts.taken + loop.counts.late);

        /* A start does not step yet; the next SYNC does, and its end drives. */
        time += 200 * PERIOD;
        come_command(0x01, k % 2 == 0 ? 0 : NODE, time);
        TEST_ASSERT_FALSE(loop.stopped);
        check(1, 1);
        TEST_ASSERT_EQUAL_UINT(before, sends);
        come_sync_of(t + 50, time + 1);
        TEST_ASSERT_EQUAL_UINT(before + 1, sends);
        TEST_ASSERT_EQUAL_UINT8(((t + 50) % 128) << 1, sent.data[0] & ~1u);
        check(1, 1);
        come_sync_of(t + 51, time + 1 + PERIOD);
        check(2, 1);
    }
}

static void test_without_a_node_number_only_all_are_meant(void)
{
    loop.node = 0;
    come_sync(0);
    for (unsigned node = 1; node <= 255; ++node) {
        come_command(0x02, (uint8_t)node, 1);
        TEST_ASSERT_FALSE(loop.stopped);
    }
    come_command(0x02, 0, 1);
    TEST_ASSERT_TRUE(loop.stopped);
}

/* --- no SYNC --- */

static void test_on_hold_before_the_first_sync(void)
{
    step_loop_run(&loop, 0);
    check(0, 1);
    step_loop_run(&loop, 100 * PERIOD);
    check(0, 1);
    come_sync(101 * PERIOD);
    come_sync(102 * PERIOD);
    check(1, 1);

    setUp();
    come_sync(0); /* the first call finds it */
    come_sync(PERIOD);
    check(1, 0);
}

/* Where no time is known too: the first SYNC ends it, and no lack of one is noticed. */
static void test_without_a_clock(void)
{
    loop.period = 0;
    step_loop_run(&loop, 0);
    check(0, 1);
    for (unsigned step = 0; step < 50; ++step) {
        come_sync(0);
        step_loop_run(&loop, 0);
        check(step, 1);
    }
}

/* The time limit to the nanosecond; once; and the next SYNC resumes. */
static void test_sync_lost(void)
{
    static const struct {
        uint64_t period;
        uint64_t timeout;
        uint64_t control_after;
        uint64_t limit; /* 0: none */
    } cases[] = {
        {PERIOD, 0, 0, 3 * PERIOD},
        {PERIOD, 0, PERIOD / 4, 3 * PERIOD},
        {PERIOD, 5 * PERIOD / 4, 0, 5 * PERIOD / 4},
        {PERIOD, 20 * PERIOD, PERIOD / 4, 20 * PERIOD},
        {0, 7 * PERIOD, 0, 7 * PERIOD},
        {0, 0, 0, 0},
        {0, 0, PERIOD / 4, 0},
    };
    for (unsigned k = 0; k < sizeof cases / sizeof *cases; ++k) {
        setUp();
        loop.period = cases[k].period;
        loop.timeout = cases[k].timeout;
        loop.control_after = cases[k].control_after;
        const bool by_time = cases[k].control_after != 0;
        uint64_t time = 5; /* of the last SYNC */
        come_sync(time);
        for (unsigned step = 1; step <= 4; ++step) {
            time += PERIOD;
            step_loop_run(&loop, time - 1);
            check(by_time ? step : step - 1, 0);
            come_sync(time);
        }
        const uint32_t t = agent.clock;
        unsigned done = 4;
        if (cases[k].limit == 0) {
            step_loop_run(&loop, time + 1000 * PERIOD);
            check(by_time ? 5 : 4, 0);
            continue;
        }
        if (by_time) {
            step_loop_run(&loop, time + cases[k].control_after - 1);
            check(done, 0);
            step_loop_run(&loop, time + cases[k].control_after);
            check(++done, 0);
        }
        step_loop_run(&loop, time + cases[k].limit - 1);
        check(done, 0);
        TEST_ASSERT_EQUAL(!by_time, loop.in_step);
        for (unsigned later = 0; later < 5; ++later) {
            step_loop_run(&loop, time + cases[k].limit + later * PERIOD);
            check(done, 1);
            /* A step under way was given up; it has been one for the group. */
            TEST_ASSERT_FALSE(loop.in_step);
            TEST_ASSERT_EQUAL_UINT32(t + 1, agent.clock);
        }
        TEST_ASSERT_EQUAL_UINT(5, sends);
        /* It resumes, and can be lost again. */
        time += 100 * PERIOD;
        come_sync(time);
        check(done, 1);
        come_sync(time + PERIOD);
        check(++done, 1);
        step_loop_run(&loop, time + PERIOD + cases[k].limit);
        check(done, 2);
    }
}

/* A loop that was away too long does not drive what it measured then. */
static void test_a_step_too_old_is_given_up(void)
{
    loop.control_after = PERIOD / 4;
    come_sync(0);
    step_loop_run(&loop, 3 * PERIOD);
    check(0, 1);
    TEST_ASSERT_FALSE(loop.in_step);
}

/* A frame that came after the time was read is not a long time ago. */
static void test_a_sync_after_now(void)
{
    const onebit_frame sync = {.identifier = ONEBIT_SYNC_IDENTIFIER};
    loop.control_after = PERIOD / 4;
    waiting = sync;
    waiting_time = 1000;
    waits = true;
    step_loop_run(&loop, 999);
    TEST_ASSERT_TRUE(loop.in_step);
    check(0, 0);
}

static void test_without_the_hook_it_drives_zero(void)
{
    loop.plant.hold = NULL;
    come_sync(0);
    come_sync(PERIOD);
    TEST_ASSERT_EQUAL_UINT(1, drives);
    TEST_ASSERT_TRUE(driven != 0);
    for (unsigned later = 4; later < 9; ++later) {
        step_loop_run(&loop, later * PERIOD);
        TEST_ASSERT_EQUAL_UINT(2, drives);
        TEST_ASSERT_TRUE(driven == 0);
    }
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.held);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.steps);
}

/* --- SYNC's counter --- */

/* From every distance to the start, every residue: the nearest step that has it, from the first. */
static void test_sync_tells_the_time(void)
{
    for (uint32_t done = 0; done < 140; done += 7) {
        for (uint32_t residue = 0; residue < 128; ++residue) {
            setUp();
            uint64_t time = 0;
            for (uint32_t step = 0; step < done; ++step, time += PERIOD) {
                come_sync_of(FIRST + step, time);
            }
            TEST_ASSERT_EQUAL_UINT32(0, loop.counts.aligned);
            const uint32_t own = FIRST + done; /* of the step that begins now */
            uint32_t expected = 0;
            for (uint32_t t = FIRST; t < own + 128; ++t) {
                uint32_t away = t > own ? t - own : own - t;
                uint32_t before = expected > own ? expected - own : own - expected;
                if (t % 128 == residue && (expected == 0 || away < before)) {
                    expected = t;
                }
            }
            come_sync_of(residue, time);
            uint32_t apart = (residue - own) % 128;
            if (apart != 64) { /* else two are as near */
                TEST_ASSERT_EQUAL_UINT32(expected, agent.clock);
            }
            TEST_ASSERT_EQUAL_UINT32(residue, agent.clock % 128);
            TEST_ASSERT_EQUAL_UINT32(apart != 0, loop.counts.aligned);
            /* The message that begins the step is of that time. */
            TEST_ASSERT_EQUAL_UINT8(residue << 1, sent.data[0] & 0xFEu);
            TEST_ASSERT_EQUAL_UINT32(done, loop.counts.steps);
        }
    }
}

static void test_sync_that_does_not_tell(void)
{
    const onebit_frame foreign = {.identifier = ONEBIT_SYNC_IDENTIFIER, .length = 1, .data = {200}};
    come_sync_of(50, 0);
    TEST_ASSERT_EQUAL_UINT32(50, agent.clock);
    come_sync(PERIOD);
    TEST_ASSERT_EQUAL_UINT32(51, agent.clock);
    come(&foreign, 2 * PERIOD);
    TEST_ASSERT_EQUAL_UINT32(52, agent.clock);
    come_sync_of(90, 2 * PERIOD + PERIOD / 2 - 1); /* too soon: refused whole */
    TEST_ASSERT_EQUAL_UINT32(52, agent.clock);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.sync_refused);
    TEST_ASSERT_EQUAL_UINT32(1, loop.counts.aligned);
}

/* --- what the library refuses --- */

static void test_an_agent_that_was_not_started(void)
{
    const onebit_frame message = {.identifier = 0x101, .length = 1, .data = {FIRST << 1}};
    agent = (onebit_agent){0};
    for (unsigned step = 0; step < 20; ++step) {
        come_sync_of(FIRST + step, step * PERIOD);
        come(&message, step * PERIOD + 1);
    }
    check(0, 1);
    TEST_ASSERT_EQUAL_UINT(0, sends);
    TEST_ASSERT_EQUAL_UINT32(20 + 19, loop.counts.refused);
    TEST_ASSERT_EQUAL_UINT32(0, loop.counts.aligned + loop.counts.taken + loop.counts.late);
}

#if ONEBIT_ARITHMETIC != ONEBIT_Q31
/* Nothing is sent and the machine is on hold, once; the clock goes on; a finite state resumes. */
static void test_a_state_that_is_not_finite(void)
{
    static const onebit_real states[] = {(onebit_real)NAN, (onebit_real)INFINITY,
                                         (onebit_real)-INFINITY};
    for (unsigned k = 0; k < 3; ++k) {
        setUp();
        uint64_t time = 0;
        come_sync(time);
        for (unsigned step = 1; step <= 5; ++step) {
            state = states[k];
            come_sync(time += PERIOD);
            TEST_ASSERT_EQUAL_UINT32(FIRST + step, agent.clock);
            check(1, step > 1);
        }
        TEST_ASSERT_EQUAL_UINT(1, sends);
        TEST_ASSERT_EQUAL_UINT32(5 + 4, loop.counts.refused);
        state = ONEBIT_REAL(0.75, 26);
        come_sync(time += PERIOD);
        check(1, 1);
        TEST_ASSERT_EQUAL_UINT(2, sends);
        come_sync(time += PERIOD);
        check(2, 1);
        TEST_ASSERT_EQUAL_UINT32(FIRST + 7, agent.clock);
        TEST_ASSERT_EQUAL_UINT32(5 + 5, loop.counts.refused);
        TEST_ASSERT_EQUAL_UINT32(0, loop.counts.late);
    }
}
#endif

int main(void)
{
    UNITY_BEGIN();
    RUN_TEST(test_commands);
    RUN_TEST(test_frames_that_are_no_commands);
    RUN_TEST(test_the_masters_frame_stops_all);
    RUN_TEST(test_stop_and_start);
    RUN_TEST(test_without_a_node_number_only_all_are_meant);
    RUN_TEST(test_on_hold_before_the_first_sync);
    RUN_TEST(test_without_a_clock);
    RUN_TEST(test_sync_lost);
    RUN_TEST(test_a_step_too_old_is_given_up);
    RUN_TEST(test_a_sync_after_now);
    RUN_TEST(test_without_the_hook_it_drives_zero);
    RUN_TEST(test_sync_tells_the_time);
    RUN_TEST(test_sync_that_does_not_tell);
    RUN_TEST(test_an_agent_that_was_not_started);
#if ONEBIT_ARITHMETIC != ONEBIT_Q31
    RUN_TEST(test_a_state_that_is_not_finite);
#endif
    return UNITY_END();
}
