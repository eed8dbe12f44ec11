/*
 * The rig on D-Bus and its clients in one process, via peer connections. The rig is the small
 * simulated rig with changes. Errors in these functions fail the test.
 */
#pragma once

#include "bus/bus.h"
#include "bus/bus_private.h"
#include "small_rig.h"

struct bus_peer {
    /* `session` is a path at which a test may make a session */
    char *folder, *address, *rig, *conf, *session;
    Bus *bus;
    BusServer *server;
    GDBusConnection *client;
    GString *told; /* events, one per line */
};

struct bus_peer *bus_peer_new(const struct change *changes); /* makes it without opening the rig */
struct bus_peer *bus_peer_open(const struct change *changes);
void bus_peer_free(struct bus_peer *peer);

/* Connects another client; g_object_unref(). */
GDBusConnection *bus_peer_join(struct bus_peer *peer);

/* Begins a call. Its result will be stored in *ret_result, which must be NULL. Consumes the
 * parameters. */
void bus_peer_begin(GDBusConnection *client, const char *method, GVariant *parameters,
                    GAsyncResult **ret_result);
/* Returns the answer of a call. On error returns NULL and sets error, without its remote name. The
 * remote name is stored in *ret_name (g_free()); ret_name may be NULL. Unrefs the result. */
GVariant *bus_peer_end(GDBusConnection *client, GAsyncResult **result, char **ret_name,
                       GError **error);

/* Makes a call that must succeed. */
void bus_peer_tell(struct bus_peer *peer, const char *method, GVariant *parameters);
/* Makes a call that must fail with the error “org.mesorig.Error.” + name and a message that
 * contains these words. */
void bus_peer_refused(struct bus_peer *peer, const char *method, GVariant *parameters,
                      const char *name, const char *words);
/* Checks the same for a call that was begun. */
void bus_peer_fails(GDBusConnection *client, GAsyncResult **result, const char *name,
                    const char *words);

/* Runs the main loop until holds(bus) is TRUE. Fails after a minute. */
void bus_peer_wait(struct bus_peer *peer, gboolean (*holds)(const Bus *bus));
