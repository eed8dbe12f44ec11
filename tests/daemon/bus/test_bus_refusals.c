/* What the bus refuses, and with which errors: options, paths, callers, checks at the same time,
 * the queue, and addresses that clients give. */
#include "bus/bus_authority.h"
#include "bus/bus_caller.h"
#include "bus/bus_client.h"
#include "bus/bus_errors.h"
#include "bus/bus_options.h"
#include "bus/bus_unattended.h"
#include "bus/preparer.h"

#include <glib/gstdio.h>
#include <string.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <unistd.h>

#include "lib/bus_peer.h"
#include "lib/long_session.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

static GVariant *session(const struct bus_peer *peer, const char *directory, const char *options) {
    return g_variant_new("(ss@a{sv})", peer->conf, directory, g_variant_new_parsed(options));
}

TEST(options) {
    static const char *const wrong[] = {"{'hurry': <true>}", "{'process': <'yes'>}",
                                        "{'yes': <1>}",      "{'calibration': <true>}",
                                        "{'chosen': <2.5>}", "{'session_text': <['a']>}"};
    struct bus_peer *peer = bus_peer_open(NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        const char *why = i == 0 ? "there is no option hurry" : "but its D-Bus type is";
        bus_peer_refused(peer, "Validate", session(peer, "", wrong[i]), "Unknown", why);
        bus_peer_refused(peer, "Start", session(peer, peer->session, wrong[i]), "Unknown", why);
    }
    bus_peer_refused(peer, "Validate", session(peer, "here", "@a{sv} {}"), "BadPath", "here");
    bus_peer_refused(peer, "Start",
                     session(peer, peer->session, "{'calibration': <'rig.calibration'>}"),
                     "BadPath", "rig.calibration");
    bus_peer_refused(peer, "Start",
                     session(peer, peer->session, "{'calibration': <'/no/such/file'>}"), "Failed",
                     "there is no calibration file /no/such/file");
    bus_peer_refused(peer, "Start", g_variant_new("(ssa{sv})", "session.conf", peer->session, NULL),
                     "BadPath", "session.conf");
    bus_peer_refused(
        peer, "Resume",
        g_variant_new("(s@a{sv})", peer->session, g_variant_new_parsed("{'calibration': <'/z'>}")),
        "Unknown", "a resumed session keeps the calibration");
    bus_peer_refused(peer, "QueueAdd", session(peer, peer->session, "@a{sv} {}"), "Failed",
                     "this mesorigd keeps no queue: start it with --queue FILE");
    bus_peer_refused(peer, "QueuePause", NULL, "Failed", "keeps no queue");
    bus_peer_refused(peer, "QueueResume", NULL, "Failed", "keeps no queue");
    bus_peer_refused(peer, "QueueRemove", g_variant_new("(u)", 1), "Failed", "keeps no queue");
    bus_peer_refused(peer, "QueueMove", g_variant_new("(uu)", 1, 1), "Failed", "keeps no queue");
    g_assert_false(g_file_test(peer->session, G_FILE_TEST_EXISTS));
    bus_peer_free(peer);
}

/* Each client has one check at a time, and all together a few. */
TEST(checks) {
    struct bus_peer *peer = bus_peer_open(NULL);
    g_autofree char *large = long_session_write(peer->folder, "30:140; 60:140");
    GDBusConnection *others[8] = {0};
    GAsyncResult *results[8] = {0};
    int refused = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(others); i++) {
        others[i] = bus_peer_join(peer);
        bus_peer_begin(others[i], "Validate", g_variant_new("(ssa{sv})", large, "", NULL),
                       &results[i]);
    }
    /* As soon as one call is refused, the maximum number of checks is running. */
    for (gboolean answered = FALSE; !answered;) {
        g_main_context_iteration(NULL, TRUE);
        for (gsize i = 0; i < G_N_ELEMENTS(others); i++)
            answered |= results[i] != NULL;
    }
    bus_peer_refused(peer, "Validate", session(peer, "", "@a{sv} {}"), "Busy",
                     "sessions are being checked, which is the maximum");
    g_dbus_connection_close_sync(others[0], NULL, NULL);
    bus_peer_tell(peer, "CloseRig", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(others); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_null(bus_peer_end(others[i], &results[i], NULL, &error));
        refused += strstr(error->message, "which is the maximum") != NULL;
        g_object_unref(others[i]);
    }
    g_test_message("%d of %d were refused", refused, (int)G_N_ELEMENTS(others));
    g_assert_cmpint(refused, >, 0);
    g_assert_cmpint(refused, <, (int)G_N_ELEMENTS(others));
    bus_peer_free(peer);
}

