/*
 * The queue of ports/can-controller/ between two threads, for the thread sanitizer: what
 * frame_queue.h claims of the order of accesses to memory where both sides run at once. All
 * frames must come out, once, in order, whole; status 1 if not.
 */
#include "frame_queue.h"

#include <pthread.h>
#include <sched.h>
#include <stdio.h>

#define FRAMES 100000u

static struct frame_queue_entry entries[8];
static struct frame_queue queue;

static void *write_all(void *argument)
{
    for (uint32_t k = 0; k < FRAMES;) {
        struct frame_queue_entry *entry = frame_queue_room(&queue);
        if (entry == NULL) {
            sched_yield();
            continue;
        }
        entry->frame = (onebit_frame){.identifier = k, .data = {(uint8_t)k}};
        entry->ticks = ~k;
        frame_queue_put(&queue);
        ++k;
    }
    return argument;
}

int main(void)
{
    pthread_t writer;
    uint32_t wrong = 0;
    if (!frame_queue_start(&queue, entries, sizeof entries / sizeof *entries) ||
        pthread_create(&writer, NULL, write_all, NULL) != 0) {
        return 2;
    }
    for (uint32_t k = 0; k < FRAMES;) {
        const struct frame_queue_entry *entry = frame_queue_oldest(&queue);
        if (entry == NULL) {
            sched_yield();
            continue;
        }
        wrong += entry->frame.identifier != k || entry->frame.data[0] != (uint8_t)k ||
                 entry->ticks != ~k;
        frame_queue_drop(&queue);
        ++k;
    }
    pthread_join(writer, NULL);
    printf("frames %u, wrong %lu\n", FRAMES, (unsigned long)wrong);
    return wrong != 0;
}
