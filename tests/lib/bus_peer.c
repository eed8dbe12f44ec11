#include "bus_peer.h"

#include "bus/bus_client.h"
#include "lib/ok.h"
#include "process.h"
#include "remove_tree.h"

#define WAIT_US (60 * G_USEC_PER_SEC)

static void bus_peer_on_event(GDBusConnection *connection, const char *sender, const char *path,
                              const char *interface, const char *signal, GVariant *parameters,
                              gpointer data) {
    const char *level, *source, *message;
    g_variant_get(parameters, "(&s&s&s)", &level, &source, &message);
    g_string_append_printf(((struct bus_peer *)data)->told, "%s %s: %s\n", level, source, message);
}

GDBusConnection *bus_peer_join(struct bus_peer *peer) {
    GDBusConnection *client = ok(bus_client_connect(peer->address, ERR));
    return client;
}

struct bus_peer *bus_peer_new(const struct change *changes) {
    struct bus_peer *peer = g_new0(struct bus_peer, 1);
    peer->folder = ok(g_dir_make_tmp("mesorig-peer-XXXXXX", ERR));
    peer->address = g_strdup_printf("unix:path=%s/bus", peer->folder);
    peer->rig = g_build_filename(peer->folder, "rig.conf", NULL);
    peer->conf = g_build_filename(peer->folder, "session.conf", NULL);
    peer->session = g_build_filename(peer->folder, "small.session", NULL);
    peer->told = g_string_new(NULL);
    small_rig_write(peer->folder, "rig.conf", changes);
    small_rig_write(peer->folder, "world.conf", NULL);
    small_rig_write(peer->folder, "session.conf", changes);
    peer->bus = bus_new(peer->address);
    peer->server = ok(bus_serve(peer->bus, peer->address, ERR));
    peer->client = bus_peer_join(peer);
    g_dbus_connection_signal_subscribe(peer->client, NULL, BUS_NAME, "Event", NULL, NULL,
                                       G_DBUS_SIGNAL_FLAGS_NONE, bus_peer_on_event, peer, NULL);
    return peer;
}

struct bus_peer *bus_peer_open(const struct change *changes) {
    struct bus_peer *peer = bus_peer_new(changes);
    bus_peer_tell(peer, "OpenRig", g_variant_new("(s)", peer->rig));
    return peer;
}

void bus_peer_free(struct bus_peer *peer) {
    g_clear_object(&peer->client);
    bus_unserve(peer->bus, peer->server);
    bus_free(peer->bus);
    while (g_main_context_iteration(NULL, FALSE))
        ;
    remove_tree(peer->folder);
    g_free(peer->folder);
    g_free(peer->address);
    g_free(peer->rig);
    g_free(peer->conf);
    g_free(peer->session);
    g_string_free(peer->told, TRUE);
    g_free(peer);
}

static void bus_peer_take(GObject *source, GAsyncResult *result, gpointer data) {
    *(GAsyncResult **)data = g_object_ref(result);
}

void bus_peer_begin(GDBusConnection *client, const char *method, GVariant *parameters,
                    GAsyncResult **ret_result) {
    g_assert_null(*ret_result);
    g_dbus_connection_call(client, NULL, BUS_PATH, BUS_NAME, method, parameters, NULL,
                           G_DBUS_CALL_FLAGS_NONE, 60000, NULL, bus_peer_take, ret_result);
}

GVariant *bus_peer_end(GDBusConnection *client, GAsyncResult **result, char **ret_name,
                       GError **error) {
    g_autoptr(GError) own = NULL;
    while (!*result)
        g_main_context_iteration(NULL, TRUE);
    GVariant *answer = g_dbus_connection_call_finish(client, *result, &own);
    g_clear_object(result);
    if (ret_name)
        *ret_name = own ? g_dbus_error_get_remote_error(own) : NULL;
    if (own) {
        g_dbus_error_strip_remote_error(own);
        g_propagate_error(error, g_steal_pointer(&own));
    }
    return answer;
}

void bus_peer_tell(struct bus_peer *peer, const char *method, GVariant *parameters) {
    GAsyncResult *result = NULL;
    g_autoptr(GError) error = NULL;
    bus_peer_begin(peer->client, method, parameters, &result);
    g_autoptr(GVariant) answer = bus_peer_end(peer->client, &result, NULL, &error);
    g_assert_no_error(error);
}

void bus_peer_fails(GDBusConnection *client, GAsyncResult **result, const char *name,
                    const char *words) {
    g_autoptr(GError) error = NULL;
    g_autofree char *is = NULL, *full = g_strconcat("org.mesorig.Error.", name, NULL);
    g_autoptr(GVariant) answer = bus_peer_end(client, result, &is, &error);
    if (answer)
        g_error("it succeeds, and should fail with %s: %s", name, words);
    g_assert_cmpstr(is, ==, full);
    assert_has(error->message, words);
}

void bus_peer_refused(struct bus_peer *peer, const char *method, GVariant *parameters,
                      const char *name, const char *words) {
    GAsyncResult *result = NULL;
    bus_peer_begin(peer->client, method, parameters, &result);
    bus_peer_fails(peer->client, &result, name, words);
}

void bus_peer_wait(struct bus_peer *peer, gboolean (*holds)(const Bus *bus)) {
    const gint64 until = g_get_monotonic_time() + WAIT_US;
    while (!holds(peer->bus)) {
        if (g_get_monotonic_time() > until)
            g_error("nothing more happens; told so far:\n%s", peer->told->str);
        if (!g_main_context_iteration(NULL, FALSE))
            g_usleep(1000);
    }
}
