/* SafeState is answered before other work, whatever clients ask of mesorigd, which runs here as a
 * program of its own. The tests assert an order: the other work has not ended when SafeState is
 * answered. Times depend on the load of the computer, so they are only printed. */
#include "bus/bus.h"
#include "lib/long_session.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"

#include <gio/gio.h>
#include <glib/gstdio.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/stat.h>
#include <time.h>
#include <unistd.h>

#define RIG        SOURCE_DIR "/tests/small/rig.conf"
#define MESORIGD   BUILD_DIR "/bin/mesorigd"
#define WAIT_MS    120000
#define ROUNDS     5
#define MAX_SHARE  0.25 /* of the CPU time that a flood of calls costs mesorigd */
#define N_CALLS    20000
#define FIRST_CALL 1000000 /* serial: beyond those of GDBus */
#define PLAN_RINGS "30:140; 60:140"

struct fixture {
    char *folder, *address;
    GSubprocess *daemon;
    GDBusConnection *client, *operator;
    GAsyncResult *answer; /* of what was asked last */
    int asked;            /* calls that are not answered yet */
};

static GDBusConnection *try_to_join(const char *address) {
    return g_dbus_connection_new_for_address_sync(
        address, G_DBUS_CONNECTION_FLAGS_AUTHENTICATION_CLIENT, NULL, NULL, NULL);
}

static GDBusConnection *join(const char *address) {
    GDBusConnection *connection = NULL;
    for (int ms = 0; ms < WAIT_MS && !(connection = try_to_join(address)); ms += 20)
        g_usleep(20000);
    g_assert_nonnull(connection);
    return connection;
}

static void set_up(struct fixture *fixture, gconstpointer data) {
    fixture->folder = g_dir_make_tmp("mesorig-load-XXXXXX", NULL);
    fixture->address = g_strdup_printf("unix:path=%s/bus", fixture->folder);
    fixture->daemon =
        process_start(G_SUBPROCESS_FLAGS_STDOUT_SILENCE, NULL,
                      (const char *[]){MESORIGD, "--listen", fixture->address, "--rig", RIG, NULL});
    fixture->operator= join(fixture->address);
    fixture->client = join(fixture->address);
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    g_subprocess_force_exit(fixture->daemon);
    g_subprocess_wait(fixture->daemon, NULL, NULL);
    g_clear_object(&fixture->client);
    g_clear_object(&fixture->operator);
    while (fixture->asked > 0) /* GDBus answers what the daemon has not */
        g_main_context_iteration(NULL, TRUE);
    g_clear_object(&fixture->answer);
    g_object_unref(fixture->daemon);
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->address);
}

/* How long one SafeState took: on the clock, and of mesorigd's CPU time. */
struct answer_time {
    double ms, cpu_ms;
};

static int compare(gconstpointer a, gconstpointer b) {
    const double x = ((const struct answer_time *)a)->cpu_ms,
                 y = ((const struct answer_time *)b)->cpu_ms;
    return (x > y) - (x < y);
}

static double cpu_ms(GSubprocess *process) {
    const pid_t pid = (pid_t)atoi(g_subprocess_get_identifier(process));
    struct timespec now;
    clockid_t id;
    g_assert_cmpint(clock_getcpuclockid(pid, &id), ==, 0);
    g_assert_cmpint(clock_gettime(id, &now), ==, 0);
    return (double)now.tv_sec * 1e3 + (double)now.tv_nsec / 1e6;
}

static struct answer_time safe_state(struct fixture *fixture, GDBusConnection *connection) {
    g_autoptr(GError) error = NULL;
    const double cpu_from_ms = cpu_ms(fixture->daemon);
    const gint64 from_us = g_get_monotonic_time();
    g_autoptr(GVariant) answer =
        g_dbus_connection_call_sync(connection, NULL, BUS_PATH, BUS_NAME, "SafeState", NULL, NULL,
                                    G_DBUS_CALL_FLAGS_NONE, WAIT_MS, NULL, &error);
    g_assert_no_error(error);
    return (struct answer_time){(double)(g_get_monotonic_time() - from_us) / 1e3,
                                cpu_ms(fixture->daemon) - cpu_from_ms};
}

