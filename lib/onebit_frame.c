/* The frame codec of onebit_frame.h. Touches nothing but its arguments. */
#include "onebit_frame.h"

#include <stddef.h>

#define IDENTIFIER_FIRST 0x081u /* 0x080 is SYNC; below it CANopen's NMT */
#define IDENTIFIER_LAST 0x7EFu  /* above it CiA 301 reserves */
#define RECEIVER_SHIFT 1u
#define SENDER_SHIFT 14u
#define LINK_AGENT_LAST 0x1FFFu /* receiver: identifier bits 13..1 */

/* Numbers from 1 to the limit stand in the identifier above the base, from this bit on. */
static unsigned sender_shift(const onebit_format *format)
{
    return format->mode == ONEBIT_LINK ? SENDER_SHIFT : format->encoding;
}

static uint32_t identifier_base(const onebit_format *format)
{
    return format->mode == ONEBIT_LINK ? ONEBIT_LINK_BASE : format->base;
}

static inline uint32_t agent_limit(const onebit_format *format)
{
    if (format->mode > ONEBIT_LINK || format->encoding > ONEBIT_IN_IDENTIFIER) {
        return 0;
    }
    if (format->mode == ONEBIT_LINK) {
        return LINK_AGENT_LAST;
    }
    /* Agent 1 is at base + 1 or base + 2, which must not fall on SYNC or below, nor too high. */
    if (format->base < IDENTIFIER_FIRST - 1u || format->base > IDENTIFIER_LAST - format->encoding) {
        return 0;
    }
    return ((IDENTIFIER_LAST + 1u - format->base) >> format->encoding) - 1u;
}

uint32_t onebit_frame_agent_limit(const onebit_format *format)
{
    return format == NULL ? 0 : agent_limit(format);
}

onebit_status onebit_frame_encode(const onebit_format *format, const onebit_message *message,
                                  onebit_frame *frame)
{
    if (format == NULL || message == NULL || frame == NULL) {
        return ONEBIT_NULL;
    }
    uint32_t limit = agent_limit(format);
    if (limit == 0) {
        return ONEBIT_CONFIG_FORMAT;
    }
    bool link = format->mode == ONEBIT_LINK;
    bool payload = format->encoding == ONEBIT_PAYLOAD;
    /* Numbers from 1: zero wraps to the largest and is refused by the same comparison. */
    if (message->sender - 1u >= limit || (link && message->receiver - 1u >= limit)) {
        return ONEBIT_IDENTIFIER;
    }
    *frame = (onebit_frame){0};
    frame->identifier = identifier_base(format) + (message->sender << sender_shift(format)) +
                        (link ? message->receiver << RECEIVER_SHIFT : 0u) +
                        (payload ? 0u : message->bit);
    frame->flags = link ? ONEBIT_FRAME_EXTENDED : 0u;
    if (payload) {
        frame->length = 1;
        frame->data[0] = (uint8_t)(message->step << 1 | message->bit); /* bit 7 of step falls out */
    }
    return ONEBIT_OK;
}

onebit_status onebit_frame_decode(const onebit_format *format, const onebit_frame *frame,
                                  onebit_message *message)
{
    if (format == NULL || frame == NULL || message == NULL) {
        return ONEBIT_NULL;
    }
    uint32_t limit = agent_limit(format);
    if (limit == 0) {
        return ONEBIT_CONFIG_FORMAT;
    }
    if (frame->flags & ONEBIT_FRAME_ERROR) {
        return ONEBIT_ERROR_FRAME;
    }
    bool link = format->mode == ONEBIT_LINK;
    bool payload = format->encoding == ONEBIT_PAYLOAD;
    /* Unsigned: an identifier below the base wraps to a number above every limit. */
    uint32_t offset = frame->identifier - identifier_base(format);
    uint32_t sender = offset >> sender_shift(format);
    /* Below the sender stand receiver and bit in link mode, else a bit or nothing. */
    uint32_t below = offset - (sender << sender_shift(format));
    uint32_t receiver = below >> RECEIVER_SHIFT;
    uint32_t byte = below & 1u;
    if (((frame->flags & ONEBIT_FRAME_EXTENDED) != 0) != link || sender - 1u >= limit ||
        (receiver != 0) != link || (payload && byte != 0)) {
        return ONEBIT_UNKNOWN;
    }
    if (frame->flags & ONEBIT_FRAME_REMOTE) {
        return ONEBIT_REMOTE;
    }
    if (frame->flags & ONEBIT_FRAME_FLEXIBLE) {
        return ONEBIT_FLEXIBLE;
    }
    if (frame->length != (payload ? 1u : 0u)) {
        return ONEBIT_LENGTH;
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

void onebit_frame_sync(onebit_frame *frame)
{
    *frame = (onebit_frame){0};
    frame->identifier = ONEBIT_SYNC_IDENTIFIER;
}

bool onebit_frame_is_sync(const onebit_frame *frame)
{
    return frame != NULL && frame->identifier == ONEBIT_SYNC_IDENTIFIER && frame->flags == 0 &&
           frame->length <= 1;
}
