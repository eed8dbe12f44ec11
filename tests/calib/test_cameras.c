/*
 * Cameras and turntable are calibrated from simulated pictures of a board, and compared with the
 * truth of the simulated world. Input that would give a wrong calibration must be refused.
 */
#include "lib/calibration_fixture.h"

#include <gio/gio.h>

#include "base/residual.h"
#include "cameras/board_find.h"
#include "lib/ok.h"
#include "lib/test.h"

#define N_STOPS 8

static struct fixture f; /* lay 0 flat, lay 1 leaning; three cameras, the last at 75° */

static struct cameras_task whole_task(void) {
    return (struct cameras_task){f.board, f.pictures, f.n_pictures, boards_read, NULL, &f};
}

/* The calibration from all pictures, which is made once. */
static const struct cameras_result *whole_result(const struct calibration **ret_calibration) {
    static struct calibration *calibration;
    static struct cameras_result *result;
    if (!result) {
        const struct cameras_task task = whole_task();
        calibration = calibration_new(&f.nominal);
        result = ok(cameras_calibrate(calibration, &task, ERR));
    }
    *ret_calibration = calibration;
    return result;
}

TEST(truth) {
    g_autoptr(GError) error = NULL;
    const struct calibration *calibration;
    const struct cameras_result *result = whole_result(&calibration);

    const struct fixture_errors e = boards_compare(&f, calibration);
    g_test_message(
        "points %.4f px, direction %.4f°, distance %.3f %%, axis %.4f mm %.4f°, chi2 %.2f",
        e.point_px, e.direction_deg, e.distance_pct, e.axis_mm, e.axis_deg, e.chi2);
    /* Fewer pictures than anybody would take: what a whole calibration reaches is measured. */
    g_test_message("%.4f px RMS, %.4f px expected; between the angles %.4f px", result->rms_px,
                   result->expected_px, boards_turned_px(&f, calibration));
    g_assert_cmpfloat(result->wobble_rad, ==, 0); /* a perfect bearing */
    g_assert_cmpfloat(result->rms_px, <, RESIDUAL_LIMIT * result->expected_px);
    g_assert_cmpfloat(result->rms_px, >, result->expected_px / RESIDUAL_LIMIT);
    g_assert_cmpfloat(result->rms_px, <, 0.15);
    g_assert_cmpfloat(e.point_px, <, 0.05);
    g_assert_cmpfloat(e.direction_deg, <, 0.08);
    g_assert_cmpfloat(e.distance_pct, <, 1);
    g_assert_cmpfloat(e.axis_mm, <, 0.02);
    g_assert_cmpfloat(e.axis_deg, <, 0.04);
    g_assert_cmpfloat(e.chi2, <, 3);
    g_assert_cmpfloat(e.chi2, >, 0.2);
    const struct calibration_part *part = &calibration->parts[CALIBRATION_CAMERAS];
    g_assert_true(part->done);
    g_assert_cmpint(part->pictures + (int)part->rejected->len, ==, f.n_pictures);
    g_assert_cmpint(strlen(part->checksum), ==, 64);
    /* The camera at 75° has no picture in which OpenCV alone would find the board flat, yet it has
     * corners of all of them. */
    g_assert_cmpint(calibration->cameras[2].points, >, 150);
    /* It can be written and read. */
    g_autofree char *text = calibration_to_text(calibration);
    g_autoptr(Calibration) back = calibration_from_text(text, "x", &error);
    g_assert_no_error(error);
    g_assert_cmpmem(back->cameras, sizeof back->cameras, calibration->cameras,
                    sizeof calibration->cameras);
    for (guint i = 0; i < result->stops->len; i++) {
        const struct cameras_stop *s = &g_array_index(result->stops, struct cameras_stop, i);
        const double truth = boards_true_deg(&f, s->commanded_deg) - s->commanded_deg;
        g_assert_cmpfloat_with_epsilon(s->error_deg, truth, 0.03);
    }
}

