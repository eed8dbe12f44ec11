/* Colour matrices of invented charts, and of a chart in a session of the simulated rig. */
#include "lib/grey_fixture.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "radiometry/colour.h"
#include "targets/chart_session.h"

/* The matrix of linear sRGB (IEC 61966-2-1). Any other matrix would be as good for these tests. */
static const double truth[9] = {0.4124, 0.3576, 0.1805, 0.2126, 0.7152,
                                0.0722, 0.0193, 0.1192, 0.9505};

static void to_xyz(const double rgb[3], double ret[3]) {
    for (int i = 0; i < 3; i++)
        ret[i] = truth[3 * i] * rgb[0] + truth[3 * i + 1] * rgb[1] + truth[3 * i + 2] * rgb[2];
}

/* Published pairs of CIE 1976: lightness of a mid grey, and a whole step of b*. */
TEST(difference) {
    const double white[3] = {0.9505, 1, 1.089}, black[3] = {0};
    const double grey[3] = {0.9505 * 0.18418651851, 0.18418651851, 1.089 * 0.18418651851};
    g_assert_cmpfloat_with_epsilon(colour_difference(white, black, white), 100, 1e-9);
    g_assert_cmpfloat_with_epsilon(colour_difference(grey, black, white), 50, 1e-6);
    const double bluer[3] = {0.9505, 1, 1.089 * pow(1 + 0.05, 3)}; /* b* = 200 (1 − 1.05) */
    g_assert_cmpfloat_with_epsilon(colour_difference(white, bluer, white), 10, 1e-9);
}

/* With errors of 1 % in every reading, the matrix is right within its error bars. */
TEST(matrix) {
    double chi2 = 0;
    g_autoptr(GRand) random = g_rand_new_with_seed(5);
    for (int trial = 0; trial < 40; trial++) {
        struct colour_patch patches[24];
        struct colour_matrix found;
        g_autoptr(GError) error = NULL;
        for (int i = 0; i < 24; i++) {
            double rgb[3];
            for (int k = 0; k < 3; k++)
                rgb[k] = g_rand_double_range(random, 0.05, 0.9);
            to_xyz(rgb, patches[i].xyz);
            for (int k = 0; k < 3; k++) {
                patches[i].rgb[k] = rgb[k];
                patches[i].xyz[k] += 0.005 * pow(patches[i].xyz[1], 2.0 / 3) *
                                     g_rand_double_range(random, -1.7320508, 1.7320508);
            }
        }
        g_assert_true(colour_fit(patches, 24, &found, &error));
        for (int i = 0; i < 9; i++) {
            double off = (found.matrix[i] - truth[i]) / found.error[i];
            chi2 += off * off / (40 * 9);
        }
    }
    g_test_message("chi-square %.2f", chi2);
    g_assert_cmpfloat(chi2, >, 0.7);
    g_assert_cmpfloat(chi2, <, 1.4);
}

/* Pictures that are darker or brighter than the chart's values say: the matrix has another scale,
 * and the patches differ by the same ΔE. */
TEST(scales) {
    static const double of[] = {0.01, 0.1, 0.5, 1, 2, 10, 100};
    double first = 0;
    for (gsize s = 0; s < G_N_ELEMENTS(of); s++) {
        struct colour_patch patches[24];
        struct colour_matrix found;
        g_autoptr(GError) error = NULL;
        g_autoptr(GRand) random = g_rand_new_with_seed(7);
        for (int i = 0; i < 24; i++) {
            double rgb[3];
            for (int k = 0; k < 3; k++)
                rgb[k] = g_rand_double_range(random, 0.05, 0.9);
            to_xyz(rgb, patches[i].xyz);
            for (int k = 0; k < 3; k++) {
                patches[i].rgb[k] = of[s] * rgb[k];
                patches[i].xyz[k] *= 1 + 0.03 * g_rand_double_range(random, -1, 1);
            }
        }
        g_assert_true(ok(colour_fit(patches, 24, &found, ERR)));
        g_test_message("brightness %g: %.3f ΔE", of[s], found.residual);
        first = s == 0 ? found.residual : first;
        g_assert_cmpfloat_with_epsilon(found.residual, first, 1e-6);
        for (int i = 0; i < 9; i++)
            g_assert_cmpfloat(fabs(of[s] * found.matrix[i] - truth[i]), <, 0.05);
        /* Another chart is refused at every brightness. */
        for (int i = 0; i < 24; i++)
            memcpy(patches[i].xyz, patches[(i * 7 + 3) % 24].xyz, sizeof patches[i].xyz);
        g_assert_false(colour_fit(patches, 24, &found, &error));
        g_assert_error(error, COLOUR_ERROR, COLOUR_ERROR_MISFIT);
    }
    g_assert_cmpfloat(first, >, 1);
    g_assert_cmpfloat(first, <, 4);
}

static void refused(const struct colour_patch *patches, int n, enum colour_error code) {
    struct colour_matrix found = {0};
    g_autoptr(GError) error = NULL;
    g_assert_false(colour_fit(patches, n, &found, &error));
    g_assert_error(error, COLOUR_ERROR, (int)code);
    g_assert_false(found.known);
}

