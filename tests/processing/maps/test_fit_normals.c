/* Normals and heights from PTM and HSH of surfaces that are known by formula, under Lambert's law
 * with an albedo that varies from texel to texel. */
#include "base/robust.h"
#include "codecs/hsh/hsh.h"
#include "codecs/lobes/lobes_levels.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "maps/fit_normals.h"
#include "maps/integrate_normals.h"

#include <glib/gstdio.h>
#include <math.h>

#include "lib/assert_error.h"
#include "lib/btf_fixture.h"
#include "lib/process.h"
#include "lib/session_fixture.h"

#define SIDE     48
#define TEXELS   (SIDE * SIDE)
#define TEXEL_MM 0.25
#define DEG      (180 / G_PI)

static const struct work quietly = {0};

/* Where a texel's middle is, in mm from the middle of the picture, y up. */
static double texel_x(int texel) {
    return (texel % SIDE + 0.5 - SIDE / 2.0) * TEXEL_MM;
}
static double texel_y(int texel) {
    return (SIDE / 2.0 - 0.5 - texel / SIDE) * TEXEL_MM;
}

typedef void (*Shape)(double x, double y, double *ret_z, double ret_normal[3]);

static void normal_of_slopes(double p, double q, double ret[3]) {
    const double length = sqrt(1 + p * p + q * q);
    ret[0] = -p / length;
    ret[1] = -q / length;
    ret[2] = 1 / length;
}

/* A cap of 60°, with flat ground around it. */
static void sphere(double x, double y, double *ret_z, double ret_normal[3]) {
    const double radius = 6.5, r2 = x * x + y * y, edge = radius * sin(60 / DEG);
    const double z = sqrt(MAX(radius * radius - r2, 0));
    const gboolean on = r2 < edge * edge;
    *ret_z = on ? z : radius * cos(60 / DEG);
    normal_of_slopes(on ? -x / z : 0, on ? -y / z : 0, ret_normal);
}

static void bumps(double x, double y, double *ret_z, double ret_normal[3]) {
    *ret_z = 0.5 * sin(1.1 * x + 0.3) * cos(0.8 * y) + 0.1 * x;
    normal_of_slopes(0.55 * cos(1.1 * x + 0.3) * cos(0.8 * y) + 0.1,
                     -0.4 * sin(1.1 * x + 0.3) * sin(0.8 * y), ret_normal);
}

/* What a light does to a texel next to Lambert's law. */
enum trouble { NONE, SHADOW, SHINE };

static struct btf_matrix *new_btf(Shape shape, enum trouble trouble) {
    struct btf_matrix *btf =
        btf_fixture_of("shape", SIDE, SIDE, direction_list_new(1), btf_fixture_rings(4, 72, 11));
    const gsize n = btf->layout.lights.n;
    g_autofree float *lights = direction_list_vectors(&btf->layout.lights);
    btf->layout.texel_mm = TEXEL_MM;
    for (int t = 0; t < TEXELS; t++) {
        double z, normal[3];
        shape(texel_x(t), texel_y(t), &z, normal);
        const double albedo = 0.3 + 0.2 * sin(0.9 * t);
        for (gsize l = 0; l < n; l++) {
            const float *d = lights + 3 * l;
            double y = 0;
            for (int i = 0; i < 3; i++)
                y += normal[i] * (double)d[i];
            /* A wall in the west; or a coat that shines where light comes from the north east. */
            if (trouble == SHADOW && d[0] < -0.75F)
                y = 0;
            if (trouble == SHINE)
                y += 1.5 * pow(MAX(0, (d[0] + d[1]) * 0.5 + d[2] * G_SQRT2 / 2), 40);
            for (int c = 0; c < 3; c++)
                btf->values[((gsize)t * n + l) * 3 + (gsize)c] =
                    (float)(albedo * (1 - 0.2 * c) * MAX(y, 0));
        }
    }
    return btf;
}

/* terms 0: a PTM. */
static char *write_model(const struct btf_matrix *btf, int terms) {
    g_autoptr(GError) error = NULL;
    char *path = g_build_filename(session_fixture_folder, terms ? "hsh.exr" : "ptm.exr", NULL);
    if (terms) {
        struct hsh *hsh = ok(hsh_compute(btf, &(struct hsh_options){.n_terms = terms}, ERR));
        g_assert_true(hsh_write(path, hsh, &error));
        hsh_free(hsh);
    } else {
        struct lobes *lobes =
            ok(lobes_compute(btf, &(struct lobes_options){.model = LOBES_PTM}, ERR));
        g_assert_true(lobes_write_levels(path, &lobes, 1, &error));
        lobes_free(lobes);
    }
    return path;
}

struct errors {
    double median_deg, worst_deg;
    struct fit_normals_result result;
};

