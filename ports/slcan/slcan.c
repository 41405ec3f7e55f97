/* The protocol of slcan.h. Touches nothing but its arguments. */
#include "slcan.h"

#include <stdbool.h>
#include <stddef.h>

#define STANDARD_MAX 0x7FFu
#define EXTENDED_MAX 0x1FFFFFFFu
#define LENGTH_MAX 8u /* bytes of a frame */
#define TIME_DIGITS 4 /* of a time stamp: milliseconds modulo one minute */

/* --- lines that came --- */

/* Value of a digit; 16 and more if it is none. */
static uint8_t digit_value(uint8_t character)
{
    if (character >= '0' && character <= '9') {
        return (uint8_t)(character - '0');
    }
    uint8_t letter = character | 0x20u; /* small */
    return letter >= 'a' && letter <= 'f' ? (uint8_t)(letter - 'a' + 10) : 16;
}

/* Up to eight digits; false if one is none. */
static bool read_number(const uint8_t *text, uint8_t digits, uint32_t *number)
{
    uint32_t value = 0;
    for (uint8_t k = 0; k < digits; ++k) {
        uint8_t digit = digit_value(text[k]);
        if (digit > 15) {
            return false;
        }
        value = value << 4 | digit;
    }
    *number = value;
    return true;
}

/* Indices stay below `length`, which is compared before each part is read. */
static enum slcan_status read_frame(const uint8_t *text, uint8_t length, onebit_frame *frame)
{
    bool extended = text[0] == 'T' || text[0] == 'R';
    bool remote = text[0] == 'r' || text[0] == 'R';
    uint8_t digits = extended ? 8 : 3;
    uint8_t at = (uint8_t)(digits + 2); /* behind the length digit */
    onebit_frame read = {.flags = (uint8_t)((extended ? ONEBIT_FRAME_EXTENDED : 0) |
                                            (remote ? ONEBIT_FRAME_REMOTE : 0))};
    if (length < at) {
        return SLCAN_LENGTH;
    }
    read.length = digit_value(text[at - 1]);
    if (!read_number(&text[1], digits, &read.identifier) || read.length > 15) {
        return SLCAN_DIGIT;
    }
    if (read.identifier > (extended ? EXTENDED_MAX : STANDARD_MAX) || read.length > LENGTH_MAX) {
        return SLCAN_RANGE;
    }
    uint8_t bytes = remote ? 0 : read.length;
    uint8_t rest = (uint8_t)(length - at);
    if (rest != 2 * bytes && rest != 2 * bytes + TIME_DIGITS) {
        return SLCAN_LENGTH;
    }
    uint32_t number;
    for (uint8_t k = 0; k < bytes; ++k, at = (uint8_t)(at + 2)) {
        if (!read_number(&text[at], 2, &number)) {
            return SLCAN_DIGIT;
        }
        read.data[k] = (uint8_t)number;
    }
    if (!read_number(&text[at], (uint8_t)(length - at), &number)) {
        return SLCAN_DIGIT;
    }
    *frame = read;
    return SLCAN_FRAME;
}

/* Whether a letter takes so many digits; SLCAN_COMMAND, SLCAN_LENGTH or SLCAN_UNKNOWN. */
static enum slcan_status judge_digits(uint8_t letter, uint8_t digits)
{
    bool good;
    switch (letter) {
    case 'O': /* open */
    case 'L': /* open, only to listen */
    case 'C': /* close */
    case 'P': /* hand over one frame */
    case 'A': /* hand over all frames */
    case 'N': /* the adapter's serial number? */
    case 'z': /* answer: an 11-bit frame is sent */
        good = digits == 0;
        break;
    case 'Z': /* time stamps off or on; answer: a 29-bit frame is sent */
        good = digits <= 1;
        break;
    case 'S': /* bit rate by number */
    case 'X': /* hand frames over at once: off or on */
    case 'W': /* one filter or two */
    case 'U': /* speed of the line */
    case 'Q': /* open at power-up */
        good = digits == 1;
        break;
    case 'F': /* status flags? and the answer */
        good = digits == 0 || digits == 2;
        break;
    case 'V': /* version? and the answer */
        good = digits == 0 || digits == 4;
        break;
    case 's': /* bit rate by registers */
        good = digits == 4;
        break;
    case 'M': /* acceptance code of the filter */
    case 'm': /* its mask */
        good = digits == 8;
        break;
    default:
        return SLCAN_UNKNOWN;
    }
    return good ? SLCAN_COMMAND : SLCAN_LENGTH;
}

