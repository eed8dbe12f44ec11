/* Effects of real cameras and lamps on tones, from a white tile to the BTF of a grey scale, through
 * sessions: the halves of a sensor, offsets of columns, veiling glare, flicker. They are corrected
 * if the tile's pictures show them. Otherwise the error bars contain them. */
#include "base/residual.h"
#include "base/robust.h"
#include "btf/btf_sigma.h"
#include "lib/grey_fixture.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/test.h"

#include <stdlib.h>

struct effect {
    const char *name, *world, *camera; /* keys of the world file */
    const char *objects;               /* further sections; may be NULL */
    gboolean bright;                   /* the turntable is */
};

/* Puts keys into the world file that is there. */
static void change_world(const char *folder, const struct effect *effect) {
    g_autofree char *path = g_build_filename(folder, "world.conf", NULL), *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_autoptr(GString) all = g_string_new(text);
    g_autofree char *world = g_strconcat("[world]\n", effect->world, "\n", NULL);
    g_assert_cmpint(g_string_replace(all, "[world]\n", world, 0), ==, 1);
    for (gsize c = 0; c < G_N_ELEMENTS(fixture_cameras); c++) {
        g_autofree char *head = g_strdup_printf("[camera cam%zu]\n", c);
        g_autofree char *camera = g_strconcat(head, effect->camera, "\n", NULL);
        g_assert_cmpint(g_string_replace(all, head, camera, 0), ==, 1);
    }
    if (effect->bright)
        g_string_replace(all, "turntable_albedo=0.02", "turntable_albedo=0.5", 0);
    g_string_append(all, effect->objects ? effect->objects : "");
    radiometry_rig_write(folder, "world.conf", all->str);
}

static void capture(const char *folder, const char *conf, const char *name) {
    g_autofree char *reason = NULL;
    const enum capture_state state =
        ok(radiometry_rig_capture(folder, conf, name, NULL, &reason, ERR));
    g_test_message("%s", reason ? reason : "");
    g_assert_cmpint(state, ==, CAPTURE_DONE);
}

/* Captures the tile as a session of a name, adds what it tells to a calibration, and writes it.
 * Returns it as it is read again. */
static struct calibration *calibrate_more(const char *folder, const struct effect *effect,
                                          const char *name, const char *conf,
                                          struct calibration *known, struct tile_result *ret) {
    g_autoptr(GError) error = NULL;
    g_autofree char *file = g_strconcat(name, ".session", NULL);
    g_autofree char *path = g_build_filename(folder, file, NULL);
    g_autofree char *to = g_build_filename(folder, "calibration.conf", NULL);
    radiometry_rig_write_tile(folder, 1);
    change_world(folder, effect);
    capture(folder, conf, name);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_text(session, "calibration.conf", &error);
    g_autoptr(Calibration) own = known ? NULL : calibration_from_text(text, path, &error);
    g_assert_no_error(error);
    struct calibration *calibration = known ? known : own;
    calibration_set_part(calibration, CALIBRATION_CAMERAS, "nominal", 0, "-", NULL);
    g_assert_true(tile_session(session, calibration, &grey_tile, ret, &error));
    g_assert_true(calibration_write(calibration, to, &error));
    struct calibration *again = ok(calibration_read(to, ERR));
    return again;
}

static struct calibration *calibrate(const char *folder, const struct effect *effect,
                                     struct tile_result *ret) {
    return calibrate_more(folder, effect, "tile", TILE_CONF, NULL, ret);
}

struct errors { /* of the greys' texels: relative errors, and squares by their bars */
    GArray *relative, *grazing; /* double; of all lights, of those at 70° */
    double chi2, shared_chi2;   /* of texels; of greys' means in a picture */
    int n, n_shared;
};

static void add_errors(const struct exr_part *part, const struct session_grid *grid,
                       const struct session_direction *light, struct errors *to) {
    static const char *const channels[] = {"R", "G", "B"};
    struct btf_sigma sigma;
    const float *bar = exr_part_plane(part, "sigma");
    g_assert_nonnull(bar);
    g_assert_true(btf_sigma_read(part, &sigma));
    const struct vec3 lamp =
        vec3_scale(rig_direction(light->theta_deg * G_PI / 180, light->phi_deg * G_PI / 180), 500);
    struct mean {
        double error, square;
        int n;
    } means[G_N_ELEMENTS(grey_values)][3] = {{{0}}};
    for (int t = 0; t < grid->width * grid->height; t++) {
        const struct vec3 p = rectify_point_mm(grid, t % grid->width + 0.5, t / grid->width + 0.5);
        const struct vec3 way = vec3_sub(lamp, p);
        for (gsize g = 0; g < G_N_ELEMENTS(grey_values); g++) {
            if (hypot(p.x - grey_mm[g][0], p.y - grey_mm[g][1]) > 4)
                continue;
            const double truth = grey_values[g] * way.z / vec3_length(way);
            for (int c = 0; c < 3; c++) {
                const double value = (double)exr_part_plane(part, channels[c])[t];
                const double error = value - truth, relative = fabs(error) / truth;
                const double own = sigma.colour[c] * (double)bar[t];
                const double shared = sigma.scale[c] * truth;
                g_array_append_val(to->relative, relative);
                if (light->theta_deg > 60)
                    g_array_append_val(to->grazing, relative);
                to->chi2 += error * error / (own * own + shared * shared);
                to->n++;
                means[g][c].error += error / truth;
                means[g][c].square += own * own / (truth * truth);
                means[g][c].n++;
            }
        }
    }
    for (gsize g = 0; g < G_N_ELEMENTS(grey_values); g++)
        for (int c = 0; c < 3; c++) {
            const struct mean *m = &means[g][c];
            to->shared_chi2 +=
                pow(m->error / m->n, 2) / (pow(sigma.scale[c], 2) + m->square / (m->n * m->n));
            to->n_shared++;
        }
}

