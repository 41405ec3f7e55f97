/*
 * An agent's steps over any transport, for firmware: SYNC begins a step (measure, encode, send),
 * frames are taken until it ends (control, drive), and the clock is aligned with SYNC's counter or
 * the group. While nobody tells it steps the machine is on hold. Allocates nothing, never waits,
 * and takes a bounded time a call. In the arithmetic of this file's compilation; one graph, that is
 * the neighbours of onebit_config in every step.
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

    /*
     * What the machine does while nobody tells it steps, until the next call of `drive`. Called
     * once each time it begins, see step_loop_run. Null: drive(0), by which a machine that keeps
     * its state by itself (K1 = 0) stands still. One that K1 stabilizes is then not stabilized: its
     * hook switches to a controller of its own, or keeps up u = K1 x.
     */
    void (*hold)(void *context);
};

/* Modulo 2^32; what the library refuses of frames it counts itself (onebit_agent.refused). */
struct step_loop_counts {
    uint32_t steps;        /* that ended with an input */
    uint32_t taken;        /* messages that moved an estimate */
    uint32_t late;         /* own messages given up or withdrawn as their step was over */
    uint32_t outside;      /* frames between the end of a step and the next SYNC */
    uint32_t duplicates;   /* messages that another node sends under the own number */
    uint32_t sync_refused; /* SYNC sooner than half a period after the last */
    uint32_t aligned;      /* moves of the clock to the group's */
    uint32_t held;         /* times that the machine went on hold */
    uint32_t refused;      /* messages and inputs refused by the library: a state not finite */
};

struct step_loop {
    /* To be filled in; the rest is 0 in the beginning. */
    const onebit_config *config;
    onebit_agent *agent; /* after onebit_start */
    struct transport transport;
    struct plant_hooks plant;
    uint8_t node; /* CANopen's node-ID, see canopen.h; 0: none, commands to all are heard */

    /* Nanoseconds. */
    uint64_t period;        /* of SYNC; 0: not known, then none comes too soon */
    uint64_t control_after; /* SYNC; 0: the next SYNC ends the step */
    uint64_t timeout;       /* without SYNC; 0: three periods, never if the period is not known */

    bool stopped; /* by the master */
    bool on_hold;
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
 * message that found no mailbox is tried again in the next call). `now` is in nanoseconds of the
 * clock that the transport's `receive` tells, read before the call; 0 where there is none, and then
 * period, control_after and timeout are 0 too. Takes the frames that wait, at most
 * STEP_LOOP_FRAMES, then does what the time asks for and sends what is to be sent.
 *
 * A step ends `control_after` its SYNC, once all messages must have come. So the input follows the
 * measurement after a small part of the period; if the next SYNC ends it, after a whole one, of
 * which the design's discrete model then has to know.
 *
 * The machine goes on hold
 * - in the beginning, unless the first call finds a SYNC;
 * - when no SYNC has come for `timeout`: a step still under way is given up, for it is old;
 * - when the master stops the node, which first ends the step under way as a SYNC does;
 * - at the end of a step whose input the library refuses, or of any if the agent was not started.
 * The next step that ends with an input drives the machine again; after a stop, one that begins
 * after the master's start. A SYNC's counter, else the neighbours' messages, then align the clock.
 */
void step_loop_run(struct step_loop *loop, uint64_t now);

#endif
