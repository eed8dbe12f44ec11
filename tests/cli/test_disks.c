/* What the operator is told about disks that are too small or become full, and that the work can be
 * continued afterwards. */
#include <errno.h>
#include <fcntl.h>
#include <glib/gstdio.h>
#include <sqlite3.h>
#include <string.h>
#include <sys/mount.h>
#include <sys/statvfs.h>
#include <sys/wait.h>
#include <unistd.h>

#include "lib/long_session.h"
#include "lib/operator.h"
#include "lib/skip.h"
#include "lib/test.h"
#include "lib/wait.h"

/* A disk of our own; NULL where that is not allowed. */
static char *mount_disk(const char *size) {
    static int n;
    char *path = g_strdup_printf("%s/disk%d", operator_folder(), n++);
    g_autofree char *options = g_strconcat("size=", size, NULL);
    g_assert_cmpint(g_mkdir(path, 0777), ==, 0);
    if (mount("mesorig-test", path, "tmpfs", 0, options) == 0)
        return path;
    test_skip_or_fail("a disk cannot be mounted here");
    g_free(path);
    return NULL;
}

static void unmount_disk(char *path) {
    g_assert_cmpint(umount2(path, MNT_DETACH), ==, 0);
    g_free(path);
}

TEST(disk_too_small) {
    char *disk = mount_disk("1m");
    if (!disk)
        return;
    struct operation *run = operator_new_in(disk, NULL);
    operator_captures(run, 1);
    assert_has(run->err, run->session);
    assert_has(run->err, "the session needs ");
    assert_has(run->err, "are free there; free some space or choose another disk");
    g_assert_false(g_file_test(run->session, G_FILE_TEST_EXISTS));
    operator_free(run);
    unmount_disk(disk);
}

/* Takes all that is free. */
static void fill_up(const char *directory) {
    g_autofree char *ballast = g_build_filename(directory, "ballast", NULL);
    const int fd = open(ballast, O_CREAT | O_WRONLY | O_CLOEXEC, 0666);
    struct statvfs stat;
    gint64 taken = 0;
    while (statvfs(directory, &stat) == 0 && stat.f_bavail > 0) {
        const gint64 more = (gint64)(stat.f_bavail * stat.f_frsize);
        if (posix_fallocate(fd, taken, more) == 0)
            taken += more;
    }
    close(fd);
}

/* Takes all that is free, a moment after the first frame is there. */
static gpointer fill_disk(gpointer data) {
    struct operation *run = data;
    g_autofree char *frames = g_build_filename(run->session, "frames", NULL);
    gboolean any = FALSE;
    UNTIL (any) {
        g_autoptr(GDir) dir = g_dir_open(frames, 0, NULL);
        any = dir && g_dir_read_name(dir);
        g_usleep(200);
    }
    fill_up(run->directory);
    return NULL;
}

/* A longer session, with a sample that is seen whole from everywhere. */
static char *write_small_sample(const struct operation *run) {
    static const struct change changes[] = {{"[sample]", "width_mm = 40"},
                                            {"[sample]", "height_mm = 40"}};
    char *path = long_session_write(run->directory, LONG_RINGS);
    for (gsize i = 0; i < G_N_ELEMENTS(changes); i++) {
        g_autofree char *text = NULL;
        g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
        g_autofree char *changed = small_rig_changed(text, &changes[i]);
        g_assert_true(g_file_set_contents(path, changed, -1, NULL));
    }
    return path;
}

/* The disk becomes full during a capture: nothing is lost, and the capture continues when there is
 * space again. */
TEST(disk_full) {
    char *disk = mount_disk("90m");
    if (!disk)
        return;
    struct operation *whole = operator_new(NULL), *run = operator_new_in(disk, NULL);
    g_autofree char *conf = write_small_sample(run);
    g_autofree char *ballast = g_build_filename(run->directory, "ballast", NULL);
    operator_does(whole, 0, "capture", whole->rig, conf, "-o", whole->session, "--yes", NULL);
    operator_does(whole, 0, "process", whole->session, NULL);
    g_autofree char *expected = operator_products(whole->session);
    g_autoptr(GThread) filler = g_thread_new("filler", fill_disk, run);
    operator_does(run, 1, "capture", run->rig, conf, "-o", run->session, "--yes", NULL);
    g_thread_join(g_steal_pointer(&filler));
    g_test_message("%s", run->err);
    assert_has(run->out, "error: disk: The disk is full: ");
    assert_has(run->err, "mesorig: paused, the rig is being made safe: The disk is full: ");
    assert_has(run->err, "Nothing was lost; free some space, then continue.");
    assert_has(run->err, "to go on: mesorig resume ");
    operator_does(run, 1, "resume", run->session, NULL); /* it is full still */
    assert_has(run->err, "free");
    g_assert_cmpint(g_remove(ballast), ==, 0);
    g_autofree char *before = operator_frames(run->session);
    operator_does(run, 0, "resume", run->session, NULL);
    g_autofree char *after = operator_frames(run->session);
    g_assert_true(g_str_has_prefix(after, before));
    operator_does(run, 0, "process", run->session, NULL);
    g_autofree char *products = operator_products(run->session);
    g_assert_cmpstr(products, ==, expected);
    operator_free(run);
    operator_free(whole);
    unmount_disk(disk);
}

/* Changes the checksum of a frame, as a program does that is killed then: the change is in the WAL.
 */
static void change_in_wal(const char *session) {
    g_autofree char *file = g_build_filename(session, "session.db", NULL);
    g_autofree char *index = g_strconcat(file, "-shm", NULL);
    const pid_t pid = fork();
    if (pid == 0) {
        sqlite3 *db = NULL;
        _exit(sqlite3_open(file, &db) != SQLITE_OK ||
              sqlite3_exec(
                  db, "UPDATE frame SET sha256 = 'x' WHERE shot = (SELECT min(shot) FROM frame)",
                  NULL, NULL, NULL) != SQLITE_OK);
    }
    int status = -1;
    g_assert_cmpint(waitpid(pid, &status, 0), ==, pid);
    g_assert_cmpint(status, ==, 0);
    g_assert_cmpint(g_remove(index), ==, 0);
}

/* A session is read on a full disk, where the index of its WAL cannot be made: with an empty WAL,
 * and with one that a killed program has left. */
TEST(verify_on_full_disk) {
    char *disk = mount_disk("90m");
    if (!disk)
        return;
    struct operation *run = operator_new_in(disk, NULL);
    g_autofree char *ballast = g_build_filename(run->directory, "ballast", NULL);
    operator_captures(run, 0);
    fill_up(run->directory);
    operator_does(run, 0, "verify", run->session, NULL);
    assert_has(run->out, ": 0 are damaged or missing, 0 other files are unknown");
    operator_does(run, 0, "info", run->session, NULL);
    g_assert_cmpint(g_remove(ballast), ==, 0);
    change_in_wal(run->session);
    fill_up(run->directory);
    operator_does(run, 1, "verify", run->session, NULL);
    g_test_message("%s%s", run->out, run->err);
    assert_has(run->out, "damaged   frames/");
    assert_has(run->err, "the damaged frames could not be recorded");
    operator_free(run);
    unmount_disk(disk);
}

TESTS_RUN_BY(operator_tests);
