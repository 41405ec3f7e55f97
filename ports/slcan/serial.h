/*
 * The host's end of a serial line, for the hooks of channel.h: a terminal (/dev/ttyACM0, a pty),
 * set to raw bytes, or a Unix socket, as emulators offer it. Owns the file; never waits but in
 * serial_open. For Linux and other systems with termios.
 */
#ifndef SERIAL_H
#define SERIAL_H

#include "channel.h"
#include "problem.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define SERIAL_BUFFER 1024

struct serial {
    int handle;     /* for poll; -1 when closed */
    bool is_socket; /* else a terminal */
    bool down;      /* the other end or the device is gone; stays so */
    uint8_t in[SERIAL_BUFFER];
    size_t in_next;
    size_t in_end;
    uint64_t in_time; /* nanoseconds, CLOCK_MONOTONIC: when `in` was read */
    uint8_t out[SERIAL_BUFFER];
    size_t out_count;
};

/*
 * Opens PATH or PATH@SPEED (bit/s of a terminal; 115200). False and a line in *problem where that
 * cannot be; nothing is open then.
 */
bool serial_open(struct serial *serial, const char *path, struct problem *problem);

void serial_close(struct serial *serial);

/* put keeps bytes until serial_flush, or until there are many. *serial must stay where it is. */
struct channel_hooks serial_hooks(struct serial *serial);

/* Writes what is kept; true when nothing is left. To be called before waiting for the file. */
bool serial_flush(struct serial *serial);

#endif
