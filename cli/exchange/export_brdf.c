/* export bsdf, merl: write the mean BRDF of all texels of a material. */
#include "formats/reflectance/export_brdf.h"
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"

#include <stdio.h>

static char *output, *region, *texel;
static gboolean isotropic, rgb_only;

#define OUTPUT_ENTRY(name)                                                                         \
    { "output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "File to write", name }
#define SHARED_ENTRIES                                                                             \
    {"region",          0, 0, G_OPTION_ARG_STRING, &region, "Use only the mean of these texels",   \
     "X,Y,WIDTH,HEIGHT"},                                                                          \
    {                                                                                              \
        "texel", 0, 0, G_OPTION_ARG_STRING, &texel, "Use only this texel", "X,Y"                   \
    }

static const GOptionEntry bsdf_entries[] = {
    OUTPUT_ENTRY("FILE.bsdf"),
    SHARED_ENTRIES,
    {"isotropic", 0, 0, G_OPTION_ARG_NONE, &isotropic,
     "Write the mean over rotations about the normal, which takes a thirtieth of the size", NULL},
    {"rgb", 0, 0, G_OPTION_ARG_NONE, &rgb_only, "Write no spectra, for the RGB variants of Mitsuba",
     NULL},
    {NULL},
};

static const GOptionEntry merl_entries[] = {OUTPUT_ENTRY("FILE.binary"), SHARED_ENTRIES, {NULL}};

struct brdf_export {
    const char *material;
    struct export_brdf_options options;
    struct export_brdf_result result;
};

static gboolean write_brdf(const char *path, const struct work *work, gpointer data,
                           GError **error) {
    struct brdf_export *export = data;
    return export_brdf(export->material, path, &export->options, work, &export->result, error);
}

static gboolean parse_texel(struct import_region *ret) {
    char more;
    ret->width = ret->height = 1;
    return sscanf(texel, "%d,%d%c", &ret->x, &ret->y, &more) == 2 && ret->x >= 0 && ret->y >= 0;
}

static int run(const struct call *call, enum brdf_kind kind, GError **error) {
    const struct command *command = call->command;
    struct brdf_export export = {
        .material = call->arguments[0],
        .options = {.kind = kind, .isotropic = isotropic, .rgb_only = rgb_only}};
    const struct export_brdf_result *result = &export.result;
    Record *to = call->record;
    double seconds = 0;
    if (region && texel)
        return cli_usage(command, "give --region or --texel, not both");
    if (region && !exchange_parse_region(region, &export.options.region))
        return cli_usage(command, "--region=%s: give X,Y,WIDTH,HEIGHT in texels", region);
    if (texel && !parse_texel(&export.options.region))
        return cli_usage(command, "--texel=%s: give X,Y, counted from 0", texel);
    const struct exchange_format format = {"BRDFs",
                                           kind == BRDF_MERL ? "MERL's format" : "RGL's format",
                                           kind == BRDF_MERL ? ".binary" : ".bsdf", NULL};
    g_autoptr(OutputFile) file = exchange_output(output, &format, error);
    if (!file || !cli_work_write(file, write_brdf, &export, &seconds, error))
        return CLI_FAILED;
    const gboolean one = result->width == 1 && result->height == 1;
    record_say(to, "%s{file}: %d{views} %s × %d{lights} %s of %s", output,
               PLURAL(result->n_views, "view"), PLURAL(result->n_lights, "light"),
               one ? "one texel" : "the mean of ");
    record_say_if(to, !one, "%d{width} × %d{height} texels", result->width, result->height);
    record_add(to, "%" G_GINT64_FORMAT "{holes} %d{filled}", result->holes, result->filled);
    record_say(to,
               ", in %g{:time}; beyond %.0f{lowest_deg}° from the normal nothing was measured; the "
               "interpolation has an error of %.2f{error:%%}\n",
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
    .examples = "  mesorig export bsdf weave.session -o weave.bsdf\n"
                "  mesorig export bsdf weave.session --rgb -o weave_rgb.bsdf\n",
    .help = "Export the mean BRDF of a material in the format of RGL.",
    .options = bsdf_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = bsdf_run};
const struct command exchange_merl = {
    .name = "export merl",
    .arguments = "DIR|FILE -o FILE.binary",
    .examples = "  mesorig export merl weave.session -o weave.binary\n",
    .help = "Export the mean isotropic BRDF of a material in the format of MERL.",
    .options = merl_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = merl_run};
