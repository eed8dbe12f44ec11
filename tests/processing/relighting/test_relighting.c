/* Lights that are predicted from all others, by weights in closed form: against fits that are
 * repeated without each light, and against planes under near lamps, whose pictures are known. */
#include <lapacke.h>
#include <math.h>
#include <string.h>

#include "base/data_error.h"
#include "base/srgb.h"
#include "codecs/hsh/hsh.h"
#include "lib/direction.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "relighting/relighting.h"
#include "selection/prediction_private.h"

#define LIGHTS  30
#define SIDE    12
#define SIDE_MM 40.0
#define LAMP_MM 50.0
#define LEVEL   3.0 /* height of the reference plane */
#define TEXELS  (SIDE * SIDE)

static struct vec3 direction_at(int i) {
    return direction_of_deg(10 + 65 * sqrt((i + 0.5) / LIGHTS), 137.5 * i);
}

/* The lamps stand LAMP_MM from the centre of the sample, and shine towards it. */
static Relighting *dome(double exponent) {
    Relighting *ret = g_new0(struct relighting, 1);
    struct near_field *near = ret->near = g_new0(struct near_field, 1);
    ret->width = ret->height = SIDE;
    ret->n_lights = LIGHTS;
    ret->lights = g_new(int, LIGHTS);
    ret->values = g_new0(float, LIGHTS *TEXELS * 3);
    near->grid = (struct session_grid){.width = SIDE,
                                       .height = SIDE,
                                       .width_mm = SIDE_MM,
                                       .height_mm = SIDE_MM,
                                       .reference_mm = LEVEL};
    near->views = direction_list_new(1);
    near->lights = direction_list_new(LIGHTS);
    near->lamp_mm = g_new(struct vec3, LIGHTS);
    near->lamp_aim = g_new(struct vec3, LIGHTS);
    near->lamp_exponent = g_new(double, LIGHTS);
    for (int i = 0; i < LIGHTS; i++) {
        const struct vec3 d = direction_at(i);
        ret->lights[i] = i;
        near->lights.theta_deg[i] = (float)(acos(d.z) * 180 / G_PI);
        near->lights.phi_deg[i] = (float)(atan2(d.y, d.x) * 180 / G_PI);
        near->lamp_mm[i] = vec3_add(vec3_scale(d, LAMP_MM), vec3(0, 0, LEVEL));
        near->lamp_aim[i] = vec3_scale(d, -1);
        near->lamp_exponent[i] = exponent;
    }
    return ret;
}

static float *value(const Relighting *r, int light, int texel) {
    return r->values + 3 * (light * TEXELS + texel);
}

/* The position of a texel, computed here: row 0 is at +y. */
static void position(int texel, double ret[2]) {
    ret[0] = (texel % SIDE + 0.5) * SIDE_MM / SIDE - SIDE_MM / 2;
    ret[1] = SIDE_MM / 2 - (texel / SIDE + 0.5) * SIDE_MM / SIDE;
}

static double albedo(int texel, int colour) {
    return 0.2 + 0.05 * (texel * 7 % 5) + 0.1 * colour;
}

/* The picture of a diffuse plane under a lamp, relative to a white plane in the centre that faces
 * the lamp. With the way (x, y, h) from the texel to the lamp, r its length, R = LAMP_MM and α the
 * angle at the lamp between the ways to the texel and to the centre:
 *   a (h / r) (R / r)² cosⁿ α,  cos α = (r² + R² − |texel|²) / (2 r R) */
static double plane(int light, int texel, int colour, double exponent) {
    const struct vec3 d = direction_at(light);
    double at[2];
    position(texel, at);
    const double x = LAMP_MM * d.x - at[0], y = LAMP_MM * d.y - at[1], h = LAMP_MM * d.z;
    const double r = sqrt(x * x + y * y + h * h), square = at[0] * at[0] + at[1] * at[1];
    const double cosine = (r * r + LAMP_MM * LAMP_MM - square) / (2 * r * LAMP_MM);
    return albedo(texel, colour) * h / r * LAMP_MM * LAMP_MM / (r * r) * pow(cosine, exponent);
}

/* Fills a dome with the reflectance of a diffuse plane, a n·l. */
static Relighting *diffuse_plane(double exponent) {
    Relighting *ret = dome(exponent);
    for (int i = 0; i < LIGHTS; i++)
        for (int t = 0; t < TEXELS; t++) {
            double at[2];
            position(t, at);
            const struct vec3 d = direction_at(i);
            const double x = LAMP_MM * d.x - at[0], y = LAMP_MM * d.y - at[1], h = LAMP_MM * d.z;
            for (int c = 0; c < 3; c++)
                value(ret, i, t)[c] = (float)(albedo(t, c) * h / sqrt(x * x + y * y + h * h));
        }
    return ret;
}

