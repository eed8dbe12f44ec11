/* What libmesorig-material opens, and what it says of what it cannot open. */
#include "lib/folder.h"
#include "lib/material_fixture.h"
#include "lib/test.h"

#include <math.h>
#include <mesorig/material.h>
#include <string.h>

/* A session directory with a BTF only. */
static char *make_session(const char *name, const struct btf_matrix *btf) {
    char *session = in_folder(name);
    material_fixture_write_session(session, btf);
    return session;
}

/* At the measured directions and texel centres the value is the BTF's own. */
TEST(session) {
    g_autoptr(BtfMatrix) btf = material_fixture_btf(FALSE);
    g_autofree char *session = make_session("a.session", btf);
    g_autofree char *products = g_build_filename(session, "products", "btf", NULL);
    const gsize n_views = btf->layout.views.n, n_lights = btf->layout.lights.n;
    g_autofree float *views = g_new(float, 3 * n_views), *lights = g_new(float, 3 * n_lights);
    struct mesorig_error error = {0};
    mesorig_material *material = mesorig_material_open(session, NULL, &error);
    g_assert_cmpstr(error.text, ==, "");
    struct mesorig_material_info info = {.size = sizeof info};
    g_assert_cmpint(mesorig_material_info(material, &info), ==, MESORIG_OK);
    g_assert_cmpstr(info.kind, ==, "btf");
    g_assert_cmpint(info.n_views, ==, n_views);
    g_assert_cmpint(info.n_lights, ==, n_lights);
    g_assert_cmpfloat(info.error, ==, 0);
    g_assert_cmpint(mesorig_material_directions(material, views, lights), ==, MESORIG_OK);
    for (gsize texel = 0; texel < MATERIAL_WIDTH * MATERIAL_HEIGHT; texel++)
        for (gsize v = 0; v < n_views; v++)
            for (gsize l = 0; l < n_lights; l++) {
                const gsize column = texel % MATERIAL_WIDTH, row = texel / MATERIAL_WIDTH;
                const float uv[] = {((float)column + 0.5F) / MATERIAL_WIDTH,
                                    ((float)row + 0.5F) / MATERIAL_HEIGHT};
                float rgb[3];
                g_assert_cmpint(mesorig_material_evaluate(material, 1, uv, views + 3 * v,
                                                          lights + 3 * l, NULL, rgb),
                                ==, MESORIG_OK);
                for (gsize c = 0; c < 3; c++)
                    g_assert_cmpfloat_with_epsilon(
                        rgb[c], btf->values[((texel * n_views + v) * n_lights + l) * 3 + c], 2e-5);
            }
    mesorig_material_close(material);
    material = mesorig_material_open(products, NULL, &error);
    g_assert_nonnull(material);
    mesorig_material_close(material);
}

/* Without a BTF the compressed form with the least error is taken; without any, a sentence says
 * what to do. */
TEST(best) {
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autofree char *session = in_folder("b.session");
    g_autofree char *products = g_build_filename(session, "products", NULL);
    g_autofree char *good = g_build_filename(products, "z.exr", NULL);
    g_autofree char *poor = g_build_filename(products, "a.exr", NULL);
    g_autofree char *unknown = g_build_filename(products, "eigenmaps.exr", NULL);
    struct mesorig_material_info info = {.size = sizeof info};
    struct mesorig_error error = {0};
    g_assert_cmpint(g_mkdir_with_parents(products, 0755), ==, 0);
    g_assert_null(mesorig_material_open(session, NULL, &error));
    g_assert_cmpint(error.status, ==, MESORIG_ERROR_FORMAT);
    g_assert_nonnull(strstr(error.text, "b.session contains no material: give a session"));
    material_fixture_write(unknown, codecs_find("eigenmaps"), btf, "");
    mesorig_material *material = mesorig_material_open(session, NULL, &error);
    mesorig_material_info(material, &info);
    g_assert_cmpstr(info.kind, ==, "eigenmaps");
    g_assert_cmpfloat(info.error, ==, -1);
    mesorig_material_close(material);
    material_fixture_write(poor, codecs_find("ptm"), btf, "");
    material_fixture_write(good, codecs_find("lpca"), btf, "clusters=2 components=8");
    material = mesorig_material_open(session, NULL, &error);
    mesorig_material_info(material, &info);
    g_assert_cmpstr(info.kind, ==, "lpca");
    mesorig_material_close(material);
}

/* One view under one light, from straight above: it is seen alike from everywhere, and falls off as
 * the cosine does. */
