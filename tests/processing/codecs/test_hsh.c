#include "base/data_error.h"
#include "codecs/codec/compare.h"
#include "codecs/codecs.h"
#include "codecs/hsh/hsh.h"
#include "codecs/hsh/hsh_codec.h"
#include "lib/damage.h"

#include "exr/exr.h"
#include "lib/btf_fixture.h"
#include "lib/hsh_formula.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

static const int all_terms[] = {4, 9, 16};

/* Lights on rings up to 80 degrees, in which 16 terms are well determined; three views. */
static struct btf_matrix *new_btf(int width, int height, int rings) {
    struct direction_list views = direction_list_new(3);
    for (gsize i = 1; i < views.n; i++) {
        views.theta_deg[i] = 30;
        views.phi_deg[i] = (float)(90 * i);
    }
    return btf_fixture_of("coin", width, height, views, btf_fixture_rings(rings, 80, 11));
}

/* P_l^m(x) without Condon–Shortley phase, by recursion over l from P_m^m = (2m − 1)!! (1 −
 * x²)^(m/2).
 */
static double legendre(int l, int m, double x) {
    double before = 0, now = 1;
    for (int i = 1; i <= m; i++)
        now *= (2 * i - 1) * sqrt(1 - x * x);
    for (int i = m + 1; i <= l; i++) {
        const double next = ((2 * i - 1) * x * now - (i + m - 1) * before) / (i - m);
        before = now;
        now = next;
    }
    return now;
}

/* H_l^m as Gautron et al. 2004 define it. */
static double gautron(int l, int m, double theta, double phi) {
    const int a = ABS(m);
    double ratio = 1; /* (l − a)! / (l + a)! */
    for (int i = l - a + 1; i <= l + a; i++)
        ratio /= i;
    const double k = sqrt((2 * l + 1) * ratio / (2 * G_PI));
    const double p = k * legendre(l, a, 2 * cos(theta) - 1);
    return m == 0 ? p : sqrt(2) * p * (m > 0 ? cos(a * phi) : sin(a * phi));
}

/* The n-th function in RTIViewer's order and with its signs. */
static double rti_viewer(int n, double theta, double phi) {
    const int l = (int)sqrt(n), m = l * l + l - n;
    return (ABS(m) == 2 ? -1 : 1) * gautron(l, m, theta, phi);
}

static void direction(double theta, double phi, float ret[3]) {
    ret[0] = (float)(sin(theta) * cos(phi));
    ret[1] = (float)(sin(theta) * sin(phi));
    ret[2] = (float)cos(theta);
}

static void light_of(const struct btf_matrix *btf, gsize light, float ret[3]) {
    direction(btf->layout.lights.theta_deg[light] * G_PI / 180,
              btf->layout.lights.phi_deg[light] * G_PI / 180, ret);
}

TEST(basis) {
    GRand *random = g_rand_new_with_seed(4);
    for (int k = 0; k < 1000; k++) {
        const double theta = g_rand_double_range(random, 0, 1.57);
        const double phi = g_rand_double_range(random, -4, 7);
        float light[3], basis[HSH_MAX_TERMS];
        direction(theta, phi, light);
        hsh_basis(light, HSH_MAX_TERMS, basis);
        for (int n = 0; n < HSH_MAX_TERMS; n++)
            g_assert_cmpfloat_with_epsilon(basis[n], rti_viewer(n, theta, phi), 1e-5);
    }
    g_rand_free(random);
    /* RTIViewer's own formulas, at θ = 60°, φ = 30°: cos θ = 1/2, cos θ − cos² θ = 1/4. */
    const double quarter = sqrt(30 / G_PI) / 4, c = sqrt(3) / 2, s = 0.5;
    const double known[9] = {1 / sqrt(2 * G_PI),
                             sqrt(6 / G_PI) * c / 2,
                             0,
                             sqrt(6 / G_PI) * s / 2,
                             -quarter * 0.5 /* cos 2φ */,
                             0,
                             -sqrt(5 / (2 * G_PI)) / 2,
                             0,
                             -quarter * c};
    float light[3], basis[9];
    direction(G_PI / 3, G_PI / 6, light);
    hsh_basis(light, 9, basis);
    for (int n = 0; n < 9; n++)
        g_assert_cmpfloat_with_epsilon(basis[n], known[n], 1e-6);
}

