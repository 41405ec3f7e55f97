/* The frame codec of onebit_frame.h. Touches nothing but its arguments. */
#include "onebit_frame.h"

#include <stddef.h>

#define IDENTIFIER_FIRST 0x081u /* 0x080 is SYNC; below it CANopen's NMT */
#define IDENTIFIER_LAST 0x7EFu  /* above it CiA 301 reserves */
#define RECEIVER_SHIFT 1u
#define SENDER_SHIFT 14u
#define LINK_AGENT_LAST 0x1FFFu /* receiver: identifier bits 13..1 */

#define LINK_SYNC_LAST 0x3FFu /* the first 11 bits of a link's identifier are from 0x400 on */

/* Constants where the format is fixed at compile time (onebit_frame.h). */
#if defined(ONEBIT_ONLY_MODE) != defined(ONEBIT_ONLY_ENCODING)
#error "ONEBIT_ONLY_MODE and ONEBIT_ONLY_ENCODING fix the format together"
#elif defined(ONEBIT_ONLY_MODE)
#define MODE(format) ((void)(format), (unsigned)ONEBIT_ONLY_MODE)
#define ENCODING(format) ((void)(format), (unsigned)ONEBIT_ONLY_ENCODING)
#else
#define MODE(format) ((unsigned)(format)->mode)
#define ENCODING(format) ((unsigned)(format)->encoding)
#endif

/* Numbers from 1 to the limit stand in the identifier above the base, from this bit on. */
static unsigned sender_shift(const onebit_format *format)
{
    return MODE(format) == ONEBIT_MODE_LINK ? SENDER_SHIFT : ENCODING(format);
}

static uint32_t identifier_base(const onebit_format *format)
{
    return MODE(format) == ONEBIT_MODE_LINK ? ONEBIT_LINK_BASE : format->base;
}

static inline uint32_t agent_limit(const onebit_format *format)
{
    if (format->mode > ONEBIT_MODE_LINK || format->encoding > ONEBIT_ENCODING_IDENTIFIER ||
        format->mode != MODE(format) || format->encoding != ENCODING(format)) {
        return 0;
    }
    if (MODE(format) == ONEBIT_MODE_LINK) {
        return format->sync - 1u < LINK_SYNC_LAST ? LINK_AGENT_LAST : 0;
    }
    /* Agent 1 is at base + 1 or base + 2, which must not fall on SYNC or below, nor too high. */
    if (format->base < IDENTIFIER_FIRST - 1u || format->base > IDENTIFIER_LAST - ENCODING(format) ||
        format->sync - 1u >= format->base) {
        return 0;
    }
    return ((IDENTIFIER_LAST + 1u - format->base) >> ENCODING(format)) - 1u;
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
    bool link = MODE(format) == ONEBIT_MODE_LINK;
    bool payload = ENCODING(format) == ONEBIT_ENCODING_PAYLOAD;
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
        return ONEBIT_REFUSED_ERROR_FRAME;
    }
    bool link = MODE(format) == ONEBIT_MODE_LINK;
    bool payload = ENCODING(format) == ONEBIT_ENCODING_PAYLOAD;
    /* Unsigned: an identifier below the base wraps to a number above every limit. */
    uint32_t offset = frame->identifier - identifier_base(format);
    uint32_t sender = offset >> sender_shift(format);
    /* Below the sender stand receiver and bit in link mode, else a bit or nothing. */
    uint32_t below = offset - (sender << sender_shift(format));
    uint32_t receiver = below >> RECEIVER_SHIFT;
    uint32_t byte = below & 1u;
    if (((frame->flags & ONEBIT_FRAME_EXTENDED) != 0) != link || sender - 1u >= limit ||
        (receiver != 0) != link || (payload && byte != 0)) {
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

void onebit_frame_sync(const onebit_format *format, uint32_t t, onebit_frame *frame)
{
    uint32_t step = t % ONEBIT_STEP_MODULUS;
    *frame = (onebit_frame){.identifier = format->sync, .length = 1};
    frame->data[0] = (uint8_t)(step == 0 ? ONEBIT_STEP_MODULUS : step);
}

bool onebit_frame_is_sync(const onebit_format *format, const onebit_frame *frame, uint8_t *step)
{
    if (format == NULL || frame == NULL || step == NULL || frame->identifier != format->sync ||
        frame->flags != 0 || frame->length > 1) {
        return false;
    }
    uint32_t counter = frame->length != 0 ? frame->data[0] : 0u;
    bool told = counter - 1u < ONEBIT_STEP_MODULUS;
    *step = (uint8_t)(told ? counter % ONEBIT_STEP_MODULUS : ONEBIT_NO_STEP);
    return true;
}
