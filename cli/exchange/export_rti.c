/* export ptm, relight: write one view of a session as functions of the light. */
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"
#include "formats/reflectance/export_brdf.h"

#include <string.h>

static char *output, *format;
static int view = -1;

#define SHARED_ENTRIES                                                                             \
    {"format",                                                                                     \
     0,                                                                                            \
     0,                                                                                            \
     G_OPTION_ARG_STRING,                                                                          \
     &format,                                                                                      \
     "lrgb: one polynomial for the brightness and a constant colour; rgb: a polynomial for "       \
     "each colour (lrgb)",                                                                         \
     "lrgb|rgb"},                                                                                  \
    {                                                                                              \
        "view", 0, 0, G_OPTION_ARG_INT, &view,                                                     \
            "Number of the view (the view nearest to the normal)", "N"                             \
    }

static const GOptionEntry ptm_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "File to write", "FILE.ptm"},
    SHARED_ENTRIES,
    {NULL},
};

static const GOptionEntry relight_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Folder to make", "DIR"},
    SHARED_ENTRIES,
    {NULL},
};

struct rti_export {
    const char *session;
    struct export_rti_options options;
    struct export_rti_result result;
};

static gboolean write_rti(const char *path, const struct work *work, gpointer data,
                          GError **error) {
    struct rti_export *export = data;
    return export_rti(export->session, path, &export->options, work, &export->result, error);
}

static gboolean write_folder(const struct work *work, gpointer data, GError **error) {
    return write_rti(output, work, data, error);
}

static int run(const struct call *call, enum export_rti_kind kind, GError **error) {
    struct rti_export export = {.session = call->arguments[0],
                                .options = {.kind = kind,
                                            .rgb = format && strcmp(format, "rgb") == 0,
                                            .view = view,
                                            .replace = cli_force}};
    const struct export_rti_result *result = &export.result;
    Record *to = call->record;
    double seconds = 0;
    if (format && strcmp(format, "rgb") != 0 && strcmp(format, "lrgb") != 0)
        return cli_usage(call->command, "there is no --format=%s; choose from: lrgb, rgb", format);
    if (view < -1)
        return cli_usage(call->command, "--view=%d is out of range: 0 or more", view);
    static const struct exchange_format ptm = {"PTMs", "their own format", ".ptm", NULL};
    g_autoptr(OutputFile) file = kind == EXPORT_PTM ? exchange_output(output, &ptm, error) : NULL;
    const gboolean ok = kind == EXPORT_PTM
                            ? file && cli_work_write(file, write_rti, &export, &seconds, error)
                            : exchange_check_folder(output, error) &&
                                  cli_work_run(write_folder, &export, &seconds, error);
    if (!ok)
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
    .help = "Export a view of a session as a polynomial texture map, for RTI viewers.",
    .options = ptm_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = ptm_run};
const struct command exchange_relight = {
    .name = "export relight",
    .arguments = "DIR -o DIR",
    .examples = "  mesorig export relight coin.session -o coin\n",
    .help = "Export a view of a session as a folder for OpenLIME, as Relight writes it.",
    .options = relight_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = relight_run};
