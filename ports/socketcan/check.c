/*
 * The check of check.h. Asks the kernel by sockets, ioctl and rtnetlink; looks for modules below
 * /lib/modules. Writes on standard output.
 */
#include "check.h"

#include <errno.h>
#include <linux/can.h>
#include <linux/can/netlink.h>
#include <linux/can/raw.h>
#include <linux/if_link.h>
#include <linux/rtnetlink.h>
#include <net/if.h>
#include <net/if_arp.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/ioctl.h>
#include <sys/socket.h>
#include <sys/utsname.h>
#include <unistd.h>

/* What rtnetlink says about the interface. */
struct link_details {
    char kind[32]; /* "vcan", "can", ...; empty where the driver has none */
    bool has_bitrate;
    uint32_t bitrate;
    bool bus_off;
};

static bool missing(const char *what, const char *mend)
{
    printf("missing  %s\n         %s\n", what, mend);
    return false;
}

static bool fine(const char *what)
{
    printf("ok       %s\n", what);
    return true;
}

/* Whether the running kernel has a module to load; the kernel's own list tells, without a search.
 */
static bool has_module(const char *name)
{
    struct utsname system;
    char path[512];
    char line[1024];
    bool found = false;
    static const char *const lists[] = {"modules.dep", "modules.builtin"};
    if (uname(&system) != 0) {
        return false;
    }
    for (size_t k = 0; !found && k < sizeof lists / sizeof *lists; ++k) {
        snprintf(path, sizeof path, "/lib/modules/%s/%s", system.release, lists[k]);
        FILE *file = fopen(path, "r");
        while (file != NULL && !found && fgets(line, sizeof line, file) != NULL) {
            /* "kernel/net/can/can-raw.ko.xz: kernel/net/can/can.ko.xz" */
            line[strcspn(line, ":\n")] = '\0';
            const char *slash = strrchr(line, '/');
            const char *module = slash != NULL ? slash + 1 : line;
            found = strncmp(module, name, strlen(name)) == 0 &&
                    strncmp(module + strlen(name), ".ko", 3) == 0;
        }
        if (file != NULL) {
            fclose(file);
        }
    }
    return found;
}

static bool check_kernel(int *handle)
{
    *handle = socket(PF_CAN, SOCK_RAW | SOCK_CLOEXEC, CAN_RAW);
    if (*handle >= 0) {
        return fine("the kernel has CAN sockets, and this process may open them");
    }
    if (errno == EPERM || errno == EACCES) {
        return missing("the right to open CAN sockets: the kernel refuses this process",
                       "a container or sandbox forbids it: run outside, or let it have AF_CAN "
                       "(seccomp, apparmor)");
    }
    if (has_module("can-raw")) {
        return missing("CAN sockets: the kernel's module is not loaded", "sudo modprobe can-raw");
    }
    return missing("CAN sockets: this kernel has none, and no module can-raw to load",
                   "boot a kernel with CONFIG_CAN and CONFIG_CAN_RAW (Debian, Ubuntu: sudo apt "
                   "install linux-image-generic || sudo apt install linux-image-amd64)");
}

static void name_request(struct ifreq *request, const char *interface)
{
    memset(request, 0, sizeof *request);
    memcpy(request->ifr_name, interface, strnlen(interface, sizeof request->ifr_name - 1));
}

static bool check_there(int handle, const char *interface)
{
    char what[128];
    char mend[256];
    struct ifreq request;
    name_request(&request, interface);
    if (strlen(interface) < sizeof request.ifr_name && ioctl(handle, SIOCGIFINDEX, &request) == 0) {
        snprintf(what, sizeof what, "%.32s: the interface is there", interface);
        return fine(what);
    }
    snprintf(what, sizeof what, "%.32s: no such interface", interface);
    if (strncmp(interface, "vcan", 4) != 0) {
        return missing(what, "ip -details link show type can lists the adapters that drivers have "
                             "found; a serial one needs slcand");
    }
    snprintf(mend, sizeof mend, "%ssudo ip link add dev %.32s type vcan",
             has_module("vcan") ? "sudo modprobe vcan && " : "", interface);
    return missing(what, mend);
}

static bool check_kind(int handle, const char *interface)
{
    char what[128];
    struct ifreq request;
    name_request(&request, interface);
    if (ioctl(handle, SIOCGIFHWADDR, &request) == 0 && request.ifr_hwaddr.sa_family == ARPHRD_CAN) {
        snprintf(what, sizeof what, "%.32s: it is a CAN interface", interface);
        return fine(what);
    }
    snprintf(what, sizeof what, "%.32s: it is not a CAN interface", interface);
    return missing(what,
                   "choose another; ip -details link show type can, or type vcan, lists them");
}

static bool check_up(int handle, const char *interface)
{
    char what[128];
    char mend[128];
    struct ifreq request;
    name_request(&request, interface);
    if (ioctl(handle, SIOCGIFFLAGS, &request) == 0 && (request.ifr_flags & IFF_UP) != 0) {
        snprintf(what, sizeof what, "%.32s: it is up", interface);
        return fine(what);
    }
    snprintf(what, sizeof what, "%.32s: it is down", interface);
    snprintf(mend, sizeof mend, "sudo ip link set %.32s up", interface);
    return missing(what, mend);
}

/* --- rtnetlink --- */

/* The attribute that begins `length` bytes of a list, or null. */
static const struct rtattr *attribute_at(const void *list, size_t length)
{
    const struct rtattr *attribute = list;
    bool whole = length >= sizeof *attribute && attribute->rta_len >= sizeof *attribute &&
                 attribute->rta_len <= length;
    return whole ? attribute : NULL;
}

