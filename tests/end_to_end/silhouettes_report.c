/*
 * Silhouettes and shadows of a simulated material on a torus or a cylinder above a floor, as
 * mesorig-view draws them from the products of its session, against the same scene with the
 * sample's true surface, ray traced. Also makes that scene's picture.
 */
#include "base/srgb.h"
#include "drawing/gl/gpu.h"
#include "drawing/methods/methods.h"
#include "lib/silhouettes_fixture.h"
#include "metrics/flip.h"
#include "metrics/psnr.h"
#include "scene/file_kind.h"
#include "scene/picture.h"

#include <locale.h>
#include <stdio.h>
#include <string.h>

struct options {
    char *world, *session, *material, *picture, *size, **tiles, **rest;
    gboolean json, no_floor, traced_mdf;
    int width, height, texels;
    double tile_mm, reference_mm;
    struct viewer_settings view;
    const struct silhouettes_shape *shape;
    gboolean cylinder;
};

/* What the session's MDF says of its texels. */
static gboolean read_grid(struct options *o, const char *path, GError **error) {
    struct exr_file *file = exr_read_headers(path, error);
    const struct exr_part *part =
        file != NULL && file->parts->len > 0 ? file->parts->pdata[0] : NULL;
    double texel_mm = 0;
    gboolean good = part != NULL && exr_get_double(part, "texel_mm", &texel_mm, error) &&
                    exr_get_double(part, "reference_mm", &o->reference_mm, error);
    if (good)
        o->tile_mm = texel_mm * (o->texels = part->width);
    exr_file_free(file);
    return good;
}

static Viewer *open_view(const struct options *o, World *world, int tiles_u, int tiles_v,
                         GError **error) {
    struct file_opened file = {.method = methods[0]};
    g_autofree char *material =
        o->material != NULL ? g_strdup(o->material) : method_path(methods[0], o->session);
    if (o->material != NULL && !file_kind_find(o->material, &file, error))
        return NULL;
    const struct truth_grid grid = {o->texels, o->texels, o->tile_mm, o->tile_mm, o->reference_mm};
    g_autofree char *mdf = o->traced_mdf
                               ? silhouettes_write_truth(world, &grid)
                               : g_build_filename(o->session, "products", "mdf.exr", NULL);
    const struct scene_options scene = {tiles_u, tiles_v, SCENE_Z_UP, !o->no_floor};
    struct mesh *mesh = scene_make(o->shape->name, &scene, error);
    g_autoptr(Viewer) view = viewer_new(NULL, error);
    gboolean good = view != NULL && viewer_open(view, file.method, material, error) &&
                    viewer_open_mdf(view, mdf, error) && viewer_set_mesh(view, mesh, error);
    mesh_free(mesh);
    file_opened_clear(&file);
    return good ? g_steal_pointer(&view) : NULL;
}

static gboolean compare(const struct options *o, Viewer *view, const struct viewer_settings *s,
                        const struct displaced_pixel *truth, struct scores *ret, GError **error) {
    g_autofree float *seen =
        viewer_render_geometry(view, s, VIEWER_GEOMETRY_LIT, o->width, o->height, error);
    if (seen == NULL)
        return FALSE;
    *ret = silhouettes_score(o->shape, seen, truth, s, o->width, o->height, !o->no_floor);
    return TRUE;
}

enum { BTF, STRAIGHT, VIEWS, MDF, ALONG, N_WAYS };

/* The scene as diffuse surfaces: direct light, and ambient light as the viewer adds it. Returns the
 * picture as the viewer shows it, width × height × 3 bytes. */
static guint8 *traced_picture(const struct options *o, Displaced *displaced, Viewer *view,
                              const struct viewer_settings *s, GError **error) {
    int w = o->width * s->samples, h = o->height * s->samples;
    g_autofree struct displaced_pixel *pixels = silhouettes_trace(o->shape, displaced, s, w, h);
    g_autofree float *linear = g_new0(float, 4 * (gsize)w * h);
    for (int k = 0; k < w * h; k++) {
        const struct displaced_pixel *p = &pixels[k];
        float *to = linear + 4 * (gsize)k;
        to[3] = p->part != DISPLACED_NONE;
        for (int c = 0; c < 3; c++)
            to[c] = p->part == DISPLACED_NONE
                        ? 0.03f
                        : p->albedo[c] * ((p->dark ? 0 : p->cosine) + (float)s->ambient);
    }
    return viewer_resolve(view, s, linear, o->width, o->height, error);
}

/* The scores of a way: shares of outline and shadow, and FLIP and PSNR of the whole picture. */
struct way_scores {
    struct scores shares;
    double flip, psnr;
};