/* Fills a dome with values that no basis predicts. */
static Relighting *noise(void) {
    Relighting *ret = dome(0);
    GRand *random = g_rand_new_with_seed(3);
    for (int i = 0; i < LIGHTS * TEXELS * 3; i++)
        ret->values[i] = (float)g_rand_double_range(random, 0.2, 0.6);
    g_rand_free(random);
    return ret;
}

static float *leave_out(const Relighting *r, const struct relighting_model *model) {
    float *ret = g_new(float, 3 * LIGHTS * TEXELS);
    ok(relighting_leave_out(r, model, NULL, ret, NULL, ERR));
    return ret;
}

static double psnr_of(const Relighting *r, const struct relighting_model *model) {
    g_autofree float *pictures = relighting_pictures(r), *predicted = leave_out(r, model);
    struct relighting_errors errors;
    relighting_compare(r, pictures, predicted, &errors, NULL);
    return errors.psnr_db;
}

/* The picture that a near lamp makes of a diffuse plane is known in closed form. */
TEST(near_plane) {
    for (int exponent = 0; exponent < 3; exponent++) {
        g_autoptr(Relighting) r = diffuse_plane(exponent);
        g_autofree float *pictures = relighting_pictures(r);
        double least = INFINITY, most = 0;
        for (int i = 0; i < LIGHTS; i++)
            for (int t = 0; t < TEXELS; t++)
                for (int c = 0; c < 3; c++) {
                    const double found = (double)pictures[3 * (i * TEXELS + t) + c];
                    const double truth = plane(i, t, c, exponent);
                    g_assert_cmpfloat_with_epsilon(found, truth, 1e-5 * truth);
                    least = fmin(least, truth / albedo(t, c));
                    most = fmax(most, truth / albedo(t, c));
                }
        g_assert_cmpfloat(most, >, 10 * least); /* the lamps are near */
    }
}

/* HSH of four terms contain n·l. In the near model each picture of a diffuse plane is predicted
 * exactly from the others, in the distant model none is. */
