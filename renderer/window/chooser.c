#include "chooser.h"

#include "session_bus.h"

#include <gio/gio.h>

#define PORTAL      "org.freedesktop.portal.Desktop"
#define PORTAL_PATH "/org/freedesktop/portal/desktop"
#define REQUEST     "org.freedesktop.portal.Request"
#define ANSWER_MS   5000 /* how long the portal may take to answer that it opens a dialog */

struct Chooser {
    GDBusConnection *bus;
    /* cancels the calls that have not returned; NULL if no dialog was requested */
    GCancellable *cancel;
    int under_way; /* number of calls whose callback has not run yet */
    char *request; /* object path of the open dialog; NULL if there is none */
    /* id of the subscription to the dialog's signal Response; 0 if there is none */
    guint subscription;
    int n_asked; /* number of dialogs requested so far */
    enum chooser_what what;
    char *folder, *name;
    enum chooser_state state; /* next result of chooser_poll() */
    char *path;               /* the chosen file, until chooser_poll() returns it; otherwise NULL */
};

Chooser *chooser_new(void) {
    return g_new0(Chooser, 1);
}

static void end(Chooser *chooser, enum chooser_state state) {
    if (chooser->subscription != 0)
        g_dbus_connection_signal_unsubscribe(chooser->bus, chooser->subscription);
    chooser->subscription = 0;
    g_clear_object(&chooser->cancel);
    g_clear_pointer(&chooser->request, g_free);
    chooser->state = state;
}

/* Handles the signal Response (u response, a{sv} results). response is 0 if a file was chosen, 1 if
 * the user cancelled the dialog, and 2 if the dialog ended in another way. */
static void on_response(GDBusConnection *bus, const char *sender, const char *object,
                        const char *interface, const char *signal, GVariant *parameters,
                        gpointer data) {
    Chooser *chooser = data;
    guint32 response;
    g_autoptr(GVariant) results = NULL;
    g_autofree const char **uris = NULL;
    if (!g_variant_is_of_type(parameters, G_VARIANT_TYPE("(ua{sv})")))
        return;
    g_variant_get(parameters, "(u@a{sv})", &response, &results);
    g_variant_lookup(results, "uris", "^a&s", &uris);
    g_free(chooser->path);
    chooser->path = response == 0 && uris != NULL && uris[0] != NULL
                        ? g_filename_from_uri(uris[0], NULL, NULL)
                        : NULL;
    end(chooser, chooser->path != NULL ? CHOOSER_CHOSEN : CHOOSER_CANCELLED);
}

static void chooser_listen(Chooser *chooser, const char *request) {
    if (chooser->subscription != 0)
        g_dbus_connection_signal_unsubscribe(chooser->bus, chooser->subscription);
    chooser->subscription =
        g_dbus_connection_signal_subscribe(chooser->bus, PORTAL, REQUEST, "Response", request, NULL,
                                           G_DBUS_SIGNAL_FLAGS_NONE, on_response, chooser, NULL);
    g_free(chooser->request);
    chooser->request = g_strdup(request);
}

static gboolean was_cancelled(const GError *error) {
    return g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
}

static void on_opened(GObject *source, GAsyncResult *result, gpointer data) {
    Chooser *chooser = data;
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) reply =
        g_dbus_connection_call_finish(G_DBUS_CONNECTION(source), result, &error);
    chooser->under_way--;
    if (reply == NULL && !was_cancelled(error)) {
        g_debug("the portal does not open a dialog: %s", error->message);
        end(chooser, CHOOSER_UNAVAILABLE);
    } else if (reply != NULL && chooser->cancel != NULL) {
        const char *request;
        g_variant_get(reply, "(&o)", &request);
        if (g_strcmp0(request, chooser->request) != 0) /* a portal older than version 0.9 */
            chooser_listen(chooser, request);
    }
}

/* Returns the filters of the dialog as a(sa(us)): one for files that can be opened, and one for all
 * files. In (us), the number 0 says that the text is a pattern of file names. */
static GVariant *chooser_filters(void) {
    static const char *const patterns[] = {"session.db", "*.exr", "*.obj",
                                           "*.gltf",     "*.glb", "*.png"};
    GVariantBuilder filters, ours;
    g_variant_builder_init(&filters, G_VARIANT_TYPE("a(sa(us))"));
    g_variant_builder_init(&ours, G_VARIANT_TYPE("a(us)"));
    for (gsize k = 0; k < G_N_ELEMENTS(patterns); k++)
        g_variant_builder_add(&ours, "(us)", 0, patterns[k]);
    g_variant_builder_add(&filters, "(sa(us))", "Sessions, materials, shapes and environments",
                          &ours);
    g_variant_builder_init(&ours, G_VARIANT_TYPE("a(us)"));
    g_variant_builder_add(&ours, "(us)", 0, "*");
    g_variant_builder_add(&filters, "(sa(us))", "All files", &ours);
    return g_variant_builder_end(&filters);
}

