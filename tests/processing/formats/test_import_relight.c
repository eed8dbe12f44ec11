/* Sets of Relight whose coefficients are known, against the formula of OpenLIME's shader. */
#include "btf/btf_matrix.h"
#include "formats/import.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "scene/picture.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#include "lib/process.h"
#include "lib/session_fixture.h"

#define WIDTH  4
#define HEIGHT 3
#define TEXELS (WIDTH * HEIGHT)
#define LIGHTS 4

static const double lights[LIGHTS][3] = {
    {0, 0, 1}, {0.6, 0, 0.8}, {-0.48, 0.64, 0.6}, {0, -0.995, 0.1}};

static guint8 byte(int plane, int texel, int colour) {
    return (guint8)((plane * 71 + texel * 37 + colour * 23 + 40) % 256);
}
static double scale(int k) {
    return 0.5 + 0.05 * k;
}
static double bias(int k) {
    return k < 3 ? 0.01 * k : 0.15 + 0.005 * k;
}

static void write_planes(int n) {
    for (int plane = 0; plane < n; plane++) {
        g_autofree char *name = g_strdup_printf("plane_%d.png", plane), *path = in_folder(name);
        guint8 rgb[TEXELS * 3];
        for (int i = 0; i < TEXELS * 3; i++)
            rgb[i] = byte(plane, i / 3, i % 3);
        g_assert_true(picture_write_png(path, rgb, WIDTH, HEIGHT, NULL, NULL));
    }
}

/* more: further members, each with a comma before it. */
static char *write_info(const char *type, const char *space, int n_planes, const char *more) {
    g_autoptr(GString) text = g_string_new(NULL);
    char *path = in_folder("info.json");
    g_string_printf(text,
                    "{\"width\": %d, \"height\": %d, \"format\": \"png\", \"type\": \"%s\", "
                    "\"colorspace\": \"%s\", \"nplanes\": %d, \"pixelSizeInMM\": 0.125%s, "
                    "\"materials\": [{\"scale\": [",
                    WIDTH, HEIGHT, type, space, 3 * n_planes, more);
    for (int k = 0; k < 3 * n_planes; k++)
        g_string_append_printf(text, "%s%.4f", k ? "," : "", scale(k));
    g_string_append(text, "], \"bias\": [");
    for (int k = 0; k < 3 * n_planes; k++)
        g_string_append_printf(text, "%s%.4f", k ? "," : "", bias(k));
    g_string_append(text, "]}], \"lights\": [");
    for (int i = 0; i < 3 * LIGHTS; i++)
        g_string_append_printf(text, "%s%.4f", i ? "," : "", lights[i / 3][i % 3]);
    g_string_append(text, "]}");
    g_assert_true(g_file_set_contents(path, text->str, -1, NULL));
    return path;
}

/* As PTM.lightWeights() and HSH.lightWeights() of OpenLIME have them. */
static void weights(gboolean hsh, const double *v, double *ret) {
    const double theta = MIN(acos(v[2]), G_PI / 2 - 0.15), phi = atan2(v[1], v[0]);
    const double c = cos(theta), c2 = c * c, s = sqrt(c - c2);
    const double of_ptm[9] = {1, v[0], v[1], v[0] * v[0], v[0] * v[1], v[1] * v[1]};
    const double of_hsh[9] = {1 / sqrt(2 * G_PI),
                              sqrt(6 / G_PI) * cos(phi) * s,
                              sqrt(3 / (2 * G_PI)) * (-1 + 2 * c),
                              sqrt(6 / G_PI) * s * sin(phi),
                              sqrt(30 / G_PI) * cos(2 * phi) * (-c + c2),
                              sqrt(30 / G_PI) * cos(phi) * (-1 + 2 * c) * s,
                              sqrt(5 / (2 * G_PI)) * (1 - 6 * c + 6 * c2),
                              sqrt(30 / G_PI) * (-1 + 2 * c) * s * sin(phi),
                              sqrt(30 / G_PI) * (-c + c2) * sin(2 * phi)};
    for (int i = 0; i < 9; i++)
        ret[i] = hsh ? of_hsh[i] : of_ptm[i];
}

