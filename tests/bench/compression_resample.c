#include "compression_parts.h"

#include "bench.h"
#include "codecs/lpca/lpca_resample.h"
#include "directions/triangulation.h"

#include <math.h>

/* The three measured directions around each of others: barycentric in the stereographic plane. */
struct triples {
    int *index;     /* × 3 */
    double *weight; /* × 3 */
};

static void stereographic(float theta_deg, float phi_deg, double ret[2]) {
    const double r = tan(theta_deg * G_PI / 360), phi = phi_deg * G_PI / 180;
    ret[0] = r * cos(phi);
    ret[1] = r * sin(phi);
}

static struct triples triples_new(const float *theta_deg, const float *phi_deg, int n,
                                  const float *at_theta_deg, const float *at_phi_deg, int n_at) {
    struct triples ret = {g_new0(int, 3 * n_at), g_new0(double, 3 * n_at)};
    g_autofree double *points = g_new(double, 2 * n);
    for (int i = 0; i < n; i++)
        stereographic(theta_deg[i], phi_deg[i], points + (gsize)(2 * i));
    Triangulation *triangulation = triangulation_new(points, n);
    for (int i = 0; i < n_at; i++) {
        double at[2], nearest[2];
        stereographic(at_theta_deg[i], at_phi_deg[i], at);
        triangulation_weights(triangulation, at, ret.index + (gsize)(3 * i),
                              ret.weight + (gsize)(3 * i), nearest);
    }
    triangulation_free(triangulation);
    return ret;
}

static void triples_clear(struct triples *triples) {
    g_free(triples->index);
    g_free(triples->weight);
}

static double mix(const float *row, int n_lights, const struct triples *views, int view,
                  const struct triples *lights, int light, int colour) {
    double sum = 0;
    for (int a = 0; a < 3; a++)
        for (int b = 0; b < 3; b++)
            sum += views->weight[3 * view + a] * lights->weight[3 * light + b] *
                   row[(views->index[3 * view + a] * n_lights + lights->index[3 * light + b]) * 3 +
                       colour];
    return sum;
}

static double nine_pairs(const struct lpca *lpca, const struct btf_matrix *truth) {
    struct triples views = triples_new(lpca->layout.views.theta_deg, lpca->layout.views.phi_deg,
                                       lpca->layout.views.n, truth->layout.views.theta_deg,
                                       truth->layout.views.phi_deg, truth->layout.views.n);
    struct triples lights = triples_new(lpca->layout.lights.theta_deg, lpca->layout.lights.phi_deg,
                                        lpca->layout.lights.n, truth->layout.lights.theta_deg,
                                        truth->layout.lights.phi_deg, truth->layout.lights.n);
    g_autofree float *row = g_new(float, btf_layout_values(&lpca->layout));
    const float *value = truth->values;
    double rest = 0, all = 0;
    for (gsize texel = 0; texel < btf_layout_texels(&truth->layout); texel++) {
        lpca_reconstruct(lpca, texel, row);
        for (gsize i = 0; i < btf_layout_values(&truth->layout); i++, value++) {
            const double found =
                mix(row, lpca->layout.lights.n, &views, i / 3 / truth->layout.lights.n, &lights,
                    i / 3 % truth->layout.lights.n, i % 3);
            rest += (found - *value) * (found - *value);
            all += (double)*value * *value;
        }
    }
    triples_clear(&views);
    triples_clear(&lights);
    return sqrt(rest / all);
}

static void print_grid(const struct lpca *lpca, int n_grid, const struct btf_matrix *at,
                       const struct btf_matrix *between, double nine) {
    const double start = bench_now_s();
    struct lpca *grid = lpca_resample(lpca, n_grid, NULL);
    const double seconds = bench_now_s() - start;
    const double here = lpca_resample_error(grid, at, 0),
                 there = lpca_resample_error(grid, between, 0);
    bench_row(NULL, "%d{grid} %.2f{seconds} %.5f{error} %.5f{between} %.3f{ratio}", n_grid, seconds,
              here, there, there / nine);
    lpca_free(grid);
}

static void measure(struct btf_matrix *at, struct btf_matrix *between, int clusters, int components,
                    GError **error) {
    const struct lpca_options options = {.n_clusters = clusters, .n_components = components};
    struct lpca *lpca = at && between ? lpca_compute(at, &options, error) : NULL;
    if (!lpca)
        return;
    const double nine = nine_pairs(lpca, between);
    bench_begin(NULL);
    bench_put("%s{name} %.5f{error} %.5f{nine_pairs_between}", at->name, lpca->error, nine);
    bench_begin_list("grids");
    for (int n_grid = 8; n_grid <= 16; n_grid += 2)
        print_grid(lpca, n_grid, at, between, nine);
    bench_end();
    bench_end();
    lpca_free(lpca);
}

int bench_resample(char *const *sessions, int clusters, int components) {
    g_autoptr(GError) error = NULL;
    bench_begin(NULL);
    bench_begin_list("materials");
    for (int i = 0; sessions[i] && sessions[i + 1]; i += 2) {
        struct btf_matrix *at = btf_matrix_read(sessions[i], NULL, &error);
        struct btf_matrix *between = at ? btf_matrix_read(sessions[i + 1], NULL, &error) : NULL;
        measure(at, between, clusters, components, &error);
        btf_matrix_free(at);
        btf_matrix_free(between);
        bench_check(error);
    }
    bench_end();
    bench_end();
    return 0;
}
