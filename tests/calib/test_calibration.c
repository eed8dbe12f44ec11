/* The calibration file: what is written comes back, and what was damaged is refused with a reason.
 */
#include "calibration/calibration.h"

#include <glib/gstdio.h>
#include <string.h>

static struct rig nominal(void) {
    struct rig rig = {.id = "test rig", .n_cameras = 2, .n_lamps = 1, .n_lasers = 1};

    rig.arc_radius_mm = 500;
    for (int i = 0; i < 2; i++) {
        struct rig_camera *camera = &rig.cameras[i];
        *camera = (struct rig_camera){.width = 64, .height = 48, .response = 6000};
        g_snprintf(camera->name, RIG_NAME, "cam%d", i);
        camera->fx_px = camera->fy_px = 333.25;
        rig_camera_look_at(camera, vec3(100 * i, 10, 600), vec3(0, 0, 0));
    }
    rig.lamps[0] = (struct rig_lamp){"lamp", {300, 0, 400}, {-0.6, 0, -0.8}, 2, 40};
    rig.lasers[0] = (struct rig_laser){"laser", {300, 0, 400}, {0, 1, 0}, {0.8, 0, -0.6}};
    return rig;
}

static struct calibration *example(void) {
    const struct rig rig = nominal();
    struct calibration *calibration = calibration_new(&rig);
    GPtrArray *rejected = g_ptr_array_new_with_free_func(g_free);

    g_ptr_array_add(rejected, g_strdup("frames/000007_cam1.exr: no board; it is dark"));
    struct calibration_part *part = calibration_set_part(
        calibration, CALIBRATION_CAMERAS, "board \"5 × 7\"", 41, "0123456789abcdef", rejected);
    part->residual_rms = 0.1 / 3;
    part->degrees_of_freedom = 1234;
    calibration->cameras[1].known = TRUE;
    calibration->cameras[1].points = 77;
    for (int i = 0; i < CALIBRATION_CAMERA_PARAMETERS; i++)
        for (int j = 0; j < CALIBRATION_CAMERA_PARAMETERS; j++)
            calibration->cameras[1].covariance[i][j] = (i == j ? 1 : 0.2 / 7) * 1e-6;
    g_key_file_set_string(calibration->extra, "my notes", "said", "clean the lens; then again");
    return calibration;
}

static void test_comes_back(void) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *text = calibration_to_text(calibration);
    g_autoptr(Calibration) back = calibration_from_text(text, "x", &error);

    g_assert_no_error(error);
    g_autofree char *again = calibration_to_text(back);
    g_assert_cmpstr(text, ==, again);
    const struct calibration_part *part = &back->parts[CALIBRATION_CAMERAS];
    g_assert_true(part->done && !back->parts[CALIBRATION_LASER].done);
    g_assert_cmpfloat(part->residual_rms, ==, 0.1 / 3);
    g_assert_cmpint(part->pictures, ==, 41);
    g_assert_cmpstr(part->rejected->pdata[0], ==, "frames/000007_cam1.exr: no board; it is dark");
    g_assert_cmpmem(&back->cameras, sizeof back->cameras, &calibration->cameras,
                    sizeof calibration->cameras);
    g_autofree char *said = g_key_file_get_string(back->extra, "my notes", "said", NULL);
    g_assert_cmpstr(said, ==, "clean the lens; then again");
    g_assert_cmpfloat_with_epsilon(calibration_age_days(back, CALIBRATION_CAMERAS), 0, 0.01);
    g_assert_cmpfloat(calibration_age_days(back, CALIBRATION_LIGHTS), ==, -1);
}

static void test_is_a_rig(void) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *text = calibration_to_text(calibration);
    g_autofree char *rig_text = rig_to_text(&calibration->rig);
    struct rig rig;

    g_assert_true(rig_from_text(&rig, text, "x", &error));
    g_autofree char *again = rig_to_text(&rig);
    g_assert_cmpstr(rig_text, ==, again);
    g_autoptr(Calibration) bare = calibration_from_text(rig_text, "x", &error);
    g_assert_no_error(error);
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        g_assert_false(bare->parts[i].done);
}

/* Wherever it is cut, it is refused: the last section says that it is whole. */
static void test_cut(void) {
    g_autoptr(Calibration) calibration = example();
    g_autofree char *text = calibration_to_text(calibration);
    const gsize whole = strlen(text) - 1; /* without the last line's end it is still whole */

    for (gsize n = 0; n < whole; n++) {
        g_autoptr(GError) error = NULL;
        g_autofree char *cut = g_strndup(text, n);
        g_assert_null(calibration_from_text(cut, "cut.conf", &error));
        g_assert_nonnull(error);
        g_assert_nonnull(strstr(error->message, "cut.conf"));
    }
}

static void assert_refused(const char *find, const char *replace, const char *reason) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *text = calibration_to_text(calibration);
    g_auto(GStrv) around = g_strsplit(text, find, 2);

    g_assert_cmpint(g_strv_length(around), ==, 2);
    g_autofree char *edited = g_strconcat(around[0], replace, around[1], NULL);
    g_assert_null(calibration_from_text(edited, "edited.conf", &error));
    g_assert_nonnull(error);
    if (!strstr(error->message, reason))
        g_error("“%s” does not say “%s”", error->message, reason);
}

