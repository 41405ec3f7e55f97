/* The frame codec of onebit_frame.h. Touches nothing but its arguments. */
#include "onebit_frame.h"

#include <stddef.h>

#define IDENTIFIER_FIRST 0x081u /* 0x080 is SYNC; below it CANopen's NMT */
#define IDENTIFIER_LAST 0x7EFu  /* above it CiA 301 reserves */
#define RECEIVER_SHIFT 1u
#define SENDER_SHIFT 14u
#define LINK_AGENT_LAST 0x1FFFu /* receiver: identifier bits 13..1 */

static inline uint32_t agent_limit(const onebit_format *format)
{
    if (format->encoding > ONEBIT_IN_IDENTIFIER) {
        return 0;
    }
    if (format->mode == ONEBIT_LINK) {
        return LINK_AGENT_LAST;
    }
    /* Agent 1 is at base + 1 or base + 2, which must not fall on SYNC or below. */
    if (format->mode != ONEBIT_BROADCAST || format->base < IDENTIFIER_FIRST - 1u ||
        format->base > IDENTIFIER_LAST) {
        return 0;
    }
    uint32_t room = IDENTIFIER_LAST - format->base;
    return format->encoding == ONEBIT_PAYLOAD ? room : (room == 0 ? 0 : (room - 1u) / 2u);
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
    /* Numbers from 1: zero wraps to the largest and is refused by the same comparison. */
    if (message->sender - 1u >= limit ||
        (format->mode == ONEBIT_LINK && message->receiver - 1u >= limit)) {
        return ONEBIT_IDENTIFIER;
    }
    bool payload = format->encoding == ONEBIT_PAYLOAD;
    uint32_t bit = message->bit ? 1u : 0u;
    uint32_t identifier;
    if (format->mode == ONEBIT_LINK) {
        identifier = ONEBIT_LINK_BASE + (message->sender << SENDER_SHIFT) +
                     (message->receiver << RECEIVER_SHIFT) + (payload ? 0u : bit);
    } else if (payload) {
        identifier = format->base + message->sender;
    } else {
        identifier = format->base + 2u * message->sender + bit;
    }
    *frame = (onebit_frame){0};
    frame->identifier = identifier;
    frame->flags = format->mode == ONEBIT_LINK ? ONEBIT_FRAME_EXTENDED : 0u;
    if (payload) {
        frame->length = 1;
        frame->data[0] = (uint8_t)(((message->step % ONEBIT_STEP_MODULUS) << 1) | bit);
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
    if (((frame->flags & ONEBIT_FRAME_EXTENDED) != 0) != link) {
        return ONEBIT_UNKNOWN;
    }
    /* Unsigned: an identifier below the base wraps to a number above every limit. */
    uint32_t offset = frame->identifier - (link ? ONEBIT_LINK_BASE : format->base);
    uint32_t bit = offset & 1u;
    uint32_t sender;
    uint32_t receiver = 0;
    if (link) {
        sender = offset >> SENDER_SHIFT;
        receiver = (offset >> RECEIVER_SHIFT) & LINK_AGENT_LAST;
        if (receiver == 0 || (payload && bit != 0)) {
            return ONEBIT_UNKNOWN;
        }
    } else {
        sender = payload ? offset : offset >> 1;
    }
    if (sender - 1u >= limit) {
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
    message->sender = sender;
    message->receiver = receiver;
    message->step = payload ? (uint8_t)(frame->data[0] >> 1) : 0u;
    message->has_step = payload;
    message->bit = (payload ? frame->data[0] & 1u : bit) != 0;
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