/* Returns the picture as linear sRGB, n values. */
static float *linear_picture(const guint8 *rgb, gsize n) {
    float *linear = g_new(float, n);
    for (gsize k = 0; k < n; k++)
        linear[k] = (float)srgb_decode((double)rgb[k] / 255.0);
    return linear;
}

static gboolean measure(const struct options *o, Displaced *displaced, Viewer *view,
                        const struct viewer_settings *s, struct way_scores ret[N_WAYS],
                        GError **error) {
    const gsize n = 3 * (gsize)o->width * o->height;
    g_autofree struct displaced_pixel *truth =
        silhouettes_trace(o->shape, displaced, s, o->width, o->height);
    g_autofree guint8 *traced = traced_picture(o, displaced, view, s, error);
    if (traced == NULL)
        return FALSE;
    g_autofree float *reference = linear_picture(traced, n);
    for (int way = 0; way < N_WAYS; way++) {
        struct viewer_settings one = *s;
        one.shadows = TRUE;
        one.silhouettes = way != BTF;
        one.visibility.straight = way == STRAIGHT;
        one.visibility.views = way == VIEWS;
        one.along_surface = way == ALONG;
        g_autofree float *light =
            viewer_render_linear(view, &one, o->width * s->samples, o->height * s->samples, error);
        g_autofree guint8 *drawn =
            light != NULL ? viewer_resolve(view, s, light, o->width, o->height, error) : NULL;
        if (drawn == NULL || !compare(o, view, &one, truth, &ret[way].shares, error))
            return FALSE;
        g_autofree float *test = linear_picture(drawn, n);
        ret[way].flip =
            flip_ldr(reference, test, o->width, o->height, FLIP_PIXELS_PER_DEGREE, NULL);
        ret[way].psnr = psnr(reference, test, o->width, o->height);
    }
    return TRUE;
}

static gboolean make_picture(const struct options *o, Displaced *displaced, Viewer *view,
                             const struct viewer_settings *s, GError **error) {
    g_autofree guint8 *rgb = traced_picture(o, displaced, view, s, error);
    g_autofree char *world = g_path_get_basename(o->world); /* nobody's business where it lies */
    const char *texts[] = {"Software", "silhouettes_report", "World", world, NULL};
    return rgb != NULL && picture_write_png(o->picture, rgb, o->width, o->height, texts, error);
}

static gboolean run_tiling(const struct options *o, World *world, const char *tiles,
                           GError **error) {
    int u, v;
    char end;
    if (sscanf(tiles, "%3dx%3d%c", &u, &v, &end) != 2 || u < 1 || v < 1) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_BAD_VALUE,
                    "--tiles %s: UxV is expected, whole numbers", tiles);
        return FALSE;
    }
    struct truth_surface surface;
    struct displaced_shape shape =
        silhouettes_displaced(o->shape, u, v, !o->no_floor, o->tile_mm, o->reference_mm);
    truth_surface(world, &surface);
    g_autoptr(Viewer) view = open_view(o, world, u, v, error);
    if (view == NULL)
        return FALSE;
    g_autoptr(Displaced) displaced = displaced_new(&surface, &shape);
    struct viewer_settings s = o->view;
    viewer_fit(view, &s, (double)o->width / o->height);
    if (o->picture != NULL)
        return make_picture(o, displaced, view, &s, error);
    struct way_scores scores[N_WAYS];
    if (!measure(o, displaced, view, &s, scores, error))
        return FALSE;
    static const char *const names[N_WAYS] = {"btf_only", "flat_rays", "views", "mdf", "along"};
    if (o->json)
        printf("{\"tiles\": \"%dx%d\"", u, v);
    else
        printf("%dx%d\n", u, v);
    for (int way = 0; way < N_WAYS; way++)
        printf(o->json ? ", \"%s\": {\"outline\": %.4f, \"shadow\": %.4f, \"flip\": %.4f, "
                         "\"psnr\": %.2f}"
                       : "  %-10s outline %.4f  shadow on the floor %.4f  FLIP %.4f  PSNR %.2f\n",
               names[way], overlap_share(&scores[way].shares.outline),
               overlap_share(&scores[way].shares.shadow), scores[way].flip, scores[way].psnr);
    printf(o->json ? "}" : "");
    return TRUE;
}

