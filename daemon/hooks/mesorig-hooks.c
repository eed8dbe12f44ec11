/* mesorig-hooks: reports events of captures and of the rig to other programs and to the desktop. It
 * is a separate process that receives the daemon's signals and calls no methods. */
#include "base/program.h"
#include "hooks.h"

#include <glib-unix.h>
#include <signal.h>
#include <string.h>
#include <systemd/sd-daemon.h>

#include "bus/bus.h"
#include "bus/bus_client.h"

#define AGAIN_S 2 /* seconds between attempts to connect to a daemon that does not answer */

static char *address, *bus, *conf_path;
static gboolean desktop, check;

static const GOptionEntry entries[] = {
    {"config", 0, 0, G_OPTION_ARG_FILENAME, &conf_path,
     "Read this file (" HOOKS_CONF ", if it exists)", "FILE"},
    {"check", 0, 0, G_OPTION_ARG_NONE, &check, "Run all hooks once for a test event, and end",
     NULL},
    {"desktop", 0, 0, G_OPTION_ARG_NONE, &desktop,
     "Show notifications on this user's desktop, and do nothing else", NULL},
    {"bus", 0, 0, G_OPTION_ARG_STRING, &bus, "The daemon's bus: system or session (system)", "BUS"},
    {"address", 0, 0, G_OPTION_ARG_STRING, &address,
     "Connect to the daemon's own socket, not to a bus (MESORIG_ADDRESS in the environment)",
     "unix:path=…"},
    {NULL},
};

struct program {
    GMainLoop *loop;
    Hooks *hooks;            /* NULL if only the desktop is used */
    GDBusConnection *screen; /* the session bus, for the desktop */
    const char *address;     /* address of the daemon's own socket; NULL if it is on a bus */
    GDBusConnection *connection;
    GCancellable *cancellable;
    guint again_id;
    /* reason why no daemon answers at the address; NULL if a daemon answers or no connection was
     * tried yet */
    char *away;
    int exit_code;
};

static const char *bus_name(void) {
    return g_strcmp0(bus, "session") == 0 ? "session" : "system";
}

