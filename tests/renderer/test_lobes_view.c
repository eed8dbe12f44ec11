/* Pictures of the analytic models of texels against lobes_evaluate(), pixel by pixel. */
#include "lib/lobes_scene.h"
#include "lib/ok.h"

#include <glib/gstdio.h>
#include <string.h>

static double uniform(GRand *random, double low, double high) {
    return g_rand_double_range(random, low, high);
}

static void fill_values(GRand *random, const struct lobes *lobes, float *ret) {
    for (int k = 0; k < 6; k++)
        ret[k] = (float)uniform(random, 0.1, 0.5);
    if (lobes->model == LOBES_PTM)
        for (int k = 3; k < 9; k++)
            ret[k] = (float)uniform(random, -0.3, 0.6);
    if (lobes->model == LOBES_FIELDS || lobes->model == LOBES_LAFORTUNE)
        for (int k = 0; k < lobes->n_lobes; k++) {
            float *lobe = ret + lobes->n_values - 4 * (k + 1);
            for (int i = 0; i < 2; i++)
                lobe[i] = (float)uniform(random, -0.4, 0.4);
            lobe[2] = (float)uniform(random, 0.5, 0.9);
            lobe[3] = (float)uniform(random, 0.8, 6);
        }
    if (lobes->model < LOBES_WARD)
        return;
    const gboolean ward = lobes->model == LOBES_WARD;
    for (int k = 3; k < 6; k++)
        ret[k] *= 0.3F;
    /* Normal and tangent as a fit has them: the tangent's azimuth is turned, then laid into the
     * surface. */
    const double p = uniform(random, -0.5, 0.5), q = uniform(random, -0.5, 0.5);
    const double turn = uniform(random, -3, 3), c = cos(turn), s = sin(turn);
    const double n = sqrt(p * p + q * q + 1), z = p * c + q * s, t = sqrt(1 + z * z);
    const double frame[6] = {-p / n, -q / n, 1 / n, c / t, s / t, z / t};
    for (int k = 0; k < 6; k++)
        ret[6 + k] = (float)frame[k];
    ret[12] = (float)(ward ? uniform(random, 0.2, 0.6) : uniform(random, 1, 20));
    ret[13] = (float)(ward ? uniform(random, 0.2, 0.6) : uniform(random, 1, 20));
}

static struct lobes *make_lobes(enum lobes_model model, int n_lobes) {
    g_autoptr(GRand) random = g_rand_new_with_seed(11 + model);
    struct lobes *p = g_new0(struct lobes, 1);
    const gboolean sliced = model == LOBES_FIELDS || model == LOBES_PTM;
    const int n_values[LOBES_MODELS] = {3 + 4 * n_lobes, 9, 4 + 4 * n_lobes, 14, 14};
    *p = (struct lobes){.model = model,
                        .name = g_strdup("test"),
                        .layout.width = W,
                        .layout.height = H,
                        .layout.texel_mm = 1,
                        .layout.views.n = RINGS * A_RING,
                        .layout.lights.n = RINGS * A_RING,
                        .n_lobes = model == LOBES_FIELDS || model == LOBES_LAFORTUNE ? n_lobes : 0,
                        .n_slices = sliced ? RINGS * A_RING : 1,
                        .n_values = n_values[model]};
    rings_fill(0, &p->layout.views.theta_deg, &p->layout.views.phi_deg);
    rings_fill(5, &p->layout.lights.theta_deg, &p->layout.lights.phi_deg);
    p->values = g_new0(float, p->n_slices *W *H * p->n_values);
    for (int k = 0; k < p->n_slices * W * H; k++)
        fill_values(random, p, p->values + (gsize)k * p->n_values);
    return p;
}

/* Through a file, as the viewer opens it. */
static void check_rotated(enum lobes_model model, int n_lobes, gboolean nearest, double ambient,
                          enum method_rotation rotation) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "lobes.exr", NULL);
    struct lobes *made = make_lobes(model, n_lobes);
    g_assert_true(lobes_write_levels(path, &made, 1, &error));
    lobes_free(made);
    struct lobes *lobes = ok(lobes_read(path, ERR));
    struct scene scene = {.lobes = lobes,
                          .ambient = ambient,
                          .nearest = nearest,
                          .rotation = rotation,
                          .layout = &lobes->layout};
    g_test_message("%s, %d lobes", lobes_model_name(model), lobes->n_lobes);
    lobes_scene_compare(&scene, &methods_lobes[model], path,
                        &methods_lobes[(model + 1) % LOBES_MODELS], lobes_model_name(model));
    g_assert_true(g_unlink(path) == 0 && g_rmdir(dir) == 0);
    lobes_free(lobes);
}

static void check_model(enum lobes_model model, int n_lobes, gboolean nearest, double ambient) {
    check_rotated(model, n_lobes, nearest, ambient, METHOD_ROTATION_EXACT);
}

/* What was fitted, with the ways of Kang & Cho 2011 to turn it. */
GPU_TEST(rotations) {
    check_rotated(LOBES_WARD, 0, FALSE, 0, METHOD_ROTATION_APPROXIMATE);
    check_rotated(LOBES_WARD, 0, TRUE, 0, METHOD_ROTATION_NONE);
    check_rotated(LOBES_ASHIKHMIN, 0, TRUE, 0, METHOD_ROTATION_APPROXIMATE);
    check_rotated(LOBES_ASHIKHMIN, 0, FALSE, 0, METHOD_ROTATION_NONE);
}

GPU_TEST(formula) {
    check_model(LOBES_FIELDS, 2, FALSE, 0);
    check_model(LOBES_FIELDS, 3, TRUE, 0.3);
    check_model(LOBES_PTM, 0, FALSE, 0.1);
    check_model(LOBES_LAFORTUNE, 1, TRUE, 0.2);
    check_model(LOBES_LAFORTUNE, 3, FALSE, 0);
    check_model(LOBES_WARD, 0, FALSE, 0);
    check_model(LOBES_ASHIKHMIN, 0, FALSE, 0.1);
}

GPU_TEST(bad) {
    g_autoptr(GError) error = NULL;
    struct lobes *lobes = make_lobes(LOBES_FIELDS, 2);
    lobes->values[19] = NAN;
    g_assert_null(lobes_view_new(&lobes, 1, &error));
    g_assert_nonnull(strstr(error->message, "value number 19 (counted from 0) of the fields"));
    g_clear_error(&error);
    lobes->values[19] = 0.5F;
    lobes->layout.views.theta_deg[1] = NAN;
    g_assert_null(lobes_view_new(&lobes, 1, &error));
    g_assert_true(g_str_has_prefix(error->message, "views: "));
    g_clear_error(&error);
    lobes->layout.views.theta_deg[1] = 20;
    lobes->layout.width = 1 << 20;
    lobes->layout.height = 0;
    g_assert_null(lobes_view_new(&lobes, 1, &error));
    g_assert_nonnull(strstr(error->message, "do not fit into textures"));
    lobes_free(lobes);
}
