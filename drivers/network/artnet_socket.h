/*
 * The UDP socket of Art-Net. Nodes answer to port 6454 of the controller, so all nodes of this
 * process share one socket for each local address. Only the main thread may call the functions.
 */
#pragma once

#include "artnet_packet.h"

typedef struct ArtnetSocket ArtnetSocket;

/* Called with each reply of a node. Addresses are in host byte order. */
typedef void (*ArtnetFunc)(const struct artnet_reply *reply, gpointer data);

/* Returns the socket of a local address; 0.0.0.0 is any. The error is a DEVICE_ERROR without a
 * subject. Free it with artnet_socket_unref(). */
ArtnetSocket *artnet_socket_get(guint32 local_address, GError **error);
void artnet_socket_unref(ArtnetSocket *socket); /* NULL is ignored */

/* Makes the socket call func for each reply that comes from the address `node`. */
void artnet_socket_listen(ArtnetSocket *socket, guint32 node, ArtnetFunc func, gpointer data);
/* Removes all listeners with this data. */
void artnet_socket_unlisten(ArtnetSocket *socket, gpointer data);

/* Sends a packet to a node. A packet for which the system has no space is lost. */
gboolean artnet_socket_send(ArtnetSocket *socket, guint32 node, const guint8 *packet, gsize n,
                            GError **error);

/* Reads the packets that have arrived, and calls the listeners. The main loop also calls this
 * function. */
void artnet_socket_receive(ArtnetSocket *socket);
