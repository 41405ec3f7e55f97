/*
 * How a node that restarted or missed a SYNC finds the group's clock again. Pure but for its own
 * few bytes of state; for every port. Arithmetic-independent.
 *
 * A message carries its sender's clock modulo 128. A frame of step s has the error
 * e = (s - t) mod 128. When all frames that a node hears in a step are off by the same e, it is the
 * node that is wrong, and it moves to the nearest step with that residue, not below its first.
 *
 * The rule alone never ends where two nodes hear only each other: both are off, both move, and they
 * have changed places. So a node has patience: it moves when it has been off by the same e for so
 * many steps with frames in a row:
 *
 *                                  has taken part      has not, since its start or last move
 *   a lower number was heard       3                   1
 *   the own number is the lowest   4                   2
 *
 * Of two that hear only each other one always moves first, and a node that has just started moves
 * before one that has been part of the group. A step without frames does not break a row.
 *
 * Where many nodes missed SYNC at once, each hears others that are off by different e and would
 * stay. So a node also follows the lowest number that it hears, if that is below its own, once that
 * one has been off by the same e in 16 of its messages in a row: the group gathers from the lowest.
 */
#ifndef ALIGNMENT_H
#define ALIGNMENT_H

#include "onebit_frame.h"

#include <stdbool.h>
#include <stdint.h>

struct alignment {
    uint32_t heard;  /* messages with a step number in this step */
    uint32_t lowest; /* number of their senders */
    uint8_t error;   /* of the first of them */
    uint8_t lowest_error;
    bool mixed;         /* another had another error */
    bool on_time;       /* one of them had none */
    bool settled;       /* heard on time since the start or the last move */
    uint8_t row_error;  /* what this node has been off by ... */
    uint8_t row;        /* ... for so many steps */
    uint32_t lead;      /* the lowest number heard since the start or the last move; 0: none ... */
    uint8_t lead_error; /* ... what this node has been off by from it ... */
    uint8_t lead_row;   /* ... for so many of its messages */
};

/* Takes note of a neighbour's message at clock t; one without step number says nothing. */
void alignment_hear(struct alignment *alignment, uint32_t clock, const onebit_message *message);

/*
 * Ends the step. The steps, -64..127, by which the clock must move beyond the next step `next`
 * (t + 1) to be the group's; 0 if it stays. next + the result is at least `first` (t0 + 1). For
 * onebit_advance, after the control of a step in which, all frames being off, nothing was heard.
 */
int32_t alignment_end_step(struct alignment *alignment, uint32_t agent, uint32_t next,
                           uint32_t first);

/*
 * At a SYNC that tells the time, after the step before it has ended: `residue`, 0..127, is t mod
 * 128 of the step that begins and `next` the node's own clock for it. The steps by which that must
 * move, as above; 0 if it is right.
 */
int32_t alignment_sync(struct alignment *alignment, uint8_t residue, uint32_t next, uint32_t first);

#endif
