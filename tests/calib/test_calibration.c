/* The calibration file: values that are written are read back unchanged, and a damaged file is
 * refused with a reason. */
#include "calibration/calibration.h"
#include "lib/test.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <math.h>
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

/* A calibration in which everything is known. */
static struct calibration *complete(void) {
    struct calibration *calibration = example();
    struct rig *rig = &calibration->rig;
    rig->n_fiducials = 1;
    rig->fiducials[0] = (struct rig_fiducial){"mark", {30, 5, 2}, 3, {0.9, 0.9, 0.9}};
    rig->arc = (struct rig_arc){0.01, {0.002, -0.003}, {0.4, -0.7}};
    rig->arm = rig->probe = (struct rig_swing){{0, 1, 0}, {0.1, 0.2, 0.3}};
    rig->n_lamps = 2;
    rig->lamps[1] = rig->lamps[0];
    for (int i = 0; i < 2; i++) { /* two stops of one camera, and of one lamp */
        rig->cameras[i].on_arm = rig->lamps[i].on_probe = 1;
        rig->cameras[i].arm_deg = rig->lamps[i].probe_deg = 10 + i;
        rig->cameras[i].stop = rig->lamps[i].stop = i;
    }
    for (int k = 0; k < CALIBRATION_PARTS; k++) {
        GPtrArray *rejected = g_ptr_array_new_with_free_func(g_free);
        g_ptr_array_add(rejected, g_strdup("a picture: dark"));
        g_ptr_array_add(rejected, g_strdup("another: dark"));
        calibration_set_part(calibration, (enum calibration_kind)k, "by hand", 2, "00", rejected)
            ->residual_expected = 0.02;
    }
    for (int i = 0; i < rig->n_cameras; i++) {
        calibration->cameras[i].known = calibration->noise[i].known = TRUE;
        calibration->camera_radiometry[i].known = TRUE;
        for (int c = 0; c < 3; c++)
            calibration->camera_radiometry[i].colour[c] = 1;
        struct radiometry_camera *radiometry = &calibration->camera_radiometry[i];
        radiometry->flat[RADIOMETRY_SMOOTH] = radiometry->flat_error[RADIOMETRY_SMOOTH] = 0.01;
        radiometry->glare = 0.02;
        radiometry->excess = 0.003;
    }
    calibration->lamp_radiometry[0].flicker = 0.004;
    for (int i = 0; i < 3; i++) {
        calibration->lamps[0].position_covariance_mm2[i][i] = 1 + i;
        calibration->lamp_radiometry[0].colour[i] = 1;
    }
    for (int k = 0; k < RIG_WOBBLE_HARMONICS; k++)
        for (int i = 0; i < 4; i++)
            rig->wobble.rad[k][i] = 1e-3 * (1 + k) * (i % 2 ? -1 : 1);
    calibration->turntable.known = TRUE;
    calibration->turntable.wobble_rad = 1e-4;
    calibration->cameras[0].expected_px = 0.05;
    for (int c = 0; c < 3; c++) {
        rig->cameras[0].lateral_colour[c] = 2e-4 * (1 - c);
        calibration->cameras[0].lateral_colour[c] = 3e-5;
    }
    rig->lasers[0].bend_rad = -0.02;
    struct calibration_laser *laser = &calibration->lasers[0];
    laser->bend_rad = 0.001;
    laser->from_prior[CALIBRATION_LASER_POSITION] = 1;
    laser->expected_rms_mm = 0.03;
    laser->line_rad = 0.002;
    for (int i = 0; i < RIG_SHEET_PARAMETERS; i++)
        laser->sheet.covariance[i][i] = 1e-6 * (1 + i);
    calibration->arc.known = calibration->lamps[0].known = calibration->lasers[0].known = TRUE;
    calibration->lamp_radiometry[0].known = calibration->fiducials[0].known = TRUE;
    calibration->colour.known = TRUE;
    return calibration;
}

/* "section key" for each key of the manual page, sections being numbered 0. */
static GHashTable *documented(void) {
    GHashTable *found = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_autofree char *page = NULL;
    g_auto(GStrv) sections = NULL;
    g_assert_true(
        g_file_get_contents(SOURCE_DIR "/etc/man/mesorig-calibration.5", &page, NULL, NULL));
    g_auto(GStrv) lines = g_strsplit(page, "\n", -1);
    for (char **line = lines; *line; line++) {
        if (g_str_has_prefix(*line, ".Ss ")) {
            g_strfreev(sections);
            sections = g_strsplit(*line + 4, ", ", -1);
        }
        if (!sections || !g_str_has_prefix(*line, ".It Ic "))
            continue;
        g_auto(GStrv) keys = g_strsplit(*line + 7, " , ", -1);
        for (char **key = keys; *key; key++)
            for (char **section = sections; *section && strcmp(*key, "...") != 0; section++)
                g_hash_table_add(found, g_strdup_printf("%s %s", *section, *key));
    }
    return found;
}

