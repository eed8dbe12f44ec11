/* status, watch, pause, continue, abort, safe: the commands about a daemon's work. */
#include "bus/bus_errors.h"
#include "command/link.h"
#include "command/monitor.h"
#include "command/watching.h"
#include "commands.h"
#include "info.h"
#include "plan/report.h"
#include "unattended/unattended.h"

/* NULL: none was given. g_free(). */
static char *directory_of(const struct call *call) {
    return call->n_arguments > 0 ? g_canonicalize_filename(call->arguments[0], NULL) : NULL;
}

/* Reports how much of the session is done, the elapsed time and the predicted end. */
static void tell_progress(Record *to, BusRig1 *rig) {
    const int shots = bus_rig1_get_shots(rig), done = bus_rig1_get_shots_done(rig);
    const guint64 end = bus_rig1_get_predicted_end(rig);
    g_autofree char *elapsed = report_duration(bus_rig1_get_elapsed(rig));
    g_autofree char *left = report_duration(bus_rig1_get_left(rig));
    record_say(to, "session    %s\n", bus_rig1_get_session(rig));
    record_say(to, "shots      %d of %d, %.1f %%\n", done, shots, 100.0 * done / shots);
    record_say(to, "frames     %" G_GINT64_FORMAT ", %" G_GINT64_FORMAT " retakes\n",
               bus_rig1_get_frames(rig), bus_rig1_get_retakes(rig));
    record_say(to, "time       %s, %s left%s", elapsed, left,
               bus_rig1_get_simulated(rig) ? " (simulated)" : "");
    if (end) {
        g_autoptr(GDateTime) time = g_date_time_new_from_unix_local((gint64)end);
        g_autofree char *text = time ? g_date_time_format(time, "%F %H:%M") : g_strdup("?");
        record_say(to, ", ends about %s", text);
    }
    record_say(to, "\n");
}

static void tell_status(Record *to, BusRig1 *rig) {
    const char *reason = bus_rig1_get_reason(rig), *doing = bus_rig1_get_doing(rig);
    const char *prompt = bus_rig1_get_prompt(rig);
    const char *class_name, *name, *driver, *health;
    GVariantIter iter;
    GVariant *devices = bus_rig1_get_devices(rig);
    monitor_status(to, rig);
    if (devices)
        record_variant(to, "devices", devices);
    record_say(to, "state      %s\n", bus_rig1_get_state(rig));
    if (*prompt)
        record_say(to, "to do      %s\n", prompt);
    else if (*reason)
        record_say(to, "reason     %s\n", reason);
    g_autofree char *pose = watching_pose(rig);
    if (*doing)
        record_say(to, "doing      %s\n", doing);
    if (pose)
        record_say(to, "pose       %s\n", pose);
    record_say(to, "rig        %s\n", bus_rig1_get_rig_path(rig));
    if (bus_rig1_get_shots(rig) > 0)
        tell_progress(to, rig);
    unattended_tell(to, rig, FALSE);
    if (!devices || g_variant_n_children(devices) == 0)
        return;
    record_say(to, "\n%-10s %-16s %-16s %s\n", "CLASS", "NAME", "DRIVER", "HEALTH");
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health))
        record_say(to, "%-10s %-16s %-16s %s\n", class_name, name, driver, health);
}

static int run_status(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    /* Without a daemon, what is in the directory is shown. */
    const gboolean readable = directory && !cli_address && !cli_bus;
    g_autoptr(Link) link = link_find(directory, readable ? NULL : error);
    if (!link)
        return readable && info_session(directory, call->record, error) ? CLI_DONE : CLI_FAILED;
    tell_status(call->record, link_rig(link));
    return CLI_DONE;
}

static gboolean no_pictures;
static const GOptionEntry watch_entries[] = {
    {"no-pictures", 0, 0, G_OPTION_ARG_NONE, &no_pictures,
     "Do not show the cameras' last pictures in the terminal", NULL},
    {NULL},
};

