#include "file_portal.h"
#include "lib/ok.h"

#include <gio/gio.h>

#define NAME "org.freedesktop.portal.Desktop"
#define PATH "/org/freedesktop/portal/desktop"

static const char interfaces[] =
    "<node><interface name='org.freedesktop.portal.FileChooser'>"
    "<method name='OpenFile'><arg type='s' direction='in'/><arg type='s' direction='in'/>"
    "<arg type='a{sv}' direction='in'/><arg type='o' direction='out'/></method>"
    "<method name='SaveFile'><arg type='s' direction='in'/><arg type='s' direction='in'/>"
    "<arg type='a{sv}' direction='in'/><arg type='o' direction='out'/></method>"
    "</interface><interface name='org.freedesktop.Notifications'>"
    "<method name='Notify'><arg type='s' direction='in'/><arg type='u' direction='in'/>"
    "<arg type='s' direction='in'/><arg type='s' direction='in'/><arg type='s' direction='in'/>"
    "<arg type='as' direction='in'/><arg type='a{sv}' direction='in'/>"
    "<arg type='i' direction='in'/><arg type='u' direction='out'/></method>"
    "</interface></node>";

struct FilePortal {
    GTestDBus *bus;
    GThread *thread;
    GMainContext *context;
    GMainLoop *loop;
    GDBusConnection *connection;
    GMutex lock;
    GCond changed;
    gboolean ready;
    char *path, *last;
    int n;
};

/* Takes ownership of what. */
static void portal_note(FilePortal *portal, char *what) {
    g_free(portal->last);
    portal->last = what;
    portal->n++;
    g_cond_broadcast(&portal->changed);
}

static void on_notice(GDBusConnection *connection, const char *sender, const char *object,
                      const char *interface, const char *method, GVariant *parameters,
                      GDBusMethodInvocation *invocation, gpointer data) {
    FilePortal *portal = data;
    const char *sentence = NULL;
    g_variant_get_child(parameters, 4, "&s", &sentence);
    g_mutex_lock(&portal->lock);
    portal_note(portal, g_strjoin(" ", method, sentence, NULL));
    g_mutex_unlock(&portal->lock);
    g_dbus_method_invocation_return_value(invocation, g_variant_new("(u)", 1U));
}

static void on_call(GDBusConnection *connection, const char *sender, const char *object,
                    const char *interface, const char *method, GVariant *parameters,
                    GDBusMethodInvocation *invocation, gpointer data) {
    FilePortal *portal = data;
    g_autoptr(GVariant) options = g_variant_get_child_value(parameters, 2);
    const char *token = NULL, *name = NULL;
    gboolean directory = FALSE;
    g_assert_true(g_variant_lookup(options, "handle_token", "&s", &token));
    g_variant_lookup(options, "current_name", "&s", &name);
    g_variant_lookup(options, "directory", "b", &directory);
    g_autofree char *caller = g_strdelimit(g_strdup(sender + 1), ".", '_');
    g_autofree char *request = g_strdup_printf(PATH "/request/%s/%s", caller, token);
    g_dbus_method_invocation_return_value(invocation, g_variant_new("(o)", request));
    GVariantBuilder results;
    g_variant_builder_init(&results, G_VARIANT_TYPE_VARDICT);
    g_mutex_lock(&portal->lock);
    if (portal->path != NULL) {
        g_autofree char *uri = g_filename_to_uri(portal->path, NULL, NULL);
        const char *const uris[] = {uri, NULL};
        g_variant_builder_add(&results, "{sv}", "uris", g_variant_new_strv(uris, -1));
    }
    g_dbus_connection_emit_signal(
        connection, sender, request, "org.freedesktop.portal.Request", "Response",
        g_variant_new("(ua{sv})", portal->path != NULL ? 0U : 1U, &results), NULL);
    portal_note(portal, g_strjoin(" ", method, directory ? "directory" : name, NULL));
    g_mutex_unlock(&portal->lock);
}