TEST(one_view) {
    g_autoptr(BtfMatrix) btf = material_fixture_sized(MATERIAL_WIDTH, MATERIAL_HEIGHT, 0, TRUE);
    g_autofree char *session = make_session("one.session", btf);
    struct mesorig_error error = {0};
    const float uv[] = {0.5F / MATERIAL_WIDTH, 0.5F / MATERIAL_HEIGHT};
    const float views[][3] = {{0, 0, 1}, {0.8F, 0, 0.6F}, {0, -0.999F, 0.04F}};
    g_assert_cmpint(btf->layout.views.n * btf->layout.lights.n, ==, 1);
    mesorig_material *material = mesorig_material_open(session, NULL, &error);
    g_assert_cmpstr(error.text, ==, "");
    for (gsize v = 0; v < G_N_ELEMENTS(views); v++)
        for (gsize l = 0; l < 2; l++) {
            float rgb[3];
            mesorig_material_evaluate(material, 1, uv, views[v], views[l], NULL, rgb);
            g_assert_cmpfloat_with_epsilon(rgb[1], btf->values[1] * views[l][2], 1e-5);
        }
    mesorig_material_close(material);
}

/* The same bytes give the same values, wherever they lie. */
TEST(memory) {
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autofree char *path = in_folder("memory.exr");
    g_autofree char *bytes = NULL;
    gsize n;
    struct mesorig_error error = {0};
    const float uv[] = {0.3F, 0.6F}, view[] = {0.2F, 0.1F, 0.9F}, light[] = {-0.5F, 0.2F, 0.6F};
    float a[3], b[3];
    material_fixture_write(path, codecs_find("hsh"), btf, "");
    g_assert_true(g_file_get_contents(path, &bytes, &n, NULL));
    mesorig_material *file = mesorig_material_open(path, NULL, NULL);
    mesorig_material *memory = mesorig_material_open_memory(bytes, n, NULL, 0, &error);
    g_assert_cmpstr(error.text, ==, "");
    mesorig_material_evaluate(file, 1, uv, view, light, NULL, a);
    mesorig_material_evaluate(memory, 1, uv, view, light, NULL, b);
    g_assert_cmpmem(a, sizeof a, b, sizeof b);
    mesorig_material_close(file);
    mesorig_material_close(memory);
    g_assert_null(mesorig_material_open_memory(bytes, n / 2, NULL, 0, &error));
    g_assert_true(g_str_has_prefix(error.text, "the material in memory: "));
    g_assert_cmpint(error.status, ==, MESORIG_ERROR_FORMAT);
    g_assert_null(mesorig_material_open_memory(bytes, n, bytes, n, &error));
    g_assert_nonnull(strstr(error.text, "the MDF in memory: "));
    g_assert_null(mesorig_material_open_memory(bytes, 0, NULL, 0, &error));
    g_assert_cmpint(error.status, ==, MESORIG_ERROR_ARGUMENT);
    g_assert_null(mesorig_material_open_memory(NULL, 5, NULL, 0, NULL));
}

static void assert_refused(const char *path, const char *mdf, int status, const char *text) {
    struct mesorig_error error = {0};
    g_assert_null(mesorig_material_open(path, mdf, &error));
    g_assert_cmpint(error.status, ==, status);
    if (!strstr(error.text, text))
        g_error("“%s” does not say “%s”", error.text, text);
    g_assert_null(mesorig_material_open(path, mdf, NULL));
}

TEST(bad) {
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autofree char *good = in_folder("good.exr"), *cut = in_folder("cut.exr");
    g_autofree char *text = in_folder("text.exr"), *gone = in_folder("gone.exr");
    g_autofree char *empty = in_folder("empty"), *bytes = NULL;
    g_autofree char *long_name = g_strnfill(3000, 'x');
    gsize n;
    material_fixture_write(good, codecs_find("lafortune"), btf, "");
    g_assert_true(g_file_get_contents(good, &bytes, &n, NULL));
    g_assert_true(g_file_set_contents(cut, bytes, (gssize)(n * 3 / 4), NULL));
    g_assert_true(g_file_set_contents(text, "not a picture", -1, NULL));
    g_assert_cmpint(g_mkdir_with_parents(empty, 0755), ==, 0);
    assert_refused(NULL, NULL, MESORIG_ERROR_ARGUMENT, "path is NULL");
    assert_refused(gone, NULL, MESORIG_ERROR_FILE, "gone.exr");
    assert_refused(cut, NULL, MESORIG_ERROR_FORMAT, "cut.exr");
    assert_refused(text, NULL, MESORIG_ERROR_FORMAT, "text.exr");
    assert_refused(empty, NULL, MESORIG_ERROR_FORMAT, "empty contains no material");
    assert_refused("/dev/zero", NULL, MESORIG_ERROR_FORMAT, "/dev/zero");
    assert_refused(good, gone, MESORIG_ERROR_FILE, "there is no ");
    assert_refused(good, text, MESORIG_ERROR_FORMAT, "text.exr");
    assert_refused(good, good, MESORIG_ERROR_FORMAT, "good.exr");
    assert_refused(long_name, NULL, MESORIG_ERROR_FILE, "xxxxxx");
}

