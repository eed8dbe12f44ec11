/*
 * Compares materials that are laid out without end in hexagons (synthesis/endless.h) with the
 * repeated sample: the time of a frame, and the number of lookups per point. For the values at
 * points of 32 × 32 tiles, it also compares the mean, the standard deviation and the distribution
 * for each view, light and colour of a BTF, and measures the correlation of points that are one
 * tile apart. It does so for each session or, if none is given, for samples made here: noise,
 * printed dots, and ordered tiles.
 */
#include "base/robust.h"
#include "bench.h"
#include "btf/btf_matrix.h"
#include "codecs/eigenmaps/eigenmaps_codec.h"
#include "frame_time.h"
#include "lib/btf_fixture.h"
#include "shapes/scene.h"
#include "synthesis/endless.h"
#include "synthesis/order.h"

#include <math.h>
#include <string.h>

#define SIDE   64 /* texels of a sample that is made here */
#define TERMS  4
#define TILES  32
#define POINTS 24 /* points a tile each way, at random */
#define ALL    (TILES * TILES * POINTS)
#define MAP    256
#define LAGS   3
#define LOOKS  10 /* pictures by which hexagons are chosen */

static int frames = 5, views_at_most = 12;

static const GOptionEntry options[] = {
    {"frames", 0, 0, G_OPTION_ARG_INT, &frames, "Frames that are timed, 5; 0: none", "N"},
    {"views", 0, 0, G_OPTION_ARG_INT, &views_at_most, "Views that are looked at, 12", "N"},
    {NULL},
};

enum made { NOISE, DOTS, ORDERED, MADE };
static const char *const made_names[MADE] = {"noise", "dots", "ordered"};

/* Height and albedo of each texel; both repeat. */
static void draw_sample(enum made kind, float *height, float *albedo) {
    GRand *random = g_rand_new_with_seed(2);
    const int n = kind == NOISE ? 900 : kind == DOTS ? 140 : 64;
    for (int i = 0; i < SIDE * SIDE; i++) {
        height[i] = 0;
        albedo[i] = kind == DOTS ? 0.8F : 0.4F;
    }
    for (int k = 0; k < n; k++) {
        const double x = kind == ORDERED ? 8 * (k % 8) + 4 : g_rand_double_range(random, 0, SIDE);
        const double y = kind == ORDERED ? 8 * (k / 8) + 4 : g_rand_double_range(random, 0, SIDE);
        const double r = kind == NOISE ? 2 : 3, sign = kind == NOISE && k % 2 ? -1 : 1;
        const double tint = g_rand_double_range(random, 0.1, 0.9);
        for (int j = -6; j <= 6; j++)
            for (int i = -6; i <= 6; i++) {
                const int at = ((int)y + j + SIDE) % SIDE * SIDE + ((int)x + i + SIDE) % SIDE;
                const double dx = i - (x - floor(x)), dy = j - (y - floor(y));
                const double bump = exp(-(dx * dx + dy * dy) / (r * r));
                if (kind != DOTS)
                    height[at] += (float)(sign * 0.8 * bump);
                if (kind != NOISE && dx * dx + dy * dy < r * r)
                    albedo[at] = (float)tint;
            }
    }
    g_rand_free(random);
}

/* Lambert's law and a little gloss over a relief. */
static struct btf_matrix *make_sample(enum made kind) {
    struct btf_matrix *btf = btf_fixture_of(made_names[kind], SIDE, SIDE, btf_fixture_two_rings(0),
                                            btf_fixture_two_rings(15));
    const gsize values = btf_layout_values(&btf->layout), lights = btf->layout.lights.n;
    g_autofree float *l = direction_list_vectors(&btf->layout.lights);
    g_autofree float *v = direction_list_vectors(&btf->layout.views);
    g_autofree float *height = g_new(float, SIDE *SIDE), *albedo = g_new(float, SIDE *SIDE);
    draw_sample(kind, height, albedo);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const int x = i % SIDE, y = i / SIDE, row = y * SIDE;
        const float dx =
            0.5F * (height[row + (x + 1) % SIDE] - height[row + (x + SIDE - 1) % SIDE]);
        const float dy =
            0.5F * (height[(y + SIDE - 1) % SIDE * SIDE + x] - height[(y + 1) % SIDE * SIDE + x]);
        const float size = sqrtf(dx * dx + dy * dy + 1), n[3] = {-dx / size, -dy / size, 1 / size};
        for (gsize k = 0; k < btf->layout.views.n * lights; k++) {
            const float *to_view = v + 3 * (k / lights), *to_light = l + 3 * (k % lights);
            float h[3], across = 0, cosine = 0, shine = 0;
            for (int c = 0; c < 3; c++) {
                h[c] = to_view[c] + to_light[c];
                across += h[c] * h[c];
                cosine += n[c] * to_light[c];
                shine += n[c] * h[c];
            }
            const float lit = fmaxf(cosine, 0);
            for (int c = 0; c < 3; c++)
                btf->values[(gsize)i * values + 3 * k + (gsize)c] =
                    lit * (albedo[i] * (c == 0 ? 1 : 0.6F) +
                           0.3F * powf(fmaxf(shine, 0) / sqrtf(across), 30));
        }
    }
    return btf;
}

