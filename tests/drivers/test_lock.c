/* Locks of devices between processes: children of this one hold them, are stopped, and are killed.
 */
#include "drivers/device.h"
#include "drivers/lock.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define MANY_ASKERS 3000

static char *unique_key(const char *what) {
    static int n;
    return g_strdup_printf("test %s %d of %d", what, n++, getpid());
}

/* A process that takes the lock and keeps it for some seconds (0: until it is killed). */
static pid_t hold(const char *key, enum lock_kind kind, enum lock_role role, double seconds) {
    int ready[2];
    char byte;
    g_assert_cmpint(pipe(ready), ==, 0);
    const pid_t pid = fork();
    g_assert_cmpint(pid, >=, 0);
    if (pid == 0) {
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        lock_set_role(role);
        if (lock_take(key, kind, "it", NULL) && write(ready[1], "+", 1) != 1)
            _exit(1);
        g_usleep((gulong)((seconds > 0 ? seconds : 3600) * 1e6));
        _exit(0);
    }
    close(ready[1]);
    g_assert_cmpint(read(ready[0], &byte, 1), ==, 1);
    close(ready[0]);
    return pid;
}

static void end(pid_t pid) {
    kill(pid, SIGKILL);
    g_assert_cmpint(waitpid(pid, NULL, 0), ==, pid);
}

static void assert_refused(const char *key, enum lock_kind kind, pid_t by) {
    g_autoptr(GError) error = NULL;
    const char *holder = "cannot open the line: test_lock";
    g_autofree char *process = g_strdup_printf("(process %d) uses it; end that program", by);
    g_assert_null(lock_take(key, kind, "the line", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_BUSY);
    if (!g_str_has_prefix(error->message, holder) || !g_str_has_suffix(error->message, process))
        g_error("%s", error->message);
}

static void assert_free(const char *key) {
    pid_t pid;
    g_assert_false(lock_holder(key, &pid));
    Lock *lock = ok(lock_take(key, LOCK_ALONE, "it", ERR));
    g_assert_cmpstr(lock_key(lock), ==, key);
    lock_release(lock);
}

TEST(one_process) {
    g_autofree char *key = unique_key("own");
    g_autoptr(GError) error = NULL;
    pid_t pid;
    Lock *lock = ok(lock_take(key, LOCK_ALONE, "the line", ERR));
    g_assert_true(lock_holder(key, &pid));
    g_assert_cmpint(pid, ==, getpid());
    g_assert_null(lock_take(key, LOCK_ALONE, "the line", &error));
    g_assert_cmpstr(error->message, ==,
                    "the line is already open for another section of the rig file; write a shared "
                    "line or board the same way in both sections, or correct one of them");
    lock_release(lock);
    assert_free(key);
}

TEST(other_process) {
    g_autofree char *key = unique_key("other");
    const pid_t other = hold(key, LOCK_ALONE, LOCK_OWNER, 0);
    pid_t pid;
    lock_steal_found();
    assert_refused(key, LOCK_ALONE, other);
    g_assert_cmpint(lock_steal_found(), ==, other);
    g_assert_cmpint(lock_steal_found(), ==, 0);
    g_assert_true(lock_holder(key, &pid));
    g_assert_cmpint(pid, ==, other);
    end(other);
    assert_free(key);
}

/* A stopped holder is named, however many have asked it. */
TEST(stopped) {
    g_autofree char *key = unique_key("stopped");
    const pid_t other = hold(key, LOCK_ALONE, LOCK_OWNER, 0);
    pid_t pid;
    kill(other, SIGSTOP);
    assert_refused(key, LOCK_ALONE, other);
    for (int i = 0; i < MANY_ASKERS; i++)
        g_assert_true(lock_holder(key, &pid));
    g_assert_null(lock_take(key, LOCK_ALONE, "it", NULL));
    end(other);
    assert_free(key);
}

TEST(long_keys) {
    g_autofree char *key = unique_key("long"), *tail = g_strnfill(150, 'x');
    g_autofree char *a = g_strconcat(key, tail, "a", NULL), *b = g_strconcat(key, tail, "b", NULL);
    Lock *one = lock_take(a, LOCK_ALONE, "a", NULL), *two = lock_take(b, LOCK_ALONE, "b", NULL);
    g_assert_true(one && two);
    g_assert_null(lock_take(a, LOCK_ALONE, "a", NULL));
    lock_release(one);
    lock_release(two);
}

/* A link is the device that it points to. */
TEST(links) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *file = g_build_filename(folder, "ttyUSB0", NULL);
    g_autofree char *other = g_build_filename(folder, "ttyUSB1", NULL);
    g_autofree char *link = g_build_filename(folder, "by-id", NULL);
    g_assert_true(g_file_set_contents(file, "", 0, NULL));
    g_assert_true(g_file_set_contents(other, "", 0, NULL));
    g_assert_cmpint(symlink(file, link), ==, 0);
    g_autofree char *of_file = lock_key_of_node("serial", file);
    g_autofree char *of_link = lock_key_of_node("serial", link);
    g_autofree char *of_other = lock_key_of_node("serial", other);
    g_assert_cmpstr(of_file, ==, of_link);
    g_assert_cmpstr(of_file, !=, of_other);
    g_unlink(link);
    g_assert_null(lock_key_of_node("serial", link));
}

/* What a program that makes a rig safe may open while a daemon has it. */
TEST(roles) {
    static const struct {
        enum lock_role role;
        enum lock_kind kind;
        gboolean opens;
    } cases[] = {{LOCK_GUARDIAN, LOCK_ALONE, FALSE},
                 {LOCK_GUARDIAN, LOCK_SHARED, FALSE},
                 {LOCK_OPERATOR, LOCK_ALONE, FALSE},
                 {LOCK_OPERATOR, LOCK_SHARED, TRUE}};
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *key = unique_key("role");
        const pid_t other = hold(key, cases[i].kind, LOCK_OWNER, 0);
        lock_set_role(cases[i].role);
        lock_steal_found();
        if (cases[i].opens)
            lock_release(lock_take(key, cases[i].kind, "it", NULL));
        else
            assert_refused(key, cases[i].kind, other);
        g_assert_cmpint(lock_steal_found(), ==, other);
        end(other);
        Lock *lock = lock_take(key, cases[i].kind, "it", NULL);
        g_assert_nonnull(lock);
        g_assert_cmpint(lock_steal_found(), ==, 0);
        lock_release(lock);
        lock_set_role(LOCK_OWNER);
    }
}

/* A daemon that starts while a device is being made safe waits for the end of that; two that make
 * it safe take turns. */
TEST(waits_for_rescue) {
    g_autofree char *key = unique_key("rescue"), *board = unique_key("board");
    const pid_t rescuer = hold(key, LOCK_ALONE, LOCK_GUARDIAN, 1);
    pid_t pid;
    g_assert_false(lock_holder(key, &pid));
    lock_set_role(LOCK_OPERATOR);
    assert_refused(key, LOCK_ALONE, rescuer);
    lock_set_role(LOCK_OWNER);
    Lock *lock = lock_take(key, LOCK_ALONE, "it", NULL);
    g_assert_nonnull(lock);
    siginfo_t ended = {0};
    g_assert_cmpint(waitid(P_PID, (id_t)rescuer, &ended, WEXITED | WNOHANG), ==, 0);
    g_assert_cmpint(ended.si_pid, ==, rescuer);
    lock_release(lock);
    const pid_t beside = hold(board, LOCK_SHARED, LOCK_GUARDIAN, 0);
    assert_free(board);
    end(beside);
}
