/* plan: shows a plan. drivers: lists the available drivers. */
#include "base/nearest.h"
#include "capture/capture.h"
#include "capture/capture_calibration.h"
#include "captures.h"
#include "common/cli.h"
#include "common/link.h"
#include "common/plot.h"
#include "plan/adaptive/expected.h"
#include "plan/report.h"
#include "rig/devices.h"

#include <gio/gio.h>

static char *output, *calibration, *curve, *like;
static gboolean offline;
static const GOptionEntry entries[] = {
    {"offline", 0, 0, G_OPTION_ARG_NONE, &offline,
     "Ask no daemon and no device; values that only a device can tell are assumed", NULL},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration,
     "Show this calibration in the last line instead of the one that the rig file names", "FILE"},
    {"curve", 0, 0, G_OPTION_ARG_FILENAME, &curve,
     "Draw the expected error of the BTF against the time for lamps, if [lights] sampling is "
     "adaptive (.svg or .png)",
     "FILE"},
    {"like", 0, 0, G_OPTION_ARG_FILENAME, &like,
     "With --curve: expect a material like that of this session (no particular material)", "DIR"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "Also check whether a capture into this session directory is possible", "DIR"},
    {NULL},
};

/* Lets the daemon that has the rig open make the plan. Returns NULL with an error on failure. */
static GVariant *remotely(Link *link, const char *session, const char *directory, GError **error) {
    gboolean ok = FALSE;
    g_autofree char *text = NULL;
    g_autoptr(GVariant) plan = NULL;
    g_auto(GVariantDict) options;
    g_variant_dict_init(&options, NULL);
    if (!link_add_text(link, &options, "session_text", session, error) ||
        !bus_rig1_call_validate_sync(link_rig(link), session, directory,
                                     g_variant_dict_end(&options), &ok, &text, &plan, NULL, error))
        return NULL;
    if (!ok)
        g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_FAILED, text);
    return ok ? g_steal_pointer(&plan) : NULL;
}

/* Joins the errors of rig file and session file in *error, so that one run reports all mistakes.
 * Each of the two errors may be NULL. */
static void join_errors(GError *of_rig, GError *of_session, GError **error) {
    if (of_rig && of_session) {
        g_prefix_error(&of_session, "%s\n", of_rig->message);
        g_clear_error(&of_rig);
    }
    g_propagate_error(error, of_rig ? of_rig : of_session);
}

static GVariant *here(const char *rig, const char *session, const char *directory, GError **error) {
    struct session_conf conf = {0};
    GError *of_rig = NULL, *of_session = NULL;
    const gboolean read = session_conf_load(&conf, session, &of_session);
    struct devices *devices = devices_open(rig, &of_rig);
    struct plan *plan = NULL;
    if (!read || !devices)
        join_errors(of_rig, of_session, error);
    else
        plan = *directory ? capture_validate(devices, &conf, directory, error)
                          : plan_build(&conf, &devices->geometry, &devices->timing, error);
    GVariant *report = plan ? g_variant_ref_sink(report_plan(&conf, plan)) : NULL;
    plan_free(plan);
    devices_close(devices);
    session_conf_clear(&conf);
    return report;
}

/* Makes a plan from the rig file, without its devices. Assumptions about devices are added to
 * the plan's notes. */
static GVariant *plan_offline(const char *rig_path, const char *session, GError **error) {
    struct session_conf conf = {0};
    struct rig rig;
    struct rig_timing timing;
    GError *of_rig = NULL, *of_session = NULL;
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    const gboolean read = session_conf_load(&conf, session, &of_session);
    const gboolean timed = devices_read_timing(rig_path, &rig, &timing, assumed, &of_rig);
    struct plan *plan = NULL;
    if (!read || !timed)
        join_errors(of_rig, of_session, error);
    else
        plan = plan_build(&conf, &rig, &timing, error);
    for (guint i = 0; plan && i < assumed->len; i++)
        g_ptr_array_add(plan->notes, g_strdup(assumed->pdata[i]));
    GVariant *report = plan ? g_variant_ref_sink(report_plan(&conf, plan)) : NULL;
    plan_free(plan);
    session_conf_clear(&conf);
    return report;
}

