/* Time of a frame of neural planes with four rays and with one ray, compared with that of a local
 * PCA on a grid of directions, on a torus; and how much the pictures of one ray differ from those
 * of four, in ΔE00. Without neural.exr, the model is one of random numbers whose relief has hills.
 * Ratios are medians over frames. */
#include "bench.h"
#include "drawing/gl/gpu.h"
#include "drawing/methods/lpca_grid.h"
#include "drawing/methods/neural_view.h"
#include "frame_time.h"
#include "lib/neural_fixture.h"
#include "metrics/delta_e.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <stdlib.h>

#define DEPTH_TEXELS 4.0 /* depth of the relief of the random model, in texels */

enum { FOUR, ONE, GRID, N_WAYS };

/* Returns the constants of the method with another number of rays. */
static char *with_rays(gconstpointer material, const struct method_style *style, int n) {
    g_autofree char *own = method_neural.constants(material, style);
    return g_strdup_printf("%s#undef N_RAYS\n#define N_RAYS %d\n", own, n);
}

static char *four_rays(gconstpointer material, const struct method_style *style) {
    return with_rays(material, style, 4);
}

static char *one_ray(gconstpointer material, const struct method_style *style) {
    return with_rays(material, style, 1);
}

static gpointer open_neural(const char *file, int texels, GError **error) {
    if (file)
        return method_neural.open(file, error);
    struct neural *neural = neural_fixture_new(texels, texels, 12, DEPTH_TEXELS * 0.5, 1);
    NeuralView *view = neural_view_new(&neural, 1, error);
    neural_free(neural);
    return view;
}

static gboolean set(Viewer *viewer, const struct method *method, gpointer material,
                    const struct mesh *mesh, GError **error) {
    return material && viewer_set_method(viewer, method, material, error) &&
           viewer_set_mesh(viewer, mesh, error);
}

/* Compares pictures of both numbers of rays, at a distance of the camera in radii. */
static gboolean compare(Viewer *const *viewers, const struct viewer_settings *s, double distance,
                        GError **error) {
    enum { WIDTH = 400, HEIGHT = 300 };
    struct viewer_settings near = *s;
    near.camera_distance = distance;
    g_autofree float *four = viewer_render_linear(viewers[FOUR], &near, WIDTH, HEIGHT, error);
    g_autofree float *one =
        four ? viewer_render_linear(viewers[ONE], &near, WIDTH, HEIGHT, error) : NULL;
    g_autofree double *all = g_new(double, WIDTH *HEIGHT);
    double sum = 0;
    int n = 0;
    for (gsize k = 0; one && k < 4 * (gsize)WIDTH * HEIGHT; k += 4) {
        double lab[2][3];
        if (four[k + 3] <= 0)
            continue;
        delta_e_lab(four + k, lab[0]);
        delta_e_lab(one + k, lab[1]);
        all[n] = delta_e_2000(lab[0], lab[1]);
        sum += all[n++];
    }
    if (one)
        bench_row(NULL, "%.1f{distance} %.2f{mean_delta_e} %.2f{p99_delta_e}", distance,
                  sum / MAX(n, 1), bench_time_quantile(all, n, 0.99));
    return one != NULL;
}

static gboolean bench(const char *lpca, const char *neural, int texels, double ambient, int frames,
                      GError **error) {
    struct method four = method_neural, one = method_neural;
    four.constants = four_rays;
    one.constants = one_ray;
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 192, 96);
    g_autoptr(Viewer) a = viewer_new(NULL, error);
    g_autoptr(Viewer) b = viewer_new(NULL, error);
    g_autoptr(Viewer) c = viewer_new(NULL, error);
    Viewer *viewers[N_WAYS] = {a, b, c};
    struct viewer_settings s = viewer_settings_default;
    double ms[N_WAYS], ratio[N_WAYS];
    s.ambient = ambient;
    const struct viewer_settings settings[N_WAYS] = {s, s, s};
    const double begun_s = bench_now_s();
    gpointer opened = open_neural(neural, texels, error);
    const double open_s = bench_now_s() - begun_s;
    if (!set(a, &four, opened, mesh, error) ||
        !set(b, &one, open_neural(neural, texels, error), mesh, error) ||
        !set(c, &method_lpca_grid, method_lpca_grid.open(lpca, error), mesh, error) ||
        !time_in_turns(viewers, settings, N_WAYS, frames, ms, ratio, error))
        return FALSE;
    bench_put("%.2f{four_ms} %.2f{one_ms} %.2f{grid_ms} %.3f{four_ratio} %.3f{one_ratio}", ms[FOUR],
              ms[ONE], ms[GRID], ratio[FOUR], ratio[ONE]);
    bench_put("%.3f{open_s} %" G_GINT64_FORMAT "{neural_bytes} %" G_GINT64_FORMAT "{grid_bytes}",
              open_s, viewer_memory(a).material, viewer_memory(c).material);
    bench_begin_list("pictures");
    const gboolean ok = compare(viewers, &s, 4, error) && compare(viewers, &s, 2, error) &&
                        compare(viewers, &s, 1.5, error);
    bench_end();
    return ok;
}

int main(int argc, char **argv) {
    int frames = 9, texels = 256;
    double ambient = viewer_settings_default.ambient;
    const GOptionEntry entries[] = {
        {"frames", 0, 0, G_OPTION_ARG_INT, &frames, "Timed frames of each, default 9", "N"},
        {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Size of the random model, default 256", "N"},
        {"ambient", 0, 0, G_OPTION_ARG_DOUBLE, &ambient, "Light of the even sky", "L"},
        {NULL}};
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, "lpca.exr [neural.exr]");
    if (frames < 1 || argc < 2 || argc > 3 || texels < 2)
        bench_fail(2, "bad arguments");
    g_autoptr(Gpu) gpu = gpu_new_headless(&error);
    bench_check(error);
    bench_begin(NULL);
    bench_put("%s{renderer}", gpu_renderer());
    bench(argv[1], argc > 2 ? argv[2] : NULL, texels, ambient, frames, &error);
    bench_end();
    bench_check(error);
    return 0;
}
