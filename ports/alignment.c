/* The rule of alignment.h. Touches nothing but its arguments. */
#include "alignment.h"

#define HALF (ONEBIT_STEP_MODULUS / 2u)
#define PATIENCE_SETTLED 2u
#define PATIENCE_LOWEST 1u

void alignment_hear(struct alignment *alignment, uint32_t clock, const onebit_message *message)
{
    if (!message->has_step) {
        return;
    }
    uint8_t error = (uint8_t)((message->step - clock) % ONEBIT_STEP_MODULUS);
    if (alignment->heard == 0) {
        alignment->error = error;
        alignment->lowest = message->sender;
    }
    alignment->mixed = alignment->mixed || error != alignment->error;
    alignment->on_time = alignment->on_time || error == 0;
    if (message->sender < alignment->lowest) {
        alignment->lowest = message->sender;
    }
    if (alignment->heard != UINT32_MAX) {
        ++alignment->heard;
    }
}

/* The nearest way to a clock that is `error` ahead modulo 128, and not below the first step. */
static int32_t nearest(uint8_t error, uint32_t next, uint32_t first)
{
    if (error < HALF || next - first < ONEBIT_STEP_MODULUS - error) {
        return error;
    }
    return (int32_t)error - (int32_t)ONEBIT_STEP_MODULUS;
}

int32_t alignment_end_step(struct alignment *alignment, uint32_t agent, uint32_t next,
                           uint32_t first)
{
    struct alignment heard = *alignment;
    *alignment = (struct alignment){
        .settled = heard.settled || heard.on_time,
        .row_error = heard.row_error,
        .row = heard.row,
    };
    if (heard.heard == 0) {
        return 0;
    }
    if (heard.mixed || heard.on_time) {
        alignment->row = 0;
        return 0;
    }
    if (heard.error != heard.row_error) {
        alignment->row_error = heard.error;
        alignment->row = 0;
    }
    ++alignment->row;
    uint32_t patience =
        1u + (heard.settled ? PATIENCE_SETTLED : 0) + (agent < heard.lowest ? PATIENCE_LOWEST : 0);
    if (alignment->row < patience) {
        return 0;
    }
    *alignment = (struct alignment){0};
    return nearest(heard.error, next, first);
}
