/* Shows a material on a shape: in a window, or as PNG files without one. See mesorig-view(1). */
#include "gpu.h"
#include "picture.h"
#include "reference.h"
#include "view.h"
#include "window.h"

#include <locale.h>
#include <stdio.h>
#include <string.h>

#define MAX_SIZE 16384
#define DEMO     "fabric-ashikhmin" /* shown where nothing is named */

struct options {
    const struct method *method;
    char *method_name;
    char *mdf, *mdf_path;
    char *render, *shape, *size, *tiles, *up, *screenshot;
    int frames, close_after, supersample, sheet;
    gboolean floor, reference, light_turn, camera_turn, nearest, json, version;
    struct view_settings settings;
    char **rest;
    int width, height;
};

struct rendered {
    int n_frames;
    double seconds;
    char *renderer;
    GPtrArray *files;
    double error; /* of the last frame against its reference */
};

static gboolean bad(GError **error, const char *option, const char *text, const char *wanted) {
    g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE, "%s %s: %s is expected", option,
                text, wanted);
    return FALSE;
}

/* The data of the option group is the options; see main(). */
static gboolean parse_silhouettes(const char *option, const char *value, gpointer data,
                                  GError **error) {
    static const char *const ways[] = {"auto", "peel", "lists"};
    struct options *o = data;
    o->settings.silhouettes = TRUE;
    for (gsize k = 0; k < G_N_ELEMENTS(ways); k++)
        if (value == NULL || strcmp(value, ways[k]) == 0) {
            o->settings.visibility.way = (enum visibility_way)k;
            return TRUE;
        }
    return bad(error, option, value, "auto, peel or lists");
}

static gboolean parse_rotation(const char *option, const char *value, gpointer data,
                               GError **error) {
    static const char *const ways[METHOD_ROTATIONS] = {"exact", "approximate", "none"};
    struct options *o = data;
    for (gsize k = 0; k < G_N_ELEMENTS(ways); k++)
        if (strcmp(value, ways[k]) == 0) {
            o->settings.style.rotation = (enum method_rotation)k;
            return TRUE;
        }
    return bad(error, option, value, "exact, approximate or none");
}

