/*
 * The rig on D-Bus: org.mesorig.Rig1 (etc/org.mesorig.Rig1.xml) at /org/mesorig/Rig1, on any number
 * of connections at once. Holds the devices and the session being captured. Main loop's thread.
 */
#pragma once

#include <gio/gio.h>

#define BUS_NAME    "org.mesorig.Rig1"
#define BUS_PATH    "/org/mesorig/Rig1"
#define BUS_CONTROL "control" /* in a session directory: where its daemon listens */

/* The longest lease of a lamp or laser that is on by hand. */
#define BUS_MAX_LEASE_S 60

typedef struct Bus Bus;

/* Called when a value that the bus shows has changed, at most every 100 ms. */
typedef void (*BusFunc)(Bus *bus, gpointer data);

/* address: how clients reach it: "system", "session" or a D-Bus address; it is written to the file
 * "control" of the session directory while a session is captured. */
Bus *bus_new(const char *address);

/* Closes the session as it is (it can be resumed) and makes the rig safe. Returns TRUE if every
 * device has confirmed that it is safe. Runs the main loop. */
gboolean bus_end(Bus *bus, GError **error);

/* Makes the rig safe, closes the session (it can be resumed) and the devices, and removes the
 * object from every connection. NULL is ignored. */
void bus_free(Bus *bus);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Bus, bus_free)

void bus_listen(Bus *bus, BusFunc func, gpointer data);

/* Shows the rig on a connection, until that closes. */
gboolean bus_export(Bus *bus, GDBusConnection *connection, GError **error);

/* Does what the method OpenRig does. */
gboolean bus_open_rig(Bus *bus, const char *path, GError **error);

/* Keeps a queue of sessions in this file (queue/queue.h), and captures them while a rig is open.
 * Called once, before any client calls. If the file cannot be used, there is no queue: the log and
 * the answers to calls about the queue say so, and the rig serves all other calls. */
void bus_keep_queue(Bus *bus, const char *path);

gboolean bus_has_rig(const Bus *bus); /* one is open */

/* One line for people: "running, 12 % (120 of 1000 shots), 1 h 20 min left"; g_free(). */
char *bus_status(Bus *bus);

/* Called when the client that was the first to open a rig or to begin with a session has closed its
 * connection. Clients that only watch do not count. */
void bus_listen_client(Bus *bus, BusFunc gone, gpointer data);

/* A server for clients of the same user, which the kernel alone authenticates (EXTERNAL). address
 * is "unix:path=…"; a stale socket there is replaced. Every connection shows the rig. Commands of
 * the same user find the daemon (bus_client.h). Clients are refused that would
 * leave few descriptors for devices and files, and those of a process that has many connections. */
typedef struct BusServer BusServer;
BusServer *bus_serve(Bus *bus, const char *address, GError **error);

/* Ends the server. Call it before bus_free(): a client that connects at that moment is refused. */
void bus_unserve(Bus *bus, BusServer *server);
