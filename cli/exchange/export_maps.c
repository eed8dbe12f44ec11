/* export maps, gltf, materialx, blender: write a microfacet model of a material for artists. */
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"
#include "maps/maps.h"

#include <gio/gio.h>

#define MEMORY G_GINT64_CONSTANT(4000000000)
#define MEMORY_ENTRY                                                                               \
    {                                                                                              \
        "memory", 0, 0, G_OPTION_ARG_STRING, &memory,                                              \
            "Maximum memory for the BTF; a larger BTF is kept in a temporary file (4GB)", "512MB"  \
    }

static char *output, *format, *shape, *memory;
static gboolean core;

static const GOptionEntry map_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Folder to make", "FOLDER"},
    {"format", 0, 0, G_OPTION_ARG_STRING, &format, "Format of the maps (png)", "png|exr"},
    MEMORY_ENTRY,
    {NULL},
};

static const GOptionEntry gltf_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "File to write: .glb, or .gltf with its textures in the same folder", "FILE.glb"},
    {"shape", 0, 0, G_OPTION_ARG_STRING, &shape, "Shapes with the material (both)",
     "plane|sphere|both"},
    {"core", 0, 0, G_OPTION_ARG_NONE, &core,
     "Fit only base colour, metallic, roughness and normals, for renderers without glTF extensions",
     NULL},
    MEMORY_ENTRY,
    {NULL},
};

static const GOptionEntry usd_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Folder to make", "FOLDER"},
    {"shape", 0, 0, G_OPTION_ARG_STRING, &shape, "Shapes with the material (both)",
     "plane|sphere|both"},
    {"core", 0, 0, G_OPTION_ARG_NONE, &core,
     "Fit only base colour, metallic, roughness and normals, for renderers without MaterialX",
     NULL},
    MEMORY_ENTRY,
    {NULL},
};

static const GOptionEntry folder_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Folder to make", "FOLDER"},
    MEMORY_ENTRY,
    {NULL},
};

enum export_kind { EXPORT_MAPS, EXPORT_GLTF, EXPORT_MATERIALX, EXPORT_USD, EXPORT_BLENDER };

struct maps_export {
    const char *session;
    enum export_kind kind;
    gboolean exr, text;
    enum maps_model model;
    int shapes;
    gint64 memory;
    struct maps *maps;
};

static gboolean add(const struct maps_export *export, MapsFiles *files, GError **error) {
    g_autofree char *name = g_path_get_basename(output);
    switch (export->kind) {
    case EXPORT_MAPS:
        return maps_add_maps(export->maps, export->exr, files, error) &&
               maps_add_errors(export->maps, files, error);
    case EXPORT_GLTF:
        return maps_add_gltf(export->maps, name, export->text, export->shapes, files, error);
    case EXPORT_MATERIALX:
        return maps_add_materialx(export->maps, files, error);
    case EXPORT_USD:
        return maps_add_usd(export->maps, export->shapes, files, error);
    default:
        return maps_add_blender(export->maps, files, error);
    }
}

static gboolean work_maps(const struct work *work, gpointer data, GError **error) {
    struct maps_export *export = data;
    g_autoptr(MapsFiles) files = maps_files_new();
    if (!maps_files_check(output, cli_force, error))
        return FALSE;
    export->maps = maps_new(export->session, export->model, export->memory, work, error);
    if (!export->maps || !add(export, files, error))
        return FALSE;
    return export->kind == EXPORT_GLTF ? maps_files_write_beside(files, output, cli_force, error)
                                       : maps_files_write_folder(files, output, cli_force, error);
}

/* Returns the index of the pair of view and light for which the maps have the largest error. The
 * index of a pair is its element in views × lights. */
static int find_worst(const struct maps_errors *errors) {
    int ret = 0;
    for (int i = 1; i < errors->n_views * errors->n_lights; i++)
        if (errors->pairs[i] > errors->pairs[ret])
            ret = i;
    return ret;
}