/* Returns the median, in milliseconds of CPU time. */
static double print_times(struct answer_time *times) {
    qsort(times, ROUNDS, sizeof *times, compare);
    const struct answer_time *median = &times[ROUNDS / 2], *most = &times[ROUNDS - 1];
    g_test_message("SafeState of another client: after %.1f ms of CPU time in the middle of %d "
                   "(%.1f ms on the clock), %.1f ms (%.1f ms) at most",
                   median->cpu_ms, ROUNDS, median->ms, most->cpu_ms, most->ms);
    return median->cpu_ms;
}

static void take_answer(GObject *source, GAsyncResult *result, gpointer data) {
    struct fixture *fixture = data;
    fixture->asked--;
    g_set_object(&fixture->answer, result);
}

static void ask(struct fixture *fixture, const char *method, GVariant *parameters) {
    fixture->asked++;
    g_dbus_connection_call(fixture->client, NULL, BUS_PATH, BUS_NAME, method, parameters, NULL,
                           G_DBUS_CALL_FLAGS_NONE, WAIT_MS * 10, NULL, take_answer, fixture);
    g_assert_true(g_dbus_connection_flush_sync(fixture->client, NULL, NULL));
    g_usleep(300000);
}

static gboolean is_answered(struct fixture *fixture) {
    while (g_main_context_iteration(NULL, FALSE))
        ;
    return fixture->answer != NULL;
}

static void append_calls(GByteArray *bytes, guint32 first, GDBusMessageFlags flags) {
    for (guint32 i = 0; i < N_CALLS; i++) {
        gsize size;
        g_autoptr(GDBusMessage) message = g_dbus_message_new_method_call(
            NULL, BUS_PATH, "org.freedesktop.DBus.Properties", "GetAll");
        g_dbus_message_set_body(message, g_variant_new("(s)", BUS_NAME));
        g_dbus_message_set_serial(message, first + i);
        g_dbus_message_set_flags(message, flags);
        g_autofree guchar *blob =
            ok(g_dbus_message_to_blob(message, &size, G_DBUS_CAPABILITY_FLAGS_NONE, ERR));
        g_byte_array_append(bytes, blob, (guint)size);
    }
}

/* All at the same time, past GDBus of this process, which would take longer than the daemon. */
static void write_calls(GDBusConnection *connection, const GByteArray *bytes) {
    GSocketConnection *stream = G_SOCKET_CONNECTION(g_dbus_connection_get_stream(connection));
    const int fd = g_socket_get_fd(g_socket_connection_get_socket(stream));
    for (gsize at = 0; at < bytes->len;) {
        struct pollfd wait = {.fd = fd, .events = POLLOUT};
        const ssize_t n = write(fd, bytes->data + at, bytes->len - at);
        g_assert_true(n > 0 || errno == EAGAIN);
        at += (gsize)MAX(n, 0);
        if (n <= 0)
            g_assert_cmpint(poll(&wait, 1, WAIT_MS), ==, 1);
    }
}

struct flood {
    GDBusConnection *hostile;
    GByteArray *calls;
    gint written; /* atomic */
};

static gpointer write_flood(gpointer data) {
    struct flood *flood = data;
    write_calls(flood->hostile, flood->calls);
    g_atomic_int_set(&flood->written, 1);
    return NULL;
}

/* While the calls come in, and when they are all there. */
static void check_flood(struct fixture *fixture, GDBusMessageFlags flags) {
    struct answer_time times[ROUNDS];
    struct flood flood = {join(fixture->address), g_byte_array_new(), 0};
    append_calls(flood.calls, FIRST_CALL, flags);
    const double cpu_from_ms = cpu_ms(fixture->daemon);
    GThread *thread = g_thread_new("flood", write_flood, &flood);
    for (int i = 0; i < ROUNDS; i++) {
        g_usleep(20000);
        times[i] = safe_state(fixture, fixture->operator);
    }
    g_test_message("calls were %s then", g_atomic_int_get(&flood.written) ? "sent" : "being sent");
    g_thread_join(thread);
    const struct answer_time behind = safe_state(fixture, fixture->operator);
    const struct answer_time own = safe_state(fixture, flood.hostile);
    g_test_message("SafeState when all were sent: after %.1f ms of CPU time (%.1f ms)",
                   behind.cpu_ms, behind.ms);
    g_test_message("SafeState of the client itself, which reads all its other answers first: "
                   "%.1f ms",
                   own.ms);
    const double flood_ms = cpu_ms(fixture->daemon) - cpu_from_ms;
    g_test_message("all calls: %.1f ms of CPU time", flood_ms);
    g_assert_cmpfloat(print_times(times), <, MAX_SHARE * flood_ms);
    g_dbus_connection_close_sync(flood.hostile, NULL, NULL);
    g_object_unref(flood.hostile);
    g_byte_array_unref(flood.calls);
}

