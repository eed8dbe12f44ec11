/* mesorig-hooks: tells others what happens to captures. A process of its own, which hears what the
 * daemon says to all and may ask it nothing. */
#include "base/nearest.h"
#include "hooks.h"

#include <glib-unix.h>
#include <locale.h>
#include <signal.h>
#include <string.h>
#include <systemd/sd-daemon.h>

#include "bus/bus.h"

static char *address, *bus, *conf_path;
static gboolean desktop, check, version;

static const GOptionEntry entries[] = {
    {"config", 0, 0, G_OPTION_ARG_FILENAME, &conf_path,
     "Read this file, not " HOOKS_CONF ", which need not exist", "FILE"},
    {"check", 0, 0, G_OPTION_ARG_NONE, &check,
     "Tell of an event that is made up, wait until all is done, and end", NULL},
    {"desktop", 0, 0, G_OPTION_ARG_NONE, &desktop,
     "Show notifications on this user's desktop, and do nothing else", NULL},
    {"bus", 0, 0, G_OPTION_ARG_STRING, &bus, "The daemon's bus: system or session (system)", "BUS"},
    {"address", 0, 0, G_OPTION_ARG_STRING, &address, "A daemon's own socket, in place of a bus",
     "unix:path=…"},
    {"version", 0, 0, G_OPTION_ARG_NONE, &version, "Print the version", NULL},
    {NULL},
};

struct program {
    GMainLoop *loop;
    Hooks *hooks;            /* NULL: the desktop alone */
    GDBusConnection *screen; /* the session bus, for the desktop */
    int exit_code;
};

static gboolean on_signal(gpointer data) {
    struct program *program = data;
    g_main_loop_quit(program->loop);
    return G_SOURCE_CONTINUE;
}

static void on_closed(GDBusConnection *connection, gboolean by_peer, GError *error, gpointer data) {
    struct program *program = data;
    g_printerr("mesorig-hooks: the connection to the daemon has ended\n");
    program->exit_code = 1;
    g_main_loop_quit(program->loop);
}

static void program_tell(struct program *program, const char *what, GVariant *details) {
    if (program->hooks)
        hooks_tell(program->hooks, what, details);
    else if (strcmp(what, "begun") != 0)
        hooks_show(program->screen, what, details);
}

static void on_milestone(GDBusConnection *connection, const char *sender, const char *path,
                         const char *interface, const char *signal, GVariant *parameters,
                         gpointer data) {
    const char *what;
    g_autoptr(GVariant) details = NULL;
    if (!g_variant_is_of_type(parameters, G_VARIANT_TYPE("(sa{sv})")))
        return;
    g_variant_get(parameters, "(&s@a{sv})", &what, &details);
    program_tell(data, what, details);
}

static GDBusConnection *connect_to_daemon(GError **error) {
    const GBusType type = g_strcmp0(bus, "session") == 0 ? G_BUS_TYPE_SESSION : G_BUS_TYPE_SYSTEM;
    return address ? g_dbus_connection_new_for_address_sync(
                         address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, error)
                   : g_bus_get_sync(type, NULL, error);
}

static void listen_to(struct program *program, GDBusConnection *connection) {
    g_dbus_connection_set_exit_on_close(connection, FALSE);
    g_signal_connect(connection, "closed", G_CALLBACK(on_closed), program);
    g_dbus_connection_signal_subscribe(connection, address ? NULL : BUS_NAME, BUS_NAME, "Milestone",
                                       BUS_PATH, NULL, G_DBUS_SIGNAL_FLAGS_NONE, on_milestone,
                                       program, NULL);
    g_unix_signal_add(SIGINT, on_signal, program);
    g_unix_signal_add(SIGTERM, on_signal, program);
    sd_notify(0, "READY=1");
    g_main_loop_run(program->loop);
    g_signal_handlers_disconnect_by_data(connection, program);
}

static void tell_made_up(struct program *program) {
    GVariantBuilder details;
    g_variant_builder_init(&details, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&details, "{sv}", "name", g_variant_new_string("check"));
    g_variant_builder_add(&details, "{sv}", "session", g_variant_new_string(""));
    g_variant_builder_add(
        &details, "{sv}", "message",
        g_variant_new_string("mesorig-hooks --check: nothing has happened to the rig"));
    program_tell(program, "queue-empty", g_variant_builder_end(&details));
    while (program->hooks && !hooks_is_idle(program->hooks))
        g_main_context_iteration(NULL, TRUE);
    if (program->screen)
        g_dbus_connection_flush_sync(program->screen, NULL, NULL);
}

/* An exit code. */
static int run(const struct hooks_conf *conf, GError **error) {
    struct program program = {.loop = g_main_loop_new(NULL, FALSE)};
    g_autoptr(GDBusConnection) connection = NULL;
    if (desktop)
        program.screen = g_bus_get_sync(G_BUS_TYPE_SESSION, NULL, error);
    else
        program.hooks = hooks_new(conf);
    if (desktop && !program.screen)
        program.exit_code = 1;
    else if (check)
        tell_made_up(&program);
    else if ((connection = connect_to_daemon(error)))
        listen_to(&program, connection);
    else
        program.exit_code = 1;
    hooks_free(program.hooks);
    g_clear_object(&program.screen);
    g_main_loop_unref(program.loop);
    return program.exit_code;
}

int main(int argc, char **argv) {
    setlocale(LC_CTYPE, "");
    signal(SIGPIPE, SIG_IGN);
    g_autoptr(GOptionContext) context = g_option_context_new("— tell others of captures");
    g_autoptr(GError) error = NULL;
    g_auto(HooksConf) conf = {0};
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, &argc, &argv, &error) || argc > 1 ||
        (bus && strcmp(bus, "system") != 0 && strcmp(bus, "session") != 0)) {
        if (error)
            nearest_add_option(error, (const GOptionEntry *const[]){entries, NULL});
        g_printerr("mesorig-hooks: %s\n", error      ? error->message
                                          : argc > 1 ? "it takes options alone"
                                                     : "--bus is system or session");
        return 2;
    }
    if (version) {
        g_print("mesorig-hooks %s\n", MESORIG_VERSION);
        return 0;
    }
    const char *path = conf_path                                     ? conf_path
                       : g_file_test(HOOKS_CONF, G_FILE_TEST_EXISTS) ? HOOKS_CONF
                                                                     : NULL;
    const int code = hooks_conf_load(&conf, path, &error) ? run(&conf, &error) : 1;
    if (error)
        g_printerr("mesorig-hooks: %s\n", error->message);
    return code;
}
