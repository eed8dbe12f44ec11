/* The rotation of microfacets, and pictures of metal and fabric against microfacet_evaluate(). */
#include "lib/formula_fixture.h"
#include "lib/microfacet_formula.h"
#include "lib/test.h"

static struct vec3 random_normal(GRand *random) {
    for (;;) {
        const struct vec3 n = {g_rand_double_range(random, -1, 1),
                               g_rand_double_range(random, -1, 1),
                               g_rand_double_range(random, 0, 1)};
        const double length = vec3_length(n);
        if (length > 0.1 && length < 1)
            return vec3_scale(n, 1 / length);
    }
}

/* The columns are the images of x, y and z. */
static struct mat3 matrix_of(struct vec3 n, enum method_rotation rotation) {
    struct mat3 m;
    for (int k = 0; k < 3; k++) {
        const struct vec3 h = {k == 0, k == 1, k == 2};
        const struct vec3 image = microfacet_half(h, n, rotation);
        m.m[0][k] = image.x;
        m.m[1][k] = image.y;
        m.m[2][k] = image.z;
    }
    return m;
}

static void assert_near(double a, double b) {
    g_assert_cmpfloat_with_epsilon(a, b, 1e-9);
}

/* M Mᵀ has these on its diagonal and else zeros. */
static void assert_rows(const struct mat3 *m, double u, double v, double w) {
    const double lengths[3] = {u, v, w};
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) {
            double sum = 0;
            for (int k = 0; k < 3; k++)
                sum += m->m[i][k] * m->m[j][k];
            assert_near(sum, i == j ? lengths[i] : 0);
        }
}

static void check_normal(struct vec3 n) {
    const struct mat3 exact = matrix_of(n, METHOD_ROTATION_EXACT);
    const struct mat3 approximate = matrix_of(n, METHOD_ROTATION_APPROXIMATE);
    const struct vec3 up = mat3_mul_vec(&exact, n);
    assert_rows(&exact, 1, 1, 1);
    const struct vec3 r[3] = {{exact.m[0][0], exact.m[0][1], exact.m[0][2]},
                              {exact.m[1][0], exact.m[1][1], exact.m[1][2]},
                              {exact.m[2][0], exact.m[2][1], exact.m[2][2]}};
    assert_near(vec3_dot(r[0], vec3_cross(r[1], r[2])), 1); /* the determinant */
    assert_near(up.z, 1);
    g_assert_cmpfloat(hypot(up.x, up.y), <, 1e-9);
    /* v' of eq. 4 has no part along x: u' stays above the surface's x axis. */
    assert_near(exact.m[0][1], 0);
    if (hypot(n.x, n.z) > 1e-6)
        g_assert_cmpfloat(exact.m[0][0], >=, 0);
    assert_rows(&approximate, 1 - n.y * n.y, 1 - n.y * n.y, 1);
}

TEST(rotation) {
    g_autoptr(GRand) random = g_rand_new_with_seed(3);
    for (int k = 0; k < 1000; k++)
        check_normal(random_normal(random));
    check_normal((struct vec3){0, 0, 1});
    check_normal((struct vec3){1, 0, 0});
    check_normal((struct vec3){0, 1, 0});
    check_normal((struct vec3){0, -1, 0});
    /* Without a tilt all three are the same. */
    for (int k = 0; k < METHOD_ROTATIONS; k++) {
        const struct vec3 n = {0, 0, 1}, h = random_normal(random);
        const struct vec3 seen = microfacet_half(h, n, (enum method_rotation)k);
        assert_near(vec3_length(vec3_sub(seen, h)), 0);
    }
}

/* Where both angles are the same about one plane, so must the reflectance be: Ward's formula by
 * hand, in the plane of x. */
TEST(ward) {
    const struct microfacet s = {MICROFACET_WARD, {0.1F, 0.2F, 0.3F}, {1, 1, 1}, {0.25F, 0.5F}};
    const double tilt = 0.2, half = 0.3; /* of the normal; of light and view from it */
    const struct vec3 n = {sin(tilt), 0, cos(tilt)};
    const struct vec3 v = {sin(tilt + half), 0, cos(tilt + half)};
    const struct vec3 l = {sin(tilt - half), 0, cos(tilt - half)};
    double ret[3];
    microfacet_evaluate(&s, n, v, l, METHOD_ROTATION_EXACT, ret);
    g_assert_cmpfloat_with_epsilon(ret[1], 0.2 * cos(half) + 1 / (4 * 0.25 * 0.5), 1e-6);
    microfacet_evaluate(&s, n, v, l, METHOD_ROTATION_NONE, ret);
    const double hx = sin(tilt) / 0.25;
    g_assert_cmpfloat_with_epsilon(
        ret[1], 0.2 * cos(half) + exp(-2 * hx * hx / 2) / (4 * 0.25 * 0.5), 1e-6);
}

struct scene {
    enum microfacet_surface which;
    enum microfacet_model model;
    enum method_rotation rotation;
    double ambient;
};

static gboolean expected(gconstpointer data, const float *at, const float *v, const float *l,
                         double ret[3]) {
    static const float other_diffuse[3] = {0.07F, 0.08F, 0.3F};
    const struct scene *s = data;
    const double x[2] = {at[0], at[1]}, cells = s->which == MICROFACET_METAL ? 256 : 16;
    struct microfacet here;
    struct vec3 n;
    for (int k = 0; k < 2; k++)
        if (fabs(x[k] * cells - round(x[k] * cells)) < 0.02)
            return FALSE;
    if (v[2] < 0.1 || l[2] < 0.1)
        return FALSE;
    microfacet_surface_at(s->which, s->model, x, &here, &n);
    microfacet_evaluate(&here, n, (struct vec3){v[0], v[1], v[2]}, (struct vec3){l[0], l[1], l[2]},
                        s->rotation, ret);
    g_assert_true(s->which == MICROFACET_METAL || here.diffuse[2] == other_diffuse[2] ||
                  here.diffuse[0] > here.diffuse[2]);
    for (int c = 0; c < 3; c++)
        ret[c] += s->ambient * (here.diffuse[c] + here.specular[c]);
    return TRUE;
}

GPU_TEST(pictures) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_torus(1, 0.4, 128, 64);
    struct viewer_settings settings;
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    g_assert_no_error(error);
    formula_start_view(view, &settings, mesh);
    settings.style.nearest = TRUE;
    settings.tiles_u = 0.5;
    settings.tiles_v = 0.25; /* of fabric every yarn is large */
    for (int k = 0; k < MICROFACET_METHODS * METHOD_ROTATIONS; k++) {
        const struct method *method = &methods_microfacet[k / METHOD_ROTATIONS];
        const enum method_rotation rotation = (enum method_rotation)(k % METHOD_ROTATIONS);
        const struct scene scene = {(enum microfacet_surface)(k / METHOD_ROTATIONS / 2),
                                    (enum microfacet_model)(k / METHOD_ROTATIONS % 2), rotation,
                                    k % 2 ? 0.2 : 0};
        g_assert_true(viewer_open(view, method, NULL, &error));
        settings.style.rotation = rotation;
        settings.ambient = scene.ambient;
        g_test_message("%s, rotation %d", method->name, rotation);
        formula_compare(expected, &scene, view, &settings);
    }
}
