/* Laser positions whose lines are not where the session says, and surfaces that no camera saw. */
#include "base/data_error.h"
#include "lib/ok.h"
#include "lib/pipeline_fixture.h"

#include "frames/laser_lines.h"

#include <glib/gstdio.h>
#include <string.h>

/* The first laser position's sheet was 0.2° further on than it was told. */
static void slip(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind != SHOT_SWEEP || shot->source != 0)
        return;
    for (int i = 0; i < SIDE * SIDE; i++)
        part->planes[1][i] -= (float)(0.2 / (to_deg - from_deg) * (N_STEPS - 1));
}

/* It is told where a laser is said to be known. */
static void check_against_calibration(const struct fixture *fixture) {
    const struct rig rig = fixture_make_rig();
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    calibration->lasers[0].known = TRUE;
    calibration->lasers[0].normal_rad = calibration->lasers[0].axis_rad = 1e-4;
    g_autofree char *text = calibration_to_text(calibration);
    const struct pipeline_options options = {.n_eigenmaps = 2, .calibration = text};
    struct pipeline_result result;
    ok(pipeline_run(fixture->path, &options, &result, ERR));
    g_assert_cmpint(result.lines_disagree, ==, N_VIEWS);
    g_assert_cmpint(result.line_worst_position, ==, 0);
    fixture_check_mdf(fixture);
}

/* What lies around the sample is as high as its surface: the lines there tell of the slip, again
 * when nothing is made again, and the surface is where it is. Without it nobody can tell. */
static void test_slipped(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, slip);
    struct pipeline_result result = fixture_process(fixture, 1, FALSE);
    g_assert_cmpint(result.line_sweeps, ==, N_VIEWS * N_LASERS);
    g_assert_cmpint(result.lines_found, ==, 0);
    g_assert_cmpint(result.line_worst_position, ==, -1);
    fixture_set_value(fixture, LASER_REFERENCE_KEY, "2.2;0.01;28;28;30");
    for (int i = 0; i < 2; i++) {
        result = fixture_process(fixture, 1, FALSE);
        g_assert_cmpint(result.lines_found, ==, N_VIEWS * N_LASERS);
        g_assert_cmpint(result.line_worst_position, ==, 0);
        g_assert_cmpfloat_with_epsilon(result.lines_worst_deg, 0.2, 0.002);
        g_assert_cmpfloat_with_epsilon(result.lines_rms_deg, 0.2 / sqrt(N_LASERS), 0.002);
    }
    g_assert_cmpint(result.lines_disagree, ==, 0); /* with a calibration that knows nothing */
    fixture_check_mdf(fixture);
    check_against_calibration(fixture);
    fixture_set_value(fixture, LASER_REFERENCE_KEY, "2.2;0.01;28;28");
    fixture_process_fails(fixture, DATA_ERROR_INVALID, "2.2;0.01;28;28");
}

/* Frames of a sweep, as it is said to have been seen, next to the sweep's file. */
static void write_frames(const char *folder, const char *name) {
    static const char *const channels[] = {"Y", NULL};
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autoptr(ExrPart) sweep = exr_read_part(path, "sweep", &error);
    g_assert_no_error(error);
    path[strlen(path) - strlen(".exr")] = 0;
    g_assert_cmpint(g_mkdir(path, 0777), ==, 0);
    const float *peak = exr_part_plane(sweep, "peak");
    for (int k = 0; k < N_STEPS; k++) {
        g_autofree char *to = g_strdup_printf("%s/%04d.exr", path, k);
        struct exr_file *file = exr_file_new();
        struct exr_part *part = exr_part_new("frame", SIDE, SIDE, channels, EXR_HALF);
        for (int i = 0; i < SIDE * SIDE; i++)
            part->planes[0][i] = roundf(64 + 800 * expf(-powf((float)k - peak[i], 2) / 4.5F));
        exr_file_add(file, part);
        ok(exr_write(to, file, EXR_NONE, FALSE, ERR));
        exr_file_free(file);
    }
}

/* The published way finds the slip in the frames, if there are any, and is not confused with the
 * other. */