static void tell(const struct maps_export *export, double seconds, Record *to) {
    const struct maps *maps = export->maps;
    const struct maps_errors *errors = &maps->errors;
    const int worst = find_worst(errors);
    const gboolean mdf = maps->heights_from == MAPS_HEIGHTS_MDF;
    record_say(to,
               "%s{file}: %d{width} × %d{height} texels from %d{views} %s × %d{lights} %s in "
               "%g{:time}%s\n",
               output, maps->width, maps->height, PLURAL(maps->n_views, "view"),
               PLURAL(maps->n_lights, "light"), seconds,
               maps->kept == MAPS_FIT_TAKEN ? ", with the fit of an earlier export" : "");
    if (maps->lost)
        record_say(to, "  the next export will fit again: %s\n", maps->lost);
    record_say(to,
               "  the maps differ from the BTF by %.2f{delta_e} CIEDE2000 on average "
               "(%.1f{error:%%} RMS), and most in view %d{worst_view} under light "
               "%d{worst_light}: by %.1f{worst_delta_e}\n",
               errors->delta_e, errors->relative_error, worst / errors->n_lights,
               worst % errors->n_lights, (double)errors->pairs[worst]);
    record_boolean(to, "core", maps->model == MAPS_MODEL_CORE);
    record_boolean(to, "anisotropy", maps->anisotropic);
    record_add(to, "%g{sheen_roughness} %g{coat_roughness} %s{heights}",
               (double)maps->fit->layers.sheen_roughness, (double)maps->fit->layers.coat_roughness,
               mdf ? "mdf" : "normals");
    record_say(to, "  heights of %.3g{relief_mm} mm from %s", maps->relief_mm,
               mdf ? "the MDF" : "the normals, because the MDF is missing or has too many holes");
    record_double(to, "depth_mm", maps->depth_mm);
    record_say_if(to, maps->height_holes > 0,
                  ", %d{height_holes} texels are filled from their neighbours", maps->height_holes);
    record_say(to, "%s%s%s\n", maps->anisotropic ? "; anisotropic" : "",
               maps->fit->layers.sheen_roughness > 0 ? "; with sheen" : "",
               maps->fit->layers.coat_roughness > 0 ? "; with a clear coat" : "");
    record_add(to, "%d{dark} %" G_GINT64_FORMAT "{holes}", maps->fit->dark, maps->holes);
    record_boolean(to, "fit_taken", maps->kept == MAPS_FIT_TAKEN);
    record_double(to, "real_s", seconds);
    if (maps->depth_mm != 0)
        record_say(to, "  the maps show the mean surface, %.2f mm below the reference plane\n",
                   maps->depth_mm);
    record_say_if(
        to, maps->specular_scale > 1,
        "  SpecularLevel of a PNG is to be multiplied by %.4g{specular_scale}, because some "
        "texels reflect more than 8 %%\n",
        (double)maps->specular_scale);
    if (maps->n_views == 1)
        record_say(
            to,
            "  one view shows little of the highlights: roughness and metallic are uncertain\n");
}

static int export_maps(const struct call *call, struct maps_export *export, GError **error) {
    double seconds = 0;
    export->session = call->arguments[0];
    export->memory = MEMORY;
    if (!exchange_parse_bytes(call->command, "memory", memory, &export->memory))
        return CLI_USAGE;
    if (output == NULL) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    "no output is given: give -o %s",
                    export->kind == EXPORT_GLTF ? "FILE.glb" : "FOLDER");
        return CLI_FAILED;
    }
    const gboolean ok =
        (export->kind == EXPORT_GLTF ? output_file_check(output, NULL, cli_force, error)
                                     : cli_check_folder(output, error)) &&
        cli_work_run(work_maps, export, &seconds, error);
    if (ok)
        tell(export, seconds, call->record);
    maps_free(export->maps);
    return ok ? CLI_DONE : CLI_FAILED;
}

