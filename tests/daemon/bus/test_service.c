/* mesorigd as a service manager sees it: notifications, signals, exit codes, a kill. */
#include "bus/bus_errors.h"
#include "lib/ok.h"
#include "rig1-bus.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "lib/long_session.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#define RIG      SOURCE_DIR "/tests/small/rig.conf"
#define MESORIGD BUILD_DIR "/bin/mesorigd"
#define WAIT_US  (120 * G_USEC_PER_SEC)

G_DEFINE_AUTOPTR_CLEANUP_FUNC(BusRig1, g_object_unref)

struct fixture {
    char *folder, *address, *directory, *session;
    int notify_fd;
    GString *told; /* all notifications, a line each */
    GSubprocess *daemon;
};

static void set_up(struct fixture *fixture, gconstpointer data) {
    struct sockaddr_un at = {.sun_family = AF_UNIX};
    fixture->folder = g_dir_make_tmp("mesorig-service-XXXXXX", NULL);
    fixture->address = g_strdup_printf("unix:path=%s/bus", fixture->folder);
    fixture->directory = g_build_filename(fixture->folder, "small.session", NULL);
    fixture->session = long_session_write(fixture->folder, LONG_RINGS);
    fixture->told = g_string_new("\n");
    g_snprintf(at.sun_path, sizeof(at.sun_path), "%s/notify", fixture->folder);
    fixture->notify_fd = socket(AF_UNIX, SOCK_DGRAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
    g_assert_cmpint(bind(fixture->notify_fd, (struct sockaddr *)&at, sizeof(at)), ==, 0);
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    if (fixture->daemon) {
        g_subprocess_force_exit(fixture->daemon);
        g_subprocess_wait(fixture->daemon, NULL, NULL);
        g_object_unref(fixture->daemon);
    }
    close(fixture->notify_fd);
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->address);
    g_free(fixture->directory);
    g_free(fixture->session);
    g_string_free(fixture->told, TRUE);
}

static void start(struct fixture *fixture, const char *option) {
    g_autofree char *notify = g_build_filename(fixture->folder, "notify", NULL);
    g_autoptr(GSubprocessLauncher) launcher =
        g_subprocess_launcher_new(G_SUBPROCESS_FLAGS_STDOUT_SILENCE);
    g_subprocess_launcher_setenv(launcher, "NOTIFY_SOCKET", notify, TRUE);
    g_subprocess_launcher_setenv(launcher, "WATCHDOG_USEC", "400000", TRUE);
    g_subprocess_launcher_unsetenv(launcher, "WATCHDOG_PID");
    fixture->daemon = ok(g_subprocess_launcher_spawn(launcher, ERR, MESORIGD, "--listen",
                                                     fixture->address, "--rig", RIG, option, NULL));
}

static void collect(struct fixture *fixture) {
    char text[4096];
    ssize_t n;
    while ((n = recv(fixture->notify_fd, text, sizeof(text), 0)) > 0) {
        g_string_append_len(fixture->told, text, n);
        g_string_append_c(fixture->told, '\n');
    }
}

static int count(struct fixture *fixture, const char *words) {
    int n = 0;
    for (const char *at = fixture->told->str; (at = strstr(at, words)); at++)
        n++;
    return n;
}

static void wait_for(struct fixture *fixture, const char *words, int times) {
    const gint64 until = g_get_monotonic_time() + WAIT_US;
    for (collect(fixture); count(fixture, words) < times; collect(fixture)) {
        if (g_get_monotonic_time() > until)
            g_error("never heard “%s”, but: %s", words, fixture->told->str);
        g_usleep(5000);
    }
}

static int wait_for_end(struct fixture *fixture) {
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    collect(fixture);
    return g_subprocess_get_if_exited(fixture->daemon)
               ? g_subprocess_get_exit_status(fixture->daemon)
               : -1;
}

static BusRig1 *join(struct fixture *fixture) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GDBusConnection) connection = g_dbus_connection_new_for_address_sync(
        fixture->address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, &error);
    g_assert_no_error(error);
    BusRig1 *rig = ok(bus_rig1_proxy_new_sync(connection, G_DBUS_PROXY_FLAGS_NONE, NULL,
                                              "/org/mesorig/Rig1", NULL, ERR));
    return rig;
}

static void take_result(GObject *source, GAsyncResult *result, gpointer data) {
    *(GAsyncResult **)data = g_object_ref(result);
}

/* A daemon whose notifications nobody takes waits in the end, as it would not for a service
 * manager. */
static GAsyncResult *wait_for_answer(struct fixture *fixture, GAsyncResult **result) {
    while (!*result) {
        collect(fixture);
        if (!g_main_context_iteration(NULL, FALSE))
            g_usleep(5000);
    }
    return *result;
}

static void capture(struct fixture *fixture, BusRig1 *rig, gboolean process) {
    GVariantBuilder options;
    GAsyncResult *result = NULL;
    g_variant_builder_init(&options, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&options, "{sv}", "process", g_variant_new_boolean(process));
    bus_rig1_call_start(rig, fixture->session, fixture->directory, g_variant_builder_end(&options),
                        NULL, take_result, &result);
    ok(bus_rig1_call_start_finish(rig, wait_for_answer(fixture, &result), ERR));
    g_object_unref(result);
}

static void resume(struct fixture *fixture, BusRig1 *rig) {
    GAsyncResult *result = NULL;
    bus_rig1_call_resume(rig, fixture->directory, g_variant_new("a{sv}", NULL), NULL, take_result,
                         &result);
    ok(bus_rig1_call_resume_finish(rig, wait_for_answer(fixture, &result), ERR));
    g_object_unref(result);
}

