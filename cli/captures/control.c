/* status, watch, pause, continue, finish, abort, safe, release, close: commands that control a
 * daemon. */
#include "bus/bus_errors.h"
#include "captures.h"
#include "common/link.h"
#include "common/monitor.h"
#include "common/status.h"
#include "common/watching.h"
#include "sessions/info.h"
#include "unattended.h"

#include <gio/gio.h>

/* While a device has not confirmed that it is safe, “safe” repeats its request. SAFE_WAIT_US is the
 * longest time for which it does so, and SAFE_PAUSE_US is the pause between two requests. */
#define SAFE_WAIT_US  (3 * G_USEC_PER_SEC)
#define SAFE_PAUSE_US (100 * 1000)

/* Returns the directory that was given on the command line, or NULL. Free it with g_free(). */
static char *directory_of(const struct call *call) {
    return call->n_arguments > 0 ? g_canonicalize_filename(call->arguments[0], NULL) : NULL;
}

static void tell_status(Record *to, BusRig1 *rig) {
    const char *reason = bus_rig1_get_reason(rig), *doing = bus_rig1_get_doing(rig);
    const char *prompt = bus_rig1_get_prompt(rig);
    GVariant *devices = bus_rig1_get_devices(rig);
    monitor_status(to, rig);
    if (devices)
        record_variant(to, "devices", devices);
    record_boolean(to, "latched", bus_rig1_get_latched(rig));
    record_say(to, "state      %s%s\n", bus_rig1_get_state(rig),
               bus_rig1_get_latched(rig) ? ", held in the safe state until “mesorig release”" : "");
    if (*prompt)
        status_say_sentences(to, "to do", prompt);
    else if (*reason)
        status_say_sentences(to, "reason", reason);
    g_autofree char *pose = watching_pose(rig);
    if (*doing)
        record_say(to, "doing      %s\n", doing);
    if (pose)
        record_say(to, "pose       %s\n", pose);
    record_say(to, "rig        %s\n", bus_rig1_get_rig_path(rig));
    if (bus_rig1_get_shots(rig) > 0)
        status_say_progress(to, rig);
    g_autoptr(GPtrArray) processed = g_ptr_array_new();
    const char *const *directories = bus_rig1_get_processing(rig);
    for (int i = 0; directories && directories[i]; i++)
        g_ptr_array_add(processed, (gpointer)directories[i]);
    record_say_strings(to, "processing", "processing ", processed);
    unattended_tell(to, rig, FALSE);
    if (devices && g_variant_n_children(devices) > 0)
        status_say_devices(to, devices, reason);
}

static int run_status(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    /* If no daemon is found, the contents of the directory are shown instead. */
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
     "Do not show pictures of the cameras in the terminal", NULL},
    {NULL},
};

static int run_watch(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    if (!link)
        return CLI_FAILED;
    if (bus_rig1_get_shots(link_rig(link)) == 0 && !status_is_capturing(link_rig(link))) {
        const char *rig = bus_rig1_get_rig_path(link_rig(link));
        monitor_status(call->record, link_rig(link));
        record_say(call->record, "nothing is being captured (%s%s)\n",
                   *rig ? "rig " : "the daemon has no rig open", rig);
        return CLI_DONE;
    }
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

/* Adds to the record what a command has done, the rig, and the directory of the session that is
 * being captured, or "" if there is none. */
static void tell_whose(Record *to, const char *done, const char *rig, const char *session) {
    record_add(to, "%s{done} %s{rig} %s{session}", done, rig, session);
}

/* Commands that send one request to the daemon, and the words that report the success: `done` is
 * what has been done, `how` is how the daemon carries out the request, and `next` is the command
 * with which to continue. `how` and `next` may be NULL. */
static const struct request {
    const char *name;
    gboolean (*call)(BusRig1 *rig, GCancellable *cancellable, GError **error);
    const char *done, *how, *next;
} requests[] = {
    {"pause", bus_rig1_call_pause_sync, "pausing", "after the shot under way", "continue"},
    {"continue", bus_rig1_call_continue_sync, "going on with", NULL, NULL},
    {"finish", bus_rig1_call_finish_sync, "ending as good enough", NULL, NULL},
    {"abort", bus_rig1_call_abort_sync, "aborted",
     "the rig is being made safe, what was taken stays", "resume"},
};

static int run_request(const struct call *call, GError **error) {
    const struct request *request = requests;
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    if (!link)
        return CLI_FAILED;
    BusRig1 *rig = link_rig(link);
    g_autofree char *path = g_strdup(bus_rig1_get_rig_path(rig));
    g_autofree char *session = g_strdup(status_is_capturing(rig) ? bus_rig1_get_session(rig) : "");
    g_autofree char *again = link_again(link);
    while (!g_str_equal(request->name, call->command->name))
        request++;
    if (!request->call(rig, NULL, error))
        return CLI_FAILED;
    tell_whose(call->record, request->name, path, session);
    if (!*session)
        record_say(call->record, "%s what was about to begin on the rig %s\n", request->done, path);
    else if (!request->next)
        record_say(call->record, "%s %s (rig %s)\n", request->done, session, path);
    else
        record_say(call->record, "%s %s (rig %s): %s; “mesorig %s %s%s” continues it\n",
                   request->done, session, path, request->how, request->next, session, again);
    return CLI_DONE;
}

static int run_close(const struct call *call, GError **error) {
    g_autoptr(Link) link = link_find(NULL, error);
    if (!link)
        return CLI_FAILED;
    BusRig1 *rig = link_rig(link);
    g_autofree char *path = g_strdup(bus_rig1_get_rig_path(rig));
    g_autofree char *again = link_again(link);
    if (status_is_capturing(rig)) {
        g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                    "the rig %s is capturing the session %s (state: %s): wait until the capture "
                    "ends, or end it with “mesorig abort %s%s”",
                    path, bus_rig1_get_session(rig), bus_rig1_get_state(rig),
                    bus_rig1_get_session(rig), again);
        return CLI_FAILED;
    }
    if (!bus_rig1_call_close_rig_sync(rig, NULL, error))
        return CLI_FAILED;
    tell_whose(call->record, "close", path, "");
    record_say(call->record, "closed the rig %s; its devices are free for other programs\n", path);
    return CLI_DONE;
}

