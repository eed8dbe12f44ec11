#include "bus_private.h"

#include <string.h>

#include "base/input_file.h"
#include "bus_errors.h"
#include "bus_options.h"
#include "bus_safety.h"
#include "plan/report.h"

/* Maximum size of a calibration in bytes, as in calibration.c. Other files have lower limits. */
#define MAX_TEXT (16 << 20)

/* A call about a session that waits for a child process. */
struct session_call {
    Bus *bus;
    char *directory;
    gboolean resumes, process;
    struct queue_item *item; /* session that the call adds to the queue; NULL for other calls */
};

static void session_call_free(gpointer data) {
    struct session_call *call = data;
    queue_item_free(call->item);
    g_free(call->directory);
    g_free(call);
}

static struct session_call *session_call_new(Bus *bus, const char *directory) {
    struct session_call *call = g_new0(struct session_call, 1);
    call->bus = bus;
    call->directory = g_strdup(directory);
    return call;
}

static void refuse(GDBusMethodInvocation *invocation, GError *error) {
    g_dbus_method_invocation_take_error(invocation, bus_errors_wrap(error));
}

/* Answers Validate. If the session is invalid, the answer lists the mistakes. If the check itself
 * has failed (BUS_ERROR), the answer is the error. */
static void on_checked(GDBusMethodInvocation *invocation, GVariant *report, GError *error,
                       gpointer data) {
    const struct session_call *call = data;
    if (!report && error->domain == BUS_ERROR) {
        refuse(invocation, error);
        return;
    }
    g_autofree char *text = report ? report_text(report) : g_strdup(error->message);
    bus_rig1_complete_validate(call->bus->object, invocation, report != NULL, text,
                               report ? report : g_variant_new("a{sv}", NULL));
    g_clear_error(&error);
}

/* Answers QueueAdd. The values that the queue shows are copied from the report of the plan to the
 * item. */
static void on_checked_for_queue(GDBusMethodInvocation *invocation, GVariant *report, GError *error,
                                 gpointer data) {
    struct session_call *call = data;
    struct queue_item *item = call->item;
    const char *name = "", *prompt = "";
    if (!report) {
        refuse(invocation, error);
        return;
    }
    g_variant_lookup(report, "session", "&s", &name);
    g_variant_lookup(report, "prompt", "&s", &prompt);
    g_variant_lookup(report, "predicted_s", "d", &item->predicted_s);
    g_variant_lookup(report, "bytes", "t", &item->bytes);
    g_free(item->name);
    item->name = g_strdup(name);
    g_free(item->prompt);
    item->prompt = g_strdup(prompt);
    const guint number =
        bus_unattended_add(call->bus->unattended, g_steal_pointer(&call->item), &error);
    if (number == 0) {
        refuse(invocation, error);
        return;
    }
    bus_rig_flush(&call->bus->rig);
    bus_rig1_complete_queue_add(call->bus->object, invocation, number, report);
}

/* Answers Start and Resume. */
static void on_prepared(GDBusMethodInvocation *invocation, GVariant *result, GError *error,
                        gpointer data) {
    const struct session_call *call = data;
    Bus *bus = call->bus;
    const char *warning = result ? g_variant_get_string(result, NULL) : "";
    if (!result || !bus_run_begin(&bus->run, call->directory, call->resumes,
                                  *warning ? warning : NULL, call->process, &error)) {
        refuse(invocation, error);
        return;
    }
    bus_rig_flush(&bus->rig);
    if (call->resumes)
        bus_rig1_complete_resume(bus->object, invocation);
    else
        bus_rig1_complete_start(bus->object, invocation);
}

/* Checks that the daemon need not read the file at path for another user, because the daemon may
 * have other rights than that user. Returns FALSE with an error if a caller who is such a user has
 * not sent the text of the file. A NULL path is always allowed. */
static gboolean check_readable(GDBusMethodInvocation *invocation, const char *path,
                               const char *text, const char *option, GError **error) {
    if (!path || text || !bus_authority_caller(invocation))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_DENIED,
                "%s: mesorigd does not read files for another user: give the text of the file in "
                "the option %s",
                path, option);
    return FALSE;
}

gboolean bus_validate(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                      const char *directory, GVariant *options, GError **error) {
    g_auto(BusOptions) chosen = {0};
    if (!bus_rig_need_open(&bus->rig, error) || !devices_check_file(bus->rig.devices, error) ||
        !bus_need_absolute(session_path, error) ||
        (*directory && !bus_need_absolute(directory, error)) ||
        !bus_options_read(options, &chosen, error) ||
        !check_readable(invocation, session_path, chosen.session_text, "session_text", error) ||
        !bus_jobs_may_check(&bus->jobs, invocation, error))
        return FALSE;
    struct preparer_request request = {.task = PREPARER_CHECK,
                                       .session_path = session_path,
                                       .session_text = chosen.session_text,
                                       .directory = directory,
                                       .caller = bus_authority_caller(invocation)};
    bus_jobs_start(&bus->jobs, &request, invocation, on_checked, session_call_new(bus, directory),
                   session_call_free);
    return TRUE;
}

/* Checks the path of a calibration with which a call replaces the calibration of the rig file. path
 * is NULL if the call names no calibration, which is always allowed. Returns FALSE with an error
 * if:
 * - begins is FALSE, because a resumed session keeps its calibration,
 * - path is not absolute,
 * - text is NULL and no file exists at path. */
