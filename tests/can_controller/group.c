/*
 * All agents of a system as firmware, from the header of onebit-design alone: each with a
 * controller, ports/can-controller/ and the step loop, started as main.c starts them, on one bus
 * made here, in time made here; on the host or on one Cortex-M. After CALM steps some of them
 * restart, one is stopped and started by the master's network management, and others restart in the
 * middle of a step.
 *
 * Prints, of each calm step, a line an agent: states, input, estimates; of each later one the
 * agents' clocks, and how many messages each took in it; and at the end the states. With
 * SYNC_COUNTS the master's SYNC carries CiA 301's counter, the group's clock modulo 128.
 */
#include "can_controller.h"
#include "integer_plant.h"
#include "onebit_config.h"
#include "step_loop.h"

#include <stdio.h>

#define AGENTS ONEBIT_CONFIG_AGENTS
#define STATES ONEBIT_CONFIG_STATES
#define PERIOD_TICKS ((uint32_t)(ONEBIT_CONFIG_PERIOD_NANOSECONDS / 1000)) /* microseconds */
#define FRAME_TICKS 200u
#define NODE_OF(agent) (uint8_t)(40u + (agent)) /* CANopen's node-ID */

#define CALM 300u
#define STEPS 1000u

static const struct event {
    uint32_t step;
    enum { RESTART, STOP, START, RESTART_WITHIN } what;
    uint32_t agent;
} events[] = {
    {300, RESTART, 2},        {300, RESTART, 5},        {330, STOP, 7},
    {350, START, 7},          {360, RESTART_WITHIN, 1}, {360, RESTART_WITHIN, 3},
    {360, RESTART_WITHIN, 4}, {360, RESTART_WITHIN, 6},
};

static const struct integer_plant plant = {
    .state_count = STATES,
    .A_fraction_bits = ONEBIT_CONFIG_PLANT_A_FRACTION_BITS,
    .B_fraction_bits = ONEBIT_CONFIG_PLANT_B_FRACTION_BITS,
    .state_fraction_bits = ONEBIT_CONFIG_STATE_FRACTION_BITS,
    .control_fraction_bits = ONEBIT_CONFIG_CONTROL_FRACTION_BITS,
    .A = onebit_config_plant_A,
    .B = onebit_config_plant_B,
};

/* A machine, its controller with one place each way, and what main.c has. */
static struct machine {
    int32_t x[STATES];
    int32_t u;
    bool on_hold;

    onebit_frame received;
    bool has_received;
    onebit_frame mailbox;
    bool has_mailbox;

    struct controller controller;
    struct frame_queue_entry entries[32];
    struct can_controller can;
    onebit_estimate estimates[ONEBIT_CONFIG_NEIGHBOURS];
    onebit_agent agent;
    struct step_loop loop;
} machines[AGENTS];
static uint32_t now;

/* --- the controllers --- */

static bool send(void *context, const onebit_frame *frame)
{
    struct machine *machine = context;
    if (machine->has_mailbox) {
        return false;
    }
    machine->mailbox = *frame;
    machine->has_mailbox = true;
    return true;
}

static uint32_t withdraw(void *context)
{
    struct machine *machine = context;
    bool had = machine->has_mailbox;
    machine->has_mailbox = false;
    return had;
}

static bool bus_off(void *context)
{
    (void)context;
    return false;
}

static bool receive(void *context, onebit_frame *frame, uint32_t *ticks)
{
    struct machine *machine = context;
    (void)ticks; /* the interrupt's time will do */
    bool had = machine->has_received;
    machine->has_received = false;
    *frame = machine->received;
    return had;
}

static uint32_t overrun(void *context)
{
    (void)context;
    return 0;
}

static uint32_t read_ticks(void *context)
{
    (void)context;
    return now;
}

static void no_lock(void *context)
{
    (void)context;
}

/* --- the machines --- */

static void measure(void *context, onebit_real *x)
{
    const struct machine *machine = context;
    for (unsigned k = 0; k < STATES; ++k) {
        x[k] = machine->x[k];
    }
}

static void drive(void *context, onebit_real u)
{
    struct machine *machine = context;
    machine->u = u;
    machine->on_hold = false;
}

static void hold(void *context)
{
    struct machine *machine = context;
    machine->on_hold = true;
}

/* On hold the machine keeps up u = K1 x by itself. */
static int32_t stabilizing(const struct machine *machine, const onebit_config *config)
{
    int64_t sum = 0;
    for (unsigned k = 0; k < STATES; ++k) {
        sum += (int64_t)config->stabilizing[k] * machine->x[k];
    }
    return (int32_t)(sum >> (config->fraction_bits.stabilizing + config->fraction_bits.state -
                             config->fraction_bits.control));
}

