/*
 * Bytes on their way from an interrupt to the program: a ring with one writer and one reader that
 * needs no lock (queue_index.h says why). Touches its arguments only.
 */
#ifndef BYTE_QUEUE_H
#define BYTE_QUEUE_H

#include "queue_index.h"

#include <stdbool.h>
#include <stdint.h>

#ifndef BYTE_QUEUE_SIZE
#define BYTE_QUEUE_SIZE 256u /* a power of two, at most 256; holds one less */
#endif

/* All zero is the empty queue. */
struct byte_queue {
    uint8_t begin; /* the oldest; the reader writes it */
    uint8_t end;   /* behind the newest; the writer writes it */
    uint8_t bytes[BYTE_QUEUE_SIZE];
};

/* The writer's; false, and nothing done, if it is full. */
static inline bool byte_queue_put(struct byte_queue *queue, uint8_t byte)
{
    uint8_t next = (uint8_t)((queue->end + 1u) % BYTE_QUEUE_SIZE);
    if (next == queue_index_read(&queue->begin)) {
        return false;
    }
    queue->bytes[queue->end] = byte;
    queue_index_publish(&queue->end, next);
    return true;
}

/* The reader's; false, and *byte untouched, if it is empty. */
static inline bool byte_queue_take(struct byte_queue *queue, uint8_t *byte)
{
    if (queue->begin == queue_index_read(&queue->end)) {
        return false;
    }
    *byte = queue->bytes[queue->begin];
    queue_index_publish(&queue->begin, (uint8_t)((queue->begin + 1u) % BYTE_QUEUE_SIZE));
    return true;
}

#endif