static void assert_refused(const struct cameras_task *task, const char *reason) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibration_new(&f.nominal);
    g_autofree char *before = calibration_to_text(calibration);
    g_autoptr(CamerasResult) result = cameras_calibrate(calibration, task, &error);

    g_assert_null(result);
    g_assert_nonnull(error);
    g_test_message("%s", error->message);
    if (!strstr(error->message, reason))
        g_error("“%s” does not say “%s”", error->message, reason);
    g_autofree char *after = calibration_to_text(calibration);
    g_assert_cmpstr(before, ==, after);
}

TEST(never_flat) {
    g_autofree struct cameras_picture *leaning =
        g_memdup2(f.pictures + f.n_pictures / 2, sizeof *leaning * (gsize)f.n_pictures / 2);
    struct fixture half = f;
    half.taken += f.n_pictures / 2;
    for (int i = 0; i < f.n_pictures / 2; i++)
        leaning[i].lay = 0;
    const struct cameras_task task = {f.board, leaning, f.n_pictures / 2, boards_read, NULL, &half};
    assert_refused(&task, "never lies flat");
}

static struct picture *read_scaled(int i, gpointer data, GError **error) {
    return picture_new(f.taken[i]->name, "", 88, 80);
}

static struct picture *read_empty(int i, gpointer data, GError **error) {
    struct picture *picture = picture_new(f.taken[i]->name, "", 176, 160);
    GRand *rand = g_rand_new_with_seed((guint32)i);
    for (int k = 0; k < 176 * 160; k++)
        picture->values[k] = (float)g_rand_double_range(rand, 90, 110);
    g_rand_free(rand);
    return picture;
}

TEST(empty) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Picture) picture = read_empty(0, NULL, NULL);
    g_assert_null(board_find(picture, &f.board, FALSE, &error));
    g_assert_cmpstr(
        error->message, ==,
        "no board is visible: no marker of the dictionary 4x4_50 was found; if the picture "
        "shows the board, correct dictionary= in --board, or take a sharper, brighter "
        "picture");
}

TEST(mirrored) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Picture) picture = boards_copy(f.taken[0]);
    for (int y = 0; y < picture->height; y++)
        for (int x = 0; x < picture->width; x++)
            picture->values[y * picture->width + x] =
                f.taken[0]->values[y * picture->width + picture->width - 1 - x];
    g_assert_null(board_find(picture, &f.board, FALSE, &error));
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, "mirrored"));
}

static struct picture *read_broken(int i, gpointer data, GError **error) {
    if (i != 5)
        return boards_copy(f.taken[i]);
    g_set_error_literal(error, G_IO_ERROR, G_IO_ERROR_FAILED, "the disk has gone");
    return NULL;
}

static const struct refusal {
    const char *path, *reason;
    const char *board; /* NULL: that of the pictures */
    CamerasRead read;
    int n_pictures; /* 0: all */
} refusals[] = {
    {"/cameras/all parallel", "the board is never tilted by more than", NULL, boards_read,
     3 * N_STOPS},
    {"/cameras/too few angles", "axis cannot be found from 2 angle(s)", NULL, boards_read, 2 * 3},
    {"/cameras/square size", "mm instead of 12.6 mm", "7x7,square=12.6,marker=9.45,thickness=3",
     boards_read, 0},
    {"/cameras/upside down", "looks the same upside down", "8x8,square=10.5", boards_read, 0},
    {"/cameras/other size", "has 88 × 80 pixels, but camera cam", NULL, read_scaled, 0},
    {"/cameras/no board", "the board was found in 0 of 9 pictures", NULL, read_empty, 3 * 3},
    {"/cameras/read error", "the disk has gone", NULL, read_broken, 0},
};

static void test_refused(gconstpointer data) {
    const struct refusal *refusal = data;
    struct cameras_task task = whole_task();
    task.read = refusal->read;
    if (refusal->n_pictures > 0)
        task.n_pictures = refusal->n_pictures;
    if (refusal->board)
        g_assert_true(board_parse(&task.board, refusal->board, NULL));
    assert_refused(&task, refusal->reason);
}