static double channel(int k, int texel) {
    return (byte(k / 3, texel, k % 3) / 255.0 - bias(k)) * scale(k);
}

static void check_set(gboolean hsh, gboolean lrgb, int n_planes) {
    g_autofree char *path = session_fixture_path("relight");
    g_autofree char *info = write_info(hsh ? "hsh" : "ptm", lrgb ? "lrgb" : "rgb", n_planes, "");
    const struct import_wish wish = {0};
    struct import_result result;
    int dark = 0;
    write_planes(n_planes);
    ok(import_relight(path, info, &wish, NULL, &result, ERR));
    struct btf_matrix *btf = ok(btf_matrix_read(path, NULL, ERR));
    g_assert_cmpint(btf->layout.lights.n, ==, LIGHTS);
    g_assert_cmpint(btf->layout.width, ==, WIDTH);
    g_assert_cmpfloat(btf->layout.texel_mm, ==, 0.125);
    g_assert_cmpfloat_with_epsilon((double)btf->layout.lights.phi_deg[3], 270, 1e-3);
    for (int t = 0; t < TEXELS; t++)
        for (int l = 0; l < LIGHTS; l++) {
            double b[9], f[3] = {0}, lit = 0;
            weights(hsh, lights[l], b);
            for (int k = 0; k < 3 * n_planes; k++)
                if (!lrgb)
                    f[k % 3] += b[k / 3] * channel(k, t);
                else if (k >= 3)
                    lit += b[k - 3] * channel(k, t);
            for (int c = 0; c < 3; c++) {
                const double v = MAX(lrgb ? lit * channel(c, t) : f[c], 0);
                const double linear = v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
                dark += v <= 0;
                g_assert_cmpfloat_with_epsilon(
                    (double)btf->values[((gsize)t * LIGHTS + (gsize)l) * 3 + (gsize)c], linear,
                    1e-3 + 2e-3 * linear);
            }
        }
    g_assert_cmpint(dark, <, TEXELS * LIGHTS * 3 / 2);
    btf_matrix_free(btf);
}

TEST(sets) {
    check_set(FALSE, FALSE, 6);
    check_set(FALSE, TRUE, 3);
    check_set(TRUE, FALSE, 4);
    check_set(TRUE, FALSE, 9);
    check_set(TRUE, TRUE, 4);
}

static void assert_refused(const char *info, const char *what) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = session_fixture_path("refused");
    struct import_result result;
    g_assert_false(import_relight(path, info, &(struct import_wish){0}, NULL, &result, &error));
    g_assert_nonnull(error);
    assert_has(error->message, info);
    assert_has(error->message, what);
    g_assert_false(g_file_test(path, G_FILE_TEST_EXISTS));
}

