/*
 * slcan-device: the device's end of a slcan line (ports/slcan/channel.h) for tests, on a terminal
 * of its own making. Prints the path of the other end; then a line on standard input is a frame to
 * send, and what is received is printed in the same form: identifier, flags, length, data,
 * hexadecimal but for the length. Ends with its input.
 */
#include "channel.h"
#include "serial.h"

#include <fcntl.h>
#include <poll.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

static int fail(const char *what)
{
    perror(what);
    return 1;
}

static bool read_frame(const char *text, onebit_frame *frame)
{
    unsigned long identifier;
    unsigned flags;
    unsigned length;
    int at;
    if (sscanf(text, "%lx %x %u %n", &identifier, &flags, &length, &at) != 3 || length > 8) {
        return false;
    }
    *frame = (onebit_frame){
        .identifier = (uint32_t)identifier, .flags = (uint8_t)flags, .length = (uint8_t)length};
    for (unsigned k = 0, byte; k < length && sscanf(text + at + 2 * k, "%2x", &byte) == 1; ++k) {
        frame->data[k] = (uint8_t)byte;
    }
    return true;
}

static void print_frame(const onebit_frame *frame)
{
    printf("%lX %X %u ", (unsigned long)frame->identifier, (unsigned)frame->flags,
           (unsigned)frame->length);
    for (int k = 0; k < frame->length; ++k) {
        printf("%02X", (unsigned)frame->data[k]);
    }
    putchar('\n');
}

int main(void)
{
    struct serial serial = {.handle = posix_openpt(O_RDWR | O_NOCTTY | O_NONBLOCK)};
    if (serial.handle < 0 || grantpt(serial.handle) != 0 || unlockpt(serial.handle) != 0) {
        return fail("no pty");
    }
    /* Held open, so that the line is there before and after its user. */
    const char *path = ptsname(serial.handle);
    int other_end = open(path, O_RDWR | O_NOCTTY);
    if (other_end < 0) {
        return fail(path);
    }
    setvbuf(stdin, NULL, _IONBF, 0); /* so that poll knows of all that waits */
    setvbuf(stdout, NULL, _IOLBF, BUFSIZ);
    puts(path);
    static struct channel channel;
    const struct channel_hooks hooks = serial_hooks(&serial);
    channel_begin_device(&channel, &hooks);
    struct transport transport = channel_transport(&channel);
    onebit_frame frame;
    uint64_t time;
    for (;;) {
        while (transport.receive(transport.context, &frame, &time) == TRANSPORT_DONE) {
            print_frame(&frame);
        }
        bool written = channel_flush(&channel) && serial_flush(&serial);
        struct pollfd files[] = {
            {.fd = serial.handle, .events = (short)(written ? POLLIN : POLLIN | POLLOUT)},
            {.fd = STDIN_FILENO, .events = POLLIN},
        };
        poll(files, 2, -1);
        char text[128];
        if (files[1].revents != 0) {
            if (fgets(text, sizeof text, stdin) == NULL) {
                return 0;
            }
            if (!read_frame(text, &frame) ||
                transport.send(transport.context, &frame) != TRANSPORT_DONE) {
                printf("not sent: %s", text);
            }
        }
    }
}
