/* Meseth et al. 2003 §4.1, for luminances B(x, v, l) that contain n·l.
 *
 * Reciprocity means B(v, l) / cos θ_l = B(l, v) / cos θ_v. Conservation of energy means Σ_v w_v
 * B(v, l) / cos θ_l ≤ 1, where w_v is the cosine-weighted solid angle of view v over π. */
#include "energy.h"

#include "base/data_error.h"
#include "base/vec.h"

#include <math.h>

#define SAME_DEG 1.0
/* number of points of weigh_views() over the unit disc, in each dimension */
#define SAMPLES_ASIDE 200
#define MIN_COSINE    0.05 /* lights and views whose cos θ is at most this are left out */
#define ROWS          256  /* number of texels that are read at a time */

static struct vec3 *directions(const struct direction_list *list) {
    struct vec3 *all = g_new(struct vec3, list->n);
    for (gsize i = 0; i < list->n; i++) {
        const double theta = (double)list->theta_deg[i] * G_PI / 180;
        const double phi = (double)list->phi_deg[i] * G_PI / 180;
        all[i] = vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
    }
    return all;
}

/* Returns the index of the nearest of n directions, or −1 if none is within SAME_DEG. */
static int same(const struct vec3 *all, int n, struct vec3 to) {
    int best = -1;
    double most = cos(SAME_DEG * G_PI / 180);
    for (int i = 0; i < n; i++)
        if (vec3_dot(all[i], to) >= most) {
            most = vec3_dot(all[i], to);
            best = i;
        }
    return best;
}

/* Returns w_v, the cosine-weighted share of the hemisphere that is nearest to view v. The
 * hemisphere weighted by cos θ projects to a disc of uniform density. Each point of the disc counts
 * for the nearest view. */
static double *weigh_views(const struct vec3 *views, int n) {
    double *weight = g_new0(double, n), total = 0;
    for (int j = 0; j < SAMPLES_ASIDE; j++)
        for (int i = 0; i < SAMPLES_ASIDE; i++) {
            double x = 2 * (i + 0.5) / SAMPLES_ASIDE - 1, y = 2 * (j + 0.5) / SAMPLES_ASIDE - 1;
            if (x * x + y * y >= 1)
                continue;
            const struct vec3 d = vec3(x, y, sqrt(1 - x * x - y * y));
            int next = 0;
            for (int k = 1; k < n; k++)
                next = vec3_dot(views[k], d) > vec3_dot(views[next], d) ? k : next;
            weight[next]++;
            total++;
        }
    for (int i = 0; i < n; i++)
        weight[i] /= total;
    return weight;
}

int *energy_exchanges(const struct btf_layout *layout) {
    const gsize n_views = layout->views.n, n_lights = layout->lights.n;
    g_autofree struct vec3 *views = directions(&layout->views);
    g_autofree struct vec3 *lights = directions(&layout->lights);
    g_autofree int *view_as_light = g_new(int, n_views), *light_as_view = g_new(int, n_lights);
    int *other = g_new(int, n_views *n_lights);
    for (gsize v = 0; v < n_views; v++)
        view_as_light[v] = same(lights, n_lights, views[v]);
    for (gsize l = 0; l < n_lights; l++)
        light_as_view[l] = same(views, n_views, lights[l]);
    for (gsize v = 0; v < n_views; v++)
        for (gsize l = 0; l < n_lights; l++) {
            gboolean there = view_as_light[v] >= 0 && light_as_view[l] >= 0 &&
                             views[v].z > MIN_COSINE && lights[l].z > MIN_COSINE;
            other[v * n_lights + l] =
                there ? light_as_view[l] * (int)n_lights + view_as_light[v] : -1;
        }
    return other;
}

/* Sums of (a − b)² and ((a + b)/2)² over pairs, each pair counted once. */
struct symmetry {
    double differences, squares;
    int pairs;
};

/* Adds the pairs of values B(v, l) (n_views × n_lights) to the sums. a is B(v, l) / cos θ_l, and b
 * is the same quotient of the exchanged pair. other[i] is the index of the exchanged pair of i
 * (energy_exchanges()). */
static void add_symmetry(const struct btf_matrix *btf, const int *other, const struct vec3 *lights,
                         const double *values, struct symmetry *to) {
    const int n_lights = (int)btf->layout.lights.n, n = (int)btf->layout.views.n * n_lights;
    for (int i = 0; i < n; i++) {
        int k = other[i];
        if (k <= i)
            continue;
        double a = values[i] / lights[i % n_lights].z, b = values[k] / lights[k % n_lights].z;
        to->differences += (a - b) * (a - b);
        to->squares += 0.25 * (a + b) * (a + b);
        to->pairs++;
    }
}

/* Returns √(Σ (a − b)² / Σ ((a + b)/2)²), or 0 if there are no pairs. */
static double asymmetry_of(const struct symmetry *symmetry) {
    return symmetry->squares > 0 ? sqrt(symmetry->differences / symmetry->squares) : 0;
}

/* Adds E_r(v) = mean_l f to ret_r and E_i(l) = mean_v f to ret_i, where f(v, l) = B(v, l) / cos θ_l
 * (Meseth et al. 2003 §4.1). Lights with cos θ_l ≤ MIN_COSINE are left out. */