static enum slcan_status read_line(const uint8_t *text, uint8_t length, struct slcan_line *line)
{
    enum slcan_status status;
    uint8_t digits = 0;
    uint32_t number = 0;
    if (text[0] == 't' || text[0] == 'T' || text[0] == 'r' || text[0] == 'R') {
        status = read_frame(text, length, &line->frame);
    } else {
        digits = (uint8_t)(length - 1);
        status = judge_digits(text[0], digits);
        if (status == SLCAN_COMMAND && !read_number(&text[1], digits, &number)) {
            status = SLCAN_DIGIT;
        }
    }
    if (status == SLCAN_FRAME || status == SLCAN_COMMAND) {
        line->command = (char)text[0];
        line->digits = digits;
        line->number = number;
    }
    return status;
}

static void drop(struct slcan_parser *parser, enum slcan_status reason)
{
    uint16_t *counter = &parser->dropped[reason - SLCAN_UNKNOWN];
    *counter = (uint16_t)(*counter + (*counter != UINT16_MAX));
}

enum slcan_status slcan_take(struct slcan_parser *parser, uint8_t byte, struct slcan_line *line)
{
    uint8_t length = parser->length;
    if (byte != SLCAN_END && byte != SLCAN_REFUSE) {
        if (length == 0 && byte == '\n') {
            return SLCAN_PENDING;
        }
        if (length < SLCAN_LINE_MAX) {
            parser->line[length] = byte;
        }
        parser->length = (uint8_t)(length + (length <= SLCAN_LINE_MAX));
        return SLCAN_PENDING;
    }
    /* Whatever was there, the next byte begins a line. */
    parser->length = 0;
    enum slcan_status end = byte == SLCAN_END ? SLCAN_DONE : SLCAN_REFUSED;
    if (length == 0) {
        return end;
    }
    enum slcan_status status = SLCAN_LENGTH;
    if (length > SLCAN_LINE_MAX) {
        status = SLCAN_OVERLONG;
    } else if (end == SLCAN_DONE) {
        status = read_line(parser->line, length, line);
    }
    if (status >= SLCAN_UNKNOWN) {
        drop(parser, status);
    }
    return end == SLCAN_DONE ? status : SLCAN_REFUSED;
}

/* --- lines to send --- */

static uint8_t write_digits(uint8_t *text, uint8_t digits, uint32_t number)
{
    for (uint8_t k = digits; k > 0; --k, number >>= 4) {
        uint8_t digit = number & 0xFu;
        text[k - 1] = (uint8_t)(digit < 10 ? '0' + digit : 'A' + digit - 10);
    }
    return digits;
}

uint8_t slcan_format(const onebit_frame *frame, uint8_t line[SLCAN_LINE_MAX + 1])
{
    bool extended = (frame->flags & ONEBIT_FRAME_EXTENDED) != 0;
    bool remote = (frame->flags & ONEBIT_FRAME_REMOTE) != 0;
    if ((frame->flags & (ONEBIT_FRAME_ERROR | ONEBIT_FRAME_FLEXIBLE)) != 0 ||
        frame->identifier > (extended ? EXTENDED_MAX : STANDARD_MAX) ||
        frame->length > LENGTH_MAX) {
        return 0;
    }
    uint8_t at = 0;
    line[at++] = (uint8_t)((remote ? 'r' : 't') & (extended ? 0xDF : 0xFF)); /* capital: 29 bits */
    at = (uint8_t)(at + write_digits(&line[at], extended ? 8 : 3, frame->identifier));
    at = (uint8_t)(at + write_digits(&line[at], 1, frame->length));
    for (uint8_t k = 0; k < frame->length && !remote; ++k) {
        at = (uint8_t)(at + write_digits(&line[at], 2, frame->data[k]));
    }
    line[at++] = SLCAN_END;
    return at;
}
