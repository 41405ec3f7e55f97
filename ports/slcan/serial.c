/* Terminals and Unix sockets behind serial.h. Touches its file and nothing else. */
#include "serial.h"

#include <errno.h>
#include <fcntl.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/stat.h>
#include <sys/un.h>
#include <termios.h>
#include <time.h>
#include <unistd.h>

#define SPEED 115200
#define NANOSECONDS 1000000000u

static const struct {
    unsigned long bits; /* a second */
    speed_t code;
} speeds[] = {
    {9600, B9600},     {19200, B19200},     {38400, B38400},     {57600, B57600},
    {115200, B115200}, {230400, B230400},   {460800, B460800},   {500000, B500000},
    {921600, B921600}, {1000000, B1000000}, {2000000, B2000000}, {3000000, B3000000},
};

/* --- opening --- */

/* PATH or PATH@SPEED in its parts. */
static bool split(const char *text, char *path, size_t size, speed_t *speed,
                  struct problem *problem)
{
    const char *at = strrchr(text, '@');
    size_t length = at != NULL ? (size_t)(at - text) : strlen(text);
    if (length == 0 || length >= size) {
        return problem_set(problem, "%s: must be the path of a terminal or a socket", text);
    }
    memcpy(path, text, length);
    path[length] = '\0';
    char *end = NULL;
    unsigned long bits = at != NULL ? strtoul(at + 1, &end, 10) : SPEED;
    for (size_t k = 0; k < sizeof speeds / sizeof *speeds; ++k) {
        if ((end == NULL || *end == '\0') && speeds[k].bits == bits) {
            *speed = speeds[k].code;
            return true;
        }
    }
    return problem_set(problem, "%s: no such speed; 9600, 115200, 921600, 1000000 are some", text);
}

static int connect_to(const char *path)
{
    struct sockaddr_un address = {.sun_family = AF_UNIX};
    if (strlen(path) >= sizeof address.sun_path) {
        errno = ENAMETOOLONG;
        return -1;
    }
    strcpy(address.sun_path, path);
    int handle = socket(AF_UNIX, SOCK_STREAM, 0);
    if (handle >= 0 && connect(handle, (const struct sockaddr *)&address, sizeof address) != 0) {
        int reason = errno;
        close(handle);
        errno = reason;
        return -1;
    }
    return handle;
}

/* Bytes as they are, eight bits, no parity, no handshake. */
static bool make_raw(int handle, speed_t speed)
{
    struct termios settings;
    if (tcgetattr(handle, &settings) != 0) {
        return false;
    }
    cfmakeraw(&settings);
    settings.c_cflag &= ~(tcflag_t)(CSTOPB | CRTSCTS);
    settings.c_cflag |= CLOCAL | CREAD;
    /* A read of no bytes is then the end of the line, never a line that is silent. */
    settings.c_cc[VMIN] = 1;
    settings.c_cc[VTIME] = 0;
    return cfsetispeed(&settings, speed) == 0 && cfsetospeed(&settings, speed) == 0 &&
           tcsetattr(handle, TCSANOW, &settings) == 0 && tcflush(handle, TCIFLUSH) == 0;
}

bool serial_open(struct serial *serial, const char *path, struct problem *problem)
{
    char name[4096];
    struct stat status;
    speed_t speed = B0;
    *serial = (struct serial){.handle = -1};
    if (!split(path, name, sizeof name, &speed, problem)) {
        return false;
    }
    bool is_socket = stat(name, &status) == 0 && S_ISSOCK(status.st_mode);
    /* O_NONBLOCK: do not wait for a modem's carrier. */
    int handle = is_socket ? connect_to(name) : open(name, O_RDWR | O_NOCTTY | O_NONBLOCK);
    if (handle < 0) {
        return problem_set(problem, "%s: cannot be opened: %s", name, strerror(errno));
    }
    serial->handle = handle;
    serial->is_socket = is_socket;
    int flags = fcntl(handle, F_GETFL);
    if ((!is_socket && !make_raw(handle, speed)) || flags < 0 ||
        fcntl(handle, F_SETFL, flags | O_NONBLOCK) != 0 ||
        fcntl(handle, F_SETFD, FD_CLOEXEC) != 0) {
        problem_set(problem, "%s: cannot be set up as a serial line: %s", name, strerror(errno));
        serial_close(serial);
        return false;
    }
    return true;
}

void serial_close(struct serial *serial)
{
    if (serial->handle >= 0) {
        close(serial->handle);
        serial->handle = -1;
    }
}

/* --- bytes --- */

bool serial_flush(struct serial *serial)
{
    size_t written = 0;
    while (!serial->down && written < serial->out_count) {
        const uint8_t *rest = serial->out + written;
        size_t length = serial->out_count - written;
        /* A socket whose other end is gone would send SIGPIPE. */
        ssize_t count = serial->is_socket ? send(serial->handle, rest, length, MSG_NOSIGNAL)
                                          : write(serial->handle, rest, length);
        if (count > 0) {
            written += (size_t)count;
        } else if (count < 0 && errno == EAGAIN) {
            break;
        } else if (count == 0 || errno != EINTR) {
            serial->down = true;
        }
    }
    serial->out_count = serial->down ? 0 : serial->out_count - written;
    memmove(serial->out, serial->out + written, serial->out_count);
    return serial->out_count == 0;
}

static bool put(void *context, uint8_t byte)
{
    struct serial *serial = context;
    if (serial->out_count == SERIAL_BUFFER) {
        serial_flush(serial);
    }
    if (serial->out_count == SERIAL_BUFFER) {
        return false;
    }
    serial->out[serial->out_count++] = byte;
    return true;
}

static void fill(struct serial *serial)
{
    struct timespec time;
    ssize_t count;
    do {
        count = read(serial->handle, serial->in, sizeof serial->in);
    } while (count < 0 && errno == EINTR);
    serial->in_next = 0;
    serial->in_end = count > 0 ? (size_t)count : 0;
    serial->down = serial->down || count == 0 || (count < 0 && errno != EAGAIN);
    clock_gettime(CLOCK_MONOTONIC, &time);
    serial->in_time = (uint64_t)time.tv_sec * NANOSECONDS + (uint64_t)time.tv_nsec;
}

static bool take(void *context, uint8_t *byte, uint64_t *nanoseconds)
{
    struct serial *serial = context;
    if (serial->in_next == serial->in_end && !serial->down) {
        fill(serial);
    }
    if (serial->in_next == serial->in_end) {
        return false;
    }
    *byte = serial->in[serial->in_next++];
    *nanoseconds = serial->in_time;
    return true;
}

struct channel_hooks serial_hooks(struct serial *serial)
{
    return (struct channel_hooks){.context = serial, .put = put, .take = take};
}
