/* Error bars of a BTF against a diffuser whose pictures have noise by formula: photons, readout and
 * rounding of every exposure, drawn here, merged as captures are. */
#include "lib/ok.h"
#include "lib/pipeline_fixture.h"

#include "btf/btf_sigma.h"
#include "session/outputs.h"

#include <sqlite3.h>

static const double exposures_ms[] = {2, 8, 27};
enum { N_EXPOSURES = 3, LIMIT_DN = 4014, BLACK_DN = 60 };
static const double gain_dn_e = 0.8, read_noise_e = 9;

static double normal(GRand *random) {
    return sqrt(-2 * log(1 - g_rand_double(random))) * cos(2 * G_PI * g_rand_double(random));
}

/* Every pixel of a lamp's picture as three exposures show it. */
static void noisy(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind != SHOT_LAMP)
        return;
    GRand *random = g_rand_new_with_seed((guint32)shot->id);
    for (int i = 0; i < SIDE * SIDE; i++) {
        double sum = 0, time = 0;
        for (int e = 0; e < N_EXPOSURES; e++) {
            const double electrons = (double)part->planes[0][i] * exposures_ms[e] / gain_dn_e;
            const double seen =
                electrons + sqrt(electrons) * normal(random) + read_noise_e * normal(random);
            const double dn = round(BLACK_DN + gain_dn_e * seen);
            if (dn >= LIMIT_DN)
                continue;
            sum += dn - BLACK_DN;
            time += exposures_ms[e];
        }
        g_assert_cmpfloat(time, >, 0);
        part->planes[0][i] = (float)(sum / time);
    }
    g_rand_free(random);
    exr_set_string(part, "mesorig.exposures_us", "2000;8000;27000");
    exr_set_double(part, "mesorig.shorter_from", (LIMIT_DN - BLACK_DN) / exposures_ms[2]);
}

static void wrong_exposures(struct exr_part *part, const struct session_shot *shot) {
    noisy(part, shot);
    if (shot->id == 2)
        exr_set_string(part, "mesorig.exposures_us", "2000;abc");
}

/* The fixture's rig, calibrated: noise as above, times the factor. */
static Calibration *calibrated(double factor) {
    const struct rig rig = fixture_make_rig();
    Calibration *calibration = calibration_new(&rig);
    for (int i = 0; i < N_CAMERAS; i++)
        calibration->noise[i] = (struct calibration_noise){
            TRUE, {.gain_dn_e = gain_dn_e * factor, .read_noise_e = read_noise_e, .quality = 1}};
    return calibration;
}

static gboolean process(const struct fixture *fixture, const Calibration *calibration,
                        GError **error) {
    g_autofree char *text = calibration_to_text(calibration);
    struct pipeline_options options = {
        .n_eigenmaps = 2, .calibration = text, .work = {.n_threads = 2}};
    struct pipeline_result result;
    return pipeline_run(fixture->path, &options, &result, error);
}

/* ρ is the albedo times the cosine to the lamp, as pipeline.h defines it. */
static double truth(const struct exr_part *part, int texel, int colour) {
    double at[3], light[3];
    g_assert_true(exr_get_v3d(part, "light.position_mm", at, NULL));
    light[0] = at[0] - (-12 + (texel % TEXELS + 0.5) * 24 / TEXELS);
    light[1] = at[1] - (12 - ((double)(texel / TEXELS) + 0.5) * 24 / TEXELS);
    light[2] = at[2] - 5;
    return albedo[colour] * light[2] / sqrt(analytic_dot(light, light));
}

/* A printed edge: left of x = 0 of the sample the diffuser is a fifth as bright. The border runs
 * soft over a texel, as a lens shows it, so that means over texels are known by the formula. */
#define SOFT_MM 1.5

static double printed_mean(double x0, double x1) {
    const double step = 0.8;
    double sum = 0;
    for (int k = 0; k < 64; k++) {
        const double x = x0 + (k + 0.5) / 64 * (x1 - x0);
        sum += 1 - step / (1 + exp(x / (SOFT_MM / 4)));
    }
    return sum / 64;
}

/* Mean square of (ρ − truth) / σ of each colour, over all parts; edge: of the four
 * columns of texels at the printed edge. */
