/* mesorigd: opens the devices of a rig and runs sessions, controlled over D-Bus. */
#include "base/program.h"
#include "bus/bus.h"
#include "bus/bus_client.h"
#include "bus/preparer.h"
#include "drivers/lock.h"
#include "rig/guardian.h"
#include "rig/safe_work.h"

#include <glib-unix.h>
#include <stdio.h>
#include <string.h>
#include <sys/stat.h>
#include <systemd/sd-daemon.h>

struct daemon {
    GMainLoop *loop;
    Bus *bus;
    BusServer *server;
    guint name_id, watchdog_id;
    gboolean was_owner;
    int exit_code;
};

static char *bus_kind, *listen_address, *rig_path, *queue_path, *safe_path, *guardian_path;
static gboolean exit_with_client, prepare;

static const GOptionEntry entries[] = {
    {"bus", 0, 0, G_OPTION_ARG_STRING, &bus_kind,
     "Serve clients on this message bus: system or session (system)", "BUS"},
    {"listen", 0, 0, G_OPTION_ARG_STRING, &listen_address,
     "Serve only clients of the same user, at unix:path=…, instead of on a message bus", "ADDRESS"},
    {"rig", 0, 0, G_OPTION_ARG_FILENAME, &rig_path, "Open this rig at the start", "FILE"},
    {"queue", 0, 0, G_OPTION_ARG_FILENAME, &queue_path,
     "Keep a queue of sessions in this file, and capture them", "FILE"},
    {"exit-with-client", 0, 0, G_OPTION_ARG_NONE, &exit_with_client,
     "With --listen: end when the client that opened the rig disconnects", NULL},
    {"safe-state", 0, 0, G_OPTION_ARG_FILENAME, &safe_path,
     "Switch lamps and lasers of this rig off, stop its axes, and end", "RIG"},
    {"guardian", 0, G_OPTION_FLAG_HIDDEN, G_OPTION_ARG_FILENAME, &guardian_path,
     "Make this rig safe when the daemon that started this process has ended", "RIG"},
    {"prepare", 0, G_OPTION_FLAG_HIDDEN, G_OPTION_ARG_NONE, &prepare,
     "Work for the mesorigd that has started this one", NULL},
    {NULL},
};

static int fail(const GError *error) {
    g_printerr("mesorigd: %s\n", error->message);
    return 1;
}

/* Carries out --safe-state: makes the rig safe and returns an exit code.
 *
 * systemd also runs this as ExecStopPost, with SERVICE_RESULT set. It does so even if the service
 * could not start because another daemon has the rig open. That rig must not be switched off, so
 * this process then takes the role LOCK_GUARDIAN. Afterwards, a new guardian continues with devices
 * that are not safe yet, if another attempt may help and no guardian is already at work. */
static int safe_state(const char *path) {
    const gboolean service = g_getenv("SERVICE_RESULT") != NULL;
    g_autoptr(GError) error = NULL;
    g_autoptr(SafeState) state = safe_state_read(path, &error);
    lock_set_role(service ? LOCK_GUARDIAN : LOCK_OPERATOR);
    if (!state) {
        g_prefix_error(&error, "the rig is NOT safe: ");
        return fail(error);
    }
    const gboolean guarded = guardian_await(path);
    gboolean hope;
    const gboolean safe = safe_work_once(state, &hope);
    if (service && hope && !guarded)
        guardian_leave(path);
    return safe ? 0 : 1;
}

/* Writes a message to the journal if stderr is connected to it. Otherwise prints a line with time,
 * level and message to stderr. */
