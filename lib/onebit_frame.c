/* The frame codec of onebit_frame.h: which formats are valid, and SYNC. Touches its arguments. */
#include "onebit_codec.h"

#include <stddef.h>

#define IDENTIFIER_FIRST 0x081u /* 0x080 is CANopen's SYNC; below it its network management */
#define LINK_SYNC_LAST 0x3FFu   /* the first 11 bits of a link's identifier are from 0x400 on */

static uint32_t agent_limit(const onebit_format *format)
{
    unsigned encoding = onebit_encoding_of(format);
    bool link = onebit_mode_of(format) == ONEBIT_MODE_LINK;
#ifdef ONEBIT_ONLY_MODE
    bool possible = format->mode == ONEBIT_ONLY_MODE && format->encoding == ONEBIT_ONLY_ENCODING;
#else
    bool possible =
        format->mode <= ONEBIT_MODE_LINK && format->encoding <= ONEBIT_ENCODING_IDENTIFIER;
#endif
    if (!possible) {
        return 0;
    }
    /* Agent 1 is at base + 1 or base + 2, which must not fall on SYNC or below, nor too high. */
    if (!link && (format->base < IDENTIFIER_FIRST - 1u ||
                  format->base > ONEBIT_IDENTIFIER_LAST - encoding)) {
        return 0;
    }
    bool sync_wins = format->sync - 1u < (link ? LINK_SYNC_LAST : format->base);
    return sync_wins ? onebit_number_limit(format) : 0;
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
        (onebit_mode_of(format) == ONEBIT_MODE_LINK && message->receiver - 1u >= limit)) {
        return ONEBIT_IDENTIFIER;
    }
    onebit_write_frame(format, message, frame);
    return ONEBIT_OK;
}

onebit_status onebit_frame_decode(const onebit_format *format, const onebit_frame *frame,
                                  onebit_message *message)
{
    if (format == NULL || frame == NULL || message == NULL) {
        return ONEBIT_NULL;
    }
    return agent_limit(format) == 0 ? ONEBIT_CONFIG_FORMAT
                                    : onebit_read_frame(format, frame, message);
}

void onebit_frame_sync(const onebit_format *format, uint32_t t, onebit_frame *frame)
{
    uint32_t step = t % ONEBIT_STEP_MODULUS;
    onebit_fill_frame(frame, format->sync, 0, 1, (uint8_t)(step == 0 ? ONEBIT_STEP_MODULUS : step));
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
