/* export points, height, normals: write the surface of a session's material. */
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"
#include "formats/export_surface.h"
#include "maps/fit_normals.h"
#include "maps/light_normals.h"

static char *output;
static int min_views;
static gboolean layered, maximum;

static const GOptionEntry point_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "File to write", "FILE.ply"},
    {"views", 0, 0, G_OPTION_ARG_INT, &min_views, "Leave out points that fewer views saw (2)", "N"},
    {NULL},
};

static const GOptionEntry map_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "File to write", "FILE.exr"},
    {"layered", 0, 0, G_OPTION_ARG_NONE, &layered,
     "Write the upper layer if parts of the surface lie below others", NULL},
    {"maximum", 0, 0, G_OPTION_ARG_NONE, &maximum,
     "With a PTM: the normal points to the light at which the PTM is brightest", NULL},
    {NULL},
};

struct surface_export {
    const char *session;
    OutputFile *to;
    struct export_surface_options options;
    struct export_surface_result surface;
    struct fit_normals_result fit;
    struct light_normals_result lights;
};

static gboolean write_surface(const char *path, const struct work *work, gpointer data,
                              GError **error) {
    struct surface_export *export = data;
    return export_surface(export->session, path, &export->options, work, &export->surface, error);
}

static gboolean write_fit(const char *path, const struct work *work, gpointer data,
                          GError **error) {
    struct surface_export *export = data;
    return fit_normals(export->session, path, export->options.what == EXPORT_HEIGHT,
                       maximum ? FIT_NORMALS_MAXIMUM : FIT_NORMALS_LAMBERT, work, &export->fit,
                       error);
}

static gboolean write_lights(const char *path, const struct work *work, gpointer data,
                             GError **error) {
    struct surface_export *export = data;
    return light_normals(export->session, path, export->options.what == EXPORT_HEIGHT, work,
                         &export->lights, error);
}

/* Exports normals or heights from the pictures under the measured lights. */
static int by_lights(const struct call *call, struct surface_export *export, GError **error) {
    static const char *const names[PHOTOMETRIC_CAUSES] = {
        [PHOTOMETRIC_DARK] = "dark",
        [PHOTOMETRIC_FEW] = "few_lights",
        [PHOTOMETRIC_CONTRADICT] = "contradicting",
        [PHOTOMETRIC_FLAT] = "flat",
        [PHOTOMETRIC_AWAY] = "away",
    };
    const struct light_normals_result *result = &export->lights;
    Record *to = call->record;
    double seconds = 0;
    if (!cli_work_write(export->to, write_lights, export, &seconds, error))
        return CLI_FAILED;
    record_add(to, "%s{file} %s{model} %d{lights} %d{points} %d{holes}", output, "lights",
               result->n_lights, result->texels - result->holes, result->holes);
    record_add(to, "%g{sigma_deg} %g{sigma_95_deg} %g{lights_used} %g{real_s}",
               result->sigma_deg[0], result->sigma_deg[1], result->used, seconds);
    record_say(to,
               "%s: %d of %d texels from their pictures under %d %s, of which %.0f agree (median); "
               "normals are known to %.2f° (median), %.2f° (95 %%)\n",
               output, result->texels - result->holes, result->texels,
               PLURAL(result->n_lights, "light"), result->used, result->sigma_deg[0],
               result->sigma_deg[1]);
    for (int cause = PHOTOMETRIC_DARK; cause < PHOTOMETRIC_CAUSES; cause++) {
        record_int(to, names[cause], result->causes[cause]);
        if (result->causes[cause] > 0)
            record_say(to, "  holes: %d texels %s\n", result->causes[cause],
                       photometric_cause_text((enum photometric_cause)cause));
    }
    cli_tell_output(to, export->to);
    return CLI_DONE;
}

/* Exports the surface from a fit of the pictures: a PTM or HSH, which describes how brightness
 * depends on the light. */