/* What is noted of the pictures is wrong: the error names the mistake, with the figures of the fit.
 * Half of the stops show it. */
static const struct noted {
    const char *path, *reason;
    double turntable; /* factor of the angles */
    int cameras[3];
} noted[] = {
    {"/cameras/noted/reversed", "the turntable turns the wrong way", -1, {0, 1, 2}},
    {"/cameras/noted/radians", "angles seem to be in radians", G_PI / 180, {0, 1, 2}},
    {"/cameras/noted/exchanged", "of camera cam1: the two cameras are exchanged", 1, {1, 0, 2}},
    {"/cameras/noted/order", "mm from the place of camera cam", 1, {1, 2, 0}},
    /* No single mistake explains these: none is named. */
    {"/cameras/noted/half the angles", "nor exchanged cameras explain this", 0.5, {0, 1, 2}},
};

static void test_noted(gconstpointer data) {
    const struct noted *wrong = data;
    g_autofree struct cameras_picture *pictures = g_new(struct cameras_picture, f.n_pictures);
    g_autofree struct picture **taken = g_new(struct picture *, f.n_pictures);
    struct fixture half = f;
    struct cameras_task task = {f.board, pictures, 0, boards_read, NULL, &half};
    half.taken = taken;
    for (int i = 0; i < f.n_pictures; i++) {
        if (i / f.options.n_cameras % 2)
            continue;
        pictures[task.n_pictures] = f.pictures[i];
        pictures[task.n_pictures].camera = wrong->cameras[f.pictures[i].camera];
        pictures[task.n_pictures].turntable_deg *= wrong->turntable;
        taken[task.n_pictures++] = f.taken[i];
    }
    assert_refused(&task, wrong->reason);
}

/* One picture with the turntable elsewhere, one with half of it black, one of not-a-numbers. */
static struct picture *read_spoilt(int i, gpointer data, GError **error) {
    struct picture *picture = boards_copy(f.taken[i == 0 ? 3 : i]);
    const int n = picture->width * picture->height;
    for (int k = 0; i == 4 && k < n / 2; k++)
        picture->values[k] = 0;
    for (int k = 0; i == 7 && k < n; k++)
        picture->values[k] = NAN;
    return picture;
}

TEST(spoilt_pictures) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibration_new(&f.nominal);
    struct cameras_task task = whole_task();
    task.read = read_spoilt;
    g_autoptr(CamerasResult) result = cameras_calibrate(calibration, &task, &error);

    g_assert_no_error(error);
    const struct fixture_errors e = boards_compare(&f, calibration);
    const GPtrArray *rejected = calibration->parts[CALIBRATION_CAMERAS].rejected;
    g_assert_cmpfloat(e.point_px, <, 0.05);
    int told = 0;
    for (guint i = 0; i < rejected->len; i++) {
        g_test_message("%s", (char *)rejected->pdata[i]);
        told += g_str_has_prefix(rejected->pdata[i], f.taken[3]->name) ||
                g_str_has_prefix(rejected->pdata[i], f.taken[7]->name);
    }
    g_assert_cmpint(told, >=, 2);
}

/* Cameras that shake from picture to picture: each picture is shifted by a few tenths of a pixel,
 * by linear interpolation. */
static struct picture *read_shaken(int i, gpointer data, GError **error) {
    struct picture *picture = boards_copy(f.taken[i]);
    GRand *rand = g_rand_new_with_seed((guint32)(900 + i));
    const double across = g_rand_double_range(rand, -0.45, 0.45), dx = across - floor(across);
    const double down = g_rand_double_range(rand, -0.45, 0.45), dy = down - floor(down);
    const int width = picture->width;
    const float *from = f.taken[i]->values + (int)floor(down) * width + (int)floor(across);
    for (int y = 1; y + 1 < picture->height; y++)
        for (int x = 1; x + 1 < width; x++) {
            const float *p = from + y * width + x;
            picture->values[y * width + x] =
                (float)((1 - dy) * ((1 - dx) * (double)p[0] + dx * (double)p[1]) +
                        dy * ((1 - dx) * (double)p[width] + dx * (double)p[width + 1]));
        }
    g_rand_free(rand);
    return picture;
}