/* A queue whose rig is closed: what it accepts, and what it refuses. */
TEST(queue) {
    struct bus_peer *peer = bus_peer_open(NULL);
    g_autofree char *file = g_build_filename(peer->folder, "queue", NULL);
    g_autofree char *second = g_build_filename(peer->folder, "second.session", NULL);
    g_autofree char *latin = g_build_filename(peer->folder, "latin.conf", NULL);
    g_autofree char *calibration = g_strdup_printf("{'calibration': <'%s'>}", latin);
    bus_keep_queue(peer->bus, file);
    bus_peer_tell(peer, "QueuePause", NULL);
    bus_peer_tell(peer, "QueuePause", NULL); /* it is */
    g_file_set_contents(latin, "\xe4", 1, NULL);
    bus_peer_refused(peer, "QueueAdd", g_variant_new("(ssa{sv})", latin, second, NULL), "Failed",
                     "is not UTF-8");
    bus_peer_refused(peer, "QueueAdd", session(peer, second, calibration), "Failed",
                     "is not UTF-8");
    bus_peer_refused(peer, "QueueAdd", g_variant_new("(ssa{sv})", "/no/such.conf", second, NULL),
                     "Failed", "/no/such.conf");
    bus_peer_refused(peer, "QueueAdd", session(peer, "here", "@a{sv} {}"), "BadPath", "here");
    bus_peer_refused(peer, "QueueAdd", g_variant_new("(ssa{sv})", "a.conf", second, NULL),
                     "BadPath", "a.conf");
    bus_peer_refused(peer, "QueueAdd", session(peer, second, "{'hurry': <true>}"), "Unknown",
                     "hurry");
    bus_peer_refused(peer, "QueueAdd", session(peer, second, "{'calibration': <'/no/such'>}"),
                     "Failed", "there is no calibration file");
    bus_peer_tell(peer, "QueueAdd", session(peer, peer->session, "{'yes': <true>}"));
    bus_peer_tell(peer, "QueueAdd", session(peer, second, "{'chosen': <''>, 'process': <false>}"));
    bus_peer_refused(peer, "QueueAdd", session(peer, second, "@a{sv} {}"), "Failed", "second");
    bus_peer_refused(peer, "QueueRemove", g_variant_new("(u)", 99), "Failed", "99");
    bus_peer_refused(peer, "QueueMove", g_variant_new("(uu)", 99, 1), "Failed", "99");
    bus_peer_tell(peer, "QueueMove", g_variant_new("(uu)", 2, 1));
    bus_peer_tell(peer, "QueueRemove", g_variant_new("(u)", 1));
    bus_peer_tell(peer, "QueueRemove", g_variant_new("(u)", 2));
    bus_peer_tell(peer, "QueueResume", NULL);
    bus_peer_tell(peer, "QueueResume", NULL); /* it runs */
    bus_peer_tell(peer, "CloseRig", NULL);
    bus_peer_refused(peer, "QueueAdd", session(peer, second, "@a{sv} {}"), "NoRig", "OpenRig");
    bus_peer_free(peer);
}

/* A file that is not that of a queue is reported, and the daemon then has no queue. */
TEST(no_queue) {
    struct bus_peer *peer = bus_peer_open(NULL);
    bus_keep_queue(peer->bus, "/no/such/folder/queue");
    bus_peer_refused(peer, "QueueResume", NULL, "Failed", "/no/such/folder");
    bus_peer_free(peer);
}

static GError *client_error(const char *address) {
    GError *error = NULL;
    g_assert_null(bus_client_connect(address, &error));
    return error;
}

