/*
 * The queue of ports/can-controller/, or with -DBYTES that of ports/byte_queue.h, on a Cortex-M0
 * with an interrupt at every instruction: SysTick interrupts the reader after 0, 1, 2, ..
 * instructions (QEMU with -icount shift=10 takes 1.024 us for each, 16.384 ticks of the micro:bit's
 * clock), for every number of entries that wait before. The interrupt puts two in, as far as there
 * is room. All must come out, once, in order, whole. Prints the addresses of the reader at which it
 * was interrupted; status 1 if anything was wrong.
 */
#ifdef BYTES
#define BYTE_QUEUE_SIZE 4u
#include "byte_queue.h"
#else
#include "frame_queue.h"
#endif

#include <stdio.h>

#define SYSTICK_CONTROL (*(volatile uint32_t *)0xE000E010u)
#define SYSTICK_RELOAD (*(volatile uint32_t *)0xE000E014u)
#define SYSTICK_CURRENT (*(volatile uint32_t *)0xE000E018u)

#define TICKS_EACH 8u      /* about half an instruction */
#define READER_LARGEST 512 /* bytes of code */

/* The reader stands in a section of its own, whose begin and end the linker names. */
#define READER __attribute__((noinline, section("reader")))

static volatile uint32_t put;
static volatile bool interrupted;
static volatile uintptr_t interrupted_at;
static uint32_t taken_count;

#ifdef BYTES
#define COUNT (BYTE_QUEUE_SIZE - 1u)
#define TAKEN_MAX (2 * COUNT + 2)
static struct byte_queue queue;
static uint8_t taken[TAKEN_MAX];

static void start(void)
{
    queue = (struct byte_queue){0};
}

static void put_one(void)
{
    if (byte_queue_put(&queue, (uint8_t)~put)) {
        put = put + 1;
    }
}

READER static void take_all(void)
{
    while (taken_count < TAKEN_MAX && byte_queue_take(&queue, &taken[taken_count])) {
        ++taken_count;
    }
}

static bool is_good(uint32_t k)
{
    return taken[k] == (uint8_t)~k;
}
#else
#define COUNT 2u
#define TAKEN_MAX (2 * COUNT + 2)
static struct frame_queue_entry entries[COUNT];
static struct frame_queue queue;
static struct frame_queue_entry taken[TAKEN_MAX];

static void start(void)
{
    frame_queue_start(&queue, entries, COUNT);
}

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

READER static void take_all(void)
{
    const struct frame_queue_entry *entry;
    while ((entry = frame_queue_oldest(&queue)) != NULL && taken_count < TAKEN_MAX) {
        taken[taken_count++] = *entry;
        frame_queue_drop(&queue);
    }
}

static bool is_good(uint32_t k)
{
    return taken[k].frame.identifier == k && taken[k].ticks == ~k &&
           taken[k].frame.data[0] == (uint8_t)k && taken[k].frame.data[7] == (uint8_t)~k;
}
#endif

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
        good = is_good(k);
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
            start();
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