TEST(bad_charts) {
    struct colour_patch patches[8];
    for (int i = 0; i < 8; i++) {
        for (int k = 0; k < 3; k++)
            patches[i].rgb[k] = 0.1 + 0.1 * ((i * (k + 3)) % 8);
        to_xyz(patches[i].rgb, patches[i].xyz);
    }
    refused(patches, 5, COLOUR_ERROR_TOO_FEW);
    double kept = patches[2].rgb[1];
    patches[2].rgb[1] = (double)NAN;
    refused(patches, 8, COLOUR_ERROR_MISFIT);
    patches[2].rgb[1] = kept;
    for (int i = 0; i < 8; i++) /* another chart */
        to_xyz(patches[(i * 3 + 1) % 8].rgb, patches[i].xyz);
    refused(patches, 8, COLOUR_ERROR_MISFIT);
    for (int i = 0; i < 8; i++) /* greys only */
        for (int k = 0; k < 3; k++)
            patches[i].rgb[k] = 0.1 * (i + 1);
    refused(patches, 8, COLOUR_ERROR_TOO_FEW);
    static const char *const wrong[] = {"1,2,3,4,5", "1,2,0,1,1,1", "1,2,3,nan,1,1", "x,2,3,1,1,1",
                                        "1,2,3,0.5,0.5,0.5\n1,2,3,0.5,0.5,0.5,7"};
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(chart_parse(wrong[i], "chart.csv", &error));
        g_assert_error(error, COLOUR_ERROR, COLOUR_ERROR_FILE);
        g_assert_nonnull(strstr(error->message, "chart.csv:"));
    }
}

/* As spreadsheets save it. */
TEST(chart) {
    static const char *const forms[] = {"1.5,2,3,0.25,1,0.5\n1,2,3,1,1,1\n",
                                        "1,5;2;3;0,25;1;0,5\r\n1;2;3;1;1;1\r\n",
                                        "1.5\t2\t3\t0,25\t1\t0.5\r1\t2\t3\t1\t1\t1"};
    for (gsize i = 0; i < G_N_ELEMENTS(forms); i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(GArray) fields = chart_parse(forms[i], "chart.csv", &error);
        g_assert_no_error(error);
        g_assert_cmpuint(fields->len, ==, 2);
        const struct chart_field *field = &g_array_index(fields, struct chart_field, 0);
        g_assert_cmpfloat(field->x_mm, ==, 1.5);
        g_assert_cmpfloat(field->xyz[0], ==, 0.25);
        g_assert_cmpfloat(field->xyz[2], ==, 0.5);
    }
}

static const double patch_rgb[][3] = {{0.6, 0.15, 0.1}, {0.15, 0.5, 0.15}, {0.1, 0.15, 0.6},
                                      {0.7, 0.6, 0.1},  {0.5, 0.2, 0.5},   {0.8, 0.8, 0.8}};
#define N_PATCHES ((int)G_N_ELEMENTS(patch_rgb))

/* Colours behind the sensors' filters differ, lamps drift, corners are dark: after radiometry the
 * chart's own matrix comes out. */
TEST(session) {
    g_autofree char *folder = grey_folder();
    g_autofree char *path = g_build_filename(folder, "grey.session", NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(GString) text = g_string_new("# six patches\n\n"), objects = g_string_new(NULL);
    struct tile_result result;
    struct pipeline_options options = {.work.n_threads = 2};
    struct pipeline_result made;
    struct colour_patch patches[N_PATCHES];
    struct colour_matrix found;
    g_string_append(objects,
                    "[sample]\nkind=flat\nwidth_mm=48\nheight_mm=48\nbase_mm=1\nalbedo=0.03\n");
    for (int i = 0; i < N_PATCHES; i++) {
        double x = -15 + 15 * (i % 3), y = i < 3 ? 9 : -9, xyz[3];
        const double *c = patch_rgb[i];
        to_xyz(c, xyz);
        g_string_append_printf(
            objects, "[mark p%d]\nx_mm=%g\ny_mm=%g\nz_mm=4\nradius_mm=7\nalbedo=%g;%g;%g\n", i, x,
            y, c[0], c[1], c[2]);
        g_string_append_printf(text, "%g, %g, 2, %.6f, %.6f, %.6f\n", x, y, xyz[0], xyz[1], xyz[2]);
    }
    grey_calibrate(folder, 1, &result);
    radiometry_rig_write_world(
        folder, "seed=9\nturntable_albedo=0.02\ndrift_pct=3\ndrift_period_s=150", objects->str);
    g_assert_cmpint(radiometry_rig_capture(folder, GREY_CONF, "grey", NULL, NULL, &error), ==,
                    CAPTURE_DONE);
    g_assert_true(pipeline_run(path, &options, &made, &error));
    g_autoptr(Session) opened = session_open(path, SESSION_READ, &error);
    g_autoptr(GArray) fields = chart_parse(text->str, "chart.csv", &error);
    g_assert_no_error(error);
    g_assert_cmpuint(fields->len, ==, N_PATCHES);
    g_assert_true(chart_session(opened, fields, patches, &error));
    g_assert_true(ok(colour_fit(patches, N_PATCHES, &found, ERR)));
    g_test_message("%.2f ΔE", found.residual);
    for (int i = 0; i < 9; i++)
        g_assert_cmpfloat(fabs(found.matrix[i] - truth[i]), <, 0.015);
    g_assert_cmpfloat(found.residual, <, 1);
    g_array_index(fields, struct chart_field, 0).x_mm = 300; /* next to the sample */
    g_assert_false(chart_session(opened, fields, patches, &error));
    g_assert_error(error, COLOUR_ERROR, COLOUR_ERROR_FILE);
    g_clear_pointer(&opened, session_close);
    radiometry_rig_remove(folder);
}

AFTER_TESTS {
    world_fixture_clean();
}
