/*
 * Frame lengths of wire.h. Both rules that depend on a frame's content, CRC and bit stuffing, are
 * taken a byte at a time with the tables of wire_tables.h; touches nothing but its arguments.
 */
#include "wire.h"

#include "wire_tables.h"

#include <stdbool.h>

#define LENGTH_MAX 8u

/*
 * Bits of fixed form, which are not stuffed (Bosch CAN 2.0, "Coding"): CRC delimiter 1,
 * acknowledgement slot and delimiter 2, end of frame 7, intermission 3.
 */
#define TRAILER_BITS (1u + 2u + 7u + WIRE_INTERFRAME_BITS)
#define CRC_BITS 15u

/*
 * The bits before the data, right-aligned so that the data length code ends a byte:
 *   standard 19: start 0, identifier 11, RTR, IDE 0, r0 0, DLC 4
 *   extended 39: start 0, base identifier 11, SRR 1, IDE 1, extension 18, RTR, r1 0, r0 0, DLC 4
 * In front of them padding fills the first byte. For the CRC it is 0, which leaves a register of
 * zeros as it is. For stuffing it alternates and ends recessive, like the idle bus before the
 * dominant start of frame, so that it makes no stuff bit and does not lengthen the first run.
 */
#define STANDARD_BITS 19u
#define STANDARD_BYTES 3u
#define STANDARD_PADDING (0x15u << 19)
#define STANDARD_IDENTIFIER_SHIFT 7u
#define EXTENDED_BITS 39u
#define EXTENDED_BYTES 5u
#define EXTENDED_PADDING ((uint64_t)1 << 39)
#define EXTENDED_BASE_SHIFT 27u
#define EXTENDED_SRR_IDE ((uint64_t)3 << 25)
#define EXTENDED_EXTENSION_SHIFT 7u
#define REMOTE_BIT 0x40u

#define EXTENSION_BITS 18u
#define EXTENSION_MASK 0x3FFFFu
#define BASE_MASK 0x7FFu

/* Stuffing's state before the padding: one dominant bit, which the padding ends. */
#define STUFF_START 0u

/* What the bits so far leave behind. */
struct wire {
    uint32_t crc;      /* register in bits 15..1, bit 0 is 0, above stands what was shifted out */
    uint32_t stuffing; /* state of the stuffing machine, 0..7 */
    uint32_t stuffed;  /* stuff bits */
};

static inline void take_crc(struct wire *wire, uint32_t byte)
{
    wire->crc = (wire->crc << 8) ^ wire_crc_table[((wire->crc >> 8) ^ byte) & 0xFFu];
}

static inline void take_stuffing(struct wire *wire, uint32_t byte)
{
    uint32_t entry = wire_stuff_table[8u * (byte & 0xFFu) + wire->stuffing];
    wire->stuffing = entry & 7u;
    wire->stuffed += entry >> 3;
}

/* Called with a constant number of bytes, so that each kind of frame has its own straight code. */
static inline void take_header(struct wire *wire, uint64_t header, uint64_t padding, uint32_t bytes)
{
    for (uint32_t shift = 8u * bytes; shift != 0;) {
        shift -= 8u;
        take_crc(wire, (uint32_t)(header >> shift));
        take_stuffing(wire, (uint32_t)((header | padding) >> shift));
    }
}

uint32_t wire_bits(const onebit_frame *frame)
{
    bool remote = (frame->flags & ONEBIT_FRAME_REMOTE) != 0;
    uint32_t length = frame->length < LENGTH_MAX ? frame->length : LENGTH_MAX;
    uint32_t data_bytes = remote ? 0 : length;
    uint32_t control = (remote ? REMOTE_BIT : 0u) | length;
    uint32_t bits = 8u * data_bytes + CRC_BITS + TRAILER_BITS;
    struct wire wire = {0, STUFF_START, 0};
    if ((frame->flags & ONEBIT_FRAME_EXTENDED) != 0) {
        uint64_t base = (frame->identifier >> EXTENSION_BITS) & BASE_MASK;
        uint64_t extension = frame->identifier & EXTENSION_MASK;
        uint64_t header = base << EXTENDED_BASE_SHIFT | EXTENDED_SRR_IDE |
                          extension << EXTENDED_EXTENSION_SHIFT | control;
        take_header(&wire, header, EXTENDED_PADDING, EXTENDED_BYTES);
        bits += EXTENDED_BITS;
    } else {
        uint32_t header = (frame->identifier & BASE_MASK) << STANDARD_IDENTIFIER_SHIFT | control;
        take_header(&wire, header, STANDARD_PADDING, STANDARD_BYTES);
        bits += STANDARD_BITS;
    }
    for (uint32_t k = 0; k < data_bytes; k++) {
        take_crc(&wire, frame->data[k]);
        take_stuffing(&wire, frame->data[k]);
    }
    /* The CRC's 15 bits and, to fill the byte, the last one inverted, which ends every run. */
    uint32_t crc = wire.crc;
    take_stuffing(&wire, crc >> 8);
    take_stuffing(&wire, crc | (~crc >> 1 & 1u));
    return bits + wire.stuffed;
}

/*
 * 32 bits in the order of the wire: base identifier 11, RTR or SRR 1, IDE 1, extension 18, RTR 1. A
 * standard frame is decided by IDE at the latest, so its last 19 bits do not matter.
 */
uint32_t wire_arbitration(const onebit_frame *frame)
{
    uint32_t remote = (frame->flags & ONEBIT_FRAME_REMOTE) != 0 ? 1u : 0u;
    if ((frame->flags & ONEBIT_FRAME_EXTENDED) == 0) {
        return (frame->identifier & BASE_MASK) << 21 | remote << 20;
    }
    return ((frame->identifier >> EXTENSION_BITS) & BASE_MASK) << 21 | 3u << 19 |
           (frame->identifier & EXTENSION_MASK) << 1 | remote;
}
