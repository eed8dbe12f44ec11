/*
 * Larger materials from samples: the time to make their maps, and the time of a frame that is drawn
 * through a map, relative to the repeated sample. At decreasing sizes, the picture is also compared
 * with that of the material with all its texels stored, whose mip levels are averages. The sample
 * is made here: bumps at random places, and bumps on a regular grid, each under 12 views and 12
 * lights.
 */
#include "bench.h"
#include "codecs/eigenmaps/eigenmaps_codec.h"
#include "frame_time.h"
#include "lib/btf_fixture.h"
#include "shapes/scene.h"
#include "synthesis/synthesis.h"

#include <math.h>
#include <string.h>

#define SIDE    64  /* texels of the sample each way */
#define MAP     256 /* of the map */
#define BUMPS   90
#define TERMS   4
#define SIZES   4
#define PICTURE 256

static int frames = 7;

static const GOptionEntry options[] = {
    {"frames", 0, 0, G_OPTION_ARG_INT, &frames, "Frames that are timed, 7", "N"},
    {NULL},
};

/* Lambert's law over hemispherical bumps with parallax of half their height. */
static struct btf_matrix *make_sample(gboolean ordered) {
    struct btf_matrix *btf =
        btf_fixture_of("bumps", SIDE, SIDE, btf_fixture_two_rings(0), btf_fixture_two_rings(15));
    const gsize values = btf_layout_values(&btf->layout), lights = btf->layout.lights.n;
    g_autofree float *l = direction_list_vectors(&btf->layout.lights);
    g_autofree float *v = direction_list_vectors(&btf->layout.views);
    double at[2 * BUMPS], tint[BUMPS];
    GRand *random = g_rand_new_with_seed(1);
    for (int k = 0; k < BUMPS; k++) {
        at[2 * k] = ordered ? 4 + 7.1 * (k % 9) : g_rand_double_range(random, 0, SIDE);
        at[2 * k + 1] = ordered ? 4 + 7.1 * (k / 9) : g_rand_double_range(random, 0, SIDE);
        tint[k] = g_rand_double_range(random, 0.3, 0.9);
    }
    for (gsize i = 0; i < (gsize)SIDE * SIDE; i++)
        for (gsize view = 0; view < btf->layout.views.n; view++) {
            const double x = (double)(i % SIDE) + 0.9 * v[3 * view];
            const double y = (double)(i / SIDE) - 0.9 * v[3 * view + 1];
            double n[3] = {0, 0, 1}, colour = 0.15, top = 0;
            for (int k = 0; k < BUMPS; k++) {
                const double dx = (x - at[2 * k]) / 3, dy = (y - at[2 * k + 1]) / 3;
                const double z = 1 - dx * dx - dy * dy;
                if (z > top) {
                    top = z;
                    n[0] = dx, n[1] = -dy, n[2] = sqrt(z);
                    colour = tint[k];
                }
            }
            for (gsize k = 0; k < lights; k++) {
                const double cosine = n[0] * l[3 * k] + n[1] * l[3 * k + 1] + n[2] * l[3 * k + 2];
                float *to = btf->values + i * values + 3 * (view * lights + k);
                to[0] = (float)(colour * fmax(cosine, 0));
                to[1] = to[2] = 0.5F * to[0] + 0.02F * (float)g_rand_double(random);
            }
        }
    g_rand_free(random);
    return btf;
}

static struct eigenmaps *laid_out(const struct eigenmaps *from, const struct index_map *map) {
    struct eigenmaps *to = g_memdup2(from, sizeof *from);
    const gsize n = (gsize)from->n_terms * from->layout.lights.n;
    const gsize texels = (gsize)map->width * (gsize)map->height;
    to->name = g_strdup(from->name);
    to->layout = btf_layout_copy(&from->layout);
    to->layout.width = (gsize)map->width;
    to->layout.height = (gsize)map->height;
    to->weights =
        g_memdup2(from->weights, sizeof(float) * (gsize)from->n_terms * from->layout.views.n);
    to->maps = g_new(float, 3 * n * texels);
    for (gsize k = 0; k < n; k++)
        for (gsize i = 0; i < texels; i++) {
            const guint16 *s = map->levels[0] + 2 * i;
            memcpy(to->maps + 3 * (k * texels + i),
                   from->maps + 3 * (k * SIDE * SIDE + (gsize)s[1] * SIDE + s[0]),
                   3 * sizeof(float));
        }
    return to;
}

static Viewer *view_of(const struct eigenmaps *maps, const struct index_map *map,
                       const struct mesh *mesh) {
    g_autoptr(GError) error = NULL;
    Viewer *viewer = viewer_new(maps, &error);
    bench_check(error);
    if (!viewer_set_mesh(viewer, mesh, &error) || !viewer_set_index(viewer, map, &error))
        bench_check(error);
    return viewer;
}

static struct viewer_settings settings_of(double u, double v) {
    struct viewer_settings s = viewer_settings_default;
    s.tiles_u = u;
    s.tiles_v = v;
    s.ambient = 0;
    return s;
}