/* mesorig-calibration(5) has every key that is written, and no other. */
TEST(manual) {
    /* keys that are missing if their value is 0 */
    static const char *const left_out[] = {"lens", "k4", "k5", "k6", "fixed", "further_covariance",
                                           NULL};
    g_autoptr(Calibration) calibration = complete();
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autoptr(GHashTable) page = documented();
    g_autofree char *text = calibration_to_text(calibration);
    g_autoptr(GHashTable) written = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_assert_true(g_key_file_load_from_data(file, text, (gsize)-1, G_KEY_FILE_NONE, NULL));
    g_key_file_remove_group(file, "my notes", NULL);
    g_auto(GStrv) groups = g_key_file_get_groups(file, NULL);
    for (char **group = groups; *group; group++) {
        g_auto(GStrv) keys = g_key_file_get_keys(file, *group, NULL, NULL);
        if (g_str_has_suffix(*group, " 1")) /* the page describes 0 */
            (*group)[strlen(*group) - 1] = '0';
        for (char **key = keys; *key; key++) {
            char *name = g_strdup_printf("[%s] %s", *group, *key);
            if (!g_hash_table_contains(page, name))
                g_error("etc/man/mesorig-calibration.5 lacks %s", name);
            g_hash_table_add(written, name);
        }
    }
    GHashTableIter iter;
    gpointer name;
    g_hash_table_iter_init(&iter, page);
    while (g_hash_table_iter_next(&iter, &name, NULL))
        if (g_str_has_prefix(name, "[laser plane ") || /* test_laser_images reads these */
            g_strv_contains(left_out, strchr(name, ']') + 2))
            g_hash_table_iter_remove(&iter);
        else if (!g_hash_table_contains(written, name))
            g_test_message("no calibration file has %s", (char *)name);
    g_assert_cmpuint(g_hash_table_size(page), ==, g_hash_table_size(written));
}

/* In a frame that is turned, everything sees the same: pictures, lamps and sheets of all angles. */
TEST(turn) {
    const double angle = 0.7;
    g_autoptr(Calibration) before = complete();
    g_autoptr(Calibration) turned = complete();
    struct calibration_camera *camera = &turned->cameras[1];
    /* A rotation about x only is known badly: in the turned frame, about (cos, sin). */
    camera->covariance[CALIBRATION_TURN_X][CALIBRATION_TURN_X] = 1;
    camera->further_covariance[0][CALIBRATION_TURN_X] = 0.01;
    camera->further_covariance[0][CALIBRATION_K4] = 1;
    /* Errors along x only. */
    double *const errors[] = {turned->lasers[0].position_mm, turned->fiducials[0].centre_mm,
                              turned->arc.tilt_rad, turned->arc.centre_mm};
    for (gsize i = 0; i < G_N_ELEMENTS(errors); i++) {
        errors[i][0] = 2;
        errors[i][1] = 0;
    }
    calibration_turn(turned, angle);
    for (int i = 0; i < 27; i++) {
        const struct vec3 p = vec3(20 * (i % 3 - 1), 20 * (i / 3 % 3 - 1), 5 * (int)(i / 9));
        const struct vec3 q = rig_turn(p, angle);
        const double arc_rad = 0.3 * i, sweep_rad = 0.01 * i;
        const struct rig *a = &before->rig, *b = &turned->rig;
        double x[2], y[2];
        for (int c = 0; c < 2; c++) {
            g_assert_true(rig_project(&a->cameras[c], p, &x[0], &y[0]));
            g_assert_true(rig_project(&b->cameras[c], q, &x[1], &y[1]));
            g_assert_cmpfloat_with_epsilon(x[0], x[1], 1e-9);
            g_assert_cmpfloat_with_epsilon(y[0], y[1], 1e-9);
        }
        const struct vec3 lamp =
            rig_turn(rig_lamp_position_mm(&a->arc, &a->lamps[0], arc_rad), angle);
        g_assert_cmpfloat_with_epsilon(
            vec3_length(vec3_sub(lamp, rig_lamp_position_mm(&b->arc, &b->lamps[0], arc_rad))), 0,
            1e-9);
        g_assert_cmpfloat_with_epsilon(rig_lamp_irradiance(&a->arc, &a->lamps[0], arc_rad, p),
                                       rig_lamp_irradiance(&b->arc, &b->lamps[0], arc_rad, q),
                                       1e-9);
        const struct rig_plane one = rig_laser_sheet(&a->arc, &a->lasers[0], arc_rad, sweep_rad);
        const struct rig_plane two = rig_laser_sheet(&b->arc, &b->lasers[0], arc_rad, sweep_rad);
        g_assert_cmpfloat_with_epsilon(vec3_dot(one.normal, p) - one.offset_mm,
                                       vec3_dot(two.normal, q) - two.offset_mm, 1e-9);
    }
    const double c = cos(angle), s = sin(angle);
    g_assert_cmpfloat_with_epsilon(camera->covariance[CALIBRATION_TURN_X][CALIBRATION_TURN_X],
                                   c * c, 1e-5);
    g_assert_cmpfloat_with_epsilon(camera->covariance[CALIBRATION_TURN_X][CALIBRATION_TURN_Y],
                                   c * s, 1e-5);
    g_assert_cmpfloat_with_epsilon(camera->covariance[CALIBRATION_TURN_Y][CALIBRATION_TURN_Y],
                                   s * s, 1e-5);
    g_assert_cmpfloat_with_epsilon(camera->further_covariance[0][CALIBRATION_TURN_X], 0.01 * c,
                                   1e-9);
    g_assert_cmpfloat_with_epsilon(camera->further_covariance[0][CALIBRATION_TURN_Y], 0.01 * s,
                                   1e-9);
    for (gsize i = 0; i < G_N_ELEMENTS(errors); i++) {
        g_assert_cmpfloat_with_epsilon(errors[i][0], 2 * c, 1e-9);
        g_assert_cmpfloat_with_epsilon(errors[i][1], 2 * s, 1e-9);
    }
    const double(*lamp)[3] = turned->lamps[0].position_covariance_mm2; /* was 1, 2, 3 */
    g_assert_cmpfloat_with_epsilon(lamp[0][0], c * c + 2 * s * s, 1e-9);
    g_assert_cmpfloat_with_epsilon(lamp[0][1], -c * s, 1e-9);
    g_assert_cmpfloat_with_epsilon(lamp[2][2], 3, 1e-9);
    g_autoptr(GError) error = NULL;
    g_autofree char *text = calibration_to_text(turned);
    g_autoptr(Calibration) readable = calibration_from_text(text, "x", &error);
    g_assert_no_error(error);
}

