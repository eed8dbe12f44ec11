#include "calibration/calibration.h"
#include "lib/radiometry_fixture.h"
#include "lib/test.h"
#include "radiometry/fiducials.h"

#define PIXELS (FIXTURE_SIZE * FIXTURE_SIZE)

static const double places_mm[][2] = {{32, 0}, {0, 32}, {-32, 0}, {0, -32}};
#define N_FIDUCIALS ((int)G_N_ELEMENTS(places_mm))

#define DARK   "width_mm=50\nheight_mm=50\nbase_mm=2\nalbedo=0.3\n"
#define BRIGHT "width_mm=57\nheight_mm=57\nbase_mm=3.9\nalbedo=0.4\n"
static const char *sample = DARK;

/* A sample with four fiducials next to it; the turntable may be off by a slip. */
static World *fiducials_world(int seed, const char *cam1_keys, double drift_pct) {
    g_autoptr(GString) objects = g_string_new("[sample]\nkind=flat\n");
    g_string_append(objects, sample);
    for (int i = 0; i < N_FIDUCIALS; i++)
        g_string_append_printf(objects,
                               "[mark m%d]\nx_mm=%g\ny_mm=%g\nz_mm=4\nradius_mm=3\nalbedo=0.9\n", i,
                               places_mm[i][0], places_mm[i][1]);
    g_autofree char *keys = g_strdup_printf(
        "seed=%d\nturntable_albedo=0.02\ndrift_pct=%g\ndrift_period_s=100", seed, drift_pct);
    g_autofree char *text = radiometry_fixture_world(keys, objects->str);
    if (!cam1_keys)
        return world_fixture_new(text);
    g_auto(GStrv) parts = g_strsplit(text, "[camera cam1]\n", 2);
    g_autofree char *nudged =
        g_strconcat(parts[0], "[camera cam1]\n", cam1_keys, "\n", parts[1], NULL);
    return world_fixture_new(nudged);
}

/* The fixture's true values, as a radiometric calibration would give them. */
static struct rig rig;
static struct radiometry_camera cameras[3];
static struct radiometry_lamp lamps[3];

static void fiducials_rig(void) {
    radiometry_fixture_rig(&rig);
    for (int i = 0; i < 3; i++) {
        rig.cameras[i].response = fixture_cameras[i].response;
        rig.cameras[i].vignetting = fixture_cameras[i].vignetting;
        rig.lamps[i].intensity = fixture_lamps[i].intensity;
        rig.lamps[i].exponent = fixture_lamps[i].exponent;
        rig.lamps[i].aim = radiometry_fixture_aim(i);
        cameras[i] = (struct radiometry_camera){.known = TRUE};
        lamps[i] = (struct radiometry_lamp){.known = TRUE, .colour = {1, 1, 1}};
        for (int k = 0; k < 3; k++)
            cameras[i].colour[k] = fixture_cameras[i].colour[k];
    }
    rig.n_fiducials = N_FIDUCIALS;
    for (int i = 0; i < N_FIDUCIALS; i++) {
        struct rig_fiducial *fiducial = &rig.fiducials[i];
        g_snprintf(fiducial->name, sizeof fiducial->name, "m%d", i);
        fiducial->centre_mm = vec3(places_mm[i][0], places_mm[i][1], 4);
        fiducial->radius_mm = 3;
        for (int k = 0; k < 3; k++)
            fiducial->reflectance[k] = 0.9;
    }
}

/* All cameras, one lamp after the other. */
static GArray *look(World *world, int seed, double slip_deg) {
    g_autofree float *mosaic = g_new(float, PIXELS);
    GArray *seen = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    for (int lamp = 0; lamp < 3; lamp++) {
        double turn_deg = 17 + 30 * lamp;
        struct fixture_pose pose = {lamp, turn_deg + slip_deg, 100 + 40.0 * lamp, 10.0 * lamp};
        for (int c = 0; c < 3; c++) {
            radiometry_fixture_mosaic(world, c, &pose, 1, (guint64)seed * 100 + (guint64)lamp,
                                      mosaic);
            struct fiducial_scene scene = {
                &rig,        c,           lamp, turn_deg * G_PI / 180, pose.arc_deg * G_PI / 180,
                &cameras[c], &lamps[lamp]};
            fiducials_measure(&scene, "rggb", mosaic, seen);
        }
    }
    return seen;
}

static const struct fiducial_seen *at(const GArray *seen, guint i) {
    return &g_array_index(seen, struct fiducial_seen, i);
}

struct offsets { /* of pictures from where they are expected */
    double squares, normalised;
    int n;
};