static void sum_fields(const struct btf_matrix *btf, const struct vec3 *lights,
                       const double *values, double *ret_r, double *ret_i) {
    const int n_views = (int)btf->layout.views.n, n_lights = (int)btf->layout.lights.n;
    int n_divided = 0;
    for (int l = 0; l < n_lights; l++)
        n_divided += lights[l].z > MIN_COSINE;
    for (int v = 0; v < n_views; v++)
        for (int l = 0; l < n_lights; l++) {
            const double f = lights[l].z > MIN_COSINE ? values[v * n_lights + l] / lights[l].z : 0;
            ret_r[v] += f / MAX(n_divided, 1);
            ret_i[l] += f / n_views;
        }
}

/* Computes in one pass over all texels the mean BRDF, E_r and E_i of the requested texel, and
 * the asymmetry of the single texels. values: luminance, ROWS × n_views × n_lights. */
static gboolean sum_texels(const struct btf_matrix *btf, const int *other,
                           const struct vec3 *lights, struct energy *energy, double *ret_mean,
                           GError **error) {
    const gsize n_lights = btf->layout.lights.n, n = btf->layout.views.n * n_lights;
    const int n_texels = (int)btf_layout_texels(&btf->layout);
    g_autofree float *buffer = g_new(float, 3 * ROWS * n_lights);
    g_autofree double *values = g_new0(double, ROWS *n);
    struct symmetry alone = {0};
    for (int first = 0; first < n_texels; first += ROWS) {
        const int rows = MIN(ROWS, n_texels - first);
        for (gsize view = 0; view < btf->layout.views.n; view++) {
            gsize stride = 0;
            const float *from =
                btf_matrix_rows(btf, (int)view, first, rows, buffer, &stride, error);
            if (!from)
                return FALSE;
            for (gsize i = 0; i < (gsize)rows * n_lights; i++) {
                const gsize row = i / n_lights, light = i % n_lights;
                const float *rgb = from + row * stride + 3 * light;
                values[row * n + view * n_lights + light] =
                    0.2126 * (double)rgb[0] + 0.7152 * (double)rgb[1] + 0.0722 * (double)rgb[2];
            }
        }
        for (int row = 0; row < rows; row++) {
            const double *one = values + (gsize)row * n;
            for (gsize k = 0; k < n; k++)
                ret_mean[k] += one[k] / n_texels;
            add_symmetry(btf, other, lights, one, &alone);
            if (first + row == energy->texel)
                sum_fields(btf, lights, one, energy->texel_e_r, energy->texel_e_i);
        }
    }
    energy->texel_asymmetry = asymmetry_of(&alone);
    return TRUE;
}

static struct energy *energy_new(const struct btf_matrix *btf, int texel) {
    struct energy *energy = g_new0(struct energy, 1);
    energy->n_views = btf->layout.views.n;
    energy->n_lights = btf->layout.lights.n;
    energy->texel = texel;
    energy->e_r = g_new0(double, btf->layout.views.n);
    energy->texel_e_r = g_new0(double, btf->layout.views.n);
    energy->e_i = g_new0(double, btf->layout.lights.n);
    energy->texel_e_i = g_new0(double, btf->layout.lights.n);
    energy->albedo = g_new0(double, btf->layout.lights.n);
    for (gsize v = 0; v < btf->layout.views.n; v++)
        energy->covered_deg = MAX(energy->covered_deg, (double)btf->layout.views.theta_deg[v]);
    return energy;
}

void energy_free(struct energy *energy) {
    if (!energy)
        return;
    g_free(energy->e_r);
    g_free(energy->texel_e_r);
    g_free(energy->e_i);
    g_free(energy->texel_e_i);
    g_free(energy->albedo);
    g_free(energy);
}

struct energy *energy_compute(const struct btf_matrix *btf, int texel, GError **error) {
    int n_texels = btf_layout_texels(&btf->layout);
    g_return_val_if_fail(btf->layout.views.n > 0 && btf->layout.lights.n > 0, NULL);
    if (texel < -1 || texel >= n_texels) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "%s: there is no texel %d; texels are 0 … %d", btf->name, texel, n_texels - 1);
        return NULL;
    }
    if (texel < 0)
        texel = btf->layout.height / 2 * btf->layout.width + btf->layout.width / 2;
    g_autofree struct vec3 *views = directions(&btf->layout.views);
    g_autofree struct vec3 *lights = directions(&btf->layout.lights);
    g_autofree int *other = energy_exchanges(&btf->layout);
    g_autofree double *mean = g_new0(double, btf->layout.views.n * btf->layout.lights.n);
    struct energy *energy = energy_new(btf, texel);
    if (!sum_texels(btf, other, lights, energy, mean, error)) {
        energy_free(energy);
        return NULL;
    }
    g_autofree double *weight = weigh_views(views, btf->layout.views.n);
    sum_fields(btf, lights, mean, energy->e_r, energy->e_i);
    /* The albedo of light l is Σ_v w_v B(v, l) / cos θ_l. */
    for (int l = 0; l < energy->n_lights; l++) {
        double sum = 0;
        for (int v = 0; v < energy->n_views; v++)
            sum += weight[v] * mean[v * energy->n_lights + l];
        energy->albedo[l] = lights[l].z > MIN_COSINE ? sum / lights[l].z : 0;
        energy->largest_albedo = MAX(energy->largest_albedo, energy->albedo[l]);
    }
    struct symmetry symmetry = {0};
    add_symmetry(btf, other, lights, mean, &symmetry);
    energy->pairs = symmetry.pairs;
    energy->asymmetry = asymmetry_of(&symmetry);
    return energy;
}
