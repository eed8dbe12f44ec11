/* export: the products of a session, for other programs. */
#include "command/cli.h"
#include "command/work.h"
#include "formats/export_surface.h"
#include "lpca/lpca.h"
#include "normals/fit_normals.h"
#include "plan/report.h"

#include <string.h>

#define COMPONENTS 24

static char *output, *format;
static int components, least_views;
static gboolean layered, maximum;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The file to write", "FILE"},
    {"format", 0, 0, G_OPTION_ARG_STRING, &format, "btf: how the values are stored (bdi)",
     "bdi|fmf|dfmf"},
    {"components", 0, 0, G_OPTION_ARG_INT, &components, "fmf, dfmf: number of components (24)",
     "N"},
    {"views", 0, 0, G_OPTION_ARG_INT, &least_views,
     "points: least number of views that saw each (2)", "N"},
    {"layered", 0, 0, G_OPTION_ARG_NONE, &layered,
     "height, normals: write the upper layer if the surface is not a height field", NULL},
    {"maximum", 0, 0, G_OPTION_ARG_NONE, &maximum,
     "height, normals of a PTM: the light of its greatest value", NULL},
    {NULL},
};

struct job {
    const char *session;
    enum bonn_kind kind;
    struct export_bonn_result btf;
    struct export_surface_options options;
    struct export_surface_result surface;
    struct fit_normals_result fit;
};

/* KIND determines what is written; the file's name must not contradict it. */
static gboolean export_check_name(const char *what, const char *format_name, const char *end,
                                  GError **error) {
    g_autofree char *lower = g_ascii_strdown(output, -1);
    if (g_str_has_suffix(lower, end))
        return TRUE;
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_FILENAME,
                "%s: %s are written as %s; give a name that ends in %s", output, what, format_name,
                end);
    return FALSE;
}

static gboolean work_btf(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return export_bonn(job->session, output, job->kind, components ? components : COMPONENTS, work,
                       &job->btf, error);
}

static int export_btf(const struct call *call, struct job *job, GError **error) {
    const struct export_bonn_result *result = &job->btf;
    Record *to = call->record;
    double seconds = 0;
    if (format && (!bonn_kind_parse(format, &job->kind) || job->kind == BONN_BDI_SPARSE))
        return cli_usage(call->command, "there is no --format=%s; choose from: bdi, fmf, dfmf",
                         format);
    if (components < 0 || components > LPCA_MAX_COMPONENTS)
        return cli_usage(call->command, "--components=%d is out of range: 1 to %d", components,
                         LPCA_MAX_COMPONENTS);
    if (!export_check_name("BTFs", "Bonn's format", ".btf", error) ||
        !cli_work_run(work_btf, job, &seconds, error))
        return CLI_FAILED;
    g_autofree char *time = report_duration(seconds);
    record_string(to, "file", output);
    record_int(to, "views", result->n_views);
    record_int(to, "lights", result->n_lights);
    record_int(to, "width", result->width);
    record_int(to, "height", result->height);
    record_double(to, "error", result->error);
    record_double(to, "real_s", seconds);
    record_say(to, "%s: %d × %d texels, %d views × %d lights as %s in %s", output, result->width,
               result->height, result->n_views, result->n_lights, bonn_kind_name(job->kind), time);
    if (result->error > 0)
        record_say(to, ", with an error of %.2f %%", 100 * result->error);
    record_say(to, "\n");
    return CLI_DONE;
}

static gboolean work_surface(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return export_surface(job->session, output, &job->options, work, &job->surface, error);
}

static gboolean work_fit(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return fit_normals(job->session, output, job->options.what == EXPORT_HEIGHT,
                       maximum ? FIT_NORMALS_MAXIMUM : FIT_NORMALS_LAMBERT, work, &job->fit, error);
}

