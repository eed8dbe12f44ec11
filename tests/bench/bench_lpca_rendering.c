/* Local PCA drawn by the pairs of measured directions (Schneider 2004 §5, the baseline), from a 3D
 * texture (§6) and on a grid of directions with simplices: the time of a frame, and the differences
 * of the pictures. The shape is a torus. The material has invented glossy lobes on 81 × 81
 * directions, or comes from a file. */
#include "bench.h"
#include "drawing/gl/gpu.h"
#include "drawing/methods/lpca_grid.h"
#include "drawing/methods/lpca_revised.h"
#include "drawing/methods/lpca_view.h"
#include "frame_time.h"
#include "lpca_rendering_parts.h"
#include "scene/viewer.h"
#include "shapes/scene.h"

#include <math.h>

#define TEXELS   64
#define CLUSTERS 32
#define LIMIT    2.0 /* at least so many times as fast, on a processor */

static void directions_81(float **ret_theta, float **ret_phi) {
    static const int counts[] = {1, 6, 12, 18, 20, 24};
    int n = 0;
    *ret_theta = g_new(float, 81);
    *ret_phi = g_new(float, 81);
    for (int ring = 0; ring < 6; ring++)
        for (int k = 0; k < counts[ring]; k++, n++) {
            (*ret_theta)[n] = 15.0f * ring;
            (*ret_phi)[n] = 360.0f * k / counts[ring];
        }
}

static void unit(float theta_deg, float phi_deg, double ret[3]) {
    const double theta = theta_deg * G_PI / 180, phi = phi_deg * G_PI / 180;
    ret[0] = sin(theta) * cos(phi);
    ret[1] = sin(theta) * sin(phi);
    ret[2] = cos(theta);
}

/* A Blinn lobe around a normal of its own, times n·l. */
static double lobe(const double v[3], const double l[3], double exponent, const double n[3]) {
    double dot = 0, length = 0;
    for (int k = 0; k < 3; k++) {
        const double h = v[k] + l[k];
        dot += h * n[k];
        length += h * h;
    }
    return l[2] * pow(fmax(dot / sqrt(length), 0), exponent);
}

/* Component 0 of a cluster is a diffuser with a lobe, the others narrower lobes that lean about. */
static void fill_component(struct lpca *p, GRand *random, int i, float *values) {
    double n[3];
    const double exponent = i == 0 ? 6 : g_rand_double_range(random, 4, 40);
    unit((float)(i == 0 ? 0 : g_rand_double_range(random, 0, 40)),
         (float)g_rand_double_range(random, 0, 360), n);
    for (gsize v = 0; v < p->layout.views.n; v++)
        for (gsize l = 0; l < p->layout.lights.n; l++, values += 3) {
            double from[3], to[3];
            unit(p->layout.views.theta_deg[v], p->layout.views.phi_deg[v], to);
            unit(p->layout.lights.theta_deg[l], p->layout.lights.phi_deg[l], from);
            const double value = lobe(to, from, exponent, n);
            values[0] = (float)(i == 0 ? 0.4 * from[2] + 0.3 * value : value);
            values[1] = (float)(i == 0 ? 0.3 * from[2] + 0.3 * value : 0.9 * value);
            values[2] = (float)(i == 0 ? 0.2 * from[2] + 0.3 * value : 0.8 * value);
        }
}

