/*
 * A CAN frame as an array of bits, the slow and plain way, to check sim/wire.c with: nothing of it
 * is shared. Stuff bits are really inserted, the CRC is a long division of polynomials.
 */
#ifndef WIRE_REFERENCE_H
#define WIRE_REFERENCE_H

#include "onebit_frame.h"

#include <stdint.h>
#include <string.h>

struct wire_reference {
    uint8_t bits[256]; /* as sent, start of frame to the end of the interframe space */
    uint32_t count;
    uint32_t stuffed;     /* stuff bits among them */
    uint8_t plain[256];   /* start of frame to CRC sequence, without stuff bits */
    uint32_t arbitration; /* plain bits up to here decide arbitration */
    uint32_t plain_count;
};

static inline void wire_reference_put(struct wire_reference *wire, uint32_t value, uint32_t bits)
{
    while (bits > 0) {
        bits--;
        wire->plain[wire->plain_count++] = (uint8_t)(value >> bits & 1u);
    }
}

/* Remainder of the plain bits, 15 zeros behind them, divided by x^15+x^14+x^10+x^8+x^7+x^4+x^3+1.
 */
static inline uint32_t wire_reference_crc(const struct wire_reference *wire)
{
    static const uint8_t divisor[16] = {1, 1, 0, 0, 0, 1, 0, 1, 1, 0, 0, 1, 1, 0, 0, 1};
    uint8_t dividend[256] = {0};
    memcpy(dividend, wire->plain, wire->plain_count);
    for (uint32_t k = 0; k < wire->plain_count; k++) {
        if (dividend[k] != 0) {
            for (uint32_t j = 0; j < 16; j++) {
                dividend[k + j] ^= divisor[j];
            }
        }
    }
    uint32_t remainder = 0;
    for (uint32_t k = 0; k < 15; k++) {
        remainder = remainder << 1 | dividend[wire->plain_count + k];
    }
    return remainder;
}

/* True if the last five bits sent are equal. */
static inline int wire_reference_five(const struct wire_reference *wire)
{
    if (wire->count < 5) {
        return 0;
    }
    for (uint32_t k = 1; k < 5; k++) {
        if (wire->bits[wire->count - 1 - k] != wire->bits[wire->count - 1]) {
            return 0;
        }
    }
    return 1;
}

static inline void wire_reference_build(struct wire_reference *wire, const onebit_frame *frame)
{
    memset(wire, 0, sizeof *wire);
    uint32_t remote = (frame->flags & ONEBIT_FRAME_REMOTE) != 0;
    uint32_t length = frame->length > 8 ? 8 : frame->length;
    wire_reference_put(wire, 0, 1); /* start of frame */
    if (frame->flags & ONEBIT_FRAME_EXTENDED) {
        wire_reference_put(wire, frame->identifier >> 18, 11);
        wire_reference_put(wire, 1, 1); /* substitute remote request */
        wire_reference_put(wire, 1, 1); /* identifier extension */
        wire_reference_put(wire, frame->identifier, 18);
        wire_reference_put(wire, remote, 1);
        wire->arbitration = wire->plain_count;
        wire_reference_put(wire, 0, 1); /* r1 */
    } else {
        wire_reference_put(wire, frame->identifier, 11);
        wire_reference_put(wire, remote, 1);
        wire_reference_put(wire, 0, 1); /* identifier extension */
        wire->arbitration = wire->plain_count;
    }
    wire_reference_put(wire, 0, 1); /* r0 */
    wire_reference_put(wire, length, 4);
    for (uint32_t k = 0; k < length && !remote; k++) {
        wire_reference_put(wire, frame->data[k], 8);
    }
    wire_reference_put(wire, wire_reference_crc(wire), 15);
    for (uint32_t k = 0; k < wire->plain_count; k++) {
        wire->bits[wire->count++] = wire->plain[k];
        if (wire_reference_five(wire)) {
            wire->bits[wire->count] = !wire->bits[wire->count - 1];
            wire->count++;
            wire->stuffed++;
        }
    }
    /* CRC delimiter, acknowledgement slot (taken as sent) and delimiter, end of frame, interframe.
     */
    for (uint32_t k = 0; k < 1 + 2 + 7 + 3; k++) {
        wire->bits[wire->count++] = 1;
    }
}

/* A frame of any kind; every other one has long runs of equal bits, which stuffing is about. */
static inline onebit_frame wire_reference_frame(uint32_t (*random_word)(void))
{
    onebit_frame frame;
    memset(&frame, 0, sizeof frame);
    uint32_t kind = random_word();
    frame.flags = (uint8_t)(kind & (ONEBIT_FRAME_EXTENDED | ONEBIT_FRAME_REMOTE));
    frame.length = (uint8_t)((kind >> 8) % 9u);
    frame.identifier = random_word();
    if (kind & 16u) {
        frame.identifier &= random_word() & random_word();
    } else if (kind & 32u) {
        frame.identifier |= random_word() | random_word();
    }
    frame.identifier &= frame.flags & ONEBIT_FRAME_EXTENDED ? 0x1FFFFFFFu : 0x7FFu;
    for (uint32_t k = 0; k < frame.length && !(frame.flags & ONEBIT_FRAME_REMOTE); k++) {
        uint32_t word = random_word();
        frame.data[k] = (uint8_t)(kind & 64u        ? word
                                  : word & 0x10000u ? 0xFFu << (word & 7u)
                                                    : word & 1u);
    }
    return frame;
}

#endif