static void chi_squares(const struct fixture *fixture, gboolean edge, double ret[3]) {
    static const char *const channels[] = {"R", "G", "B"};
    double sums[3] = {0};
    int n = 0;
    for (int view = 0; view < N_VIEWS; view++) {
        g_autofree char *name = g_strdup_printf("btf/view_%04d.exr", view);
        g_autofree char *path = fixture_product(fixture, name);
        g_autoptr(ExrFile) file = exr_read(path, NULL);
        for (guint k = 0; k < file->parts->len; k++) {
            const struct exr_part *part = file->parts->pdata[k];
            const float *sigma = exr_part_plane(part, "sigma");
            struct btf_sigma said;
            g_assert_nonnull(sigma);
            g_assert_true(btf_sigma_read(part, &said));
            for (int i = 0; i < TEXELS * TEXELS; i++) {
                if (edge && abs(i % TEXELS * 2 + 1 - TEXELS) > 3)
                    continue;
                n++;
                for (int c = 0; c < 3; c++) {
                    const double value = (double)exr_part_plane(part, channels[c])[i];
                    const double x0 = -12 + i % TEXELS * (24.0 / TEXELS), x1 = x0 + 24.0 / TEXELS;
                    const double print = edge ? printed_mean(x0, x1) : 1;
                    const double error = value - print * truth(part, i, c);
                    sums[c] += pow(error / (said.colour[c] * (double)sigma[i]), 2);
                }
            }
        }
    }
    for (int c = 0; c < 3; c++)
        ret[c] = sums[c] / n;
}

/* With the noise that the pictures have, errors are as large as the error bars say, in each colour
 * (the longest exposure saturates in red, and neither in green nor in blue); with a gain of four
 * times less they are larger, though the texture that noise then seems to be covers some of it, and
 * with four times the gain smaller. */
static void test_noise(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(Calibration) right = calibrated(1), less = calibrated(0.25);
    g_autoptr(Calibration) more = calibrated(4);
    double chi[3];
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    ok(process(fixture, right, ERR));
    chi_squares(fixture, FALSE, chi);
    for (int c = 0; c < 3; c++) {
        g_test_message("χ² of colour %d: %.3f", c, chi[c]);
        g_assert_cmpfloat(chi[c], >, 0.75);
        g_assert_cmpfloat(chi[c], <, 1.3);
    }
    ok(process(fixture, less, ERR));
    chi_squares(fixture, FALSE, chi);
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat(chi[c], >, 1.6);
    ok(process(fixture, more, ERR));
    chi_squares(fixture, FALSE, chi);
    for (int c = 0; c < 3; c++)
        g_assert_cmpfloat(chi[c], <, 0.4);
}

/* Cameras are not where the calibration says: pictures of one are shifted by so many pixels in x,
 * those of the other in y. */
#define SHIFT_PX 0.7

static void shifted_edge(struct exr_part *part, const struct session_shot *shot) {
    static int pictures; /* of the cameras in turn */
    if (shot->kind != SHOT_LAMP)
        return;
    const int camera = pictures++ % N_CAMERAS;
    const struct pinhole *pinhole = &pinholes[camera];
    for (int i = 0; i < SIDE * SIDE; i++) {
        double p[3], q[3], at[3];
        hit(pinhole, i, 5, p);
        hit(pinhole, i + (camera ? 1 : SIDE), 5, q);
        for (int k = 0; k < 3; k++)
            at[k] = p[k] + SHIFT_PX * (q[k] - p[k]);
        analytic_turn(at, -shot->turntable_deg * DEGREE, at);
        part->planes[0][i] *= (float)printed_mean(at[0] - 0.1, at[0] + 0.1);
    }
    noisy(part, shot);
}

/* Where a printed edge lies half a pixel off, errors are as large as the error bars say if they
 * know of it, and far larger than noise and detail only. */
static void test_edge(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(Calibration) calibration = calibrated(1);
    double known[3], unknown[3];
    fixture_capture(fixture, 0, fixture->n_shots, shifted_edge);
    ok(process(fixture, calibration, ERR));
    chi_squares(fixture, TRUE, unknown);
    for (int i = 0; i < N_CAMERAS; i++) {
        calibration->cameras[i].known = TRUE;
        calibration->cameras[i].residual_rms_px = SHIFT_PX;
        calibration->cameras[i].points = 100;
    }
    ok(process(fixture, calibration, ERR));
    chi_squares(fixture, TRUE, known);
    for (int c = 0; c < 3; c++) {
        g_test_message("χ² of colour %d at the edge: %.3f, without registration %.1f", c, known[c],
                       unknown[c]);
        g_assert_cmpfloat(known[c], >, 0.7);
        g_assert_cmpfloat(known[c], <, 1.4);
        g_assert_cmpfloat(unknown[c], >, 5);
    }
}

