/* The receive buffer of a UDP socket that a library keeps to itself. */
#pragma once

#include <glib.h>

/* Of this process's socket on a local UDP port. Returns the bytes of payload that it holds now, or
 * −1 if there is no such socket; the kernel gives no more than net.core.rmem_max. */
int socket_buffer_set(guint16 port, int bytes);
