/*
 * The virtual bus of bus.h. Touches nothing but its own memory and the log that it was given.
 *
 * `can` counts in bit times, whole numbers in doubles (exact to 2^53, 285 years at 1 Mbit/s). All
 * messages of a step become ready together, when its SYNC is over, and a bus that has frames ready
 * is never idle. So arbitration, one winner after the other, is the same as sorting once, and the
 * time at which the bus is next free is all there is to keep.
 */
#include "bus.h"

#include "wire.h"

#include <assert.h>
#include <math.h>
#include <stddef.h>
#include <stdlib.h>

struct waiting {
    onebit_frame frame;
    uint32_t tag;
};

struct bus {
    enum bus_model model;
    double bitrate;
    double period;
    uint32_t capacity;
    struct log_writer *log;

    uint64_t next_step;    /* the number, from 0, of the step that begins next */
    struct waiting *queue; /* of this step, in the order sent */
    uint32_t count;        /* in the queue */
    uint32_t next;         /* places below it have been received */

    double now; /* ideal: seconds at which the step began */

    /* The rest is for `can`; times are in bits since the first step began. */
    double step_end;
    double free_time; /* the first bit time at which a frame may start */
    double ready;     /* of this step's messages: their SYNC and the space behind it are over */
    uint64_t *order;  /* arbitration << 32 | place in the queue */
    bool sorted;      /* order is ascending as it was filled */
    double latency_sum;
    double latency_max;

    struct bus_traffic traffic;
};

struct bus *bus_create(enum bus_model model, double bitrate, double period, uint32_t capacity,
                       struct log_writer *log)
{
    struct bus *bus = calloc(1, sizeof *bus);
    if (bus == NULL) {
        return NULL;
    }
    bus->model = model;
    bus->bitrate = bitrate;
    bus->period = period;
    bus->capacity = capacity;
    bus->log = log;
    /* One more place than asked for: calloc(0) may be null. */
    bus->queue = calloc((size_t)capacity + 1u, sizeof *bus->queue);
    bus->order = calloc((size_t)capacity + 1u, sizeof *bus->order);
    if (bus->queue == NULL || bus->order == NULL) {
        bus_free(bus);
        return NULL;
    }
    return bus;
}

void bus_free(struct bus *bus)
{
    if (bus != NULL) {
        free(bus->queue);
        free(bus->order);
        free(bus);
    }
}

/* Bit time at which a step begins: the nearest whole one, where period and bit rate give none. */
static double step_start(const struct bus *bus, uint64_t step)
{
    return floor((double)step * bus->period * bus->bitrate + 0.5);
}

static void count_frame(struct bus *bus, const onebit_frame *frame, uint32_t bits, double seconds)
{
    bus->traffic.frames++;
    bus->traffic.wire_bits += bits;
    if (bus->log != NULL) {
        log_writer_frame(bus->log, seconds, frame);
    }
}

/*
 * Puts a frame on the wire as soon as it is free. False, and nothing happens, when this period has
 * ended by then. The end of the frame, where it is heard, is WIRE_INTERFRAME_BITS before the bus is
 * free again.
 */
static bool transmit(struct bus *bus, const onebit_frame *frame, uint32_t bits)
{
    if (bus->free_time >= bus->step_end) {
        return false;
    }
    bus->free_time += bits;
    count_frame(bus, frame, bits, (bus->free_time - WIRE_INTERFRAME_BITS) / bus->bitrate);
    return true;
}

/* Ends a step: what has not started is withdrawn, and the sums in bits become seconds. */
static void finish_step(struct bus *bus)
{
    if (bus->model == BUS_CAN) {
        bus->traffic.late_frames += bus->count - bus->next;
        bus->traffic.latency_sum = bus->latency_sum / bus->bitrate;
        bus->traffic.latency_max = bus->latency_max / bus->bitrate;
    }
    bus->next = bus->count;
}

void bus_begin_step(struct bus *bus, const onebit_frame *sync)
{
    finish_step(bus);
    bus->count = 0;
    bus->next = 0;
    uint64_t step = bus->next_step++;
    if (bus->model == BUS_IDEAL) {
        bus->now = (double)step * bus->period;
        count_frame(bus, sync, wire_bits(sync), bus->now);
        return;
    }
    double start = step_start(bus, step);
    bus->step_end = step_start(bus, step + 1u);
    bus->sorted = true;
    if (bus->free_time < start) {
        bus->free_time = start;
    }
    if (!transmit(bus, sync, wire_bits(sync))) {
        bus->traffic.late_frames++;
    }
    bus->ready = bus->free_time;
}

void bus_send(struct bus *bus, const onebit_frame *frame, uint32_t tag)
{
    assert(bus->count < bus->capacity);
    uint32_t place = bus->count++;
    bus->queue[place].frame = *frame;
    bus->queue[place].tag = tag;
    if (bus->model == BUS_IDEAL) {
        bus->traffic.messages++;
        count_frame(bus, frame, wire_bits(frame), bus->now);
        return;
    }
    bus->order[place] = (uint64_t)wire_arbitration(frame) << 32 | place;
    if (place > 0 && bus->order[place] < bus->order[place - 1u]) {
        bus->sorted = false;
    }
}

static int compare_order(const void *left, const void *right)
{
    uint64_t a = *(const uint64_t *)left;
    uint64_t b = *(const uint64_t *)right;
    return (a > b) - (a < b);
}

bool bus_receive(struct bus *bus, const onebit_frame **frame, uint32_t *tag)
{
    if (bus->next == bus->count) {
        finish_step(bus);
        return false;
    }
    uint32_t place = bus->next;
    if (bus->model == BUS_CAN) {
        /* Agents mostly send in the order of their identifiers: then there is nothing to sort. */
        if (!bus->sorted) {
            qsort(bus->order, bus->count, sizeof *bus->order, compare_order);
            bus->sorted = true;
        }
        place = (uint32_t)bus->order[bus->next]; /* its lower half */
        const onebit_frame *winner = &bus->queue[place].frame;
        if (!transmit(bus, winner, wire_bits(winner))) {
            finish_step(bus);
            return false;
        }
        double latency = bus->free_time - WIRE_INTERFRAME_BITS - bus->ready;
        bus->latency_sum += latency;
        if (latency > bus->latency_max) {
            bus->latency_max = latency;
        }
        bus->traffic.messages++;
    }
    bus->next++;
    *frame = &bus->queue[place].frame;
    *tag = bus->queue[place].tag;
    return true;
}

const struct bus_traffic *bus_traffic(const struct bus *bus)
{
    return &bus->traffic;
}