/* What lamps and cameras are off by, as often as the calibration says, explains how far mean values
 * of lights are from the truth: hundreds of calibrations are drawn with its errors. */
static void test_scale(struct fixture *fixture, gconstpointer unused) {
    const struct radiometry_camera camera = {
        TRUE, {1.3, 1, 0.7}, .response_error = 0.01, .colour_error = {0.02, 0, 0.01}};
    const struct radiometry_lamp source = {
        TRUE, {0.9, 1, 1.2}, .intensity_error = 0.015, .colour_error = {0.009, 0, 0.03}};
    struct radiometry_lamp flickering = source;
    double scale[3], none[3], measured[3], unmeasured[3], sums[3] = {0};
    enum { DRAWS = 4000 };
    GRand *random = g_rand_new_with_seed(3);
    flickering.flicker = 0.03;
    flickering.frame_flicker = 0.004;
    btf_sigma_scale(&camera, &source, 0, scale);
    btf_sigma_scale(NULL, NULL, 0, none);
    btf_sigma_scale(&camera, &flickering, 0.003, measured);
    btf_sigma_scale(&camera, &flickering, 0, unmeasured);
    for (int i = 0; i < DRAWS; i++) {
        const double both = exp(0.01 * normal(random) + 0.015 * normal(random));
        for (int c = 0; c < 3; c++) {
            const double seen = camera.colour[c] + camera.colour_error[c] * normal(random);
            const double lit = source.colour[c] + source.colour_error[c] * normal(random);
            sums[c] += pow(both * seen * lit / (camera.colour[c] * source.colour[c]) - 1, 2);
        }
    }
    g_rand_free(random);
    for (int c = 0; c < 3; c++) {
        g_assert_cmpfloat_with_epsilon(sums[c] / DRAWS / pow(scale[c], 2), 1, 0.1);
        g_assert_cmpfloat(none[c], ==, 0);
        g_assert_cmpfloat_with_epsilon(measured[c], hypot(scale[c], 0.005), 1e-9);
        g_assert_cmpfloat_with_epsilon(unmeasured[c], hypot(scale[c], hypot(0.03, 0.004)), 1e-9);
    }
}

/* A calibrated lamp's error stands in every part, and the values' own error bars are the same. */
static void test_scale_in_file(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibrated(1);
    g_autofree char *path = fixture_product(fixture, "btf/view_0001.exr");
    struct btf_sigma before, after;
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    ok(process(fixture, calibration, ERR));
    g_autoptr(ExrPart) first = exr_read_part(path, "light_0001", &error);
    calibration->lamp_radiometry[0] =
        (struct radiometry_lamp){TRUE, {1, 1, 1}, .intensity_error = 0.03};
    ok(process(fixture, calibration, ERR));
    g_autoptr(ExrPart) second = exr_read_part(path, "light_0001", &error);
    g_assert_true(btf_sigma_read(first, &before) && btf_sigma_read(second, &after));
    for (int c = 0; c < 3; c++) {
        g_assert_cmpfloat(before.scale[c], ==, 0);
        g_assert_cmpfloat_with_epsilon(after.scale[c], 0.03, 1e-9);
    }
    g_assert_cmpfloat(before.rms, ==, after.rms);
}

/* The calibration that the session was captured with. */
static void set_captured(const struct fixture *fixture, const Calibration *calibration) {
    g_autofree char *path = g_build_filename(fixture->path, "session.db", NULL);
    g_autofree char *text = calibration_to_text(calibration);
    char *sql =
        sqlite3_mprintf("UPDATE text SET content = %Q WHERE name = 'calibration.conf'", text);
    sqlite3 *db;
    g_assert_cmpint(sqlite3_open(path, &db), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_exec(db, sql, NULL, NULL, NULL), ==, SQLITE_OK);
    g_assert_cmpint(sqlite3_changes(db), ==, 1);
    sqlite3_free(sql);
    sqlite3_close(db);
}