static void offsets_add(struct offsets *to, const struct fiducial_seen *s) {
    double dx = s->x_px - s->expected_x_px, dy = s->y_px - s->expected_y_px;
    to->squares += (dx * dx + dy * dy) / 2;
    to->normalised += (dx * dx + dy * dy) / (2 * s->error_px * s->error_px);
    to->n++;
}

/* Fiducials are found to a small part of a pixel, and they show the output of each lamp. */
TEST(found) {
    struct offsets offsets = {0};
    double output = 0;
    int n_output = 0;
    for (int seed = 1; seed <= 5; seed++) {
        g_autoptr(World) world = fiducials_world(seed, NULL, 3);
        g_autoptr(GArray) seen = look(world, seed, 0);
        g_assert_cmpuint(seen->len, >=, 30);
        for (guint i = 0; i < seen->len; i++) {
            const struct fiducial_seen *s = at(seen, i);
            int lamp = (int)lrint((s->turntable_rad * 180 / G_PI - 17) / 30);
            double drift = 0.03 * sin(2 * G_PI * (10.0 * lamp + 1 + FIXTURE_US * 0.5e-6) / 100);
            double off = s->output / (1 + drift) - 1;
            offsets_add(&offsets, s);
            if (!isfinite(s->output_error))
                continue;
            output += off * off / (s->output_error * s->output_error);
            n_output++;
            g_assert_cmpfloat(fabs(off), <, 0.02);
        }
    }
    g_test_message("%d fiducials: rms %.4f px, chi-square %.2f; output chi-square %.2f", offsets.n,
                   sqrt(offsets.squares / offsets.n), offsets.normalised / offsets.n,
                   output / n_output);
    g_assert_cmpfloat(sqrt(offsets.squares / offsets.n), <, 0.06);
}

/* The output that a camera's sightings at one angle of the turntable give; 0 if there is none. */
static double output_of(const GArray *seen, int camera, double turn_rad) {
    g_autoptr(GArray) own = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    double output, error;
    for (guint i = 0; i < seen->len; i++)
        if (at(seen, i)->camera == camera && fabs(at(seen, i)->turntable_rad - turn_rad) < 1e-9)
            g_array_append_vals(own, at(seen, i), 1);
    return fiducials_output((struct fiducial_seen *)(void *)own->data, (int)own->len, &output,
                            &error)
               ? output
               : 0;
}

static void check_one(int seed, const char *nudge, double slip_deg, struct fiducials_check *ret) {
    g_autoptr(World) world = fiducials_world(seed, nudge, 0);
    g_autoptr(GArray) seen = look(world, seed, slip_deg);
    fiducials_check(&rig, (struct fiducial_seen *)(void *)seen->data, (int)seen->len, 0.03, 0.03,
                    ret);
    g_autofree char *text = fiducials_describe(&rig, ret);
    g_test_message("seed %d, %s, slip %g: %d seen, %.3f px: %s", seed, nudge ? nudge : "-",
                   slip_deg, ret->n_seen, ret->rms_px, text ? text : "nothing");
    g_assert_true((text != NULL) == (nudge || slip_deg != 0));
}

/* The factor between two calibrations is that of the outputs that the same pictures have with one
 * and with the other. */
TEST(other_calibration) {
    g_autoptr(World) world = fiducials_world(3, NULL, 3);
    g_autoptr(Calibration) one = calibration_new(&rig);
    g_autoptr(GArray) before = look(world, 3, 0);
    int n = 0;
    for (int i = 0; i < 3; i++) {
        one->camera_radiometry[i] = cameras[i];
        one->lamp_radiometry[i] = lamps[i];
        rig.cameras[i].response *= 1.02 - 0.03 * i;
        rig.lamps[i].intensity *= 0.95 + 0.04 * i;
        rig.lamps[i].exponent += 0.3;
        cameras[i].colour[0] *= 1.01;
    }
    for (int i = 0; i < N_FIDUCIALS; i++)
        for (int k = 0; k < 3; k++)
            rig.fiducials[i].reflectance[k] = 0.85;
    g_autoptr(Calibration) other = calibration_new(&rig);
    for (int i = 0; i < 3; i++) {
        other->camera_radiometry[i] = cameras[i];
        other->lamp_radiometry[i] = lamps[i];
    }
    g_autoptr(GArray) after = look(world, 3, 0);
    for (int lamp = 0; lamp < 3; lamp++)
        for (int c = 0; c < 3; c++) {
            const double turn_rad = (17 + 30 * lamp) * G_PI / 180;
            const double arc_rad = (100 + 40.0 * lamp) * G_PI / 180;
            const double factor = calibration_output_factor(one, other, c, lamp, turn_rad, arc_rad);
            const double was = output_of(before, c, turn_rad), is = output_of(after, c, turn_rad);
            g_test_message("lamp %d, camera %d: factor %.4f, outputs %.4f and %.4f", lamp, c,
                           factor, was, is);
            n += was > 0;
            g_assert_cmpfloat_with_epsilon(was * factor, is, 2e-3);
        }
    g_assert_cmpint(n, >=, 6);
    g_assert_cmpfloat(calibration_output_factor(one, one, 0, 0, 0.3, 1.8), ==, 1);
    fiducials_rig();
}