static bool start(uint32_t number)
{
    struct machine *machine = &machines[number - 1];
    onebit_real initial[ONEBIT_CONFIG_NEIGHBOURS];
    machine->has_received = false;
    machine->has_mailbox = false;
    machine->controller = (struct controller){
        .context = machine,
        .send = send,
        .withdraw = withdraw,
        .bus_off = bus_off,
        .receive = receive,
        .overrun = overrun,
        .ticks = read_ticks,
        .nanoseconds_per_tick = 1000,
        .lock = no_lock,
        .unlock = no_lock,
    };
    machine->loop = (struct step_loop){
        .config = onebit_configs[number - 1],
        .agent = &machine->agent,
        .plant = {.context = machine, .measure = measure, .drive = drive, .hold = hold},
        .node = NODE_OF(number),
        .period = ONEBIT_CONFIG_PERIOD_NANOSECONDS,
        .control_after = ONEBIT_CONFIG_PERIOD_NANOSECONDS / 4,
    };
    for (unsigned k = 0; k < ONEBIT_CONFIG_NEIGHBOURS; ++k) {
        initial[k] = ONEBIT_CONFIG_ESTIMATE;
    }
    if (onebit_start(machine->loop.config, &machine->agent, machine->estimates, initial) !=
            ONEBIT_OK ||
        !can_controller_start(&machine->can, &machine->controller, machine->entries, 32)) {
        return false;
    }
    machine->loop.transport = can_controller_transport(&machine->can);
    return true;
}

/* --- the bus --- */

static void run_all(void)
{
    for (unsigned k = 0; k < AGENTS; ++k) {
        step_loop_run(&machines[k].loop, can_controller_now(&machines[k].can));
    }
}

/* To all but the sender, and then all look at it. */
static void carry(const onebit_frame *frame, const struct machine *sender)
{
    now += FRAME_TICKS;
    for (unsigned k = 0; k < AGENTS; ++k) {
        if (&machines[k] != sender) {
            machines[k].received = *frame;
            machines[k].has_received = true;
            can_controller_interrupt(&machines[k].can);
        }
    }
    run_all();
}

/* All that stands in the mailboxes and what is put there meanwhile, the lowest identifier first. */
static void carry_messages(void)
{
    for (;;) {
        struct machine *first = NULL;
        for (unsigned k = 0; k < AGENTS; ++k) {
            struct machine *machine = &machines[k];
            if (machine->has_mailbox &&
                (first == NULL || machine->mailbox.identifier < first->mailbox.identifier)) {
                first = machine;
            }
        }
        if (first == NULL) {
            return;
        }
        const onebit_frame frame = first->mailbox;
        first->has_mailbox = false;
        carry(&frame, first);
    }
}

static void carry_sync(uint32_t t)
{
    const onebit_format format = ONEBIT_CONFIG_FORMAT;
    onebit_frame frame;
    onebit_frame_sync(&format, t, &frame);
#ifndef SYNC_COUNTS
    frame.length = 0;
#endif
    carry(&frame, NULL);
}

static bool happen(uint32_t step, bool within)
{
    bool good = true;
    for (unsigned k = 0; k < sizeof events / sizeof *events; ++k) {
        const struct event *event = &events[k];
        if (event->step != step || (event->what == RESTART_WITHIN) != within) {
            continue;
        }
        if (event->what == RESTART || event->what == RESTART_WITHIN) {
            good = start(event->agent) && good;
        } else {
            const onebit_frame frame = {
                .length = 2,
                .data = {event->what == STOP ? 0x02 : 0x01, NODE_OF(event->agent)},
            };
            carry(&frame, NULL);
        }
    }
    return good;
}

static void print_agent(const struct machine *machine, const int32_t *x)
{
    for (unsigned k = 0; k < STATES; ++k) {
        printf("%ld ", (long)x[k]);
    }
    printf("%ld", (long)machine->u);
    for (unsigned k = 0; k < machine->loop.config->neighbour_count; ++k) {
        printf(" %ld", (long)machine->estimates[k].value);
    }
    printf("\n");
}

int main(void)
{
    uint32_t taken[AGENTS] = {0};
    uint32_t start_time = 0;
    for (uint32_t number = 1; number <= AGENTS; ++number) {
        for (unsigned k = 0; k < STATES; ++k) {
            machines[number - 1].x[k] = onebit_config_initial_states[(number - 1) * STATES + k];
        }
        if (!start(number)) {
            return 1;
        }
    }
    for (uint32_t step = 0; step < STEPS; ++step) {
        if (!happen(step, false)) {
            return 1;
        }
        carry_sync(onebit_config_agent_1.start + 1 + step);
        carry_messages();
        if (!happen(step, true)) {
            return 1;
        }
        for (unsigned k = 0; step >= CALM && k < AGENTS; ++k) {
            printf("%lu %lu ", (unsigned long)machines[k].agent.clock,
                   (unsigned long)(machines[k].loop.counts.taken - taken[k]));
            taken[k] = machines[k].loop.counts.taken;
        }
        now = start_time + PERIOD_TICKS / 4 + 2 * FRAME_TICKS;
        run_all();
        start_time += PERIOD_TICKS;
        now = start_time;
        run_all();
        for (unsigned k = 0; k < AGENTS; ++k) {
            struct machine *machine = &machines[k];
            if (step < CALM) {
                print_agent(machine, machine->x);
                taken[k] = machine->loop.counts.taken;
            }
            integer_plant_step(&plant, machine->x,
                               machine->on_hold ? stabilizing(machine, machine->loop.config)
                                                : machine->u);
        }
        if (step >= CALM) {
            printf("\n");
        }
    }
    for (unsigned k = 0; k < AGENTS; ++k) {
        print_agent(&machines[k], machines[k].x);
    }
    for (unsigned k = 0; k < AGENTS; ++k) {
        const struct step_loop_counts *counts = &machines[k].loop.counts;
        printf("steps %lu held %lu aligned %lu late %lu\n", (unsigned long)counts->steps,
               (unsigned long)counts->held, (unsigned long)counts->aligned,
               (unsigned long)counts->late);
    }
    return 0;
}