/* A point of the surface, and where its values come from. */
struct point {
    struct endless_places places, repeated;
    struct endless_places lags[LAGS]; /* one tile to the right, down, and both */
};

struct figures {
    double evaluations,
        in_one; /* look-ups a point, with the mean's; share of points in one hexagon */
    double mean_rms, mean_most, deviation_rms, deviation_most, averaged_rms, distance_rms;
    double below; /* share of values that are below 0 before they are clamped */
    double lag[LAGS], order;
    double ms[2], times[2]; /* endless, the sample repeated */
    int pairs, width, height;
};

static struct point *make_points(const struct endless *e, struct figures *f) {
    static const float lags[LAGS][2] = {{1, 0}, {0, 1}, {1, 1}};
    struct endless_lattice lattice;
    struct point *points = g_new0(struct point, ALL);
    GRand *random = g_rand_new_with_seed(3);
    gint64 looked = 0, alone = 0;
    endless_lattice_init(&lattice, e, TILES, TILES);
    for (int k = 0; k < ALL; k++) {
        const int tile = k / POINTS;
        const float x[2] = {(float)(tile % TILES + g_rand_double(random)),
                            (float)(tile / TILES + g_rand_double(random))};
        struct point *p = points + k;
        endless_find(e, &lattice, x, &p->places);
        p->repeated = (struct endless_places){.n = 1, .x = {{x[0], x[1]}}, .weight = {1}};
        for (int lag = 0; lag < LAGS; lag++) {
            const float far[2] = {x[0] + lags[lag][0], x[1] + lags[lag][1]};
            endless_find(e, &lattice, far, &p->lags[lag]);
        }
        looked += p->places.n + (p->places.n > 1);
        alone += p->places.n == 1;
    }
    f->evaluations = (double)looked / ALL;
    f->in_one = (double)alone / ALL;
    g_rand_free(random);
    return points;
}

/* One picture of the BTF: height × width. */
struct picture {
    int width, height;
    const float *values;
    double mean;
};

static double at_place(const struct picture *p, const float at[2]) {
    const float x = at[0] * (float)p->width - 0.5F, y = at[1] * (float)p->height - 0.5F;
    const int i = ((int)floorf(x) % p->width + p->width) % p->width;
    const int j = ((int)floorf(y) % p->height + p->height) % p->height;
    const int right = (i + 1) % p->width, down = (j + 1) % p->height;
    const double fx = x - floorf(x), fy = y - floorf(y);
    const float *v = p->values, *a = v + (gsize)j * (gsize)p->width;
    const float *b = v + (gsize)down * (gsize)p->width;
    return (1 - fy) * (a[i] + fx * (a[right] - a[i])) + fy * (b[i] + fx * (b[right] - b[i]));
}

/* averaged: with shares of 1 together, without regard to the variance. */
static double at_places(const struct picture *p, const struct endless_places *at,
                        gboolean averaged) {
    double sum = averaged ? 0 : at->mean * p->mean;
    for (int k = 0; k < at->n; k++)
        sum += at->weight[k] / (averaged ? 1 - at->mean : 1) * at_place(p, at->x[k]);
    return sum;
}

struct moments {
    double mean, deviation;
};

static struct moments moments_of(const double *values) {
    double sum = 0, squares = 0;
    for (int k = 0; k < ALL; k++)
        sum += values[k];
    for (int k = 0; k < ALL; k++)
        squares += (values[k] - sum / ALL) * (values[k] - sum / ALL);
    return (struct moments){sum / ALL, sqrt(squares / ALL)};
}

/* Sums over pictures, before they are divided by their number. */
struct sums {
    double variance, lag[LAGS];
    gint64 below;
};

