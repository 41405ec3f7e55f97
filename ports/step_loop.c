/* The loop of step_loop.h. Touches its argument, the agent and what the hooks lead to. */
#include "step_loop.h"

#include "canopen.h"

#include <stddef.h>

static void begin_step(struct step_loop *loop)
{
    loop->plant.measure(loop->plant.context, loop->x);
    loop->message = 0;
    loop->in_step = true;
}

void step_loop_end_step(struct step_loop *loop)
{
    if (!loop->in_step) {
        return;
    }
    loop->in_step = false;
    loop->counts.late += onebit_message_count(loop->config) - loop->message;
    if (loop->transport.withdraw != NULL) {
        loop->counts.late += loop->transport.withdraw(loop->transport.context);
    }
    /* A state that is not finite is refused and the clock stands: the plant then gets no input. */
    onebit_real u = 0;
    if (onebit_control(loop->config, loop->agent, loop->x, ONEBIT_ALL_LINKED, &u) != ONEBIT_OK) {
        onebit_advance(loop->config, loop->agent, 1);
    }
    loop->plant.drive(loop->plant.context, u);
    ++loop->counts.steps;
    int32_t steps = alignment_end_step(&loop->alignment, loop->config->agent, loop->agent->clock,
                                       loop->config->start + 1u);
    if (steps != 0) {
        onebit_advance(loop->config, loop->agent, steps);
        ++loop->counts.aligned;
    }
}

static void take_sync(struct step_loop *loop, uint64_t time)
{
    if (loop->synced && time - loop->sync_time < loop->period / 2) {
        ++loop->counts.sync_refused;
        return;
    }
    loop->synced = true;
    loop->sync_time = time;
    step_loop_end_step(loop);
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

static void send_messages(struct step_loop *loop)
{
    while (loop->in_step && loop->message < onebit_message_count(loop->config)) {
        onebit_frame frame;
        /* Refused is a state that is not finite: nothing is sent then. */
        if (onebit_send(loop->config, loop->agent, loop->x, loop->message, &frame) == ONEBIT_OK &&
            loop->transport.send(loop->transport.context, &frame) != TRANSPORT_DONE) {
            return; /* the next call tries again */
        }
        ++loop->message;
    }
}

void step_loop_run(struct step_loop *loop)
{
    onebit_frame frame;
    uint64_t time;
    uint8_t told;
    for (unsigned k = 0; k < STEP_LOOP_FRAMES; ++k) {
        if (loop->transport.receive(loop->transport.context, &frame, &time) != TRANSPORT_DONE) {
            break;
        }
        if (loop->stopped) {
            continue;
        }
        if (canopen_is_stop(&frame, loop->config->agent)) {
            step_loop_end_step(loop);
            loop->stopped = true;
        } else if (onebit_frame_is_sync(&loop->config->format, &frame, &told)) {
            take_sync(loop, time);
        } else if (loop->in_step) {
            take_message(loop, &frame);
        } else {
            ++loop->counts.outside;
        }
    }
    send_messages(loop);
}
