/*
 * Frames on their way from the receive interrupt to the step loop: a ring with one writer (the
 * interrupt) and one reader (the loop) that needs no interrupt lock (queue_index.h says why).
 * Touches its arguments only.
 */
#ifndef FRAME_QUEUE_H
#define FRAME_QUEUE_H

#include "onebit_frame.h"
#include "queue_index.h"

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>

#define FRAME_QUEUE_MAX 128u /* half of what an index counts to */

struct frame_queue_entry {
    onebit_frame frame;
    uint32_t ticks; /* of the controller's clock, when the frame had come */
};

struct frame_queue {
    struct frame_queue_entry *entries; /* the caller's */
    uint8_t count;                     /* of them: a power of two up to FRAME_QUEUE_MAX */
    uint8_t put;                       /* entries so far, modulo 256; the interrupt writes it */
    uint8_t taken;                     /* likewise; the step loop writes it */
};

/* False, and nothing done, if `count` is not a power of two from 1 to FRAME_QUEUE_MAX. */
static inline bool frame_queue_start(struct frame_queue *queue, struct frame_queue_entry *entries,
                                     unsigned count)
{
    if (count == 0 || count > FRAME_QUEUE_MAX || (count & (count - 1u)) != 0) {
        return false;
    }
    queue->entries = entries;
    queue->count = (uint8_t)count;
    queue->put = 0;
    queue->taken = 0;
    return true;
}

/* Interrupt: the entry to fill in before frame_queue_put, null if the queue is full. */
static inline struct frame_queue_entry *frame_queue_room(const struct frame_queue *queue)
{
    uint8_t waiting = (uint8_t)(queue->put - queue_index_read(&queue->taken));
    return waiting < queue->count ? &queue->entries[queue->put & (queue->count - 1u)] : NULL;
}

/* Interrupt: the entry is the loop's. */
static inline void frame_queue_put(struct frame_queue *queue)
{
    queue_index_publish(&queue->put, (uint8_t)(queue->put + 1u));
}

/* Step loop: the entry that has waited longest, null if none does. */
static inline const struct frame_queue_entry *frame_queue_oldest(const struct frame_queue *queue)
{
    bool empty = queue_index_read(&queue->put) == queue->taken;
    return empty ? NULL : &queue->entries[queue->taken & (queue->count - 1u)];
}

/* Step loop: the oldest entry is the interrupt's again. */
static inline void frame_queue_drop(struct frame_queue *queue)
{
    queue_index_publish(&queue->taken, (uint8_t)(queue->taken + 1u));
}

#endif
