#include "twin_sessions.h"
#include "lib/ok.h"

#include "process.h"

#include <math.h>
#include <string.h>

#define SMALL SOURCE_DIR "/tests/small/"

char *twin_folder;

char *twin_path(const char *name) {
    return g_build_filename(twin_folder, name, NULL);
}

struct difference twin_compare(const char *a, const char *b, const char *folder, gboolean holes) {
    struct difference difference;
    g_autofree char *in_a = twin_path(a), *in_b = twin_path(b);
    ok(difference_folder(in_a, in_b, folder, holes, &difference, ERR));
    g_assert_cmpint(difference.n_files, >, 0);
    g_assert_cmpint(difference.n_values, >, 0);
    g_test_message("%s and %s, %s: RMS %.5f, mean %+.5f, seen differently %.4f", a, b, folder,
                   difference.rms, difference.systematic, difference.seen_differently);
    return difference;
}

double twin_value(const char *name, const char *key) {
    g_autofree char *path = twin_path(name);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    g_assert_no_error(error);
    g_autofree char *text = session_value(session, key);
    g_assert_nonnull(text);
    return g_ascii_strtod(text, NULL);
}

void twin_capture_simulated(const char *name, const char *seed) {
    static const char *const mesorig = BUILD_DIR "/bin/mesorig";
    g_autofree char *rig = twin_path("rig.conf"), *world = twin_path("world.conf");
    g_autofree char *session = twin_path(name), *rig_text = NULL, *text = NULL;
    g_assert_true(g_file_get_contents(SMALL "rig.conf", &rig_text, NULL, NULL));
    g_assert_true(g_file_get_contents(SMALL "world.conf", &text, NULL, NULL));
    g_auto(GStrv) parts = g_strsplit(text, "seed = 7", 2);
    g_assert_nonnull(parts[1]);
    g_autofree char *changed = g_strconcat(parts[0], "seed = ", seed, parts[1], NULL);
    g_assert_true(g_file_set_contents(rig, rig_text, -1, NULL));
    g_assert_true(g_file_set_contents(world, changed, -1, NULL));
    g_free(process_text(
        0, (const char *[]){mesorig, "capture", rig, SMALL "session.conf", "-o", session, NULL}));
    g_free(process_text(0, (const char *[]){mesorig, "process", session, NULL}));
}

void twin_assert_noise_alone(const char *name) {
    static const struct {
        const char *folder;
        gboolean holes;
    } kinds[] = {{"frames", FALSE}, {"products/btf", FALSE}, {"products", TRUE}};
    twin_capture_simulated("simulated.session", "7");
    twin_capture_simulated("other.session", "8");
    g_assert_cmpfloat(twin_value(name, "frames"), ==, twin_value("simulated.session", "frames"));
    g_assert_cmpfloat(twin_value(name, "retakes"), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        struct difference noise =
            twin_compare("simulated.session", "other.session", kinds[i].folder, kinds[i].holes);
        struct difference real =
            twin_compare("simulated.session", name, kinds[i].folder, kinds[i].holes);
        g_assert_cmpfloat(noise.rms, >, 0);
        g_assert_cmpfloat(real.rms, >, 0); /* the noise differs */
        g_assert_cmpfloat(real.rms, <, 1.4 * noise.rms);
        g_assert_cmpfloat(fabs(real.systematic), <, noise.rms);
        g_assert_cmpfloat(real.seen_differently, <, noise.seen_differently + 0.05);
    }
}

GSubprocess *twin_start_daemon(GSubprocessFlags flags, const char *log, const char *rig,
                               const char *address) {
    return process_start_ready(
        flags, log,
        (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen", address, "--rig", rig, NULL});
}