static double quantile(GArray *values, double q) {
    g_array_sort(values, robust_by_value);
    return g_array_index(values, double, (guint)(q * (values->len - 1)));
}

struct figures {
    double median, p95, grazing, chi2, shared_chi2;
};

/* Captures and processes the grey scale with the calibration in the folder. */
static struct figures measure(const char *folder, const struct effect *effect, const char *conf) {
    g_autoptr(GError) error = NULL;
    struct pipeline_options options = {.work.n_threads = 2};
    struct pipeline_result made;
    struct session_grid grid;
    struct errors errors = {g_array_new(FALSE, FALSE, sizeof(double)),
                            g_array_new(FALSE, FALSE, sizeof(double))};
    g_autofree char *path = g_build_filename(folder, "grey.session", NULL);
    grey_write(folder, 1, "drift_pct=3\ndrift_period_s=170");
    change_world(folder, effect);
    capture(folder, conf, "grey");
    g_assert_true(pipeline_run(path, &options, &made, &error));
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_true(session_grid(session, &grid, &error));
    g_autoptr(GPtrArray) views = session_views(session, NULL),
                         lights = session_lights(session, NULL);
    for (guint v = 0; v < views->len; v++) {
        g_autofree char *name = g_strdup_printf("products/btf/view_%04u.exr", v);
        g_autofree char *file = session_file(session, name);
        g_autoptr(ExrFile) parts = exr_read(file, &error);
        g_assert_no_error(error);
        for (guint l = 0; l < lights->len; l++) {
            g_autofree char *part = g_strdup_printf("light_%04u", l);
            add_errors(exr_file_part(parts, part), &grid, lights->pdata[l], &errors);
        }
    }
    const struct figures ret = {quantile(errors.relative, 0.5), quantile(errors.relative, 0.95),
                                quantile(errors.grazing, 0.5), errors.chi2 / errors.n,
                                errors.shared_chi2 / errors.n_shared};
    g_test_message(
        "%s: median %.3f %%, p95 %.3f %%, at 70° %.3f %%, chi-square %.2f, of means %.2f",
        effect->name, 100 * ret.median, 100 * ret.p95, 100 * ret.grazing, ret.chi2,
        ret.shared_chi2);
    g_array_unref(errors.relative);
    g_array_unref(errors.grazing);
    return ret;
}

static const struct effect none = {"none", "", ""};

static void show(const struct calibration *found, const struct tile_result *result) {
    g_test_message("tile %.4f, expected %.4f, quality %.2f; exponents %.2f, aims %.3f",
                   result->residual, result->expected, result->quality, result->exponent_off,
                   result->aim_off_rad);
    for (int c = 0; c < 3; c++) {
        const struct radiometry_camera *r = &found->camera_radiometry[c];
        g_test_message("cam%d: halves %+.4f ± %.4f, glare %.4f ± %.5f, excess %.5f", c, r->flat[9],
                       r->flat_error[9], r->glare, r->glare_error, r->excess);
        g_test_message("lamp%d: flicker %.4f, %.4f among pictures; exponent %.2f", c,
                       found->lamp_radiometry[c].flicker, found->lamp_radiometry[c].frame_flicker,
                       found->rig.lamps[c].exponent);
    }
}

/* Runs the way of an effect, and compares what the tile told with the truth. */
static struct figures run(const struct effect *effect, double halves, double glare) {
    struct tile_result result;
    g_autofree char *folder = grey_folder();
    g_autofree char *conf = g_build_filename(folder, "calibration.conf", NULL);
    g_autofree char *path = g_build_filename(folder, "tile.session", NULL);
    g_autoptr(Calibration) found = calibrate(folder, effect, &result);
    show(found, &result);
    for (int c = 0; c < 3; c++) {
        const struct radiometry_camera *r = &found->camera_radiometry[c];
        g_assert_cmpfloat(fabs(r->flat[RADIOMETRY_SMOOTH] - halves), <, 0.001);
        g_assert_cmpfloat(fabs(r->glare - glare), <, 0.001);
        g_assert_cmpfloat(r->glare_error, >, 0);
        g_assert_cmpfloat(r->glare_error, <, 0.001);
        g_assert_cmpfloat(r->excess, <, 0.001);
    }
    g_assert_cmpfloat(result.residual, <, RESIDUAL_LIMIT * result.expected);
    const struct figures figures = measure(folder, effect, GREY_CONF);
    g_assert_cmpfloat(figures.chi2, <, 1);
    g_assert_cmpfloat(figures.shared_chi2, <, 1.2);
    g_assert_cmpfloat(figures.median, <, 0.0125);
    g_assert_cmpfloat(figures.p95, <, 0.048);
    /* Nothing is amiss. */
    g_autofree char *told = process_mesorig(0, "calibrate radiometry %s -r 0.96 -o %s", path, conf);
    g_assert_null(strstr(told, "warning"));
    radiometry_rig_remove(folder);
    return figures;
}

