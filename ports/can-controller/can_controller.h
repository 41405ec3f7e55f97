/*
 * The transport of transport.h on a CAN controller (controller.h): frames come from the receive
 * interrupt through a queue to the step loop and go from there into the transmit mailboxes.
 * Allocates nothing; arithmetic-independent.
 *
 * Two sides: can_controller_interrupt belongs to the interrupt, everything else to the step loop.
 * They share the queue, which needs no lock (frame_queue.h says why), and counters that the
 * interrupt writes. The lock is taken in two places only: to read those counters as they stand
 * together (can_controller_counts), and by the program before it sleeps (main.c).
 */
#ifndef CAN_CONTROLLER_H
#define CAN_CONTROLLER_H

#include "controller.h"
#include "frame_queue.h"
#include "transport.h"

#include <stdbool.h>
#include <stdint.h>

/* Modulo 2^32. */
struct can_controller_counts {
    uint32_t received;     /* into the queue, SYNC and reports among them */
    uint32_t lost;         /* for want of room in the queue or in the chip */
    uint32_t error_frames; /* reports of the controller */
    uint32_t sent;         /* into a mailbox */
    uint32_t mailbox_full; /* refusals, every attempt */
    uint32_t withdrawn;    /* from a mailbox, at the end of a step or when bus off */
    uint32_t went_off;     /* times that the controller went bus off */
};

struct can_controller {
    const struct controller *controller;
    struct frame_queue queue;
    bool off;         /* bus off when last looked */
    uint32_t ticks;   /* of the clock when last looked ... */
    uint64_t elapsed; /* ... and the same without wrapping */
    struct can_controller_counts counts;
};

/*
 * Begins with nothing received, before the interrupt is switched on. `entries` is the queue's
 * memory, 20 bytes each, and stays where it is: a power of two up to 128, as many as frames can
 * come while the step loop is away (at 500 kbit/s up to 10 a millisecond pass the filters). False
 * for another number, and nothing is begun.
 */
bool can_controller_start(struct can_controller *can, const struct controller *controller,
                          struct frame_queue_entry *entries, unsigned count);

/*
 * The receive interrupt: reads the clock, then takes what the chip has, at most as many frames as
 * the queue holds at all; a chip that has more interrupts again. What finds no room is lost and
 * counted, the newest first: what waits is older and belongs to an earlier step.
 */
void can_controller_interrupt(struct can_controller *can);

/* The hooks; *can must stay where it is. `receive` to be called once in 2^32 ticks at least. */
struct transport can_controller_transport(struct can_controller *can);

/* Whether frames wait; after a look that says no, asked again under the lock before sleep. */
bool can_controller_waiting(const struct can_controller *can);

/* The time now, in nanoseconds of the clock that `receive` tells. */
uint64_t can_controller_now(struct can_controller *can);

/* All counters at one moment. */
void can_controller_counts(const struct can_controller *can, struct can_controller_counts *counts);

#endif
