/* The loop of step_loop.h. Touches its argument, the agent and what the hooks lead to. */
#include "step_loop.h"

#include "canopen.h"

#include <stddef.h>

#define TIMEOUT_PERIODS 3u

static void hold(struct step_loop *loop)
{
    if (loop->on_hold) {
        return;
    }
    loop->on_hold = true;
    ++loop->counts.held;
    if (loop->plant.hold != NULL) {
        loop->plant.hold(loop->plant.context);
    } else {
        loop->plant.drive(loop->plant.context, 0);
    }
}

static void begin_step(struct step_loop *loop)
{
    loop->plant.measure(loop->plant.context, loop->x);
    loop->message = 0;
    loop->in_step = true;
}

static void move_clock(struct step_loop *loop, int32_t steps)
{
    if (steps != 0 && onebit_advance(loop->config, loop->agent, steps) == ONEBIT_OK) {
        ++loop->counts.aligned;
    }
}

/* The step is over: takes back what was not sent, and looks at whose clock it was. */
static void leave_step(struct step_loop *loop)
{
    loop->in_step = false;
    loop->counts.late += onebit_message_count(loop->config) - loop->message;
    if (loop->transport.withdraw != NULL) {
        loop->counts.late += loop->transport.withdraw(loop->transport.context);
    }
    move_clock(loop, alignment_end_step(&loop->alignment, loop->config->agent, loop->agent->clock,
                                        loop->config->start + 1u));
}

/* The step has no input, but the group's clock goes on. An agent not started has none: refused. */
static void give_up_step(struct step_loop *loop)
{
    (void)onebit_advance(loop->config, loop->agent, 1);
    leave_step(loop);
}

static void end_step(struct step_loop *loop)
{
    onebit_real u;
    if (!loop->in_step) {
        return;
    }
    if (onebit_control(loop->config, loop->agent, loop->x, ONEBIT_ALL_LINKED, &u) != ONEBIT_OK) {
        ++loop->counts.refused;
        hold(loop);
        give_up_step(loop);
        return;
    }
    loop->on_hold = false;
    loop->plant.drive(loop->plant.context, u);
    ++loop->counts.steps;
    leave_step(loop);
}

/* `told` is the step's t modulo 128, or ONEBIT_NO_STEP. */
static void take_sync(struct step_loop *loop, uint8_t told, uint64_t time)
{
    if (loop->synced && time - loop->sync_time < loop->period / 2) {
        ++loop->counts.sync_refused;
        return;
    }
    loop->synced = true;
    loop->sync_time = time;
    end_step(loop);
    if (told != ONEBIT_NO_STEP) {
        move_clock(loop, alignment_sync(&loop->alignment, told, loop->agent->clock,
                                        loop->config->start + 1u));
    }
    begin_step(loop);
}

static void take_message(struct step_loop *loop, const onebit_frame *frame)
{
    onebit_message message;
    onebit_status status =
        onebit_receive(loop->config, loop->agent, frame, ONEBIT_ALL_LINKED, &message);
    if (status == ONEBIT_OK) {
        ++loop->counts.taken;
    }
    if (status != ONEBIT_REFUSED_UNKNOWN && onebit_is_message(status)) {
        alignment_hear(&loop->alignment, loop->agent->clock, &message);
    } else if (onebit_is_message(status) && message.sender == loop->config->agent) {
        ++loop->counts.duplicates;
    }
}

static void take_frame(struct step_loop *loop, const onebit_frame *frame, uint64_t time)
{
    uint8_t told;
    if (canopen_is_start(frame, loop->node)) {
        loop->stopped = false;
    } else if (loop->stopped) {
        return;
    } else if (canopen_is_stop(frame, loop->node)) {
        end_step(loop);
        hold(loop);
        loop->stopped = true;
    } else if (onebit_frame_is_sync(&loop->config->format, frame, &told)) {
        take_sync(loop, told, time);
    } else if (loop->in_step) {
        take_message(loop, frame);
    } else {
        ++loop->counts.outside;
    }
}

static void look_at_time(struct step_loop *loop, uint64_t now)
{
    /* A frame may have come after `now` was read. */
    uint64_t since = now > loop->sync_time ? now - loop->sync_time : 0;
    uint64_t timeout = loop->timeout != 0 ? loop->timeout : TIMEOUT_PERIODS * loop->period;
    if (!loop->synced || (timeout != 0 && since >= timeout)) {
        hold(loop);
        if (loop->in_step) {
            give_up_step(loop);
        }
    } else if (loop->control_after != 0 && since >= loop->control_after) {
        end_step(loop);
    }
}

static void send_messages(struct step_loop *loop)
{
    while (loop->in_step && loop->message < onebit_message_count(loop->config)) {
        onebit_frame frame;
        if (onebit_send(loop->config, loop->agent, loop->x, loop->message, &frame) != ONEBIT_OK) {
            ++loop->counts.refused;
        } else if (loop->transport.send(loop->transport.context, &frame) != TRANSPORT_DONE) {
            return; /* the next call tries again */
        }
        ++loop->message;
    }
}

void step_loop_run(struct step_loop *loop, uint64_t now)
{
    onebit_frame frame;
    uint64_t time;
    for (unsigned k = 0; k < STEP_LOOP_FRAMES; ++k) {
        if (loop->transport.receive(loop->transport.context, &frame, &time) != TRANSPORT_DONE) {
            break;
        }
        take_frame(loop, &frame, time);
    }
    look_at_time(loop, now);
    send_messages(loop);
}