static GOptionEntry *entries(struct options *o) {
    struct view_settings *s = &o->settings;
    const GOptionEntry all[] = {
        {"render", 'o', 0, G_OPTION_ARG_FILENAME, &o->render, "Write a picture, open no window",
         "OUT.png"},
        {"shape", 0, 0, G_OPTION_ARG_FILENAME, &o->shape,
         "plane, torus (default), sphere, cylinder, torus-knot or an OBJ file", "SHAPE"},
        {"method", 0, 0, G_OPTION_ARG_STRING, &o->method_name,
         "How it is drawn: eigenmaps (default), lpca-grid, lpca-revised, lpca, fields, ptm, "
         "lafortune, "
         "ward, ashikhmin; without MATERIAL fabric-… (default), metal-ward or metal-ashikhmin",
         "METHOD"},
        {"rotation", 0, 0, G_OPTION_ARG_CALLBACK, (gpointer)parse_rotation,
         "Of microfacets with the normal (ward, ashikhmin, metal-…, fabric-…)",
         "exact|approximate|none"},
        {"size", 0, 0, G_OPTION_ARG_STRING, &o->size, "Pixels, default 800x600", "WxH"},
        {"tiles", 0, 0, G_OPTION_ARG_STRING, &o->tiles,
         "Repetitions of the material along the shape, for example 8x3", "N|UxV"},
        {"light-theta-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->light_theta_deg,
         "Light's angle from straight above, 0 … 180, default 50", "DEG"},
        {"light-phi-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->light_phi_deg,
         "Light's azimuth from +x, default 200: from the left", "DEG"},
        {"camera-azimuth-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->camera_azimuth_deg,
         "Camera's azimuth from +x, default -90: in front", "DEG"},
        {"camera-elevation-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->camera_elevation_deg,
         "Camera's height above the horizon, -90 … 90, default 40", "DEG"},
        {"camera-distance", 0, 0, G_OPTION_ARG_DOUBLE, &s->camera_distance,
         "In radii of the shape; default: the shape fills the picture", "R"},
        {"camera-fov-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->camera_fov_deg,
         "Field of view of the shorter side, 1 … 120, default 30", "DEG"},
        {"exposure", 0, 0, G_OPTION_ARG_DOUBLE, &s->exposure_ev,
         "Stops brighter, default 0.7; at 0 a lit white diffuser is just below white", "EV"},
        {"ambient", 0, 0, G_OPTION_ARG_DOUBLE, &s->ambient,
         "Light from all around, as a share of the lamp's, default 0.05", "SHARE"},
        {"supersample", 0, 0, G_OPTION_ARG_INT, &o->supersample,
         "Samples each way of a pixel, 1 … 8; default 4, in the window 1, of a reference 2", "N"},
        {"nearest", 0, 0, G_OPTION_ARG_NONE, &o->nearest, "Do not filter between texels", NULL},
        {"plain", 0, 0, G_OPTION_ARG_NONE, &s->plain,
         "One texture times n·l instead of the BTF, to compare", NULL},
        {"silhouettes", 0, G_OPTION_FLAG_OPTIONAL_ARG, G_OPTION_ARG_CALLBACK,
         (gpointer)parse_silhouettes, "With the structure's outline, from the session's mdf.exr",
         "auto|peel|lists"},
        {"shadows", 0, 0, G_OPTION_ARG_NONE, &s->shadows, "With the shadows that the shape casts",
         NULL},
        {"floor", 0, 0, G_OPTION_ARG_NONE, &o->floor, "A floor of the material under the shape",
         NULL},
        {"layers", 0, 0, G_OPTION_ARG_INT, &s->visibility.layers,
         "Of silhouettes behind each other, at most, 1 … 32 (default)", "N"},
        {"straight", 0, 0, G_OPTION_ARG_NONE, &s->visibility.straight,
         "Silhouettes as if the shape were flat under each ray, to compare", NULL},
        {"shadow-map", 0, 0, G_OPTION_ARG_INT, &s->shadow_size,
         "Size of the map of shadows, 16 … 16384, default 1024", "PIXELS"},
        {"mdf", 0, 0, G_OPTION_ARG_FILENAME, &o->mdf,
         "Distances for --silhouettes, if not the mdf.exr beside the material", "FILE"},
        {"up", 0, 0, G_OPTION_ARG_STRING, &o->up, "An OBJ file's upward axis, default y", "y|z"},
        {"frames", 0, 0, G_OPTION_ARG_INT, &o->frames,
         "With --render: this many pictures OUT_0000.png …", "N"},
        {"sheet", 0, 0, G_OPTION_ARG_INT, &o->sheet,
         "With --frames: one picture instead, with so many of them side by side", "COLUMNS"},
        {"reference", 0, 0, G_OPTION_ARG_NONE, &o->reference,
         "With --render: from the session's whole BTF, not its eigen-maps; slow", NULL},
        {"light-turn", 0, 0, G_OPTION_ARG_NONE, &o->light_turn,
         "The light goes once around during the frames", NULL},
        {"camera-turn", 0, 0, G_OPTION_ARG_NONE, &o->camera_turn,
         "The camera goes once around during the frames", NULL},
        {"close-after", 0, 0, G_OPTION_ARG_INT, &o->close_after,
         "Close the window after this many frames", "N"},
        {"screenshot", 0, 0, G_OPTION_ARG_FILENAME, &o->screenshot,
         "Write the window's last picture when it closes", "OUT.png"},
        {"json", 0, 0, G_OPTION_ARG_NONE, &o->json, "Say what was done as JSON", NULL},
        {"version", 0, 0, G_OPTION_ARG_NONE, &o->version, "Print the version", NULL},
        {G_OPTION_REMAINING, 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &o->rest, NULL, "MATERIAL"},
        {NULL}};
    return g_memdup2(all, sizeof all);
}

