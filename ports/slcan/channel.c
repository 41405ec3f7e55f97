/* The two ends of channel.h. Touches the channel and calls its hooks. */
#include "channel.h"

#include <stddef.h>

/* Hardware and software version, two digits each; the serial number. */
static const char version[] = "V0101\r";
static const char serial_number[] = "N0001\r";

static void count(uint16_t *counter)
{
    *counter = (uint16_t)(*counter + (*counter != UINT16_MAX));
}

bool channel_flush(struct channel *channel)
{
    while (channel->pending != 0 &&
           channel->hooks.put(channel->hooks.context, channel->out[channel->next])) {
        ++channel->next;
        --channel->pending;
    }
    return channel->pending == 0;
}

/* `out` holds `length` characters and all before them are gone. */
static void begin_output(struct channel *channel, uint8_t length)
{
    channel->next = 0;
    channel->pending = length;
    channel_flush(channel);
}

/* Text of at most SLCAN_LINE_MAX + 1 characters, when nothing is pending. */
static void say(struct channel *channel, const char *text)
{
    uint8_t length = 0;
    while (text[length] != '\0') {
        channel->out[length] = (uint8_t)text[length];
        ++length;
    }
    begin_output(channel, length);
}

/* --- the device's answers --- */

static const char *refuse(struct channel *channel)
{
    count(&channel->counts.refused);
    return "\a";
}

/* What the manual allows an open channel only, or a closed one only, is refused otherwise. */
static const char *answer(struct channel *channel, const struct slcan_line *line)
{
    bool good = false;
    switch (line->command) {
    case 'O':
    case 'L':
        good = !channel->open;
        channel->open = true;
        channel->listen_only = good ? line->command == 'L' : channel->listen_only;
        break;
    case 'C':
        good = channel->open;
        channel->open = false;
        break;
    case 'S':
        /* No bus behind this line that has a bit rate; the hosts set one all the same. */
        good = !channel->open && line->number <= 8;
        break;
    case 's':
        good = !channel->open;
        break;
    case 'X':
        good = !channel->open && line->number == 1; /* frames are always handed over at once */
        break;
    case 'Z':
        good = !channel->open && line->digits == 1 && line->number == 0; /* no time stamps */
        break;
    case 'M':
        good = !channel->open && line->number == 0; /* no filter: code 0, mask all ones */
        break;
    case 'm':
        good = !channel->open && line->number == UINT32_MAX;
        break;
    case 'V':
        return line->digits == 0 ? version : refuse(channel);
    case 'N':
        return serial_number;
    case 'F':
        /* No controller whose flags could be told. */
        return channel->open && line->digits == 0 ? "F00\r" : refuse(channel);
    default:
        break; /* P, A, W, U, Q, and z, which only devices say */
    }
    return good ? "\r" : refuse(channel);
}

/* True if the line was a frame to hand over. */
static bool serve(struct channel *channel, enum slcan_status status, const struct slcan_line *line)
{
    if (status == SLCAN_FRAME && channel->open && !channel->listen_only) {
        say(channel, line->frame.flags & ONEBIT_FRAME_EXTENDED ? "Z\r" : "z\r");
        return true;
    }
    if (status == SLCAN_COMMAND) {
        say(channel, answer(channel, line));
    } else if (status != SLCAN_DONE && status != SLCAN_REFUSED) {
        /* CR alone is how hosts clear a line; to BEL, which no host sends, no answer helps. */
        say(channel, refuse(channel));
    }
    return false;
}

/* --- the host --- */

bool channel_open(struct channel *channel, uint8_t bit_rate)
{
    char text[] = "\r\rC\rS6\rO\r";
    if (!channel_flush(channel)) {
        return false;
    }
    text[5] = (char)('0' + bit_rate);
    channel->open = true;
    say(channel, text);
    return true;
}

bool channel_close(struct channel *channel)
{
    if (!channel_flush(channel)) {
        return false;
    }
    channel->open = false;
    say(channel, "C\r");
    return true;
}

bool channel_ask_version(struct channel *channel)
{
    if (!channel_flush(channel)) {
        return false;
    }
    channel->version_told = false;
    say(channel, "V\r");
    return true;
}

static void note_answer(struct channel *channel, enum slcan_status status,
                        const struct slcan_line *line)
{
    if (status == SLCAN_REFUSED) {
        count(&channel->counts.refused);
    }
    if (status == SLCAN_COMMAND && line->command == 'V') {
        channel->version_told = true;
    }
}

/* --- the transport --- */

static enum transport_status send_frame(void *context, const onebit_frame *frame)
{
    struct channel *channel = context;
    if (!channel->open) {
        channel_flush(channel); /* the answer to the command that closed it */
        return TRANSPORT_DOWN;
    }
    if (!channel_flush(channel)) {
        count(&channel->counts.full);
        return TRANSPORT_LATER;
    }
    uint8_t length = slcan_format(frame, channel->out);
    if (length == 0) {
        count(&channel->counts.unsayable);
        return TRANSPORT_LATER;
    }
    begin_output(channel, length);
    return TRANSPORT_DONE;
}

static enum transport_status receive_frame(void *context, onebit_frame *frame,
                                           uint64_t *nanoseconds)
{
    struct channel *channel = context;
    struct slcan_line line;
    uint8_t byte;
    uint64_t time = 0;
    /*
     * A device takes no byte while an answer could find no room: the host waits then. A host
     * answers nothing and goes on taking, so the two never wait for each other.
     */
    while ((channel_flush(channel) || channel->host) &&
           channel->hooks.take(channel->hooks.context, &byte, &time)) {
        enum slcan_status status = slcan_take(&channel->parser, byte, &line);
        if (status == SLCAN_PENDING) {
            continue;
        }
        channel->heard = true;
        bool is_frame = status == SLCAN_FRAME && channel->open;
        if (channel->host) {
            note_answer(channel, status, &line);
        } else {
            is_frame = serve(channel, status, &line);
        }
        if (is_frame) {
            *frame = line.frame;
            *nanoseconds = time;
            return TRANSPORT_DONE;
        }
    }
    return channel->open ? TRANSPORT_LATER : TRANSPORT_DOWN;
}

struct transport channel_transport(struct channel *channel)
{
    return (struct transport){.context = channel, .send = send_frame, .receive = receive_frame};
}

static void begin(struct channel *channel, const struct channel_hooks *hooks, bool host)
{
    *channel = (struct channel){.hooks = *hooks, .host = host};
}

void channel_begin_device(struct channel *channel, const struct channel_hooks *hooks)
{
    begin(channel, hooks, false);
}

void channel_begin_host(struct channel *channel, const struct channel_hooks *hooks)
{
    begin(channel, hooks, true);
}
