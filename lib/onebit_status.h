/*
 * Status codes of the agent library. One meaning each; a call that returns anything but ONEBIT_OK
 * has changed nothing but, for a refused frame, that frame's counter. Arithmetic-independent.
 */
#ifndef ONEBIT_STATUS_H
#define ONEBIT_STATUS_H

typedef enum onebit_status {
    ONEBIT_OK = 0,

    /* The call. */
    ONEBIT_NULL,       /* a pointer is null */
    ONEBIT_STATE,      /* a state or what follows from it is not finite (floating) */
    ONEBIT_ESTIMATE,   /* an initial estimate is outside [-bound, bound] */
    ONEBIT_CLOCK,      /* the clock would fall below start + 1 */
    ONEBIT_IDENTIFIER, /* the message has no identifier: agent number 0 or too large */

    /* The configuration: the field that is wrong. Ranges stand with the fields in onebit.h. */
    ONEBIT_CONFIG_AGENT,
    ONEBIT_CONFIG_NEIGHBOURS,
    ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_STABILIZING,
    ONEBIT_CONFIG_COMPRESSION,
    ONEBIT_CONFIG_THRESHOLD,
    ONEBIT_CONFIG_BOUND,
    ONEBIT_CONFIG_ESTIMATOR_GAIN,
    ONEBIT_CONFIG_CONTROL_GAIN,
    ONEBIT_CONFIG_START,
    ONEBIT_CONFIG_FRACTION_BITS,
    ONEBIT_CONFIG_FORMAT,

    /* A received frame that is refused and counted. */
    ONEBIT_UNKNOWN,     /* the identifier is not that of a neighbour's message to this agent */
    ONEBIT_REPEATED,    /* second bit of this sender in this step; the first was taken */
    ONEBIT_STALE,       /* step number 1..64 behind the clock, modulo 128 */
    ONEBIT_EARLY,       /* step number 1..63 ahead of the clock, modulo 128 */
    ONEBIT_LENGTH,      /* data length differs from the encoding's */
    ONEBIT_REMOTE,      /* remote frame */
    ONEBIT_ERROR_FRAME, /* error frame, as SocketCAN delivers it */
    ONEBIT_FLEXIBLE     /* CAN FD frame */
} onebit_status;

/* Number of counters of refused frames; the counter of code s stands at [s - ONEBIT_UNKNOWN]. */
#define ONEBIT_REFUSALS 8

#endif
