#include "artnet_socket.h"

#include "drivers/device.h"
#include "drivers/recording.h"
#include "udp.h"

#include <gio/gio.h>
#include <glib-unix.h>
#include <unistd.h>

struct listener {
    guint32 node;
    ArtnetFunc func;
    gpointer data;
};

/* Nodes before Art-Net 4 and the daemon olad broadcast their answers. A socket with a local address
 * does not get broadcasts, so two more sockets have the broadcast addresses. */
enum { OWN, BROADCAST, BROADCAST_ALL, N_SOCKETS };

struct ArtnetSocket {
    int n_refs;
    guint32 local_address;
    int fds[N_SOCKETS]; /* -1 if it is not needed */
    guint sources[N_SOCKETS];
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
    const guint32 broadcast = local_address ? udp_broadcast(local_address) : 0;
    ArtnetSocket *socket = g_new0(ArtnetSocket, 1);
    *socket = (ArtnetSocket){.n_refs = 1,
                             .local_address = local_address,
                             .fds = {fd, broadcast ? udp_open(broadcast, ARTNET_PORT, NULL) : -1,
                                     broadcast ? udp_open(G_MAXUINT32, ARTNET_PORT, NULL) : -1},
                             .listeners = g_ptr_array_new_with_free_func(g_free)};
    for (int i = 0; i < N_SOCKETS; i++)
        if (socket->fds[i] >= 0)
            socket->sources[i] = g_unix_fd_add(socket->fds[i], G_IO_IN, on_input, socket);
    sockets = g_slist_prepend(sockets, socket);
    return socket;
}

void artnet_socket_unref(ArtnetSocket *socket) {
    if (!socket || --socket->n_refs > 0)
        return;
    sockets = g_slist_remove(sockets, socket);
    for (int i = 0; i < N_SOCKETS; i++)
        if (socket->fds[i] >= 0) {
            g_source_remove(socket->sources[i]);
            close(socket->fds[i]);
        }
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
    const int why = udp_send(socket->fds[OWN], node, ARTNET_PORT, packet, n);
    g_autofree char *name = udp_name(node);
    return why == 0 || device_error_set(error, DEVICE_ERROR_DISCONNECTED, NULL,
                                        "cannot send to the Art-Net node %s: %s" ERROR_ADVICE
                                        "check address, and the network of this computer",
                                        name, g_strerror(why));
}

/* Hides the addresses of a node from a recording. */
static void hide_addresses(const guint8 *reply, gsize n) {
    recording_hide_bytes(reply + ARTNET_REPLY_IP, 4);
    if (n >= ARTNET_REPLY_MAC + 6)
        recording_hide_bytes(reply + ARTNET_REPLY_MAC, 6);
}

static void receive(ArtnetSocket *socket, int fd) {
    guint8 bytes[1500];
    guint32 from;
    for (gssize n; (n = udp_receive(fd, bytes, sizeof bytes, &from)) >= 0;) {
        struct artnet_reply reply;
        if (!artnet_reply_read(bytes, (gsize)n, &reply))
            continue;
        hide_addresses(bytes, (gsize)n);
        for (guint i = 0; i < socket->listeners->len; i++) {
            const struct listener *listener = socket->listeners->pdata[i];
            if (listener->node == from)
                listener->func(&reply, listener->data);
        }
    }
}

void artnet_socket_receive(ArtnetSocket *socket) {
    for (int i = 0; i < N_SOCKETS; i++)
        if (socket->fds[i] >= 0)
            receive(socket, socket->fds[i]);
}
