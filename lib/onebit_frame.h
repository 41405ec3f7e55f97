/*
 * The one-bit message as a CAN frame. Pure functions without state; they allocate nothing, may be
 * called from any context, and take bounded time. Arithmetic-independent.
 *
 *   mode, encoding         identifier                                              DLC  data
 *   broadcast, payload     11 bit: base + sender, base 0x100                       1    t', bit
 *   broadcast, identifier  11 bit: base + 2 sender + bit, base 0x400               0
 *   link, payload          29 bit: 0x10000000 + (sender << 14) + (receiver << 1)   1    t', bit
 *   link, identifier       29 bit: the same + bit                                  0
 *   any: SYNC              11 bit: 0x080 (CANopen, CiA 301)                        1    counter
 *   any: stop, start       11 bit: 0x000 (CANopen, CiA 301; ports/canopen.h)        2
 *
 * SYNC comes from the master before every step. Its counter, 1..128, is that step's t modulo 128,
 * with 128 for 0; CiA 301 calls 128 the overflow value (object 1019h). SYNC without data is taken
 * as well and tells no step. Data "t', bit" is one byte: the clock t modulo 128 in bits 7..1, the
 * message bit in bit 0.
 *
 * The bit is the lowest of the identifier, so that it never decides arbitration between two agents.
 * 11-bit identifiers of messages stay in 0x081..0x7EF, between CANopen's SYNC and its reserved top.
 *
 * Firmware of one kind of bus may fix the format when the library is compiled, which leaves the
 * other formats' code out: -DONEBIT_ONLY_MODE=ONEBIT_MODE_BROADCAST (or _LINK) and
 * -DONEBIT_ONLY_ENCODING=ONEBIT_ENCODING_PAYLOAD (or _IDENTIFIER), together. Every other format is
 * then not valid.
 */
#ifndef ONEBIT_FRAME_H
#define ONEBIT_FRAME_H

#include "onebit_status.h"

#include <stdbool.h>
#include <stdint.h>

#ifdef __cplusplus
extern "C" {
#endif

#define ONEBIT_PAYLOAD_BASE 0x100u
#define ONEBIT_IDENTIFIER_BASE 0x400u
#define ONEBIT_LINK_BASE 0x10000000u
#define ONEBIT_SYNC_IDENTIFIER 0x080u

/* Steps are numbered modulo 128 on the bus. */
#define ONEBIT_STEP_MODULUS 128u

enum { ONEBIT_MODE_BROADCAST = 0, ONEBIT_MODE_LINK = 1 };
enum {
    ONEBIT_ENCODING_PAYLOAD = 0,
    ONEBIT_ENCODING_IDENTIFIER = 1,
    ONEBIT_ENCODING_NONE = 2 /* another bus: messages without frames, any agent number */
};

/* How messages stand on the bus; the same for all agents of a bus. */
typedef struct onebit_format {
    uint8_t mode;     /* ONEBIT_MODE_.. */
    uint8_t encoding; /* ONEBIT_ENCODING_.. */
    uint16_t base;    /* of the 11-bit identifiers, 0x080..0x7EE; not used in link mode */
    uint16_t sync;    /* identifier of SYNC: 1 to base, so that it wins; link mode: to 0x3FF */
} onebit_format;

/* The usual formats of each mode and encoding: {mode, encoding, ONEBIT_PAYLOAD_BASE, ..}. */
#define ONEBIT_FORMAT_BROADCAST_PAYLOAD                                                            \
    {                                                                                              \
        ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_PAYLOAD, ONEBIT_PAYLOAD_BASE,                       \
            ONEBIT_SYNC_IDENTIFIER                                                                 \
    }
#define ONEBIT_FORMAT_BROADCAST_IDENTIFIER                                                         \
    {                                                                                              \
        ONEBIT_MODE_BROADCAST, ONEBIT_ENCODING_IDENTIFIER, ONEBIT_IDENTIFIER_BASE,                 \
            ONEBIT_SYNC_IDENTIFIER                                                                 \
    }
#define ONEBIT_FORMAT_LINK_PAYLOAD                                                                 \
    {                                                                                              \
        ONEBIT_MODE_LINK, ONEBIT_ENCODING_PAYLOAD, 0, ONEBIT_SYNC_IDENTIFIER                       \
    }
#define ONEBIT_FORMAT_LINK_IDENTIFIER                                                              \
    {                                                                                              \
        ONEBIT_MODE_LINK, ONEBIT_ENCODING_IDENTIFIER, 0, ONEBIT_SYNC_IDENTIFIER                    \
    }

typedef struct onebit_message {
    uint32_t sender;   /* from 1 */
    uint32_t receiver; /* from 1 in link mode, 0 in broadcast */
    uint8_t step;      /* t mod 128; of a decoded frame 0 where the encoding has no step number */
    bool has_step;     /* `step` counts; encode ignores it */
    bool bit;
} onebit_message;

/* Flags of a frame. */
#define ONEBIT_FRAME_EXTENDED 0x01u /* 29-bit identifier */
#define ONEBIT_FRAME_REMOTE 0x02u
#define ONEBIT_FRAME_ERROR 0x04u    /* not a frame of the bus but a report of the controller */
#define ONEBIT_FRAME_FLEXIBLE 0x08u /* CAN FD */

/* A frame as a controller hands it over. Data beyond eight bytes (CAN FD) is never looked at. */
typedef struct onebit_frame {
    uint32_t identifier; /* 11 or 29 bits, right-aligned */
    uint8_t flags;
    uint8_t length; /* data bytes */
    uint8_t data[8];
} onebit_frame;

/*
 * Largest agent number that the format can carry, 0 if it carries no frames or is not valid (mode,
 * encoding, base that leaves agent 1 no identifier in 0x081..0x7EF, SYNC's identifier out of
 * range). Link mode: 8191, the receiver's 13 bits.
 */
uint32_t onebit_frame_agent_limit(const onebit_format *format);

/*
 * Writes the frame of a message. ONEBIT_NULL; ONEBIT_CONFIG_FORMAT; ONEBIT_IDENTIFIER if sender
 * (or, in link mode, receiver) is 0 or above onebit_frame_agent_limit. On refusal *frame is
 * untouched.
 */
onebit_status onebit_frame_encode(const onebit_format *format, const onebit_message *message,
                                  onebit_frame *frame);

/*
 * Reads the message of a frame, whatever bits the frame holds. ONEBIT_NULL; ONEBIT_CONFIG_FORMAT;
 * else, in this order: ONEBIT_REFUSED_ERROR_FRAME, _FOREIGN (identifier of another kind or range),
 * _REMOTE, _FLEXIBLE, _LENGTH. On refusal *message is untouched.
 */
onebit_status onebit_frame_decode(const onebit_format *format, const onebit_frame *frame,
                                  onebit_message *message);

/* SYNC for the step of clock t, with its counter. Neither pointer may be null. */
void onebit_frame_sync(const onebit_format *format, uint32_t t, onebit_frame *frame);

#define ONEBIT_NO_STEP 0xFFu

/*
 * True for SYNC, a classical data frame of format->sync with DLC 0 or 1; false for null. Then *step
 * is the t modulo 128 that its counter tells, ONEBIT_NO_STEP if it has none of 1..128.
 */
bool onebit_frame_is_sync(const onebit_format *format, const onebit_frame *frame, uint8_t *step);

#ifdef __cplusplus
}
#endif

#endif
