/* UDP over IPv4. Addresses are in host byte order. Only the main thread may call the functions. */
#pragma once

#include <glib.h>

/* Opens a socket that does not block, with this local address and port (0: any). Other programs may
 * use the same port. Returns the descriptor, to be closed with close(). On failure returns -1 with
 * a DEVICE_ERROR without a subject. */
int udp_open(guint32 local_address, guint16 port, GError **error);

/* Sends a packet. Returns 0, or errno on failure. If the system has no space for the packet, the
 * packet is not sent, and the result is EAGAIN or ENOBUFS. */
int udp_send(int fd, guint32 address, guint16 port, const guint8 *packet, gsize n);

/* Receives a packet. Returns its length, or -1 if there is none. *ret_address is the address of the
 * sender. */
gssize udp_receive(int fd, guint8 *ret, gsize size, guint32 *ret_address);

/* Returns the broadcast address of the network in which this computer has the address
 * local_address. Returns 0 if there is no such network. */
guint32 udp_broadcast(guint32 local_address);

/* Returns an address as text, such as 10.0.0.7. Free it with g_free(). */
char *udp_name(guint32 address);
