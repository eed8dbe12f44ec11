#include "base/data_error.h"
#include "codecs/lobes/lobes_levels.h"
#include "lib/damage.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include "btf/btf_checkpoint.h"
#include "exr/exr.h"
#include "lib/btf_fixture.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define RINGS 4

/* 1 + 6 + 12 + 18 directions, up to 75 degrees: as dense as the 81 of the papers is coarse. */
static struct btf_matrix *new_btf(int width, int height, int view_rings, int light_rings) {
    return btf_fixture_of("weave", width, height, btf_fixture_rings(view_rings, 75, 0),
                          btf_fixture_rings(light_rings, 75, 7));
}

static void unit(double theta_deg, double phi_deg, double ret[3]) {
    ret[0] = sin(theta_deg * G_PI / 180) * cos(phi_deg * G_PI / 180);
    ret[1] = sin(theta_deg * G_PI / 180) * sin(phi_deg * G_PI / 180);
    ret[2] = cos(theta_deg * G_PI / 180);
}

static double dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/* Truth in double precision, by the formulas of the header written out again. */
typedef double (*Truth)(const double *v, const double *l, const double *p);

static double lobe(const double *p, const double *w) {
    const double c = dot(p, w);
    return c > 0 ? p[4] * pow(c, p[3]) : 0; /* p: unit vector, exponent, peak */
}

static double truth_fields(const double *v, const double *l, const double *p) {
    return lobe(p, l) + lobe(p + 5, l);
}

static double truth_lafortune(const double *v, const double *l, const double *p) {
    const double w[3] = {v[0] * l[0], v[1] * l[1], v[2] * l[2]};
    return l[2] * (p[10] + lobe(p, w) + lobe(p + 5, w));
}

struct frame {
    double t[3], b[3], n[3];
};

/* Normal from its slopes, tangent the turned x axis laid into the surface by Gram and Schmidt. */
static struct frame frame_of(const double *p) {
    struct frame f;
    const double size = sqrt(p[0] * p[0] + p[1] * p[1] + 1);
    const double x[3] = {cos(p[2]), sin(p[2]), p[0] * cos(p[2]) + p[1] * sin(p[2])};
    const double n[3] = {-p[0] / size, -p[1] / size, 1 / size};
    memcpy(f.n, n, sizeof n);
    for (int i = 0; i < 3; i++)
        f.t[i] = x[i] / sqrt(dot(x, x));
    g_assert_cmpfloat_with_epsilon(dot(f.t, f.n), 0, 1e-12);
    f.b[0] = n[1] * f.t[2] - n[2] * f.t[1];
    f.b[1] = n[2] * f.t[0] - n[0] * f.t[2];
    f.b[2] = n[0] * f.t[1] - n[1] * f.t[0];
    return f;
}

/* p: slopes, angle, U, V, diffuse, specular. */
static double truth_facet(gboolean ward, const double *v, const double *l, const double *p) {
    const struct frame f = frame_of(p);
    double h[3] = {v[0] + l[0], v[1] + l[1], v[2] + l[2]};
    const double size = sqrt(dot(h, h)), nl = dot(f.n, l), nv = MAX(dot(f.n, v), 0.1);
    if (nl <= 0)
        return 0;
    for (int i = 0; i < 3; i++)
        h[i] /= size;
    const double x = dot(h, f.t), y = dot(h, f.b), z = dot(h, f.n), u = x / p[3], w = y / p[4];
    if (ward)
        return p[5] * nl + p[6] * sqrt(nl / nv) / (4 * p[3] * p[4]) *
                               exp(-2 * (u * u + w * w) / (1 + MAX(z, 0)));
    if (z <= 0)
        return p[5] * nl;
    const double d = z >= 1 - 1e-12 ? 1 : pow(z, (p[3] * x * x + p[4] * y * y) / (1 - z * z));
    return p[5] * nl +
           p[6] * sqrt((p[3] + 1) * (p[4] + 1)) / 8 * d * nl / (dot(h, l) * MAX(nl, nv));
}

static double truth_ward(const double *v, const double *l, const double *p) {
    return truth_facet(TRUE, v, l, p);
}

static double truth_ashikhmin(const double *v, const double *l, const double *p) {
    return truth_facet(FALSE, v, l, p);
}

