/*
 * The queue of ports/can-controller/ on a Cortex-M0 with an interrupt at every instruction: SysTick
 * interrupts the reader after 0, 1, 2, .. instructions (QEMU with -icount shift=10 takes 1.024 us
 * for each, 16.384 ticks of the micro:bit's clock), for every number of frames that wait before.
 * The interrupt puts two frames in, as far as there is room. All must come out, once, in order,
 * whole. Prints the addresses of the reader at which it was interrupted; status 1 if anything was
 * wrong.
 */
#include "frame_queue.h"

#include <stdio.h>

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_CURRENT (*(volatile uint32_t *)0xE000E018u)

#define COUNT 2u
#define TICKS_EACH 8u      /* about half an instruction */
#define READER_LARGEST 512 /* bytes of code */

static struct frame_queue_entry entries[COUNT];
static struct frame_queue queue;
static volatile uint32_t put;
static volatile bool interrupted;
static volatile uintptr_t interrupted_at;
static struct frame_queue_entry taken[2 * COUNT + 2];
static uint32_t taken_count;

static void put_one(void)
{
    struct frame_queue_entry *entry = frame_queue_room(&queue);
    if (entry != NULL) {
        entry->frame = (onebit_frame){.identifier = put,
                                      .data = {(uint8_t)put, 0, 0, 0, 0, 0, 0, (uint8_t)~put}};
        entry->ticks = ~put;
        put = put + 1;
        frame_queue_put(&queue);
    }
}

/* The reader; in a section of its own, whose begin and end the linker names. */
__attribute__((noinline, section("reader"))) static void take_all(void)
{
    const struct frame_queue_entry *entry;
    while ((entry = frame_queue_oldest(&queue)) != NULL && taken_count < 2 * COUNT + 2) {
        taken[taken_count++] = *entry;
        frame_queue_drop(&queue);
    }
}
extern const char __start_reader[];
extern const char __stop_reader[];

__attribute__((used)) static void handle(const uint32_t *stacked)
{
    SYSTICK_CONTROL = 0;
    interrupted_at = stacked[6]; /* r0-r3, r12, lr, then the address to return to */
    put_one();
    put_one();
    interrupted = true;
}

void arm_systick_isr(void); /* in the vector table of picolibc's crt0 */

__attribute__((naked)) void arm_systick_isr(void)
{
    __asm__ volatile("mrs r0, msp\n\tldr r1, =handle\n\tbx r1");
}

static bool all_came_in_order(void)
{
    bool good = taken_count == put;
    for (uint32_t k = 0; good && k < taken_count; ++k) {
        good = taken[k].frame.identifier == k && taken[k].ticks == ~k &&
               taken[k].frame.data[0] == (uint8_t)k && taken[k].frame.data[7] == (uint8_t)~k;
    }
    return good;
}

int main(void)
{
    static bool seen[READER_LARGEST];
    uint32_t wrong = 0;
    uint32_t runs = 0;
    for (uint32_t waiting = 0; waiting <= COUNT; ++waiting) {
        uint32_t beyond = 0; /* runs in which the reader had ended before */
        for (uint32_t delay = 1; beyond < 300; ++delay, ++runs) {
            frame_queue_start(&queue, entries, COUNT);
            put = 0;
            taken_count = 0;
            interrupted = false;
            for (uint32_t k = 0; k < waiting; ++k) {
                put_one();
            }
            SYSTICK_RELOAD = delay * TICKS_EACH;
            SYSTICK_CURRENT = 0;
            SYSTICK_CONTROL = 7; /* on, with its interrupt, by the processor's clock */
            take_all();
            while (!interrupted) {
            }
            uintptr_t place = interrupted_at - (uintptr_t)__start_reader;
            if (place < (uintptr_t)(__stop_reader - __start_reader) && place < READER_LARGEST) {
                seen[place] = true;
                beyond = 0;
            } else {
                ++beyond;
            }
            take_all();
            wrong += !all_came_in_order();
        }
    }
    for (uint32_t place = 0; place < READER_LARGEST; ++place) {
        if (seen[place]) {
            printf("%lx\n", (unsigned long)((uintptr_t)__start_reader + place));
        }
    }
    printf("runs %lu, wrong %lu\n", (unsigned long)runs, (unsigned long)wrong);
    return wrong != 0;
}