/* Draws the plot of --curve, and adds its points to the record. */
static gboolean draw_curve(Record *to, OutputFile *file, const char *rig_path, const char *session,
                           GError **error) {
    g_auto(SessionConf) conf = {0};
    struct rig rig;
    struct rig_timing timing;
    g_autoptr(GPtrArray) assumed = g_ptr_array_new_with_free_func(g_free);
    if (!session_conf_load(&conf, session, error) ||
        !devices_read_timing(rig_path, &rig, &timing, assumed, error))
        return FALSE;
    g_autoptr(Plan) plan = plan_build(&conf, &rig, &timing, error);
    g_autoptr(GArray) points =
        plan ? expected_curve(&conf, &rig, &timing, plan, like, NULL, error) : NULL;
    if (!points)
        return FALSE;
    g_autofree const struct session_shot **lamps =
        g_new(const struct session_shot *, plan->session.n_shots + 1);
    int n = 0;
    for (int i = 0; i < plan->session.n_shots; i++)
        if (plan->session.shots[i].kind == SHOT_LAMP &&
            plan->session.shots[i].state == SHOT_PLANNED)
            lamps[n++] = &plan->session.shots[i];
    const double all_s = plan_lamps_s(lamps, n, &conf, &rig, &timing);
    g_autofree struct plot_time *drawn = g_new(struct plot_time, points->len + 1);
    record_begin_list(to, "curve");
    for (guint i = 0; i < points->len; i++) {
        const struct expected_point *point = &g_array_index(points, struct expected_point, i);
        drawn[i] = (struct plot_time){point->shots, point->time_s / 60, point->error_pct};
        record_begin(to, NULL);
        record_add(to, "%d{shots} %g{time_s} %g{expected_error_pct}", point->shots, point->time_s,
                   point->error_pct);
        record_end(to);
    }
    record_end(to);
    g_autofree char *title = g_strdup_printf("%s: expected error against time", conf.name);
    g_autofree char *base = like ? g_path_get_basename(like) : NULL;
    g_autofree char *text =
        base ? g_strdup_printf("relative RMS error of all pictures, %d shots of lamps; a material "
                               "like that of %s",
                               n, base)
             : g_strdup_printf("relative RMS error of all pictures, %d shots of lamps; no "
                               "particular material",
                               n);
    const char *path = output_file_path(file, error);
    if (!path ||
        !output_file_end(
            file, plot_times(path, title, text, all_s / 60, drawn, (int)points->len, error), error))
        return FALSE;
    record_say(to, "curve           %s{curve_file}\n", curve);
    record_double(to, "all_lamps_s", all_s);
    cli_tell_output(to, file);
    return TRUE;
}

static int run_plan(const struct call *call, GError **error) {
    GError *failed = NULL;
    g_autofree char *rig = g_canonicalize_filename(call->arguments[0], NULL);
    g_autofree char *session = g_canonicalize_filename(call->arguments[1], NULL);
    g_autofree char *directory = output ? g_canonicalize_filename(output, NULL) : g_strdup("");
    if (offline && output) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "--offline asks no daemon, so it cannot check the directory --output %s: leave "
                    "out --output or --offline",
                    output);
        return CLI_FAILED;
    }
    if (like && !curve) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "--like %s needs --curve FILE: give both", like);
        return CLI_FAILED;
    }
    g_autoptr(OutputFile) drawing = NULL;
    if ((curve && !(drawing = cli_output(curve, "plot", error))) ||
        !plan_check_order(rig, session, error))
        return CLI_FAILED;
    g_autoptr(Link) link = offline ? NULL : link_find_rig(rig, &failed);
    g_autoptr(GVariant) report = NULL;
    if (!failed)
        report = offline ? plan_offline(rig, session, &failed)
                 : link  ? remotely(link, session, directory, &failed)
                         : here(rig, session, directory, &failed);
    if (!report) {
        g_propagate_error(error, failed);
        return CLI_FAILED;
    }
    g_autofree char *line = capture_calibration_line(rig, calibration, error);
    if (!line)
        return CLI_FAILED;
    g_autofree char *text = report_text(report);
    record_variants(call->record, report);
    record_say(call->record, "%scalibration     %s{calibration}\n", text, line);
    return !drawing || draw_curve(call->record, drawing, rig, session, error) ? CLI_DONE
                                                                              : CLI_FAILED;
}

static int run_drivers(const struct call *call, GError **error) {
    const char *name = call->arguments[0];
    g_autofree char *text = devices_describe_drivers(name, cli_json);
    if (text && *text) {
        g_print("%s%s%s", text, g_str_has_suffix(text, "\n") ? "" : "\n",
                name || cli_json ? "" : "“mesorig drivers NAME” lists the options of one.\n");
        return CLI_DONE;
    }
    struct nearest nearest = nearest_new(name ? name : "");
    for (gsize i = 0; devices_driver(i); i++)
        nearest_consider(&nearest, devices_driver(i)->name);
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND, "there is no driver “%s”; %s%s%s", name,
                nearest.name ? "did you mean “" : "“mesorig drivers” lists the drivers",
                nearest.name ? nearest.name : "", nearest.name ? "”?" : "");
    return CLI_FAILED;
}

const struct command cli_plan = {
    .name = "plan",
    .arguments = "RIG SESSION",
    .examples = "  mesorig plan rig.conf session.conf\n"
                "  mesorig plan rig.conf session.conf --json | jq .bytes\n"
                "  mesorig plan rig.conf session.conf --curve curve.svg "
                "--like weave.session\n",
    .help = "Check a session file, and predict order and time of its capture.",
    .options = entries,
    .daemon = TRUE,
    .writes = TRUE,
    .min = 2,
    .max = 2,
    .run = run_plan};
const struct command cli_drivers = {.name = "drivers",
                                    .arguments = "[NAME]",
                                    .examples = "  mesorig drivers\n"
                                                "  mesorig drivers modbus-axis\n",
                                    .help = "List the drivers and their options in a rig file.",
                                    .max = 1,
                                    .run = run_drivers};
