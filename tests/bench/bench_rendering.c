/*
 * Compares the time of a frame of eigen-maps with that of a plain textured mesh on the same
 * graphics card, with the same mesh and size. Both are measured alternately. The material is made
 * here: glazed bumps with parallax and shadows. --write-material also saves it. The MDF is made
 * here as well. The times with silhouettes, and with silhouettes and shadows, are compared with the
 * time of the BTF alone. The shadows are computed again in every frame.
 */
#include "bench.h"
#include "codecs/eigenmaps/eigenmaps.h"
#include "drawing/gl/gpu.h"
#include "drawing/methods/eigenmaps_volume.h"
#include "frame_time.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define N_THETA 5
#define N_PHI   12
#define DEPTH   0.08 /* of the bumps, in tiles */

#define FINE 512

static float heights[FINE][FINE];

struct bumps {
    int n; /* texels each way */
    struct eigenmaps *maps;
    float *visible; /* light × texel: does the surface see the light */
};

/* 0 … 1; domes on a lattice, one tile a period. */
static double exact_height(double x, double y) {
    double best = 0.0;
    for (int j = -1; j <= 5; j++)
        for (int i = -1; i <= 4; i++) {
            double dx = (x - (i + 0.5 * (j & 1)) / 3.0) / 0.17, dy = (y - j / 4.0) / 0.15;
            best = fmax(best, 1.0 - dx * dx - dy * dy);
        }
    return sqrt(best);
}

static double height_at(double x, double y) {
    double u = (x - floor(x)) * FINE, v = (y - floor(y)) * FINE;
    int i = (int)u % FINE, j = (int)v % FINE, right = (i + 1) % FINE, up = (j + 1) % FINE;
    double s = u - floor(u), t = v - floor(v);
    return (1.0 - t) * ((1.0 - s) * heights[j][i] + s * heights[j][right]) +
           t * ((1.0 - s) * heights[up][i] + s * heights[up][right]);
}

static void unit(double theta_deg, double phi_deg, double ret[3]) {
    double theta = theta_deg * G_PI / 180.0, phi = phi_deg * G_PI / 180.0;
    ret[0] = sin(theta) * cos(phi);
    ret[1] = sin(theta) * sin(phi);
    ret[2] = cos(theta);
}

/* Follows a ray from the reference plane down along −v to the surface. */
static void trace(const double v[3], double *x, double *y) {
    double step = DEPTH / 64.0, z = 0.0;
    while (z > DEPTH * (height_at(*x, *y) - 1.0) && z > -DEPTH) {
        z -= step;
        *x -= step * v[0] / v[2];
        *y -= step * v[1] / v[2];
    }
}

static float lit(const double l[3], double x, double y) {
    double step = DEPTH / 32.0, z = DEPTH * (height_at(x, y) - 1.0) + 0.5 * step;
    for (; z < 0.0; z += step, x += step * l[0] / l[2], y += step * l[1] / l[2])
        if (z < DEPTH * (height_at(x, y) - 1.0))
            return 0.0f;
    return 1.0f;
}

static void shade(const struct bumps *b, int light, const double v[3], const double n[3], double x,
                  double y, float ret[3]) {
    static const double glaze[3] = {0.50, 0.16, 0.07}, ground[3] = {0.30, 0.27, 0.22};
    double l[3], up = height_at(x, y), h[3], length = 0.0, cosine = 0.0, half = 0.0;
    unit(b->maps->layout.lights.theta_deg[light], b->maps->layout.lights.phi_deg[light], l);
    for (int k = 0; k < 3; k++) {
        h[k] = l[k] + v[k];
        length += h[k] * h[k];
        cosine += n[k] * l[k];
        half += n[k] * h[k];
    }
    int i = (int)floor((x - floor(x)) * b->n) % b->n;
    int j = (int)floor((1.0 - (y - floor(y))) * b->n) % b->n;
    double visible = b->visible[((gsize)light * b->n + j) * b->n + i];
    double direct = visible * fmax(cosine, 0.0);
    double gloss = up > 0.0 ? 0.5 * pow(fmax(half / sqrt(length), 0.0), 24.0) : 0.0;
    double bounced = 0.12 * (0.3 + 0.7 * up) * l[2];
    for (int k = 0; k < 3; k++)
        ret[k] = (up > 0.0 ? glaze[k] : ground[k]) * (direct + bounced) + gloss * direct;
}