TEST(near_light) {
    g_autoptr(Relighting) r = diffuse_plane(1);
    struct relighting_model model = {.basis = RELIGHTING_HSH, .n_terms = 4, .linear = TRUE};
    const double distant_db = psnr_of(r, &model);
    model.near = TRUE;
    g_autofree float *near = leave_out(r, &model);
    for (int i = 0; i < LIGHTS; i++)
        for (int t = 0; t < TEXELS; t++)
            for (int c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon((double)near[3 * (i * TEXELS + t) + c],
                                               plane(i, t, c, 1), 2e-5);
    g_test_message("distant light: %.2f dB", distant_db);
    g_assert_cmpfloat(distant_db, <, 32);
    const struct relighting_model others[] = {{.basis = RELIGHTING_PTM, .linear = TRUE},
                                              {.basis = RELIGHTING_HSH, .n_terms = 9},
                                              {.basis = RELIGHTING_HSH, .n_terms = 16},
                                              {.basis = RELIGHTING_KRIGING}};
    for (gsize k = 0; k < G_N_ELEMENTS(others); k++) {
        model = others[k];
        const double far_db = psnr_of(r, &model);
        model.near = TRUE;
        const double near_db = psnr_of(r, &model);
        g_test_message("basis %zu: %.2f dB, near %.2f dB", k, far_db, near_db);
        g_assert_cmpfloat(near_db, >, far_db + 5);
    }
}

/* A polynomial of the light is predicted exactly by a PTM, in the directions of each model. */
TEST(polynomial) {
    for (int near = 0; near < 2; near++) {
        g_autoptr(Relighting) r = dome(0);
        for (int i = 0; i < LIGHTS; i++)
            for (int t = 0; t < TEXELS; t++) {
                const struct vec3 d = direction_at(i);
                double at[2] = {0, 0};
                if (near)
                    position(t, at);
                const struct vec3 l =
                    vec3_unit(vec3(LAMP_MM * d.x - at[0], LAMP_MM * d.y - at[1], LAMP_MM * d.z));
                const double f = near ? 1 : near_field_fall_off(r->near, 0, i, t);
                for (int c = 0; c < 3; c++)
                    value(r, i, t)[c] = (float)((0.5 + 0.1 * l.x - 0.07 * l.y - 0.2 * l.x * l.x +
                                                 0.05 * c * l.x * l.y - 0.1 * l.y * l.y) /
                                                f);
            }
        const struct relighting_model model = {
            .basis = RELIGHTING_PTM, .near = near, .linear = TRUE};
        g_assert_cmpfloat(psnr_of(r, &model), >, 100);
    }
}

/* Fits A to the lights other than j, and returns the value of the fit at light j. */
static double refit(const Relighting *r, int n_terms, int j, int texel, int colour) {
    double a[LIGHTS * HSH_MAX_TERMS], b[LIGHTS], ret = 0;
    float terms[HSH_MAX_TERMS];
    int row = 0;
    for (int i = 0; i < LIGHTS; i++) {
        const struct vec3 d = direction_at(i);
        const float l[3] = {(float)d.x, (float)d.y, (float)d.z};
        const double f = near_field_fall_off(r->near, 0, i, texel);
        hsh_basis(l, n_terms, terms);
        if (i == j)
            continue;
        for (int k = 0; k < n_terms; k++)
            a[row * n_terms + k] = (double)terms[k];
        b[row++] = srgb_encode(f * (double)value(r, i, texel)[colour]);
    }
    g_assert_cmpint(LAPACKE_dgels(LAPACK_ROW_MAJOR, 'N', row, n_terms, 1, a, n_terms, b, 1), ==, 0);
    const struct vec3 d = direction_at(j);
    const float l[3] = {(float)d.x, (float)d.y, (float)d.z};
    hsh_basis(l, n_terms, terms);
    for (int k = 0; k < n_terms; k++)
        ret += b[k] * (double)terms[k];
    return fmax(srgb_decode(ret), 0);
}

TEST(refitted) {
    g_autoptr(Relighting) r = noise();
    for (int n_terms = 4; n_terms <= 16; n_terms += n_terms == 4 ? 5 : 7) {
        const struct relighting_model model = {.basis = RELIGHTING_HSH, .n_terms = n_terms};
        g_autofree float *found = leave_out(r, &model);
        for (int j = 0; j < LIGHTS; j++)
            for (int t = 0; t < TEXELS; t += 29)
                for (int c = 0; c < 3; c++) {
                    const double truth = refit(r, n_terms, j, t, c);
                    g_assert_cmpfloat_with_epsilon((double)found[3 * (j * TEXELS + t) + c], truth,
                                                   1e-4 * (0.1 + truth));
                }
    }
}

/* A Gaussian process with K of all lights but j, solved again for each j. */
TEST(kriging) {
    g_autoptr(Relighting) r = noise();
    struct vec3 lights[LIGHTS];
    const struct vec3 view = vec3(0, 0, 1);
    int indices[LIGHTS];
    double weights[LIGHTS * LIGHTS];
    for (int i = 0; i < LIGHTS; i++)
        lights[i] = direction_at(i);
    g_autofree float *probes = g_new(float, 3 * LIGHTS * TEXELS);
    for (int i = 0; i < 3 * LIGHTS * TEXELS; i++)
        probes[i] = r->values[3 * (i % LIGHTS * TEXELS + i / (3 * LIGHTS)) + i / LIGHTS % 3];
    const struct prediction_pairs pairs = {1, LIGHTS, &view, lights, NULL, NULL, NULL};
    g_autoptr(Prediction) p = ok(prediction_new(&pairs, probes, NULL, TEXELS, NULL, ERR));
    g_assert_true(prediction_left_out_weights(p, view, lights, LIGHTS, weights));
    for (int j = 0; j < LIGHTS; j++) {
        double all[LIGHTS * LIGHTS], k[LIGHTS * LIGHTS], w[LIGHTS];
        int n = 0;
        for (int i = 0; i < LIGHTS; i++)
            indices[i] = i;
        prediction_covariance_small(p, indices, LIGHTS, all);
        for (int i = 0; i < LIGHTS; i++)
            if (i != j) {
                for (int m = 0, column = 0; m < LIGHTS; m++)
                    if (m != j)
                        k[n * (LIGHTS - 1) + column++] = all[i * LIGHTS + m];
                w[n++] = all[i * LIGHTS + j];
            }
        g_assert_cmpint(LAPACKE_dposv(LAPACK_ROW_MAJOR, 'U', n, 1, k, n, w, 1), ==, 0);
        for (int i = 0, m = 0; i < LIGHTS; i++)
            g_assert_cmpfloat_with_epsilon(weights[i + LIGHTS * j], i == j ? 0 : w[m++], 1e-7);
    }
}

/* Gaussians of the distance, and σ of which the error is least. */
TEST(rbf) {
    g_autoptr(Relighting) r = noise();
    struct relighting_model model = {.basis = RELIGHTING_RBF, .sigma = 0.3, .linear = TRUE};
    g_autofree float *found = leave_out(r, &model);
    for (int j = 0; j < LIGHTS; j++)
        for (int t = 0; t < TEXELS; t += 17) {
            double sum = 0, truth = 0;
            for (int i = 0; i < LIGHTS; i++) {
                const double d = vec3_length(vec3_sub(direction_at(i), direction_at(j)));
                const double e = i == j ? 0 : exp(-d * d / 0.09);
                sum += e;
                truth += e * near_field_fall_off(r->near, 0, i, t) * (double)value(r, i, t)[1];
            }
            g_assert_cmpfloat_with_epsilon((double)found[3 * (j * TEXELS + t) + 1], truth / sum,
                                           1e-5);
        }
    g_autoptr(Relighting) smooth = diffuse_plane(0);
    double sigma = 0;
    model.sigma = 0;
    model.near = TRUE;
    ok(relighting_leave_out(smooth, &model, NULL, found, &sigma, ERR));
    const double best = psnr_of(smooth, &model);
    for (double other = 0.1; other < 0.8; other *= 1.5) {
        model.sigma = other;
        g_assert_cmpfloat(psnr_of(smooth, &model), <, best + 0.5);
    }
    g_assert_cmpfloat(sigma, <, 0.5);
}

/* The singular vectors of the values without light j, found here from the values themselves. */
TEST(components) {
    enum { PLANES = 5, LEFT = 3 * (LIGHTS - 1) };
    g_autoptr(Relighting) r = noise();
    const struct relighting_model model = {
        .basis = RELIGHTING_RBF, .sigma = 0.3, .planes = PLANES, .linear = TRUE, .near = TRUE};
    g_autofree float *found = leave_out(r, &model);
    const int j = 7;
    g_autofree double *x = g_new(double, TEXELS *LEFT), *u = g_new(double, TEXELS *TEXELS);
    g_autofree double *vt = g_new(double, LEFT *LEFT), *kept = g_new0(double, TEXELS *LEFT);
    double mean[LEFT] = {0}, s[LEFT], superb[LEFT];
    for (int t = 0; t < TEXELS; t++)
        for (int i = 0, k = 0; i < LIGHTS; i++)
            for (int c = 0; c < 3 && i != j; c++, k++) {
                x[t * LEFT + k] = (double)value(r, i, t)[c];
                mean[k] += x[t * LEFT + k] / TEXELS;
            }
    for (int i = 0; i < TEXELS * LEFT; i++)
        x[i] -= mean[i % LEFT];
    g_assert_cmpint(LAPACKE_dgesvd(LAPACK_ROW_MAJOR, 'A', 'A', TEXELS, LEFT, x, LEFT, s, u, TEXELS,
                                   vt, LEFT, superb),
                    ==, 0);
    for (int t = 0; t < TEXELS; t++)
        for (int k = 0; k < LEFT; k++) {
            kept[t * LEFT + k] = mean[k];
            for (int p = 0; p < PLANES; p++)
                kept[t * LEFT + k] += u[t * TEXELS + p] * s[p] * vt[p * LEFT + k];
        }
    for (int t = 0; t < TEXELS; t++) {
        double sum = 0, truth = 0;
        const struct vec3 to = near_field_light(r->near, 0, j, t);
        for (int i = 0, k = 1; i < LIGHTS; i++) {
            const struct vec3 off = vec3_sub(near_field_light(r->near, 0, i, t), to);
            const double e = i == j ? 0 : exp(-vec3_dot(off, off) / 0.09);
            sum += e;
            if (i != j) {
                truth += e * kept[t * LEFT + k];
                k += 3;
            }
        }
        truth *= near_field_fall_off(r->near, 0, j, t) / sum;
        g_assert_cmpfloat_with_epsilon((double)found[3 * (j * TEXELS + t) + 1], truth, 1e-5);
    }
}

/* A light that alone determines a term cannot be left out. */
TEST(too_few) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Relighting) r = noise();
    g_autofree float *pictures = g_new(float, 3 * LIGHTS * TEXELS);
    for (int i = 1; i < LIGHTS; i++) /* all but one on a ring */
        r->near->lights.theta_deg[i] = 45;
    g_clear_pointer(&r->near->lamp_mm, g_free);
    struct relighting_model model = {.basis = RELIGHTING_PTM};
    g_assert_false(relighting_leave_out(r, &model, NULL, pictures, NULL, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_cmpstr(error->message, ==,
                    "ptm: without light 0, counted from 0, the other lights do not determine all "
                    "terms; use a basis of fewer terms");
}

TEST(names) {
    const struct relighting_model models[] = {{.basis = RELIGHTING_PTM},
                                              {.basis = RELIGHTING_HSH, .n_terms = 9},
                                              {.basis = RELIGHTING_RBF, .planes = 27},
                                              {.basis = RELIGHTING_KRIGING}};
    static const char *const names[] = {"ptm", "hsh9", "rbf27", "kriging"};
    static const int numbers[] = {18, 27, 27, 90};
    for (gsize i = 0; i < G_N_ELEMENTS(models); i++) {
        g_autofree char *name = relighting_model_name(&models[i]);
        g_assert_cmpstr(name, ==, names[i]);
        g_assert_cmpint(relighting_model_numbers(&models[i], LIGHTS), ==, numbers[i]);
    }
}