/* From how brightness depends on the light, where no laser has measured the surface. */
static int export_by_fit(const struct call *call, struct job *job, GError **error) {
    const struct fit_normals_result *result = &job->fit;
    Record *to = call->record;
    double seconds = 0;
    if (least_views || layered)
        return cli_usage(call->command,
                         "--views and --layered are for materials with an MDF; %s "
                         "has none",
                         job->session);
    if (!cli_work_run(work_fit, job, &seconds, error))
        return CLI_FAILED;
    record_string(to, "file", output);
    record_string(to, "model", result->model);
    record_int(to, "points", result->texels - result->holes);
    record_int(to, "holes", result->holes);
    record_int(to, "clipped", result->clipped);
    record_int(to, "shadowed", result->shadowed);
    record_double(to, "real_s", seconds);
    record_say(to, "%s: %d of %d texels from their %s", output, result->texels - result->holes,
               result->texels, result->model);
    if (maximum)
        record_say(to, "; %d texels are holes, since their maximum is clipped\n", result->clipped);
    else
        record_say(to,
                   "; %d are in shadow or shine under more than a quarter of the lights they "
                   "face, and are less certain\n",
                   result->shadowed);
    return CLI_DONE;
}

static int export_shape(const struct call *call, struct job *job, enum export_surface what,
                        GError **error) {
    const struct export_surface_result *result = &job->surface;
    Record *to = call->record;
    double seconds = 0;
    if (least_views < 0 || least_views > 255)
        return cli_usage(call->command, "--views=%d is out of range: 1 to 255", least_views);
    if (!(what == EXPORT_POINTS ? export_check_name("points", "PLY", ".ply", error)
                                : export_check_name("maps", "OpenEXR", ".exr", error)))
        return CLI_FAILED;
    job->options = (struct export_surface_options){
        .what = what, .least_views = least_views, .layered = layered};
    if (what != EXPORT_POINTS && fit_normals_applies(job->session))
        return export_by_fit(call, job, error);
    if (maximum)
        return cli_usage(call->command,
                         "--maximum is for height and normals of a PTM; %s is to be "
                         "exported from its MDF",
                         job->session);
    if (!cli_work_run(work_surface, job, &seconds, error))
        return CLI_FAILED;
    record_string(to, "file", output);
    record_int(to, "views", result->n_views);
    record_int(to, "seen", result->seen);
    record_int(to, "points", result->points);
    record_int(to, "holes", result->holes);
    record_int(to, "stacked", result->stacked);
    record_double(to, "real_s", seconds);
    if (what == EXPORT_POINTS)
        record_say(to,
                   "%s: %" G_GINT64_FORMAT " points; %d views saw %" G_GINT64_FORMAT
                   ", and points that several views saw were merged into one\n",
                   output, result->points, result->n_views, result->seen);
    else
        record_say(to,
                   "%s: %" G_GINT64_FORMAT " of %d texels from %d views, %d holes, %d with "
                   "structure below structure\n",
                   output, result->points, result->texels, result->n_views, result->holes,
                   result->stacked);
    return CLI_DONE;
}

static int cli_export_run(const struct call *call, GError **error) {
    const char *kind = call->arguments[0];
    struct job job = {.session = call->arguments[1], .kind = BONN_BDI};
    if (!output)
        return cli_usage(call->command, "no file to write is given: give -o FILE");
    if (strcmp(kind, "btf") == 0)
        return export_btf(call, &job, error);
    if (strcmp(kind, "points") == 0)
        return export_shape(call, &job, EXPORT_POINTS, error);
    if (strcmp(kind, "height") == 0)
        return export_shape(call, &job, EXPORT_HEIGHT, error);
    if (strcmp(kind, "normals") == 0)
        return export_shape(call, &job, EXPORT_NORMALS, error);
    return cli_usage(call->command,
                     "there is no KIND “%s”; choose from: btf, points, height, normals", kind);
}

static const char *const kind_words[] = {"btf", "points", "height", "normals", NULL};

const struct command cli_export = {
    .words = kind_words,
    .name = "export",
    .arguments = "KIND DIR -o FILE",
    .examples = "  mesorig export btf weave.session -o weave.btf\n"
                "  mesorig export normals weave.session -o normals.exr\n",
    .help =
        "Write what a session has become for other programs. KIND: btf (a .btf of Bonn's), "
        "points (of "
        "the structure, with normals: PLY), height, normals (maps: EXR; of a session without MDF, "
        "from its PTM or HSH, or such a file).",
    .options = entries,
    .min = 2,
    .max = 2,
    .run = cli_export_run};
