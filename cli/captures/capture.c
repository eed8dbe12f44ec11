#include "bus/bus.h"
#include "captures.h"
#include "common/cli.h"
#include "common/link.h"
#include "common/monitor.h"
#include "hands/before_capture.h"
#include "hands/rig_link.h"
#include "plan/plan.h"
#include "rig/devices.h"
#include "session/session.h"
#include "sessions/process.h"

#include <string.h>

static char *output, *rig_option, *calibration;
static gboolean process, yes;

#define YES_ENTRY                                                                                  \
    {                                                                                              \
        "yes", 0, 0, G_OPTION_ARG_NONE, &yes,                                                      \
            "Capture even if test shots give warnings; on a simulated rig, confirm manual steps",  \
            NULL                                                                                   \
    }

static const GOptionEntry capture_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Session directory to make", "DIR"},
    {"process", 0, 0, G_OPTION_ARG_NONE, &process, "Process the frames while they are captured",
     NULL},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration,
     "Use this calibration instead of the one that the rig file names", "FILE"},
    YES_ENTRY,
    {NULL},
};

static const GOptionEntry resume_entries[] = {
    {"rig", 0, 0, G_OPTION_ARG_FILENAME, &rig_option,
     "Rig file, if it was moved since the session began", "RIG"},
    {"process", 0, 0, G_OPTION_ARG_NONE, &process, "Process the frames while they are captured",
     NULL},
    YES_ENTRY,
    {NULL},
};

/* Returns the options of the method Start or, if session is NULL, of Resume. chosen has the
 * exposures that replace "auto" in the session file, or is NULL. Returns NULL with an error if a
 * file that the options name cannot be read. */
static GVariant *start_options(Link *link, const char *session, const char *chosen,
                               GError **error) {
    g_autofree char *path = calibration ? g_canonicalize_filename(calibration, NULL) : NULL;
    g_auto(GVariantDict) options;
    g_variant_dict_init(&options, NULL);
    if (process)
        g_variant_dict_insert(&options, "process", "b", TRUE);
    if (path)
        g_variant_dict_insert(&options, "calibration", "s", path);
    if (chosen)
        g_variant_dict_insert(&options, "chosen", "s", chosen);
    if ((session && !link_add_text(link, &options, "session_text", session, error)) ||
        (session && path && !link_add_text(link, &options, "calibration_text", path, error)))
        return NULL;
    return g_variant_dict_end(&options);
}

/* Prints how the capture has ended, and returns an exit code. With --json, the monitor has already
 * printed all states, so only an error is reported here. */
static int tell_end(Link *link, Monitor *monitor, enum monitor_end end, const char *directory,
                    GError **error) {
    g_autofree char *summary = monitor_summary(monitor);
    const char *go_on = link_is_private(link) ? "resume" : "continue";
    const char *reason = monitor_reason(monitor);
    g_autofree char *again = link_again(link);
    const gboolean done = end == MONITOR_DONE || end == MONITOR_DETACHED;
    if (end == MONITOR_LOST) {
        g_autofree char *log = link_log(link);
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_CLOSED,
                    "mesorigd has ended unexpectedly; the frames that it has stored are kept: "
                    "continue with mesorig resume %s%s%s%s",
                    directory, again, *log ? "\nIts last messages:\n" : "", log);
        return CLI_FAILED;
    }
    if (cli_json)
        return done ? CLI_DONE : CLI_FAILED;
    if (end == MONITOR_DONE)
        g_print("done: %s\n", summary);
    else if (end == MONITOR_DETACHED)
        g_print("the capture continues in mesorigd: mesorig watch, pause or abort %s%s\n",
                directory, again);
    else if (end == MONITOR_FAULT)
        g_printerr("mesorig: paused%s: %s\nto go on: mesorig %s %s%s\n",
                   strstr(reason, DEVICES_UNSAFE) ? "" : ", the rig is being made safe", reason,
                   go_on, directory, again);
    else
        g_printerr("mesorig: %s, the rig is being made safe: %s\nto go on: mesorig resume %s%s\n",
                   end == MONITOR_PAUSED ? "paused" : "aborted", summary, directory, again);
    return done ? CLI_DONE : CLI_FAILED;
}

/* Waits until a daemon that other programs use as well has processed the session. Returns an exit
 * code. */
static int wait_for_products(Monitor *monitor, const char *directory, GError **error) {
    switch (monitor_run_processing(monitor, directory)) {
    case MONITOR_DONE:
        return CLI_DONE;
    case MONITOR_DETACHED:
        if (!cli_json)
            g_print("mesorigd continues the processing; mesorig info %s shows the products\n",
                    directory);
        return CLI_DONE;
    case MONITOR_LOST:
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_CLOSED,
                    "mesorigd has ended before the frames were processed: mesorig process %s",
                    directory);
        return CLI_FAILED;
    default:
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_FAILED,
                    "%s was captured, but not processed: mesorig process %s says why", directory,
                    directory);
        return CLI_FAILED;
    }
}