static void test_queued_calls(struct fixture *fixture, gconstpointer data) {
    check_flood(fixture, G_DBUS_MESSAGE_FLAGS_NONE);
}

static void test_queued_messages(struct fixture *fixture, gconstpointer data) {
    check_flood(fixture, G_DBUS_MESSAGE_FLAGS_NO_REPLY_EXPECTED);
}

/* A client that asks for no more than a few things at the same time is never refused. */
static void test_others_served(struct fixture *fixture, gconstpointer data) {
    g_autoptr(GByteArray) bytes = g_byte_array_new();
    g_autoptr(GError) error = NULL;
    append_calls(bytes, FIRST_CALL, G_DBUS_MESSAGE_FLAGS_NO_REPLY_EXPECTED);
    write_calls(fixture->client, bytes);
    for (int i = 0; i < 50; i++) {
        g_autoptr(GVariant) answer = g_dbus_connection_call_sync(
            fixture->operator, NULL, BUS_PATH, "org.freedesktop.DBus.Properties", "Get",
            g_variant_new("(ss)", BUS_NAME, "State"), NULL, G_DBUS_CALL_FLAGS_NONE, WAIT_MS, NULL,
            &error);
        g_assert_no_error(error);
    }
}

static void test_largest_plan(struct fixture *fixture, gconstpointer data) {
    struct answer_time times[ROUNDS];
    g_autofree char *path = long_session_write(fixture->folder, PLAN_RINGS);
    ask(fixture, "Validate", g_variant_new("(ssa{sv})", path, "", NULL));
    for (int i = 0; i < ROUNDS; i++)
        times[i] = safe_state(fixture, fixture->operator);
    g_assert_false(is_answered(fixture)); /* it is planned still */
    print_times(times);
}

static void check_start(struct fixture *fixture, const char *calibration) {
    struct answer_time times[ROUNDS];
    GVariantBuilder options;
    g_autoptr(GError) error = NULL;
    g_autofree char *directory = g_build_filename(fixture->folder, "small.session", NULL);
    g_variant_builder_init(&options, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&options, "{sv}", "calibration", g_variant_new_string(calibration));
    ask(fixture, "Start",
        g_variant_new("(ssa{sv})", SOURCE_DIR "/tests/small/session.conf", directory, &options));
    for (int i = 0; i < ROUNDS; i++)
        times[i] = safe_state(fixture, fixture->operator);
    while (!is_answered(fixture))
        g_main_context_iteration(NULL, TRUE);
    g_assert_null(g_dbus_connection_call_finish(fixture->client, fixture->answer, &error));
    g_assert_nonnull(error);
    g_test_message("%s", error->message);
    g_assert_false(g_file_test(directory, G_FILE_TEST_EXISTS));
    print_times(times);
}

static void test_fifo(struct fixture *fixture, gconstpointer data) {
    g_autofree char *path = g_build_filename(fixture->folder, "calibration.conf", NULL);
    g_assert_cmpint(mkfifo(path, 0600), ==, 0);
    check_start(fixture, path);
}

static void test_endless(struct fixture *fixture, gconstpointer data) {
    check_start(fixture, "/dev/zero");
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
#define ADD(path, func) g_test_add(path, struct fixture, NULL, set_up, func, tear_down)
    ADD("/bus-load/queued-calls", test_queued_calls);
    ADD("/bus-load/queued-messages", test_queued_messages);
    ADD("/bus-load/others-served", test_others_served);
    ADD("/bus-load/largest-plan", test_largest_plan);
    ADD("/bus-load/fifo", test_fifo);
    ADD("/bus-load/endless", test_endless);
    return g_test_run();
}