/* ∫ H_i H_j dω = δ_ij, by the midpoint rule in cos θ and φ. */
TEST(orthonormal) {
    const int rows = 400, columns = 24; /* φ: exact for products of degree up to 6 */
    double sums[HSH_MAX_TERMS][HSH_MAX_TERMS] = {{0}};
    for (int k = 0; k < rows * columns; k++) {
        const int row = k / columns;
        const double c = (row + 0.5) / rows;
        float light[3], basis[HSH_MAX_TERMS];
        direction(acos(c), 2 * G_PI * (k % columns) / columns, light);
        hsh_basis(light, HSH_MAX_TERMS, basis);
        for (int i = 0; i < HSH_MAX_TERMS; i++)
            for (int j = 0; j < HSH_MAX_TERMS; j++)
                sums[i][j] += 2 * G_PI / (rows * columns) * basis[i] * basis[j];
    }
    for (int i = 0; i < HSH_MAX_TERMS; i++)
        for (int j = 0; j < HSH_MAX_TERMS; j++)
            g_assert_cmpfloat_with_epsilon(sums[i][j], i == j, 1e-3);
}

/* Neither the pole nor the horizon, nor what lies below it, is anything but finite. */
TEST(limits) {
    static const float lights[][3] = {{0, 0, 1}, {1, 0, 0}, {0, -1, -1e-8F}, {0.6F, 0, -0.8F}};
    for (gsize k = 0; k < G_N_ELEMENTS(lights); k++) {
        float basis[HSH_MAX_TERMS];
        hsh_basis(lights[k], HSH_MAX_TERMS, basis);
        for (int n = 0; n < HSH_MAX_TERMS; n++)
            g_assert_cmpfloat_with_epsilon(basis[n], rti_viewer(n, k == 0 ? 0 : G_PI / 2, 0), 1e-5);
    }
}

/* Coefficients that halves hold exactly: n_views × texels × n_terms × 3. */
static float *random_coefficients(const struct btf_matrix *btf, int n_terms) {
    GRand *random = g_rand_new_with_seed(9);
    const int n = btf->layout.views.n * btf_layout_texels(&btf->layout) * n_terms * 3;
    float *ret = g_new0(float, n);
    for (int i = 0; i < n; i++)
        ret[i] = (float)g_rand_int_range(random, -512, 512) / 512;
    g_rand_free(random);
    return ret;
}

/* What the coefficients mean, in double precision. */
static void fill(struct btf_matrix *btf, const float *coefficients, int n_terms) {
    const int texels = btf_layout_texels(&btf->layout);
    float *to = btf->values;
    for (int texel = 0; texel < texels; texel++)
        for (gsize view = 0; view < btf->layout.views.n; view++)
            for (gsize light = 0; light < btf->layout.lights.n; light++, to += 3)
                for (int c = 0; c < 3; c++) {
                    const float *from = coefficients + (gsize)(view * texels + texel) * n_terms * 3;
                    double sum = 0;
                    for (int n = 0; n < n_terms; n++)
                        sum += from[3 * n + c] *
                               rti_viewer(n, btf->layout.lights.theta_deg[light] * G_PI / 180,
                                          btf->layout.lights.phi_deg[light] * G_PI / 180);
                    to[c] = (float)sum;
                }
}

static struct hsh *compute(const struct btf_matrix *btf, int n_terms) {
    const struct hsh_options options = {.n_terms = n_terms};
    struct hsh *hsh = ok(hsh_compute(btf, &options, ERR));
    return hsh;
}

static void check_coefficients(const struct hsh *hsh, const float *coefficients) {
    for (gint64 i = 0; i < hsh_bytes(hsh) / 2; i++)
        g_assert_cmpfloat_with_epsilon(hsh->values[i], coefficients[i], 1e-5);
}