static void call(Chooser *chooser) {
    static const char *const titles[] = {"Open a material, a shape or an environment",
                                         "Open a session", "Save the picture"};
    g_autofree char *token = g_strdup_printf("mesorig%d", ++chooser->n_asked);
    g_autofree char *sender = g_strdup(g_dbus_connection_get_unique_name(chooser->bus) + 1);
    g_autofree char *request =
        g_strdup_printf(PORTAL_PATH "/request/%s/%s", g_strdelimit(sender, ".", '_'), token);
    GVariantBuilder options;
    g_variant_builder_init(&options, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&options, "{sv}", "handle_token", g_variant_new_string(token));
    g_variant_builder_add(&options, "{sv}", "current_folder",
                          g_variant_new_bytestring(chooser->folder));
    if (chooser->what == CHOOSER_SAVE)
        g_variant_builder_add(&options, "{sv}", "current_name",
                              g_variant_new_string(chooser->name));
    else if (chooser->what == CHOOSER_FOLDER)
        g_variant_builder_add(&options, "{sv}", "directory", g_variant_new_boolean(TRUE));
    else
        g_variant_builder_add(&options, "{sv}", "filters", chooser_filters());
    chooser_listen(chooser, request);
    chooser->under_way++;
    g_dbus_connection_call(chooser->bus, PORTAL, PORTAL_PATH, "org.freedesktop.portal.FileChooser",
                           chooser->what == CHOOSER_SAVE ? "SaveFile" : "OpenFile",
                           g_variant_new("(ssa{sv})", "", titles[chooser->what], &options),
                           G_VARIANT_TYPE("(o)"), G_DBUS_CALL_FLAGS_NONE, ANSWER_MS,
                           chooser->cancel, on_opened, chooser);
}

static void on_bus(GObject *source, GAsyncResult *result, gpointer data) {
    Chooser *chooser = data;
    g_autoptr(GError) error = NULL;
    GDBusConnection *bus = g_bus_get_finish(result, &error);
    chooser->under_way--;
    if (bus == NULL) {
        if (!was_cancelled(error))
            end(chooser, CHOOSER_UNAVAILABLE);
        return;
    }
    g_clear_object(&chooser->bus);
    chooser->bus = bus;
    g_dbus_connection_set_exit_on_close(bus, FALSE);
    if (chooser->cancel != NULL && chooser->request == NULL)
        call(chooser);
}

void chooser_ask(Chooser *chooser, enum chooser_what what, const char *folder, const char *name) {
    chooser_close(chooser);
    g_free(chooser->folder);
    g_free(chooser->name);
    chooser->what = what;
    chooser->folder = g_strdup(folder);
    chooser->name = g_strdup(name != NULL ? name : "");
    chooser->state = CHOOSER_IDLE;
    if (!session_bus_is_there()) {
        chooser->state = CHOOSER_UNAVAILABLE;
        return;
    }
    chooser->cancel = g_cancellable_new();
    if (chooser->bus != NULL) {
        call(chooser);
        return;
    }
    chooser->under_way++;
    g_bus_get(G_BUS_TYPE_SESSION, chooser->cancel, on_bus, chooser);
}

void chooser_close(Chooser *chooser) {
    if (chooser->cancel == NULL)
        return;
    g_cancellable_cancel(chooser->cancel);
    if (chooser->request != NULL)
        g_dbus_connection_call(chooser->bus, PORTAL, chooser->request, REQUEST, "Close", NULL, NULL,
                               G_DBUS_CALL_FLAGS_NO_AUTO_START, ANSWER_MS, NULL, NULL, NULL);
    end(chooser, CHOOSER_IDLE);
}

gboolean chooser_is_open(const Chooser *chooser) {
    return chooser->cancel != NULL;
}

enum chooser_state chooser_poll(Chooser *chooser, char **ret_path) {
    while (g_main_context_iteration(NULL, FALSE))
        ;
    const enum chooser_state state = chooser->state;
    chooser->state = CHOOSER_IDLE;
    *ret_path = state == CHOOSER_CHOSEN ? g_steal_pointer(&chooser->path) : NULL;
    return state;
}

void chooser_free(Chooser *chooser) {
    if (chooser == NULL)
        return;
    const gboolean was_open = chooser->request != NULL;
    chooser_close(chooser);
    if (was_open) /* send Close before the program ends */
        g_dbus_connection_flush_sync(chooser->bus, NULL, NULL);
    while (chooser->under_way > 0) /* callbacks of cancelled calls come immediately */
        g_main_context_iteration(NULL, TRUE);
    g_clear_object(&chooser->bus);
    g_free(chooser->folder);
    g_free(chooser->name);
    g_free(chooser->path);
    g_free(chooser);
}
