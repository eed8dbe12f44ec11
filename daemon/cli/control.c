/* status, watch, pause, continue, abort, safe: of what a daemon does. */
#include "command/link.h"
#include "command/monitor.h"
#include "commands.h"
#include "info.h"
#include "plan/report.h"

/* NULL: none was given. g_free(). */
static char *directory_of(const struct call *call) {
    return call->n_arguments > 0 ? g_canonicalize_filename(call->arguments[0], NULL) : NULL;
}

static void tell_times(Record *to, BusRig1 *rig) {
    const guint64 end = bus_rig1_get_predicted_end(rig);
    g_autofree char *elapsed = report_duration(bus_rig1_get_elapsed(rig));
    g_autofree char *left = report_duration(bus_rig1_get_left(rig));
    record_say(to, "time       %s, %s left%s", elapsed, left,
               bus_rig1_get_simulated(rig) ? " (simulated)" : "");
    if (end) {
        g_autoptr(GDateTime) time = g_date_time_new_from_unix_local((gint64)end);
        g_autofree char *text = time ? g_date_time_format(time, "%F %H:%M") : g_strdup("?");
        record_say(to, ", ends about %s", text);
    }
    record_say(to, "\n");
}

static void tell_devices(Record *to, GVariant *devices) {
    const char *class_name, *name, *driver, *health;
    GVariantIter iter;
    record_say(to, "\n%-10s %-16s %-16s %s\n", "CLASS", "NAME", "DRIVER", "HEALTH");
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health))
        record_say(to, "%-10s %-16s %-16s %s\n", class_name, name, driver, health);
}

static void tell_status(Record *to, BusRig1 *rig) {
    const char *reason = bus_rig1_get_reason(rig), *doing = bus_rig1_get_doing(rig);
    const char *prompt = bus_rig1_get_prompt(rig);
    const int shots = bus_rig1_get_shots(rig), done = bus_rig1_get_shots_done(rig);
    GVariant *devices = bus_rig1_get_devices(rig);
    monitor_status(to, rig);
    if (devices)
        record_variant(to, "devices", devices);
    record_say(to, "state      %s\n", bus_rig1_get_state(rig));
    if (*prompt)
        record_say(to, "to do      %s\n", prompt);
    else if (*reason)
        record_say(to, "reason     %s\n", reason);
    if (*doing)
        record_say(to, "doing      %s\n", doing);
    record_say(to, "rig        %s\n", bus_rig1_get_rig_path(rig));
    if (shots > 0) {
        record_say(to, "session    %s\n", bus_rig1_get_session(rig));
        record_say(to, "shots      %d of %d, %.1f %%\n", done, shots, 100.0 * done / shots);
        record_say(to, "frames     %" G_GINT64_FORMAT ", %" G_GINT64_FORMAT " retakes\n",
                   bus_rig1_get_frames(rig), bus_rig1_get_retakes(rig));
        tell_times(to, rig);
    }
    if (devices && g_variant_n_children(devices) > 0)
        tell_devices(to, devices);
}

static int run_status(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    g_autoptr(GError) none = NULL;
    g_autoptr(Link) link = link_find(directory, &none);
    if (!link && directory && !cli_address && !cli_bus)
        return info_session(directory, call->record, error) ? CLI_DONE : CLI_FAILED;
    if (link)
        tell_status(call->record, link_rig(link));
    else
        g_propagate_error(error, g_steal_pointer(&none));
    return link ? CLI_DONE : CLI_FAILED;
}

static int run_watch(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    if (!link)
        return CLI_FAILED;
    g_autoptr(Monitor) monitor = monitor_new(link, FALSE);
    const enum monitor_end end = monitor_run(monitor, TRUE);
    if (end == MONITOR_LOST && bus_rig1_get_shots(link_rig(link)) == 0)
        return CLI_FAILED;
    g_autofree char *summary = monitor_summary(monitor);
    if (end != MONITOR_DETACHED)
        record_say(call->record, "%s: %s\n", end == MONITOR_DONE ? "done" : "ended", summary);
    return end == MONITOR_DONE || end == MONITOR_DETACHED ? CLI_DONE : CLI_FAILED;
}

/* What only asks the daemon for something, and what it is told then. */
static const struct request {
    const struct command *command;
    gboolean (*call)(BusRig1 *rig, GCancellable *cancellable, GError **error);
    const char *told;
} requests[] = {
    {&cli_pause, bus_rig1_call_pause_sync,
     "pausing after the shot under way; “mesorig continue” goes on"},
    {&cli_continue, bus_rig1_call_continue_sync, "going on"},
    {&cli_abort, bus_rig1_call_abort_sync,
     "aborted, the rig is safe; what was taken stays: “mesorig resume” goes on"},
    {&cli_safe, bus_rig1_call_safe_state_sync,
     "lamps and lasers were told to be off, axes to stop"},
};

static int run_request(const struct call *call, GError **error) {
    const struct request *request = requests;
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    while (request->command != call->command)
        request++;
    if (!link || !request->call(link_rig(link), NULL, error))
        return CLI_FAILED;
    record_string(call->record, "done", call->command->name);
    record_say(call->record, "%s\n", request->told);
    return CLI_DONE;
}

const struct command cli_status = {.name = "status",
                                   .arguments = "[DIR]",
                                   .help = "Show what the rig does.",
                                   .daemon = TRUE,
                                   .max = 1,
                                   .run = run_status};
const struct command cli_watch = {.name = "watch",
                                  .arguments = "[DIR]",
                                  .help = "Follow a capture until it ends.",
                                  .daemon = TRUE,
                                  .max = 1,
                                  .run = run_watch};
const struct command cli_pause = {.name = "pause",
                                  .arguments = "[DIR]",
                                  .help = "Pause after the shot under way.",
                                  .daemon = TRUE,
                                  .max = 1,
                                  .run = run_request};
const struct command cli_continue = {.name = "continue",
                                     .arguments = "[DIR]",
                                     .help = "Go on after a pause or a fault.",
                                     .daemon = TRUE,
                                     .max = 1,
                                     .run = run_request};
const struct command cli_abort = {.name = "abort",
                                  .arguments = "[DIR]",
                                  .help = "End a capture now; it can be resumed.",
                                  .daemon = TRUE,
                                  .max = 1,
                                  .run = run_request};
const struct command cli_safe = {.name = "safe",
                                 .arguments = "[DIR]",
                                 .help =
                                     "End what is under way; lamps and lasers off, axes stopped.",
                                 .daemon = TRUE,
                                 .max = 1,
                                 .run = run_request};
