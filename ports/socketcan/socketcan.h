/*
 * The transport of transport.h on Linux's raw CAN sockets. One socket a transport, bound to one
 * interface, non-blocking. Receives what its filters let through (in the kernel, so that other
 * traffic costs the process nothing), all error frames, and not its own frames; other sockets of
 * the host hear those. Times are the kernel's, of the system's clock (CLOCK_REALTIME).
 */
#ifndef SOCKETCAN_H
#define SOCKETCAN_H

#include "problem.h"
#include "transport.h"

#include <stdbool.h>
#include <stdint.h>

#define SOCKETCAN_FILTERS_MAX 256u
#define SOCKETCAN_NAME_MAX 16u

/* Lets a frame through whose identifier equals `identifier` where `mask` has ones. */
struct socketcan_filter {
    uint32_t identifier;
    uint32_t mask;
    bool extended;
};

struct socketcan_counts {
    uint64_t sent;
    uint64_t received;     /* SYNC and error frames among them */
    uint64_t queue_full;   /* refusals of a full transmit queue, every attempt */
    uint64_t lost;         /* frames that the full receive queue did not take */
    uint64_t error_frames; /* reports of the controller */
    uint64_t bus_off;      /* those among them that say so */
    uint64_t went_down;    /* times that the interface went down or away */
};

struct socketcan {
    int handle;        /* for poll; -1 when closed */
    bool down;         /* the interface is; see socketcan_revive */
    uint32_t overflow; /* the kernel's own count of lost frames, modulo 2^32 */
    char name[SOCKETCAN_NAME_MAX];
    struct socketcan_filter filters[SOCKETCAN_FILTERS_MAX]; /* the kernel forgets them with the
                                                               interface */
    uint32_t filter_count;
    struct socketcan_counts counts;
};

/*
 * Opens a socket on an interface that is there, is CAN and is up. False and a line in *problem
 * where it is not, or where the process may not; nothing is open then.
 */
bool socketcan_open(struct socketcan *socketcan, const char *interface,
                    const struct socketcan_filter *filters, uint32_t count,
                    struct problem *problem);

/* Sets the filters anew, at most SOCKETCAN_FILTERS_MAX; false when the kernel has no memory for
 * them, and the old ones stay. */
bool socketcan_filter(struct socketcan *socketcan, const struct socketcan_filter *filters,
                      uint32_t count);

void socketcan_close(struct socketcan *socketcan);

/* The hooks; *socketcan must stay where it is. */
struct transport socketcan_transport(struct socketcan *socketcan);

/*
 * While `down`: looks whether the interface is back, also as a new one of the same name, and takes
 * it up again. Some system calls: call it a few times a second, not in a loop.
 */
bool socketcan_revive(struct socketcan *socketcan);

#endif
