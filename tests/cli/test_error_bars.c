/* What info, check and compare print about the error bars of a BTF: for a session whose pictures
 * have the noise that its calibration states, and for a session without a calibration of the noise.
 */
#include "btf/btf_sigma.h"
#include "lib/ok.h"
#include "lib/pipeline_fixture.h"
#include "lib/process.h"

static guint32 seed;
static double gain_dn_e;
static gint64 short_shot = -1; /* exposed for a hundredth of the time */

/* Photons of one exposure of 10 ms. */
static void noisy(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind != SHOT_LAMP)
        return;
    GRand *random = g_rand_new_with_seed(seed++);
    for (int i = 0; i < SIDE * SIDE; i++) {
        const double normal =
            sqrt(-2 * log(1 - g_rand_double(random))) * cos(2 * G_PI * g_rand_double(random));
        const double value = (double)part->planes[0][i];
        part->planes[0][i] = (float)(value + sqrt(gain_dn_e * value / 10) * normal);
    }
    g_rand_free(random);
    exr_set_string(part, "mesorig.exposures_us", shot->id == short_shot ? "100" : "10000");
}

static void process(const struct fixture *fixture) {
    const struct rig rig = fixture_make_rig();
    g_autoptr(Calibration) calibration = calibration_new(&rig);
    for (int i = 0; i < N_CAMERAS; i++)
        calibration->noise[i] = (struct calibration_noise){TRUE, {.gain_dn_e = gain_dn_e}};
    g_autofree char *text = calibration_to_text(calibration);
    struct pipeline_options options = {.n_eigenmaps = 2, .calibration = text};
    struct pipeline_result result;
    ok(pipeline_run(fixture->path, &options, &result, ERR));
}

static double number(const char *json, const char *key) {
    g_autofree char *quoted = g_strdup_printf("\"%s\":", key);
    const char *at = strstr(json, quoted);
    if (!at)
        g_error("no %s in %s", key, json);
    return g_ascii_strtod(at + strlen(quoted), NULL);
}

/* The median of the pictures' medians, and no warning. */
static void test_medians(struct fixture *fixture, gconstpointer unused) {
    gain_dn_e = 0.05;
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    process(fixture);
    double least = INFINITY, most = 0;
    for (int view = 0; view < N_VIEWS; view++) {
        g_autofree char *name = g_strdup_printf("btf/view_%04d.exr", view);
        g_autofree char *path = fixture_product(fixture, name);
        g_autoptr(ExrFile) file = exr_read(path, NULL);
        for (guint k = 0; k < file->parts->len; k++) {
            struct btf_sigma sigma;
            g_assert_true(btf_sigma_read(file->parts->pdata[k], &sigma));
            least = fmin(least, sigma.median);
            most = fmax(most, sigma.median);
        }
    }
    g_autofree char *json = process_mesorig(0, "info --json %s", fixture->path);
    g_assert_cmpfloat(number(json, "btf_sigma_median"), >=, least);
    g_assert_cmpfloat(number(json, "btf_sigma_median"), <=, most);
    g_assert_cmpfloat(number(json, "btf_sigma_known"), ==, N_VIEWS * N_LIGHTS);
    g_autofree char *info = process_mesorig(0, "info %s", fixture->path);
    assert_has(info, "error bars median σ");
    g_autofree char *check = process_mesorig(0, "check %s", fixture->path);
    assert_has(check, "error bars   median σ");
    g_assert_null(strstr(check, "warning"));
}

/* Pictures with two thousand times the photon noise's variance. */
static void test_large(struct fixture *fixture, gconstpointer unused) {
    gain_dn_e = 100;
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    process(fixture);
    g_autofree char *check = process_mesorig(0, "check %s", fixture->path);
    assert_has(check, "in 12 of 12 pictures σ is more than 5 %");
    g_assert_null(strstr(check, "warning")); /* none is worse than the others */
    g_autofree char *json = process_mesorig(0, "check --json %s", fixture->path);
    g_assert_cmpfloat(number(json, "sigma_worst"), >, 0.05);
}

static void find_lamp(struct exr_part *part, const struct session_shot *shot) {
    if (shot->kind == SHOT_LAMP)
        short_shot = shot->id;
}

/* Pictures that are worse than the others are warned of, and only these. */
static void test_worse(struct fixture *fixture, gconstpointer unused) {
    gain_dn_e = 0.5;
    fixture_capture(fixture, 0, fixture->n_shots, find_lamp);
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    process(fixture);
    short_shot = -1;
    g_autofree char *check = process_mesorig(0, "check %s", fixture->path);
    g_autofree char *json = process_mesorig(0, "check --json %s", fixture->path);
    const int worse = (int)number(json, "sigma_worse");
    g_assert_cmpint(worse, >, 0);
    g_assert_cmpint(worse, <=, N_CAMERAS);
    g_autofree char *words =
        g_strdup_printf("warning: in %d of 12 pictures σ is more than twice", worse);
    assert_has(check, words);
}

/* Two captures of one sample differ by their noise, and by nothing else. */
static void test_twice(struct fixture *fixture, gconstpointer unused) {
    gain_dn_e = 2;
    g_autofree char *first = g_strconcat(fixture->folder, "/first.session", NULL);
    const char *const copy[] = {"cp", "-r", fixture->path, first, NULL};
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    process(fixture);
    g_assert_cmpint(process_run(copy, NULL, NULL), ==, 0);
    fixture_capture(fixture, 0, fixture->n_shots, noisy);
    process(fixture);
    g_autofree char *json = process_mesorig(0, "compare --json %s %s", first, fixture->path);
    g_assert_cmpfloat(number(json, "sigma"), >, 0);
    g_test_message("σ is %.3f of the difference", number(json, "sigma") / number(json, "error"));
    g_assert_cmpfloat_with_epsilon(number(json, "sigma") / number(json, "error"), 1, 0.15);
    g_autofree char *text = process_mesorig(0, "compare %s %s", first, fixture->path);
    assert_has(text, "they explain");
    g_autofree char *maps = fixture_product(fixture, "eigenmaps.exr");
    g_autofree char *other = process_mesorig(0, "compare --json %s %s", maps, first);
    g_assert_cmpfloat(number(other, "sigma_known"), ==, N_VIEWS * N_LIGHTS);
}

/* A session without them says so. */
static void test_unknown(struct fixture *fixture, gconstpointer unused) {
    fixture_capture(fixture, 0, fixture->n_shots, NULL);
    fixture_process(fixture, 2, FALSE);
    g_autofree char *check = process_mesorig(0, "check %s", fixture->path);
    assert_has(check, "error bars   not known");
    g_autofree char *info = process_mesorig(0, "info %s", fixture->path);
    g_assert_null(strstr(info, "error bars"));
    g_autofree char *compare = process_mesorig(0, "compare %s %s", fixture->path, fixture->path);
    assert_has(compare, "error bars not known");
}

int main(int argc, char **argv) {
    static const struct pipeline_test tests[] = {
        {"/cli/error-bars/medians", test_medians}, {"/cli/error-bars/large", test_large},
        {"/cli/error-bars/worse", test_worse},     {"/cli/error-bars/twice", test_twice},
        {"/cli/error-bars/unknown", test_unknown},
    };
    return fixture_run_tests(argc, argv, tests, G_N_ELEMENTS(tests));
}
