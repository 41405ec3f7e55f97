/*
 * The queue of ports/can-controller/, or with -DBYTES that of ports/byte_queue.h, between two
 * threads, for the thread sanitizer: what queue_index.h claims of the order of accesses to memory
 * where both sides run at once. All entries must come out, once, in order, whole; status 1 if not.
 */
#ifdef BYTES
#define BYTE_QUEUE_SIZE 8u
#include "byte_queue.h"
#else
#include "frame_queue.h"
#endif

#include <pthread.h>
#include <sched.h>
#include <stdio.h>

#define ENTRIES 100000u

#ifdef BYTES
static struct byte_queue queue;

static bool start(void)
{
    return true; /* all zero */
}

/* Entry k, if there is room. */
static bool put(uint32_t k)
{
    return byte_queue_put(&queue, (uint8_t)~k);
}

/* The oldest entry, if there is one; whether it is k is counted. */
static bool take(uint32_t k, uint32_t *wrong)
{
    uint8_t byte;
    bool there = byte_queue_take(&queue, &byte);
    *wrong += there && byte != (uint8_t)~k;
    return there;
}
#else
static struct frame_queue_entry entries[8];
static struct frame_queue queue;

static bool start(void)
{
    return frame_queue_start(&queue, entries, sizeof entries / sizeof *entries);
}

static bool put(uint32_t k)
{
    struct frame_queue_entry *entry = frame_queue_room(&queue);
    if (entry != NULL) {
        entry->frame = (onebit_frame){.identifier = k, .data = {(uint8_t)k}};
        entry->ticks = ~k;
        frame_queue_put(&queue);
    }
    return entry != NULL;
}

static bool take(uint32_t k, uint32_t *wrong)
{
    const struct frame_queue_entry *entry = frame_queue_oldest(&queue);
    if (entry != NULL) {
        *wrong += entry->frame.identifier != k || entry->frame.data[0] != (uint8_t)k ||
                  entry->ticks != ~k;
        frame_queue_drop(&queue);
    }
    return entry != NULL;
}
#endif

static void *write_all(void *argument)
{
    for (uint32_t k = 0; k < ENTRIES;) {
        if (put(k)) {
            ++k;
        } else {
            sched_yield();
        }
    }
    return argument;
}

int main(void)
{
    pthread_t writer;
    uint32_t wrong = 0;
    if (!start() || pthread_create(&writer, NULL, write_all, NULL) != 0) {
        return 2;
    }
    for (uint32_t k = 0; k < ENTRIES;) {
        if (take(k, &wrong)) {
            ++k;
        } else {
            sched_yield();
        }
    }
    pthread_join(writer, NULL);
    printf("entries %u, wrong %lu\n", ENTRIES, (unsigned long)wrong);
    return wrong != 0;
}
