/*
 * A board for ports/can-controller/main.c, on the host and on a Cortex-M. Its bus carries SYNC and
 * the other agents' frames of bus_log.h, as onebit-sim recorded them; the own frames are the
 * firmware's to send and are compared. After the last step of the log SYNC stays away, comes again,
 * and the master stops and starts the node. Its plant is the header's in integers. Prints state and
 * input of each step, "hold" where that begins, and at the end what went wrong.
 *
 * On a Cortex-M the bus is moved by SysTick interrupts at odd moments, whatever main.c is doing; on
 * the host while it sleeps. SYNC comes when the firmware has sent its messages and twice found
 * nothing to do, so that no result depends on the speed of a processor or emulator.
 */
#include "board.h"

#include "bus_log.h"
#include "integer_plant.h"
#include "onebit_config.h"

#include <stdio.h>

#define RECEIVE_PLACES 3u
#define PERIOD_TICKS BUS_LOG_PERIOD      /* microseconds */
#define FRAME_TICKS (PERIOD_TICKS / 400) /* that a frame takes */
#define NODE 99u                         /* CANopen's node-ID */
#define STATES ONEBIT_CONFIG_STATES

/* Shared with the interrupt. */
static volatile uint32_t ticks;
static volatile uint32_t sleeps;
static onebit_frame received[RECEIVE_PLACES];
static volatile uint32_t received_count;
static onebit_frame mailbox;
static volatile bool mailbox_full;
static volatile bool over;

/* The interrupt's. */
static uint32_t step; /* of bus_log ... */
static uint32_t next; /* ... of its frames: 0 SYNC, then the others' */
static uint32_t own_sent;
static uint32_t own_wrong;
static uint32_t overruns;
static uint32_t sleeps_before;

static const struct integer_plant plant = {
    .state_count = STATES,
    .A_fraction_bits = ONEBIT_CONFIG_PLANT_A_FRACTION_BITS,
    .B_fraction_bits = ONEBIT_CONFIG_PLANT_B_FRACTION_BITS,
    .state_fraction_bits = ONEBIT_CONFIG_STATE_FRACTION_BITS,
    .control_fraction_bits = ONEBIT_CONFIG_CONTROL_FRACTION_BITS,
    .A = onebit_config_plant_A,
    .B = onebit_config_plant_B,
};
static int32_t state[STATES];

/* --- the bus --- */

static void deliver(const onebit_frame *frame)
{
    if (received_count == RECEIVE_PLACES) {
        ++overruns;
        return;
    }
    received[received_count] = *frame;
    received_count = received_count + 1;
    can_receive_interrupt();
}

static void deliver_sync(void)
{
    const onebit_format format = ONEBIT_CONFIG_FORMAT;
    onebit_frame frame;
    onebit_frame_sync(&format, BUS_LOG_FIRST + step, &frame);
    deliver(&frame);
}

/* CANopen's network management. */
static void deliver_command(uint8_t command, uint8_t node)
{
    const onebit_frame frame = {.identifier = 0, .length = 2, .data = {command, node}};
    deliver(&frame);
}

static onebit_frame frame_of(const struct logged *logged)
{
    return (onebit_frame){.identifier = logged->identifier,
                          .flags = logged->identifier > 0x7FFu ? ONEBIT_FRAME_EXTENDED : 0,
                          .length = logged->length,
                          .data = {logged->data}};
}

static void carry_own(void)
{
    if (step < BUS_LOG_STEPS) {
        onebit_frame expected = frame_of(&bus_log[step].own[own_sent % BUS_LOG_OWN]);
        own_wrong += mailbox.identifier != expected.identifier || mailbox.flags != expected.flags ||
                     mailbox.length != expected.length || mailbox.data[0] != expected.data[0];
    }
    ++own_sent;
    mailbox_full = false;
}

/* Whether the firmware has nothing to do any more since something last happened. */
static bool quiet(void)
{
    return sleeps - sleeps_before >= 2;
}

/* What happens after the log, when all is quiet. */
static void move_after_log(void)
{
    static uint32_t event;
    static uint32_t own_expected;
    own_wrong += own_sent != own_expected;
    own_sent = 0;
    own_expected = 0;
    switch (event++) {
    case 0:                        /* silence */
        ticks += 2 * PERIOD_TICKS; /* and half of one since the last control */
        break;
    case 4: /* of another node */
        deliver_command(0x02, BUS_LOG_AGENT);
        break;
    case 5:
        deliver_command(0x02, NODE);
        break;
    case 7:
        deliver_command(0x01, NODE);
        break;
    case 6: /* while it is stopped */
        deliver_sync();
        break;
    case 1:
    case 8:
        deliver_sync();
        own_expected = BUS_LOG_OWN;
        break;
    case 2:
    case 9:
        ticks += PERIOD_TICKS / 2; /* control */
        break;
    case 3:
        ticks += PERIOD_TICKS / 2;
        break;
    default:
        over = true;
        break;
    }
}