/* What no parameter describes is in the residual, which speaks, and in the cameras' covariances; it
 * is not taken for a wobble. */
TEST(shaken) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibration_new(&f.nominal);
    struct cameras_task task = whole_task();
    task.read = read_shaken;
    g_autoptr(CamerasResult) result = cameras_calibrate(calibration, &task, &error);
    g_assert_no_error(error);
    const struct fixture_errors e = boards_compare(&f, calibration);
    const struct residual residual = {"the board", result->rms_px, result->expected_px, "px",
                                      "shaking"};
    g_autofree char *warning = residual_warning(&residual);
    g_test_message("%s; wobble %.4f°, chi2 %.2f", warning ? warning : "no warning",
                   FIXTURE_DEG(result->wobble_rad), e.chi2);
    g_assert_nonnull(warning);
    g_assert_cmpfloat(result->wobble_rad, ==, 0);
    g_assert_cmpfloat(e.chi2, <, 6); /* one draw; with the noise of the corners alone about 75 */
    const struct calibration_part *part = &calibration->parts[CALIBRATION_CAMERAS];
    g_assert_cmpfloat(part->residual_rms, ==, result->rms_px);
    g_assert_cmpfloat(part->residual_expected, ==, result->expected_px);
}

/* Only the lens, from pictures that are treated as photographs of a board in unknown poses. */
/* A chessboard whose first square has the other colour than said is taken upside down. Markers tell
 * up from down themselves, so a board of them may lie half a turn from the nominal azimuths. */
TEST(board_azimuth) {
    static const double degrees[] = {0, 2, -90, 160, 179.5, -179.5, -172};
    struct cameras_lay lays[2] = {{.tilt_deg = 20, .azimuth_deg = 77}, {.tilt_deg = 0.1}};
    struct cameras_result result = {.lays = g_array_new(FALSE, FALSE, sizeof *lays)};
    g_array_append_vals(result.lays, lays, 2);
    for (gsize i = 0; i < G_N_ELEMENTS(degrees); i++)
        for (int markers = 0; markers < 2; markers++) {
            g_autoptr(GError) error = NULL;
            struct board board;
            double found;
            g_assert_true(
                board_parse(&board, markers ? "8x8,square=9,marker=6.75" : "7x6,square=8", NULL));
            g_array_index(result.lays, struct cameras_lay, 1).azimuth_deg = degrees[i];
            const gboolean right = markers || fabs(degrees[i]) < 165;
            g_assert_true(right == cameras_board_azimuth(&result, &board, &found, &error));
            if (right)
                g_assert_cmpfloat(found, ==, degrees[i]);
            else
                g_assert_nonnull(strstr(error->message, "add first=white to --board"));
        }
    g_array_unref(result.lays);
}

TEST(lens) {
    g_autoptr(GError) error = NULL;
    struct rig rig = {.id = "photographs", .n_cameras = 1};
    struct cameras_picture pictures[2 * N_STOPS];
    struct picture *taken[2 * N_STOPS];
    struct fixture one = f;
    rig.cameras[0] = (struct rig_camera){.name = "camera", .width = 176, .height = 160};
    rig.cameras[0].response = 1;
    rig.cameras[0].rotation = (struct mat3){{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}};
    for (int i = 0; i < 2 * N_STOPS; i++) {
        pictures[i] = (struct cameras_picture){0, i, 0};
        taken[i] = f.taken[i * f.options.n_cameras + 1];
    }
    one.taken = taken;
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    struct cameras_task task = {f.board, pictures, 2 * N_STOPS, boards_read, NULL, &one};
    g_autoptr(CamerasResult) result = cameras_calibrate_lens(calibration, &task, &error);
    g_assert_no_error(error);
    struct rig_camera truth;
    boards_true_camera(&f, 1, &truth);
    const double sigma = sqrt(calibration->cameras[0].covariance[CALIBRATION_FX][CALIBRATION_FX]);
    g_test_message("focal length %.2f ± %.2f px, truly %.2f", calibration->rig.cameras[0].fx_px,
                   sigma, truth.fx_px);
    g_assert_cmpfloat(fabs(calibration->rig.cameras[0].fx_px - truth.fx_px), <, 4 * sigma);
    g_assert_cmpfloat(sigma, <, 0.02 * truth.fx_px);
    g_assert_cmpfloat(result->rms_px, <, 0.15);
    task.n_pictures = N_STOPS; /* flat only */
    g_autoptr(Calibration) flat = calibration_new(&rig);
    g_assert_null(cameras_calibrate_lens(flat, &task, &error));
    g_test_message("%s", error->message);
    g_assert_error(error, CAMERAS_ERROR, CAMERAS_ERROR_PICTURES);
}

