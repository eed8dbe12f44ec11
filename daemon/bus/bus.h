/*
 * The rig on D-Bus: the interface org.mesorig.Rig1 (etc/org.mesorig.Rig1.xml) at /org/mesorig/Rig1,
 * on any number of connections. The Bus holds the devices and the session that is being captured.
 * All functions belong to the main loop's thread.
 */
#pragma once

#include "bus_names.h"

#include <gio/gio.h>

typedef struct Bus Bus;

/* Called when a value that the bus shows has changed; during a capture about every 100 ms at
 * most. */
typedef void (*BusFunc)(Bus *bus, gpointer data);

/* Makes a bus. address is the address by which clients reach it: "system", "session" or a D-Bus
 * address. While a session is captured, address is written to the file "control" of the session
 * directory. */
Bus *bus_new(const char *address);

/* Ends all operations, closes the session in its present state, so that it can be resumed, and
 * makes the rig safe. Returns TRUE if every device has confirmed that it is safe, or if no rig is
 * open. Runs the main loop. */
gboolean bus_end(Bus *bus, GError **error);

/* Makes the rig safe, closes the session (it can be resumed) and the devices, and removes the
 * object from every connection. If a device does not confirm that it is safe, the devices stay
 * open, and the guardian continues to make the rig safe. NULL is ignored. */
void bus_free(Bus *bus);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Bus, bus_free)

/* Sets the function that is called for changes. It replaces an earlier function. NULL means none.
 */
void bus_listen(Bus *bus, BusFunc func, gpointer data);

/* Shows the rig on a connection until the connection closes. */
gboolean bus_export(Bus *bus, GDBusConnection *connection, GError **error);

/* Does the same as the method OpenRig. path must be absolute. Fails with BUS_ERROR_BUSY if a rig is
 * open. */
gboolean bus_open_rig(Bus *bus, const char *path, GError **error);

/* Keeps a queue of sessions in this file (queue.h), and captures the sessions while a rig is open.
 * Call it at most once, before any client calls. If the file cannot be locked, there is no queue.
 * The log and the answers to calls about the queue then say so, and the rig serves all other
 * calls. */
void bus_keep_queue(Bus *bus, const char *path);

gboolean bus_has_rig(const Bus *bus); /* whether a rig is open */

/* Returns one line for users: "running, 12 % (120 of 1000 shots), 1 h 20 min left". If the
 * capture has stopped for a reason, the reason replaces the time left. Without a session, the
 * line is only the state, for instance "idle". Free it with g_free(). */
char *bus_status(Bus *bus);

/* Sets a function that is called when the main client has closed its connection. The main client
 * is the first client that called OpenRig, Start or Resume since the last main client closed its
 * connection. On a message bus, the connection is the one to the bus. */
void bus_listen_client(Bus *bus, BusFunc gone, gpointer data);

/* Starts a server for clients of the same user. The kernel tells the server the user of each
 * client (D-Bus authentication EXTERNAL). address is "unix:path=…"; a socket at that path at
 * which no process listens is replaced. Returns NULL with an error if the address has another
 * form or contains a comma, semicolon or percent sign, if another kind of file is at the path,
 * if a process listens there, or if the socket cannot be made. The rig is shown on every
 * connection. Commands of the same user find the daemon in the folder that bus_client.h
 * describes. A client is refused if too few descriptors would be left for devices and files, or
 * if its process has too many connections. */
typedef struct BusServer BusServer;
BusServer *bus_serve(Bus *bus, const char *address, GError **error);

/* Ends the server. Call it before bus_free(). A client that connects at that moment is refused. */
void bus_unserve(Bus *bus, BusServer *server);