static void options_clear(struct options *o) {
    g_free(o->method_name);
    g_free(o->mdf);
    g_free(o->mdf_path);
    g_free(o->render);
    g_free(o->shape);
    g_free(o->size);
    g_free(o->tiles);
    g_free(o->up);
    g_free(o->screenshot);
    g_strfreev(o->rest);
}

static gboolean bad_method(const struct options *o, GError **error) {
    g_autoptr(GString) names = g_string_new(NULL);
    for (gsize k = 0; methods[k] != NULL; k++)
        g_string_append_printf(names, "%s%s",
                               k == 0                   ? ""
                               : methods[k + 1] != NULL ? ", "
                                                        : " or ",
                               methods[k]->name);
    return bad(error, "--method", o->method_name, names->str);
}

static gboolean parse_size(struct options *o, GError **error) {
    char end;
    o->width = 800;
    o->height = 600;
    if (o->size != NULL &&
        (sscanf(o->size, "%5dx%5d%c", &o->width, &o->height, &end) != 2 || o->width < 1 ||
         o->height < 1 || o->width > MAX_SIZE || o->height > MAX_SIZE))
        return bad(error, "--size", o->size, "WIDTHxHEIGHT, each 1 … 16384");
    return TRUE;
}

static gboolean parse_tiles(struct options *o, GError **error) {
    char *end;
    struct view_settings *s = &o->settings;
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

static int sheet_rows(const struct options *o) {
    return o->sheet > 0 ? (o->frames + o->sheet - 1) / o->sheet : 1;
}

static gboolean check_sheet(const struct options *o, GError **error) {
    if ((gint64)o->width * MAX(o->sheet, 1) <= MAX_SIZE &&
        (gint64)o->height * sheet_rows(o) <= MAX_SIZE)
        return TRUE;
    g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                "--sheet %d with %d frames of %d × %d: the whole may be %d each way", o->sheet,
                o->frames, o->width, o->height, MAX_SIZE);
    return FALSE;
}

static gboolean check_plain(const struct options *o, GError **error) {
    if (!o->settings.plain || o->method == methods[0])
        return TRUE;
    g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE, "--plain goes with --method %s",
                methods[0]->name);
    return FALSE;
}

static gboolean check_options(struct options *o, GError **error) {
    const gboolean given = o->rest != NULL && o->rest[0] != NULL;
    o->method = given ? methods[0] : method_find(DEMO);
    if (o->method_name != NULL && (o->method = method_find(o->method_name)) == NULL)
        return bad_method(o, error);
    if (given ? o->rest[1] != NULL : o->method->product != NULL) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_FAILED,
                    "one MATERIAL is expected: a session directory or what “%s” made of one",
                    o->method->made_by != NULL ? o->method->made_by : "mesorig process");
        return FALSE;
    }
    if (!check_plain(o, error))
        return FALSE;
    if (o->up != NULL && strcmp(o->up, "y") != 0 && strcmp(o->up, "z") != 0)
        return bad(error, "--up", o->up, "y or z");
    if (o->frames < 0 || o->frames > 10000 || o->close_after < 0) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "--frames takes 1 … 10000, --close-after 1 or more");
        return FALSE;
    }
    if (o->reference && (o->render == NULL || o->settings.plain || !given)) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "--reference goes with --render OUT.png and a session, not with --plain");
        return FALSE;
    }
    if (o->sheet != 0 && (o->frames == 0 || o->sheet < 1 || o->sheet > o->frames)) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "--sheet goes with --frames N and takes 1 … N columns");
        return FALSE;
    }
    if (o->render == NULL && o->frames > 0) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "--frames goes with --render OUT.png");
        return FALSE;
    }
    o->settings.style.nearest = o->nearest;
    int samples = o->reference ? 2 : o->render != NULL ? 4 : 1;
    o->settings.samples = o->supersample != 0 ? o->supersample : samples;
    return parse_size(o, error) && check_sheet(o, error) && parse_tiles(o, error) &&
           view_settings_check(&o->settings, error);
}