static double mean_green(const char *path) {
    g_autoptr(ExrPart) part = ok(exr_read_part(path, "light_0001", ERR));
    double sum = 0;
    for (int i = 0; i < TEXELS * TEXELS; i++)
        sum += (double)exr_part_plane(part, "G")[i];
    return sum / (TEXELS * TEXELS);
}

/* The lamp was 10 % brighter than in the calibration of the capture, as fiducials have shown. With
 * another calibration, in which the lamp is as bright as it was, the values are the same. */
static void test_outputs(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(Calibration) captured = calibrated(1), other = calibrated(1);
    g_autofree char *path = fixture_product(fixture, "btf/view_0001.exr");
    Calibration *const both[] = {captured, other};
    for (int i = 0; i < 2; i++) {
        both[i]->lamp_radiometry[0] = (struct radiometry_lamp){TRUE, {1, 1, 1}};
        for (int c = 0; c < N_CAMERAS; c++)
            both[i]->camera_radiometry[c] = (struct radiometry_camera){TRUE, {1, 1, 1}};
        both[i]->rig.n_fiducials = 1;
        both[i]->rig.fiducials[0] =
            (struct rig_fiducial){"dot", vec3(0, 0, 5), 1, .reflectance = {0.9, 0.9, 0.9}};
    }
    captured->rig.lamps[0].intensity /= 1.1;
    set_captured(fixture, captured);
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    Session *session = ok(session_open(fixture->path, SESSION_PRODUCTS, ERR));
    for (int i = 0; i < fixture->n_shots; i++)
        for (int c = 0; c < N_CAMERAS && fixture->shots[i].kind == SHOT_LAMP; c++)
            ok(outputs_store(session, fixture->shots[i].id, captured->rig.cameras[c].name, 1.1,
                             0.001, ERR));
    session_close(session);
    ok(process(fixture, captured, ERR));
    const double same = mean_green(path);
    ok(process(fixture, other, ERR));
    g_assert_cmpfloat_with_epsilon(mean_green(path), same, 1e-3 * same);
}

/* Error bars change no value: a session without them has the same pictures. */
static void test_values(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(Calibration) with = calibrated(1);
    g_autofree char *path = fixture_product(fixture, "btf/view_0002.exr");
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    fixture_process(fixture, 2, FALSE);
    g_autoptr(ExrFile) before = exr_read(path, NULL);
    ok(process(fixture, with, ERR));
    g_autoptr(ExrFile) after = exr_read(path, NULL);
    g_assert_cmpint(before->parts->len, ==, after->parts->len);
    for (guint k = 0; k < before->parts->len; k++) {
        const struct exr_part *a = before->parts->pdata[k], *b = after->parts->pdata[k];
        struct btf_sigma sigma;
        g_assert_null(exr_part_plane(a, "sigma"));
        g_assert_false(btf_sigma_read(a, &sigma));
        g_assert_nonnull(exr_part_plane(b, "sigma"));
        g_assert_cmpint(b->n_channels, ==, a->n_channels + 1);
        for (int c = 0; c < a->n_channels; c++)
            g_assert_cmpmem(a->planes[c], sizeof(float) * TEXELS * TEXELS,
                            exr_part_plane(b, a->channels[c]), sizeof(float) * TEXELS * TEXELS);
    }
}

/* A frame that does not say its exposures in numbers is refused by name. */
static void test_exposures(struct fixture *fixture, gconstpointer unused) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Calibration) calibration = calibrated(1);
    fixture_capture(fixture, 0, fixture->n_shots, wrong_exposures);
    g_assert_false(process(fixture, calibration, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_assert_nonnull(strstr(error->message, "000002"));
    g_assert_nonnull(strstr(error->message, "“2000;abc”"));
}

int main(int argc, char **argv) {
    static const struct pipeline_test tests[] = {
        {"/pipeline/sigma/noise", test_noise},
        {"/pipeline/sigma/edge", test_edge},
        {"/pipeline/sigma/scale", test_scale},
        {"/pipeline/sigma/scale-in-file", test_scale_in_file},
        {"/pipeline/sigma/values", test_values},
        {"/pipeline/sigma/outputs", test_outputs},
        {"/pipeline/sigma/exposures", test_exposures},
    };
    return fixture_run_tests(argc, argv, tests, G_N_ELEMENTS(tests));
}
