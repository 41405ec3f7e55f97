/* A CAN 2.0 frame as the bits on its wire (ISO 11898-1:2015, classical frames). Pure functions. */
#ifndef WIRE_H
#define WIRE_H

#include "onebit_frame.h"

#include <stdint.h>

/* The last bits of wire_bits, which the next frame waits for but no receiver of this one does. */
#define WIRE_INTERFRAME_BITS 3u

/*
 * Bits that a frame keeps the bus busy: start of frame to end of frame, with the stuff bits that
 * its own content makes, and the interframe space of 3 bits. Classical data and remote frames:
 * other flags are not looked at, a length above 8 counts as 8, identifier bits that do not fit are
 * left out. About 10 to 25 ns.
 */
uint32_t wire_bits(const onebit_frame *frame);

/*
 * The arbitration field as a number: of two frames that start together the one with the lower
 * number wins (dominant is 0). Standard and extended frames compare rightly with each other; only
 * frames of the same kind and identifier have the same number.
 */
uint32_t wire_arbitration(const onebit_frame *frame);

#endif
