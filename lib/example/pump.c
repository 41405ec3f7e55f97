/*
 * All that firmware writes around the library: a pump that agrees with two others. The same text in
 * every arithmetic. A false says that the library has refused: the pump holds its pressure then.
 */
#include "pump.h"

#include <stddef.h>

#define OWN 1 /* number on the bus; with the neighbours' the only difference between the pumps */
static const uint32_t neighbours[] = {2, 3};
static const onebit_real stabilizing[] = {0};                    /* K1: a pump holds its pressure */
static const onebit_real compression[] = {ONEBIT_REAL(1.0, 30)}; /* K2 / sigma, sigma = 1 bar */
static const onebit_config config = {
    .agent = OWN,
    .neighbours = neighbours,
    .neighbour_count = 2,
    .state_count = 1,
    .format = ONEBIT_FORMAT_BROADCAST_PAYLOAD,
    .stabilizing = stabilizing,
    .compression = compression,
    .threshold = ONEBIT_NOISE(0.0),             /* c / sigma */
    .bound = ONEBIT_NOISE(2.0),                 /* M / sigma */
    .estimator_gain = ONEBIT_COEFFICIENT(25.0), /* beta / sigma */
    .control_gain = ONEBIT_COEFFICIENT(1.0),    /* gamma sigma */
    .start = 20,
    .fraction_bits = {.stabilizing = 30, .compression = 30, .state = 26, .control = 26},
    .seed = 1,
};
static onebit_estimate estimates[2];
static onebit_agent agent;
static onebit_real measured;

bool pump_start(void)
{
    return onebit_start(&config, &agent, estimates, NULL) == ONEBIT_OK;
}

bool pump_step_begins(onebit_real pressure)
{
    onebit_frame frame;
    measured = pressure;
    if (onebit_send(&config, &agent, &measured, 0, &frame) != ONEBIT_OK) {
        return false;
    }
    pump_send(&frame);
    return true;
}

void pump_receive(const onebit_frame *frame)
{
    /* What is not a neighbour's bit of this step is refused and counted in agent.refused. */
    (void)onebit_receive(&config, &agent, frame, ONEBIT_ALL_LINKED, NULL);
}

bool pump_step_ends(onebit_real *change)
{
    return onebit_control(&config, &agent, &measured, ONEBIT_ALL_LINKED, change) == ONEBIT_OK;
}