static gboolean column(int view, float *ret, gpointer data, GError **error) {
    const struct bumps *b = data;
    double v[3];
    unit(b->maps->layout.views.theta_deg[view], b->maps->layout.views.phi_deg[view], v);
    for (int j = 0; j < b->n; j++)
        for (int i = 0; i < b->n; i++) {
            double x = (i + 0.5) / b->n, y = 1.0 - (j + 0.5) / b->n;
            double n[3];
            trace(v, &x, &y);
            double e = 2.0 / FINE;
            n[0] = -DEPTH * (height_at(x + e, y) - height_at(x - e, y)) / (2.0 * e);
            n[1] = -DEPTH * (height_at(x, y + e) - height_at(x, y - e)) / (2.0 * e);
            n[2] = 1.0;
            double length = sqrt(n[0] * n[0] + n[1] * n[1] + 1.0);
            for (int k = 0; k < 3; k++)
                n[k] /= length;
            for (gsize light = 0; light < b->maps->layout.lights.n; light++)
                shade(b, light, v, n, x, y, ret + 3 * (((gsize)light * b->n + j) * b->n + i));
        }
    return TRUE;
}

static float *ring_angles(gboolean theta, double offset_deg) {
    float *angles = g_new(float, N_THETA *N_PHI), *out = angles;
    for (int j = 0; j < N_THETA; j++)
        for (int i = 0; i < N_PHI; i++)
            *out++ = theta ? 15.0 * (1 + j) : offset_deg + 360.0 / N_PHI * i;
    return angles;
}

static struct eigenmaps *make_material(int n, double *ret_error, GError **error) {
    struct eigenmaps *maps = g_new0(struct eigenmaps, 1);
    maps->name = g_strdup("glazed bumps");
    maps->layout.width = maps->layout.height = n;
    maps->layout.texel_mm = 50.0 / n;
    maps->layout.views.n = maps->layout.lights.n = N_THETA * N_PHI;
    maps->n_terms = 4;
    maps->layout.views.theta_deg = ring_angles(TRUE, 0.0);
    maps->layout.views.phi_deg = ring_angles(FALSE, 0.0);
    maps->layout.lights.theta_deg = ring_angles(TRUE, 0.0);
    maps->layout.lights.phi_deg = ring_angles(FALSE, 15.0);
    struct bumps bumps = {n, maps, NULL};
    for (int j = 0; j < FINE; j++)
        for (int i = 0; i < FINE; i++)
            heights[j][i] = exact_height((double)i / FINE, (double)j / FINE);
    bumps.visible = g_new(float, bumps.maps->layout.lights.n *bumps.n *bumps.n);
    for (gsize light = 0; light < bumps.maps->layout.lights.n; light++) {
        double l[3];
        unit(bumps.maps->layout.lights.theta_deg[light], bumps.maps->layout.lights.phi_deg[light],
             l);
        float *visible = bumps.visible + (gsize)light * bumps.n * bumps.n;
        for (int j = 0; j < bumps.n; j++)
            for (int i = 0; i < bumps.n; i++)
                *visible++ = lit(l, (i + 0.5) / bumps.n, 1.0 - (j + 0.5) / bumps.n);
    }
    gboolean good = eigenmaps_compute(maps, column, &bumps, ret_error, error);
    g_free(bumps.visible);
    if (good)
        return maps;
    eigenmaps_free(maps);
    return NULL;
}

