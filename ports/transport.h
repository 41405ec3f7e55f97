/*
 * The contract between an agent's program and the bus it hangs on. A port fills in the hooks;
 * whoever steps the agent calls them and knows nothing of sockets, registers or interrupts.
 *
 * No hook ever blocks, allocates or waits. All belong to the one thread (or interrupt level) that
 * steps the agent: a transport is not reentrant, different transports are independent.
 */
#ifndef TRANSPORT_H
#define TRANSPORT_H

#include "onebit_frame.h"

#include <stdint.h>

enum transport_status {
    TRANSPORT_DONE,  /* send: the frame is in the transmit queue; receive: *frame is a frame */
    TRANSPORT_LATER, /* send: no room in the queue now, nothing was sent; receive: nothing waits */
    TRANSPORT_DOWN   /* the link is down (interface down or gone, bus off): nothing was done */
};

struct transport {
    void *context; /* handed to the hooks as it stands */

    /*
     * Queues one frame for the bus. Frames leave in the order queued. After TRANSPORT_LATER the
     * caller tries again after some time of its own choosing, never at once in a loop, and
     * gives the frame up when its step is over: a bit is worth nothing in another step. Every
     * TRANSPORT_LATER is counted by the port. *frame is not kept.
     */
    enum transport_status (*send)(void *context, const onebit_frame *frame);

    /*
     * At the end of a step: takes back the frames that were queued and are not on the wire yet, and
     * tells how many. Null where the queue keeps what it has: such frames leave in another step,
     * and receivers know them as stale only in payload form.
     */
    uint32_t (*withdraw)(void *context);

    /*
     * The oldest frame that waits, whatever it is: data, remote, CAN FD, or a report of the
     * controller (ONEBIT_FRAME_ERROR). Own frames never come back, and a port may leave out
     * identifiers that the agent did not ask for. *nanoseconds is when the frame ended on the bus
     * as nearly as the port can tell, on a clock of the port's choosing that does not depend on
     * when this hook is called. Frames that were lost for want of room are counted by the port.
     * On anything but TRANSPORT_DONE neither *frame nor *nanoseconds is touched.
     */
    enum transport_status (*receive)(void *context, onebit_frame *frame, uint64_t *nanoseconds);
};

#endif
