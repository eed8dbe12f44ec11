/* A session through USB and V4L2 only: the axes of the small rig are Tics, its lamps and lasers are
 * connected to relay boards, and its cameras are V4L2 cameras and one USB3 Vision camera. All share
 * one world, and the programs capture the session in real time. Its frames and products are those
 * of the simulated drivers, except for the noise. */
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/twin_sessions.h"

#include "virtual/rig/rig.h"
#include "virtual/testbed.h"

#include <gio/gio.h>
#include <signal.h>

#define SMALL  SOURCE_DIR "/tests/small/"
#define BIN(x) BUILD_DIR "/bin/" x

static void runs(const char *const *argv) {
    g_free(process_text(0, argv));
}

static void capture_usb(const char *name) {
    g_autofree char *path = twin_path("usb.conf"), *socket = twin_path("bus"),
                    *session = twin_path(name);
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    GError *error = NULL;
    const struct virtual_rig_kinds kinds = {.usb = (const char *[]){"all", NULL},
                                            .u3v = (const char *[]){"cam30", NULL}};
    g_autoptr(VirtualRig) rig = virtual_rig_new(SMALL "rig.conf", &kinds, &error);
    g_assert_no_error(error);
    g_assert_true(g_file_set_contents(path, virtual_rig_text(rig), -1, NULL));
    g_autoptr(GSubprocess) daemon =
        twin_start_daemon(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL, path, address);
    runs((const char *[]){BIN("mesorig"), "capture", "--address", address, path,
                          SMALL "session.conf", "-o", session, NULL});
    g_subprocess_send_signal(daemon, SIGTERM);
    g_subprocess_wait(daemon, NULL, NULL);
    g_assert_true(g_subprocess_get_successful(daemon));
    /* All is left dark and still. */
    struct virtual_rig_state state;
    virtual_rig_state(rig, &state);
    g_assert_cmpint(state.n_lit, ==, 0);
    g_assert_cmpint(state.n_moving, ==, 0);
    runs((const char *[]){BIN("mesorig"), "process", session, NULL});
}

/* What the daemon says from its start with this rig to its end; g_free(). */
static char *daemon_says(VirtualRig *rig) {
    g_autofree char *path = twin_path("warned.conf"), *socket = twin_path("warned-bus"),
                    *said = NULL;
    g_autofree char *address = g_strdup_printf("unix:path=%s", socket);
    g_assert_true(g_file_set_contents(path, virtual_rig_text(rig), -1, NULL));
    g_autoptr(GSubprocess) daemon =
        twin_start_daemon(G_SUBPROCESS_FLAGS_STDERR_PIPE, NULL, path, address);
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
TEST(warning) {
    const struct virtual_rig_kinds kinds = {.usb = (const char *[]){"all", NULL},
                                            .u3v = (const char *[]){"cam30", NULL}};
    for (int usb = 1; usb >= 0; usb--) {
        GError *error = NULL;
        g_autoptr(VirtualRig) rig = virtual_rig_new(SMALL "rig.conf", usb ? &kinds : NULL, &error);
        g_assert_no_error(error);
        g_autofree char *said = daemon_says(rig);
        g_assert_cmpint(count(said, "no watchdog is set up"), ==, usb ? 2 : 0);
        g_assert_cmpint(
            count(said, "laser laser30: no watchdog is set up for its device (usb-relay-laser)"),
            ==, usb);
        g_assert_cmpint(
            count(said, "laser laser60: no watchdog is set up for its device (usb-relay-laser)"),
            ==, usb);
        g_assert_cmpint(count(said, "docs/operate/safety.md"), ==, usb ? 2 : 0);
    }
}

TEST(session) {
    capture_usb("usb.session");
    twin_assert_noise_alone("usb.session");
}

BEFORE_TESTS {
    twin_folder = g_dir_make_tmp("mesorig-usb-XXXXXX", NULL);
}

AFTER_TESTS {
    remove_tree(twin_folder);
    g_free(twin_folder);
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    return tests_run(argc, argv);
}
