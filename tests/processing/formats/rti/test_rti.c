/* PTM, HSH and Relight's files against a reader and writer in Python that share nothing with ours.
 */
#include "btf/btf_matrix.h"
#include "formats/reflectance/import_brdf.h"
#include "formats/rti/rti.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

#define WIDTH  5
#define HEIGHT 3
#define TEXELS (WIDTH * HEIGHT)
#define LIGHTS 24

static const struct work quietly = {0};
static float lights[LIGHTS * 3];

/* Three rings and a bit, as domes have them; also as a table and for the peer. */
static void make_lights(void) {
    g_autoptr(GString) table = g_string_new("of,theta_deg,phi_deg\nview,0,0\n");
    g_autofree char *path = in_folder("lights.csv"), *raw = in_folder("lights");
    double numbers[LIGHTS * 3];
    for (int i = 0; i < LIGHTS; i++) {
        const int theta = 10 + 20 * (i % 4), phi = 15 * i;
        const double t = theta * G_PI / 180, p = phi * G_PI / 180;
        const double light[3] = {sin(t) * cos(p), sin(t) * sin(p), cos(t)};
        g_string_append_printf(table, "light,%d,%d\n", theta, phi);
        for (int k = 0; k < 3; k++) {
            numbers[3 * i + k] = light[k];
            lights[3 * i + k] = (float)light[k];
        }
    }
    g_assert_true(g_file_set_contents(path, table->str, -1, NULL));
    g_assert_true(g_file_set_contents(raw, (const char *)numbers, (gssize)sizeof numbers, NULL));
}

/* What the peer says that a file holds, after it has written it: LIGHTS × texels × 3. */
static double *peer(const char *verb, const char *a, const char *b, const char *c, gsize texels) {
    g_autofree char *raw = in_folder("lights"), *values = in_folder("values");
    const char *argv[9] = {"python3", SOURCE_DIR "/tests/rti_peer.py", verb, a, b};
    int n = 5;
    char *bytes;
    gsize length;
    if (c)
        argv[n++] = c;
    argv[n++] = raw;
    argv[n++] = values;
    g_free(process_text(0, argv));
    g_assert_true(g_file_get_contents(values, &bytes, &length, NULL));
    g_assert_cmpuint(length, ==, LIGHTS * texels * 3 * sizeof(double));
    return (double *)bytes;
}

static double linear(double v) {
    v = MAX(v, 0);
    return v <= 0.04045 ? v / 12.92 : pow((v + 0.055) / 1.055, 2.4);
}

/* Imported, a file is a session of the peer's values. */
static void check_import(const char *path, const double *wanted) {
    g_autofree char *session = in_folder("imported.session"), *table = in_folder("lights.csv");
    const struct import_wish wish = {.texel_mm = 0.25};
    struct import_result result;
    ok(import_ptm(session, path, table, &wish, &quietly, &result, ERR));
    struct btf_matrix *btf = ok(btf_matrix_read(session, NULL, ERR));
    g_assert_cmpuint(btf->layout.width, ==, WIDTH);
    g_assert_cmpuint(btf->layout.lights.n, ==, LIGHTS);
    g_assert_cmpfloat(btf->layout.texel_mm, ==, 0.25);
    for (gsize l = 0; l < LIGHTS; l++)
        for (gsize t = 0; t < TEXELS; t++)
            for (gsize c = 0; c < 3; c++) {
                const double value = linear(wanted[(l * TEXELS + t) * 3 + c]);
                g_assert_cmpfloat_with_epsilon(
                    (double)btf->values[(t * LIGHTS + l) * 3 + c], value,
                    1e-5 + value / 1024); /* values of a session are halves */
            }
    btf_matrix_free(btf);
    remove_tree(session);
}

/* Read, a file evaluates to the peer's values. */
static void check_values(const char *path, const double *wanted, gboolean hsh) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Rti) rti = rti_read(path, &error);
    g_assert_no_error(error);
    g_assert_cmpint(rti->width, ==, WIDTH);
    g_assert_cmpint(rti->hsh, ==, hsh);
    for (gsize l = 0; !hsh && l < LIGHTS; l++)
        for (gsize t = 0; t < TEXELS; t++) {
            float basis[RTI_PTM_TERMS], rgb[3];
            rti_ptm_basis(lights + 3 * l, basis);
            rti_evaluate(rti, t, basis, rgb);
            for (gsize c = 0; c < 3; c++)
                g_assert_cmpfloat_with_epsilon((double)rgb[c], wanted[(l * TEXELS + t) * 3 + c],
                                               1e-5);
        }
    check_import(path, wanted);
}

TEST(read) {
    static const char *const forms[][2] = {{"PTM_1.2", "PTM_FORMAT_RGB"},
                                           {"PTM_1.2", "PTM_FORMAT_LRGB"},
                                           {"PTM_1.1", "PTM_FORMAT_LRGB"}};
    g_autofree char *path = in_folder("made");
    for (gsize i = 0; i < G_N_ELEMENTS(forms); i++) {
        g_autofree double *wanted = peer("ptm", forms[i][0], forms[i][1], path, TEXELS);
        check_values(path, wanted, FALSE);
    }
    for (int terms = 4; terms <= 9; terms += 5) {
        g_autofree char *number = g_strdup_printf("%d", terms);
        g_autofree double *wanted = peer("hsh", number, path, NULL, TEXELS);
        check_values(path, wanted, TRUE);
    }
}

