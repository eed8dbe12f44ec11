/* The receive buffer of a UDP socket that a library opened and does not expose. */
#pragma once

#include <glib.h>

/* Sets the receive buffer of this process's socket on a local UDP port. The kernel grants at most
 * net.core.rmem_max. Does nothing if this process has no such socket. */
void socket_buffer_set(guint16 port, int bytes);