/* The same bumps seen from each direction. */
static struct mdf_table *make_mdf(const struct eigenmaps *maps) {
    int n = maps->layout.width;
    struct mdf_table *mdf = g_new0(struct mdf_table, 1);
    *mdf = (struct mdf_table){.width = n,
                              .height = n,
                              .n_views = maps->layout.views.n,
                              .texel_mm = maps->layout.texel_mm};
    mdf->theta_deg = g_memdup2(maps->layout.views.theta_deg, maps->layout.views.n * sizeof(float));
    mdf->phi_deg = g_memdup2(maps->layout.views.phi_deg, maps->layout.views.n * sizeof(float));
    mdf->depth_mm = g_new(float, maps->layout.views.n *n *n);
    mdf->deepest_mm = DEPTH * n * maps->layout.texel_mm;
    float *out = mdf->depth_mm;
    for (gsize view = 0; view < maps->layout.views.n; view++)
        for (int j = 0; j < n; j++)
            for (int i = 0; i < n; i++) {
                double v[3], from_x = (i + 0.5) / n, from_y = 1.0 - (j + 0.5) / n;
                double x = from_x, y = from_y;
                unit(mdf->theta_deg[view], mdf->phi_deg[view], v);
                trace(v, &x, &y);
                double z = hypot(x - from_x, y - from_y) * v[2] / hypot(v[0], v[1]);
                *out++ = MIN(z, DEPTH) * n * maps->layout.texel_mm;
            }
    return mdf;
}

enum {
    BTF,
    PLAIN,
    VOLUME,
    SILHOUETTES,
    PEELED,
    SHADOWS,
    SHADOWS_ONLY,
    VIEWS,
    VIEWS_SHADOWS,
    ALONG,
    PUBLISHED,
    PUBLISHED_SHADOWS,
    N_VARIANTS
};
static const struct {
    const char *name;
    double limit; /* times the BTF only, or 0 */
} variants[N_VARIANTS] = {{"eigenmaps", 0},
                          {"plain", 0},
                          /* mesorig-view --method eigenmaps-volume */
                          {"eigenmaps_volume", 0},
                          {"silhouettes", 1.5},
                          {"peeled_silhouettes", 0},
                          {"silhouettes_shadows", 2.0},
                          {"shadows", 0},
                          /* mesorig-view --mdf-views */
                          {"views_silhouettes", 0},
                          {"views_silhouettes_shadows", 2.0},
                          {"along_surface", 0}, /* with silhouettes */
                          /* Peeling in a number of passes that the user says, straight rays and
                           * distances in a volume: Wang et al. 2005, table 2. */
                          {"published_silhouettes", 0},
                          {"published_silhouettes_shadows", 0}};
static int passes = 2;

static const char *const shapes[] = {"torus", "sphere", "cylinder", "torus-knot"};

/* Returns a shape of the viewer, or a torus of N × M quadrilaterals, such as 40x40. */
static struct mesh *make_mesh(const char *shape, GError **error) {
    int around, tube;
    char end;
    if (sscanf(shape, "%dx%d%c", &around, &tube, &end) == 2 && around >= 3 && tube >= 3)
        return scene_torus(1.0, 0.4, around, tube);
    return scene_shape(shape, SCENE_Z_UP, error);
}

static gboolean measure(Viewer *viewer, Viewer *of_volume, const char *shape, int frames,
                        GError **error) {
    Viewer *viewers[N_VARIANTS];
    struct viewer_settings settings[N_VARIANTS];
    double ms[N_VARIANTS];
    for (int v = 0; v < N_VARIANTS; v++) {
        viewers[v] = v == VOLUME ? of_volume : viewer;
        struct viewer_settings s = viewer_settings_default;
        s.camera_distance = 3.4; /* a picture of always the same pixels, whatever looks good */
        s.camera_elevation_deg = s.camera_fov_deg = 35.0;
        s.plain = v == PLAIN;
        const gboolean published = v >= PUBLISHED;
        s.silhouettes = v >= SILHOUETTES && v != SHADOWS_ONLY;
        s.shadows =
            v == SHADOWS || v == SHADOWS_ONLY || v == VIEWS_SHADOWS || v == PUBLISHED_SHADOWS;
        s.along_surface = v == ALONG;
        s.visibility.views = v == VIEWS || v == VIEWS_SHADOWS;
        s.visibility.way = v == PEELED || published ? VISIBILITY_PEEL : VISIBILITY_AUTO;
        s.visibility.straight = s.visibility.volume = published;
        if (published)
            s.visibility.layers = passes;
        settings[v] = s;
    }
    struct mesh *mesh = make_mesh(shape, error);
    const gboolean good = mesh != NULL && viewer_set_mesh(viewer, mesh, error) &&
                          viewer_set_mesh(of_volume, mesh, error) &&
                          time_in_turns(viewers, settings, N_VARIANTS, frames, ms, NULL, error);
    if (good) {
        bench_begin(NULL);
        bench_put("%s{shape} %u{triangles}", shape, mesh->n_indices / 3);
        for (int k = 0; k < N_VARIANTS; k++)
            bench_put_double(variants[k].name, "_ms", "%.2f", ms[k]);
        for (int k = VOLUME; k < N_VARIANTS; k++) {
            bench_put_double(variants[k].name, "_ratio", "%.3f", ms[k] / ms[BTF]);
            if (variants[k].limit > 0)
                bench_put_double(variants[k].name, "_limit", "%.2f", variants[k].limit);
        }
        bench_put("%.3f{along_surface_ratio_to_silhouettes} %.1f{along_surface_limit}",
                  ms[ALONG] / ms[SILHOUETTES], 2.0);
        bench_put("%.3f{ratio}", ms[BTF] / ms[PLAIN]);
        bench_end();
    }
    mesh_free(mesh);
    return good;
}

