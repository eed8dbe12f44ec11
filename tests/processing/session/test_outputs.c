/* The outputs of the lamps that fiducials have shown: means, interpolation between measured shots
 * of a lamp, and invalid values in the database. */
#include "lib/ok.h"
#include "lib/test.h"
#include "session/outputs.h"

#include <math.h>

#include "lib/session_fixture.h"

#define N 8

/* Two lamps in turns, with a dark frame among them. */
static GPtrArray *new_shots(void) {
    static const int lamps[N] = {0, 1, 0, -1, 0, 1, 0, 1};
    GPtrArray *shots = g_ptr_array_new_with_free_func(g_free);
    for (int i = 0; i < N; i++) {
        struct session_shot *shot = g_new0(struct session_shot, 1);
        shot->id = i + 1;
        shot->kind = lamps[i] < 0 ? SHOT_DARK : SHOT_LAMP;
        shot->device = lamps[i];
        g_ptr_array_add(shots, shot);
    }
    return shots;
}

static void store(Session *session, gint64 shot, const char *camera, double output, double own) {
    g_assert_true(ok(outputs_store(session, shot, camera, output, own, ERR)));
}

static void assert_outputs(Session *session, const GPtrArray *shots, int measured,
                           const double expected[N]) {
    struct outputs *outputs = ok(outputs_load(session, shots, ERR));
    for (int i = 0; i < N; i++) {
        measured -= outputs_error(outputs, i + 1) > 0;
        g_assert_cmpfloat_with_epsilon(outputs_of(outputs, i + 1), expected[i], 1e-9);
    }
    g_assert_cmpint(measured, ==, 0);
    g_assert_cmpfloat(outputs_of(outputs, 0), ==, 1);
    g_assert_cmpfloat(outputs_of(outputs, N + 1), ==, 1);
    outputs_free(outputs);
}

TEST(interpolation) {
    g_autofree char *path = session_fixture_path("outputs");
    g_autoptr(Session) session = session_fixture_create(path, 1, N);
    g_autoptr(GPtrArray) shots = new_shots();
    outputs_free(NULL);
    assert_outputs(session, shots, 0, (const double[N]){1, 1, 1, 1, 1, 1, 1, 1});
    /* Lamp 0 falls from 1.2 in shot 3 to 0.8 in shot 7; lamp 1 is not measured. */
    store(session, 3, "cam30", 1.2, 0.01);
    store(session, 7, "cam30", 0.8, 0.01);
    assert_outputs(session, shots, 2, (const double[N]){1.2, 1, 1.2, 1, 1.0, 1, 0.8, 1});
    /* Two cameras, equally good: their mean. A later take replaces the first. */
    store(session, 2, "cam30", 3, 0.02);
    store(session, 2, "cam30", 1.1, 0.02);
    store(session, 2, "cam60", 1.3, 0.02);
    assert_outputs(session, shots, 3, (const double[N]){1.2, 1.2, 1.2, 1, 1.0, 1.2, 0.8, 1.2});
}

TEST(bad) {
    static const char *const bad[][2] = {
        {"x/cam30", "1 0.1"},   {"0/cam30", "1 0.1"},  {"9/cam30", "1 0.1"},
        {"3", "1 0.1"},         {"3/cam30", "1"},      {"3/cam30", "1 0.1 2"},
        {"3/cam30", "dim 0.1"}, {"3/cam30", ""},       {"3/cam30", "nan 0.1"},
        {"3/cam30", "0 0.1"},   {"3/cam30", "-1 0.1"}, {"3/cam30", "1e9 0.1"},
        {"3/cam30", "1 -0.1"},  {"3/cam30", "1 nan"},  {"3/cam30", "1 1e9"},
        {"3/cam30", "1 much"},
    };
    g_autoptr(GPtrArray) shots = new_shots();
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autofree char *name = g_strdup_printf("bad-%d", (int)i);
        g_autofree char *path = session_fixture_path(name);
        g_autofree char *key = g_strconcat("lamp_output/", bad[i][0], NULL);
        g_autoptr(Session) session = session_fixture_create(path, 1, N);
        g_autoptr(GError) error = NULL;
        g_assert_true(session_set_value(session, key, bad[i][1], &error));
        if (outputs_load(session, shots, &error))
            g_error("%s = “%s” is taken for an output", key, bad[i][1]);
        g_assert_error(error, SESSION_ERROR, SESSION_ERROR_FORMAT);
        g_assert_nonnull(strstr(error->message, key));
    }
}

TESTS_RUN_BY(session_fixture_run);
