/*
 * The text protocol of serial CAN adapters, LAWICEL's CAN232 and CANUSB and all that follow them
 * (slcan): bytes of a line to frames and commands, frames to lines. Both ends of a line speak it.
 *
 *   tiiildd..        data frame: identifier 000..7FF, length 0..8, bytes; all hexadecimal digits
 *   Tiiiiiiiildd..   data frame: identifier 00000000..1FFFFFFF
 *   riiil, Riiiiiiiil  remote frames
 *   S6, O, C, ..     a letter and digits: commands to an adapter, answers of an adapter
 *
 * CR ends each line; of an adapter CR alone says done, BEL refused, z and Z sent. An adapter may
 * put a time stamp of four digits behind a frame. The parser's memory is its struct; no call
 * allocates, recurses or takes more time than one line needs. Needs no C library. A parser is not
 * reentrant.
 */
#ifndef SLCAN_H
#define SLCAN_H

#include "onebit_frame.h"

#include <stdint.h>

/* Characters of the longest line, a 29-bit frame of eight bytes with its time stamp; without CR. */
#define SLCAN_LINE_MAX 30

#define SLCAN_END '\r'    /* of a line */
#define SLCAN_REFUSE '\a' /* an adapter's "no", without CR */

enum slcan_status {
    SLCAN_PENDING, /* the line goes on */
    SLCAN_FRAME,   /* a frame */
    SLCAN_COMMAND, /* another command, or an answer */
    SLCAN_DONE,    /* CR alone */
    SLCAN_REFUSED, /* BEL */

    /* A line that is neither: dropped and counted, the first reason that holds from left to right.
     */
    SLCAN_UNKNOWN, /* begins with no letter of the protocol */
    SLCAN_LENGTH,  /* too short or too long for its letter and length digit, or cut off by BEL */
    SLCAN_DIGIT,   /* no hexadecimal digit where one belongs */
    SLCAN_RANGE,   /* identifier or length digit too large */
    SLCAN_OVERLONG /* more than SLCAN_LINE_MAX characters without CR */
};

/* Number of counters of dropped lines; the counter of status s stands at [s - SLCAN_UNKNOWN]. */
#define SLCAN_DROPS 5

/* All zero is the parser before the first byte. */
struct slcan_parser {
    uint8_t length; /* of the line so far; SLCAN_LINE_MAX + 1: overlong */
    uint8_t line[SLCAN_LINE_MAX];
    uint16_t dropped[SLCAN_DROPS]; /* saturating */
};

/* What a line said. */
struct slcan_line {
    char command;    /* its letter */
    uint8_t digits;  /* behind the letter, at most 8; 0 for a frame */
    uint32_t number; /* their value; 0 for a frame */
    onebit_frame frame;
};

/*
 * Takes the next byte, whatever it is. SLCAN_FRAME writes *line, SLCAN_COMMAND all of it but the
 * frame, any other status nothing. LF at the beginning of a line is passed over.
 */
enum slcan_status slcan_take(struct slcan_parser *parser, uint8_t byte, struct slcan_line *line);

/*
 * Writes the line of a frame with its CR and returns the number of characters; 0 for what the
 * protocol cannot say: error report, CAN FD, identifier out of range, more than eight bytes.
 */
uint8_t slcan_format(const onebit_frame *frame, uint8_t line[SLCAN_LINE_MAX + 1]);

#endif
