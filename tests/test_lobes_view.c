/* Pictures of the analytic models of texels against lobes_evaluate(), pixel by pixel. */
#include "formula_fixture.h"
#include "processing/lobes.h"
#include "processing/resample.h"
#include "renderer/directions.h"
#include "renderer/lobes_view.h"
#include "rings.h"

#include <glib/gstdio.h>
#include <string.h>

static double uniform(GRand *random, double low, double high) {
    return g_rand_double_range(random, low, high);
}

static void fill_lobe(GRand *random, float *ret) {
    for (int k = 0; k < 2; k++)
        ret[k] = (float)uniform(random, -0.4, 0.4);
    ret[2] = (float)uniform(random, 0.5, 0.9);
    ret[3] = (float)uniform(random, 0.8, 6);
}

/* Normal and tangent as a fit has them: the tangent's azimuth is turned, then laid into the
 * surface. */
static void fill_frame(GRand *random, float *ret) {
    const double p = uniform(random, -0.5, 0.5), q = uniform(random, -0.5, 0.5);
    const double turn = uniform(random, -3, 3), c = cos(turn), s = sin(turn);
    const double n = sqrt(p * p + q * q + 1), z = p * c + q * s, t = sqrt(1 + z * z);
    const double frame[6] = {-p / n, -q / n, 1 / n, c / t, s / t, z / t};
    for (int k = 0; k < 6; k++)
        ret[k] = (float)frame[k];
}

static void fill_values(GRand *random, const struct lobes *lobes, float *ret) {
    for (int k = 0; k < 6; k++)
        ret[k] = (float)uniform(random, 0.1, 0.5);
    if (lobes->model == LOBES_PTM)
        for (int k = 3; k < 9; k++)
            ret[k] = (float)uniform(random, -0.3, 0.6);
    if (lobes->model == LOBES_FIELDS || lobes->model == LOBES_LAFORTUNE)
        for (int k = 0; k < lobes->n_lobes; k++)
            fill_lobe(random, ret + lobes->n_values - 4 * (k + 1));
    if (lobes->model < LOBES_WARD)
        return;
    const gboolean ward = lobes->model == LOBES_WARD;
    for (int k = 3; k < 6; k++)
        ret[k] *= 0.3F;
    fill_frame(random, ret + 6);
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
                        .width = W,
                        .height = H,
                        .texel_mm = 1,
                        .n_views = RINGS * A_RING,
                        .n_lights = RINGS * A_RING,
                        .n_lobes = model == LOBES_FIELDS || model == LOBES_LAFORTUNE ? n_lobes : 0,
                        .n_slices = sliced ? RINGS * A_RING : 1,
                        .n_values = n_values[model]};
    fill_directions(0, &p->view_theta_deg, &p->view_phi_deg);
    fill_directions(5, &p->light_theta_deg, &p->light_phi_deg);
    p->values = g_new0(float, p->n_slices *W *H * p->n_values);
    for (int k = 0; k < p->n_slices * W * H; k++)
        fill_values(random, p, p->values + (gsize)k * p->n_values);
    return p;
}

/* Through a file, as the viewer opens it; returns what the file gives back. */
static struct lobes *show(View *view, enum lobes_model model, int n_lobes) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "lobes.exr", NULL);
    struct lobes *made = make_lobes(model, n_lobes);
    g_assert_true(lobes_write(path, made, &error));
    lobes_free(made);
    struct lobes *lobes = lobes_read(path, &error);
    g_assert_no_error(error);
    g_assert_true(view_open(view, &methods_lobes[model], path, &error));
    g_assert_no_error(error);
    g_assert_false(view_open(view, &methods_lobes[(model + 1) % LOBES_MODELS], path, &error));
    g_assert_nonnull(strstr(error->message, lobes_model_name(model)));
    g_assert_true(g_unlink(path) == 0 && g_rmdir(dir) == 0);
    return lobes;
}

struct scene {
    const struct lobes *lobes;
    Directions *views;
    double ambient;
    gboolean nearest;
};

/* A texel of a slice under the light and the sky. */
static void slice_value(const struct scene *s, int slice, int texel, const float *v, const float *l,
                        double share, double ret[3]) {
    float rgb[3];
    lobes_evaluate(s->lobes, slice, texel, v, l, rgb);
    for (int c = 0; c < 3; c++)
        ret[c] += share * fmax(rgb[c], 0);
}

/* The sky as a measured view sees it, by 16 lights. */
static void sky_value(const struct scene *s, int view, int texel, double share, double ret[3]) {
    const struct lobes *p = s->lobes;
    const double theta = p->view_theta_deg[view] * G_PI / 180;
    const double phi = p->view_phi_deg[view] * G_PI / 180;
    const float v[3] = {(float)(sin(theta) * cos(phi)), (float)(sin(theta) * sin(phi)),
                        (float)cos(theta)};
    for (int k = 0; k < 16; k++) {
        const int row = k / 4;
        float l[3];
        resample_direction((0.5 + k % 4) / 4, (0.5 + row) / 4, l);
        slice_value(s, p->n_slices > 1 ? view : 0, texel, v, l, share * s->ambient / 8, ret);
    }
}

