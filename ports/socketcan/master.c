/* The master of master.h. Reads the clock, its socket and signals; writes its summary. */
#include "master.h"

#include "canopen.h"
#include "chain.h"
#include "command_line.h"
#include "loop.h"
#include "socketcan.h"

#include <cjson/cJSON.h>
#include <inttypes.h>
#include <stdio.h>
#include <unistd.h>

#define MISSING LOOP_SECOND /* a step of period 0 waits no longer for its messages */
#define STOP_ATTEMPTS 1000  /* LOOP_RETRY apart */

struct state {
    const struct master *master;
    struct socketcan socketcan;
    struct transport transport;
    struct chain chain;
    uint64_t next;     /* when the next SYNC is due, monotonic */
    bool waiting;      /* a SYNC is due that the queue or the interface did not take */
    uint64_t try_time; /* of it */
    uint64_t revive_time;
    uint32_t expected; /* messages of this step, period 0 */
    uint32_t heard;
    uint64_t sent;
    uint64_t late;       /* SYNC that found no room in their period and were withdrawn */
    uint64_t incomplete; /* steps of period 0 whose messages did not all come */
    uint64_t deadline_misses;
    uint64_t other_masters; /* SYNC that another process sent */
};

/* Messages that the whole group sends in the step of a clock. */
static uint32_t messages_at(struct state *state, uint32_t t)
{
    const struct topology *topology = &state->master->scenario->topology;
    if (state->master->scenario->format.mode != ONEBIT_MODE_LINK) {
        return topology->agent_count;
    }
    uint32_t graph = chain_graph(&state->chain, t);
    uint32_t count = 0;
    for (uint32_t link = 0; link < topology->link_count; ++link) {
        count += topology->linked[(size_t)graph * topology->link_count + link];
    }
    return count;
}

static void receive_frames(struct state *state)
{
    bool was_down = state->socketcan.down;
    enum transport_status status = TRANSPORT_DONE;
    for (int k = 0; k < LOOP_BATCH && status == TRANSPORT_DONE; ++k) {
        onebit_frame frame;
        onebit_message message;
        uint64_t time;
        uint8_t told;
        status = state->transport.receive(state->transport.context, &frame, &time);
        if (status != TRANSPORT_DONE) {
            break;
        }
        if (onebit_frame_is_sync(&state->master->scenario->format, &frame, &told)) {
            if (state->other_masters++ == 0) {
                fputs("onebit-node: another process sends SYNC too\n", stderr);
            }
        } else if (onebit_frame_decode(&state->master->scenario->format, &frame, &message) ==
                   ONEBIT_OK) {
            ++state->heard;
        }
    }
    if (state->socketcan.down && !was_down) {
        fputs("onebit-node: the interface went down; waiting for it\n", stderr);
    }
}

static bool send_sync(struct state *state, uint64_t now)
{
    uint32_t t = state->master->scenario->t0 + 1u + (uint32_t)state->sent;
    onebit_frame frame;
    onebit_frame_sync(&state->master->scenario->format, t, &frame);
    state->heard = 0;
    state->waiting = state->transport.send(state->transport.context, &frame) != TRANSPORT_DONE;
    state->try_time = now + LOOP_RETRY;
    if (state->waiting) {
        return false;
    }
    state->expected = state->master->period > 0 ? 0 : messages_at(state, t);
    ++state->sent;
    return true;
}

/* Whether the step that was begun last is over; a step that is late is counted. */
static bool step_over(struct state *state, uint64_t now)
{
    if (state->master->period > 0) {
        return now >= state->next;
    }
    if (state->heard >= state->expected) {
        return true;
    }
    if (now < state->next) {
        return false;
    }
    ++state->incomplete;
    return true;
}

/* The time of the SYNC after one that is due now. */
static void set_next(struct state *state, uint64_t now)
{
    if (!(state->master->period > 0)) {
        state->next = now + MISSING;
        return;
    }
    uint64_t period = (uint64_t)(state->master->period * LOOP_SECOND);
    if (now - state->next > period / 2) {
        /* Nodes would refuse a next SYNC that keeps to the old times as too soon. */
        ++state->deadline_misses;
        state->next = now;
    }
    state->next += period;
}

/* After a SYNC that had to wait: what followed in less than half a period would be refused. */
static void set_next_after_delay(struct state *state, uint64_t now)
{
    state->next = now;
    set_next(state, now);
}

static void revive(struct state *state, uint64_t now)
{
    if (state->socketcan.down && now >= state->revive_time) {
        state->revive_time = now + LOOP_REVIVE;
        if (socketcan_revive(&state->socketcan)) {
            fputs("onebit-node: the interface is back\n", stderr);
        }
    }
}