static void test_nonsense(void) {
    assert_refused("pictures=41", "pictures=-1", "[part cameras] pictures: is out of range");
    assert_refused("pictures=41", "pictures=nan", "[part cameras] pictures: is not a finite");
    assert_refused("pictures=41", "pictures=41\nflavour=2", "[part cameras] flavour: is not known");
    assert_refused("degrees_of_freedom=1234\n", "", "degrees_of_freedom: missing");
    assert_refused("\ndate=2", "\ndate=yesterday 2", "date: is not a date");
    assert_refused("covariance=9.9999999999999995e-07", "covariance=-1", "is not a covariance");
    assert_refused("covariance=9.9999999999999995e-07;", "covariance=", "not as many numbers");
    assert_refused("cameras=2", "cameras=1", "sections");
    assert_refused("fx_px=333.25", "fx_px=", "[camera 0] fx_px");
    assert_refused("response=6000", "response=1e308", "[camera 0] response: is out of range");
    assert_refused("[end]", "[camera residuals 0]\ndx_px=0.1;nan\n[end]",
                   "[camera residuals 0] dx_px: is not a list of finite numbers");
    assert_refused("[end]", "[laser steps]\ntilt_deg=0.1;1e999\n[end]",
                   "[laser steps] tilt_deg: is not a list of finite numbers");
}

/* Of a file that is none, nothing is quoted: it may be one that others must not read. */
static void test_not_quoted(void) {
    static const char *const texts[] = {"root:secret:0\n", "[a]\n\nsecret\n", "secret=1\n[a]\n",
                                        "[a]\nEncoding=secret\n"};
    static const char *const where[] = {"x: not a calibration file: line 1 is", "file: line 3 is",
                                        "x: not", "x: not"};

    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(calibration_from_text(texts[i], "x", &error));
        g_assert_error(error, RIG_ERROR, RIG_ERROR_FORMAT);
        g_assert_null(strstr(error->message, "secret"));
        g_assert_nonnull(strstr(error->message, where[i]));
    }
}

/* Bytes changed at random: refused, or read as something that can be written and read again. */
static void test_random_damage(void) {
    g_autoptr(Calibration) calibration = example();
    g_autofree char *text = calibration_to_text(calibration);
    const gsize length = strlen(text);
    GRand *rand = g_rand_new_with_seed(5);

    for (int i = 0; i < 2000; i++) {
        g_autofree char *damaged = g_strdup(text);
        for (int k = g_rand_int_range(rand, 1, 5); k > 0; k--)
            damaged[g_rand_int_range(rand, 0, (gint32)length)] =
                (char)(g_rand_boolean(rand) ? g_rand_int_range(rand, 1, 256)
                                            : "0123456789-;=[]\n.e"[g_rand_int_range(rand, 0, 18)]);
        g_autoptr(GError) error = NULL;
        g_autoptr(Calibration) read = calibration_from_text(damaged, "damaged", &error);
        g_assert_true((read == NULL) == (error != NULL));
        if (!read)
            continue;
        g_autofree char *again = calibration_to_text(read);
        g_autoptr(Calibration) reread = calibration_from_text(again, "again", &error);
        g_assert_no_error(error);
    }
    g_rand_free(rand);
}

/* What could not be read back is refused before anything is written over. */
static void test_unreadable(void) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *folder = g_dir_make_tmp("mesorig-calibration-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "rig.calibration", NULL);

    g_assert_true(calibration_write(calibration, path, &error));
    calibration->parts[CALIBRATION_CAMERAS].residual_rms = NAN;
    g_assert_false(calibration_write(calibration, path, &error));
    g_assert_error(error, RIG_ERROR, RIG_ERROR_VALUE);
    g_assert_nonnull(strstr(error->message, "[part cameras] residual_rms: is not a finite"));
    g_assert_nonnull(strstr(error->message, "is not written"));
    g_autoptr(Calibration) back = calibration_read(path, NULL);
    g_assert_nonnull(back);
    g_unlink(path);
    g_assert_cmpint(g_rmdir(folder), ==, 0);
}

static void test_files(void) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *folder = g_dir_make_tmp("mesorig-calibration-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "rig.calibration", NULL);

    g_assert_true(calibration_write(calibration, path, &error));
    g_autoptr(Calibration) back = calibration_read(path, &error);
    g_assert_no_error(error);
    g_assert_cmpstr(back->rig.id, ==, "test rig");
    g_assert_true(g_file_set_contents(path, "[rig]\0\n", 7, NULL));
    g_assert_null(calibration_read(path, &error));
    g_assert_error(error, RIG_ERROR, RIG_ERROR_FORMAT);
    g_clear_error(&error);
    g_unlink(path);
    g_assert_null(calibration_read(path, &error));
    g_assert_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT);
    g_assert_cmpint(g_rmdir(folder), ==, 0);
}

static void test_other_rig(void) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    struct rig rig = nominal();

    g_assert_true(calibration_check_rig(calibration, "x.conf", &rig, &error));
    g_strlcpy(rig.id, "another", sizeof rig.id);
    g_assert_false(calibration_check_rig(calibration, "x.conf", &rig, &error));
    g_assert_nonnull(strstr(error->message, "is of rig test rig, but this is rig another"));
    g_clear_error(&error);
    rig = nominal();
    rig.cameras[1].height = 47;
    g_assert_false(calibration_check_rig(calibration, "x.conf", &rig, &error));
    g_assert_nonnull(strstr(error->message, "64 × 47"));
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/calibration/comes back", test_comes_back);
    g_test_add_func("/calibration/is a rig", test_is_a_rig);
    g_test_add_func("/calibration/cut", test_cut);
    g_test_add_func("/calibration/nonsense", test_nonsense);
    g_test_add_func("/calibration/not quoted", test_not_quoted);
    g_test_add_func("/calibration/random damage", test_random_damage);
    g_test_add_func("/calibration/unreadable", test_unreadable);
    g_test_add_func("/calibration/files", test_files);
    g_test_add_func("/calibration/other rig", test_other_rig);
    return g_test_run();
}