static int run_watch(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    if (!link)
        return CLI_FAILED;
    g_autoptr(Monitor) monitor = monitor_new(link, FALSE);
    monitor_watch(monitor, !no_pictures);
    const enum monitor_end end = monitor_run(monitor, TRUE);
    if (end == MONITOR_LOST && bus_rig1_get_shots(link_rig(link)) == 0)
        return CLI_FAILED;
    g_autofree char *summary = monitor_summary(monitor);
    if (end != MONITOR_DETACHED)
        record_say(call->record, "%s: %s\n", end == MONITOR_DONE ? "done" : "ended", summary);
    return end == MONITOR_DONE || end == MONITOR_DETACHED ? CLI_DONE : CLI_FAILED;
}

/* Commands that send one request to the daemon, with the text that is printed on success. */
static const struct request {
    const char *name;
    gboolean (*call)(BusRig1 *rig, GCancellable *cancellable, GError **error);
    const char *done;
} requests[] = {
    {"pause", bus_rig1_call_pause_sync,
     "pausing after the shot under way; “mesorig continue” goes on"},
    {"continue", bus_rig1_call_continue_sync, "going on"},
    {"abort", bus_rig1_call_abort_sync,
     "aborted, the rig is safe; what was taken stays: “mesorig resume” goes on"},
};

static int run_request(const struct call *call, GError **error) {
    const struct request *request = requests;
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    while (!g_str_equal(request->name, call->command->name))
        request++;
    if (!link || !request->call(link_rig(link), NULL, error))
        return CLI_FAILED;
    record_string(call->record, "done", request->name);
    record_say(call->record, "%s\n", request->done);
    return CLI_DONE;
}

/* Prints the answer of each device. A state that was not read back is a failure. */
static int run_safe(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    g_autoptr(GVariant) devices = NULL;
    g_autoptr(GString) open = g_string_new(NULL);
    gboolean safe = FALSE;
    if (!link || !bus_rig1_call_safe_state_sync(link_rig(link), &safe, &devices, NULL, error))
        return CLI_FAILED;
    GVariantIter iter;
    const char *class_name, *name, *state;
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s)", &class_name, &name, &state)) {
        record_say(call->record, "%-10s %-16s %s\n", class_name, name, state);
        if (!g_str_equal(state, "read back"))
            g_string_append_printf(open, "%s%s %s (%s)", open->len ? ", " : "", class_name, name,
                                   state);
    }
    record_string(call->record, "done", "safe");
    record_boolean(call->record, "safe", safe);
    record_variant(call->record, "devices", devices);
    if (safe) {
        record_say(call->record, "lamps and lasers are off, axes stand\n");
        return CLI_DONE;
    }
    g_set_error(error, BUS_ERROR, BUS_ERROR_FAILED,
                "the rig was commanded into its safe state, but these devices did not confirm it: "
                "%s; look at them and switch them off by hand",
                open->str);
    return CLI_FAILED;
}

#define CONTROL(name_, run_, help_, ...)                                                           \
    {                                                                                              \
        .name = (name_), .arguments = "[DIR]", .examples = "  mesorig " name_ "\n",                \
        .help = (help_), .daemon = TRUE, .max = 1, .run = (run_), __VA_ARGS__                      \
    }

const struct command cli_status = CONTROL("status", run_status, "Show what the rig does.");
const struct command cli_watch =
    CONTROL("watch", run_watch, "Follow a capture until it ends.", .options = watch_entries);
const struct command cli_pause = CONTROL("pause", run_request, "Pause after the shot under way.");
const struct command cli_continue =
    CONTROL("continue", run_request, "Go on after a pause or a fault.");
const struct command cli_abort =
    CONTROL("abort", run_request, "End a capture now; it can be resumed.");
const struct command cli_safe =
    CONTROL("safe", run_safe, "End what is under way; lamps and lasers off, axes stopped.");