/* The method SafeState answers within a quarter of a second, but a slow device may confirm later.
 * The command therefore asks again until all devices have confirmed, or until SAFE_WAIT_US have
 * passed. SAFE_WAIT_US is longer than the deadline of a command to a laser or lamp. */
static gboolean make_safe(BusRig1 *rig, gboolean *ret_safe, GVariant **ret_devices,
                          GError **error) {
    const gint64 until_us = g_get_monotonic_time() + SAFE_WAIT_US;
    for (;;) {
        if (!bus_rig1_call_safe_state_sync(rig, ret_safe, ret_devices, NULL, error))
            return FALSE;
        if (*ret_safe || g_get_monotonic_time() > until_us)
            return TRUE;
        g_clear_pointer(ret_devices, g_variant_unref);
        g_usleep(SAFE_PAUSE_US);
    }
}

/* Makes the rig safe, and prints the answer of each device. Returns CLI_FAILED if a device has not
 * confirmed its state. */
static int run_safe(const struct call *call, GError **error) {
    g_autofree char *directory = directory_of(call);
    g_autoptr(Link) link = link_find(directory, error);
    g_autoptr(GVariant) devices = NULL;
    g_autoptr(GString) open = g_string_new(NULL);
    gboolean safe = FALSE;
    if (!link)
        return CLI_FAILED;
    BusRig1 *rig = link_rig(link);
    g_autofree char *path = g_strdup(bus_rig1_get_rig_path(rig));
    g_autofree char *session = g_strdup(status_is_capturing(rig) ? bus_rig1_get_session(rig) : "");
    g_autofree char *again = link_again(link);
    if (!make_safe(rig, &safe, &devices, error))
        return CLI_FAILED;
    GVariantIter iter;
    const char *class_name, *name, *state;
    g_variant_iter_init(&iter, devices);
    while (g_variant_iter_next(&iter, "(&s&s&s)", &class_name, &name, &state)) {
        record_say(call->record, "%-10s %-16s %s\n", class_name, name, state);
        /* The answer "sent …" belongs to a device that cannot be read back. Any answer other than
         * "read back" and "sent …" means that the device has not confirmed its state, or that the
         * daemon is too busy to ask its devices. */
        if (!g_str_equal(state, "read back") && !g_str_has_prefix(state, "sent"))
            g_string_append_printf(open, "%s%s %s (%s)", open->len ? ", " : "", class_name, name,
                                   state);
    }
    tell_whose(call->record, "safe", path, session);
    record_boolean(call->record, "safe", safe);
    record_variant(call->record, "devices", devices);
    if (safe) {
        record_say(call->record,
                   "rig %s: lamps and lasers are off, axes stand%s%s\n"
                   "The rig stays so until “mesorig release%s”.\n",
                   path, *session ? "; ended: " : "", session, again);
        return CLI_DONE;
    }
    g_set_error(error, BUS_ERROR, BUS_ERROR_FAILED,
                "the rig %s was commanded into its safe state, but these devices have not "
                "confirmed that they are off or stand still: %s; go to the rig, and switch these "
                "devices off by hand; mesorigd repeats the commands meanwhile",
                path, open->str);
    return CLI_FAILED;
}

static int run_release(const struct call *call, GError **error) {
    g_autoptr(Link) link = link_find(NULL, error);
    if (!link)
        return CLI_FAILED;
    BusRig1 *rig = link_rig(link);
    g_autofree char *path = g_strdup(bus_rig1_get_rig_path(rig));
    const gboolean latched = bus_rig1_get_latched(rig);
    if (!bus_rig1_call_release_sync(rig, NULL, error))
        return CLI_FAILED;
    tell_whose(call->record, "release", path, "");
    record_boolean(call->record, "latched", latched);
    record_say(call->record,
               latched ? "the rig %s may use light and move again; nothing continues by itself\n"
                       : "the rig %s was not held in its safe state\n",
               path);
    return CLI_DONE;
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
    CONTROL("continue", run_request, "Continue after a pause or a fault.");
const struct command cli_finish =
    CONTROL("finish", run_request, "End a capture as good enough, after the shot under way.");
const struct command cli_abort =
    CONTROL("abort", run_request, "End a capture now; it can be resumed.");
const struct command cli_close = {
    .name = "close",
    .arguments = "",
    .examples = "  mesorig close\n",
    .help = "Make the daemon close its rig, so that another may be opened.",
    .daemon = TRUE,
    .run = run_close};
const struct command cli_safe =
    CONTROL("safe", run_safe, "Switch lamps and lasers off and stop all axes, until “release”.");
const struct command cli_release = {
    .name = "release",
    .arguments = "",
    .examples = "  mesorig release\n",
    .help = "Allow light and movement again after “safe”. Look at the rig first.",
    .daemon = TRUE,
    .run = run_release};
