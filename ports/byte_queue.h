/*
 * Bytes from an interrupt to the program, or the other way: a ring with one writer and one reader
 * on one processor. Needs no lock: the writer alone moves `end`, the reader alone `begin`, each is
 * one byte, so a read of it is never half of an old and half of a new value, on an AVR either. All
 * is volatile, so the compiler keeps the order (first the byte, then the index that shows it), and
 * one processor sees its own accesses in order. Two cores would need more.
 */
#ifndef BYTE_QUEUE_H
#define BYTE_QUEUE_H

#include <stdbool.h>
#include <stdint.h>

#ifndef BYTE_QUEUE_SIZE
#define BYTE_QUEUE_SIZE 256u /* a power of two, at most 256; holds one less */
#endif

/* All zero is the empty queue. */
struct byte_queue {
    volatile uint8_t begin; /* the oldest */
    volatile uint8_t end;   /* behind the newest */
    volatile uint8_t bytes[BYTE_QUEUE_SIZE];
};

/* The writer's; false, and nothing done, if it is full. */
static inline bool byte_queue_put(struct byte_queue *queue, uint8_t byte)
{
    uint8_t end = queue->end;
    uint8_t next = (uint8_t)((end + 1u) % BYTE_QUEUE_SIZE);
    if (next == queue->begin) {
        return false;
    }
    queue->bytes[end] = byte;
    queue->end = next;
    return true;
}

/* The reader's; false, and *byte untouched, if it is empty. */
static inline bool byte_queue_take(struct byte_queue *queue, uint8_t *byte)
{
    uint8_t begin = queue->begin;
    if (begin == queue->end) {
        return false;
    }
    *byte = queue->bytes[begin];
    queue->begin = (uint8_t)((begin + 1u) % BYTE_QUEUE_SIZE);
    return true;
}

#endif
