#include "udp.h"

#include "drivers/device.h"
#include "drivers/recording.h"

#include <arpa/inet.h>
#include <errno.h>
#include <ifaddrs.h>
#include <net/if.h>
#include <string.h>
#include <sys/socket.h>
#include <unistd.h>

char *udp_name(guint32 address) {
    return g_strdup_printf("%u.%u.%u.%u", address >> 24, address >> 16 & 255, address >> 8 & 255,
                           address & 255);
}

static struct sockaddr_in socket_address(guint32 address, guint16 port) {
    return (struct sockaddr_in){
        .sin_family = AF_INET, .sin_port = htons(port), .sin_addr.s_addr = htonl(address)};
}

int udp_open(guint32 local_address, guint16 port, GError **error) {
    const struct sockaddr_in address = socket_address(local_address, port);
    const int yes = 1;
    int fd = socket(AF_INET, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    if (fd >= 0 && setsockopt(fd, SOL_SOCKET, SO_REUSEADDR, &yes, sizeof yes) == 0 &&
        bind(fd, (const struct sockaddr *)&address, sizeof address) == 0)
        return fd;
    const int why = errno;
    g_autofree char *name = udp_name(local_address);
    if (fd >= 0)
        close(fd);
    device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                     "cannot open UDP port %d of %s: %s" ERROR_ADVICE "%s", port, name,
                     g_strerror(why),
                     why == EADDRNOTAVAIL
                         ? "give local_address an address of this computer, as “ip address” lists "
                           "them, and check that its network is up"
                     : why == EADDRINUSE ? "end the other program that uses the port"
                                         : "check the network of this computer");
    return -1;
}

int udp_send(int fd, guint32 address, guint16 port, const guint8 *packet, gsize n) {
    const struct sockaddr_in to = socket_address(address, port);
    const int why = sendto(fd, packet, n, MSG_NOSIGNAL, (const struct sockaddr *)&to, sizeof to) < 0
                        ? errno
                        : 0;
    if (recording_is_on()) {
        g_autofree char *name = udp_name(address);
        const struct recording_bus bus = {"udp", name};
        if (why)
            recording_note(bus, "not sent: %s", g_strerror(why));
        else
            recording_bytes(bus, RECORDING_SENT, packet, n);
    }
    return why;
}

gssize udp_receive(int fd, guint8 *ret, gsize size, guint32 *ret_address) {
    struct sockaddr_in from = {0};
    socklen_t length = sizeof from;
    gssize n;
    do
        n = recvfrom(fd, ret, size, 0, (struct sockaddr *)&from, &length);
    while (n < 0 && errno == EINTR);
    *ret_address = ntohl(from.sin_addr.s_addr);
    if (recording_is_on() && n >= 0) {
        g_autofree char *name = udp_name(*ret_address);
        recording_bytes((struct recording_bus){"udp", name}, RECORDING_RECEIVED, ret, (gsize)n);
    }
    return n;
}

guint32 udp_broadcast(guint32 local_address) {
    guint32 broadcast = 0;
    struct ifaddrs *all = NULL;
    if (getifaddrs(&all) != 0)
        return 0;
    for (const struct ifaddrs *item = all; item; item = item->ifa_next) {
        struct sockaddr_in own, to;
        if (!item->ifa_addr || item->ifa_addr->sa_family != AF_INET ||
            !(item->ifa_flags & IFF_BROADCAST) || !item->ifa_broadaddr)
            continue;
        memcpy(&own, item->ifa_addr, sizeof own);
        memcpy(&to, item->ifa_broadaddr, sizeof to);
        if (ntohl(own.sin_addr.s_addr) == local_address)
            broadcast = ntohl(to.sin_addr.s_addr);
    }
    freeifaddrs(all);
    return broadcast;
}
