#include "viewer_options.h"

#include "drawing/methods/methods.h"
#include "scene/file_kind.h"

#include <gio/gio.h>
#include <math.h>
#include <stdio.h>
#include <string.h>

#define MAX_SIZE 16384
#define WINDOW_LAMPS                                                                               \
    16 /* lamps of an environment; more would draw too slowly without a graphics card */

G_GNUC_PRINTF(2, 3)
static gboolean refuse_options(GError **error, const char *format, ...) {
    va_list list;
    va_start(list, format);
    g_propagate_error(error,
                      g_error_new_valist(G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE, format, list));
    va_end(list);
    return FALSE;
}

static gboolean bad(GError **error, const char *option, const char *text, const char *wanted) {
    return refuse_options(error, "%s %s: %s is expected", option, text, wanted);
}

void viewer_options_default_light(struct viewer_settings *settings, gboolean environment) {
    settings->lamp = environment ? 0.0 : viewer_settings_default.lamp;
    settings->ambient = environment ? 0.0 : viewer_settings_default.ambient;
}

void viewer_options_init(struct viewer_options *o) {
    *o = (struct viewer_options){.settings = viewer_settings_default,
                                 .compose = {.at = 0.5, .gain = 4.0}};
    o->settings.lamp = o->settings.ambient = NAN; /* their defaults depend on --environment */
    o->settings.environment_lamps = 0;            /* its default depends on --render */
}

void viewer_options_clear(struct viewer_options *o) {
    char *const texts[] = {o->method_name, o->mdf,        o->mdf_path,   o->index,
                           o->index_path,  o->normal_map, o->render,     o->shape,
                           o->size,        o->tiles,      o->up,         o->environment,
                           o->series_text, o->split,      o->difference, o->screenshot};
    for (gsize k = 0; k < G_N_ELEMENTS(texts); k++)
        g_free(texts[k]);
    g_strfreev(o->rest);
    g_strfreev(o->materials);
    for (int k = 0; k < o->n_bindings; k++)
        scene_binding_clear(&o->bindings[k]);
}

char *viewer_options_path(const struct viewer_options *o, const struct method *method) {
    const char *own = method->takes_normals && o->normal_map != NULL ? o->normal_map : method->name;
    return method_path(method, o->argument != NULL && method->product != NULL ? o->argument : own);
}

char *viewer_options_index(const struct viewer_options *o) {
    if (o->index == NULL || !g_file_test(o->index, G_FILE_TEST_IS_DIR))
        return g_strdup(o->index);
    return g_build_filename(o->index, "products", "index.exr", NULL);
}

static int n_pictures(const struct viewer_options *o) {
    return o->n_series > 0 ? o->n_series : o->frames;
}

int viewer_options_sheet_rows(const struct viewer_options *o) {
    return o->sheet > 0 ? (n_pictures(o) + o->sheet - 1) / o->sheet : 1;
}

gboolean viewer_options_light(const struct viewer_options *o) {
    const gsize length = o->render != NULL ? strlen(o->render) : 0;
    return length > 4 && g_ascii_strcasecmp(o->render + length - 4, ".exr") == 0;
}

static gboolean parse_sizes(struct viewer_options *o, GError **error) {
    char last, *end;
    struct viewer_settings *s = &o->settings;
    o->width = o->render != NULL ? 800 : 1200;
    o->height = o->render != NULL ? 600 : 800;
    if (o->size != NULL &&
        (sscanf(o->size, "%5dx%5d%c", &o->width, &o->height, &last) != 2 || o->width < 1 ||
         o->height < 1 || o->width > MAX_SIZE || o->height > MAX_SIZE))
        return bad(error, "--size", o->size, "WIDTHxHEIGHT, each 1 … 16384");
    if ((gint64)o->width * MAX(o->sheet, 1) > MAX_SIZE ||
        (gint64)o->height * viewer_options_sheet_rows(o) > MAX_SIZE)
        return refuse_options(error,
                              "--sheet %d: %d frames of %d × %d make a picture of more than %d "
                              "pixels in one direction; give a smaller --size or fewer frames",
                              o->sheet, n_pictures(o), o->width, o->height, MAX_SIZE);
    if (o->tiles == NULL)
        return TRUE;
    s->tiles_u = s->tiles_v = g_ascii_strtod(o->tiles, &end);
    if (*end == 'x' && end > o->tiles)
        s->tiles_v = g_ascii_strtod(end + 1, &end);
    if (*end != '\0' || !(s->tiles_u > 0.0 && s->tiles_u <= 1000.0) ||
        !(s->tiles_v > 0.0 && s->tiles_v <= 1000.0))
        return bad(error, "--tiles", o->tiles, "N or UxV, each above 0, up to 1000,");
    return TRUE;
}