TEST(own) {
    for (gsize k = 0; k < G_N_ELEMENTS(all_terms); k++) {
        struct btf_matrix *btf = new_btf(7, 5, 4);
        g_autofree float *coefficients = random_coefficients(btf, all_terms[k]);
        fill(btf, coefficients, all_terms[k]);
        struct hsh *hsh = compute(btf, all_terms[k]);
        check_coefficients(hsh, coefficients);
        g_assert_cmpint(hsh_bytes(hsh), ==, 2 * 3 * 35 * 3 * all_terms[k]);
        g_assert_cmpfloat(hsh->exact_error, <, 2e-6);
        g_assert_cmpfloat(hsh->error, <, 2e-6);
        g_assert_cmpfloat(hsh->luminance_error, <, 2e-6);
        g_autofree float *row = g_new(float, btf_layout_values(&btf->layout));
        hsh_reconstruct(hsh, 12, row);
        for (gsize i = 0; i < btf_layout_values(&btf->layout); i++) {
            const int view = i / 3 / btf->layout.lights.n, l = i / 3 % btf->layout.lights.n;
            float light[3], rgb[3];
            light_of(btf, l, light);
            hsh_formula(hsh, view, 12, light, rgb);
            g_assert_cmpfloat_with_epsilon(rgb[i % 3], row[i], 1e-5);
            g_assert_cmpfloat_with_epsilon(
                row[i], btf->values[12 * btf_layout_values(&btf->layout) + i], 1e-4);
        }
        hsh_free(hsh);
        btf_matrix_free(btf);
    }
}

/* A matt surface with a highlight, in which every degree is some part. */
static void fill_glossy(struct btf_matrix *btf) {
    const gsize n_lights = btf->layout.lights.n, pairs = btf->layout.views.n * n_lights;
    for (gsize i = 0; i < btf_layout_texels(&btf->layout) * pairs; i++) {
        float l[3];
        light_of(btf, i % n_lights, l);
        const int texel = (int)(i / pairs);
        const double shine = pow(fmax(0, 0.3 * l[0] + 0.1 * texel * l[1] + 0.9 * l[2]), 20);
        for (int c = 0; c < 3; c++)
            btf->values[3 * i + c] = (float)((0.2 + 0.1 * c) * l[2] + 0.4 * shine);
    }
}

/* More terms hold all that fewer do: residuals fall, strictly. */
TEST(nested) {
    struct btf_matrix *btf = new_btf(2, 2, 5);
    double before = 1;
    fill_glossy(btf);
    for (gsize k = 0; k < G_N_ELEMENTS(all_terms); k++) {
        struct hsh *hsh = compute(btf, all_terms[k]);
        g_test_message("%d terms: %.4f", all_terms[k], hsh->error);
        g_assert_cmpfloat(hsh->exact_error, <, 0.8 * before);
        g_assert_cmpfloat_with_epsilon(hsh->error, hsh->exact_error, 1e-3);
        before = hsh->exact_error;
        hsh_free(hsh);
    }
    btf_matrix_free(btf);
    btf = new_btf(1, 1, 3); /* without a choice it is nine */
    struct hsh *hsh = compute(btf, 0);
    g_assert_cmpint(hsh->n_terms, ==, 9);
    g_assert_cmpfloat(hsh->error, ==, 0); /* all black */
    hsh_free(hsh);
    btf_matrix_free(btf);
}

/* What is left out, in one colour or in all, changes nothing where the rest is enough. */
TEST(holes) {
    struct btf_matrix *btf = new_btf(3, 3, 4);
    g_autofree float *coefficients = random_coefficients(btf, 9);
    fill(btf, coefficients, 9);
    const int row = btf_layout_values(&btf->layout);
    for (int i = 0; i < 9 * row; i += 7)
        btf->values[i] = NAN;
    for (gsize i = 0; i < btf->layout.lights.n * 3; i++)
        btf->values[4 * row + i] = NAN; /* of view 0 texel 4 was never seen */
    memset(coefficients + (gsize)4 * 27, 0, sizeof(float) * 27);
    struct hsh *hsh = compute(btf, 9);
    check_coefficients(hsh, coefficients);
    g_assert_cmpfloat(hsh->error, <, 2e-6);
    hsh_free(hsh);
    btf_matrix_free(btf);
}

/* Seven lights are too few for 16 terms, and so are three of 61 that are not NaN: what there is
 * comes back, and of all such functions it is the smallest: a multiple of one basis row has no
 * smaller one. */
