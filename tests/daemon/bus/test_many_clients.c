/* More clients than a daemon can have: a full table of descriptors, and one program that connects
 * again and again. Meanwhile connected clients are served and the log stays short, and afterwards
 * new clients are accepted again. */
#include "bus/bus.h"
#include "bus/bus_client.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/small_rig.h"
#include "lib/wait.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <poll.h>
#include <signal.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#define MANY    100  /* connections */
#define OF_ONE  64   /* that one process may have (bus_server.c) */
#define MAX_LOG 4000 /* bytes; a daemon that does not rest writes hundreds of thousands in 3 s */

struct fixture {
    char *folder, *address, *log;
    GSubprocess *daemon;
    pid_t pid;
    GDBusConnection *client;
    struct rlimit limit;
    int sockets[MANY];
};

static void assert_answers(GDBusConnection *client) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GVariant) answer =
        g_dbus_connection_call_sync(client, NULL, BUS_PATH, BUS_NAME, "SafeState", NULL, NULL,
                                    G_DBUS_CALL_FLAGS_NONE, -1, NULL, &error);
    g_assert_no_error(error);
    g_assert_nonnull(answer);
}

static void set_up(struct fixture *fixture, gconstpointer unused) {
    fixture->folder = g_dir_make_tmp("mesorig-many-XXXXXX", NULL);
    fixture->address = g_strdup_printf("unix:path=%s/bus", fixture->folder);
    fixture->log = g_build_filename(fixture->folder, "log", NULL);
    small_rig_write(fixture->folder, "rig.conf", NULL);
    small_rig_write(fixture->folder, "world.conf", NULL);
    g_autofree char *rig = g_build_filename(fixture->folder, "rig.conf", NULL);
    fixture->daemon = process_start_ready(G_SUBPROCESS_FLAGS_NONE, fixture->log,
                                          (const char *[]){BUILD_DIR "/bin/mesorigd", "--listen",
                                                           fixture->address, "--rig", rig, NULL});
    fixture->pid = atoi(g_subprocess_get_identifier(fixture->daemon));
    fixture->client = ok(bus_client_connect(fixture->address, ERR));
    assert_answers(fixture->client); /* the daemon's side has joined as well */
    g_assert_cmpint(prlimit(fixture->pid, RLIMIT_NOFILE, NULL, &fixture->limit), ==, 0);
    memset(fixture->sockets, -1, sizeof fixture->sockets);
}

static void disconnect(struct fixture *fixture) {
    for (int i = 0; i < MANY; i++)
        if (fixture->sockets[i] >= 0)
            close(fixture->sockets[i]);
    memset(fixture->sockets, -1, sizeof fixture->sockets);
}

static void tear_down(struct fixture *fixture, gconstpointer unused) {
    disconnect(fixture);
    g_clear_object(&fixture->client);
    g_subprocess_send_signal(fixture->daemon, SIGTERM);
    g_assert_true(g_subprocess_wait(fixture->daemon, NULL, NULL));
    g_assert_true(g_subprocess_get_successful(fixture->daemon));
    g_object_unref(fixture->daemon);
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->address);
    g_free(fixture->log);
}

/* Clients that say nothing. */
static void connect_many(struct fixture *fixture) {
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    g_strlcpy(to.sun_path, strchr(fixture->address, '=') + 1, sizeof to.sun_path);
    for (int i = 0; i < MANY; i++) {
        fixture->sockets[i] = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC | SOCK_NONBLOCK, 0);
        g_assert_true(connect(fixture->sockets[i], (struct sockaddr *)&to, sizeof to) == 0 ||
                      errno == EAGAIN); /* many wait already */
    }
}

/* By the daemon, within a minute. */
static gboolean is_dropped(int fd) {
    struct pollfd at = {.fd = fd, .events = POLLIN};
    char byte;
    return poll(&at, 1, 60000) == 1 && recv(fd, &byte, 1, 0) == 0;
}

static void assert_short_log(struct fixture *fixture, const char *words) {
    g_autofree char *log = NULL;
    gsize n = 0;
    g_assert_true(g_file_get_contents(fixture->log, &log, &n, NULL));
    g_test_message("%.2000s", log);
    g_assert_cmpuint(n, <, MAX_LOG);
    assert_has(log, words);
}

/* A new client, once there is room again. */
static void assert_joins(struct fixture *fixture) {
    g_autoptr(GDBusConnection) client = NULL;
    UNTIL ((client = bus_client_connect(fixture->address, NULL)))
        g_usleep(100000);
    assert_answers(client);
}

static void set_limit(struct fixture *fixture, rlim_t files) {
    const struct rlimit limit = {files, fixture->limit.rlim_max};
    g_assert_cmpint(prlimit(fixture->pid, RLIMIT_NOFILE, &limit, NULL), ==, 0);
}

static int count_files(struct fixture *fixture) {
    g_autofree char *folder = g_strdup_printf("/proc/%d/fd", (int)fixture->pid);
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    int n = 0;
    while (g_dir_read_name(dir))
        n++;
    return n;
}

static void test_full_table(struct fixture *fixture, gconstpointer unused) {
    set_limit(fixture, 3); /* the table is full: what is open stays open */
    connect_many(fixture);
    for (int i = 0; i < 6; i++) {
        g_usleep(G_USEC_PER_SEC / 2);
        assert_answers(fixture->client);
    }
    assert_short_log(fixture, "cannot accept a client: ");
    disconnect(fixture);
    set_limit(fixture, fixture->limit.rlim_cur);
    assert_joins(fixture);
    assert_answers(fixture->client);
}

/* An eighth of the table is for devices and files. */
static void test_reserve(struct fixture *fixture, gconstpointer unused) {
    const int files = count_files(fixture) + 40;
    set_limit(fixture, (rlim_t)files);
    connect_many(fixture);
    for (int i = 0; i < 6; i++) {
        g_usleep(G_USEC_PER_SEC / 2);
        assert_answers(fixture->client);
        g_assert_cmpint(count_files(fixture), <=, files - files / 8 + 1);
    }
    assert_short_log(fixture, "no more clients are accepted");
    disconnect(fixture);
    set_limit(fixture, fixture->limit.rlim_cur);
    assert_joins(fixture);
}

/* One program takes all that it gets; another one is served all the same. */
static void test_one_program(struct fixture *fixture, gconstpointer unused) {
    connect_many(fixture);
    assert_answers(fixture->client);
    for (int i = OF_ONE; i < MANY; i++)
        g_assert_true(is_dropped(fixture->sockets[i]));
    g_autofree char *said = process_text(
        0, (const char *[]){BUILD_DIR "/bin/mesorig", "safe", "--address", fixture->address, NULL});
    assert_short_log(fixture,
                     "connections, which is the maximum: no more of its connections are accepted");
    /* Those that have not authenticated themselves are dropped after a while. */
    for (int i = 0; i < OF_ONE - 1; i++)
        g_assert_true(is_dropped(fixture->sockets[i]));
    assert_joins(fixture);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
#define ADD(path, func) g_test_add(path, struct fixture, NULL, set_up, func, tear_down)
    ADD("/clients/full-table", test_full_table);
    ADD("/clients/reserve", test_reserve);
    ADD("/clients/one-program", test_one_program);
    return g_test_run();
}