static void own_name(GDBusConnection *connection, const char *name) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) owned = g_dbus_connection_call_sync(
        connection, "org.freedesktop.DBus", "/org/freedesktop/DBus", "org.freedesktop.DBus",
        "RequestName", g_variant_new("(su)", name, 0), NULL, G_DBUS_CALL_FLAGS_NONE, -1, NULL,
        &error);
    g_assert_no_error(error);
}

static gpointer serve(gpointer data) {
    static const GDBusInterfaceVTable table = {on_call, NULL, NULL, {NULL}};
    static const GDBusInterfaceVTable notices = {on_notice, NULL, NULL, {NULL}};
    FilePortal *portal = data;
    g_main_context_push_thread_default(portal->context);
    portal->connection = ok(
        g_dbus_connection_new_for_address_sync(g_test_dbus_get_bus_address(portal->bus),
                                               G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT |
                                                   G_DBUS_CONNECTION_FLAGS_MESSAGE_BUS_CONNECTION,
                                               NULL, NULL, ERR));
    GDBusNodeInfo *node = ok(g_dbus_node_info_new_for_xml(interfaces, ERR));
    ok(g_dbus_connection_register_object(portal->connection, PATH, node->interfaces[0], &table,
                                         portal, NULL, ERR));
    ok(g_dbus_connection_register_object(portal->connection, "/org/freedesktop/Notifications",
                                         node->interfaces[1], &notices, portal, NULL, ERR));
    own_name(portal->connection, NAME);
    own_name(portal->connection, "org.freedesktop.Notifications");
    g_mutex_lock(&portal->lock);
    portal->ready = TRUE;
    g_cond_broadcast(&portal->changed);
    g_mutex_unlock(&portal->lock);
    g_main_loop_run(portal->loop);
    g_dbus_connection_close_sync(portal->connection, NULL, NULL);
    g_object_unref(portal->connection);
    g_dbus_node_info_unref(node);
    g_main_context_pop_thread_default(portal->context);
    return NULL;
}

FilePortal *file_portal_new(void) {
    FilePortal *portal = g_new0(FilePortal, 1);
    portal->bus = g_test_dbus_new(G_TEST_DBUS_NONE);
    g_test_dbus_up(portal->bus);
    portal->context = g_main_context_new();
    portal->loop = g_main_loop_new(portal->context, FALSE);
    g_mutex_init(&portal->lock);
    g_cond_init(&portal->changed);
    portal->thread = g_thread_new("portal", serve, portal);
    g_mutex_lock(&portal->lock);
    while (!portal->ready)
        g_cond_wait(&portal->changed, &portal->lock);
    g_mutex_unlock(&portal->lock);
    return portal;
}

void file_portal_free(FilePortal *portal) {
    g_main_loop_quit(portal->loop);
    g_thread_join(portal->thread);
    g_test_dbus_down(portal->bus);
    g_object_unref(portal->bus);
    g_main_loop_unref(portal->loop);
    g_main_context_unref(portal->context);
    g_mutex_clear(&portal->lock);
    g_cond_clear(&portal->changed);
    g_free(portal->path);
    g_free(portal->last);
    g_free(portal);
}

const char *file_portal_bus(const FilePortal *portal) {
    return g_test_dbus_get_bus_address(portal->bus);
}

void file_portal_answer(FilePortal *portal, const char *path) {
    g_mutex_lock(&portal->lock);
    g_free(portal->path);
    portal->path = g_strdup(path);
    g_mutex_unlock(&portal->lock);
}

char *file_portal_wait(FilePortal *portal, int n) {
    const gint64 until = g_get_monotonic_time() + 60 * G_USEC_PER_SEC;
    g_mutex_lock(&portal->lock);
    while (portal->n < n && g_cond_wait_until(&portal->changed, &portal->lock, until))
        ;
    g_assert_cmpint(portal->n, ==, n);
    char *last = g_strdup(portal->last);
    g_mutex_unlock(&portal->lock);
    return last;
}