static gboolean check_calibration(const char *path, const char *text, gboolean begins,
                                  GError **error) {
    if (!path)
        return TRUE;
    if (!begins) {
        g_set_error_literal(
            error, BUS_ERROR, BUS_ERROR_UNKNOWN,
            "a resumed session keeps the calibration with which it began; leave --calibration out");
        return FALSE;
    }
    if (!bus_need_absolute(path, error))
        return FALSE;
    if (text || g_file_test(path, G_FILE_TEST_EXISTS))
        return TRUE;
    g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT,
                "there is no calibration file %s: give the path of an existing file", path);
    return FALSE;
}

gboolean bus_start(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                   const char *directory, GVariant *options, GError **error) {
    g_auto(BusOptions) chosen = {0};
    const gboolean begins = session_path != NULL;
    if (!bus_rig_need_open(&bus->rig, error) || !bus_jobs_need_free(&bus->jobs, error) ||
        !devices_check_file(bus->rig.devices, error) || !bus_safety_need(&bus->rig, error) ||
        !bus_unattended_need_free(bus->unattended, error) || !bus_need_absolute(directory, error) ||
        !bus_options_read(options, &chosen, error) ||
        !check_calibration(chosen.calibration, chosen.calibration_text, begins, error) ||
        (begins && !bus_need_absolute(session_path, error)) ||
        !check_readable(invocation, session_path, chosen.session_text, "session_text", error) ||
        !check_readable(invocation, chosen.calibration, chosen.calibration_text, "calibration_text",
                        error))
        return FALSE;
    struct preparer_request request = {.task = begins ? PREPARER_BEGIN : PREPARER_EXAMINE,
                                       .session_path = session_path,
                                       .session_text = chosen.session_text,
                                       .directory = directory,
                                       .calibration = chosen.calibration,
                                       .calibration_text = chosen.calibration_text,
                                       .chosen = chosen.exposures,
                                       .caller = bus_authority_caller(invocation)};
    struct session_call *call = session_call_new(bus, directory);
    call->resumes = !begins;
    call->process = chosen.process;
    bus_jobs_start(&bus->jobs, &request, invocation, on_prepared, call, session_call_free);
    return TRUE;
}

/* Returns the text of a file that the queue keeps: `given` or, if `given` is NULL, the contents of
 * path. Returns "" if path is NULL. Returns NULL with an error if the file cannot be read or is not
 * UTF-8. */
static char *kept_text(const char *path, const char *given, GError **error) {
    if (!path)
        return g_strdup("");
    g_autofree char *text = given ? g_strdup(given) : input_file_read_text(path, MAX_TEXT, error);
    if (text && !g_utf8_validate(text, -1, NULL)) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_DATA,
                    "%s is not UTF-8 text: save it as UTF-8", path);
        return NULL;
    }
    return g_steal_pointer(&text);
}

gboolean bus_add_to_queue(Bus *bus, GDBusMethodInvocation *invocation, const char *session_path,
                          const char *directory, GVariant *options, GError **error) {
    const struct bus_caller *caller = bus_authority_caller(invocation);
    g_auto(BusOptions) chosen = {0};
    if (!bus_unattended_need_queue(bus->unattended, error) ||
        !bus_rig_need_open(&bus->rig, error) || !devices_check_file(bus->rig.devices, error) ||
        !bus_need_absolute(session_path, error) || !bus_need_absolute(directory, error) ||
        !bus_options_read(options, &chosen, error) ||
        !check_calibration(chosen.calibration, chosen.calibration_text, TRUE, error) ||
        !check_readable(invocation, session_path, chosen.session_text, "session_text", error) ||
        !check_readable(invocation, chosen.calibration, chosen.calibration_text, "calibration_text",
                        error) ||
        !bus_jobs_may_check(&bus->jobs, invocation, error))
        return FALSE;
    g_autofree char *session_text = kept_text(session_path, chosen.session_text, error);
    g_autofree char *calibration_text =
        session_text ? kept_text(chosen.calibration, chosen.calibration_text, error) : NULL;
    if (!calibration_text)
        return FALSE;
    struct preparer_request request = {.task = PREPARER_CHECK,
                                       .session_path = session_path,
                                       .session_text = session_text,
                                       .directory = directory,
                                       .calibration = chosen.calibration,
                                       .calibration_text = calibration_text,
                                       .caller = caller};
    struct queue_item *item = queue_item_new();
    const struct {
        char **to;
        const char *text;
    } texts[] = {{&item->session_path, session_path},
                 {&item->session_text, session_text},
                 {&item->directory, directory},
                 {&item->rig, bus->rig.path},
                 {&item->calibration, chosen.calibration ? chosen.calibration : ""},
                 {&item->calibration_text, calibration_text},
                 {&item->chosen, chosen.exposures ? chosen.exposures : ""}};
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_free(*texts[i].to);
        *texts[i].to = g_strdup(texts[i].text);
    }
    item->process = chosen.process;
    item->yes = chosen.yes;
    item->has_caller = caller != NULL;
    if (caller) {
        item->uid = caller->uid;
        g_array_append_vals(item->groups, caller->groups, (guint)caller->n_groups);
    }
    struct session_call *call = session_call_new(bus, directory);
    call->item = item;
    bus_jobs_start(&bus->jobs, &request, invocation, on_checked_for_queue, call, session_call_free);
    return TRUE;
}
