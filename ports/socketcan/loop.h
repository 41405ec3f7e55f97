/*
 * What the event loops of nodes and master share: time, waiting, and the signals that end them.
 * Owns the process's handlers of SIGINT and SIGTERM, the one thing here that is not a parameter.
 */
#ifndef LOOP_H
#define LOOP_H

#include <poll.h>
#include <stdbool.h>
#include <stdint.h>
#include <time.h>

#define LOOP_SECOND UINT64_C(1000000000) /* nanoseconds */
#define LOOP_RETRY 1000000u              /* after which a full transmit queue is tried again */
#define LOOP_REVIVE 100000000u /* after which an interface that is down is looked at again */
#define LOOP_STATUS 250000000u /* between two writings of the status line */

#define LOOP_BATCH 64 /* frames taken from one socket before timers are looked at again */

/* Nanoseconds of a clock. */
uint64_t loop_now(clockid_t clock);

/* From now on SIGINT and SIGTERM are held back but while waiting, and end it. */
void loop_catch_signals(void);

/* Whether one came. */
bool loop_ended(void);

/* Waits for one of the files, a signal, or so long. */
void loop_wait(struct pollfd *files, nfds_t count, uint64_t nanoseconds);

#endif