static const struct fixture_lay lays[] = {{0, 0, 3, 1, -2}, {30, 20, 40, 2, 1}};
static const struct fixture_rig options = {.n_cameras = 3,
                                           .width = 176,
                                           .height = 160,
                                           .focal_px = 714,
                                           .distance_mm = 320,
                                           .first_theta_deg = 15,
                                           .last_theta_deg = 75,
                                           .seed = 3,
                                           .supersample = 2,
                                           .error_mm = 1,
                                           .error_deg = 0.2,
                                           .turntable_error_deg = 0.01,
                                           .blur_px = 0.4,
                                           .board = "7x7,square=10.5,marker=7.875,thickness=3"};

/* The bearing of the turntable wobbles: the pictures show how, and the calibration knows it at
 * angles between theirs. */
static const struct wobbling {
    const char *path;
    double wobble_deg;
    int turns;
} wobblings[] = {
    {"/cameras/wobble/twice a turn", 0.1, 2},
    {"/cameras/wobble/three times a turn", 0.1, 3},
};

static void test_wobble(gconstpointer data) {
    const struct wobbling *wobbling = data;
    struct fixture_rig wobbly = options;
    struct fixture turning;
    wobbly.wobble_deg = wobbling->wobble_deg;
    wobbly.wobble_turns = wobbling->turns;
    boards_open(&turning, &wobbly, lays, G_N_ELEMENTS(lays));
    boards_capture(&turning, N_STOPS);
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibration_new(&turning.nominal);
    const struct cameras_task task = {
        turning.board, turning.pictures, turning.n_pictures, boards_read, NULL, &turning};
    g_autoptr(CamerasResult) result = cameras_calibrate(calibration, &task, &error);
    g_assert_no_error(error);
    struct calibration *flat = calibration_new(&calibration->rig);
    memset(&flat->rig.wobble, 0, sizeof flat->rig.wobble);
    const double with_px = boards_turned_px(&turning, calibration);
    const double without_px = boards_turned_px(&turning, flat);
    const struct fixture_errors e = boards_compare(&turning, calibration);
    g_test_message(
        "%.4f px RMS of %.4f expected, wobble %.4f° ± %.4f°; between the angles %.4f px, "
        "without it %.4f px; chi2 %.2f",
        result->rms_px, result->expected_px, FIXTURE_DEG(result->wobble_rad),
        FIXTURE_DEG(result->wobble_error_rad), with_px, without_px, e.chi2);
    g_assert_cmpfloat_with_epsilon(FIXTURE_DEG(result->wobble_rad), wobbling->wobble_deg,
                                   5 * FIXTURE_DEG(result->wobble_error_rad));
    g_assert_cmpfloat(with_px, <, 0.05);
    g_assert_cmpfloat(with_px, <, without_px / 3);
    g_assert_cmpfloat(e.chi2, <, 3);
    /* It is in the file. */
    g_autofree char *text = calibration_to_text(calibration);
    g_autoptr(Calibration) back = calibration_from_text(text, "x", &error);
    g_assert_no_error(error);
    g_assert_cmpmem(&back->rig.wobble, sizeof back->rig.wobble, &calibration->rig.wobble,
                    sizeof calibration->rig.wobble);
    g_assert_cmpfloat(back->turntable.wobble_rad, ==, result->wobble_error_rad);
    calibration_free(flat);
    boards_close(&turning);
}