TEST(few) {
    struct btf_matrix *btf = new_btf(1, 1, 1);
    fill_glossy(btf);
    struct hsh *hsh = compute(btf, 16);
    g_assert_cmpfloat(hsh->exact_error, <, 1e-5);
    for (int i = 0; i < 3 * 16 * 3; i++)
        g_assert_cmpfloat(fabsf(hsh->values[i]), <, 1);
    hsh_free(hsh);
    btf_matrix_free(btf);

    btf = new_btf(1, 1, 4);
    for (gsize i = 0; i < btf_layout_values(&btf->layout); i++)
        btf->values[i] = i / 3 % btf->layout.lights.n == 10 ? 0.5F : NAN;
    hsh = compute(btf, 16);
    float light[3], basis[16];
    double norm = 0;
    light_of(btf, 10, light);
    hsh_basis(light, 16, basis);
    for (int n = 0; n < 16; n++)
        norm += basis[n] * basis[n];
    for (int n = 0; n < 16; n++)
        g_assert_cmpfloat_with_epsilon(hsh->values[3 * n], 0.5 * basis[n] / norm, 1e-3);
    hsh_free(hsh);
    btf_matrix_free(btf);
}

TEST(threads) {
    struct btf_matrix *btf = new_btf(9, 7, 3);
    struct hsh *first = NULL;
    fill_glossy(btf);
    btf->values[100] = NAN;
    for (int threads = 1; threads <= 3; threads++) {
        const struct hsh_options options = {.n_terms = 16, .work.n_threads = threads};
        struct hsh *hsh = hsh_compute(btf, &options, NULL);
        const gsize size = sizeof(float) * (gsize)(hsh_bytes(hsh) / 2);
        if (first)
            g_assert_cmpmem(first->values, size, hsh->values, size);
        if (first)
            hsh_free(hsh);
        else
            first = hsh;
    }
    hsh_free(first);
    btf_matrix_free(btf);
}

TEST(refused) {
    static const int bad[] = {-1, 1, 3, 5, 6, 8, 10, 15, 17, 25, G_MAXINT};
    g_autoptr(GError) error = NULL;
    g_autoptr(GCancellable) cancelled = g_cancellable_new();
    struct btf_matrix *btf = new_btf(5, 4, 2);
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        const struct hsh_options options = {.n_terms = bad[i]};
        g_autofree char *number = g_strdup_printf("not %d", bad[i]);
        g_assert_null(hsh_compute(btf, &options, &error));
        g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
        g_assert_nonnull(strstr(error->message, "4, 9 or 16"));
        g_assert_nonnull(strstr(error->message, number));
        g_clear_error(&error);
    }
    const struct hsh_options options = {.work.cancellable = cancelled}, good = {0};
    g_cancellable_cancel(cancelled);
    g_assert_null(hsh_compute(btf, &options, &error));
    g_assert_error(error, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    g_clear_error(&error);
    btf->values[((7 * 3 + 1) * 19 + 10) * 3] = INFINITY; /* texel (2, 1), view 1 */
    g_assert_null(hsh_compute(btf, &good, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "view 1 in the texel of column 2 and row 1"));
    btf_matrix_free(btf);
}

static void write_small(const char *path, int n_terms) {
    struct btf_matrix *btf = new_btf(4, 3, 2);
    fill_glossy(btf);
    struct hsh *hsh = compute(btf, n_terms);
    g_assert_true(ok(hsh_write(path, hsh, ERR)));
    struct hsh *back = ok(hsh_read(path, ERR));
    const gsize size = sizeof(float) * (gsize)(hsh_bytes(hsh) / 2);
    g_assert_cmpint(back->n_terms, ==, n_terms);
    g_assert_cmpint(back->layout.width, ==, 4);
    g_assert_cmpint(back->layout.height, ==, 3);
    g_assert_cmpint(back->layout.views.n, ==, 3);
    g_assert_cmpint(back->layout.lights.n, ==, 19);
    g_assert_cmpmem(back->values, size, hsh->values, size);
    g_assert_true(back->error == hsh->error);
    g_assert_true(back->exact_error == hsh->exact_error);
    g_assert_true(back->luminance_error == hsh->luminance_error);
    g_assert_true(back->layout.texel_mm == 0.5 && back->layout.reference_mm == 5);
    g_assert_cmpstr(back->name, ==, "coin");
    g_assert_cmpfloat(back->layout.views.phi_deg[2], ==, btf->layout.views.phi_deg[2]);
    g_assert_cmpfloat(back->layout.lights.theta_deg[5], ==, btf->layout.lights.theta_deg[5]);
    hsh_free(back);
    hsh_free(hsh);
    btf_matrix_free(btf);
}

