/* export: what a session has become, for other programs. */
#include "cli.h"
#include "formats/export_surface.h"
#include "lpca/lpca.h"
#include "plan/report.h"
#include "work.h"

#include <string.h>

#define COMPONENTS 24

static char *output, *format;
static int components, least_views;
static gboolean layered;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The file to write", "FILE"},
    {"format", 'f', 0, G_OPTION_ARG_STRING, &format, "btf: how the values are stored (bdi)",
     "bdi|fmf|dfmf"},
    {"components", 'c', 0, G_OPTION_ARG_INT, &components, "fmf, dfmf: how many (24)", "N"},
    {"views", 0, 0, G_OPTION_ARG_INT, &least_views, "points: that saw each of them, at least (2)",
     "N"},
    {"layered", 0, 0, G_OPTION_ARG_NONE, &layered,
     "height, normals: the upper layer of what is no height field", NULL},
    {NULL},
};

struct job {
    const char *session;
    enum bonn_kind kind;
    struct export_bonn_result btf;
    struct export_surface_options options;
    struct export_surface_result surface;
};

static gboolean work_btf(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return export_bonn(job->session, output, job->kind, components ? components : COMPONENTS, work,
                       &job->btf, error);
}

static void tell_btf(const struct job *job, double seconds) {
    const struct export_bonn_result *result = &job->btf;
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output));
        g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->n_views));
        g_variant_builder_add(&builder, "{sv}", "lights", g_variant_new_int32(result->n_lights));
        g_variant_builder_add(&builder, "{sv}", "width", g_variant_new_int32(result->width));
        g_variant_builder_add(&builder, "{sv}", "height", g_variant_new_int32(result->height));
        g_variant_builder_add(&builder, "{sv}", "error", g_variant_new_double(result->error));
        g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
        cli_print_json(g_variant_builder_end(&builder));
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_print("%s: %d × %d texels, %d views × %d lights as %s in %s", output, result->width,
            result->height, result->n_views, result->n_lights, bonn_kind_name(job->kind), time);
    if (result->error > 0)
        g_print(", with an error of %.2f %%", 100 * result->error);
    g_print("\n");
}

static int export_btf(const struct command *command, struct job *job) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    if (format && (!bonn_kind_parse(format, &job->kind) || job->kind == BONN_BDI_SPARSE))
        return cli_usage(command, "--format is bdi, fmf or dfmf");
    if (components < 0 || components > LPCA_MAX_COMPONENTS)
        return cli_usage(command, "--components is 1 to %d", LPCA_MAX_COMPONENTS);
    if (!cli_work_run(work_btf, job, &seconds, &error))
        return cli_fail(error);
    tell_btf(job, seconds);
    return CLI_DONE;
}

static gboolean work_surface(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return export_surface(job->session, output, &job->options, work, &job->surface, error);
}

static void tell_surface(const struct job *job, double seconds) {
    const struct export_surface_result *result = &job->surface;
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output));
        g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->n_views));
        g_variant_builder_add(&builder, "{sv}", "seen", g_variant_new_int64(result->seen));
        g_variant_builder_add(&builder, "{sv}", "points", g_variant_new_int64(result->points));
        g_variant_builder_add(&builder, "{sv}", "holes", g_variant_new_int32(result->holes));
        g_variant_builder_add(&builder, "{sv}", "stacked", g_variant_new_int32(result->stacked));
        g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
        cli_print_json(g_variant_builder_end(&builder));
        return;
    }
    if (job->options.what == EXPORT_POINTS)
        g_print("%s: %" G_GINT64_FORMAT " points of the %" G_GINT64_FORMAT " that %d views saw\n",
                output, result->points, result->seen, result->n_views);
    else
        g_print("%s: %" G_GINT64_FORMAT " of %d texels from %d views, %d holes, %d with structure "
                "below structure\n",
                output, result->points, result->texels, result->n_views, result->holes,
                result->stacked);
}

static int export_shape(const struct command *command, struct job *job, enum export_surface what) {
    g_autoptr(GError) error = NULL;
    double seconds = 0;
    if (least_views < 0 || least_views > 255)
        return cli_usage(command, "--views is 1 to 255");
    job->options = (struct export_surface_options){
        .what = what, .least_views = least_views, .layered = layered};
    if (!cli_work_run(work_surface, job, &seconds, &error))
        return cli_fail(error);
    tell_surface(job, seconds);
    return CLI_DONE;
}

static int cli_export_run(const struct command *command, int argc, char **argv) {
    struct job job = {.kind = BONN_BDI};
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 2, 2))
        return CLI_USAGE;
    if (!output)
        return cli_usage(command, "where to? Give -o FILE");
    job.session = argv[2];
    if (strcmp(argv[1], "btf") == 0)
        return export_btf(command, &job);
    if (strcmp(argv[1], "points") == 0)
        return export_shape(command, &job, EXPORT_POINTS);
    if (strcmp(argv[1], "height") == 0)
        return export_shape(command, &job, EXPORT_HEIGHT);
    if (strcmp(argv[1], "normals") == 0)
        return export_shape(command, &job, EXPORT_NORMALS);
    return cli_usage(command, "“%s” is none of btf, points, height, normals", argv[1]);
}

const struct command cli_export = {
    .name = "export",
    .arguments = "KIND DIR -o FILE",
    .help = "Write what a session has become for other programs. KIND: btf (a .btf of Bonn's), "
            "points (of "
            "the structure, with normals: PLY), height, normals (maps: EXR).",
    .run_arguments = cli_export_run};