static void measure_picture(const struct picture *p, const struct point *points, struct figures *f,
                            struct sums *sums) {
    g_autofree double *repeated = g_new(double, ALL), *endless = g_new(double, ALL);
    g_autofree double *averaged = g_new(double, ALL);
    double lag[LAGS] = {0}, distance = 0;
    for (int k = 0; k < ALL; k++) {
        const double value = at_places(p, &points[k].places, FALSE);
        repeated[k] = at_places(p, &points[k].repeated, FALSE);
        averaged[k] = at_places(p, &points[k].places, TRUE);
        endless[k] = fmax(value, 0);
        sums->below += value < 0;
        for (int i = 0; i < LAGS; i++)
            lag[i] += (value - p->mean) * (at_places(p, &points[k].lags[i], FALSE) - p->mean) / ALL;
    }
    const struct moments a = moments_of(repeated), b = moments_of(endless),
                         c = moments_of(averaged);
    if (!(a.mean > 1e-4) || !(a.deviation > 1e-6))
        return;
    const double mean = fabs(b.mean / a.mean - 1), deviation = fabs(b.deviation / a.deviation - 1);
    qsort(repeated, ALL, sizeof *repeated, robust_by_value);
    qsort(endless, ALL, sizeof *endless, robust_by_value);
    for (int k = 0; k < ALL; k++)
        distance += fabs(repeated[k] - endless[k]) / ALL;
    f->mean_rms += mean * mean;
    f->mean_most = fmax(f->mean_most, mean);
    f->deviation_rms += deviation * deviation;
    f->deviation_most = fmax(f->deviation_most, deviation);
    f->averaged_rms += pow(c.deviation / a.deviation - 1, 2);
    f->distance_rms += pow(distance / a.deviation, 2);
    sums->variance += a.deviation * a.deviation;
    for (int i = 0; i < LAGS; i++)
        sums->lag[i] += lag[i];
    f->pairs++;
}

static void measure_values(const struct btf_matrix *btf, const struct endless *e,
                           struct figures *f) {
    const gsize texels = btf_layout_texels(&btf->layout), lights = btf->layout.lights.n;
    const int views = (int)btf->layout.views.n, used = MIN(views, views_at_most);
    g_autofree struct point *points = make_points(e, f);
    g_autofree float *buffer = g_new(float, texels * 3 * lights), *values = g_new(float, texels);
    struct sums sums = {0};
    for (int k = 0; k < used; k++) {
        g_autoptr(GError) error = NULL;
        gsize stride = 0;
        const float *rows =
            btf_matrix_rows(btf, k * views / used, 0, (int)texels, buffer, &stride, &error);
        bench_check(error);
        for (gsize column = 1; column < 3 * lights; column += 3) {
            struct picture p = {(int)btf->layout.width, (int)btf->layout.height, values, 0};
            for (gsize i = 0; i < texels; i++) {
                values[i] = rows[stride * i + column];
                p.mean += values[i] / (double)texels;
            }
            measure_picture(&p, points, f, &sums);
        }
    }
    double *const roots[] = {&f->mean_rms, &f->deviation_rms, &f->averaged_rms, &f->distance_rms};
    for (gsize k = 0; k < G_N_ELEMENTS(roots); k++)
        *roots[k] = sqrt(*roots[k] / f->pairs);
    for (int i = 0; i < LAGS; i++)
        f->lag[i] = sums.lag[i] / sums.variance;
    f->below = (double)sums.below / ((double)ALL * used * (double)lights);
}

/* Makes an index map of the texels of the nearest hexagons, and compares its order as that of any
 * other map. */
static double measure_order(const struct btf_matrix *btf, const struct endless *e) {
    g_autoptr(GError) error = NULL;
    const int width = (int)btf->layout.width, height = (int)btf->layout.height;
    g_autoptr(TexelFeatures) features = texel_features_compute(btf, NULL, NULL, &error);
    bench_check(error);
    g_autoptr(IndexMap) map = index_map_new(MAP, MAP, width, height, features->texel_mm, "endless");
    struct endless_lattice lattice;
    endless_lattice_init(&lattice, e, (double)MAP / width, (double)MAP / height);
    for (int i = 0; i < MAP * MAP; i++) {
        const float x[2] = {((float)(i % MAP) + 0.5F) / (float)width,
                            ((float)(i / MAP) + 0.5F) / (float)height};
        struct endless_places at;
        endless_find(e, &lattice, x, &at);
        map->levels[0][2 * i] = (guint16)CLAMP(at.x[0][0] * (float)width, 0, width - 1);
        map->levels[0][2 * i + 1] = (guint16)CLAMP(at.x[0][1] * (float)height, 0, height - 1);
    }
    return order_difference(features, map);
}