static struct lpca *make_lpca(int n_components) {
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    struct lpca *p = g_new0(struct lpca, 1);
    p->name = g_strdup("lobes");
    p->layout.width = p->layout.height = TEXELS;
    p->layout.views.n = p->layout.lights.n = 81;
    p->n_clusters = CLUSTERS;
    p->n_components = n_components;
    directions_81(&p->layout.views.theta_deg, &p->layout.views.phi_deg);
    directions_81(&p->layout.lights.theta_deg, &p->layout.lights.phi_deg);
    const gsize size = 3 * p->layout.views.n * p->layout.lights.n;
    p->clusters = g_new(int, TEXELS *TEXELS);
    p->weights = g_new(float, TEXELS *TEXELS *n_components);
    p->scales = g_new(float, CLUSTERS *(n_components + 1));
    p->weight_scales = g_new(float, CLUSTERS *n_components);
    for (int k = 0; k < CLUSTERS * n_components; k++)
        p->weight_scales[k] = 1;
    p->brdfs = g_new(float, size *CLUSTERS *(n_components + 1));
    for (int k = 0; k < CLUSTERS * (n_components + 1); k++) {
        p->scales[k] = 1;
        fill_component(p, random, k % (n_components + 1), p->brdfs + size * k);
    }
    /* Patches of 4 × 4 texels, as clusters of real materials are patches. */
    for (int k = 0; k < TEXELS * TEXELS; k++)
        p->clusters[k] = (k / TEXELS / 4 * 7 + k % TEXELS / 4 * 5) % CLUSTERS;
    for (int k = 0; k < TEXELS * TEXELS * n_components; k++)
        p->weights[k] = (float)g_rand_double_range(random, -0.1, 0.2);
    return p;
}

static struct viewer_settings without_sky(void) {
    struct viewer_settings s = viewer_settings_default;
    s.ambient = 0;
    return s;
}

static float *picture(Viewer *viewer, GError **error) {
    const struct viewer_settings s = without_sky();
    return viewer_render_linear(viewer, &s, 400, 300, error);
}

enum { PAIRS, REVISED, GRID, N_WAYS };

struct result { /* differences are RMS, relative to the RMS of the picture by pairs */
    int n_components, n_grid;
    double ms[N_WAYS], difference[N_WAYS];
    gint64 bytes[N_WAYS];
};

static double difference(const float *a, const float *by_pairs) {
    double off = 0, all = 0;
    for (gsize k = 0; k < 4 * 400 * 300; k++)
        if (k % 4 < 3 && by_pairs[k / 4 * 4 + 3] > 0) {
            off += pow(a[k] - by_pairs[k], 2);
            all += pow(by_pairs[k], 2);
        }
    return sqrt(off / all);
}

static gboolean compare(Viewer *const *viewers, struct result *r, GError **error) {
    g_autofree float *by_pairs = picture(viewers[PAIRS], error);
    for (int k = 0; k < N_WAYS; k++)
        r->bytes[k] = viewer_memory(viewers[k]).material;
    for (int k = REVISED; by_pairs && k < N_WAYS; k++) {
        g_autofree float *drawn = picture(viewers[k], error);
        if (!drawn)
            return FALSE;
        r->difference[k] = difference(drawn, by_pairs);
    }
    return by_pairs != NULL;
}

static gboolean set(Viewer *viewer, const struct method *method, gpointer material,
                    GError **error) {
    return material && viewer_set_method(viewer, method, material, error);
}

static gboolean measure(struct lpca *lpca, Viewer *const *viewers, int frames, struct result *r,
                        GError **error) {
    const struct viewer_settings s[N_WAYS] = {without_sky(), without_sky(), without_sky()};
    return set(viewers[PAIRS], &method_lpca, lpca_view_new(&lpca, 1, error), error) &&
           set(viewers[REVISED], &method_lpca_revised, lpca_revised_new(&lpca, 1, r->n_grid, error),
               error) &&
           set(viewers[GRID], &method_lpca_grid, lpca_grid_new(&lpca, 1, r->n_grid, error),
               error) &&
           time_in_turns(viewers, s, N_WAYS, frames, r->ms, NULL, error) &&
           compare(viewers, r, error);
}

static gboolean open_views(Viewer *viewers[N_WAYS], GError **error) {
    struct mesh *mesh = scene_torus(1.0, 0.4, 192, 96);
    gboolean good = TRUE;
    for (int k = 0; good && k < N_WAYS; k++)
        good = (viewers[k] = viewer_new(NULL, error)) && viewer_set_mesh(viewers[k], mesh, error);
    mesh_free(mesh);
    return good;
}

