#include "socket_buffer.h"

#include <arpa/inet.h>
#include <stdlib.h>
#include <sys/socket.h>

void socket_buffer_set(guint16 port, int bytes) {
    g_autoptr(GDir) dir = g_dir_open("/proc/self/fd", 0, NULL);
    const char *name;
    while (dir && (name = g_dir_read_name(dir))) {
        struct sockaddr_in address = {0};
        int fd = atoi(name), type = 0;
        socklen_t address_size = sizeof address, size = sizeof type;
        if (getsockopt(fd, SOL_SOCKET, SO_TYPE, &type, &size) != 0 || type != SOCK_DGRAM ||
            getsockname(fd, (struct sockaddr *)&address, &address_size) != 0 ||
            address.sin_family != AF_INET || ntohs(address.sin_port) != port)
            continue;
        setsockopt(fd, SOL_SOCKET, SO_RCVBUF, &bytes, sizeof bytes);
        return;
    }
}
