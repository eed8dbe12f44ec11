/*
 * The rig on D-Bus and its clients in one process, over peer connections: the small simulated rig
 * with changes. What goes wrong in here fails the test.
 */
#pragma once

#include "bus/bus.h"
#include "bus/bus_private.h"
#include "small_rig.h"

struct bus_peer {
    char *folder, *address, *rig, *conf, *session; /* of the last, the directory that may be made */
    Bus *bus;
    BusServer *server;
    GDBusConnection *client;
    GString *told; /* events, a line each */
};

struct bus_peer *bus_peer_new(const struct change *changes); /* no rig is open yet */
struct bus_peer *bus_peer_open(const struct change *changes);
void bus_peer_free(struct bus_peer *peer);

/* Another client; g_object_unref() */
GDBusConnection *bus_peer_join(struct bus_peer *peer);

/* Begins a call; its result is put into *ret_result, which must be NULL. Parameters are consumed.
 */
void bus_peer_begin(GDBusConnection *client, const char *method, GVariant *parameters,
                    GAsyncResult **ret_result);
/* What it answers, or NULL; then error is set, without its remote name, which is put into *ret_name
 * (may be NULL, g_free()). Unrefs the result. */
GVariant *bus_peer_end(GDBusConnection *client, GAsyncResult **result, char **ret_name,
                       GError **error);

/* A call that succeeds. */
void bus_peer_tell(struct bus_peer *peer, const char *method, GVariant *parameters);
/* A call that fails with this name (without org.mesorig.Error.) and says these words. */
void bus_peer_refused(struct bus_peer *peer, const char *method, GVariant *parameters,
                      const char *name, const char *words);
/* The same of a call that was begun. */
void bus_peer_fails(GDBusConnection *client, GAsyncResult **result, const char *name,
                    const char *words);

/* Runs the main loop until this holds of the bus; fails after a minute. */
void bus_peer_wait(struct bus_peer *peer, gboolean (*holds)(const Bus *bus));