static void test_in_pictures(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL, none = NULL;
    const struct pipeline_options options = {.n_eigenmaps = 1, .lines_in_pictures = TRUE};
    struct pipeline_result result;
    fixture_capture(fixture, 0, fixture->n_shots, slip);
    fixture_set_value(fixture, LASER_REFERENCE_KEY, "2.2;0.01;28;28;30");
    g_assert_false(pipeline_run(fixture->path, &options, &result, &none));
    g_assert_nonnull(strstr(none->message, "keep_laser_frames"));
    g_autofree char *folder = g_build_filename(fixture->path, "laser", NULL);
    g_autoptr(GDir) dir = g_dir_open(folder, 0, &error);
    g_assert_no_error(error);
    g_autoptr(GPtrArray) names = g_ptr_array_new_with_free_func(g_free);
    for (const char *name; (name = g_dir_read_name(dir));)
        if (g_str_has_suffix(name, ".exr"))
            g_ptr_array_add(names, g_strdup(name));
    for (guint i = 0; i < names->len; i++)
        write_frames(folder, names->pdata[i]);
    ok(pipeline_run(fixture->path, &options, &result, ERR));
    g_test_message("worst %.4f°, RMS %.4f°", result.lines_worst_deg, result.lines_rms_deg);
    g_assert_cmpint(result.lines_found, ==, N_VIEWS * N_LASERS);
    g_assert_cmpint(result.line_worst_position, ==, 0);
    g_assert_cmpfloat_with_epsilon(result.lines_worst_deg, 0.2, 0.02);
    result = fixture_process(fixture, 1, FALSE);
    g_assert_cmpfloat_with_epsilon(result.lines_worst_deg, 0.2, 0.002);
}

/* No camera saw a line in the middle of its pictures, with the turntable as it was first. */
static void blind(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind != SHOT_SWEEP || shot->pose != 0)
        return;
    for (int i = 0; i < SIDE * SIDE; i++)
        if (abs(i % SIDE - SIDE / 2) < 12 && abs(i / SIDE - SIDE / 2) < 12)
            part->planes[1][i] = -1;
}

/* Others fill in what they see, it is said where, and it does not count as measured. */
static void test_predicted(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, blind);
    const struct pipeline_result result = fixture_process(fixture, 1, FALSE),
                                 again = fixture_process(fixture, 1, FALSE);
    g_autofree char *path = fixture_product(fixture, "mdf.exr");
    g_autoptr(GError) error = NULL;
    g_autoptr(ExrFile) file = exr_read(path, &error);
    g_assert_no_error(error);
    int predicted = 0, measured = 0;
    for (guint v = 0; v < file->parts->len; v++) {
        const struct exr_part *part = file->parts->pdata[v];
        const float *d = exr_part_plane(part, "D"), *m = exr_part_plane(part, "M"),
                    *p = exr_part_plane(part, "P"), *n = exr_part_plane(part, "N");
        for (int i = 0; i < TEXELS * TEXELS; i++) {
            predicted += p[i] == 3;
            measured += p[i] == 1;
            g_assert_true(p[i] != 3 || (m[i] == -1 && n[i] == 0 && d[i] >= 0));
            g_assert_true(p[i] != 1 || d[i] == m[i]);
            g_assert_true(p[i] != 0 || d[i] == -1);
        }
    }
    g_assert_cmpint(predicted, >=, 4);
    g_assert_cmpfloat(result.mdf_coverage, ==, measured / (double)(N_VIEWS * TEXELS * TEXELS));
    g_assert_cmpfloat(result.mdf_predicted, ==, predicted / (double)(N_VIEWS * TEXELS * TEXELS));
    g_assert_cmpfloat(again.mdf_predicted, ==, result.mdf_predicted);
    fixture_check_mdf_where_known(fixture, FALSE);
}

int main(int argc, char **argv) {
    static const struct pipeline_test tests[] = {
        {"/pipeline/slipped", test_slipped},
        {"/pipeline/in-pictures", test_in_pictures},
        {"/pipeline/predicted", test_predicted},
    };
    return fixture_run_tests(argc, argv, tests, G_N_ELEMENTS(tests));
}
