/*
 * Seven aircraft on one chip: the agents of sim/scenarios/aircraft-integer.yaml, each with its
 * machine in integers, on a bus that is a call. Prints after some steps, for each agent, the CRC-32
 * (checksum.h) of all estimates and controls so far, which must be the same on every processor:
 * aircraft.txt. Of each step come an agent's estimates, ascending by neighbour, as they are when it
 * controls, then its control.
 */
#include "checksum.h"
#include "integer_plant.h"
#include "onebit_config.h"
#include "platform.h"
#include "print.h"

#include <stddef.h>

#define AGENTS ONEBIT_CONFIG_AGENTS
#define STATES ONEBIT_CONFIG_STATES

#define STEPS 5000u

static const struct integer_plant plant = {
    .state_count = STATES,
    .A_fraction_bits = ONEBIT_CONFIG_PLANT_A_FRACTION_BITS,
    .B_fraction_bits = ONEBIT_CONFIG_PLANT_B_FRACTION_BITS,
    .state_fraction_bits = ONEBIT_CONFIG_STATE_FRACTION_BITS,
    .control_fraction_bits = ONEBIT_CONFIG_CONTROL_FRACTION_BITS,
    .A = onebit_config_plant_A,
    .B = onebit_config_plant_B,
};

static struct aircraft {
    onebit_agent agent;
    onebit_estimate estimates[ONEBIT_CONFIG_NEIGHBOURS];
    int32_t x[STATES];
    uint32_t checksum; /* the CRC's register */
} group[AGENTS];

/* The library refused what it must not. */
static void fail(const char *call, unsigned number, onebit_status status)
{
    print_text(call);
    print_text(" of agent ");
    print_decimal(number);
    print_text(": status ");
    print_decimal((uint32_t)status);
    print_text("\n");
    platform_exit(1);
}

static void start(void)
{
    for (unsigned k = 0; k < AGENTS; ++k) {
        struct aircraft *aircraft = &group[k];
        onebit_status status =
            onebit_start(onebit_configs[k], &aircraft->agent, aircraft->estimates, NULL);
        if (status != ONEBIT_OK) {
            fail("start", k + 1, status);
        }
        for (unsigned state = 0; state < STATES; ++state) {
            aircraft->x[state] = onebit_config_initial_states[k * STATES + state];
        }
        aircraft->checksum = CHECKSUM_BEGIN;
    }
}

/* A frame on the bus: everyone but its sender gets it, who is not its neighbour refuses it. */
static void deliver(const onebit_frame *frame, unsigned sender)
{
    for (unsigned k = 0; k < AGENTS; ++k) {
        if (k != sender) {
            onebit_status status =
                onebit_receive(onebit_configs[k], &group[k].agent, frame, ONEBIT_ALL_LINKED, NULL);
            if (status != ONEBIT_OK && status != ONEBIT_REFUSED_UNKNOWN) {
                fail("receive", k + 1, status);
            }
        }
    }
}

static void send(unsigned k)
{
    onebit_frame frame;
    onebit_status status = onebit_send(onebit_configs[k], &group[k].agent, group[k].x, 0, &frame);
    if (status != ONEBIT_OK) {
        fail("send", k + 1, status);
    }
    deliver(&frame, k);
}

static void control(unsigned k)
{
    struct aircraft *aircraft = &group[k];
    int32_t u = 0;
    onebit_status status =
        onebit_control(onebit_configs[k], &aircraft->agent, aircraft->x, ONEBIT_ALL_LINKED, &u);
    if (status != ONEBIT_OK) {
        fail("control", k + 1, status);
    }
    for (unsigned place = 0; place < onebit_configs[k]->neighbour_count; ++place) {
        aircraft->checksum = checksum(aircraft->checksum, aircraft->estimates[place].value);
    }
    aircraft->checksum = checksum(aircraft->checksum, u);
    integer_plant_step(&plant, aircraft->x, u);
}

static void print_checksums(uint32_t step)
{
    print_text("step ");
    print_decimal(step);
    for (unsigned k = 0; k < AGENTS; ++k) {
        print_text(" ");
        print_hexadecimal(~group[k].checksum);
    }
    print_text("\n");
}

int main(void)
{
    uint32_t next_print = 1;
    start();
    for (uint32_t step = 1; step <= STEPS; ++step) {
        for (unsigned k = 0; k < AGENTS; ++k) {
            send(k);
        }
        for (unsigned k = 0; k < AGENTS; ++k) {
            control(k);
        }
        if (step == next_print || step == STEPS) {
            print_checksums(step);
            next_print *= 10;
        }
    }
    platform_exit(0);
}