/* OUT.png becomes OUT_0000.png, … if there are more than one. */
static char *frame_path(const struct options *o, int frame) {
    if (o->frames == 0 || o->sheet > 0)
        return g_strdup(o->render);
    gsize length = strlen(o->render);
    gboolean png = length > 4 && g_ascii_strcasecmp(o->render + length - 4, ".png") == 0;
    return g_strdup_printf("%.*s_%04d.png", (int)(png ? length - 4 : length), o->render, frame);
}

/* As people name it, "weave.session/products/eigenmaps.exr": where it lay on this machine is
 * nobody's business who is sent the picture. */
static char *shown_name(const char *path) {
    g_autofree char *name = g_path_get_basename(path), *folder = g_path_get_dirname(path);
    g_autofree char *folder_name = g_path_get_basename(folder);
    g_autofree char *session = g_path_get_dirname(folder);
    g_autofree char *session_name = g_path_get_basename(session);
    if (!g_str_equal(folder_name, "products"))
        return g_steal_pointer(&name);
    return g_build_filename(session_name, folder_name, name, NULL);
}

static gboolean write_frame(const struct options *o, const char *material, const char *path,
                            const struct view_settings *s, const guint8 *rgb, int width, int height,
                            GError **error) {
    g_autofree char *light =
        g_strdup_printf("theta %.10g deg, phi %.10g deg", s->light_theta_deg, s->light_phi_deg);
    g_autofree char *camera = g_strdup_printf(
        "azimuth %.10g deg, elevation %.10g deg, distance %.10g, fov %.10g deg",
        s->camera_azimuth_deg, s->camera_elevation_deg, s->camera_distance, s->camera_fov_deg);
    g_autofree char *tiles = g_strdup_printf("%.10g x %.10g", s->tiles_u, s->tiles_v);
    g_autofree char *exposure =
        g_strdup_printf("%.10g EV, ambient %.10g", s->exposure_ev, s->ambient);
    const char *relief = s->silhouettes && s->shadows ? "silhouettes, shadows"
                         : s->silhouettes             ? "silhouettes"
                         : s->shadows                 ? "shadows"
                                                      : "none";
    g_autofree char *name = shown_name(material);
    const char *texts[] = {"Software", "mesorig-view " MESORIG_VERSION,
                           "Material", name,
                           "Shape",    o->shape,
                           "Tiles",    tiles,
                           "Light",    light,
                           "Camera",   camera,
                           "Exposure", exposure,
                           "Relief",   relief,
                           "Source",   o->reference ? "the whole BTF" : o->method->title,
                           NULL};
    return picture_write_png(path, rgb, width, height, texts, error);
}

/* Into its place on a sheet of o->sheet columns. */
static void put_on_sheet(const struct options *o, int frame, const guint8 *rgb, guint8 *sheet) {
    gsize row = 3 * (gsize)o->width;
    guint8 *to = sheet + frame / o->sheet * o->height * row * o->sheet + frame % o->sheet * row;
    for (int j = 0; j < o->height; j++)
        memcpy(to + j * row * o->sheet, rgb + j * row, row);
}

static char *btf_path(const struct options *o) {
    return o->reference && o->rest ? g_build_filename(o->rest[0], "products", "btf", NULL) : NULL;
}

/* What frames are made with. */
struct studio {
    const char *material;
    View *view;
    Reference *reference; /* NULL: from eigen-maps */
    guint8 *sheet;        /* NULL: a file a frame */
};

static gboolean render_frame(const struct options *o, const struct studio *studio, int frame,
                             const struct view_settings *s, struct rendered *ret, GError **error) {
    gint64 from = g_get_monotonic_time();
    g_autofree guint8 *rgb = studio->reference != NULL
                                 ? reference_render(studio->reference, studio->view, s, o->width,
                                                    o->height, &ret->error, error)
                                 : view_render(studio->view, s, o->width, o->height, error);
    g_autofree char *path = frame_path(o, frame);
    if (rgb == NULL)
        return FALSE;
    ret->seconds += (g_get_monotonic_time() - from) * 1e-6;
    ret->n_frames++;
    if (studio->sheet != NULL) {
        put_on_sheet(o, frame, rgb, studio->sheet);
        return TRUE;
    }
    if (!write_frame(o, studio->material, path, s, rgb, o->width, o->height, error))
        return FALSE;
    g_ptr_array_add(ret->files, g_steal_pointer(&path));
    return TRUE;
}

