/* plan and drivers: what would be done, and with what. */
#include "capture/capture.h"
#include "cli.h"
#include "link.h"
#include "plan/report.h"
#include "rig/devices.h"

static char *output;
static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "Session directory it would be captured into: checks that too", "DIR"},
    {NULL},
};

/* By the daemon that has the rig open. */
static GVariant *plan_remotely(Link *link, const char *session, const char *directory,
                               GError **error) {
    gboolean ok = FALSE;
    g_autofree char *text = NULL;
    g_autoptr(GVariant) plan = NULL;
    if (!bus_rig1_call_validate_sync(link_rig(link), session, directory, &ok, &text, &plan, NULL,
                                     error))
        return NULL;
    if (ok)
        return g_steal_pointer(&plan);
    g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_FAILED, text);
    return NULL;
}

static GVariant *plan_here(const char *rig, const char *session, const char *directory,
                           GError **error) {
    struct session_conf conf = {0};
    if (!session_conf_load(&conf, session, error))
        return NULL;
    struct devices *devices = devices_open(rig, error);
    struct plan *plan = NULL;
    if (devices)
        plan = *directory ? capture_validate(devices, &conf, directory, error)
                          : plan_build(&conf, &devices->geometry, &devices->timing, error);
    GVariant *report = plan ? g_variant_ref_sink(report_plan(&conf, plan)) : NULL;
    plan_free(plan);
    devices_close(devices);
    session_conf_clear(&conf);
    return report;
}

static int run_plan(const struct command *command, int argc, char **argv) {
    GError *error = NULL;
    if (!cli_parse(command, entries, TRUE, &argc, &argv, 2, 2))
        return CLI_USAGE;
    g_autofree char *rig = cli_absolute(argv[1]);
    g_autofree char *session = cli_absolute(argv[2]);
    g_autofree char *directory = output ? cli_absolute(output) : g_strdup("");
    g_autoptr(Link) link = link_find_rig(rig, &error);
    g_autoptr(GVariant) report = NULL;
    if (!error)
        report = link ? plan_remotely(link, session, directory, &error)
                      : plan_here(rig, session, directory, &error);
    if (!report) {
        const int code = cli_fail(error);
        g_error_free(error);
        return code;
    }
    if (cli_json) {
        cli_print_json(report);
    } else {
        g_autofree char *text = report_text(report);
        g_print("%s", text);
    }
    return CLI_DONE;
}

static int run_drivers(const struct command *command, int argc, char **argv) {
    if (!cli_parse(command, NULL, FALSE, &argc, &argv, 0, 1))
        return CLI_USAGE;
    g_autofree char *text = devices_describe_drivers(argc > 1 ? argv[1] : NULL, cli_json);
    if (!text || !*text) {
        g_autoptr(GError) error =
            g_error_new(G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
                        "no driver “%s”; “mesorig drivers” lists them", argc > 1 ? argv[1] : "");
        return cli_fail(error);
    }
    g_print("%s%s", text, g_str_has_suffix(text, "\n") ? "" : "\n");
    return CLI_DONE;
}

const struct command cli_plan = {.name = "plan",
                                 .arguments = "RIG SESSION",
                                 .help = "Check a session, and predict its order and time.",
                                 .run_arguments = run_plan};
const struct command cli_drivers = {.name = "drivers",
                                    .arguments = "[NAME]",
                                    .help = "List drivers and what they take in a rig file.",
                                    .run_arguments = run_drivers};