static void add_view(const struct scene *s, int view, int texel, const float *v, const float *l,
                     double share, double ret[3]) {
    int n = 1;
    const int *members = &view;
    if (view == s->lobes->n_views)
        members = directions_pole(s->views, &n);
    for (int k = 0; k < n; k++) {
        if (s->lobes->n_slices > 1)
            slice_value(s, members[k], texel, v, l, share / n, ret);
        if (s->ambient > 0)
            sky_value(s, members[k], texel, share / n, ret);
    }
}

static gboolean expected(gconstpointer data, const float *at, const float *v, const float *l,
                         double ret[3]) {
    const struct scene *s = data;
    struct direction_weights g;
    const double x = at[0] * (double)W - 0.5, y = at[1] * (double)H - 0.5;
    const double part[2] = {x - floor(x), y - floor(y)};
    if (v[2] < 0.1 || l[2] < 0.1 ||
        (s->nearest && (fabs(part[0] - 0.5) < 0.03 || fabs(part[1] - 0.5) < 0.03)))
        return FALSE;
    directions_weights(s->views, (struct vec3){v[0], v[1], v[2]}, &g);
    ret[0] = ret[1] = ret[2] = 0;
    for (int k = 0; k < 4; k++) {
        const int i = (int)floor(x) + k % 2, j = (int)floor(y) + k / 2;
        const int texel = (i % W + W) % W + W * ((j % H + H) % H);
        const double near_x = s->nearest ? part[0] > 0.5 : part[0];
        const double near_y = s->nearest ? part[1] > 0.5 : part[1];
        const double share = (k % 2 ? near_x : 1 - near_x) * (k / 2 ? near_y : 1 - near_y);
        if (share <= 0)
            continue;
        if (s->lobes->n_slices == 1)
            slice_value(s, 0, texel, v, l, share, ret);
        for (int a = 0; a < 4; a++)
            if (g.weight[a] > 0)
                add_view(s, g.index[a], texel, v, l, share * g.weight[a], ret);
    }
    return TRUE;
}

static void check_model(enum lobes_model model, int n_lobes, gboolean nearest, double ambient) {
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_torus(1, 0.4, 128, 64);
    struct view_settings settings;
    g_autoptr(View) view = view_new(NULL, &error);
    g_assert_no_error(error);
    start_view(view, &settings, mesh);
    settings.style.nearest = nearest;
    settings.ambient = ambient;
    struct lobes *lobes = show(view, model, n_lobes);
    g_autoptr(Directions) views =
        directions_new(lobes->view_theta_deg, lobes->view_phi_deg, lobes->n_views, &error);
    const struct scene scene = {lobes, views, ambient, nearest};
    g_test_message("%s, %d lobes", lobes_model_name(model), lobes->n_lobes);
    compare_picture(expected, &scene, view, &settings);
    lobes_free(lobes);
    mesh_free(mesh);
}

static void test_formula(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    check_model(LOBES_FIELDS, 2, FALSE, 0);
    check_model(LOBES_FIELDS, 3, TRUE, 0.3);
    check_model(LOBES_PTM, 0, FALSE, 0.1);
    check_model(LOBES_LAFORTUNE, 1, TRUE, 0.2);
    check_model(LOBES_LAFORTUNE, 3, FALSE, 0);
    check_model(LOBES_WARD, 0, FALSE, 0);
    check_model(LOBES_ASHIKHMIN, 0, FALSE, 0.1);
}

static void test_bad(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    g_autoptr(GError) error = NULL;
    struct lobes *lobes = make_lobes(LOBES_FIELDS, 2);
    lobes->values[19] = NAN;
    g_assert_null(lobes_view_new(lobes, &error));
    g_assert_nonnull(strstr(error->message, "value number 19 of the fields"));
    g_clear_error(&error);
    lobes->values[19] = 0.5F;
    lobes->view_theta_deg[1] = NAN;
    g_assert_null(lobes_view_new(lobes, &error));
    g_assert_true(g_str_has_prefix(error->message, "views: "));
    g_clear_error(&error);
    lobes->view_theta_deg[1] = 20;
    lobes->width = 1 << 20;
    lobes->height = 0;
    g_assert_null(lobes_view_new(lobes, &error));
    g_assert_nonnull(strstr(error->message, "more than"));
    lobes_free(lobes);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add("/lobes-view/formula", struct fixture, NULL, set_up, test_formula, tear_down);
    g_test_add("/lobes-view/bad", struct fixture, NULL, set_up, test_bad, tear_down);
    return g_test_run();
}