static double between(GRand *random, double low, double high) {
    return g_rand_double_range(random, low, high);
}

static void random_lobe(GRand *random, double *p, double n_low, double n_high, double peak) {
    unit(between(random, 0, 60), between(random, 0, 360), p);
    p[3] = between(random, n_low, n_high);
    p[4] = peak;
}

static void random_parameters(GRand *random, enum lobes_model model, double *p) {
    switch (model) {
    case LOBES_FIELDS:
        random_lobe(random, p, 1, 1.5, between(random, 0.2, 0.6));
        random_lobe(random, p + 5, 6, 20, between(random, 0.2, 1));
        break;
    case LOBES_LAFORTUNE: {
        const double c[2][3] = {{-1, -1, 1}, {0.8, 0.8, 1}};
        for (int i = 0; i < 2; i++) {
            for (int k = 0; k < 3; k++)
                p[5 * i + k] = c[i][k] / sqrt(dot(c[i], c[i]));
            p[5 * i + 3] = i ? 2.5 : between(random, 6, 12);
            p[5 * i + 4] = between(random, 0.2, 1);
        }
        p[10] = between(random, 0.1, 0.5);
        break;
    }
    default:
        p[0] = between(random, -0.3, 0.3);
        p[1] = between(random, -0.3, 0.3);
        p[2] = between(random, 0, G_PI);
        p[3] = model == LOBES_WARD ? between(random, 0.15, 0.25) : between(random, 60, 120);
        p[4] = model == LOBES_WARD ? between(random, 0.4, 0.6) : between(random, 8, 16);
        p[5] = between(random, 0.2, 0.5);
        p[6] = between(random, 0.1, 0.4);
        break;
    }
}

/* Luminance as the truth says, in one colour, with noise. */
static void fill(struct btf_matrix *btf, enum lobes_model model, double noise) {
    static const Truth truths[] = {truth_fields, NULL, truth_lafortune, truth_ward,
                                   truth_ashikhmin};
    static const double colour[3] = {1.4, 0.9, 0.7};
    GRand *random = g_rand_new_with_seed(11);
    float *to = btf->values;
    double p[16] = {0}, v[3], l[3];
    for (gsize texel = 0; texel < btf_layout_texels(&btf->layout); texel++) {
        for (gsize view = 0; view < btf->layout.views.n; view++) {
            if (view == 0 || model == LOBES_FIELDS)
                random_parameters(random, model, p);
            unit(btf->layout.views.theta_deg[view], btf->layout.views.phi_deg[view], v);
            for (gsize light = 0; light < btf->layout.lights.n; light++, to += 3) {
                unit(btf->layout.lights.theta_deg[light], btf->layout.lights.phi_deg[light], l);
                const double y = truths[model](v, l, p);
                for (int c = 0; c < 3; c++)
                    to[c] = (float)(colour[c] * y + noise * between(random, -1, 1));
            }
        }
    }
    g_rand_free(random);
}

static struct lobes *compute(const struct btf_matrix *btf, enum lobes_model model) {
    const struct lobes_options options = {.model = model};
    struct lobes *lobes = ok(lobes_compute(btf, &options, ERR));
    return lobes;
}

static double residual(const struct lobes *lobes, const struct btf_matrix *btf) {
    const int d = btf_layout_values(&btf->layout);
    g_autofree float *row = g_new(float, d);
    double rest = 0, all = 0;
    for (gsize texel = 0; texel < btf_layout_texels(&btf->layout); texel++) {
        lobes_reconstruct(lobes, texel, row);
        for (int i = 0; i < d; i++) {
            const double truth = btf->values[texel * d + i];
            rest += (truth - row[i]) * (truth - row[i]);
            all += truth * truth;
        }
    }
    return all > 0 ? sqrt(rest / all) : 0;
}

/* Each model finds itself again. */
TEST(own) {
    const enum lobes_model models[] = {LOBES_FIELDS, LOBES_LAFORTUNE, LOBES_WARD, LOBES_ASHIKHMIN};
    for (gsize i = 0; i < G_N_ELEMENTS(models); i++) {
        struct btf_matrix *btf = new_btf(4, 3, 2, RINGS);
        fill(btf, models[i], 0);
        struct lobes *lobes = compute(btf, models[i]);
        g_test_message("%s: %g", lobes_model_name(models[i]), lobes->error);
        g_assert_cmpfloat(lobes->exact_error, <, 0.02);
        g_assert_cmpfloat(lobes->error, <, 0.02);
        g_assert_cmpfloat_with_epsilon(residual(lobes, btf), lobes->error, 1e-5);
        lobes_free(lobes);
        btf_matrix_free(btf);
    }
}