static gboolean bench(const char *file, int frames, GError **error) {
    static const struct {
        int n_components, n_grid;
    } cases[] = {{2, 12}, {4, 12}, {8, 8}, {8, 12}, {8, 16}};
    Viewer *viewers[N_WAYS] = {NULL};
    gboolean good = open_views(viewers, error);
    bench_begin_list("cases");
    for (gsize k = 0; good && k < G_N_ELEMENTS(cases); k++) {
        struct result r = {.n_components = cases[k].n_components, .n_grid = cases[k].n_grid};
        struct lpca *whole = file ? lpca_read(file, error) : make_lpca(r.n_components);
        struct lpca *lpca =
            whole ? lpca_truncated(whole, MIN(r.n_components, whole->n_components)) : NULL;
        good = lpca && measure(lpca, viewers, frames, &r, error);
        if (good) {
            static const char *const keys[N_WAYS] = {"pairs", "revised", "grid"};
            bench_begin(NULL);
            bench_put("%d{components} %d{grid} %.1f{limit}", r.n_components, r.n_grid, LIMIT);
            for (int way = 0; way < N_WAYS; way++) {
                bench_put_double(keys[way], "_ms", "%.2f", r.ms[way]);
                bench_put_double(keys[way], "_gpu_bytes", "%.0f", (double)r.bytes[way]);
            }
            for (int way = REVISED; way < N_WAYS; way++) {
                bench_put_double(keys[way], "_ratio", "%.3f", r.ms[PAIRS] / r.ms[way]);
                bench_put_double(keys[way], "_rms_difference", "%.4f", r.difference[way]);
            }
            bench_end();
        }
        lpca_free(whole);
        lpca_free(lpca);
    }
    bench_end();
    for (int k = 0; k < N_WAYS; k++)
        viewer_free(viewers[k]);
    return good;
}

static gboolean bench_fetches(const char *file, int frames, GError **error) {
    static const int n_components[] = {2, 4, 8};
    gboolean good = TRUE;
    bench_begin_list("fetches");
    for (gsize k = 0; good && k < G_N_ELEMENTS(n_components); k++) {
        g_autoptr(Lpca) whole = file ? lpca_read(file, error) : make_lpca(n_components[k]);
        g_autoptr(Lpca) lpca =
            whole ? lpca_truncated(whole, MIN(n_components[k], whole->n_components)) : NULL;
        good = lpca && lpca_rendering_fetches(lpca, 12, frames, error);
    }
    bench_end();
    return good;
}

static gboolean bench_mips(const char *file, int frames, GError **error) {
    bench_begin_list("mips");
    const gboolean good = lpca_rendering_mips(file, 12, frames, error);
    bench_end();
    return good;
}

int main(int argc, char **argv) {
    gboolean fetches = FALSE, mips = FALSE;
    int frames = 5;
    const GOptionEntry entries[] = {
        {"frames", 0, 0, G_OPTION_ARG_INT, &frames, "Timed frames of each, default 5", "N"},
        {"fetches", 0, 0, G_OPTION_ARG_NONE, &fetches, "Count and time texture fetches instead",
         NULL},
        {"mips", 0, 0, G_OPTION_ARG_NONE, &mips,
         "What the mip levels of lpca.exr cost and gain instead", NULL},
        {NULL}};
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, entries, "[lpca.exr]");
    if (frames < 1 || argc > 2 || (mips && argc < 2))
        bench_fail(2, "bad arguments");
    g_autoptr(Gpu) gpu = gpu_new_headless(&error);
    bench_check(error);
    bench_begin(NULL);
    bench_put("%s{renderer}", gpu_renderer());
    (mips      ? bench_mips
     : fetches ? bench_fetches
               : bench)(argc > 1 ? argv[1] : NULL, frames, &error);
    bench_end();
    bench_check(error);
    return 0;
}
