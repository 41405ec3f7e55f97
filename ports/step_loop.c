/* The loop of step_loop.h. Touches its argument, the agent and what the hooks lead to. */
#include "step_loop.h"

#include "canopen.h"
#include "onebit_random.h"

#include <stddef.h>

/* Messages of a step: one for all in broadcast, one for each neighbour in link mode. */
static unsigned message_count(const struct step_loop *loop)
{
    return loop->config->format.mode == ONEBIT_LINK ? loop->config->neighbour_count : 1u;
}

/* Frame k of this step. A function of state, clock and k alone, so that none has to be kept. */
static bool encode(const struct step_loop *loop, unsigned k, onebit_frame *frame)
{
    const onebit_config *config = loop->config;
    bool link_mode = config->format.mode == ONEBIT_LINK;
    uint32_t t = loop->agent->clock;
    uint32_t link = link_mode ? loop->first_link + k : config->agent;
    onebit_message message = {
        .sender = config->agent,
        .receiver = link_mode ? config->neighbours[k] : 0,
        .step = (uint8_t)(t % ONEBIT_STEP_MODULUS),
    };
    /* Refused are a state that is not finite, and a number that the format cannot carry. */
    return onebit_encode(config, loop->x, onebit_random_word(loop->seed, 0, link, t),
                         &message.bit) == ONEBIT_OK &&
           onebit_frame_encode(&config->format, &message, frame) == ONEBIT_OK;
}

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
    loop->counts.late += message_count(loop) - loop->message;
    if (loop->transport.withdraw != NULL) {
        loop->counts.late += loop->transport.withdraw(loop->transport.context);
    }
    /* A state that is not finite is refused and the clock stands: the plant then gets no input. */
    onebit_real u = 0;
    if (onebit_control(loop->config, loop->agent, loop->x, &u) != ONEBIT_OK) {
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

static bool is_neighbour(const onebit_config *config, uint32_t number)
{
    for (unsigned k = 0; k < config->neighbour_count; ++k) {
        if (config->neighbours[k] == number) {
            return true;
        }
    }
    return false;
}

static void take_message(struct step_loop *loop, const onebit_frame *frame)
{
    const onebit_config *config = loop->config;
    onebit_message message;
    if (onebit_frame_decode(&config->format, frame, &message) == ONEBIT_OK) {
        if (message.sender == config->agent) {
            ++loop->counts.duplicates;
            return;
        }
        if (is_neighbour(config, message.sender) &&
            (config->format.mode != ONEBIT_LINK || message.receiver == config->agent)) {
            alignment_hear(&loop->alignment, loop->agent->clock, &message);
        }
    }
    if (onebit_receive(config, loop->agent, frame) == ONEBIT_OK) {
        ++loop->counts.taken;
    }
}

static void send_messages(struct step_loop *loop)
{
    while (loop->in_step && loop->message < message_count(loop)) {
        onebit_frame frame;
        if (encode(loop, loop->message, &frame) &&
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
        } else if (onebit_frame_is_sync(&frame)) {
            take_sync(loop, time);
        } else if (loop->in_step) {
            take_message(loop, &frame);
        } else {
            ++loop->counts.outside;
        }
    }
    send_messages(loop);
}
