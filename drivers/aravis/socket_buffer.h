/* The receive buffer of a UDP socket that a library keeps to itself. */
#pragma once

#include <glib.h>

/* Of this process's socket on a local UDP port; the kernel gives no more than net.core.rmem_max. */
void socket_buffer_set(guint16 port, int bytes);
