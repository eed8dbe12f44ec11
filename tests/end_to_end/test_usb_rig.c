/* A session through USB and V4L2 alone: the small rig's axes are Tics, its lamps and lasers hang on
 * relay boards, its cameras are V4L2's and one USB3 Vision's, all over one world, and the programs
 * capture it in real time. Its frames and products are those of the simulated drivers, but for the
 * noise. */
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/twin_sessions.h"

#include "virtual/testbed.h"
#include "virtual_rig/rig.h"

#include <gio/gio.h>
#include <signal.h>

#define SMALL  SOURCE_DIR "/tests/small/"
#define BIN(x) BUILD_DIR "/bin/" x

static void runs(const char *const *argv) {
    g_free(process_text(0, argv));
}

/* All is left dark and still. */
static void assert_safe(VirtualRig *rig) {
    struct virtual_rig_state state;
    virtual_rig_state(rig, &state);
    g_assert_cmpint(state.n_lit, ==, 0);
    g_assert_cmpint(state.n_moving, ==, 0);
}

static void capture_usb(const char *name) {
    g_autofree char *path = twin_path("usb.conf"), *socket = twin_path("bus"),
                    *session = twin_path(name);
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    GError *error = NULL;
    g_autoptr(VirtualRig) rig = virtual_rig_new(SMALL "rig.conf", (const char *[]){"all", NULL},
                                                (const char *[]){"cam30", NULL}, &error);
    g_assert_no_error(error);
    g_assert_true(g_file_set_contents(path, virtual_rig_text(rig), -1, NULL));
    g_autoptr(GSubprocess) daemon =
        process_start(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                      (const char *[]){BIN("mesorigd"), "--listen", address, "--rig", path, NULL});
    for (int i = 0; i < 3000 && !g_file_test(socket, G_FILE_TEST_EXISTS); i++)
        g_usleep(10000);
    runs((const char *[]){BIN("mesorig"), "capture", "--address", address, path,
                          SMALL "session.conf", "-o", session, NULL});
    g_subprocess_send_signal(daemon, SIGTERM);
    g_subprocess_wait(daemon, NULL, NULL);
    g_assert_true(g_subprocess_get_successful(daemon));
    assert_safe(rig);
    runs((const char *[]){BIN("mesorig"), "process", session, NULL});
}

/* What the daemon says from its start with this rig to its end; g_free(). */
static char *daemon_says(VirtualRig *rig) {
    g_autofree char *path = twin_path("warned.conf"), *socket = twin_path("warned-bus"),
                    *said = NULL;
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    g_assert_true(g_file_set_contents(path, virtual_rig_text(rig), -1, NULL));
    g_autoptr(GSubprocess) daemon =
        process_start(G_SUBPROCESS_FLAGS_STDERR_PIPE, NULL,
                      (const char *[]){BIN("mesorigd"), "--listen", address, "--rig", path, NULL});
    for (int i = 0; i < 3000 && !g_file_test(socket, G_FILE_TEST_EXISTS); i++)
        g_usleep(10000);
    g_subprocess_send_signal(daemon, SIGTERM);
    g_assert_true(g_subprocess_communicate_utf8(daemon, NULL, NULL, NULL, &said, NULL));
    g_assert_true(g_subprocess_get_successful(daemon));
    return g_steal_pointer(&said);
}

static int count(const char *text, const char *words) {
    int n = 0;
    for (; (text = strstr(text, words)); text++)
        n++;
    return n;
}

/* USB relay boards have no watchdog: that is said once of each laser, and of none that has one. */
static void test_warning(void) {
    const char *const all[] = {"all", NULL}, *const camera[] = {"cam30", NULL};
    for (int usb = 1; usb >= 0; usb--) {
        GError *error = NULL;
        g_autoptr(VirtualRig) rig =
            virtual_rig_new(SMALL "rig.conf", usb ? all : NULL, usb ? camera : NULL, &error);
        g_assert_no_error(error);
        g_autofree char *said = daemon_says(rig);
        g_assert_cmpint(count(said, "has no watchdog"), ==, usb ? 2 : 0);
        g_assert_cmpint(count(said, "laser laser30: its device (usb-relay-laser) has no watchdog"),
                        ==, usb);
        g_assert_cmpint(count(said, "laser laser60: its device (usb-relay-laser) has no watchdog"),
                        ==, usb);
        g_assert_cmpint(count(said, "docs/safety.md"), ==, usb ? 2 : 0);
    }
}

/* The same rig, with other noise. */
static void capture_simulated(const char *name, const char *seed) {
    g_autofree char *rig = twin_path("rig.conf"), *world = twin_path("world.conf");
    g_autofree char *session = twin_path(name), *rig_text = NULL, *text = NULL;
    g_assert_true(g_file_get_contents(SMALL "rig.conf", &rig_text, NULL, NULL));
    g_assert_true(g_file_get_contents(SMALL "world.conf", &text, NULL, NULL));
    g_auto(GStrv) parts = g_strsplit(text, "seed = 7", 2);
    g_assert_nonnull(parts[1]);
    g_autofree char *changed = g_strconcat(parts[0], "seed = ", seed, parts[1], NULL);
    g_assert_true(g_file_set_contents(rig, rig_text, -1, NULL));
    g_assert_true(g_file_set_contents(world, changed, -1, NULL));
    runs((const char *[]){BIN("mesorig"), "capture", rig, SMALL "session.conf", "-o", session,
                          NULL});
    runs((const char *[]){BIN("mesorig"), "process", session, NULL});
}

static void test_session(void) {
    static const struct {
        const char *folder;
        gboolean holes;
    } kinds[] = {{"frames", FALSE}, {"products/btf", FALSE}, {"products", TRUE}};
    capture_usb("usb.session");
    capture_simulated("simulated.session", "7");
    capture_simulated("other.session", "8");
    g_assert_cmpfloat(twin_value("usb.session", "frames"), ==,
                      twin_value("simulated.session", "frames"));
    g_assert_cmpfloat(twin_value("usb.session", "retakes"), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++) {
        struct difference noise =
            twin_compare("simulated.session", "other.session", kinds[i].folder, kinds[i].holes);
        struct difference real =
            twin_compare("simulated.session", "usb.session", kinds[i].folder, kinds[i].holes);
        g_assert_cmpfloat(real.rms, >, 0); /* other noise */
        g_assert_cmpfloat(real.rms, <, 1.4 * noise.rms);
        g_assert_cmpfloat(fabs(real.systematic), <, noise.rms);
        g_assert_cmpfloat(real.seen_differently, <, noise.seen_differently + 0.05);
    }
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    g_test_init(&argc, &argv, NULL);
    twin_folder = g_dir_make_tmp("mesorig-usb-XXXXXX", NULL);
    g_test_add_func("/usb-rig/warning", test_warning);
    g_test_add_func("/usb-rig/session", test_session);
    int failed = g_test_run();
    remove_tree(twin_folder);
    g_free(twin_folder);
    return failed;
}