static GLogWriterOutput write_log(GLogLevelFlags level, const GLogField *fields, gsize n,
                                  gpointer data) {
    const char *message = NULL, *domain = NULL;
    for (gsize i = 0; i < n; i++) {
        if (strcmp(fields[i].key, "MESSAGE") == 0)
            message = fields[i].value;
        else if (strcmp(fields[i].key, "GLIB_DOMAIN") == 0)
            domain = fields[i].value;
    }
    if (g_log_writer_default_would_drop(level, domain))
        return G_LOG_WRITER_HANDLED;
    if (g_log_writer_is_journald(fileno(stderr)) &&
        g_log_writer_journald(level, fields, n, NULL) == G_LOG_WRITER_HANDLED)
        return G_LOG_WRITER_HANDLED;
    g_autoptr(GDateTime) now = g_date_time_new_now_local();
    g_autofree char *time = g_date_time_format(now, "%H:%M:%S");
    g_autofree char *of = domain ? g_strconcat(domain, ": ", NULL) : g_strdup("");
    g_printerr("%s mesorigd: %s%s%s\n", time,
               level & G_LOG_LEVEL_WARNING                          ? "warning: "
               : level & (G_LOG_LEVEL_ERROR | G_LOG_LEVEL_CRITICAL) ? "error: "
                                                                    : "",
               of, message ? message : "");
    return G_LOG_WRITER_HANDLED;
}

static void quit(struct daemon *daemon, int exit_code) {
    daemon->exit_code = exit_code;
    g_main_loop_quit(daemon->loop);
}

static gboolean on_signal(gpointer data) {
    quit(data, 0);
    return G_SOURCE_CONTINUE;
}

static void on_client_gone(Bus *bus, gpointer data) {
    quit(data, 0);
}

static void on_changed(Bus *bus, gpointer data) {
    g_autofree char *status = bus_status(bus);
    sd_notifyf(0, "STATUS=%s", status);
}

static gboolean feed_watchdog(gpointer data) {
    sd_notify(0, "WATCHDOG=1");
    return G_SOURCE_CONTINUE;
}

static void say_ready(struct daemon *daemon) {
    guint64 watchdog_us = 0;
    g_autofree char *rig =
        rig_path ? g_strdup_printf("the rig %s is open", rig_path) : g_strdup("no rig is open yet");
    if (listen_address)
        g_message("ready: %s; listening at %s", rig, listen_address);
    else
        g_message("ready: %s; on the %s bus", rig, bus_kind);
    g_autofree char *status = bus_status(daemon->bus);
    sd_notifyf(0, "READY=1\nSTATUS=%s", status);
    bus_listen(daemon->bus, on_changed, daemon);
    if (daemon->watchdog_id == 0 && sd_watchdog_enabled(0, &watchdog_us) > 0) {
        feed_watchdog(NULL);
        daemon->watchdog_id = g_timeout_add((guint)MAX(watchdog_us / 2000, 1), feed_watchdog, NULL);
    }
}

static void on_bus(GDBusConnection *connection, const char *name, gpointer data) {
    struct daemon *daemon = data;
    g_autoptr(GError) error = NULL;
    if (!bus_export(daemon->bus, connection, &error)) {
        fail(error);
        quit(daemon, 1);
    }
}

static void on_name(GDBusConnection *connection, const char *name, gpointer data) {
    struct daemon *daemon = data;
    daemon->was_owner = TRUE;
    say_ready(daemon);
}

static void on_name_lost(GDBusConnection *connection, const char *name, gpointer data) {
    struct daemon *daemon = data;
    if (!connection && daemon->was_owner)
        g_printerr("mesorigd: the %s bus has ended\n", bus_kind);
    else if (!connection)
        g_printerr(
            "mesorigd: there is no %s bus: choose the other bus with --bus, or give --listen\n",
            bus_kind);
    else if (!daemon->was_owner)
        g_printerr("mesorigd: the name %s on the %s bus is not free: another mesorigd has it, or "
                   "the policy of the bus forbids it to this user\n",
                   BUS_NAME, bus_kind);
    else
        g_printerr("mesorigd: another program has taken the name %s on the %s bus\n", BUS_NAME,
                   bus_kind);
    quit(daemon, 1);
}