/* A polynomial is found again; of what is none, the best one: nothing is left that the basis
 * could take. */
TEST(polynomial) {
    static const double c[6] = {0.2, -0.1, 0.05, 0.3, -0.2, 0.6};
    struct btf_matrix *btf = new_btf(2, 2, 1, RINGS);
    double l[3];
    for (gsize i = 0; i < 4 * btf->layout.views.n * btf->layout.lights.n; i++) {
        const int light = i % btf->layout.lights.n;
        unit(btf->layout.lights.theta_deg[light], btf->layout.lights.phi_deg[light], l);
        const double basis[6] = {l[0] * l[0], l[1] * l[1], l[0] * l[1], l[0], l[1], 1};
        double y = 0;
        for (int k = 0; k < 6; k++)
            y += c[k] * basis[k];
        btf->values[3 * i] = btf->values[3 * i + 1] = btf->values[3 * i + 2] = (float)y;
    }
    struct lobes *lobes = compute(btf, LOBES_PTM);
    for (int k = 0; k < 6; k++)
        g_assert_cmpfloat_with_epsilon(lobes->values[3 + k], c[k], 1e-3);
    g_assert_cmpfloat(lobes->error, <, 1e-3);
    lobes_free(lobes);
    fill(btf, LOBES_FIELDS, 0);
    lobes = compute(btf, LOBES_PTM);
    g_autofree float *row = g_new(float, btf_layout_values(&btf->layout));
    lobes_reconstruct(lobes, 0, row);
    double left[6] = {0};
    for (gsize light = 0; light < btf->layout.lights.n; light++) {
        unit(btf->layout.lights.theta_deg[light], btf->layout.lights.phi_deg[light], l);
        const double basis[6] = {l[0] * l[0], l[1] * l[1], l[0] * l[1], l[0], l[1], 1};
        const float *a = btf->values + (gsize)(3 * light), *b = row + (gsize)(3 * light);
        const double y = 0.2126 * (a[0] - b[0]) + 0.7152 * (a[1] - b[1]) + 0.0722 * (a[2] - b[2]);
        for (int k = 0; k < 6; k++)
            left[k] += y * basis[k] / btf->layout.lights.n;
    }
    for (int k = 0; k < 6; k++)
        g_assert_cmpfloat_with_epsilon(left[k], 0, 1e-3);
    lobes_free(lobes);
    btf_matrix_free(btf);
}

/* Noise does not stop the fit from the truth: what is left is the noise, and no more. */
TEST(noise) {
    struct btf_matrix *btf = new_btf(6, 5, 1, RINGS);
    fill(btf, LOBES_FIELDS, 0.03);
    struct lobes *lobes = compute(btf, LOBES_FIELDS);
    const double noise = 0.03 / sqrt(3);
    double all = 0;
    const int n = 6 * 5 * btf_layout_values(&btf->layout);
    for (int i = 0; i < n; i++)
        all += (double)btf->values[i] * btf->values[i] / n;
    g_assert_cmpfloat(lobes->error, <, 1.05 * noise / sqrt(all));
    lobes_free(lobes);
    btf_matrix_free(btf);
}

