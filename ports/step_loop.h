/*
 * An agent's steps over any transport, for firmware: SYNC begins a step (measure, encode, send),
 * frames are taken until it ends (control, drive), the clock is aligned with the group; the
 * master's stop ends it all. Allocates nothing, never waits, and takes a bounded time a call. In
 * the arithmetic of this file's compilation; one graph, that is the neighbours of onebit_config in
 * every step.
 */
#ifndef STEP_LOOP_H
#define STEP_LOOP_H

#include "alignment.h"
#include "onebit.h"
#include "transport.h"

#include <stdbool.h>
#include <stdint.h>

/* The machine that the agent moves. */
struct plant_hooks {
    void *context;

    /* The states as they are now, n of them, in the configuration's format. */
    void (*measure)(void *context, onebit_real *x);

    /* The input, to be held until the next call; in the configuration's format. */
    void (*drive)(void *context, onebit_real u);
};

/* Modulo 2^32; what the library refuses it counts itself (onebit_agent.refused). */
struct step_loop_counts {
    uint32_t steps;        /* that ended */
    uint32_t taken;        /* messages that moved an estimate */
    uint32_t late;         /* own messages given up or withdrawn as their step was over */
    uint32_t outside;      /* frames between the end of a step and the next SYNC */
    uint32_t duplicates;   /* messages that another node sends under the own number */
    uint32_t sync_refused; /* SYNC sooner than half a period after the last */
    uint32_t aligned;      /* moves of the clock to the group's */
};

struct step_loop {
    /* To be filled in; the rest is 0 in the beginning. */
    const onebit_config *config;
    onebit_agent *agent; /* after onebit_start */
    struct transport transport;
    struct plant_hooks plant;
    uint64_t period; /* nanoseconds; 0: not known, then no SYNC comes too soon */

    bool stopped; /* by the master, who ended the last step; nothing happens any more */
    bool in_step;
    bool synced;                      /* a SYNC has been taken ... */
    uint64_t sync_time;               /* ... the last one at this time of the transport's clock */
    uint8_t message;                  /* the next to send in this step */
    onebit_real x[ONEBIT_STATES_MAX]; /* measured as the step began */
    struct alignment alignment;
    struct step_loop_counts counts;
};

#define STEP_LOOP_FRAMES 64u /* most that one call takes */

/*
 * To be called after every interrupt that brought a frame, and about once a millisecond besides (a
 * message that found no mailbox is tried again in the next call): takes the frames that wait, at
 * most STEP_LOOP_FRAMES, and sends what is to be sent. SYNC ends the step before it, unless
 * step_loop_end_step has.
 */
void step_loop_run(struct step_loop *loop);

/*
 * Ends the step before the next SYNC does, once all messages must have come; nothing if none is
 * under way. With it the input follows the measurement after a small part of the period; without
 * it after a whole one, of which the design's discrete model then has to know.
 */
void step_loop_end_step(struct step_loop *loop);

#endif