static gboolean on_signal(gpointer data) {
    struct program *program = data;
    g_main_loop_quit(program->loop);
    return G_SOURCE_CONTINUE;
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

static void on_event(GDBusConnection *connection, const char *sender, const char *path,
                     const char *interface, const char *signal, GVariant *parameters,
                     gpointer data) {
    const char *level, *source, *message;
    if (!g_variant_is_of_type(parameters, G_VARIANT_TYPE("(sss)")))
        return;
    g_variant_get(parameters, "(&s&s&s)", &level, &source, &message);
    const char *what = hooks_what_of_event(level, message);
    if (what)
        program_tell(data, what, hooks_details_of_event(source, message));
}

static gboolean connect_again(gpointer data);

/* Reports why the daemon cannot be reached, but not the same reason twice in a row. Tries again
 * after AGAIN_S. Takes ownership of why. */
static void stay_away(struct program *program, GError *why) {
    if (g_strcmp0(program->away, why->message) != 0)
        g_printerr("mesorig-hooks: %s; mesorig-hooks tries again every %d s\n", why->message,
                   AGAIN_S);
    g_free(program->away);
    program->away = g_strdup(why->message);
    g_error_free(why);
    program->again_id = g_timeout_add_seconds(AGAIN_S, connect_again, program);
}

/* If a daemon with its own socket has ended, this program waits until the daemon has started again.
 * If a bus has ended, this program also ends, and systemd starts it again. */
static void on_closed(GDBusConnection *connection, gboolean by_peer, GError *error, gpointer data) {
    struct program *program = data;
    if (program->address) {
        g_signal_handlers_disconnect_by_data(program->connection, program);
        g_clear_object(&program->connection);
        stay_away(program, g_error_new(G_IO_ERROR, G_IO_ERROR_CLOSED, "mesorigd at %s has ended",
                                       program->address));
        return;
    }
    g_printerr("mesorig-hooks: the connection to the %s bus has ended\n", bus_name());
    program->exit_code = 1;
    g_main_loop_quit(program->loop);
}

/* Subscribes to the daemon's signals on a connection. Takes ownership of connection. */
static void listen_to(struct program *program, GDBusConnection *connection) {
    static const struct {
        const char *name;
        GDBusSignalCallback callback;
    } signals[] = {{"Milestone", on_milestone}, {"Event", on_event}};
    program->connection = connection;
    g_dbus_connection_set_exit_on_close(connection, FALSE);
    g_signal_connect(connection, "closed", G_CALLBACK(on_closed), program);
    for (gsize i = 0; i < G_N_ELEMENTS(signals); i++)
        g_dbus_connection_signal_subscribe(
            connection, program->address ? NULL : BUS_NAME, BUS_NAME, signals[i].name, BUS_PATH,
            NULL, G_DBUS_SIGNAL_FLAGS_NONE, signals[i].callback, program, NULL);
    if (g_dbus_connection_is_closed(connection))
        on_closed(connection, TRUE, NULL, program);
}

static void on_connected(GObject *source, GAsyncResult *result, gpointer data) {
    GError *error = NULL;
    struct program *program = data; /* no longer valid if the call was cancelled */
    GDBusConnection *connection = bus_client_connect_finish(result, &error);
    if (g_error_matches(error, G_IO_ERROR, G_IO_ERROR_CANCELLED)) {
        g_error_free(error);
        return;
    }
    sd_notify(0, "READY=1");
    if (!connection) {
        stay_away(program, error);
        return;
    }
    if (program->away)
        g_printerr("mesorig-hooks: mesorigd answers at %s\n", program->address);
    g_clear_pointer(&program->away, g_free);
    listen_to(program, connection);
}

static gboolean connect_again(gpointer data) {
    struct program *program = data;
    program->again_id = 0;
    bus_client_connect_async(program->address, program->cancellable, on_connected, program);
    return G_SOURCE_REMOVE;
}

/* Receives the daemon's signals until SIGINT or SIGTERM ends the program, or the bus ends. Returns
 * FALSE with an error if there is no bus. */
static gboolean hear(struct program *program, GError **error) {
    program->cancellable = g_cancellable_new();
    if (program->address) {
        connect_again(program);
    } else {
        GDBusConnection *connection = g_bus_get_sync(
            strcmp(bus_name(), "session") == 0 ? G_BUS_TYPE_SESSION : G_BUS_TYPE_SYSTEM, NULL,
            error);
        if (!connection) {
            g_prefix_error(error,
                           "cannot connect to the %s bus (give --bus=system, --bus=session or "
                           "--address, as mesorigd was started): ",
                           bus_name());
            return FALSE;
        }
        listen_to(program, connection);
        sd_notify(0, "READY=1");
    }
    g_unix_signal_add(SIGINT, on_signal, program);
    g_unix_signal_add(SIGTERM, on_signal, program);
    g_main_loop_run(program->loop);
    return TRUE;
}

static void program_end(struct program *program) {
    if (program->cancellable)
        g_cancellable_cancel(program->cancellable);
    g_clear_handle_id(&program->again_id, g_source_remove);
    while (g_main_context_iteration(NULL, FALSE)) /* lets a cancelled call end */
        ;
    g_clear_handle_id(&program->again_id, g_source_remove);
    if (program->connection)
        g_signal_handlers_disconnect_by_data(program->connection, program);
    g_clear_object(&program->connection);
    g_clear_object(&program->cancellable);
    g_free(program->away);
    g_main_loop_unref(program->loop);
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

/* Does what the command line requests. Returns an exit code. */
static int run(const struct hooks_conf *conf, GError **error) {
    struct program program = {.loop = g_main_loop_new(NULL, FALSE),
                              .address = address ? address
                                         : bus   ? NULL
                                                 : bus_client_address()};
    if (desktop) {
        program.screen = g_bus_get_sync(G_BUS_TYPE_SESSION, NULL, error);
    } else {
        program.hooks = hooks_new(conf);
    }
    if (desktop && !program.screen) {
        g_prefix_error(error,
                       "cannot connect to the session bus (start mesorig-hooks --desktop in the "
                       "session of a desktop): ");
        program.exit_code = 1;
    } else if (check) {
        tell_made_up(&program);
    } else if (!hear(&program, error)) {
        program.exit_code = 1;
    }
    program_end(&program);
    hooks_free(program.hooks);
    g_clear_object(&program.screen);
    return program.exit_code;
}

static const struct command_line command_line = {
    .name = "mesorig-hooks",
    .summary = "Reports events of captures and of the rig to other programs and to the desktop.",
    .options = entries,
};

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    g_auto(HooksConf) conf = {0};
    signal(SIGPIPE, SIG_IGN);
    program_parse(&command_line, &argc, &argv);
    if (bus && !bus_client_is_bus(bus))
        return program_usage(&command_line, BUS_CLIENT_NO_BUS, bus);
    const char *path = conf_path                                     ? conf_path
                       : g_file_test(HOOKS_CONF, G_FILE_TEST_EXISTS) ? HOOKS_CONF
                                                                     : NULL;
    const int code = hooks_conf_load(&conf, path, &error) ? run(&conf, &error) : 1;
    if (error)
        g_printerr("mesorig-hooks: %s\n", error->message);
    return code;
}