static void wait_for_frames(const struct state *state)
{
    uint64_t now = loop_now(CLOCK_MONOTONIC);
    uint64_t due = state->next;
    if (state->waiting && state->try_time < due) {
        due = state->try_time;
    }
    if (state->socketcan.down && state->revive_time < due) {
        due = state->revive_time;
    }
    struct pollfd file = {.fd = state->socketcan.handle, .events = POLLIN};
    loop_wait(&file, 1, due > now ? due - now : 0);
}

/* Steps the group until all steps are over or a signal comes. */
static void run(struct state *state)
{
    uint32_t steps = state->master->steps;
    bool status_line = isatty(STDERR_FILENO) != 0;
    uint64_t status_time = 0;
    state->next = loop_now(CLOCK_MONOTONIC);
    while (!loop_ended()) {
        uint64_t now = loop_now(CLOCK_MONOTONIC);
        revive(state, now);
        if (step_over(state, now)) {
            if (steps != 0 && state->sent >= steps && !state->waiting) {
                break;
            }
            state->late += state->waiting;
            set_next(state, now);
            send_sync(state, now);
        } else if (state->waiting && now >= state->try_time && send_sync(state, now)) {
            set_next_after_delay(state, now);
        }
        if (status_line && now >= status_time) {
            status_time = now + LOOP_STATUS;
            fprintf(stderr, "\r\033[KSYNC %" PRIu64 "%s", state->sent,
                    state->socketcan.down ? ", the interface is down" : "");
        }
        if (!step_over(state, now) || state->waiting) {
            wait_for_frames(state);
        }
        receive_frames(state);
    }
    if (status_line) {
        fputs("\r\033[K", stderr);
    }
}

/* Says on the bus that it is over. */
static bool send_stop(struct state *state)
{
    onebit_frame frame;
    canopen_stop_all(&frame);
    for (int k = 0; k < STOP_ATTEMPTS; ++k) {
        if (state->transport.send(state->transport.context, &frame) == TRANSPORT_DONE) {
            return true;
        }
        usleep(LOOP_RETRY / 1000);
    }
    return false;
}

static bool summarize(const struct state *state, double seconds, struct problem *problem)
{
    const struct master *master = state->master;
    if (!master->json) {
        printf("SYNC sent %" PRIu64 ", late %" PRIu64 ", incomplete steps %" PRIu64
               ", deadline misses %" PRIu64 ", of other masters %" PRIu64 ", %.3f s\n",
               state->sent, state->late, state->incomplete, state->deadline_misses,
               state->other_masters, seconds);
    } else {
        cJSON *object = cJSON_CreateObject();
        cJSON_AddStringToObject(object, "scenario", master->scenario->name);
        cJSON_AddStringToObject(object, "interface", master->interface);
        cJSON_AddStringToObject(object, "ended", loop_ended() ? "signal" : "steps");
        cJSON_AddNumberToObject(object, "seconds", seconds);
        cJSON_AddNumberToObject(object, "syncs", (double)state->sent);
        cJSON_AddNumberToObject(object, "late", (double)state->late);
        cJSON_AddNumberToObject(object, "incomplete", (double)state->incomplete);
        cJSON_AddNumberToObject(object, "deadline_misses", (double)state->deadline_misses);
        cJSON_AddNumberToObject(object, "other_masters", (double)state->other_masters);
        cJSON_AddNumberToObject(object, "queue_full", (double)state->socketcan.counts.queue_full);
        cJSON_AddNumberToObject(object, "interface_down",
                                (double)state->socketcan.counts.went_down);
        char *text = cJSON_Print(object);
        puts(text != NULL ? text : "");
        cJSON_free(text);
        cJSON_Delete(object);
    }
    return fflush(stdout) == 0 || problem_set(problem, "standard output: a write failed");
}

int master_run(const struct master *master, struct problem *problem)
{
    struct state state = {.master = master};
    bool link = master->scenario->format.mode == ONEBIT_MODE_LINK;
    /* SYNC of others; and the group's messages where they are waited for. */
    const struct socketcan_filter filters[] = {
        {master->scenario->format.sync, 0x7FF, false},
        {link ? ONEBIT_LINK_BASE : 0, link ? ONEBIT_LINK_BASE : 0, link},
    };
    if (!socketcan_open(&state.socketcan, master->interface, filters, master->period > 0 ? 1 : 2,
                        problem)) {
        return BAD_USE;
    }
    state.transport = socketcan_transport(&state.socketcan);
    chain_begin(&state.chain, &master->scenario->topology, master->seed, master->run,
                master->scenario->t0 + 1u);
    loop_catch_signals();
    uint64_t begun = loop_now(CLOCK_MONOTONIC);
    run(&state);
    double seconds = (double)(loop_now(CLOCK_MONOTONIC) - begun) / LOOP_SECOND;
    bool good = send_stop(&state) ||
                problem_set(problem, "%s: the stop could not be sent", master->interface);
    socketcan_close(&state.socketcan);
    return summarize(&state, seconds, problem) && good ? DONE : FAILURE;
}