static int run(const struct call *call, GError **error) {
    struct maps_export export = {.kind = EXPORT_MAPS, .exr = g_strcmp0(format, "exr") == 0};
    if (format && !export.exr && g_strcmp0(format, "png") != 0)
        return cli_usage(call->command, "there is no --format=%s; choose from: png, exr", format);
    return export_maps(call, &export, error);
}

/* Reads --shape and --core. Returns FALSE on bad usage, which has then been reported. */
static gboolean parse_scene(const struct call *call, struct maps_export *export) {
    static const char *const names[] = {NULL, "plane", "sphere", "both"};
    export->model = core ? MAPS_MODEL_CORE : MAPS_MODEL_FULL;
    for (int shapes = MAPS_PLANE; shapes <= (MAPS_PLANE | MAPS_SPHERE); shapes++)
        if (g_str_equal(shape ? shape : "both", names[shapes])) {
            export->shapes = shapes;
            return TRUE;
        }
    cli_usage(call->command, "there is no --shape=%s; choose from: plane, sphere, both", shape);
    return FALSE;
}

static int gltf_run(const struct call *call, GError **error) {
    struct maps_export export = {.kind = EXPORT_GLTF};
    if (!parse_scene(call, &export))
        return CLI_USAGE;
    g_autofree char *lower = output ? g_ascii_strdown(output, -1) : NULL;
    export.text = lower && g_str_has_suffix(lower, ".gltf");
    static const struct exchange_format glb = {"scenes", "glTF", ".glb", NULL};
    g_autoptr(OutputFile) file =
        output && !export.text ? exchange_output(output, &glb, error) : NULL;
    if (output && !export.text && !file)
        return CLI_FAILED;
    return export_maps(call, &export, error);
}

static int materialx_run(const struct call *call, GError **error) {
    struct maps_export export = {.kind = EXPORT_MATERIALX};
    return export_maps(call, &export, error);
}

static int usd_run(const struct call *call, GError **error) {
    struct maps_export export = {.kind = EXPORT_USD};
    return parse_scene(call, &export) ? export_maps(call, &export, error) : CLI_USAGE;
}

static int blender_run(const struct call *call, GError **error) {
    struct maps_export export = {.kind = EXPORT_BLENDER};
    return export_maps(call, &export, error);
}

const struct command exchange_maps = {
    .name = "export maps",
    .arguments = "DIR -o FOLDER",
    .examples = "  mesorig export maps weave.session -o weave_maps\n",
    .help = "Export base colour, roughness, normals, heights and other maps, fitted to the BTF.",
    .options = map_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = run};
const struct command exchange_gltf = {
    .name = "export gltf",
    .arguments = "DIR -o FILE.glb",
    .examples = "  mesorig export gltf weave.session -o weave.glb\n"
                "  mesorig export gltf weave.session --core -o weave_core.glb\n",
    .help = "Export the same maps as the material of a glTF 2.0 scene.",
    .options = gltf_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = gltf_run};
const struct command exchange_materialx = {
    .name = "export materialx",
    .arguments = "DIR -o FOLDER",
    .examples = "  mesorig export materialx weave.session -o weave_materialx\n",
    .help = "Export the same maps as MaterialX: OpenPBR and standard_surface.",
    .options = folder_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = materialx_run};
const struct command exchange_usd = {
    .name = "export usd",
    .arguments = "DIR -o FOLDER",
    .examples = "  mesorig export usd weave.session -o weave_usd\n"
                "  mesorig export usd weave.session --core -o weave_core_usd\n",
    .help = "Export the same maps as a USD scene: UsdPreviewSurface and MaterialX.",
    .options = usd_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = usd_run};
const struct command exchange_blender = {
    .name = "export blender",
    .arguments = "DIR -o FOLDER",
    .examples = "  mesorig export blender weave.session -o weave_blender\n",
    .help = "Export the same maps with a script that makes the material in Blender.",
    .options = folder_entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = blender_run};