TEST(arguments) {
    g_autoptr(BtfMatrix) btf = material_fixture_btf(TRUE);
    g_autofree char *path = in_folder("arguments.exr");
    struct mesorig_material_info info = {.size = sizeof info};
    const float uv[] = {0.3F, 0.6F}, up[] = {0, 0, 1}, infinite = INFINITY, below = -1;
    static const float bad[][3] = {{0, 0, -1},  {1, 0, 0},        {0, 0, 0},
                                   {NAN, 0, 1}, {0, 0, INFINITY}, {1e30F, 0, 1e-30F}};
    float rgb[3] = {5, 5, 5};
    struct mesorig_hit hit = {.hit = 7};
    material_fixture_write(path, codecs_find("ashikhmin"), btf, "");
    mesorig_material *m = mesorig_material_open(path, NULL, NULL);
    g_assert_cmpint(mesorig_material_info(NULL, &info), ==, MESORIG_ERROR_ARGUMENT);
    g_assert_cmpint(mesorig_material_info(m, NULL), ==, MESORIG_ERROR_ARGUMENT);
    info.size = 0;
    g_assert_cmpint(mesorig_material_info(m, &info), ==, MESORIG_ERROR_ARGUMENT);
    /* A caller of an older header knows fewer members. */
    info.size = offsetof(struct mesorig_material_info, n_views);
    info.n_views = -7;
    g_assert_cmpint(mesorig_material_info(m, &info), ==, MESORIG_OK);
    g_assert_cmpint(info.height, ==, MATERIAL_HEIGHT);
    g_assert_cmpint(info.n_views, ==, -7);
    g_assert_cmpint(mesorig_material_directions(NULL, NULL, NULL), ==, MESORIG_ERROR_ARGUMENT);
    g_assert_cmpint(mesorig_material_directions(m, NULL, NULL), ==, MESORIG_OK);
    g_assert_cmpint(mesorig_material_evaluate(NULL, 1, uv, up, up, NULL, rgb), ==,
                    MESORIG_ERROR_ARGUMENT);
    g_assert_cmpint(mesorig_material_evaluate(m, 1, uv, NULL, up, NULL, rgb), ==,
                    MESORIG_ERROR_ARGUMENT);
    g_assert_cmpint(mesorig_material_evaluate(m, 0, NULL, NULL, NULL, NULL, NULL), ==, MESORIG_OK);
    g_assert_cmpint(mesorig_material_intersect(m, 1, uv, NULL, &hit), ==, MESORIG_ERROR_ARGUMENT);
    g_assert_cmpfloat(rgb[0], ==, 5);
    for (gsize k = 0; k < G_N_ELEMENTS(bad); k++)
        for (int side = 0; side < 2; side++) {
            rgb[0] = rgb[1] = rgb[2] = 5;
            g_assert_cmpint(mesorig_material_evaluate(m, 1, uv, side ? bad[k] : up,
                                                      side ? up : bad[k], NULL, rgb),
                            ==, MESORIG_OK);
            if (k < 5)
                g_assert_cmpfloat(rgb[0] + rgb[1] + rgb[2], ==, 0);
            g_assert_true(isfinite(rgb[0]) && rgb[0] >= 0);
        }
    static const float nowhere[][2] = {{NAN, 0}, {0, INFINITY}};
    for (gsize k = 0; k < G_N_ELEMENTS(nowhere); k++) {
        mesorig_material_evaluate(m, 1, nowhere[k], up, up, NULL, rgb);
        g_assert_cmpfloat(rgb[1], ==, 0);
        g_assert_cmpint(mesorig_material_intersect(m, 1, nowhere[k], up, &hit), ==, MESORIG_OK);
        g_assert_cmpint(hit.hit, ==, 0);
    }
    mesorig_material_evaluate(m, 1, uv, up, up, &infinite, rgb);
    g_assert_cmpfloat(rgb[1], ==, 0);
    mesorig_material_evaluate(m, 1, uv, up, up, &below, rgb);
    g_assert_cmpfloat(rgb[1], ==, 0);
    static const float far[] = {3e38F, -3e38F};
    mesorig_material_evaluate(m, 1, far, up, up, NULL, rgb);
    g_assert_cmpfloat(rgb[1], >, 0);
    mesorig_material_close(m);
    mesorig_material_close(NULL);
}

BEFORE_TESTS {
    folder_make();
}

AFTER_TESTS {
    folder_remove();
}