const char *viewer_options_sample(void) {
    if (g_file_test(MESORIG_SAMPLE, G_FILE_TEST_EXISTS))
        return MESORIG_SAMPLE;
    /* In a source tree, the material that ./run demo has captured. */
    static char *demo;
    g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *bin = self != NULL ? g_path_get_dirname(self) : NULL;
    if (bin != NULL && demo == NULL)
        demo = g_build_filename(bin, "../../demo/weave.session", NULL);
    return demo != NULL && g_file_test(demo, G_FILE_TEST_IS_DIR) ? demo : NULL;
}

static gboolean parse_materials(struct viewer_options *o, GError **error) {
    const int most = VIEWER_MAX_MATERIALS - 1;
    for (char **text = o->materials; text != NULL && *text != NULL; text++) {
        struct scene_binding *binding = &o->bindings[o->n_bindings];
        if (o->n_bindings == most)
            return refuse_options(
                error, "--material %s: at most %d captured materials are possible; leave some out",
                *text, most);
        o->n_bindings++;
        if (!scene_binding_parse(*text, binding, error))
            return FALSE;
        if (!(binding->tiles > 0.0 && binding->tiles <= 1000.0))
            return refuse_options(
                error, "--material %s: the number of tiles is %g, but must be above 0, up to 1000",
                *text, binding->tiles);
    }
    const char *shape = o->shape != NULL ? o->shape : "";
    return o->n_bindings == 0 || g_str_has_suffix(shape, ".gltf") ||
           g_str_has_suffix(shape, ".glb") ||
           refuse_options(error, "--material also needs --shape FILE.gltf or FILE.glb");
}

static gboolean has_views(const char *session) {
    g_autofree char *btf = g_build_filename(session, "products", "btf", NULL);
    return g_file_test(btf, G_FILE_TEST_IS_DIR);
}

/* Sets the methods from --method, --split and --difference. */
static gboolean parse_methods(struct viewer_options *o, GError **error) {
    const char *second = o->split != NULL ? o->split : o->difference;
    o->argument = o->sample ? viewer_options_sample() : o->rest != NULL ? o->rest[0] : NULL;
    if (o->sample && o->rest != NULL)
        return refuse_options(error, "--sample already names a material; leave out %s", o->rest[0]);
    if (o->sample && o->argument == NULL)
        return refuse_options(error, "--sample: there is no sample material " MESORIG_SAMPLE
                                     ". It comes with the package; "
                                     "in a source tree, “./run demo” captures one, and "
                                     "“etc/sample/make BUILD DIR” makes it");
    o->method = o->argument != NULL ? methods[0] : method_find(METHOD_DEMO);
    if (o->method_name != NULL && (o->method = method_find(o->method_name)) == NULL) {
        g_autoptr(GString) names = g_string_new(methods[0]->name);
        for (gsize k = 1; methods[k] != NULL; k++)
            g_string_append_printf(names, "%s%s", methods[k + 1] != NULL ? ", " : " or ",
                                   methods[k]->name);
        return bad(error, "--method", o->method_name, names->str);
    }
    if (o->method_name == NULL &&
        o->argument != NULL) { /* use the method of the file, or a method of the session */
        struct file_opened file;
        if (g_file_test(o->argument, G_FILE_TEST_IS_DIR)) {
            /* While a session is captured, the window makes eigen-maps of the views that exist. If
             * there is a local PCA, the window shows the local PCA instead. --live and --plain are
             * possible only with eigen-maps. */
            const struct method *made = method_of_session(o->argument);
            if (!o->live && !o->settings.plain && made != NULL &&
                (o->render != NULL || made == method_find("lpca") || !has_views(o->argument)))
                o->method = made;
        } else if (file_kind_find(o->argument, &file, NULL)) {
            o->method = file.kind == FILE_KIND_MATERIAL ? file.method : o->method;
            file_opened_clear(&file);
        }
    }
    if (second == NULL)
        return TRUE;
    o->compose.mode = o->split != NULL ? COMPOSE_SPLIT : COMPOSE_DIFFERENCE;
    o->second = method_find(second);
    return o->second != NULL || bad(error, o->split != NULL ? "--split" : "--difference", second,
                                    "a method of --method");
}

