/* Pictures from the whole BTF: against the formula, and against eigen-maps that are exact. */
#include "renderer/reference.h"
#include "view_fixture.h"

static void check_reference(enum kind kind, struct mesh *mesh, const struct view_settings *s,
                            struct hit (*find)(struct v3, struct v3), double tolerance) {
    g_autoptr(GError) error = NULL;
    g_autofree char *dir = write_btf(kind, 8, 16);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    g_assert_no_error(error);
    g_autoptr(View) view = make_view(kind, 8, 16, mesh);
    struct check c = {kind, s, NULL, 120, 90, mesh->radius, find};
    double relative;
    g_autofree float *pixels =
        reference_render_linear(reference, view, s, c.width, c.height, &relative, &error);
    g_assert_no_error(error);
    c.pixels = pixels;
    compare(&c, tolerance, 1000);
    /* These materials' eigen-maps are exact. */
    g_assert_cmpfloat(relative, <, 0.01);
    remove_folder(dir);
}

static void test_reference(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct view_settings s = bare_settings();
    s.camera_distance = 2.5;
    s.tiles_u = 3.0;
    struct mesh *mesh = scene_torus(1.0, 0.4, 512, 256);
    check_reference(TEXEL, mesh, &s, hit_torus, 1e-3);
    check_reference(VIEW, mesh, &s, hit_torus, 0.03);
    check_reference(LIGHT, mesh, &s, hit_torus, 0.03);
    mesh_free(mesh);
}

/* Filtered, seen from all around, and lit by the sky too: the two ways agree in every sample. */
static void test_reference_agrees(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_sphere();
    g_autofree char *dir = write_btf(COSINE, 3, 8);
    g_autoptr(View) view = make_view(COSINE, 3, 8, mesh);
    mesh_free(mesh);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    struct view_settings s = view_settings_default;
    double relative = 1.0;
    g_autofree guint8 *whole = reference_render(reference, view, &s, 60, 40, &relative, &error);
    g_assert_no_error(error);
    g_autofree guint8 *maps = view_render(view, &s, 60, 40, &error);
    g_assert_cmpfloat(relative, <, 0.005);
    for (int k = 0; k < 60 * 40 * 3; k++)
        g_assert_cmpint(ABS(whole[k] - maps[k]), <=, 3);
    remove_folder(dir);
}

/* In a shadow both have what an even sky gives, and nothing else. */
static void test_reference_shadows(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    const struct scene_options scene = {8, 3, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_make("torus", &scene, &error);
    g_autofree char *dir = write_btf(COSINE, 3, 8);
    g_autoptr(View) view = make_view(COSINE, 3, 8, mesh);
    mesh_free(mesh);
    g_autoptr(Reference) reference = reference_open(dir, &error);
    struct view_settings s = view_settings_default;
    s.shadows = TRUE;
    s.ambient = 0.1;
    double relative = 1.0, dark = 0.0;
    g_autofree float *whole =
        reference_render_linear(reference, view, &s, 120, 90, &relative, &error);
    g_assert_no_error(error);
    g_assert_cmpfloat(relative, <, 0.005);
    g_autofree float *lit = view_render_geometry(view, &s, VIEW_GEOMETRY_LIT, 120, 90, &error);
    for (int k = 0; k < 120 * 90; k++)
        if (lit[4 * k + 3] > 0.5f && lit[4 * k] == 0.0f) {
            dark++;
            g_assert_cmpfloat(whole[4 * k], <=, 0.1 + 1e-3);
        }
    g_assert_cmpfloat(dark, >, 500.0);
    remove_folder(dir);
}

static void test_bad_reference(struct fixture *f, gconstpointer data) {
    g_autoptr(GError) none = NULL, odd = NULL, torn = NULL;
    g_autofree char *dir = write_btf(GREY, 1, 4);
    g_assert_null(reference_open("/nowhere", &none));
    g_assert_error(none, REFERENCE_ERROR, REFERENCE_ERROR_NONE);
    struct eigenmaps *m = make_material(GREY, 1, 4);
    m->n_lights = 3;
    write_view(GREY, m, 2, dir); /* a light is missing */
    eigenmaps_free(m);
    g_assert_null(reference_open(dir, &odd));
    g_assert_error(odd, REFERENCE_ERROR, REFERENCE_ERROR_FORMAT);
    g_assert_nonnull(strstr(odd->message, "view_0002.exr"));
    g_autofree char *path = g_build_filename(dir, "view_0001.exr", NULL);
    g_assert_true(g_file_set_contents(path, "v/1\1", 4, NULL));
    g_assert_null(reference_open(dir, &torn));
    g_assert_nonnull(strstr(torn->message, "view_0001.exr"));
    remove_folder(dir);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    const struct {
        const char *name;
        void (*run)(struct fixture *f, gconstpointer data);
    } tests[] = {
        {"/reference/formula", test_reference},
        {"/reference/agrees", test_reference_agrees},
        {"/reference/shadows", test_reference_shadows},
        {"/reference/bad", test_bad_reference},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(tests); k++)
        g_test_add(tests[k].name, struct fixture, NULL, set_up, tests[k].run, tear_down);
    return g_test_run();
}
