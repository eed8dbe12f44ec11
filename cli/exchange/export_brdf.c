/* export bsdf, export merl: write the mean BRDF of all texels of a material. */
#include "formats/reflectance/export_brdf.h"
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"

#include <stdio.h>

static char *output, *region, *texel;
static gboolean isotropic;

static const GOptionEntry bsdf_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The file to write", "FILE.bsdf"},
    {"region", 0, 0, G_OPTION_ARG_STRING, &region, "Use only the mean of these texels",
     "X,Y,WIDTH,HEIGHT"},
    {"texel", 0, 0, G_OPTION_ARG_STRING, &texel, "This texel only", "X,Y"},
    {"isotropic", 0, 0, G_OPTION_ARG_NONE, &isotropic,
     "Write the mean over rotations about the normal, in a thirtieth of the size", NULL},
    {NULL},
};

static const GOptionEntry merl_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The file to write", "FILE.binary"},
    {"region", 0, 0, G_OPTION_ARG_STRING, &region, "Use only the mean of these texels",
     "X,Y,WIDTH,HEIGHT"},
    {"texel", 0, 0, G_OPTION_ARG_STRING, &texel, "This texel only", "X,Y"},
    {NULL},
};

struct job {
    const char *material;
    OutputFile *to;
    struct export_brdf_options options;
    struct export_brdf_result result;
};

static gboolean export_brdf_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    const char *path = output_file_path(job->to, error);
    return path &&
           output_file_end(
               job->to, export_brdf(job->material, path, &job->options, work, &job->result, error),
               error);
}

static gboolean export_brdf_texel(struct import_region *ret) {
    char more;
    ret->width = ret->height = 1;
    return sscanf(texel, "%d,%d%c", &ret->x, &ret->y, &more) == 2 && ret->x >= 0 && ret->y >= 0;
}

static int run(const struct call *call, enum brdf_kind kind, GError **error) {
    const struct command *command = call->command;
    struct job job = {.material = call->arguments[0],
                      .options = {.kind = kind, .isotropic = isotropic}};
    const struct export_brdf_result *result = &job.result;
    Record *to = call->record;
    double seconds = 0;
    if (region && texel)
        return cli_usage(command, "--region and --texel exclude each other");
    if (region && !exchange_parse_region(region, &job.options.region))
        return cli_usage(command, "--region=%s: give X,Y,WIDTH,HEIGHT in texels", region);
    if (texel && !export_brdf_texel(&job.options.region))
        return cli_usage(command, "--texel=%s: give X,Y, counted from 0", texel);
    const struct exchange_format format = {"BRDFs",
                                           kind == BRDF_MERL ? "MERL's format" : "RGL's format",
                                           kind == BRDF_MERL ? ".binary" : ".bsdf", NULL};
    g_autoptr(OutputFile) file = job.to = exchange_output(output, &format, error);
    if (!file || !cli_work_run(export_brdf_work, &job, &seconds, error))
        return CLI_FAILED;
    record_say(to, "%s{file}: %d{views} %s × %d{lights} %s of ", output,
               PLURAL(result->n_views, "view"), PLURAL(result->n_lights, "light"));
    record_say(to, "the mean of %d{width} × %d{height} texels", result->width, result->height);
    record_add(to, "%" G_GINT64_FORMAT "{holes} %d{filled}", result->holes, result->filled);
    record_say(
        to,
        ", in %g{:time}; beyond %.0f{lowest_deg}° nothing was measured; interpolated with an "
        "error of %.2f{error:%%}\n",
        seconds, result->lowest_deg, result->error);
    if (kind == BRDF_MERL)
        record_say(to,
                   "the file is isotropic and reciprocal; the material's values under rotated or "
                   "exchanged directions differ from it by %.1f{spread:%%}\n",
                   result->spread);
    record_double(to, "real_s", seconds);
    if (result->filled > 0)
        record_say(to,
                   "%d pairs of view and light have no value and get that of the nearest light\n",
                   result->filled);
    cli_tell_output(to, file);
    return CLI_DONE;
}

static int bsdf_run(const struct call *call, GError **error) {
    return run(call, BRDF_RGL, error);
}
static int merl_run(const struct call *call, GError **error) {
    return run(call, BRDF_MERL, error);
}

const struct command exchange_bsdf = {
    .name = "export bsdf",
    .arguments = "DIR|FILE -o FILE.bsdf",
    .examples = "  mesorig export bsdf weave.session -o weave.bsdf\n",
    .help = "Write the mean BRDF of all texels of a material in the format of RGL.",
    .options = bsdf_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = bsdf_run};
const struct command exchange_merl = {
    .name = "export merl",
    .arguments = "DIR|FILE -o FILE.binary",
    .examples = "  mesorig export merl weave.session -o weave.binary\n",
    .help = "Write the mean BRDF of all texels of a material, isotropic, in the format of MERL.",
    .options = merl_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = merl_run};