static struct errors errors_of(Shape shape, enum trouble trouble, int terms,
                               enum fit_normals_method method) {
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = new_btf(shape, trouble);
    g_autofree char *model = write_model(btf, terms);
    g_autofree char *file = g_build_filename(session_fixture_folder, "normals.exr", NULL);
    struct errors ret = {0};
    double off[TEXELS];
    int n = 0;
    ok(fit_normals(model, file, FALSE, method, &quietly, &ret.result, ERR));
    g_autoptr(ExrPart) part = exr_read_part(file, "normals", &error);
    g_assert_no_error(error);
    for (int t = 0; t < TEXELS; t++) {
        double z, normal[3], cosine = 0, length = 0;
        shape(texel_x(t), texel_y(t), &z, normal);
        for (int i = 0; i < 3; i++) {
            cosine += normal[i] * (double)part->planes[i][t];
            length += (double)part->planes[i][t] * (double)part->planes[i][t];
        }
        if (length <= 0)
            continue;
        g_assert_cmpfloat_with_epsilon(length, 1, 1e-5);
        off[n++] = acos(MIN(cosine, 1)) * DEG;
    }
    qsort(off, (gsize)n, sizeof *off, robust_by_value);
    g_assert_cmpint(n, ==, TEXELS - ret.result.holes);
    g_assert_cmpint(ret.result.texels, ==, TEXELS);
    ret.median_deg = off[n / 2];
    ret.worst_deg = off[n - 1];
    g_test_message(
        "%s %d terms, trouble %d, method %d: median %.2f deg, worst %.2f deg, %d holes, %d "
        "clipped, %d shadowed",
        ret.result.model, terms, trouble, method, ret.median_deg, ret.worst_deg, ret.result.holes,
        ret.result.clipped, ret.result.shadowed);
    return ret;
}

TEST(normals) {
    static const int terms[] = {0, 4, 9, 16};
    static const double most_deg[] = {0.6, 1.3, 0.4, 0.4}; /* four terms hold little of a bump */
    static const Shape shapes[] = {sphere, bumps};
    for (gsize s = 0; s < G_N_ELEMENTS(shapes); s++)
        for (gsize k = 0; k < G_N_ELEMENTS(terms); k++) {
            const struct errors e = errors_of(shapes[s], NONE, terms[k], FIT_NORMALS_LAMBERT);
            g_assert_cmpfloat(e.median_deg, <, most_deg[k]);
            g_assert_cmpint(e.result.holes, ==, 0);
        }
}

/* The polynomial's maximum lies 4° to 8° off, and beyond about 45° outside of the disc. */
TEST(maximum) {
    const struct errors e = errors_of(sphere, NONE, 0, FIT_NORMALS_MAXIMUM);
    g_assert_cmpfloat(e.median_deg, <, 9);
    g_assert_cmpint(e.result.clipped, >, TEXELS / 10);
    g_assert_cmpint(e.result.holes, ==, e.result.clipped);
    const struct errors flat = errors_of(bumps, NONE, 0, FIT_NORMALS_MAXIMUM);
    g_assert_cmpfloat(flat.median_deg, <, 9);
    g_assert_cmpint(flat.result.clipped, ==, 0);
}

/* Lights that are left out: 16 terms tell them from the others, a PTM smears them over all. */
TEST(trouble) {
    const struct errors shadow = errors_of(bumps, SHADOW, 16, FIT_NORMALS_LAMBERT);
    const struct errors shine = errors_of(bumps, SHINE, 16, FIT_NORMALS_LAMBERT);
    g_assert_cmpfloat(shadow.median_deg, <, 1.5);
    g_assert_cmpfloat(shine.median_deg, <, 1);
    g_assert_cmpint(shadow.result.shadowed, >, TEXELS / 10);
    const struct errors smeared = errors_of(bumps, SHADOW, 0, FIT_NORMALS_LAMBERT);
    g_assert_cmpfloat(smeared.median_deg, <, 9);
    g_assert_cmpint(smeared.result.shadowed, >, TEXELS / 2);
}

/* Root mean square of what the heights are off, both with mean 0, in mm. */
static double height_error(const float *z, Shape shape, int *ret_holes) {
    double mean = 0, mean_true = 0, squares = 0;
    int n = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int t = 0; t < TEXELS; t++) {
            double truth, normal[3];
            shape(texel_x(t), texel_y(t), &truth, normal);
            if (!isfinite(z[t]))
                continue;
            if (pass == 0) {
                mean += (double)z[t];
                mean_true += truth;
                n++;
            } else {
                squares += pow((double)z[t] - mean / n - truth + mean_true / n, 2);
            }
        }
    *ret_holes = TEXELS - n;
    return sqrt(squares / n);
}