static gboolean run(struct options *o, GError **error) {
    static const char *const usual[] = {"8x3", "6x2", "3x1", "2x1",
                                        NULL}; /* Wang et al. 2005 fig. 11 */
    const char *const *tiles = o->tiles != NULL ? (const char *const *)o->tiles : usual;
    g_autofree char *mdf = g_build_filename(o->session, "products", "mdf.exr", NULL);
    g_autoptr(World) world = world_get(o->world, error);
    if (world == NULL || !read_grid(o, mdf, error))
        return FALSE;
    g_autoptr(Gpu) gpu = gpu_new_headless(error);
    if (gpu == NULL)
        return FALSE;
    gboolean print = o->json && o->picture == NULL;
    if (print)
        printf("{\"width\": %d, \"height\": %d, \"iou\": [", o->width, o->height);
    for (int k = 0; tiles[k] != NULL; k++) {
        printf("%s", print && k > 0 ? ", " : "");
        if (!run_tiling(o, world, tiles[k], error))
            return FALSE;
    }
    printf(print ? "]}\n" : "");
    return TRUE;
}

static gboolean parse(struct options *o, int *argc, char ***argv, GError **error) {
    struct viewer_settings *s = &o->view;
    const GOptionEntry entries[] = {
        {"tiles", 0, 0, G_OPTION_ARG_STRING_ARRAY, &o->tiles,
         "Along the shape; may be repeated; default 8x3, 6x2, 3x1 and 2x1", "UxV"},
        {"material", 0, 0, G_OPTION_ARG_FILENAME, &o->material,
         "Draw this compressed BTF instead of the session's eigen-maps", "FILE"},
        {"picture", 0, 0, G_OPTION_ARG_FILENAME, &o->picture,
         "Write the ray-traced scene instead of measuring", "OUT.png"},
        {"size", 0, 0, G_OPTION_ARG_STRING, &o->size, "Pixels, default 800x600", "WxH"},
        {"supersample", 0, 0, G_OPTION_ARG_INT, &s->samples, "Of the picture, each way, default 3",
         "N"},
        {"cylinder", 0, 0, G_OPTION_ARG_NONE, &o->cylinder, "Instead of a torus", NULL},
        {"traced-mdf", 0, 0, G_OPTION_ARG_NONE, &o->traced_mdf,
         "With exact distances instead of the session's, for cameras at 15, 30, 45, 60 and 75 deg",
         NULL},
        {"no-floor", 0, 0, G_OPTION_ARG_NONE, &o->no_floor, "The shape alone", NULL},
        {"light-theta-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->light_theta_deg, "As mesorig-view",
         "DEG"},
        {"light-phi-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->light_phi_deg, "As mesorig-view", "DEG"},
        {"camera-azimuth-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->camera_azimuth_deg, "As mesorig-view",
         "DEG"},
        {"camera-elevation-deg", 0, 0, G_OPTION_ARG_DOUBLE, &s->camera_elevation_deg,
         "As mesorig-view", "DEG"},
        {"camera-distance", 0, 0, G_OPTION_ARG_DOUBLE, &s->camera_distance, "As mesorig-view", "R"},
        {"json", 0, 0, G_OPTION_ARG_NONE, &o->json, "One JSON object", NULL},
        {G_OPTION_REMAINING, 0, 0, G_OPTION_ARG_FILENAME_ARRAY, &o->rest, NULL,
         "WORLD.conf SESSION"},
        {NULL}};
    g_autoptr(GOptionContext) context = g_option_context_new(NULL);
    char end;
    g_option_context_add_main_entries(context, entries, NULL);
    if (!g_option_context_parse(context, argc, argv, error))
        return FALSE;
    if (o->rest == NULL || g_strv_length(o->rest) != 2 ||
        (o->size != NULL && sscanf(o->size, "%4dx%4d%c", &o->width, &o->height, &end) != 2)) {
        g_set_error(error, G_OPTION_ERROR, G_OPTION_ERROR_FAILED,
                    "WORLD.conf and SESSION are expected, --size as WxH");
        return FALSE;
    }
    o->world = o->rest[0];
    o->session = o->rest[1];
    o->shape = o->cylinder ? &silhouettes_cylinder : &silhouettes_torus;
    return viewer_settings_check(s, error);
}

int main(int argc, char **argv) {
    setlocale(LC_ALL, "");
    struct options o = {.width = 800, .height = 600, .view = viewer_settings_default};
    o.view.samples = 3;
    g_autoptr(GError) error = NULL;
    int status = !parse(&o, &argc, &argv, &error) ? 2 : !run(&o, &error) ? 1 : 0;
    if (error != NULL)
        g_printerr("silhouettes_report: %s\n", error->message);
    g_free(o.picture);
    g_free(o.size);
    g_strfreev(o.tiles);
    g_strfreev(o.rest);
    return status;
}