TEST(bad) {
    static const char *const bad[][2] = {
        {"{", "the file is not JSON"},
        {"[]", "the file is not a JSON object"},
        {"{}", "type is none and colorspace is none; only ptm or hsh with rgb or lrgb can be read"},
        {"{\"type\": 3, \"colorspace\": null}", "type is none"},
        {"{\"type\": \"rbf\", \"colorspace\": \"mrgb\"}", "type is rbf and colorspace is mrgb"},
        {"{\"type\": \"ptm\", \"colorspace\": \"rgb\", \"width\": \"4\"}", "width is 0"},
        {"{\"type\": \"ptm\", \"colorspace\": \"rgb\", \"width\": 4, \"height\": 3, \"nplanes\": "
         "27}",
         "nplanes is 27, which is not possible for ptm in rgb"},
        {"{\"type\": \"ptm\", \"colorspace\": \"rgb\", \"width\": 4, \"height\": 3, \"nplanes\": "
         "18}",
         "“materials” is missing"},
        {"{\"type\": \"ptm\", \"colorspace\": \"rgb\", \"width\": 4, \"height\": 3, \"nplanes\": "
         "18, "
         "\"materials\": [{\"scale\": [1, \"2\"]}]}",
         "“scale” has 2 values, but needs 18 numbers"},
        {"{\"type\": \"ptm\", \"colorspace\": \"rgb\", \"width\": 4, \"height\": 3, \"nplanes\": "
         "18, \"materials\": [{\"scale\": [0, 1, 2, 3, 4, 5, 6, 7, 8, 9, 10, \"11\", 12, 13, 14, "
         "15, "
         "16, 17]}]}",
         "value 11 of “scale”, counted from 0, is not a number"},
        {"{\"type\": \"ptm\", \"colorspace\": \"rgb\", \"width\": 4, \"height\": 3, \"nplanes\": "
         "18, \"materials\": [{\"bias\": []}]}",
         "“scale” is missing or no array"},
    };
    g_autofree char *info = in_folder("info.json"), *gone = in_folder("plane_2.png");
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_assert_true(g_file_set_contents(info, bad[i][0], -1, NULL));
        assert_refused(info, bad[i][1]);
    }
    write_planes(6);
    g_free(write_info("ptm", "rgb", 6, ""));
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(info, &text, NULL, NULL));
    char *light = strstr(text, "0.1000]}");
    memcpy(light, "-0.100", 6);
    g_assert_true(g_file_set_contents(info, text, -1, NULL));
    assert_refused(info, "light 4 is 0 -0.995 -0.1, but its third number must be above 0");
    g_free(write_info("ptm", "rgb", 6, ""));
    g_unlink(gone);
    assert_refused(info,
                   "there is no plane_2.png in the same folder. Planes that are cut into tiles");
}

TEST(command) {
    g_autofree char *path = session_fixture_path("command");
    g_autofree char *info = write_info("ptm", "rgb", 6, "");
    write_planes(6);
    g_autofree char *said =
        process_mesorig(0, "import relight %s -o %s --region 1,1,2,2 --json", info, path);
    assert_has(said, "\"lights\": 4");
    assert_has(said, "\"width\": 2");
}

/* A set that lists no lights is made under those of the papers, or of a table; one of WebRTI is
 * named. */
TEST(no_lights) {
    g_autofree char *info = write_info("ptm", "rgb", 6, ""), *text = NULL;
    g_autofree char *table = in_folder("lights.csv"), *web = in_folder("web");
    g_autofree char *xml = g_build_filename(web, "info.xml", NULL);
    write_planes(6);
    g_assert_true(g_file_get_contents(info, &text, NULL, NULL));
    *strstr(text, ", \"lights\"") = '\0';
    g_autofree char *without = g_strconcat(text, "}", NULL);
    g_assert_true(g_file_set_contents(info, without, -1, NULL));
    g_assert_true(g_file_set_contents(
        table, "of,theta_deg,phi_deg\nview,0,0\nlight,10,0\nlight,50,90\n", -1, NULL));
    for (int k = 0; k < 2; k++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
        g_autofree char *path = session_fixture_path("no_lights");
        const struct import_wish wish = {.directions = k ? table : NULL, .notes = notes};
        struct import_result result;
        ok(import_relight(path, info, &wish, NULL, &result, ERR));
        g_assert_cmpint(result.n_lights, ==, k ? 2 : 81);
        g_assert_cmpuint(notes->len, ==, 1);
        assert_has(notes->pdata[0],
                   k ? "under the 2 lights of " : "under the 81 lights of the papers");
    }
    g_autoptr(GError) error = NULL;
    g_autofree char *path = session_fixture_path("web");
    const struct import_wish wish = {0};
    struct import_result result;
    g_assert_cmpint(g_mkdir(web, 0700), ==, 0);
    g_assert_true(g_file_set_contents(xml, "<MultiRes/>", -1, NULL));
    g_assert_false(import_relight(path, web, &wish, NULL, &result, &error));
    assert_has(error->message, "info.xml: it is a file of WebRTI");
}

TESTS_RUN_BY(session_fixture_run);

BEFORE_TESTS {
    folder_make();
}

AFTER_TESTS {
    folder_remove();
}
