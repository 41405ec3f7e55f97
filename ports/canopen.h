/*
 * What the master says beside SYNC: CANopen's network management (CiA 301), command "stop remote
 * node". Identifier 0x000, data: command 0x02, node (0: all). It is outside the identifiers of
 * messages (0x081..0x7EF) and wins every arbitration, so that it is heard on a full bus too. Pure.
 */
#ifndef CANOPEN_H
#define CANOPEN_H

#include "onebit_frame.h"

#include <stdbool.h>
#include <stdint.h>

#define CANOPEN_MANAGEMENT_IDENTIFIER 0x000u
#define CANOPEN_STOP 0x02u
#define CANOPEN_NODE_MAX 127u /* agents above it are stopped only with all others */

/* The frame that ends all nodes. */
static inline void canopen_stop_all(onebit_frame *frame)
{
    *frame = (onebit_frame){
        .identifier = CANOPEN_MANAGEMENT_IDENTIFIER, .length = 2, .data = {CANOPEN_STOP, 0}};
}

/* Whether a frame tells this agent to end. */
static inline bool canopen_is_stop(const onebit_frame *frame, uint32_t agent)
{
    return frame->identifier == CANOPEN_MANAGEMENT_IDENTIFIER && frame->flags == 0 &&
           frame->length == 2 && frame->data[0] == CANOPEN_STOP &&
           (frame->data[1] == 0 || (frame->data[1] <= CANOPEN_NODE_MAX && frame->data[1] == agent));
}

#endif