static gboolean go_public(struct daemon *daemon, GError **error) {
    if (listen_address) {
        /* With this mask, only the owner of the new socket may connect to it. */
        const mode_t before = umask(0077);
        daemon->server = bus_serve(daemon->bus, listen_address, error);
        umask(before);
        if (daemon->server)
            say_ready(daemon);
        return daemon->server != NULL;
    }
    const GBusType type = g_str_equal(bus_kind, "system") ? G_BUS_TYPE_SYSTEM : G_BUS_TYPE_SESSION;
    daemon->name_id = g_bus_own_name(type, BUS_NAME, G_BUS_NAME_OWNER_FLAGS_DO_NOT_QUEUE, on_bus,
                                     on_name, on_name_lost, daemon, NULL);
    return TRUE;
}

static int serve(void) {
    struct daemon daemon = {.loop = g_main_loop_new(NULL, FALSE)};
    g_autoptr(GError) error = NULL;
    daemon.bus = bus_new(listen_address ? listen_address : bus_kind);
    if (exit_with_client)
        bus_listen_client(daemon.bus, on_client_gone, &daemon);
    const int signals[] = {SIGTERM, SIGINT, SIGHUP};
    guint ids[G_N_ELEMENTS(signals)];
    for (gsize i = 0; i < G_N_ELEMENTS(signals); i++)
        ids[i] = g_unix_signal_add(signals[i], on_signal, &daemon);
    g_autofree char *path = rig_path ? g_canonicalize_filename(rig_path, NULL) : NULL;
    g_autofree char *queue = queue_path ? g_canonicalize_filename(queue_path, NULL) : NULL;
    if (queue)
        bus_keep_queue(daemon.bus, queue);
    if ((!path || bus_open_rig(daemon.bus, path, &error)) && go_public(&daemon, &error))
        g_main_loop_run(daemon.loop);
    if (error)
        daemon.exit_code = fail(error);
    /* Make the rig safe first, before clients are disconnected. */
    g_autoptr(GError) unsafe = NULL;
    sd_notify(0, "STOPPING=1\nSTATUS=making the rig safe");
    const gboolean is_open = bus_has_rig(daemon.bus);
    if (!bus_end(daemon.bus, &unsafe)) {
        g_warning("the rig is NOT safe: %s", unsafe->message);
        daemon.exit_code = 1;
    } else if (is_open) {
        g_message("the rig is safe");
    }
    g_clear_handle_id(&daemon.watchdog_id, g_source_remove);
    if (daemon.server)
        bus_unserve(daemon.bus, daemon.server);
    bus_free(daemon.bus);
    if (daemon.name_id)
        g_bus_unown_name(daemon.name_id);
    for (gsize i = 0; i < G_N_ELEMENTS(signals); i++)
        g_source_remove(ids[i]);
    g_main_loop_unref(daemon.loop);
    return daemon.exit_code;
}

static const struct command_line command_line = {
    .name = "mesorigd",
    .summary = "Runs a material-capture rig, as told over D-Bus (org.mesorig.Rig1).",
    .options = entries,
};

int main(int argc, char **argv) {
    setvbuf(stdout, NULL, _IOLBF, 0);
    g_log_set_writer_func(write_log, NULL, NULL);
    program_parse(&command_line, &argc, &argv);
    if (prepare)
        return preparer_child();
    if (safe_path)
        return safe_state(safe_path);
    if (guardian_path)
        return guardian_main(guardian_path);
    if (bus_kind && listen_address)
        return program_usage(&command_line, "give --bus or --listen, not both");
    if (!bus_kind)
        bus_kind = g_strdup("system");
    if (!bus_client_is_bus(bus_kind))
        return program_usage(&command_line, BUS_CLIENT_NO_BUS, bus_kind);
    if (exit_with_client && !listen_address)
        return program_usage(&command_line, "--exit-with-client needs --listen");
    return serve();
}