TEST(silent) {
    run(&none, 0, 0);
}

TEST(halves) {
    static const struct effect effect = {"halves", "", "half_gain_step=0.01"};
    run(&effect, 0.01, 0);
}

TEST(columns) {
    static const struct effect effect = {"columns", "", "column_offset=0.001"};
    run(&effect, 0, 0);
}

TEST(glare) {
    static const struct effect effect = {"glare", "", "veiling_glare=0.005"};
    run(&effect, 0, 0.005);
}

/* A session file with one exposure only: a lamp that flickers in a bracket pauses a session. */
static char *with_one_exposure(const char *conf) {
    g_autoptr(GRegex) exposures = g_regex_new("exposures_us=[0-9;]*", 0, 0, NULL);
    return g_regex_replace_literal(exposures, conf, -1, 0, "exposures_us=4000", 0, NULL);
}

TEST(flicker) {
    static const struct effect effect = {"flicker", "lamp_flicker=0.01", ""};
    struct tile_result result;
    g_autofree char *folder = grey_folder();
    g_autofree char *tile = with_one_exposure(TILE_CONF), *grey = with_one_exposure(GREY_CONF);
    g_autoptr(Calibration) steady = calibrate(folder, &none, &result);
    for (int l = 0; l < 3; l++)
        g_assert_cmpfloat(steady->lamp_radiometry[l].flicker, <, 0.001);
    g_autoptr(Calibration) found =
        calibrate_more(folder, &effect, "flickering", tile, steady, &result);
    show(found, &result);
    for (int l = 0; l < 3; l++) {
        g_assert_cmpfloat(found->lamp_radiometry[l].flicker, >, 0.004);
        g_assert_cmpfloat(found->lamp_radiometry[l].flicker, <, 0.025);
    }
    const struct figures figures = measure(folder, &effect, grey);
    g_assert_cmpfloat(figures.chi2, <, 1);
    g_assert_cmpfloat(figures.shared_chi2, <, 1.2);
    g_autofree char *path = g_build_filename(folder, "flickering.session", NULL);
    g_autofree char *conf = g_build_filename(folder, "calibration.conf", NULL);
    g_autofree char *told = process_mesorig(0, "calibrate radiometry %s -r 0.96 -o %s", path, conf);
    assert_has(told, "warning: lamp lamp1 flickers by ");
    radiometry_rig_remove(folder);
}

/* A tile with a dirty spot. */
TEST(soiled) {
    static const struct effect effect = {
        "soiled", "", "", "[mark spot]\nx_mm=12\ny_mm=5\nz_mm=4.01\nradius_mm=7\nalbedo=0.9\n"};
    struct tile_result result;
    g_autofree char *folder = grey_folder();
    g_autofree char *path = g_build_filename(folder, "tile.session", NULL);
    g_autofree char *conf = g_build_filename(folder, "calibration.conf", NULL);
    g_autoptr(Calibration) found = calibrate(folder, &effect, &result);
    show(found, &result);
    g_autofree char *told = process_mesorig(0, "calibrate radiometry %s -r 0.96 -o %s", path, conf);
    assert_has(told, "warning: the tile fits with an error of ");
    assert_has(told, "possible causes: a tile that is not even or not clean");
    g_assert_cmpfloat(found->parts[CALIBRATION_RADIOMETRY].residual_expected, >, 0);
    g_assert_cmpfloat(found->camera_radiometry[0].excess, >, 0.002);
    radiometry_rig_remove(folder);
}

/* Nothing dark is visible around the tile: the glare is not known, and the command says so. */
TEST(bright) {
    static const struct effect effect = {"bright", "", "veiling_glare=0.005", NULL, TRUE};
    struct tile_result result;
    g_autofree char *folder = grey_folder();
    g_autofree char *path = g_build_filename(folder, "tile.session", NULL);
    g_autofree char *conf = g_build_filename(folder, "calibration.conf", NULL);
    g_autoptr(Calibration) found = calibrate(folder, &effect, &result);
    show(found, &result);
    for (int c = 0; c < 3; c++) {
        g_assert_cmpfloat(found->camera_radiometry[c].glare, ==, 0);
        g_assert_cmpfloat(found->camera_radiometry[c].glare_error, ==, 0);
    }
    g_autofree char *told = process_mesorig(0, "calibrate radiometry %s -r 0.96 -o %s", path, conf);
    assert_has(told, "for 3 of 3 cameras, the light that the lens scatters is not known");
    radiometry_rig_remove(folder);
}