static gboolean render_frames(const struct options *o, struct studio *studio,
                              const struct view_settings *start, struct rendered *ret,
                              GError **error) {
    struct view_settings fitted = *start;
    gsize size = 3 * (gsize)o->width * o->height;
    g_autofree guint8 *sheet = o->sheet > 0 ? g_malloc0(size * o->sheet * sheet_rows(o)) : NULL;
    studio->sheet = sheet;
    /* Once, so that the shape keeps its size in all frames. */
    view_fit(studio->view, &fitted, (double)o->width / o->height);
    for (int k = 0; k < MAX(o->frames, 1); k++) {
        struct view_settings s = fitted;
        double turned = o->frames > 0 ? 360.0 * k / o->frames : 0.0;
        s.light_phi_deg += o->light_turn ? turned : 0.0;
        s.camera_azimuth_deg += o->camera_turn ? turned : 0.0;
        if (!render_frame(o, studio, k, &s, ret, error))
            return FALSE;
    }
    if (sheet == NULL)
        return TRUE;
    g_ptr_array_add(ret->files, g_strdup(o->render));
    return write_frame(o, studio->material, o->render, &fitted, sheet, o->width * o->sheet,
                       o->height * sheet_rows(o), error);
}

static enum scene_up up_of(const struct options *o) {
    return g_strcmp0(o->up, "z") == 0 ? SCENE_Z_UP : SCENE_Y_UP;
}

static gboolean render_mesh(const struct options *o, const char *material, const struct mesh *mesh,
                            struct rendered *ret, GError **error) {
    g_autoptr(Gpu) gpu = gpu_new_headless(error);
    g_autoptr(View) view = gpu != NULL ? view_new(NULL, error) : NULL;
    if (view == NULL || !view_open(view, o->method, material, error) ||
        (o->settings.silhouettes && !view_open_mdf(view, o->mdf_path, error)) ||
        !view_set_mesh(view, mesh, error))
        return FALSE;
    struct view_settings settings = o->settings;
    settings.tiles_u = mesh->tiles_u;
    settings.tiles_v = mesh->tiles_v;
    ret->renderer = g_strdup(gpu_renderer());
    g_autofree char *btf = btf_path(o);
    g_autoptr(Reference) reference = o->reference ? reference_open(btf, error) : NULL;
    if (o->reference && reference == NULL)
        return FALSE;
    struct studio studio = {.material = material, .view = view, .reference = reference};
    return render_frames(o, &studio, &settings, ret, error);
}

static gboolean render(const struct options *o, const char *material, struct rendered *ret,
                       GError **error) {
    const struct scene_options scene = {o->settings.tiles_u, o->settings.tiles_v, up_of(o),
                                        o->floor};
    struct mesh *mesh = scene_make(o->shape, &scene, error);
    gboolean good = mesh != NULL && render_mesh(o, material, mesh, ret, error);
    mesh_free(mesh);
    return good;
}

static gboolean show(const struct options *o, const char *material, struct rendered *ret,
                     GError **error) {
    const struct window_options window = {
        .method = o->method,
        .material = material,
        .mdf = o->mdf_path,
        .shape = o->shape,
        .up = up_of(o),
        .floor = o->floor,
        .width = o->width,
        .height = o->height,
        .close_after = o->close_after,
        .screenshot = o->screenshot,
        .settings = o->settings,
    };
    struct window_result result;
    gboolean good = window_run(&window, &result, error);
    ret->n_frames = result.n_frames;
    ret->seconds = result.seconds;
    ret->renderer = result.renderer;
    if (good && o->screenshot != NULL)
        g_ptr_array_add(ret->files, g_strdup(o->screenshot));
    return good;
}

