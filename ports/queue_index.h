/*
 * The memory model of the queues between an interrupt and the program (byte_queue.h,
 * can-controller/frame_queue.h): rings with one writer and one reader that need no lock.
 *
 * Each side has an index that it alone moves, of one byte, which every processor reads and writes
 * whole. An entry is filled before the writer's index shows it, and read before the reader's index
 * gives it back. The two functions below keep the compiler to that order, and an interrupt sees the
 * program that it interrupted in the order in which its instructions stand. Where the two sides run
 * on different cores they keep the processors to it too (on a Cortex-M a dmb). C99 itself has no
 * word for any of this.
 *
 * One writer means: one interrupt, or several that cannot interrupt each other (equal priority).
 */
#ifndef QUEUE_INDEX_H
#define QUEUE_INDEX_H

#include <stdint.h>

#ifndef __GNUC__
#error "queue_index.h: write queue_index_read and queue_index_publish for this compiler: a load \
(store) of one byte before (after) which it moves no other access to memory"
#endif

/* The other side's index: what that side did before it published this value has been done. */
static inline uint8_t queue_index_read(const uint8_t *index)
{
    return __atomic_load_n(index, __ATOMIC_ACQUIRE);
}

/* The own index: what was done before stands in memory when the other side sees this value. */
static inline void queue_index_publish(uint8_t *index, uint8_t value)
{
    __atomic_store_n(index, value, __ATOMIC_RELEASE);
}

#endif
