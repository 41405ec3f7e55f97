/* All that firmware writes around the library: a pump that agrees with two others, in q31. */
#include "pump.h"

#include "onebit.h"
#include "onebit_random.h"

#include <stddef.h>

#define OWN 1 /* number on the bus; with the neighbours' the only difference between the pumps */
static const uint32_t neighbours[] = {2, 3};
static const int32_t stabilizing[] = {0};                     /* K1: a pump holds its pressure */
static const int32_t compression[] = {ONEBIT_FIXED(1.0, 30)}; /* K2 / sigma, sigma = 1 bar */
static const onebit_config config = {
    .agent = OWN,
    .neighbours = neighbours,
    .neighbour_count = 2,
    .state_count = 1,
    .format = {ONEBIT_BROADCAST, ONEBIT_PAYLOAD, ONEBIT_PAYLOAD_BASE},
    .stabilizing = stabilizing,
    .compression = compression,
    .threshold = ONEBIT_FIXED(0.0, 27), /* c / sigma */
    .bound = ONEBIT_FIXED(2.0, 27),     /* M / sigma */
    .estimator_gain = {25, 0},          /* beta / sigma = 25 / 2^0 */
    .control_gain = {1, 0},             /* gamma sigma */
    .start = 20,
    .fraction_bits = {.stabilizing = 30, .compression = 30, .state = 26, .control = 26},
};
static onebit_link links[2];
static onebit_agent agent;
static int32_t measured;

bool pump_start(void)
{
    return onebit_start(&config, &agent, links, NULL) == ONEBIT_OK;
}

void pump_step_begins(int32_t pressure)
{
    onebit_message message = {.sender = OWN, .step = (uint8_t)(agent.clock % ONEBIT_STEP_MODULUS)};
    onebit_frame frame;
    measured = pressure;
    onebit_encode(&config, &measured, onebit_random_word(1, 0, OWN, agent.clock), &message.bit);
    onebit_frame_encode(&config.format, &message, &frame);
    pump_send(&frame);
}

void pump_receive(const onebit_frame *frame)
{
    onebit_receive(&config, &agent, frame); /* refuses and counts what is not a neighbour's bit */
}

int32_t pump_step_ends(void)
{
    int32_t change = 0;
    onebit_control(&config, &agent, &measured, &change);
    return change;
}
