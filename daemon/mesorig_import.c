/* import: other people's measurements, made into a session. */
#include "mesorig_cli.h"
#include "mesorig_work.h"
#include "processing/import.h"
#include "report.h"

#include <stdio.h>
#include <string.h>

static char *output, *region;
static double texel_mm;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The session to make", "DIR"},
    {"texel", 't', 0, G_OPTION_ARG_DOUBLE, &texel_mm, "How wide a texel is, in mm", "MM"},
    {"region", 'r', 0, G_OPTION_ARG_STRING, &region, "Only these texels", "X,Y,WIDTH,HEIGHT"},
    {NULL},
};

typedef gboolean (*Import)(const char *path, const char *source, const struct import_wish *wish,
                           const struct import_progress *progress, struct import_result *ret,
                           GError **error);

static const struct kind {
    const char *name;
    Import import;
} kinds[] = {
    {"btf", import_bonn},
    {"pictures", import_pictures},
    {"rti", import_rti},
};

struct job {
    const struct kind *kind;
    const char *source;
    struct import_wish wish;
    struct import_result result;
};

static gboolean work(PipelineFunc progress, gpointer progress_data, GCancellable *cancellable,
                     gpointer data, GError **error) {
    struct job *job = data;
    const struct import_progress to = {progress, progress_data, cancellable};
    return job->kind->import(output, job->source, &job->wish, &to, &job->result, error);
}

static void tell(const struct job *job, double seconds) {
    const struct import_result *result = &job->result;
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "session", g_variant_new_string(output));
        g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->n_views));
        g_variant_builder_add(&builder, "{sv}", "lights", g_variant_new_int32(result->n_lights));
        g_variant_builder_add(&builder, "{sv}", "width", g_variant_new_int32(result->width));
        g_variant_builder_add(&builder, "{sv}", "height", g_variant_new_int32(result->height));
        g_variant_builder_add(&builder, "{sv}", "holes", g_variant_new_int64(result->holes));
        g_variant_builder_add(&builder, "{sv}", "eigenmaps_error",
                              g_variant_new_double(result->eigenmaps_error));
        g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
        cli_print_json(g_variant_builder_end(&builder));
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_print("%s: %d × %d texels, %d views × %d lights in %s; eigen-maps with an error of %.2f %%\n",
            output, result->width, result->height, result->n_views, result->n_lights, time,
            100 * result->eigenmaps_error);
    if (result->holes > 0)
        g_print("%" G_GINT64_FORMAT
                " texels of its pictures are missing or no numbers, and are 0\n",
                result->holes);
}

static gboolean parse_region(const char *text, struct import_region *ret) {
    char more;
    return sscanf(text, "%d,%d,%d,%d%c", &ret->x, &ret->y, &ret->width, &ret->height, &more) == 4 &&
           ret->x >= 0 && ret->y >= 0 && ret->width > 0 && ret->height > 0;
}

static int run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    struct job job = {0};
    double seconds = 0;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 2, 2))
        return CLI_USAGE;
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (strcmp(argv[1], kinds[i].name) == 0)
            job.kind = &kinds[i];
    if (!job.kind)
        return cli_usage(command, "“%s” is none of btf, pictures, rti", argv[1]);
    if (!output)
        return cli_usage(command, "where to? Give -o DIR.session");
    if (texel_mm < 0 || texel_mm > 1000)
        return cli_usage(command, "--texel needs millimetres");
    if (region && !parse_region(region, &job.wish.region))
        return cli_usage(command, "--region needs X,Y,WIDTH,HEIGHT in texels");
    job.source = argv[2];
    job.wish.texel_mm = texel_mm;
    if (!work_run(work, &job, &seconds, &error))
        return cli_fail(error);
    tell(&job, seconds);
    return CLI_DONE;
}

const struct command cli_import = {"import", "KIND SOURCE -o DIR",
                                   "Make a session of what others have measured. KIND: btf (a file "
                                   "of Bonn's), pictures (a folder, "
                                   "names with tl… pl… tv… pv…), rti (an .lp list of lights).",
                                   run};