static int by_fit(const struct call *call, struct surface_export *export, GError **error) {
    const struct fit_normals_result *result = &export->fit;
    Record *to = call->record;
    double seconds = 0;
    if (min_views || layered)
        return cli_usage(call->command,
                         "--views and --layered are for materials with an MDF; %s "
                         "has none",
                         export->session);
    if (!cli_work_write(export->to, write_fit, export, &seconds, error))
        return CLI_FAILED;
    record_add(to, "%s{file} %s{model}", output, result->model);
    record_say(to, "%s: %d{points} of %d texels from their %s", output,
               result->texels - result->holes, result->texels, result->model);
    record_int(to, "holes", result->holes);
    record_say_if(to, maximum, "; %d{clipped} texels are holes, since their maximum is clipped\n",
                  result->clipped);
    record_say_if(to, !maximum,
                  "; %d{shadowed} are in shadow or shine under more than a quarter of the lights "
                  "they face, and are less certain\n",
                  result->shadowed);
    record_double(to, "real_s", seconds);
    cli_tell_output(to, export->to);
    return CLI_DONE;
}

/* In the order of enum export_surface. */
static const struct exchange_format formats[] = {{"points", "PLY", ".ply", "points"},
                                                 {"maps", "OpenEXR", ".exr", "height"},
                                                 {"maps", "OpenEXR", ".exr", "normals"}};

static int shape(const struct call *call, enum export_surface what, GError **error) {
    struct surface_export export = {.session = call->arguments[0]};
    const struct export_surface_result *result = &export.surface;
    Record *record = call->record;
    double seconds = 0;
    if (min_views < 0 || min_views > 255)
        return cli_usage(call->command, "--views=%d is out of range: 1 to 255", min_views);
    g_autoptr(OutputFile) to = exchange_output(output, &formats[what], error);
    if (!to)
        return CLI_FAILED;
    export.to = to;
    export.options =
        (struct export_surface_options){.what = what, .min_views = min_views, .layered = layered};
    if (what != EXPORT_POINTS && !maximum && light_normals_applies(export.session)) {
        if (min_views || layered)
            return cli_usage(call->command,
                             "--views and --layered are for materials with an MDF; %s has none",
                             export.session);
        return by_lights(call, &export, error);
    }
    if (what != EXPORT_POINTS && fit_normals_applies(export.session))
        return by_fit(call, &export, error);
    if (maximum)
        return cli_usage(call->command,
                         "--maximum is for height and normals of a PTM; %s has an MDF or no PTM: "
                         "leave out --maximum",
                         export.session);
    if (!cli_work_write(to, write_surface, &export, &seconds, error))
        return CLI_FAILED;
    record_add(record, "%s{file} %d{views} %" G_GINT64_FORMAT "{seen} %" G_GINT64_FORMAT "{points}",
               output, result->n_views, result->seen, result->points);
    record_say_if(record, what == EXPORT_POINTS,
                  "%s: %" G_GINT64_FORMAT " points; %d %s saw %" G_GINT64_FORMAT
                  ", and points that several views saw were merged into one\n",
                  output, result->points, PLURAL(result->n_views, "view"), result->seen);
    record_say_if(record, what != EXPORT_POINTS,
                  "%s: %" G_GINT64_FORMAT " of %d texels from %d %s, %d{holes} holes, %d{stacked} "
                  "with structure below structure\n",
                  output, result->points, result->texels, PLURAL(result->n_views, "view"),
                  result->holes, result->stacked);
    record_double(record, "real_s", seconds);
    cli_tell_output(record, to);
    return CLI_DONE;
}

static int points_run(const struct call *call, GError **error) {
    return shape(call, EXPORT_POINTS, error);
}

static int height_run(const struct call *call, GError **error) {
    return shape(call, EXPORT_HEIGHT, error);
}

static int normals_run(const struct call *call, GError **error) {
    return shape(call, EXPORT_NORMALS, error);
}

const struct command exchange_points = {
    .name = "export points",
    .arguments = "DIR -o FILE.ply",
    .examples = "  mesorig export points weave.session -o weave.ply\n",
    .help = "Export the measured surface as points with normals (PLY).",
    .options = point_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = points_run};
const struct command exchange_height = {
    .name = "export height",
    .arguments = "DIR|FILE -o FILE.exr",
    .examples = "  mesorig export height weave.session -o height.exr\n",
    .help =
        "Export heights as a map (EXR): from the MDF of a session, from its pictures if it has no "
        "MDF, or from a PTM or HSH file.",
    .options = map_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = height_run};
const struct command exchange_normals = {
    .name = "export normals",
    .arguments = "DIR|FILE -o FILE.exr",
    .examples = "  mesorig export normals weave.session -o normals.exr\n",
    .help =
        "Export normals as a map (EXR): from the MDF of a session, from its pictures if it has no "
        "MDF (with error bars and albedo), or from a PTM or HSH file.",
    .options = map_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = normals_run};