/* Red and blue are larger or smaller than green: the board shows by how much. Bounds in standard
 * errors hold for each of the lenses. */
static const struct lateral {
    const char *path;
    double larger; /* red, and blue smaller */
} laterals[] = {
    {"/cameras/lateral/none", 0},
    {"/cameras/lateral/small", 5e-4},
    {"/cameras/lateral/large", -4e-3},
};

static void check_lateral(const struct lateral *lateral, const struct fixture *seen,
                          const struct calibration *calibration) {
    g_autoptr(GError) error = NULL;
    for (int c = 0; c < calibration->rig.n_cameras; c++) {
        const double *found = calibration->rig.cameras[c].lateral_colour;
        const double *sigma = calibration->cameras[c].lateral_colour;
        const double truth[3] = {lateral->larger, 0, -lateral->larger};
        for (int k = 0; k < 3; k++) {
            g_test_message("camera %d, colour %d: %+.6f ± %.6f, truly %+.6f", c, k, found[k],
                           sigma[k], truth[k]);
            g_assert_cmpfloat(sigma[k], >, 0);
            g_assert_cmpfloat(sigma[k], <, 2e-4);
            g_assert_cmpfloat(fabs(found[k] - truth[k]), <=, 3 * sigma[k]);
            if (lateral->larger == 0)
                g_assert_cmpfloat(found[k], ==, 0);
        }
    }
    const struct fixture_errors e = boards_compare(seen, calibration);
    g_test_message("points %.4f px, chi2 %.2f", e.point_px, e.chi2);
    g_assert_cmpfloat(e.point_px, <, 0.05);
    /* It is in the file. */
    g_autofree char *text = calibration_to_text(calibration);
    g_autoptr(Calibration) back = calibration_from_text(text, "x", &error);
    g_assert_no_error(error);
    g_assert_cmpmem(back->cameras, sizeof back->cameras, calibration->cameras,
                    sizeof calibration->cameras);
    g_assert_cmpmem(back->rig.cameras, sizeof back->rig.cameras, calibration->rig.cameras,
                    sizeof calibration->rig.cameras);
    g_assert_true((strstr(text, "lateral_colour") != NULL));
}

static void test_lateral(gconstpointer data) {
    const struct lateral *lateral = data;
    if (lateral->larger == 0) {
        const struct calibration *calibration;
        whole_result(&calibration);
        check_lateral(lateral, &f, calibration);
        return;
    }
    struct fixture_rig coloured = options;
    struct fixture seen;
    coloured.lateral_colour = lateral->larger;
    boards_open(&seen, &coloured, lays, G_N_ELEMENTS(lays));
    boards_capture(&seen, N_STOPS);
    const struct cameras_task task = {seen.board,  seen.pictures, seen.n_pictures,
                                      boards_read, NULL,          &seen};
    g_autoptr(Calibration) calibration = calibration_new(&seen.nominal);
    cameras_result_free(ok(cameras_calibrate(calibration, &task, ERR)));
    check_lateral(lateral, &seen, calibration);
    boards_close(&seen);
}

BEFORE_TESTS {
    boards_open(&f, &options, lays, G_N_ELEMENTS(lays));
    boards_capture(&f, N_STOPS);
    for (gsize i = 0; i < G_N_ELEMENTS(refusals); i++)
        g_test_add_data_func(refusals[i].path, &refusals[i], test_refused);
    for (gsize i = 0; i < G_N_ELEMENTS(noted); i++)
        g_test_add_data_func(noted[i].path, &noted[i], test_noted);
    for (gsize i = 0; i < G_N_ELEMENTS(wobblings); i++)
        g_test_add_data_func(wobblings[i].path, &wobblings[i], test_wobble);
    for (gsize i = 0; i < G_N_ELEMENTS(laterals); i++)
        g_test_add_data_func(laterals[i].path, &laterals[i], test_lateral);
}

AFTER_TESTS {
    boards_close(&f);
}
