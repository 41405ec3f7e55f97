/* The rule of alignment.h. Touches nothing but its arguments. */
#include "alignment.h"

#define HALF (ONEBIT_STEP_MODULUS / 2u)
#define PATIENCE_SETTLED 2u
#define PATIENCE_LOWEST 1u
#define PATIENCE_LEAD 16u

void alignment_hear(struct alignment *alignment, uint32_t clock, const onebit_message *message)
{
    if (!message->has_step) {
        return;
    }
    uint8_t error = (uint8_t)((message->step - clock) % ONEBIT_STEP_MODULUS);
    if (alignment->heard == 0) {
        alignment->error = error;
        alignment->lowest = message->sender;
        alignment->lowest_error = error;
    }
    alignment->mixed = alignment->mixed || error != alignment->error;
    alignment->on_time = alignment->on_time || error == 0;
    if (message->sender < alignment->lowest) {
        alignment->lowest = message->sender;
        alignment->lowest_error = error;
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

/* Whether all that was heard has been off by the same error for long enough. */
static bool all_off(struct alignment *alignment, uint32_t agent)
{
    if (alignment->mixed || alignment->on_time) {
        alignment->row = 0;
        return false;
    }
    if (alignment->error != alignment->row_error) {
        alignment->row_error = alignment->error;
        alignment->row = 0;
    }
    ++alignment->row;
    return alignment->row >= 1u + (alignment->settled ? PATIENCE_SETTLED : 0) +
                                 (agent < alignment->lowest ? PATIENCE_LOWEST : 0);
}

/* Whether the lowest number, below the own, has been off by the same error for long enough. */
static bool lead_off(struct alignment *alignment, uint32_t agent)
{
    if (alignment->lowest > agent ||
        (alignment->lead != 0 && alignment->lowest > alignment->lead)) {
        return false; /* it was not heard in this step */
    }
    if (alignment->lowest != alignment->lead || alignment->lowest_error == 0 ||
        alignment->lowest_error != alignment->lead_error) {
        alignment->lead = alignment->lowest;
        alignment->lead_error = alignment->lowest_error;
        alignment->lead_row = 0;
    }
    if (alignment->lowest_error != 0) {
        ++alignment->lead_row;
    }
    return alignment->lead_row >= PATIENCE_LEAD;
}

int32_t alignment_end_step(struct alignment *alignment, uint32_t agent, uint32_t next,
                           uint32_t first)
{
    if (alignment->heard == 0) {
        return 0;
    }
    uint8_t error = alignment->error;
    bool follow = lead_off(alignment, agent);
    if (all_off(alignment, agent) || follow) {
        error = follow ? alignment->lead_error : error;
        *alignment = (struct alignment){0};
        return nearest(error, next, first);
    }
    alignment->settled = alignment->settled || alignment->on_time;
    alignment->heard = 0;
    alignment->mixed = false;
    alignment->on_time = false;
    return 0;
}

int32_t alignment_sync(struct alignment *alignment, uint8_t residue, uint32_t next, uint32_t first)
{
    *alignment = (struct alignment){0};
    uint8_t error = (uint8_t)((residue - next) % ONEBIT_STEP_MODULUS);
    return error == 0 ? 0 : nearest(error, next, first);
}