static void spoil(struct exr_file *file, int fault) {
    static const char *const parts[] = {"term0", "term3", "term8", "views", "lights"};
    struct exr_part *first = exr_file_part(file, "term0");
    static const struct {
        const char *name;
        int value;
    } numbers[] = {{"mesorig.terms", 16}, {"mesorig.terms", 5},  {"mesorig.views", 2},
                   {"mesorig.height", 2}, {"mesorig.width", 5},  {"mesorig.height", G_MAXINT},
                   {"mesorig.height", 0}, {"mesorig.views", -3}, {"mesorig.height", -3}};
    if (fault < 5)
        g_assert_true(g_ptr_array_remove(file->parts, exr_file_part(file, parts[fault])));
    else if (fault < 14)
        exr_set_int(first, numbers[fault - 5].name, numbers[fault - 5].value);
    else if (fault == 14)
        exr_part_plane(exr_file_part(file, "term2"), "G")[3] = NAN;
    else if (fault == 15)
        exr_set_double(first, "texel_mm", -1);
    else if (fault == 16)
        exr_set_double(first, "mesorig.error", NAN);
    else
        exr_set_string(first, "mesorig.kind", "ptm");
}

TEST(file) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "hsh.exr", NULL);
    for (gsize k = 0; k < G_N_ELEMENTS(all_terms); k++)
        write_small(path, all_terms[k]);
    for (int fault = 0; fault < 18; fault++) {
        write_small(path, 9);
        struct exr_file *file = ok(exr_read(path, ERR));
        spoil(file, fault);
        assert_file_refused(hsh_read, path, file);
    }
    write_small(path, 4);
    assert_cut_refused(hsh_read, path, 211);
}

/* By the table of codecs: encoded with the option as the command line reads it, written, opened as
 * a material, compared with the BTF. */
TEST(codec) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "hsh.exr", NULL);
    g_autoptr(GError) error = NULL;
    const struct codec *codec = codecs_find("hsh");
    const struct work work = {0};
    struct btf_matrix *btf = new_btf(4, 3, 3);
    struct codec_result result = {0};
    fill_glossy(btf);
    g_assert_true(codec == &hsh_codec);
    gpointer options = g_malloc0(codec->options_size);
    g_assert_false(options_set(codec->options, "5", options, &error));
    g_clear_error(&error);
    g_assert_true(options_set(codec->options, "16", options, &error));
    const struct codec_job job = {.btf = btf, .options = options, .work = &work};
    g_assert_true(ok(codec->encode(codec, &job, &result, ERR)));
    g_assert_cmpint(result.components, ==, 16);
    g_assert_cmpuint(result.levels->len, ==, 1);
    g_autofree char *description = codec->describe(codec, &result);
    g_assert_true(g_str_has_prefix(description, "hsh of 16 terms"));
    g_assert_true(codec->write(path, result.levels->pdata, 1, &error));
    struct exr_file *headers = exr_read_headers(path, &error);
    g_autofree char *line = codec->describe_file(headers);
    g_assert_nonnull(strstr(line, "16 terms: 4 × 3 texels, of 3 views × 37 lights"));
    exr_file_free(headers);

    g_autoptr(Material) a = material_borrow("btf", &material_btf_codec, btf);
    g_autoptr(Material) b = material_open(path, NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpstr(material_info(b)->kind, ==, "hsh");
    g_assert_cmpint(material_info(b)->bytes, ==, 12 * 3 * 16 * 3 * 2);
    struct comparison *comparison = ok(compare_materials(a, b, NULL, ERR));
    g_assert_cmpfloat_with_epsilon(comparison->all.error, result.error, 1e-6);
    g_assert_cmpfloat_with_epsilon(comparison->all.luminance_error, result.luminance_error, 1e-6);
    comparison_free(comparison);
    g_ptr_array_unref(result.levels);
    g_free(options);
    btf_matrix_free(btf);
}
