/* Raw CAN sockets behind transport.h; see socketcan.h. Touches its socket and its counters. */
#include "socketcan.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/error.h>
#include <linux/can/raw.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <time.h>
#include <unistd.h>

#define NANOSECONDS 1000000000u

/* --- opening --- */

static bool bind_to(int handle, int index)
{
    struct sockaddr_can address = {.can_family = AF_CAN, .can_ifindex = index};
    return bind(handle, (const struct sockaddr *)&address, sizeof address) == 0;
}

static void name_request(struct ifreq *request, const char *name)
{
    memset(request, 0, sizeof *request);
    memcpy(request->ifr_name, name, strnlen(name, sizeof request->ifr_name - 1));
}

static bool is_up(int handle, const char *name)
{
    struct ifreq request;
    name_request(&request, name);
    return ioctl(handle, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0;
}

/* The index of a CAN interface that is up, or 0 and why not. */
static int interface_index(int handle, const char *name, struct problem *problem)
{
    struct ifreq request;
    name_request(&request, name);
    if (strlen(name) >= sizeof request.ifr_name || ioctl(handle, SIOCGIFINDEX, &request) != 0) {
        problem_set(problem, "%s: no such interface; onebit-node check --interface %s says more",
                    name, name);
        return 0;
    }
    int index = request.ifr_ifindex;
    if (ioctl(handle, SIOCGIFHWADDR, &request) != 0 || request.ifr_hwaddr.sa_family != ARPHRD_CAN) {
        problem_set(problem, "%s: not a CAN interface", name);
        return 0;
    }
    if (!is_up(handle, name)) {
        problem_set(problem, "%s: the interface is down; ip link set %s up brings it up", name,
                    name);
        return 0;
    }
    return index;
}

static bool set_option(int handle, int level, int option, int value)
{
    return setsockopt(handle, level, option, &value, sizeof value) == 0;
}

static bool set_options(int handle)
{
    const can_err_mask_t errors = CAN_ERR_MASK;
    /* Loopback is for the host's other sockets; this one does not hear itself. */
    return set_option(handle, SOL_CAN_RAW, CAN_RAW_LOOPBACK, 1) &&
           set_option(handle, SOL_CAN_RAW, CAN_RAW_RECV_OWN_MSGS, 0) &&
           /* CAN FD frames are to be refused and counted, not overlooked. */
           set_option(handle, SOL_CAN_RAW, CAN_RAW_FD_FRAMES, 1) &&
           setsockopt(handle, SOL_CAN_RAW, CAN_RAW_ERR_FILTER, &errors, sizeof errors) == 0 &&
           set_option(handle, SOL_SOCKET, SO_TIMESTAMPNS, 1) &&
           set_option(handle, SOL_SOCKET, SO_RXQ_OVFL, 1);
}

static bool apply_filters(int handle, const struct socketcan_filter *filters, uint32_t count)
{
    struct can_filter kernel[SOCKETCAN_FILTERS_MAX];
    for (uint32_t k = 0; k < count; ++k) {
        /* Remote frames of the identifier come through, to be refused and counted. */
        kernel[k].can_id = filters[k].identifier | (filters[k].extended ? CAN_EFF_FLAG : 0);
        kernel[k].can_mask = filters[k].mask | CAN_EFF_FLAG;
    }
    return setsockopt(handle, SOL_CAN_RAW, CAN_RAW_FILTER, kernel,
                      (socklen_t)(count * sizeof *kernel)) == 0;
}

bool socketcan_filter(struct socketcan *socketcan, const struct socketcan_filter *filters,
                      uint32_t count)
{
    if (!apply_filters(socketcan->handle, filters, count)) {
        return false;
    }
    if (count != 0) {
        memcpy(socketcan->filters, filters, count * sizeof *filters);
    }
    socketcan->filter_count = count;
    return true;
}

bool socketcan_open(struct socketcan *socketcan, const char *interface,
                    const struct socketcan_filter *filters, uint32_t count, struct problem *problem)
{
    *socketcan = (struct socketcan){.handle = -1};
    int handle = socket(PF_CAN, SOCK_RAW | SOCK_NONBLOCK | SOCK_CLOEXEC, CAN_RAW);
    if (handle < 0) {
        return problem_set(problem,
                           "%s: no CAN socket: %s; onebit-node check --interface %s says more",
                           interface, strerror(errno), interface);
    }
    socketcan->handle = handle;
    int index = interface_index(handle, interface, problem);
    if (index == 0) {
        socketcan_close(socketcan);
        return false;
    }
    strcpy(socketcan->name, interface); /* it fits, or there would be no index */
    if (!set_options(handle) || !socketcan_filter(socketcan, filters, count) ||
        !bind_to(handle, index)) {
        problem_set(problem, "%s: the CAN socket cannot be set up: %s", interface, strerror(errno));
        socketcan_close(socketcan);
        return false;
    }
    return true;
}

void socketcan_close(struct socketcan *socketcan)
{
    if (socketcan->handle >= 0) {
        close(socketcan->handle);
        socketcan->handle = -1;
    }
}

/* --- the hooks --- */

static enum transport_status went_down(struct socketcan *socketcan)
{
    if (!socketcan->down) {
        socketcan->down = true;
        ++socketcan->counts.went_down;
    }
    return TRANSPORT_DOWN;
}

static enum transport_status send_frame(void *context, const onebit_frame *frame)
{
    struct socketcan *socketcan = context;
    struct can_frame kernel = {.can_id = frame->identifier, .len = frame->length};
    kernel.can_id |= (frame->flags & ONEBIT_FRAME_EXTENDED) != 0 ? CAN_EFF_FLAG : 0;
    memcpy(kernel.data, frame->data, frame->length <= 8 ? frame->length : 8);
    ssize_t sent;
    do {
        sent = send(socketcan->handle, &kernel, sizeof kernel, MSG_DONTWAIT);
    } while (sent < 0 && errno == EINTR);
    if (sent == (ssize_t)sizeof kernel) {
        ++socketcan->counts.sent;
        return TRANSPORT_DONE;
    }
    if (errno == ENOBUFS || errno == EAGAIN || errno == ENOMEM) {
        ++socketcan->counts.queue_full;
        return TRANSPORT_LATER;
    }
    return went_down(socketcan); /* ENETDOWN; ENXIO, ENODEV where the interface is gone */
}

/* When the kernel took the frame, and how many it has lost since. */
static uint64_t read_ancillary(struct socketcan *socketcan, struct msghdr *header)
{
    struct timespec time = {0};
    for (struct cmsghdr *part = CMSG_FIRSTHDR(header); part != NULL;
         part = CMSG_NXTHDR(header, part)) {
        if (part->cmsg_level != SOL_SOCKET) {
            continue;
        }
        if (part->cmsg_type == SCM_TIMESTAMPNS) {
            memcpy(&time, CMSG_DATA(part), sizeof time);
        } else if (part->cmsg_type == SO_RXQ_OVFL) {
            uint32_t overflow;
            memcpy(&overflow, CMSG_DATA(part), sizeof overflow);
            socketcan->counts.lost += overflow - socketcan->overflow;
            socketcan->overflow = overflow;
        }
    }
    if (time.tv_sec == 0) {
        clock_gettime(CLOCK_REALTIME, &time);
    }
    return (uint64_t)time.tv_sec * NANOSECONDS + (uint64_t)time.tv_nsec;
}

static void convert(struct socketcan *socketcan, const struct canfd_frame *kernel, bool flexible,
                    onebit_frame *frame)
{
    *frame = (onebit_frame){.length = kernel->len};
    bool extended = (kernel->can_id & CAN_EFF_FLAG) != 0;
    frame->identifier = kernel->can_id & (extended ? CAN_EFF_MASK : CAN_SFF_MASK);
    frame->flags = (uint8_t)((extended ? ONEBIT_FRAME_EXTENDED : 0) |
                             ((kernel->can_id & CAN_RTR_FLAG) != 0 ? ONEBIT_FRAME_REMOTE : 0) |
                             ((kernel->can_id & CAN_ERR_FLAG) != 0 ? ONEBIT_FRAME_ERROR : 0) |
                             (flexible ? ONEBIT_FRAME_FLEXIBLE : 0));
    memcpy(frame->data, kernel->data, sizeof frame->data);
    if ((kernel->can_id & CAN_ERR_FLAG) != 0) {
        ++socketcan->counts.error_frames;
        socketcan->counts.bus_off += (kernel->can_id & CAN_ERR_BUSOFF) != 0;
    }
}

static enum transport_status receive_frame(void *context, onebit_frame *frame,
                                           uint64_t *nanoseconds)
{
    struct socketcan *socketcan = context;
    struct canfd_frame kernel = {0};
    struct iovec part = {.iov_base = &kernel, .iov_len = sizeof kernel};
    union {
        struct cmsghdr header; /* for its alignment */
        char bytes[CMSG_SPACE(sizeof(struct timespec)) + CMSG_SPACE(sizeof(uint32_t))];
    } ancillary;
    struct msghdr header = {
        .msg_iov = &part,
        .msg_iovlen = 1,
        .msg_control = &ancillary,
        .msg_controllen = sizeof ancillary,
    };
    ssize_t length;
    do {
        length = recvmsg(socketcan->handle, &header, MSG_DONTWAIT);
    } while (length < 0 && errno == EINTR);
    if (length < 0) {
        return errno == EAGAIN ? TRANSPORT_LATER : went_down(socketcan);
    }
    ++socketcan->counts.received;
    *nanoseconds = read_ancillary(socketcan, &header);
    convert(socketcan, &kernel, length == (ssize_t)CANFD_MTU, frame);
    return TRANSPORT_DONE;
}

struct transport socketcan_transport(struct socketcan *socketcan)
{
    return (struct transport){.context = socketcan, .send = send_frame, .receive = receive_frame};
}

bool socketcan_revive(struct socketcan *socketcan)
{
    struct ifreq request;
    name_request(&request, socketcan->name);
    if (!is_up(socketcan->handle, socketcan->name) ||
        ioctl(socketcan->handle, SIOCGIFINDEX, &request) != 0) {
        return false;
    }
    /* Neither changes anything on the same interface; a new one needs both. */
    socketcan->down =
        !bind_to(socketcan->handle, request.ifr_ifindex) ||
        !apply_filters(socketcan->handle, socketcan->filters, socketcan->filter_count);
    return !socketcan->down;
}
