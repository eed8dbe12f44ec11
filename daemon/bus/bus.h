/*
 * The rig on D-Bus: the object /org/mesorig/Rig1 with the interface org.mesorig.Rig1
 * (etc/org.mesorig.Rig1.xml), on any number of connections. The Bus owns the devices and the
 * session that is being captured. All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_names.h"

#include <gio/gio.h>

typedef struct Bus Bus;

/* Called when a value that the bus shows has changed. During a capture, this is at most about every
 * 100 ms. */
typedef void (*BusFunc)(Bus *bus, gpointer data);

/* Makes a bus. address is the address by which clients reach it: "system", "session" or a D-Bus
 * address. While a session is captured, address is written to the file "control" of the session
 * directory. */
Bus *bus_new(const char *address);

/* Ends all operations, closes the session in its present state, so that it can be resumed, and
 * makes the rig safe. Returns TRUE if no rig is open, or if every device has confirmed that it is
 * safe. Otherwise returns FALSE with an error. Runs the main loop while it waits. */
gboolean bus_end(Bus *bus, GError **error);

/* Makes the rig safe, closes the session (it can be resumed) and the devices, and removes the
 * object from every connection. NULL is ignored. If a device does not confirm that it is safe, the
 * devices stay open, and the guardian continues to make the rig safe. */
void bus_free(Bus *bus);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Bus, bus_free)

/* Sets the function that is called for changes, in place of an earlier one. NULL means none. */
void bus_listen(Bus *bus, BusFunc func, gpointer data);

/* Shows the rig on a connection until the connection closes. */
gboolean bus_export(Bus *bus, GDBusConnection *connection, GError **error);

/* Does the same as the method OpenRig. path must be absolute. Fails with BUS_ERROR_BUSY if a rig is
 * open. */
gboolean bus_open_rig(Bus *bus, const char *path, GError **error);

/* Keeps a queue of sessions in the file at path (queue.h), and captures the sessions while a rig is
 * open. Call it at most once, before any client calls. If the file cannot be locked, there is no
 * queue: the log and the answers to calls about the queue say so, and all other calls work. */
void bus_keep_queue(Bus *bus, const char *path);

gboolean bus_has_rig(const Bus *bus); /* whether a rig is open */

/* Returns the state in one line for users, such as "running, 12 % (120 of 1000 shots), 1 h 20 min
 * left". If the capture has stopped for a reason, the line has the reason instead of the time left.
 * Without a session, the line has only the state, such as "idle". Free it with g_free(). */
char *bus_status(Bus *bus);

/* Sets a function that is called when the main client has closed its connection. The main client is
 * the client that has most recently become responsible: the first one to call OpenRig, Start or
 * Resume after the last main client left. A client on a message bus has left when its connection to
 * the bus is closed. */
void bus_listen_client(Bus *bus, BusFunc gone, gpointer data);

/* Starts a server for clients of the same user. The kernel tells the server the user of each client
 * (D-Bus authentication EXTERNAL). The rig is shown on every connection. Commands of the same user
 * find the daemon in the folder that bus_client.h describes. A client is refused if too few
 * descriptors would be left for devices and files, or if its process has too many connections.
 *
 * address is "unix:path=…", without a comma, semicolon or percent sign. If there is a socket at the
 * path at which no process listens, it is replaced. Returns NULL with an error if:
 * - the address has another form,
 * - another kind of file is at the path,
 * - a process listens there,
 * - the socket cannot be made. */
typedef struct BusServer BusServer;
BusServer *bus_serve(Bus *bus, const char *address, GError **error);

/* Ends the server. Call it before bus_free(). A client that connects at that moment is refused. */
void bus_unserve(Bus *bus, BusServer *server);
