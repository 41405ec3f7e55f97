/* The port of can_controller.h. Touches its argument and, through its hooks, the controller. */
#include "can_controller.h"

bool can_controller_start(struct can_controller *can, const struct controller *controller,
                          struct frame_queue_entry *entries, unsigned count)
{
    if (!frame_queue_start(&can->queue, entries, count)) {
        return false;
    }
    can->controller = controller;
    can->off = false;
    can->ticks = controller->ticks(controller->context);
    can->elapsed = UINT32_MAX; /* a frame that is older than this moment has a time as well */
    can->counts = (struct can_controller_counts){0};
    return true;
}

/* --- the interrupt's side --- */

void can_controller_interrupt(struct can_controller *can)
{
    const struct controller *controller = can->controller;
    /* Before work whose time depends on what came: SYNC's time is this one. */
    const uint32_t begun = controller->ticks(controller->context);
    for (unsigned k = 0; k < can->queue.count; ++k) {
        struct frame_queue_entry discarded;
        struct frame_queue_entry *entry = frame_queue_room(&can->queue);
        bool room = entry != NULL;
        entry = room ? entry : &discarded;
        entry->ticks = begun;
        if (!controller->receive(controller->context, &entry->frame, &entry->ticks)) {
            break;
        }
        can->counts.error_frames += (entry->frame.flags & ONEBIT_FRAME_ERROR) != 0;
        if (room) {
            ++can->counts.received;
            frame_queue_put(&can->queue);
        } else {
            ++can->counts.lost;
        }
    }
    can->counts.lost += controller->overrun(controller->context);
}

/* --- the step loop's side --- */

/* Ticks since the start, without wrapping. */
static uint64_t elapsed(struct can_controller *can)
{
    uint32_t ticks = can->controller->ticks(can->controller->context);
    can->elapsed += (uint32_t)(ticks - can->ticks);
    can->ticks = ticks;
    return can->elapsed;
}

uint64_t can_controller_now(struct can_controller *can)
{
    return elapsed(can) * can->controller->nanoseconds_per_tick;
}

bool can_controller_waiting(const struct can_controller *can)
{
    return frame_queue_oldest(&can->queue) != NULL;
}

void can_controller_counts(const struct can_controller *can, struct can_controller_counts *counts)
{
    can->controller->lock(can->controller->context);
    *counts = can->counts;
    can->controller->unlock(can->controller->context);
}

static uint32_t withdraw(void *context)
{
    struct can_controller *can = context;
    uint32_t count = can->controller->withdraw(can->controller->context);
    can->counts.withdrawn += count;
    return count;
}

/* Whether the controller is bus off. What it then still holds would leave in another step. */
static bool is_off(struct can_controller *can)
{
    bool was_off = can->off;
    can->off = can->controller->bus_off(can->controller->context);
    if (can->off && !was_off) {
        ++can->counts.went_off;
        withdraw(can);
    }
    return can->off;
}

static enum transport_status send_frame(void *context, const onebit_frame *frame)
{
    struct can_controller *can = context;
    if (is_off(can)) {
        return TRANSPORT_DOWN;
    }
    if (!can->controller->send(can->controller->context, frame)) {
        ++can->counts.mailbox_full;
        return TRANSPORT_LATER;
    }
    ++can->counts.sent;
    return TRANSPORT_DONE;
}

static enum transport_status receive_frame(void *context, onebit_frame *frame,
                                           uint64_t *nanoseconds)
{
    struct can_controller *can = context;
    /* Before the clock is read: the frame is then older than what the clock says. */
    const struct frame_queue_entry *entry = frame_queue_oldest(&can->queue);
    uint64_t now = elapsed(can);
    if (entry == NULL) {
        return is_off(can) ? TRANSPORT_DOWN : TRANSPORT_LATER;
    }
    uint32_t age = can->ticks - entry->ticks;
    *frame = entry->frame;
    *nanoseconds = (now - age) * can->controller->nanoseconds_per_tick;
    frame_queue_drop(&can->queue);
    return TRANSPORT_DONE;
}

struct transport can_controller_transport(struct can_controller *can)
{
    return (struct transport){
        .context = can, .send = send_frame, .withdraw = withdraw, .receive = receive_frame};
}
