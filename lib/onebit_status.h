/*
 * Status codes of the agent library. One meaning each; a call that returns anything but ONEBIT_OK
 * has changed nothing but, for a refused frame, that frame's counter. Arithmetic-independent.
 */
#ifndef ONEBIT_STATUS_H
#define ONEBIT_STATUS_H

#include <stdbool.h>

#ifdef __cplusplus
extern "C" {
#endif

typedef enum onebit_status {
    ONEBIT_OK = 0,

    /* The call. */
    ONEBIT_NULL,        /* a pointer is null */
    ONEBIT_NOT_STARTED, /* the agent was not started: onebit_start first */
    ONEBIT_STATE,       /* a state or what follows from it is not finite (floating) */
    ONEBIT_ESTIMATE,    /* an initial estimate is outside [-bound, bound] */
    ONEBIT_CLOCK,       /* the clock would fall below start + 1 */
    ONEBIT_MESSAGE,     /* the agent has no message of that place: onebit_message_count */
    ONEBIT_IDENTIFIER,  /* the message has no identifier: agent number 0 or too large */

    /* The configuration: the field that is wrong. Ranges stand with the fields in onebit_types.h.
     */
    ONEBIT_CONFIG_FORMAT,
    ONEBIT_CONFIG_AGENT,
    ONEBIT_CONFIG_NEIGHBOURS,
    ONEBIT_CONFIG_STATES,
    ONEBIT_CONFIG_STABILIZING,
    ONEBIT_CONFIG_COMPRESSION,
    ONEBIT_CONFIG_THRESHOLD, /* threshold, or one of those by neighbour */
    ONEBIT_CONFIG_BOUND,     /* or its sum with the size of a threshold */
    ONEBIT_CONFIG_ESTIMATOR_GAIN,
    ONEBIT_CONFIG_CONTROL_GAIN,
    ONEBIT_CONFIG_START,
    ONEBIT_CONFIG_FRACTION_BITS,
    ONEBIT_CONFIG_FIRST_LINK,

    /* A received frame that is refused and counted. Of these no message can be read .. */
    ONEBIT_REFUSED_FOREIGN,     /* the identifier is outside the format's: another protocol's */
    ONEBIT_REFUSED_LENGTH,      /* data length differs from the encoding's */
    ONEBIT_REFUSED_REMOTE,      /* remote frame */
    ONEBIT_REFUSED_ERROR_FRAME, /* error frame, as SocketCAN delivers it */
    ONEBIT_REFUSED_FLEXIBLE,    /* CAN FD frame */
    /* .. and these are messages. */
    ONEBIT_REFUSED_UNKNOWN,  /* not from a neighbour, or to another agent */
    ONEBIT_REFUSED_UNLINKED, /* from a neighbour that is not linked in this step */
    ONEBIT_REFUSED_REPEATED, /* second bit of this sender in this step; the first was taken */
    ONEBIT_REFUSED_STALE,    /* step number 1..64 behind the clock, modulo 128 */
    ONEBIT_REFUSED_EARLY,    /* step number 1..63 ahead of the clock, modulo 128 */

    ONEBIT_STATUS_COUNT /* of the codes; not one itself */
} onebit_status;

/* The counters of refused frames: that of code s stands at [s - ONEBIT_REFUSED_FIRST]. */
#define ONEBIT_REFUSED_FIRST ONEBIT_REFUSED_FOREIGN
#define ONEBIT_REFUSALS (ONEBIT_STATUS_COUNT - ONEBIT_REFUSED_FIRST)

/* Whether onebit_receive could read a message in the frame, taken or not. */
static inline bool onebit_is_message(onebit_status status)
{
    return status == ONEBIT_OK || status >= ONEBIT_REFUSED_UNKNOWN;
}

/*
 * The code's name as it stands above, for logs; "?" for a number that is no code. Never null. In an
 * object of its own, which firmware without it does not link.
 */
const char *onebit_status_name(onebit_status status);

#ifdef __cplusplus
}
#endif

#endif