/* Captures a session or, if session is NULL, resumes the session in directory. Returns an exit
 * code. */
static int capture(const struct call *call, const char *rig, const char *session,
                   const char *directory, GError **error) {
    gboolean simulated = FALSE;
    g_autoptr(Link) link = rig_link_find(rig, &simulated, error);
    if (!link)
        return CLI_FAILED;
    g_autofree char *chosen = NULL;
    gboolean uncalibrated = FALSE;
    const struct before_capture before = {.rig_path = rig,
                                          .session = session,
                                          .calibration = calibration,
                                          .yes = yes,
                                          .ret_uncalibrated = &uncalibrated};
    if (!rig_link_open(link, rig, error) ||
        (session && !before_capture(link, &before, &chosen, error)))
        return CLI_FAILED;
    g_autoptr(Monitor) monitor = monitor_new(link, link_is_private(link));
    if (uncalibrated)
        monitor_leave_out(monitor, "calibration"); /* before_capture() has printed this warning */
    GVariant *options = start_options(link, session, chosen, error);
    const gboolean ok =
        options &&
        (session
             ? bus_rig1_call_start_sync(link_rig(link), session, directory, options, NULL, error)
             : bus_rig1_call_resume_sync(link_rig(link), directory, options, NULL, error));
    if (!ok)
        return CLI_FAILED;
    monitor_set_answer(monitor, yes && simulated ? ANSWER_AT_ONCE : ANSWER_ENTER);
    const enum monitor_end end = monitor_run(monitor, FALSE);
    const gboolean private = link_is_private(link);
    int code = tell_end(link, monitor, end, directory, error);
    if (end == MONITOR_DONE && process && !private)
        code = wait_for_products(monitor, directory, error);
    g_clear_pointer(&monitor, monitor_free);
    g_clear_pointer(&link, link_free);
    /* A private daemon ends with this command, and so does its child that makes the products. The
     * remaining products are made here. */
    return code == CLI_DONE && process && private
               ? process_session(directory, session != NULL, call->record, error)
               : code;
}

static int run_capture(const struct call *call, GError **error) {
    if (!output)
        return cli_usage(call->command, "no session directory is given: give -o DIR");
    g_autofree char *rig = g_canonicalize_filename(call->arguments[0], NULL);
    g_autofree char *session = g_canonicalize_filename(call->arguments[1], NULL);
    g_autofree char *directory = g_canonicalize_filename(output, NULL);
    return plan_check_order(rig, session, error) ? capture(call, rig, session, directory, error)
                                                 : CLI_FAILED;
}

static char *rig_of_session(const char *directory, GError **error) {
    g_autoptr(Session) session = session_open(directory, SESSION_READ, error);
    if (!session)
        return NULL;
    if (rig_option)
        return g_canonicalize_filename(rig_option, NULL);
    g_autofree char *path = session_value(session, "rig_path");
    if (path && g_file_test(path, G_FILE_TEST_EXISTS))
        return g_steal_pointer(&path);
    if (path)
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "%s was begun with the rig file %s, which no longer exists: give --rig RIG",
                    directory, path);
    else
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                    "%s does not say which rig file it was begun with: give --rig RIG", directory);
    return NULL;
}

static int run_resume(const struct call *call, GError **error) {
    g_autofree char *directory = g_canonicalize_filename(call->arguments[0], NULL);
    g_autofree char *rig = rig_of_session(directory, error);
    return rig ? capture(call, rig, NULL, directory, error) : CLI_FAILED;
}

const struct command cli_capture = {
    .name = "capture",
    .arguments = "RIG SESSION -o DIR",
    .examples =
        "  mesorig capture rig.conf session.conf -o weave.session\n"
        "  mesorig capture rig.conf session.conf -o weave.session -c rig.calibration --process\n",
    .help = "Capture a session and show its progress.",
    .options = capture_entries,
    .daemon = TRUE,
    .streams = TRUE,
    .min = 2,
    .max = 2,
    .run = run_capture};
const struct command cli_resume = {.name = "resume",
                                   .arguments = "DIR",
                                   .examples = "  mesorig resume weave.session\n",
                                   .help =
                                       "Continue a session: capture the frames that are missing.",
                                   .options = resume_entries,
                                   .daemon = TRUE,
                                   .streams = TRUE,
                                   .min = 1,
                                   .max = 1,
                                   .run = run_resume};