/* RMS difference of two pictures of a plane, relative to the second, at 1 sample a pixel. */
static double difference(Viewer *through, Viewer *laid, double repeats) {
    g_autoptr(GError) error = NULL;
    struct viewer_settings s = settings_of(repeats * MAP / SIDE, repeats * MAP / SIDE);
    struct viewer_settings t = settings_of(repeats, repeats);
    s.camera_elevation_deg = t.camera_elevation_deg = 70;
    g_autofree float *a = viewer_render_linear(through, &s, PICTURE, PICTURE, &error);
    g_autofree float *b = viewer_render_linear(laid, &t, PICTURE, PICTURE, &error);
    double squares = 0, all = 0;
    bench_check(error);
    for (int i = 0; i < PICTURE * PICTURE; i++)
        for (int c = 0; c < 3 && b[4 * i + 3] > 0.5F; c++) {
            squares += pow(a[4 * i + c] - b[4 * i + c], 2);
            all += b[4 * i + c] * (double)b[4 * i + c];
        }
    return sqrt(squares / all);
}

struct figures {
    double features_s, seconds[2], order[2], seam[2], seam_share[2];
    double ms[3], times[3]; /* through textons, through quilting, the sample repeated */
    double differences[2][SIZES];
    gint64 bytes_sample, bytes_index, bytes_laid_out;
};

static void measure(gboolean ordered, struct figures *f) {
    static const enum synthesis_method ways[2] = {SYNTHESIS_TEXTONS, SYNTHESIS_QUILTING};
    const struct eigenmaps_options exact = {.method = EIGENMAPS_EXACT};
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = make_sample(ordered);
    double start = bench_cpu_s(), spent;
    g_autoptr(TexelFeatures) features = texel_features_compute(btf, NULL, NULL, &error);
    bench_check(error);
    f->features_s = bench_cpu_s() - start;
    struct eigenmaps *maps = eigenmaps_of_matrix(btf, TERMS, &exact, NULL, &spent, &error);
    bench_check(error);
    g_autoptr(Mesh) torus = scene_torus(1.0, 0.4, 256, 128), plane = scene_plane();
    Viewer *viewers[3] = {NULL, NULL, view_of(maps, NULL, torus)};
    struct viewer_settings settings[3];
    for (int k = 0; k < 2; k++) {
        const struct synthesis_options wanted = {ways[k], MAP, MAP, 0, 1};
        struct synthesis_result result;
        start = bench_cpu_s();
        g_autoptr(IndexMap) map = synthesis_of_features(features, &wanted, NULL, &result, &error);
        bench_check(error);
        f->seconds[k] = bench_cpu_s() - start;
        f->order[k] = result.order[ways[k]];
        f->seam[k] = result.seams.seam / result.seams.inside;
        f->seam_share[k] = (double)result.seams.seams / result.seams.pairs;
        viewers[k] = view_of(maps, map, torus);
        struct eigenmaps *whole = laid_out(maps, map);
        Viewer *through = view_of(maps, map, plane), *laid = view_of(whole, NULL, plane);
        for (int size = 0; size < SIZES; size++)
            f->differences[k][size] = difference(through, laid, 0.5 * (1 << size));
        f->bytes_sample = viewer_memory(through).material;
        f->bytes_index = viewer_memory(through).index;
        f->bytes_laid_out = viewer_memory(laid).material;
        viewer_free(through);
        viewer_free(laid);
        eigenmaps_free(whole);
    }
    for (int k = 0; k < 3; k++)
        settings[k] = settings_of(12, 4);
    if (!time_in_turns(viewers, settings, 3, frames, f->ms, f->times, &error))
        bench_check(error);
    for (int k = 0; k < 3; k++)
        viewer_free(viewers[k]);
    eigenmaps_free(maps);
}

static void print(const char *name, const struct figures *f) {
    static const char *const ways[2] = {"textons", "quilting"};
    bench_begin(NULL);
    bench_put("%s{sample} %.3f{features_s} %.2f{plain_ms} %" G_GINT64_FORMAT
              "{bytes_sample} %" G_GINT64_FORMAT "{bytes_index} %" G_GINT64_FORMAT
              "{bytes_laid_out}",
              name, f->features_s, f->ms[2], f->bytes_sample, f->bytes_index, f->bytes_laid_out);
    for (int k = 0; k < 2; k++) {
        bench_begin(ways[k]);
        bench_put("%.3f{seconds} %.4f{order} %.3f{seam_error} %.4f{seam_share} %.3f{ratio}",
                  f->seconds[k], f->order[k], f->seam[k], f->seam_share[k], f->times[k]);
        bench_put_doubles("differences", "%.4f", f->differences[k], SIZES);
        bench_end();
    }
    bench_end();
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, options, NULL);
    g_autoptr(Gpu) gpu = gpu_new_headless(&error);
    bench_check(error);
    for (int ordered = 0; ordered < 2; ordered++) {
        struct figures figures;
        measure(ordered, &figures);
        print(ordered ? "ordered" : "irregular", &figures);
    }
    return 0;
}