/* Exact slopes, all of them and with a hole, which heights do not lean on. */
TEST(integrate) {
    for (int hole = 0; hole < 2; hole++) {
        float p[TEXELS], q[TEXELS], z[TEXELS];
        int holes;
        for (int t = 0; t < TEXELS; t++) {
            double truth, normal[3];
            const gboolean in = hole && hypot(texel_x(t) - 1, texel_y(t) + 1) < 2;
            bumps(texel_x(t), texel_y(t), &truth, normal);
            p[t] = in ? NAN : (float)(-normal[0] / normal[2]);
            q[t] = in ? NAN : (float)(-normal[1] / normal[2]);
        }
        integrate_normals(p, q, SIDE, SIDE, TEXEL_MM, z);
        const double error = height_error(z, bumps, &holes);
        g_test_message("%d holes: heights are %.5f mm off", holes, error);
        g_assert_cmpfloat(error, <, 0.005);
        g_assert_true(hole ? holes > 100 : holes == 0);
    }
}

TEST(height) {
    for (int terms = 0; terms <= 9; terms += 9) {
        g_autoptr(GError) error = NULL;
        g_autoptr(BtfMatrix) btf = new_btf(bumps, NONE);
        g_autofree char *model = write_model(btf, terms);
        g_autofree char *file = g_build_filename(session_fixture_folder, "height.exr", NULL);
        struct fit_normals_result result;
        int holes;
        ok(fit_normals(model, file, TRUE, FIT_NORMALS_LAMBERT, &quietly, &result, ERR));
        g_autoptr(ExrPart) part = exr_read_part(file, "height", &error);
        g_assert_no_error(error);
        const double off = height_error(exr_part_plane(part, "Z"), bumps, &holes);
        g_test_message("%s: heights of 1.3 mm from top to bottom are %.4f mm off", result.model,
                       off);
        g_assert_cmpfloat(off, <, 0.02);
        for (int t = 0; t < TEXELS; t++)
            g_assert_cmpfloat((double)exr_part_plane(part, "N")[t], ==, 1);
    }
}

TEST(bad) {
    g_autoptr(GError) error = NULL;
    g_autoptr(BtfMatrix) btf = btf_fixture_new("black", 4, 3, 1, 12);
    g_autofree char *file = g_build_filename(session_fixture_folder, "bad.exr", NULL);
    g_autofree char *model = write_model(btf, 0), *hsh = write_model(btf, 4);
    struct fit_normals_result result;
    g_assert_true(fit_normals_applies(model));
    g_assert_false(fit_normals_applies(session_fixture_folder));
    g_assert_false(fit_normals(model, file, FALSE, FIT_NORMALS_LAMBERT, &quietly, &result, &error));
    assert_has(error->message, "ptm.exr: no texel of the ptm has a normal");
    g_clear_error(&error);
    g_assert_false(fit_normals(hsh, file, FALSE, FIT_NORMALS_MAXIMUM, &quietly, &result, &error));
    assert_has(error->message, "hsh.exr: an hsh has no polynomial");
    g_clear_error(&error);
    g_assert_false(g_file_test(file, G_FILE_TEST_EXISTS));
    g_autoptr(ExrFile) other = exr_file_new();
    exr_file_add(other, exr_part_new("a", 1, 1, (const char *const[]){"Y", NULL}, EXR_HALF));
    g_assert_true(exr_write(model, other, EXR_NONE, FALSE, NULL));
    g_assert_false(fit_normals(model, file, FALSE, FIT_NORMALS_LAMBERT, &quietly, &result, &error));
    assert_has(error->message,
               "ptm.exr: the file is of kind none, but normals need a ptm or an hsh");
}

/* Through the program: of a model's file, and with what is said. */
TEST(command) {
    g_autoptr(BtfMatrix) btf = new_btf(sphere, NONE);
    g_autofree char *model = write_model(btf, 0);
    g_autofree char *file = g_build_filename(session_fixture_folder, "out.exr", NULL);
    g_autofree char *all = process_mesorig(0, "export normals %s -o %s --json", model, file);
    assert_has(all, "\"model\": \"ptm\"");
    assert_has(all, "\"holes\": 0");
    g_autofree char *clipped =
        process_mesorig(0, "export normals %s -o %s --maximum --force", model, file);
    assert_has(clipped, "clipped");
    g_free(process_mesorig(0, "export height %s -o %s --force", model, file));
    g_autofree char *points = g_build_filename(session_fixture_folder, "out.ply", NULL);
    g_autofree char *none = process_mesorig(1, "export points %s -o %s", model, points);
    assert_has(none, model);
    /* Another format than the name says is not written. */
    g_autofree char *png = g_build_filename(session_fixture_folder, "out.png", NULL);
    static const char *const kinds[] = {"height", "normals", "points", "btf"};
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        g_autofree char *refused = process_mesorig(1, "export %s %s -o %s", kinds[i], model, png);
        assert_has(refused, "give a name that ends in .");
        g_assert_false(g_file_test(png, G_FILE_TEST_EXISTS));
    }
}

TESTS_RUN_BY(session_fixture_run);