/* What a graphics card does in half floats has no infinity in it, wherever the light comes from. */
TEST(halves) {
    struct btf_matrix *btf = new_btf(8, 8, 1, 2);
    GRand *random = g_rand_new_with_seed(3);
    const int n = 64 * btf->layout.views.n * btf->layout.lights.n;
    for (int i = 0; i < 3 * n; i++) /* single bright lights: the sharpest lobes there are */
        btf->values[i] = i / 3 % 7 == g_rand_int_range(random, 0, 7)
                             ? (float)pow(10, between(random, -3, 3))
                             : 0.01F;
    struct lobes *lobes = compute(btf, LOBES_FIELDS);
    for (int i = 0; i < 64 * lobes->n_slices; i++) {
        const float *values = lobes->values + (gsize)(i * lobes->n_values);
        for (int k = 0; k < lobes->n_values; k++)
            g_assert_cmpfloat(fabsf(values[k]), <, 65504);
        for (int k = 0; k < 2; k++) {
            const float *p = values + 3 + (gsize)(4 * k);
            const double size = sqrt(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
            g_assert_cmpfloat(p[3], >=, LOBES_MIN_EXPONENT);
            g_assert_cmpfloat(p[3], <=, LOBES_MAX_EXPONENT);
            g_assert_cmpfloat(size, <, 65504);
            g_assert_cmpfloat(pow(size, p[3]), <, 1.1 * LOBES_MAX_PEAK);
        }
    }
    lobes_free(lobes);
    g_rand_free(random);
    btf_matrix_free(btf);
}

TEST(threads) {
    struct btf_matrix *btf = new_btf(9, 7, 1, 3);
    struct lobes *first = NULL;
    fill(btf, LOBES_FIELDS, 0.02);
    for (int threads = 1; threads <= 3; threads++) {
        const struct lobes_options options = {LOBES_FIELDS, .work.n_threads = threads};
        struct lobes *lobes = lobes_compute(btf, &options, NULL);
        const gsize size = sizeof(float) * (gsize)(63 * lobes->n_slices * lobes->n_values);
        if (first)
            g_assert_cmpmem(first->values, size, lobes->values, size);
        if (first)
            lobes_free(lobes);
        else
            first = lobes;
    }
    lobes_free(first);
    btf_matrix_free(btf);
}

/* Black, constant, one direction, holes: every model gives something finite and sensible. */
TEST(edges) {
    for (int model = 0; model < LOBES_MODELS; model++) {
        struct btf_matrix *btf = new_btf(3, 2, 1, 2);
        const int n = 6 * btf_layout_values(&btf->layout);
        struct lobes *lobes = compute(btf, (enum lobes_model)model);
        g_assert_cmpfloat(lobes->error, ==, 0);
        g_assert_cmpfloat(residual(lobes, btf), ==, 0);
        lobes_free(lobes);
        for (int i = 0; i < n; i++)
            btf->values[i] = 0.5F;
        lobes = compute(btf, (enum lobes_model)model);
        g_assert_cmpfloat(lobes->error, <, model == LOBES_FIELDS || model == LOBES_PTM ? 0.2 : 0.7);
        lobes_free(lobes);
        btf_matrix_free(btf);

        btf = new_btf(1, 1, 0, 0); /* one view, one light */
        btf->values[0] = btf->values[1] = btf->values[2] = 0.7F;
        lobes = compute(btf, (enum lobes_model)model);
        g_assert_cmpfloat(lobes->error, <, 0.01);
        lobes_free(lobes);
        btf_matrix_free(btf);

        btf = new_btf(2, 1, 0, 3); /* one view; the second texel was never seen */
        fill(btf, LOBES_FIELDS, 0);
        for (gsize i = 0; i < btf->layout.lights.n * 3; i++)
            btf->values[btf->layout.lights.n * 3 + i] = NAN;
        lobes = compute(btf, (enum lobes_model)model);
        g_assert_true(isfinite(lobes->error));
        for (int i = 0; i < 2 * lobes->n_slices * lobes->n_values; i++)
            g_assert_true(isfinite(lobes->values[i]));
        g_autofree float *row = g_new(float, btf->layout.lights.n * 3);
        lobes_reconstruct(lobes, 1, row);
        for (gsize i = 0; i < btf->layout.lights.n * 3; i++)
            g_assert_cmpfloat(row[i], ==, 0);
        lobes_free(lobes);
        btf_matrix_free(btf);
    }
}

/* A tenth of the values missing changes the fit of a clean BTF little. */
TEST(holes) {
    for (int model = 0; model < LOBES_MODELS; model++) {
        struct btf_matrix *whole = new_btf(3, 3, 1, RINGS), *btf = new_btf(3, 3, 1, RINGS);
        const enum lobes_model kind = model == LOBES_PTM ? LOBES_FIELDS : (enum lobes_model)model;
        fill(whole, kind, 0);
        fill(btf, kind, 0);
        for (gsize i = 0; i < 9 * btf->layout.views.n * btf->layout.lights.n; i += 10)
            btf->values[3 * i + 1] = NAN;
        struct lobes *lobes = compute(btf, (enum lobes_model)model);
        const double error = lobes->error;
        const double on_all = lobes_error(lobes, whole, 0);
        g_assert_cmpfloat(on_all, <, model == LOBES_PTM ? 1.1 * error : 0.03);
        lobes_free(lobes);
        btf_matrix_free(whole);
        btf_matrix_free(btf);
    }
}

static void cancel_soon(const struct work_progress *progress, gpointer cancellable) {
    if (progress->done > 0)
        g_cancellable_cancel(cancellable);
}

static struct lobes *compute_checkpoint(const struct btf_matrix *btf, const char *path,
                                        GCancellable *cancellable) {
    g_autoptr(Checkpoint) checkpoint = path ? checkpoint_new(path) : NULL;
    const struct lobes_options options = {.model = LOBES_PTM,
                                          .work.n_threads = 1,
                                          .work.progress = cancellable ? cancel_soon : NULL,
                                          .work.data = cancellable,
                                          .work.cancellable = cancellable,
                                          .checkpoint = checkpoint};
    return lobes_compute(btf, &options, NULL);
}

/* Changes a value of what is kept, as if it had come out so. */
static void spoil_kept(const struct btf_matrix *btf, const char *path, gsize n) {
    g_autoptr(Checkpoint) checkpoint = checkpoint_new(path);
    const int n_blocks = btf_layout_texels(&btf->layout) / 16;
    btf_checkpoint_begin(checkpoint, btf, "ptm of 0");
    const int *found = checkpoint_get(checkpoint, "blocks", sizeof(int) * (gsize)n_blocks);
    const float *values = checkpoint_get(checkpoint, "values", sizeof(float) * n);
    g_assert_nonnull(found);
    g_assert_nonnull(values);
    g_assert_cmpint(found[0], ==, 1);
    g_autofree int *blocks = g_memdup2(found, sizeof(int) * (gsize)n_blocks);
    g_autofree float *spoiled = g_memdup2(values, sizeof(float) * n);
    spoiled[0] = 7;
    checkpoint_keep_flags(checkpoint, "blocks", blocks, n_blocks);
    checkpoint_keep(checkpoint, "values", spoiled, sizeof(float) * n);
    checkpoint_save(checkpoint);
}

/* Cut off, it goes on with what it had, and ends with the same. */
TEST(checkpoint) {
    TEMPORARY_FOLDER(dir);
    g_autofree char *path = g_build_filename(dir, "checkpoint.exr", NULL);
    g_autoptr(GCancellable) cancellable = g_cancellable_new();
    struct btf_matrix *btf = new_btf(64, 64, 1, RINGS);
    fill(btf, LOBES_FIELDS, 0.1);
    const gsize n = (gsize)(64 * 64 * btf->layout.views.n * 9);
    struct lobes *whole = compute_checkpoint(btf, NULL, NULL);
    g_assert_null(compute_checkpoint(btf, path, cancellable));
    struct lobes *rest = compute_checkpoint(btf, path, NULL);
    g_assert_cmpmem(rest->values, n * sizeof(float), whole->values, n * sizeof(float));
    g_assert_cmpfloat(rest->error, ==, whole->error);
    lobes_free(rest);
    /* What was done is not done again: it shows when it is changed. */
    spoil_kept(btf, path, n);
    rest = compute_checkpoint(btf, path, NULL);
    g_assert_cmpfloat(rest->values[0], ==, 7);
    lobes_free(rest);
    /* Of something else, or damaged, it counts as nothing. */
    btf->values[0] += 0.5F;
    rest = compute_checkpoint(btf, path, NULL);
    g_assert_cmpfloat(rest->values[0], !=, 7);
    lobes_free(rest);
    g_assert_true(g_file_set_contents(path, "cut off", -1, NULL));
    btf->values[0] -= 0.5F;
    rest = compute_checkpoint(btf, path, NULL);
    g_assert_cmpmem(rest->values, n * sizeof(float), whole->values, n * sizeof(float));
    lobes_free(rest);
    lobes_free(whole);
    btf_matrix_free(btf);
}

TEST(refused) {
    static const struct lobes_options bad[] = {
        {(enum lobes_model)5}, {LOBES_FIELDS, -1}, {LOBES_FIELDS, 4}, {LOBES_LAFORTUNE, G_MAXINT}};
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancelled = g_cancellable_new();
    struct btf_matrix *btf = new_btf(5, 4, 1, 1);
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_assert_null(lobes_compute(btf, &bad[i], &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
        g_clear_error(&error);
    }
    const struct lobes_options options = {LOBES_FIELDS, .work.cancellable = cancelled};
    g_cancellable_cancel(cancelled);
    g_assert_null(lobes_compute(btf, &options, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    g_clear_error(&error);
    btf->values[(7 * 49 + 10) * 3] = INFINITY; /* texel (2, 1), view 1 */
    const struct lobes_options good = {LOBES_PTM};
    g_assert_null(lobes_compute(btf, &good, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "view 1 in the texel of column 2 and row 1"));
    btf_matrix_free(btf);
}

TEST(file) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lobes.exr", NULL);
    struct btf_matrix *btf = new_btf(5, 4, 1, 2);
    fill(btf, LOBES_FIELDS, 0.01);
    for (int model = 0; model < LOBES_MODELS; model++) {
        g_autoptr(GError) error = NULL;
        struct lobes *lobes = compute(btf, (enum lobes_model)model);
        g_assert_true(lobes_write_levels(path, &lobes, 1, &error));
        struct lobes *back = ok(lobes_read(path, ERR));
        const gsize size = sizeof(float) * (gsize)(20 * lobes->n_slices * lobes->n_values);
        g_assert_cmpint(back->model, ==, model);
        g_assert_cmpint(back->n_values, ==, lobes->n_values);
        g_assert_cmpmem(back->values, size, lobes->values, size);
        g_assert_true(back->error == lobes->error);
        g_assert_true(back->luminance_error == lobes->luminance_error);
        g_assert_cmpstr(back->name, ==, "weave");
        g_assert_cmpfloat(back->layout.views.theta_deg[3], ==, btf->layout.views.theta_deg[3]);
        g_assert_cmpfloat(back->layout.lights.phi_deg[5], ==, btf->layout.lights.phi_deg[5]);
        lobes_free(back);
        lobes_free(lobes);
    }
    btf_matrix_free(btf);
}

static void write_small(const char *path) {
    struct btf_matrix *btf = new_btf(4, 3, 1, 1);
    g_autoptr(GError) error = NULL;
    fill(btf, LOBES_FIELDS, 0);
    struct lobes *lobes = compute(btf, LOBES_FIELDS);
    g_assert_true(lobes_write_levels(path, &lobes, 1, &error));
    lobes_free(lobes);
    btf_matrix_free(btf);
}

static void spoil(struct exr_file *file, int fault) {
    static const char *const parts[] = {"colour", "lobe1", "lobe2", "views", "lights"};
    struct exr_part *first = exr_file_part(file, "colour");
    if (fault < 5) {
        g_assert_true(g_ptr_array_remove(file->parts, exr_file_part(file, parts[fault])));
        return;
    }
    switch (fault) {
    case 5:
        exr_part_plane(exr_file_part(file, "lobe1"), "N")[3] = NAN;
        break;
    case 6:
        exr_set_int(first, "mesorig.lobes", 4);
        break;
    case 7:
        exr_set_int(first, "mesorig.slices", 1);
        break;
    case 8:
        exr_set_int(first, "mesorig.height", 2);
        break;
    case 9:
        exr_set_int(first, "mesorig.width", 5);
        break;
    case 10:
        exr_set_double(first, "texel_mm", -1);
        break;
    case 11:
        exr_set_int(first, "mesorig.height", G_MAXINT);
        break;
    default:
        exr_set_string(first, "mesorig.kind", "lpca");
        break;
    }
}

TEST(hostile) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "lobes.exr", NULL);
    for (int fault = 0; fault < 13; fault++) {
        write_small(path);
        struct exr_file *file = ok(exr_read(path, ERR));
        spoil(file, fault);
        assert_file_refused(lobes_read, path, file);
    }
    write_small(path);
    assert_cut_refused(lobes_read, path, 211);
}
