/*
 * What the port asks of a CAN controller: the functions that an integrator writes for the chip, a
 * few register accesses each. README.md says which registers these are on some chips. All must be
 * there; `context` is handed to each as it stands. No hook waits for the bus.
 *
 * To be set up before: bit rate; reception of SYNC and of the neighbours' identifiers (a filter
 * keeps the rest of the bus out of the interrupt); no reception of own frames; the receive
 * interrupt, which calls can_controller_interrupt.
 *
 * send, withdraw and bus_off are called by the step loop and can be interrupted by the receive
 * interrupt. Most chips have registers of their own for each direction. Where both go through the
 * same ones (a message window as in C_CAN, an SPI bus as to the MCP2515), these three hooks switch
 * the receive interrupt off for as long as they use them.
 */
#ifndef CONTROLLER_H
#define CONTROLLER_H

#include "onebit_frame.h"

#include <stdbool.h>
#include <stdint.h>

struct controller {
    void *context;

    /*
     * Step loop: puts a frame into a free transmit mailbox; false if none is free. Frames must
     * leave in the order in which they were put, whatever their identifiers (see README.md).
     */
    bool (*send)(void *context, const onebit_frame *frame);

    /*
     * Step loop: gives up every frame in a mailbox that is not on the wire, and tells how many
     * those were. One that is on the wire ends as it ends and is not tried again.
     */
    uint32_t (*withdraw)(void *context);

    /*
     * Step loop: whether the controller is bus off. One that does not come back by itself is told
     * to here; it then waits for 128 times 11 recessive bits, so asking again does no harm.
     */
    bool (*bus_off)(void *context);

    /*
     * Interrupt: the oldest received frame, out of the chip into *frame; false if none waits. A
     * change of the error state may be told as a frame with the flag ONEBIT_FRAME_ERROR. *ticks
     * is the time at which the interrupt began; a chip that stamps frames itself puts in its own.
     */
    bool (*receive)(void *context, onebit_frame *frame, uint32_t *ticks);

    /* Interrupt: frames that the chip has lost, its receive buffer full, since this was asked. */
    uint32_t (*overrun)(void *context);

    /* Anywhere: a clock that runs freely and wraps after 2^32 ticks. */
    uint32_t (*ticks)(void *context);
    uint32_t nanoseconds_per_tick;

    /*
     * Step loop: switches the receive interrupt off, or all, and on again; not nested. Nothing may
     * be moved across either by the compiler. On a Cortex-M, by CMSIS: __disable_irq,
     * __enable_irq.
     */
    void (*lock)(void *context);
    void (*unlock)(void *context);
};

#endif