static void append_json_string(GString *json, const char *text) {
    g_string_append_c(json, '"');
    for (const char *c = text; *c != '\0'; c++) {
        if (*c == '"' || *c == '\\')
            g_string_append_printf(json, "\\%c", *c);
        else if ((guchar)*c < 0x20)
            g_string_append_printf(json, "\\u%04x", *c);
        else
            g_string_append_c(json, *c);
    }
    g_string_append_c(json, '"');
}

static void report(const struct options *o, const char *material, const struct rendered *done) {
    g_autoptr(GString) json = g_string_new("{\"material\": ");
    append_json_string(json, material);
    g_string_append(json, ", \"shape\": ");
    append_json_string(json, o->shape);
    g_string_append(json, ", \"renderer\": ");
    append_json_string(json, done->renderer);
    char seconds[G_ASCII_DTOSTR_BUF_SIZE];
    g_ascii_formatd(seconds, sizeof seconds, "%.4f", done->seconds);
    g_string_append_printf(json,
                           ", \"width\": %d, \"height\": %d, \"frames\": %d, \"seconds\": %s, "
                           "\"files\": [",
                           o->width, o->height, done->n_frames, seconds);
    for (guint k = 0; k < done->files->len; k++) {
        g_string_append(json, k > 0 ? ", " : "");
        append_json_string(json, done->files->pdata[k]);
    }
    g_string_append_c(json, ']');
    if (o->reference) {
        g_ascii_formatd(seconds, sizeof seconds, "%.4f", done->error);
        g_string_append_printf(json, ", \"relative_error\": %s", seconds);
    }
    g_print("%s}\n", json->str);
}

/* That of a material lies beside it. */
static char *mdf_path(const struct options *o, const char *material) {
    g_autofree char *folder = g_path_get_dirname(material);
    return o->mdf != NULL ? g_strdup(o->mdf) : g_build_filename(folder, "mdf.exr", NULL);
}

static int run(struct options *o) {
    g_autoptr(GError) error = NULL;
    const gboolean given = o->rest != NULL && o->rest[0] != NULL;
    g_autofree char *material = method_path(o->method, given ? o->rest[0] : o->method->name);
    g_autoptr(GPtrArray) files = g_ptr_array_new_with_free_func(g_free);
    struct rendered done = {.files = files};
    if (o->shape == NULL)
        o->shape = g_strdup("torus");
    o->mdf_path = mdf_path(o, material);
    gboolean good =
        o->render != NULL ? render(o, material, &done, &error) : show(o, material, &done, &error);
    if (!good)
        g_printerr("mesorig-view: %s\n", error->message);
    else if (o->json)
        report(o, material, &done);
    g_free(done.renderer);
    return good ? 0 : 1;
}

int main(int argc, char **argv) {
    setlocale(LC_ALL, "");
    struct options o = {.settings = view_settings_default};
    g_autoptr(GError) error = NULL;
    g_autoptr(GOptionContext) context = g_option_context_new("– show a measured material");
    g_autofree GOptionEntry *table = entries(&o);
    GOptionGroup *group = g_option_group_new("", "", "", &o, NULL);
    g_option_group_add_entries(group, table);
    g_option_context_set_main_group(context, group);
    g_option_context_set_description(
        context,
        "MATERIAL is the directory of a processed session, or a file that mesorig process or "
        "mesorig compress made; without one, woven fabric is shown.\n");
    int status = 0;
    gboolean parsed = g_option_context_parse(context, &argc, &argv, &error);
    if (parsed && o.version) {
        g_print("mesorig-view %s\n", MESORIG_VERSION);
    } else if (!parsed || !check_options(&o, &error)) {
        g_printerr("mesorig-view: %s\nTry “mesorig-view --help”.\n", error->message);
        status = 2;
    } else {
        status = run(&o);
    }
    options_clear(&o);
    return status;
}