static void test_notify(struct fixture *fixture, gconstpointer data) {
    start(fixture, NULL);
    wait_for(fixture, "\nREADY=1\n", 1);
    wait_for(fixture, "\nSTATUS=idle\n", 1);
    wait_for(fixture, "\nWATCHDOG=1\n", 3);
    g_autoptr(BusRig1) rig = join(fixture);
    capture(fixture, rig, FALSE);
    wait_for(fixture, "\nSTATUS=running, ", 1);
    g_subprocess_send_signal(fixture->daemon, SIGTERM);
    g_assert_cmpint(wait_for_end(fixture), ==, 0);
    g_assert_cmpint(count(fixture, "\nSTOPPING=1\n"), ==, 1);
    g_assert_cmpint(count(fixture, "\nREADY=1\n"), ==, 1);
    g_autofree char *control = g_build_filename(fixture->directory, "control", NULL);
    g_assert_false(g_file_test(control, G_FILE_TEST_EXISTS));
}

static void test_signals(struct fixture *fixture, gconstpointer data) {
    start(fixture, NULL);
    wait_for(fixture, "\nREADY=1\n", 1);
    g_subprocess_send_signal(fixture->daemon, GPOINTER_TO_INT(data));
    g_assert_cmpint(wait_for_end(fixture), ==, 0);
}

static void test_exit_with_client(struct fixture *fixture, gconstpointer data) {
    start(fixture, "--exit-with-client");
    wait_for(fixture, "\nREADY=1\n", 1);
    g_autoptr(BusRig1) rig = join(fixture);
    capture(fixture, rig, FALSE);
    g_dbus_connection_close_sync(g_dbus_proxy_get_connection(G_DBUS_PROXY(rig)), NULL, NULL);
    g_assert_cmpint(wait_for_end(fixture), ==, 0);
}

/* Until so many processes have the session directory among their arguments. */
static void wait_for_followers(struct fixture *fixture, guint wanted) {
    const gint64 until = g_get_monotonic_time() + WAIT_US;
    for (;;) {
        g_autoptr(GArray) pids = process_find("cmdline", fixture->directory);
        if (pids->len == wanted)
            return;
        g_assert_cmpint(g_get_monotonic_time(), <, until);
        g_usleep(5000);
    }
}

static void test_follower(struct fixture *fixture, gconstpointer data) {
    const int number = GPOINTER_TO_INT(data);
    start(fixture, NULL);
    wait_for(fixture, "\nREADY=1\n", 1);
    g_autoptr(BusRig1) rig = join(fixture);
    capture(fixture, rig, TRUE);
    wait_for_followers(fixture, 1);
    g_subprocess_send_signal(fixture->daemon, number);
    wait_for_end(fixture);
    wait_for_followers(fixture, 0);
}

static void test_kill(struct fixture *fixture, gconstpointer data) {
    const char *const safe[] = {MESORIGD, "--safe-state", RIG, NULL};
    start(fixture, NULL);
    wait_for(fixture, "\nREADY=1\n", 1);
    g_autoptr(BusRig1) rig = join(fixture);
    capture(fixture, rig, FALSE);
    wait_for(fixture, "\nSTATUS=running, ", 1);
    g_subprocess_send_signal(fixture->daemon, SIGKILL);
    g_assert_cmpint(wait_for_end(fixture), ==, -1);
    g_assert_cmpint(process_run(safe, NULL, NULL), ==, 0);

    /* The socket and the control file that it has left do not matter. */
    g_clear_object(&fixture->daemon);
    g_string_assign(fixture->told, "\n");
    start(fixture, NULL);
    wait_for(fixture, "\nREADY=1\n", 1);
    g_autoptr(BusRig1) again = join(fixture);
    resume(fixture, again);
    wait_for(fixture, "\nSTATUS=done", 1);
}

TEST(usage) {
    static const struct {
        int code;
        const char *words, *argv[5];
    } cases[] = {
        {0, NULL, {MESORIGD, "--version"}},
        {0, NULL, {MESORIGD, "--help"}},
        {2, "--help", {MESORIGD, "--nonsense"}},
        {2, "arguments", {MESORIGD, "rig.conf"}},
        {2, "choose from: system, session", {MESORIGD, "--bus=coach"}},
        {2, "not both", {MESORIGD, "--bus=session", "--listen=unix:path=/tmp/x"}},
        {2, "--listen", {MESORIGD, "--exit-with-client"}},
        {1, "unix:path=", {MESORIGD, "--listen=tcp:host=localhost"}},
        {1, "/no/such", {MESORIGD, "--safe-state", "/no/such/rig.conf"}},
        {1, "/no/such", {MESORIGD, "--listen=unix:path=/tmp/mesorig-x", "--rig", "/no/such"}},
    };
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *text = NULL;
        g_assert_cmpint(process_run(cases[i].argv, NULL, &text), ==, cases[i].code);
        if (cases[i].words && !strstr(text, cases[i].words))
            g_error("%s does not say “%s”: %s", cases[i].argv[1], cases[i].words, text);
    }
}

BEFORE_TESTS {
    bus_errors_register();
#define ADD(path, func, data)                                                                      \
    g_test_add(path, struct fixture, GINT_TO_POINTER(data), set_up, func, tear_down)
    ADD("/service/notify", test_notify, 0);
    ADD("/service/sigint", test_signals, SIGINT);
    ADD("/service/sighup", test_signals, SIGHUP);
    ADD("/service/exit-with-client", test_exit_with_client, 0);
    ADD("/service/follower-ends", test_follower, SIGTERM);
    ADD("/service/follower-ends-after-kill", test_follower, SIGKILL);
    ADD("/service/kill", test_kill, 0);
}
