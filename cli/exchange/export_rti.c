/* export ptm, relight: one view of a session as functions of the light. */
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"
#include "formats/reflectance/export_brdf.h"

#include <string.h>

static char *output, *format;
static int view = -1;

static const GOptionEntry ptm_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The file to write", "FILE.ptm"},
    {"format", 0, 0, G_OPTION_ARG_STRING, &format,
     "A brightness and a colour, or a sum for each colour (lrgb)", "lrgb|rgb"},
    {"view", 0, 0, G_OPTION_ARG_INT, &view, "The view (the one nearest to the normal)", "N"},
    {NULL},
};

static const GOptionEntry relight_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The folder to make", "DIR"},
    {"format", 0, 0, G_OPTION_ARG_STRING, &format,
     "A brightness and a colour, or a sum for each colour (lrgb)", "lrgb|rgb"},
    {"view", 0, 0, G_OPTION_ARG_INT, &view, "The view (the one nearest to the normal)", "N"},
    {NULL},
};

struct job {
    const char *session;
    OutputFile *to; /* NULL for a folder */
    struct export_rti_options options;
    struct export_rti_result result;
};

static gboolean export_rti_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    const char *path = job->to ? output_file_path(job->to, error) : output;
    const gboolean ok =
        path && export_rti(job->session, path, &job->options, work, &job->result, error);
    return path && (job->to ? output_file_end(job->to, ok, error) : ok);
}

static int run(const struct call *call, enum export_rti_kind kind, GError **error) {
    struct job job = {.session = call->arguments[0],
                      .options = {.kind = kind,
                                  .rgb = format && strcmp(format, "rgb") == 0,
                                  .view = view,
                                  .replace = cli_force}};
    const struct export_rti_result *result = &job.result;
    Record *to = call->record;
    double seconds = 0;
    if (format && strcmp(format, "rgb") != 0 && strcmp(format, "lrgb") != 0)
        return cli_usage(call->command, "there is no --format=%s; choose from: lrgb, rgb", format);
    if (view < -1)
        return cli_usage(call->command, "--view=%d is out of range: 0 or more", view);
    static const struct exchange_format ptm = {"PTMs", "their own format", ".ptm", NULL};
    g_autoptr(OutputFile) file = NULL;
    if (!(kind == EXPORT_PTM ? (file = job.to = exchange_output(output, &ptm, error)) != NULL
                             : exchange_check_folder(output, error)) ||
        !cli_work_run(export_rti_work, &job, &seconds, error))
        return CLI_FAILED;
    record_say(to,
               "%s{file}: view %d{view} (%.0f{theta_deg}° from the normal) under %d{lights} %s, "
               "%d{width} × %d{height} texels in %g{:time}, with an error of %.2f{:%%} of white in "
               "sRGB\n",
               output, result->view, result->theta_deg, PLURAL(result->n_lights, "light"),
               result->width, result->height, seconds, result->error);
    record_say_if(to, result->clipped > 0,
                  "%" G_GINT64_FORMAT
                  "{clipped} values are brighter than white, which viewers clip\n",
                  result->clipped);
    record_add(to, "%" G_GINT64_FORMAT "{holes} %g{error} %g{real_s}", result->holes, result->error,
               seconds);
    if (file)
        cli_tell_output(to, file);
    return CLI_DONE;
}

static int ptm_run(const struct call *call, GError **error) {
    return run(call, EXPORT_PTM, error);
}
static int relight_run(const struct call *call, GError **error) {
    return run(call, EXPORT_RELIGHT, error);
}

const struct command exchange_ptm = {
    .name = "export ptm",
    .arguments = "DIR -o FILE.ptm",
    .examples = "  mesorig export ptm coin.session -o coin.ptm\n",
    .help = "Write a view of a session as a polynomial texture map, for RTI viewers.",
    .options = ptm_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = ptm_run};
const struct command exchange_relight = {
    .name = "export relight",
    .arguments = "DIR -o DIR",
    .examples = "  mesorig export relight coin.session -o coin\n",
    .help = "Write a view of a session as a folder for OpenLIME, as Relight does.",
    .options = relight_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = relight_run};