/* The attribute behind one, which leaves so many bytes of the list. */
static const struct rtattr *next_attribute(const struct rtattr *attribute, size_t *length)
{
    size_t step = RTA_ALIGN((size_t)attribute->rta_len);
    step = step < *length ? step : *length;
    *length -= step;
    return attribute_at((const void *)((const char *)attribute + step), *length);
}

/* Copies an attribute's value if it has the size. */
static void copy_value(void *to, size_t size, const struct rtattr *attribute)
{
    if (RTA_PAYLOAD(attribute) >= size) {
        memcpy(to, RTA_DATA(attribute), size);
    }
}

static void read_can_data(const struct rtattr *data, struct link_details *details)
{
    size_t rest = RTA_PAYLOAD(data);
    for (const struct rtattr *part = attribute_at(RTA_DATA(data), rest); part != NULL;
         part = next_attribute(part, &rest)) {
        if (part->rta_type == IFLA_CAN_BITTIMING) {
            struct can_bittiming timing = {0};
            copy_value(&timing, sizeof timing, part);
            details->bitrate = timing.bitrate;
            details->has_bitrate = timing.bitrate != 0;
        } else if (part->rta_type == IFLA_CAN_STATE) {
            uint32_t state = 0;
            copy_value(&state, sizeof state, part);
            details->bus_off = state == CAN_STATE_BUS_OFF;
        }
    }
}

static void read_link_info(const struct rtattr *information, struct link_details *details)
{
    size_t rest = RTA_PAYLOAD(information);
    for (const struct rtattr *part = attribute_at(RTA_DATA(information), rest); part != NULL;
         part = next_attribute(part, &rest)) {
        if (part->rta_type == IFLA_INFO_KIND) {
            size_t length = RTA_PAYLOAD(part);
            length = length < sizeof details->kind ? length : sizeof details->kind - 1;
            memcpy(details->kind, RTA_DATA(part), length);
        } else if (part->rta_type == IFLA_INFO_DATA && strcmp(details->kind, "can") == 0) {
            read_can_data(part, details);
        }
    }
}

static bool ask_details(const char *interface, struct link_details *details)
{
    struct {
        struct nlmsghdr header;
        struct ifinfomsg link;
    } request = {
        .header = {.nlmsg_len = sizeof request,
                   .nlmsg_type = RTM_GETLINK,
                   .nlmsg_flags = NLM_F_REQUEST},
        .link = {.ifi_family = AF_UNSPEC, .ifi_index = (int)if_nametoindex(interface)},
    };
    union {
        struct nlmsghdr header;
        char bytes[16384];
    } answer;
    memset(details, 0, sizeof *details);
    int handle = socket(AF_NETLINK, SOCK_RAW | SOCK_CLOEXEC, NETLINK_ROUTE);
    ssize_t length = -1;
    if (handle >= 0 && send(handle, &request, sizeof request, 0) > 0) {
        length = recv(handle, &answer, sizeof answer, 0);
    }
    if (handle >= 0) {
        close(handle);
    }
    if (length < (ssize_t)sizeof answer.header || !NLMSG_OK(&answer.header, (uint32_t)length) ||
        answer.header.nlmsg_type != RTM_NEWLINK) {
        return false;
    }
    const struct ifinfomsg *link = NLMSG_DATA(&answer.header);
    size_t rest = IFLA_PAYLOAD(&answer.header);
    for (const struct rtattr *part = attribute_at(IFLA_RTA(link), rest); part != NULL;
         part = next_attribute(part, &rest)) {
        if (part->rta_type == IFLA_LINKINFO) {
            read_link_info(part, details);
        }
    }
    return true;
}

static bool check_bitrate(const char *interface)
{
    struct link_details details;
    char what[128];
    char mend[192];
    if (!ask_details(interface, &details) || strcmp(details.kind, "can") != 0) {
        /* Virtual, or a driver (slcan) whose bit rate is set elsewhere. */
        snprintf(what, sizeof what, "%.32s: %.16s needs no bit rate", interface,
                 details.kind[0] != '\0' ? details.kind : "its driver");
        return fine(what);
    }
    if (!details.has_bitrate) {
        snprintf(what, sizeof what, "%.32s: it has no bit rate", interface);
        snprintf(mend, sizeof mend, "sudo ip link set %.32s type can bitrate 500000", interface);
        return missing(what, mend);
    }
    if (details.bus_off) {
        snprintf(what, sizeof what, "%.32s: its controller is off the bus (too many errors)",
                 interface);
        snprintf(mend, sizeof mend,
                 "mend wiring, termination and bit rate, then sudo ip link set %.32s type can "
                 "restart",
                 interface);
        return missing(what, mend);
    }
    snprintf(what, sizeof what, "%.32s: %lu bit/s; all nodes must have the same", interface,
             (unsigned long)details.bitrate);
    return fine(what);
}

bool check_interface(const char *interface)
{
    int handle;
    if (!check_kernel(&handle)) {
        /* Without CAN there is no CAN interface; any socket can still tell what there is. */
        handle = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC, 0);
        check_there(handle, interface);
        close(handle);
        return false;
    }
    /* Each question makes sense only where the one before is answered. The bit rate can be set only
       while the interface is down, so it comes first. */
    bool good = check_there(handle, interface) && check_kind(handle, interface) &&
                check_bitrate(interface) && check_up(handle, interface);
    close(handle);
    return good;
}