TEST(client) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-client-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(folder, "bus", NULL);
    g_autofree char *address = g_strconcat("unix:path=", path, NULL);
    static const char *const none[] = {"", "nonsense", "pigeon:loft=1", "unix:colour=blue"};
    g_autoptr(GCancellable) stop = g_cancellable_new();
    for (gsize i = 0; i < G_N_ELEMENTS(none); i++) {
        g_autoptr(GError) error = client_error(none[i]);
        assert_has(error->message, "is not the address of a mesorigd");
    }
    g_autoptr(GError) absent = client_error(address);
    assert_has(absent->message, "no mesorigd answers at");
    assert_has(absent->message, "mesorigd --listen");
    /* Something that listens and says nothing. */
    struct sockaddr_un to = {.sun_family = AF_UNIX};
    g_strlcpy(to.sun_path, path, sizeof(to.sun_path));
    const int fd = socket(AF_UNIX, SOCK_STREAM | SOCK_CLOEXEC, 0);
    g_assert_cmpint(bind(fd, (struct sockaddr *)&to, sizeof(to)), ==, 0);
    g_assert_cmpint(listen(fd, 4), ==, 0);
    g_autoptr(GError) silent = client_error(address);
    assert_has(silent->message, "has not answered within 15 s");
    close(fd);
    g_unlink(path);
    g_rmdir(folder);

    g_setenv(BUS_CLIENT_VARIABLE, "", TRUE);
    g_assert_null(bus_client_address());
    g_setenv(BUS_CLIENT_VARIABLE, "unix:path=/x", TRUE);
    g_assert_cmpstr(bus_client_address(), ==, "unix:path=/x");
    g_unsetenv(BUS_CLIENT_VARIABLE);
    g_assert_null(bus_client_address());
}

/* Where the folders of clients cannot be made, or have a name that is too long. */
TEST(folders__subprocess) {
    g_autoptr(GError) error = NULL;
    g_autofree char *folder = bus_client_make_folder(&error);
    g_assert_null(folder);
    assert_has(error->message,
               "cannot make a folder for the socket of mesorigd in /no/such/folder");
    g_clear_error(&error);
    g_autofree char *announced = bus_client_announce("unix:path=/x/y/bus", &error);
    g_assert_null(announced);
    g_assert_nonnull(error);
    g_clear_error(&error);
    announced = bus_client_announce("unix:path=/x/%zz/bus", &error);
    g_assert_null(announced);
    assert_has(error->message, "is not an address");
}

TEST(folders) {
    g_autofree char *exe = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *longest = g_strnfill(90, 'x');
    g_autofree char *far = g_strconcat("XDG_RUNTIME_DIR=/tmp/", longest, NULL);
    const char *const runtime[] = {"XDG_RUNTIME_DIR=/no/such/runtime", far};
    for (gsize i = 0; i < G_N_ELEMENTS(runtime); i++) {
        const char *const argv[] = {"env", runtime[i], "TMPDIR=/no/such/folder",
                                    exe,   "-p",       "/bus-refusals/folders/subprocess",
                                    NULL};
        g_free(process_text(0, argv));
    }
}

/* Owners of folders that are not there, or are no folders. */
TEST(caller) {
    static const struct bus_caller nobody = {.uid = 65534};
    TEMPORARY_FOLDER(folder);
    g_autofree char *loop = g_build_filename(folder, "loop", NULL);
    g_autofree char *below = g_build_filename(loop, "deep", NULL);
    g_autofree char *file = g_build_filename(folder, "file", NULL);
    g_autofree char *in_file = g_build_filename(file, "deep", NULL);
    const char *const paths[] = {loop, below, in_file, file};
    g_assert_cmpint(symlink("loop", loop), ==, 0);
    g_assert_true(g_file_set_contents(file, "x", -1, NULL));
    for (gsize i = 0; i < G_N_ELEMENTS(paths); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_false(bus_caller_may_write(&nobody, paths[i], &error));
        g_assert_error(error, BUS_ERROR, BUS_ERROR_DENIED);
        assert_has(error->message, folder);
    }
    g_autoptr(GError) error = NULL;
    g_assert_false(bus_caller_may_write(&nobody, "/no/such/folder/at/all", &error));
    assert_has(error->message, "you may not write in /");
}

/* A socket's path has 107 bytes at most. */
TEST(long_address) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *name = g_strnfill(120, 'x');
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autofree char *address = g_strconcat("unix:path=", path, NULL);
    g_autoptr(Bus) bus = bus_new(address);
    g_autoptr(GError) error = NULL;
    g_assert_null(bus_serve(bus, address, &error));
    assert_has(error->message, "a socket's path has at most 107");
    g_autoptr(GDir) left = g_dir_open(folder, 0, NULL);
    g_assert_null(g_dir_read_name(left));
}

BEFORE_TESTS {
    g_log_set_always_fatal(G_LOG_LEVEL_CRITICAL | G_LOG_FATAL_MASK);
}
