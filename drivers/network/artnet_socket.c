#include "artnet_socket.h"

#include "drivers/device.h"
#include "udp.h"

#include <glib-unix.h>
#include <unistd.h>

struct listener {
    guint32 node;
    ArtnetFunc func;
    gpointer data;
};

struct ArtnetSocket {
    int n_refs;
    guint32 local_address;
    int fd;
    guint source;
    GPtrArray *listeners; /* of struct listener */
};

static GSList *sockets; /* of ArtnetSocket */

static gboolean on_input(int fd, GIOCondition condition, gpointer data) {
    artnet_socket_receive(data);
    return G_SOURCE_CONTINUE;
}

ArtnetSocket *artnet_socket_get(guint32 local_address, GError **error) {
    for (const GSList *l = sockets; l; l = l->next) {
        ArtnetSocket *socket = l->data;
        if (socket->local_address != local_address)
            continue;
        socket->n_refs++;
        return socket;
    }
    const int fd = udp_open(local_address, ARTNET_PORT, error);
    if (fd < 0)
        return NULL;
    ArtnetSocket *socket = g_new0(ArtnetSocket, 1);
    *socket = (ArtnetSocket){.n_refs = 1,
                             .local_address = local_address,
                             .fd = fd,
                             .listeners = g_ptr_array_new_with_free_func(g_free)};
    socket->source = g_unix_fd_add(fd, G_IO_IN, on_input, socket);
    sockets = g_slist_prepend(sockets, socket);
    return socket;
}

void artnet_socket_unref(ArtnetSocket *socket) {
    if (!socket || --socket->n_refs > 0)
        return;
    sockets = g_slist_remove(sockets, socket);
    g_source_remove(socket->source);
    close(socket->fd);
    g_ptr_array_unref(socket->listeners);
    g_free(socket);
}

void artnet_socket_listen(ArtnetSocket *socket, guint32 node, ArtnetFunc func, gpointer data) {
    struct listener *listener = g_new0(struct listener, 1);
    *listener = (struct listener){node, func, data};
    g_ptr_array_add(socket->listeners, listener);
}

void artnet_socket_unlisten(ArtnetSocket *socket, gpointer data) {
    for (guint i = socket->listeners->len; i-- > 0;)
        if (((const struct listener *)socket->listeners->pdata[i])->data == data)
            g_ptr_array_remove_index(socket->listeners, i);
}

gboolean artnet_socket_send(ArtnetSocket *socket, guint32 node, const guint8 *packet, gsize n,
                            GError **error) {
    const int why = udp_send(socket->fd, node, ARTNET_PORT, packet, n);
    g_autofree char *name = udp_name(node);
    return why == 0 || device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                                        "cannot send to the Art-Net node %s: %s" ERROR_ADVICE
                                        "check address, and the network of this computer",
                                        name, g_strerror(why));
}

void artnet_socket_receive(ArtnetSocket *socket) {
    guint8 bytes[1500];
    guint32 from;
    for (gssize n; (n = udp_receive(socket->fd, bytes, sizeof bytes, &from)) >= 0;) {
        struct artnet_reply reply;
        if (!artnet_reply_read(bytes, (gsize)n, &reply))
            continue;
        for (guint i = 0; i < socket->listeners->len; i++) {
            const struct listener *listener = socket->listeners->pdata[i];
            if (listener->node == from)
                listener->func(&reply, listener->data);
        }
    }
}
