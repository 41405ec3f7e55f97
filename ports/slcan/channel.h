/*
 * An end of a slcan line as a transport of ports/transport.h, over two hooks that put and take
 * bytes: a UART, a USB CDC endpoint, a terminal of the host.
 *
 * A device is what an adapter is to a host, and an agent that hangs on its host's serial line: it
 * answers the host's commands and is down until the host opens the channel. A host drives an
 * adapter, or such an agent: it opens the channel and counts the answers.
 *
 * Frames from the other end are received, frames sent go to the other end, on either side; no frame
 * comes back to its sender. No allocation, no C library; a call to send writes one line, a call to
 * receive takes the bytes of one frame or all that wait. A channel is not reentrant; a UART's
 * interrupts and the program that steps the agent meet in the hooks only.
 */
#ifndef CHANNEL_H
#define CHANNEL_H

#include "slcan.h"
#include "transport.h"

#include <stdbool.h>
#include <stdint.h>

struct channel_hooks {
    void *context; /* handed to the hooks as it stands */

    /* Hands a byte to the line; false if there is no room for it now. Never waits. */
    bool (*put)(void *context, uint8_t byte);

    /*
     * The oldest byte that came; false if none waits. *nanoseconds is when it came as nearly as can
     * be told, of a clock that does not depend on when this hook is called; a program that looks at
     * no times may leave it 0. Bytes lost for want of room are counted by whoever keeps the queue.
     */
    bool (*take)(void *context, uint8_t *byte, uint64_t *nanoseconds);
};

/* 16 bits each, saturating. */
struct channel_counts {
    uint16_t full;      /* send: TRANSPORT_LATER, the line still had the last to take */
    uint16_t unsayable; /* send: frames that the protocol cannot say, LATER too */
    uint16_t refused;   /* host: BEL from the device; device: BEL to the host */
};

struct channel {
    struct channel_hooks hooks;
    bool host;
    bool open;         /* frames pass; else the transport is down */
    bool listen_only;  /* device: the host opened it so; its frames are refused */
    bool heard;        /* the other end has ended a line, or refused */
    bool version_told; /* host: since channel_ask_version */
    uint8_t pending;   /* characters of `out` that the line has yet to take ... */
    uint8_t next;      /* ... from here on */
    uint8_t out[SLCAN_LINE_MAX + 1];
    struct slcan_parser parser;
    struct channel_counts counts;
};

/* Begins an end, closed. */
void channel_begin_device(struct channel *channel, const struct channel_hooks *hooks);
void channel_begin_host(struct channel *channel, const struct channel_hooks *hooks);

/*
 * Host: clears the other end's line, closes its channel, sets the bit rate (0..8 for 10, 20, 50,
 * 100, 125, 250, 500, 800 kbit/s and 1 Mbit/s) and opens it. Adapters differ in what they answer,
 * and some do not, so the channel is open from here on; `heard` tells whether someone is there. A
 * board that was still starting may have missed it: call again until it answers. False, and nothing
 * was done, while the line is still taking something else.
 */
bool channel_open(struct channel *channel, uint8_t bit_rate);

/*
 * Host: asks for the version. Devices answer in order: when `version_told` becomes true, all that
 * went before has been taken. False, and nothing was done, while the line is still taking something
 * else.
 */
bool channel_ask_version(struct channel *channel);

/* Host: closes it; false, and nothing was done, while the line is still taking something else. */
bool channel_close(struct channel *channel);

/* Hands over what is still to go; true when nothing is left. Send and receive do so by themselves.
 */
bool channel_flush(struct channel *channel);

/* The hooks of transport.h; *channel must stay where it is. */
struct transport channel_transport(struct channel *channel);

#endif
