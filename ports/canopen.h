/*
 * What the master says beside SYNC: CANopen's network management (CiA 301), identifier 0x000, two
 * bytes of data: command, node (0: all). It is outside the identifiers of messages (0x081..0x7EF)
 * and wins every arbitration, so that it is heard on a full bus too. Pure.
 *
 *   command                            here
 *   0x01 start remote node             takes part again, from the next SYNC on
 *   0x02 stop remote node              no step, no message and no input until started
 *   0x80 enter pre-operational         the same: in that state too a node sends no process data
 *   0x81 reset node                    nothing: a reset of the machine is its firmware's, and an
 *   0x82 reset communication             agent has no communication parameters to set back
 *
 * A node that has power takes part without being started.
 *
 * `node` is CiA 301's node-ID, 1..127, which whoever plans the bus gives to each device on it. It
 * is not the agent's number: that goes beyond 127, and the same number may be the node-ID of
 * another device. A node without node-ID (0, or a number above 127) hears what is said to all.
 */
#ifndef CANOPEN_H
#define CANOPEN_H

#include "onebit_frame.h"

#include <stdbool.h>
#include <stdint.h>

#define CANOPEN_MANAGEMENT_IDENTIFIER 0x000u
#define CANOPEN_START 0x01u
#define CANOPEN_STOP 0x02u
#define CANOPEN_PREOPERATIONAL 0x80u
#define CANOPEN_NODE_MAX 127u

/* The frame that stops all nodes. */
static inline void canopen_stop_all(onebit_frame *frame)
{
    *frame = (onebit_frame){
        .identifier = CANOPEN_MANAGEMENT_IDENTIFIER, .length = 2, .data = {CANOPEN_STOP, 0}};
}

/* Whether a frame is network management that means this node. */
static inline bool canopen_means(const onebit_frame *frame, uint32_t node)
{
    return frame->identifier == CANOPEN_MANAGEMENT_IDENTIFIER && frame->flags == 0 &&
           frame->length == 2 &&
           (frame->data[1] == 0 || (frame->data[1] <= CANOPEN_NODE_MAX && frame->data[1] == node));
}

/* Whether a frame tells this node to stop ... */
static inline bool canopen_is_stop(const onebit_frame *frame, uint32_t node)
{
    return canopen_means(frame, node) &&
           (frame->data[0] == CANOPEN_STOP || frame->data[0] == CANOPEN_PREOPERATIONAL);
}

/* ... or to start. */
static inline bool canopen_is_start(const onebit_frame *frame, uint32_t node)
{
    return canopen_means(frame, node) && frame->data[0] == CANOPEN_START;
}

#endif
