/*
 * How a node that restarted or missed a SYNC finds the group's clock again. Pure but for its own
 * few bytes of state; for every port. Arithmetic-independent.
 *
 * Where SYNC carries CiA 301's counter it tells t mod 128, and the node goes there at once
 * (alignment_sync). What frames say then moves nobody, until 8 steps have ended without such a
 * SYNC: one that was lost in between changes nothing, and a group whose master does not count any
 * more goes by its frames again.
 *
 * A message carries its sender's clock modulo 128. A frame of step s has the error
 * e = (s - t) mod 128: 0 is on time, 1..63 ahead, 65..127 behind; at 64 the clock with bit 6 clear
 * finds the other ahead. In a step in which some messages were off, a node moves by chance, to one
 * of them, all of them equally likely, with the probability
 *
 *     7/8 off / (off + weight on)
 *
 * where `on` and `off` count the messages of the step, and
 *
 *     the node                                                weight    moves
 *     new: less than 16 steps with a message on time          1         at once
 *     established, nothing on time in 4 steps in a row        (on = 0)  from the 4th such step on
 *     established, else (on at least 1), the message ahead    4         from the 8th step in a row
 *     established, else (on at least 1), the message behind   1024      with one off
 *
 * Steps without a message do not count; new is who has just started. Why so:
 * - A restarted node is new and moves; the others are not and wait until it has.
 * - A SYNC can be lost but not invented, so the clock that is ahead is right. A frame can come late
 *   but not before the SYNC that it answers, so one that is behind may be a slow transport's. A
 *   node whose frames are always late hardly pulls anybody, and whom it pulls soon returns.
 * - The loss of the only frame that is on time is not a reason to follow the late one: hence the
 *   4 steps, and that `on` is never taken as 0 before.
 * - 7/8, not 1: two that hear only each other would change places for ever.
 *
 * Every connected graph gathers with probability 1, if words of Threefry are taken as independent.
 * Given any state, let S be a connected set of nodes of one clock. With positive probability all
 * frames are heard in the next 9 steps and nobody moves; from the 9th on every node that hears
 * another clock draws. If S is not all, an edge leads from S to a node outside, and with positive
 * probability that one takes the clock of S in the next step and all others stay. So S becomes all
 * n nodes within 9 + n steps with a probability of at least some p > 0, the same for all states, as
 * there are finitely many; that it has not within k (9 + n) steps, with one of at most (1 - p)^k.
 * Where all frames are on time nobody draws and nobody moves: a group that has gathered stays so.
 *
 * The words are Threefry's of own number, clock and the count of words drawn, so that two nodes
 * that come back to earlier clocks draw other words there.
 *
 * Not covered: a neighbour whose frames were ahead for ever, which no bus makes, or whose step
 * number stands still. It would pull its neighbours again and again; in the example's group of
 * seven 57 % and 83 % of the messages on the worst link between others would still be taken. SYNC's
 * counter is the remedy.
 */
#ifndef ALIGNMENT_H
#define ALIGNMENT_H

#include "onebit_frame.h"

#include <stdint.h>

/* All 0 in the beginning. */
struct alignment {
    uint32_t draws;      /* words drawn since the start */
    uint32_t choice;     /* random, to choose among the messages that are off */
    uint8_t on;          /* messages on time in this step ... */
    uint8_t off;         /* ... and off, both saturating */
    uint8_t error;       /* of the one chosen */
    uint8_t confirmed;   /* steps with a message on time since the start, at most 16 */
    uint8_t unconfirmed; /* steps in a row with none on time, at most 4 */
    uint8_t doubted;     /* steps in a row with one off, at most 8 */
    uint8_t told;        /* steps to end in which frames do not count, as SYNC has told the time */
};

/*
 * Takes note of a neighbour's message at clock t; one without step number says nothing. Two
 * multiplications of 32 bits for a message that is off, none for one on time.
 */
void alignment_hear(struct alignment *alignment, uint32_t clock, const onebit_message *message);

/*
 * Ends the step. The steps, -64..127, by which the clock must move beyond the next step `next`
 * (t + 1) to be a neighbour's; 0 if it stays. The result does not lead below `first` (t0 + 1), and
 * a clock that has run through 2^32 counts as far above it. For onebit_advance, after the step's
 * control. One call of onebit_threefry at most, and none where all that was heard was on time: 43
 * instructions of a Cortex-M0 then, 216 with it (-O2).
 */
int32_t alignment_end_step(struct alignment *alignment, uint32_t agent, uint32_t next,
                           uint32_t first);

/*
 * At a SYNC that tells the time, after the step before it has ended: `residue`, 0..127, is t mod
 * 128 of the step that begins, the counter modulo 128, and `next` the node's own clock for it. The
 * steps by which that must move, as above; 0 if it is right.
 */
int32_t alignment_sync(struct alignment *alignment, uint8_t residue, uint32_t next, uint32_t first);

#endif