static gboolean bench(const struct eigenmaps *maps, const char *only, int frames, double residual,
                      GError **error) {
    g_autoptr(Gpu) gpu = gpu_new_headless(error);
    g_autoptr(Viewer) viewer = gpu != NULL ? viewer_new(maps, error) : NULL;
    g_autoptr(Viewer) of_volume = viewer != NULL ? viewer_new(NULL, error) : NULL;
    EigenmapsVolume *volume = of_volume != NULL ? eigenmaps_volume_new(maps, error) : NULL;
    if (volume == NULL || !viewer_set_method(of_volume, &method_eigenmaps_volume, volume, error))
        return FALSE;
    struct mdf_table *mdf = make_mdf(maps);
    gboolean good = viewer_set_mdf(viewer, &(struct mdf_source){.table = mdf}, error);
    mdf_table_free(mdf);
    const struct viewer_memory memory = viewer_memory(viewer);
    bench_begin(NULL);
    bench_put("%s{renderer} %d{width} %d{height} %zu{texels} %d{terms} %d{lights} %d{frames} "
              "%.4f{svd_error} %" G_GINT64_FORMAT "{gpu_bytes} %" G_GINT64_FORMAT "{gpu_bytes_mdf}",
              gpu_renderer(), 800, 600, maps->layout.width, 4, N_THETA * N_PHI, frames, residual,
              memory.material, memory.mdf);
    bench_begin_list("scenes");
    for (gsize k = 0; good && k < (only ? 1 : G_N_ELEMENTS(shapes)); k++)
        good = measure(viewer, of_volume, only ? only : shapes[k], frames, error);
    bench_end();
    bench_end();
    return good;
}

int main(int argc, char **argv) {
    int frames = 20, texels = 64;
    g_autofree char *write = NULL, *only = NULL;
    const GOptionEntry entries[] = {
        {"frames", 0, 0, G_OPTION_ARG_INT, &frames, "Timed frames of each, default 20", "N"},
        {"passes", 0, 0, G_OPTION_ARG_INT, &passes, "Of the published peeling, default 2", "N"},
        {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Texels each way, default 64", "N"},
        {"shape", 0, 0, G_OPTION_ARG_STRING, &only, "Only this shape, or a torus of N × M faces",
         "SHAPE|NxM"},
        {"write-material", 0, 0, G_OPTION_ARG_FILENAME, &write, "Save it, time nothing",
         "eigenmaps.exr"},
        {NULL}};
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, NULL);
    if (frames < 1 || texels < 4 || passes < 1 || passes > VISIBILITY_MAX_LAYERS)
        bench_fail(2, "bad number");
    double residual;
    struct eigenmaps *maps = make_material(texels, &residual, &error);
    bench_check(error);
    if (write)
        eigenmaps_write(write, maps, &error);
    else
        bench(maps, only, frames, residual, &error);
    bench_check(error);
    eigenmaps_free(maps);
    return 0;
}
