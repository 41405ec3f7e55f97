/*
 * A whole firmware on a CAN controller: one agent of a system that onebit-design has written as
 * onebit_config.h. Everything of the hardware is behind board.h.
 */
#include "board.h"
#include "can_controller.h"
#include "onebit_config.h"
#include "step_loop.h"

static struct frame_queue_entry entries[32];
static struct can_controller can;
static onebit_estimate estimates[ONEBIT_CONFIG_NEIGHBOURS];
static onebit_agent agent;
static struct step_loop loop = {
    .agent = &agent,
    .plant = {.measure = board_measure, .drive = board_drive, .hold = board_hold},
    .period = ONEBIT_CONFIG_PERIOD_NANOSECONDS,
    /* By then all messages must have come; onebit-design tells how long the slowest takes. */
    .control_after = ONEBIT_CONFIG_PERIOD_NANOSECONDS / 4,
};

void can_receive_interrupt(void)
{
    can_controller_interrupt(&can);
}

static bool start(void)
{
    uint32_t number = board_agent();
    if (number == 0 || number > ONEBIT_CONFIG_AGENTS) {
        return false;
    }
    loop.config = onebit_configs[number - 1];
    loop.node = board_node();
    onebit_real initial[ONEBIT_CONFIG_NEIGHBOURS];
    for (unsigned k = 0; k < ONEBIT_CONFIG_NEIGHBOURS; ++k) {
        initial[k] = ONEBIT_CONFIG_ESTIMATE;
    }
    if (onebit_start(loop.config, &agent, estimates, initial) != ONEBIT_OK ||
        !can_controller_start(&can, &board_controller, entries, sizeof entries / sizeof *entries)) {
        return false;
    }
    loop.transport = can_controller_transport(&can);
    return true;
}

int main(void)
{
    if (!start()) {
        return 1;
    }
    board_start();
    while (!board_stopped()) {
        step_loop_run(&loop, can_controller_now(&can));
        /*
         * The one lock that the loop needs. A frame that came between the look and the sleep would
         * else wait for the next interrupt; so it is pending instead, and ends the sleep.
         */
        board_controller.lock(board_controller.context);
        if (!can_controller_waiting(&can)) {
            board_sleep();
        }
        board_controller.unlock(board_controller.context);
    }
    return 0;
}