/* Pictures that are PTMs: a fit finds them, as far as bytes hold them, and both files say the same.
 */
static void check_written(gboolean lrgb, double tolerance) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = in_folder("written.ptm"), *web = in_folder("written");
    float pictures[LIGHTS * TEXELS * 3];
    struct rti_fit_result fit;
    for (int i = 0; i < LIGHTS * TEXELS * 3; i++) {
        const int l = i / (TEXELS * 3), t = i / 3 % TEXELS, c = i % 3;
        const double u = (double)lights[3 * l], v = (double)lights[3 * l + 1];
        const double bright = 0.5 + 0.02 * t + 0.2 * u - 0.01 * t * v - 0.2 * u * u - 0.1 * u * v;
        pictures[i] = (float)(lrgb ? bright * (1 - 0.25 * c) : bright + 0.1 * c * v);
    }
    pictures[5] = NAN;
    g_autoptr(Rti) rti =
        rti_fit("made", pictures, WIDTH, HEIGHT, lights, LIGHTS, lrgb, &fit, &error);
    g_assert_no_error(error);
    g_assert_cmpfloat(fit.error, <, tolerance);
    g_assert_cmpint(fit.holes, ==, 1);
    g_assert_true(rti_write_ptm(path, rti, &error));
    g_assert_true(ok(rti_write_relight(web, FALSE, rti, lights, LIGHTS, 0.5, ERR)));
    g_autofree double *of_ptm = peer("evaluate", "ptm", path, NULL, TEXELS);
    g_autofree double *of_web = peer("evaluate", "relight", web, NULL, TEXELS);
    for (gsize i = 0; i < G_N_ELEMENTS(pictures); i++) {
        if (isnan(pictures[i]))
            continue;
        g_assert_cmpfloat_with_epsilon(of_ptm[i], (double)pictures[i], 4 * tolerance);
        g_assert_cmpfloat_with_epsilon(of_web[i], of_ptm[i], 1e-5);
    }
    check_values(path, of_ptm, FALSE);

    /* Relight's folder is one that import relight takes. */
    g_autofree char *info = g_build_filename(web, "info.json", NULL);
    g_autofree char *session = in_folder("relight.session");
    const struct import_wish wish = {0};
    struct import_result result;
    ok(import_relight(session, info, &wish, &quietly, &result, ERR));
    g_assert_cmpint(result.n_lights, ==, LIGHTS);
    remove_tree(session);

    /* A folder that is there is left alone. */
    g_assert_false(rti_write_relight(web, FALSE, rti, lights, LIGHTS, 0.5, &error));
    assert_has(error->message, "exists already");
    remove_tree(web);
}

TEST(write) {
    check_written(FALSE, 0.01);
    check_written(TRUE, 0.01);
}

/* Lights on one ring do not tell lx² + ly² from a constant. */
TEST(ring) {
    g_autoptr(GError) error = NULL;
    float ring[8 * 3], pictures[8 * 3] = {0};
    struct rti_fit_result fit;
    for (int i = 0; i < 8; i++) {
        ring[3 * i] = (float)(0.6 * cos(i));
        ring[3 * i + 1] = (float)(0.6 * sin(i));
        ring[3 * i + 2] = 0.8F;
    }
    g_assert_null(rti_fit("made", pictures, 1, 1, ring, 8, TRUE, &fit, &error));
    assert_has(error->message, "one ring");
}

TEST(refused) {
    static const struct {
        const char *text, *words;
    } bad[] = {
        {"", "neither a .ptm"},
        {"PTM_1.2\n", "lacks the format"},
        {"PTM_1.2\nPTM_FORMAT_JPEG_LRGB\n4\n4\n", "PTM_FORMAT_JPEG_LRGB"},
        {"PTM_1.2\nPTM_FORMAT_RGB\n0\n4\n", "the width in the header is 0"},
        {"PTM_1.2\nPTM_FORMAT_RGB\n4\n4\n1 1 1 1 x 1\n", "the scale in the header is x"},
        {"PTM_1.2\nPTM_FORMAT_RGB\n4\n4\n1 1 1 1 1 1\n0 0 0 0 0 0", "ends within the header"},
        {"PTM_1.2\nPTM_FORMAT_RGB\n4\n4\n1 1 1 1 1 1\n0 0 0 0 0 0\nabc", "too few bytes"},
        {"#HSH1.2\n2\n4 4 3\n", "the type in the header is 2"},
        {"#HSH1.2\n3\n4 4 3\n5 2 1\n", "5 terms"},
        {"#HSH1.2\n3\n4 4 3\n9 2 1\nabc", "ends 33 bytes too soon"},
    };
    g_autofree char *path = in_folder("bad");
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_true(g_file_set_contents(path, bad[i].text, -1, NULL));
        g_assert_null(rti_read(path, &error));
        g_assert_nonnull(error);
        assert_has(error->message, path);
        assert_has(error->message, bad[i].words);
    }
}

BEFORE_TESTS {
    folder_make();
    make_lights();
}

AFTER_TESTS {
    folder_remove();
}
