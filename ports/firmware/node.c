/*
 * One agent of the seven aircraft (sim/scenarios/aircraft-integer.yaml) as a node on a serial line
 * that speaks slcan, as its host's adapter would: the other six and the SYNC that begins each step
 * come over the line. Its machine is the scenario's in integers. At the stop that ends the group it
 * prints what it did, with the checksum of all its estimates and controls as aircraft.c makes it.
 */
#include "channel.h"
#include "checksum.h"
#include "integer_plant.h"
#include "onebit_config.h"
#include "platform.h"
#include "print.h"
#include "step_loop.h"
#include "uart.h"

#include <stddef.h>

#define CONFIG (&onebit_config_agent_3)
#define STATES ONEBIT_CONFIG_STATES

static const struct integer_plant plant = {
    .state_count = STATES,
    .A_fraction_bits = ONEBIT_CONFIG_PLANT_A_FRACTION_BITS,
    .B_fraction_bits = ONEBIT_CONFIG_PLANT_B_FRACTION_BITS,
    .state_fraction_bits = ONEBIT_CONFIG_STATE_FRACTION_BITS,
    .control_fraction_bits = ONEBIT_CONFIG_CONTROL_FRACTION_BITS,
    .A = onebit_config_plant_A,
    .B = onebit_config_plant_B,
};

static int32_t x[STATES];
static onebit_agent agent;
static onebit_estimate estimates[ONEBIT_CONFIG_NEIGHBOURS];
static uint32_t check = CHECKSUM_BEGIN;

/* --- the hooks of the channel: the UART --- */

static bool put(void *context, uint8_t byte)
{
    (void)context;
    return uart_put(byte);
}

/* Nothing here looks at times. */
static bool take(void *context, uint8_t *byte, uint64_t *nanoseconds)
{
    (void)context;
    *nanoseconds = 0;
    return uart_take(byte);
}

/* --- the hooks of the steps: the machine --- */

static void measure(void *context, onebit_real *states)
{
    (void)context;
    for (unsigned state = 0; state < STATES; ++state) {
        states[state] = x[state];
    }
}

static void drive(void *context, onebit_real u)
{
    (void)context;
    for (unsigned place = 0; place < CONFIG->neighbour_count; ++place) {
        check = checksum(check, estimates[place].value);
    }
    check = checksum(check, u);
    integer_plant_step(&plant, x, u);
}

/* The time of this machine is the steps: while there are none it stands still. */
static void hold(void *context)
{
    (void)context;
}

/* --- at the end --- */

static void tell(const char *what, uint32_t number)
{
    print_text(what);
    print_decimal(number);
}

static void report(const struct step_loop *loop, const struct channel *channel)
{
    uint32_t refused = 0;
    uint32_t dropped = 0;
    for (unsigned k = 0; k < ONEBIT_REFUSALS; ++k) {
        /* Other agents than the neighbours are on the bus too. */
        refused += k == ONEBIT_REFUSED_UNKNOWN - ONEBIT_REFUSED_FIRST ? 0u : agent.refused[k];
    }
    for (unsigned k = 0; k < SLCAN_DROPS; ++k) {
        dropped += channel->parser.dropped[k];
    }
    tell("agent ", CONFIG->agent);
    tell(" steps ", loop->counts.steps);
    print_text(" checksum ");
    print_hexadecimal(~check);
    print_text(" states");
    for (unsigned state = 0; state < STATES; ++state) {
        print_text(" ");
        print_hexadecimal((uint32_t)x[state]);
    }
    tell(" late ", loop->counts.late);
    tell(" refused ", refused);
    tell(" aligned ", loop->counts.aligned);
    tell(" lines_dropped ", dropped);
    tell(" bytes_lost ", uart_lost());
    print_text("\n");
}

int main(void)
{
    static struct channel channel;
    static struct step_loop loop = {
        .config = CONFIG,
        .agent = &agent,
        .plant = {.measure = measure, .drive = drive, .hold = hold},
    };
    const struct channel_hooks uart = {.context = NULL, .put = put, .take = take};
    uart_start();
    channel_begin_device(&channel, &uart);
    loop.transport = channel_transport(&channel);
    for (unsigned state = 0; state < STATES; ++state) {
        x[state] = onebit_config_initial_states[(CONFIG->agent - 1) * STATES + state];
    }
    if (onebit_start(CONFIG, &agent, estimates, NULL) != ONEBIT_OK) {
        print_text("the library refuses the configuration\n");
        platform_exit(1);
    }
    /* After the stop it serves its line until the host closes it. */
    while (!loop.stopped || channel.open) {
        step_loop_run(&loop, 0); /* a board that has nothing else to do sleeps then */
    }
    while (!channel_flush(&channel)) {
    }
    report(&loop, &channel);
    platform_exit(0);
}
