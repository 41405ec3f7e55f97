/*
 * How a message stands in a frame (the table of onebit_frame.h), for formats that are known to be
 * valid: inline, as the agent's verbs take them in and onebit_frame.c gives them out. Private to
 * the library. Arithmetic-independent.
 */
#ifndef ONEBIT_CODEC_H
#define ONEBIT_CODEC_H

#include "onebit_frame.h"

#define ONEBIT_IDENTIFIER_LAST 0x7EFu  /* of 11 bits; above it CiA 301 reserves */
#define ONEBIT_LINK_AGENT_LAST 0x1FFFu /* receiver: identifier bits 13..1 */
#define ONEBIT_LINK_SENDER_SHIFT 14u
#define ONEBIT_LINK_RECEIVER_SHIFT 1u

/* A format's mode and encoding: constants where they are fixed at compile time (onebit_frame.h). */
#if defined(ONEBIT_ONLY_MODE) != defined(ONEBIT_ONLY_ENCODING)
#error "ONEBIT_ONLY_MODE and ONEBIT_ONLY_ENCODING fix the format together"
#endif
static inline unsigned onebit_mode_of(const onebit_format *format)
{
#ifdef ONEBIT_ONLY_MODE
    (void)format;
    return ONEBIT_ONLY_MODE;
#else
    return format->mode;
#endif
}

static inline unsigned onebit_encoding_of(const onebit_format *format)
{
#ifdef ONEBIT_ONLY_ENCODING
    (void)format;
    return ONEBIT_ONLY_ENCODING;
#else
    return format->encoding;
#endif
}

/* Numbers from 1 to the limit stand in the identifier above the base, from this bit on. */
static inline unsigned onebit_sender_shift(const onebit_format *format)
{
    return onebit_mode_of(format) == ONEBIT_MODE_LINK ? ONEBIT_LINK_SENDER_SHIFT
                                                      : onebit_encoding_of(format);
}

static inline uint32_t onebit_identifier_base(const onebit_format *format)
{
    return onebit_mode_of(format) == ONEBIT_MODE_LINK ? ONEBIT_LINK_BASE : format->base;
}

/* The largest agent number of a valid format with frames. */
static inline uint32_t onebit_number_limit(const onebit_format *format)
{
    if (onebit_mode_of(format) == ONEBIT_MODE_LINK) {
        return ONEBIT_LINK_AGENT_LAST;
    }
    return ((ONEBIT_IDENTIFIER_LAST + 1u - format->base) >> onebit_encoding_of(format)) - 1u;
}

/* Field by field: for a whole structure compilers call memset, 110 instructions on Cortex-M0. */
static inline void onebit_fill_frame(onebit_frame *frame, uint32_t identifier, uint8_t flags,
                                     uint8_t length, uint8_t first)
{
    frame->identifier = identifier;
    frame->flags = flags;
    frame->length = length;
    frame->data[0] = first;
    for (unsigned k = 1; k < sizeof frame->data; ++k) {
        frame->data[k] = 0;
    }
}

/* The frame of a message whose numbers are within the limit. */
static inline void onebit_write_frame(const onebit_format *format, const onebit_message *message,
                                      onebit_frame *frame)
{
    bool link = onebit_mode_of(format) == ONEBIT_MODE_LINK;
    bool payload = onebit_encoding_of(format) == ONEBIT_ENCODING_PAYLOAD;
    uint32_t identifier = onebit_identifier_base(format) +
                          (message->sender << onebit_sender_shift(format)) +
                          (link ? message->receiver << ONEBIT_LINK_RECEIVER_SHIFT : 0u) +
                          (payload ? 0u : message->bit);
    /* Bit 7 of step falls out. */
    uint32_t byte = payload ? (uint32_t)message->step << 1 | message->bit : 0u;
    onebit_fill_frame(frame, identifier, link ? ONEBIT_FRAME_EXTENDED : 0u, payload ? 1u : 0u,
                      (uint8_t)(byte & 0xFFu));
}

/* The message of a frame, whatever bits the frame holds; the codes of onebit_frame_decode. */
static inline onebit_status onebit_read_frame(const onebit_format *format,
                                              const onebit_frame *frame, onebit_message *message)
{
    if (frame->flags & ONEBIT_FRAME_ERROR) {
        return ONEBIT_REFUSED_ERROR_FRAME;
    }
    bool link = onebit_mode_of(format) == ONEBIT_MODE_LINK;
    bool payload = onebit_encoding_of(format) == ONEBIT_ENCODING_PAYLOAD;
    unsigned shift = onebit_sender_shift(format);
    /* Unsigned: an identifier below the base wraps to a number above every limit. */
    uint32_t offset = frame->identifier - onebit_identifier_base(format);
    uint32_t sender = offset >> shift;
    /* Below the sender stand receiver and bit in link mode, else a bit or nothing. */
    uint32_t below = offset - (sender << shift);
    uint32_t receiver = below >> ONEBIT_LINK_RECEIVER_SHIFT;
    uint32_t byte = below & 1u;
    if (((frame->flags & ONEBIT_FRAME_EXTENDED) != 0) != link ||
        sender - 1u >= onebit_number_limit(format) || (receiver != 0) != link ||
        (payload && byte != 0)) {
        return ONEBIT_REFUSED_FOREIGN;
    }
    if (frame->flags & ONEBIT_FRAME_REMOTE) {
        return ONEBIT_REFUSED_REMOTE;
    }
    if (frame->flags & ONEBIT_FRAME_FLEXIBLE) {
        return ONEBIT_REFUSED_FLEXIBLE;
    }
    if (frame->length != (payload ? 1u : 0u)) {
        return ONEBIT_REFUSED_LENGTH;
    }
    if (payload) {
        byte = frame->data[0];
    }
    message->sender = sender;
    message->receiver = receiver;
    message->step = (uint8_t)(byte >> 1);
    message->has_step = payload;
    message->bit = (byte & 1u) != 0;
    return ONEBIT_OK;
}

#endif