static void measure_frames(const struct btf_matrix *btf, struct figures *f) {
    const struct eigenmaps_options exact = {.method = EIGENMAPS_EXACT};
    g_autoptr(GError) error = NULL;
    double spent;
    struct eigenmaps *maps = eigenmaps_of_matrix(btf, TERMS, &exact, NULL, &spent, &error);
    bench_check(error);
    g_autoptr(Mesh) torus = scene_torus(1.0, 0.4, 256, 128);
    Viewer *viewers[2];
    struct viewer_settings settings[2] = {viewer_settings_default, viewer_settings_default};
    for (int k = 0; k < 2; k++) {
        viewers[k] = viewer_new(maps, &error);
        bench_check(error);
        if (!viewer_set_mesh(viewers[k], torus, &error))
            bench_check(error);
        settings[k].tiles_u = 12;
        settings[k].tiles_v = 4;
        settings[k].ambient = 0;
        settings[k].endless = k == 0;
    }
    if (!time_in_turns(viewers, settings, 2, frames, f->ms, f->times, &error))
        bench_check(error);
    for (int k = 0; k < 2; k++)
        viewer_free(viewers[k]);
    eigenmaps_free(maps);
}

/* By pictures of every so many views and lights, as the viewer does; others are measured as well.
 */
static struct endless *choose_centres(const struct btf_matrix *btf) {
    const gsize texels = btf_layout_texels(&btf->layout), lights = btf->layout.lights.n;
    const gsize views = btf->layout.views.n, n = 3 * LOOKS;
    g_autofree float *buffer = g_new(float, texels * 3 * lights), *all = g_new(float, texels *n);
    for (gsize k = 0; k < LOOKS; k++) {
        g_autoptr(GError) error = NULL;
        gsize stride = 0;
        const gsize view = (2 * k + 1) * views / (2 * LOOKS),
                    light = (3 * k + 1) % LOOKS * lights / LOOKS;
        const float *rows =
            btf_matrix_rows(btf, (int)view, 0, (int)texels, buffer, &stride, &error);
        bench_check(error);
        for (gsize i = 0; i < texels; i++)
            for (gsize c = 0; c < 3; c++)
                all[i * n + 3 * k + c] = rows[stride * i + 3 * light + c];
    }
    const struct endless_pictures pictures = {(int)btf->layout.width, (int)btf->layout.height,
                                              (int)n, all};
    return endless_new(pictures.width, pictures.height, &pictures);
}

static void print(const char *name, const struct figures *f) {
    bench_begin(NULL);
    bench_put("%s{sample} %d{width} %d{height} %d{pictures} %.4f{evaluations} %.4f{in_one} "
              "%.5f{mean_rms} %.5f{mean_most} %.5f{deviation_rms} %.5f{deviation_most} "
              "%.5f{averaged_deviation_rms} %.5f{distance_rms} %.6f{below}",
              name, f->width, f->height, f->pairs, f->evaluations, f->in_one, f->mean_rms,
              f->mean_most, f->deviation_rms, f->deviation_most, f->averaged_rms, f->distance_rms,
              f->below);
    bench_put_doubles("lags", "%.4f", f->lag, LAGS);
    bench_put("%.4f{order} %.2f{plain_ms} %.3f{ratio}", f->order, f->ms[1], f->times[0]);
    bench_end();
}

static void measure(const char *name, const struct btf_matrix *btf) {
    struct figures f = {.width = (int)btf->layout.width, .height = (int)btf->layout.height};
    g_autoptr(Endless) endless = choose_centres(btf);
    measure_values(btf, endless, &f);
    f.order = measure_order(btf, endless);
    if (frames > 0)
        measure_frames(btf, &f);
    print(name, &f);
}

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    bench_parse(&argc, &argv, options, "[SESSION …]");
    g_autoptr(Gpu) gpu = frames > 0 ? gpu_new_headless(&error) : NULL;
    bench_check(error);
    for (int k = 1; k < argc; k++) {
        g_autoptr(BtfMatrix) btf = btf_matrix_read(argv[k], NULL, &error);
        bench_check(error);
        measure(argv[k], btf);
    }
    for (int k = 0; argc < 2 && k < MADE; k++) {
        g_autoptr(BtfMatrix) btf = make_sample((enum made)k);
        measure(made_names[k], btf);
    }
    return 0;
}