TEST(nothing_moved) {
    struct fiducials_check check;
    for (int seed = 1; seed <= 5; seed++) {
        check_one(seed, NULL, 0, &check);
        g_assert_false(check.slipped);
    }
}

/* A bright sample that reaches nearly to the fiducials pulls them to one side: then less is said of
 * where they are. */
TEST(bright_beside) {
    struct offsets offsets = {0};
    sample = BRIGHT;
    for (int seed = 1; seed <= 5; seed++) {
        g_autoptr(World) world = fiducials_world(seed, NULL, 0);
        g_autoptr(GArray) seen = look(world, seed, 0);
        for (guint i = 0; i < seen->len; i++)
            offsets_add(&offsets, at(seen, i));
    }
    sample = DARK;
    g_test_message("%d fiducials: rms %.3f px, chi-square %.2f", offsets.n,
                   sqrt(offsets.squares / offsets.n), offsets.normalised / offsets.n);
    g_assert_cmpint(offsets.n, >=, 150);
    g_assert_cmpfloat(sqrt(offsets.squares / offsets.n), >, 0.1);
    g_assert_cmpfloat(offsets.normalised / offsets.n, <, 1);
}

TEST(camera_nudged) {
    static const char *const nudges[] = {"turn_deg=0.1;0;0", "turn_deg=0;-0.1;0",
                                         "turn_deg=0;0;0.1"};
    for (int seed = 1; seed <= 5; seed++)
        for (int axis = 0; axis < 2; axis++) {
            struct fiducials_check check;
            check_one(seed, nudges[axis], 0, &check);
            g_assert_false(check.slipped);
            g_assert_true(check.cameras[1].moved);
            g_assert_false(check.cameras[0].moved || check.cameras[2].moved);
            g_assert_cmpfloat(fabs(check.cameras[1].turn_deg - 0.1), <, 0.03);
        }
}

TEST(turntable_slipped) {
    double normalised = 0;
    for (int seed = 1; seed <= 5; seed++)
        for (int side = -1; side <= 1; side += 2) {
            struct fiducials_check check;
            check_one(seed, NULL, 0.1 * side, &check);
            g_assert_true(check.slipped);
            for (int c = 0; c < 3; c++)
                g_assert_false(check.cameras[c].moved);
            double off = check.slip_deg - 0.1 * side;
            g_assert_cmpfloat(fabs(off), <, 0.03);
            normalised += off * off / (check.slip_error_deg * check.slip_error_deg) / 10;
        }
    g_test_message("slip: chi-square %.2f", normalised);
}

/* What is not a fiducial is not taken for one. */
TEST(nothing_seen) {
    struct fiducials_check check;
    double output, error;
    g_autofree float *mosaic = g_new0(float, PIXELS);
    g_autoptr(GArray) seen = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    struct fiducial_scene scene = {&rig, 0, 0, 0.3, 1, &cameras[0], &lamps[0]};
    g_assert_cmpint(fiducials_measure(&scene, "rggb", mosaic, seen), ==, 0);
    for (int i = 0; i < PIXELS; i++)
        mosaic[i] = (float)NAN;
    g_assert_cmpint(fiducials_measure(&scene, "rggb", mosaic, seen), ==, 0);
    for (int i = 0; i < PIXELS; i++)
        mosaic[i] = 100 + (float)(i % 7);
    g_assert_cmpint(fiducials_measure(&scene, "rggb", mosaic, seen), ==, 0);
    struct rig elsewhere = rig;
    for (int i = 0; i < N_FIDUCIALS; i++) /* out of the picture, or behind the camera */
        elsewhere.fiducials[i].centre_mm = i % 2 ? vec3(0, 0, 5000) : vec3(500, 20 * i, 4);
    scene.rig = &elsewhere;
    g_assert_cmpint(fiducials_measure(&scene, "mono", mosaic, seen), ==, 0);
    g_assert_false(fiducials_output(NULL, 0, &output, &error));
    fiducials_check(&rig, NULL, 0, 0.05, 0.05, &check);
    g_assert_false(check.slipped);
    g_assert_null(fiducials_describe(&rig, &check));
}

BEFORE_TESTS {
    fiducials_rig();
}

AFTER_TESTS {
    world_fixture_clean();
}