TEST(comes_back) {
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

TEST(is_a_rig) {
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
TEST(cut) {
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

TEST(nonsense) {
    assert_refused("pictures=41", "pictures=-1", "[part cameras] pictures: -1 is out of range");
    assert_refused("pictures=41", "pictures=nan", "[part cameras] pictures: “nan” is not a finite");
    assert_refused("pictures=41", "pictures=41\nflavour=2",
                   "[part cameras] flavour: this key is not known");
    assert_refused("degrees_of_freedom=1234\n", "", "degrees_of_freedom: is missing");
    assert_refused("\ndate=2", "\ndate=yesterday 2", "date: is not a date");
    assert_refused("covariance=9.9999999999999995e-07", "covariance=-1", "is not a covariance");
    assert_refused("covariance=9.9999999999999995e-07;", "covariance=", "does not have ");
    assert_refused("cameras=2", "cameras=1", "sections");
    assert_refused("fx_px=333.25", "fx_px=", "[camera 0] fx_px");
    assert_refused("response=6000", "response=1e308",
                   "[camera 0] response: 1e+308 is out of range");
    assert_refused("[end]", "[camera residuals 0]\ndx_px=0.1;nan\n[end]",
                   "[camera residuals 0] dx_px: is not a list of finite numbers");
    assert_refused("[end]", "[laser steps]\ntilt_deg=0.1;1e999\n[end]",
                   "[laser steps] tilt_deg: is not a list of finite numbers");
}

/* Of a file that is none, nothing is quoted: it may be one that others must not read. */
TEST(not_quoted) {
    static const char *const texts[] = {"root:secret:0\n", "[a]\n\nsecret\n", "secret=1\n[a]\n",
                                        "[a]\nEncoding=secret\n"};
    static const char *const where[] = {"x: this is not a calibration file: line 1 is",
                                        "file: line 3 is", "x: this is not", "x: this is not"};

    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(calibration_from_text(texts[i], "x", &error));
        g_assert_error(error, RIG_ERROR, RIG_ERROR_FORMAT);
        g_assert_null(strstr(error->message, "secret"));
        g_assert_nonnull(strstr(error->message, where[i]));
    }
}

/* Bytes changed at random: refused, or read as something that can be written and read again. */
TEST(random_damage) {
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
TEST(unreadable) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    g_autofree char *folder = g_dir_make_tmp("mesorig-calibration-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "rig.calibration", NULL);

    g_assert_true(calibration_write(calibration, path, &error));
    calibration->parts[CALIBRATION_CAMERAS].residual_rms = NAN;
    g_assert_false(calibration_write(calibration, path, &error));
    g_assert_error(error, RIG_ERROR, RIG_ERROR_VALUE);
    g_assert_nonnull(strstr(error->message, "[part cameras] residual_rms: “nan” is not a finite"));
    g_assert_nonnull(strstr(error->message, "is not written"));
    g_autoptr(Calibration) back = calibration_read(path, NULL);
    g_assert_nonnull(back);
    g_unlink(path);
    g_assert_cmpint(g_rmdir(folder), ==, 0);
}

TEST(files) {
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

TEST(other_rig) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = example();
    struct rig rig = nominal();

    g_assert_true(calibration_check_rig(calibration, "x.conf", &rig, &error));
    g_strlcpy(rig.id, "another", sizeof rig.id);
    g_assert_false(calibration_check_rig(calibration, "x.conf", &rig, &error));
    g_assert_nonnull(
        strstr(error->message, "a calibration of rig test rig, but this is rig another"));
    g_clear_error(&error);
    rig = nominal();
    rig.cameras[1].height = 47;
    g_assert_false(calibration_check_rig(calibration, "x.conf", &rig, &error));
    g_assert_nonnull(strstr(error->message, "64 × 47"));
}