/* The next thing that happens on the bus, if it may happen already. */
static void move_bus(void)
{
    onebit_frame frame;
    if (mailbox_full) {
        carry_own();
    } else if (next != 0 && next <= BUS_LOG_OTHERS) {
        frame = frame_of(&bus_log[step].others[next - 1]);
        deliver(&frame);
        ++next;
    } else if (!quiet() || over) {
        return;
    } else if (step == BUS_LOG_STEPS) {
        move_after_log();
    } else if (next == 0) {
        deliver_sync();
        ++next;
    } else if (next == BUS_LOG_OTHERS + 1) {
        ticks += PERIOD_TICKS / 2;
        ++next;
    } else {
        ticks += PERIOD_TICKS / 2;
        own_wrong += own_sent != BUS_LOG_OWN;
        own_sent = 0;
        next = 0;
        ++step;
    }
    ticks += FRAME_TICKS;
    sleeps_before = sleeps;
}

#ifdef __arm__
#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_CURRENT (*(volatile uint32_t *)0xE000E018u)

void arm_systick_isr(void); /* in the vector table of picolibc's crt0 */

void arm_systick_isr(void)
{
    static uint32_t word = 1;
    move_bus();
    word = word * 1664525u + 1013904223u;
    SYSTICK_RELOAD = 1000u + (word >> 20);
}

void board_start(void)
{
    SYSTICK_RELOAD = 1000;
    SYSTICK_CURRENT = 0;
    SYSTICK_CONTROL = 7; /* on, with its interrupt, by the processor's clock */
}

void board_sleep(void)
{
    sleeps = sleeps + 1;
    __asm__ volatile("wfi" ::: "memory");
}

static void lock(void *context)
{
    (void)context;
    __asm__ volatile("cpsid i" ::: "memory");
}

static void unlock(void *context)
{
    (void)context;
    __asm__ volatile("cpsie i" ::: "memory");
}
#else
static bool locked;
static bool pending;

void board_start(void)
{
}

void board_sleep(void)
{
    sleeps = sleeps + 1;
    pending = true;
}

static void lock(void *context)
{
    (void)context;
    locked = true;
}

static void unlock(void *context)
{
    (void)context;
    locked = false;
    if (pending) {
        pending = false;
        move_bus();
    }
}
#endif

/* --- the controller --- */

static bool send(void *context, const onebit_frame *frame)
{
    (void)context;
    if (mailbox_full) {
        return false;
    }
    mailbox = *frame;
    mailbox_full = true;
    return true;
}

static uint32_t withdraw(void *context)
{
    (void)context;
    bool was_full = mailbox_full;
    mailbox_full = false;
    return was_full;
}

static bool bus_off(void *context)
{
    (void)context;
    return false;
}

static bool receive(void *context, onebit_frame *frame, uint32_t *now)
{
    (void)context;
    (void)now; /* the interrupt's time will do */
    if (received_count == 0) {
        return false;
    }
    *frame = received[0];
    received_count = received_count - 1;
    for (uint32_t k = 0; k < received_count; ++k) {
        received[k] = received[k + 1];
    }
    return true;
}

static uint32_t overrun(void *context)
{
    (void)context;
    return 0;
}

static uint32_t read_ticks(void *context)
{
    (void)context;
    return ticks;
}

const struct controller board_controller = {
    .send = send,
    .withdraw = withdraw,
    .bus_off = bus_off,
    .receive = receive,
    .overrun = overrun,
    .ticks = read_ticks,
    .nanoseconds_per_tick = 1000,
    .lock = lock,
    .unlock = unlock,
};

/* --- the machine --- */

uint32_t board_agent(void)
{
    for (unsigned k = 0; k < STATES; ++k) {
        state[k] = onebit_config_initial_states[(BUS_LOG_AGENT - 1) * STATES + k];
    }
    return BUS_LOG_AGENT;
}

uint8_t board_node(void)
{
    return NODE;
}

void board_measure(void *context, onebit_real *x)
{
    (void)context;
    for (unsigned k = 0; k < STATES; ++k) {
        x[k] = state[k];
    }
}

void board_drive(void *context, onebit_real u)
{
    (void)context;
    for (unsigned k = 0; k < STATES; ++k) {
        printf("%ld ", (long)state[k]);
    }
    printf("%ld\n", (long)u);
    integer_plant_step(&plant, state, u);
}

void board_hold(void *context)
{
    (void)context;
    printf("hold\n");
}

bool board_stopped(void)
{
    if (over) {
        printf("own frames wrong %lu, overruns %lu\n", (unsigned long)own_wrong,
               (unsigned long)overruns);
    }
    return over;
}
