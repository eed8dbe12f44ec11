/* status, watch, pause, continue, abort, safe: of what a daemon does. */
#include "cli.h"
#include "info.h"
#include "link.h"
#include "monitor.h"
#include "plan/report.h"

static char *directory_of(int argc, char **argv) {
    return argc > 1 ? cli_absolute(argv[1]) : NULL;
}

static void print_times(BusRig1 *rig) {
    const guint64 end = bus_rig1_get_predicted_end(rig);
    g_autofree char *elapsed = report_duration(bus_rig1_get_elapsed(rig));
    g_autofree char *left = report_duration(bus_rig1_get_left(rig));
    g_print("time       %s, %s left%s", elapsed, left,
            bus_rig1_get_simulated(rig) ? " (simulated)" : "");
    if (end) {
        g_autoptr(GDateTime) time = g_date_time_new_from_unix_local((gint64)end);
        g_autofree char *text = time ? g_date_time_format(time, "%F %H:%M") : g_strdup("?");
        g_print(", ends about %s", text);
    }
    g_print("\n");
}

static void print_devices(GVariant *devices) {
    const char *class_name, *name, *driver, *health;
    GVariantIter iter;
    g_print("\n%-10s %-16s %-16s %s\n", "CLASS", "NAME", "DRIVER", "HEALTH");
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s&s)", &class_name, &name, &driver, &health))
        g_print("%-10s %-16s %-16s %s\n", class_name, name, driver, health);
}

static void print_status(BusRig1 *rig) {
    const char *reason = bus_rig1_get_reason(rig), *doing = bus_rig1_get_doing(rig);
    const char *prompt = bus_rig1_get_prompt(rig);
    const int shots = bus_rig1_get_shots(rig), done = bus_rig1_get_shots_done(rig);
    GVariant *devices = bus_rig1_get_devices(rig);
    g_print("state      %s\n", bus_rig1_get_state(rig));
    if (*prompt)
        g_print("to do      %s\n", prompt);
    else if (*reason)
        g_print("reason     %s\n", reason);
    if (*doing)
        g_print("doing      %s\n", doing);
    g_print("rig        %s\n", bus_rig1_get_rig_path(rig));
    if (shots > 0) {
        g_print("session    %s\n", bus_rig1_get_session(rig));
        g_print("shots      %d of %d, %.1f %%\n", done, shots, 100.0 * done / shots);
        g_print("frames     %" G_GINT64_FORMAT ", %" G_GINT64_FORMAT " retakes\n",
                bus_rig1_get_frames(rig), bus_rig1_get_retakes(rig));
        print_times(rig);
    }
    if (devices && g_variant_n_children(devices) > 0)
        print_devices(devices);
}

static int run_status(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    if (!cli_parse(command, NULL, TRUE, &argc, &argv, 0, 1))
        return CLI_USAGE;
    g_autofree char *directory = directory_of(argc, argv);
    g_autoptr(Link) link = link_find(directory, &error);
    if (!link && directory && !cli_address && !cli_bus)
        return info_session(directory);
    if (!link)
        return cli_fail(error);
    if (cli_json)
        cli_print_json(monitor_status(link_rig(link)));
    else
        print_status(link_rig(link));
    return CLI_DONE;
}

static int run_watch(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    if (!cli_parse(command, NULL, TRUE, &argc, &argv, 0, 1))
        return CLI_USAGE;
    g_autofree char *directory = directory_of(argc, argv);
    g_autoptr(Link) link = link_find(directory, &error);
    if (!link)
        return cli_fail(error);
    g_autoptr(Monitor) monitor = monitor_new(link, FALSE);
    const enum monitor_end end = monitor_run(monitor, TRUE);
    if (end == MONITOR_LOST && bus_rig1_get_shots(link_rig(link)) == 0)
        return CLI_FAILED;
    g_autofree char *summary = monitor_summary(monitor);
    if (!cli_json && end != MONITOR_DETACHED)
        g_print("%s: %s\n", end == MONITOR_DONE ? "done" : "ended", summary);
    return end == MONITOR_DONE || end == MONITOR_DETACHED ? CLI_DONE : CLI_FAILED;
}

typedef gboolean (*Call)(BusRig1 *rig, GCancellable *cancellable, GError **error);

static int run_call(const struct command *command, int argc, char **argv, Call call,
                    const char *told) {
    g_autoptr(GError) error = NULL;
    if (!cli_parse(command, NULL, TRUE, &argc, &argv, 0, 1))
        return CLI_USAGE;
    g_autofree char *directory = directory_of(argc, argv);
    g_autoptr(Link) link = link_find(directory, &error);
    if (!link || !call(link_rig(link), NULL, &error))
        return cli_fail(error);
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "done", g_variant_new_string(command->name));
        cli_print_json(g_variant_builder_end(&builder));
    } else {
        g_print("%s\n", told);
    }
    return CLI_DONE;
}

static int run_pause(const struct command *command, int argc, char **argv) {
    return run_call(command, argc, argv, bus_rig1_call_pause_sync,
                    "pausing after the shot under way; “mesorig continue” goes on");
}

static int run_continue(const struct command *command, int argc, char **argv) {
    return run_call(command, argc, argv, bus_rig1_call_continue_sync, "going on");
}

static int run_abort(const struct command *command, int argc, char **argv) {
    return run_call(command, argc, argv, bus_rig1_call_abort_sync,
                    "aborted, the rig is safe; what was taken stays: “mesorig resume” goes on");
}

static int run_safe(const struct command *command, int argc, char **argv) {
    return run_call(command, argc, argv, bus_rig1_call_safe_state_sync,
                    "lamps and lasers were told to be off, axes to stop");
}

const struct command cli_status = {.name = "status",
                                   .arguments = "[DIR]",
                                   .help = "Show what the rig does.",
                                   .run_arguments = run_status};
const struct command cli_watch = {.name = "watch",
                                  .arguments = "[DIR]",
                                  .help = "Follow a capture until it ends.",
                                  .run_arguments = run_watch};
const struct command cli_pause = {.name = "pause",
                                  .arguments = "[DIR]",
                                  .help = "Pause after the shot under way.",
                                  .run_arguments = run_pause};
const struct command cli_continue = {.name = "continue",
                                     .arguments = "[DIR]",
                                     .help = "Go on after a pause or a fault.",
                                     .run_arguments = run_continue};
const struct command cli_abort = {.name = "abort",
                                  .arguments = "[DIR]",
                                  .help = "End a capture now; it can be resumed.",
                                  .run_arguments = run_abort};
const struct command cli_safe = {.name = "safe",
                                 .arguments = "[DIR]",
                                 .help =
                                     "End what is under way; lamps and lasers off, axes stopped.",
                                 .run_arguments = run_safe};