/* Checks options that exclude or need each other. */
static gboolean check_together(const struct viewer_options *o, GError **error) {
    const struct viewer_settings *s = &o->settings;
    const gboolean first = o->method == methods[0];
    const gboolean session = o->argument != NULL && (o->series_text != NULL ||
                                                     g_file_test(o->argument, G_FILE_TEST_IS_DIR));
    const struct {
        gboolean wrong;
        const char *text;
    } rules[] = {
        {s->plain && !first, "--plain needs --method eigenmaps"},
        {o->frames < 0 || o->frames > 10000, "--frames must be 1 … 10000"},
        {o->close_after < 0, "--close-after must be at least 1"},
        {(o->split != NULL) + (o->difference != NULL) + o->reference > 1,
         "only one of --split, --difference and --reference can be given"},
        {o->normal_map != NULL && !o->method->takes_normals &&
             (o->second == NULL || !o->second->takes_normals),
         "--normal-map needs --method metal-ward or metal-ashikhmin"},
        {o->measured &&
             (!session || o->render == NULL || o->frames > 0 || o->second != NULL || o->reference),
         "--measured needs a session and --render OUT.png, without --frames, --split, --difference "
         "and --reference"},
        {o->live && (!session || !first || o->second != NULL),
         "--live needs a session and --method eigenmaps, without --split and --difference"},
        {s->plain && s->light_distance > 0.0,
         "--plain only has a light that is far away; leave out --light-distance"},
        {o->measured && s->light_distance > 0.0,
         "--measured compares under a light that is far away; leave out --light-distance"},
        {s->light_cone_deg > 0.0 && s->light_distance == 0.0,
         "--light-cone-deg needs --light-distance"},
        {s->along_surface && o->reference && (!session || o->index != NULL),
         "--along-surface with --reference needs a session, without --index"},
        {s->along_surface && !o->reference &&
             (!s->silhouettes || s->visibility.straight || s->visibility.volume ||
              s->visibility.views),
         "--along-surface needs --silhouettes or --reference, without --straight, --mdf-volume "
         "and --mdf-views"},
        {o->index != NULL && (s->plain || o->live || o->measured || o->method->product == NULL ||
                              (o->second != NULL && o->second->product == NULL)),
         "--index needs a MATERIAL and methods that draw it, without --plain, --live and "
         "--measured"},
        {s->endless && (s->plain || o->measured || o->index != NULL || o->method->product == NULL ||
                        (o->second != NULL && o->second->product == NULL)),
         "--endless needs a MATERIAL and methods that draw it, without --plain, --index and "
         "--measured"},
        {s->backdrop && o->environment == NULL, "--backdrop needs --environment"},
        {!(o->compose.at >= 0.0 && o->compose.at <= 1.0), "--split-at must be 0 … 1"},
        {!(o->compose.gain >= 0.1 && o->compose.gain <= 1000.0),
         "--difference-gain must be 0.1 … 1000"},
        {o->n_bindings > 0 && (s->plain || o->measured || o->live || o->floor),
         "--material cannot be given with --plain, --measured, --live or --floor"},
        {o->reference &&
             (o->render == NULL || s->plain || (o->argument == NULL && o->n_bindings == 0)),
         "--reference needs --render OUT.png and a session or a material, without --plain"},
        {o->n_series > 0 && (!o->live || o->render == NULL || o->frames != 0),
         "--series needs --live and --render OUT.png, without --frames"},
        {o->sheet != 0 && (o->sheet < 1 || o->sheet > n_pictures(o)),
         "--sheet needs --frames N or --series with N pictures, and must be 1 … N columns"},
        {o->render == NULL && o->frames > 0, "--frames needs --render OUT.png"},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(rules); k++)
        if (rules[k].wrong)
            return refuse_options(error, "%s", rules[k].text);
    if (viewer_options_light(o) &&
        (o->second != NULL || o->reference || o->measured || o->live || o->sheet != 0))
        return refuse_options(
            error,
            "--render %s: an EXR (linear light) cannot be written with --split, --difference, "
            "--reference, --measured, --live or --sheet; give a .png",
            o->render);
    return TRUE;
}

gboolean viewer_options_check(struct viewer_options *o, GError **error) {
    if (!parse_methods(o, error))
        return FALSE;
    if (o->rest != NULL ? o->rest[1] != NULL : o->argument == NULL && o->method->product != NULL)
        return refuse_options(
            error,
            "give one MATERIAL: a session directory, or a file that “%s” made from a session",
            o->method->made_by != NULL ? o->method->made_by : "mesorig process");
    if (o->up != NULL && strcmp(o->up, "y") != 0 && strcmp(o->up, "z") != 0)
        return bad(error, "--up", o->up, "y or z");
    o->upward = g_strcmp0(o->up, "z") == 0 ? SCENE_Z_UP : SCENE_Y_UP;
    struct viewer_settings light;
    viewer_options_default_light(&light, o->environment != NULL);
    if (isnan(o->settings.lamp))
        o->settings.lamp = light.lamp;
    if (isnan(o->settings.ambient))
        o->settings.ambient = light.ambient;
    if (o->settings.environment_lamps == 0)
        o->settings.environment_lamps =
            o->render != NULL ? viewer_settings_default.environment_lamps : WINDOW_LAMPS;
    int samples = o->reference ? 2 : o->render != NULL ? 4 : 1;
    o->settings.samples = o->supersample != 0 ? o->supersample : samples;
    o->wait_s = o->wait_s == 0.0 ? 600.0 : o->wait_s;
    if (!(o->wait_s > 0.0 && o->wait_s <= 1e6))
        return refuse_options(error, "--wait-s is %g, but must be above 0, up to 1000000",
                              o->wait_s);
    if (o->series_text != NULL && (o->n_series = series_parse(o->series_text, o->series)) == 0)
        return bad(error, "--series", o->series_text,
                   "rising percentages, such as 20,40,60,80,100,");
    return parse_materials(o, error) && check_together(o, error) && parse_sizes(o, error) &&
           viewer_settings_check(&o->settings, error);
}
