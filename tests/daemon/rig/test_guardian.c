/* The guardian as the daemon sees it: its answers, its replacement, and who has a rig's place; and
 * the work that makes a rig safe. This program is the daemon, and is started again as the guardian.
 */
#include "lib/find_guardian.h"
#include "lib/lines.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "rig/guardian.h"
#include "rig/guardian_place.h"
#include "rig/safe_work.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <stdio.h>
#include <string.h>
#include <sys/resource.h>
#include <sys/socket.h>
#include <sys/un.h>
#include <sys/wait.h>
#include <unistd.h>

#define WORLD SOURCE_DIR "/tests/small/world.conf"
#define BEHAVIOR                                                                                   \
    "MESORIG_TEST_GUARDIAN" /* in the environment: of guardians started from now on                \
                             */

static GString *told; /* warnings of this process, and what it prints */

struct fixture {
    char *folder, *rig, *said; /* said: what a process of work_start() prints */
    struct lines lines;
};

static void set_up(struct fixture *fixture, gconstpointer data) {
    fixture->folder = g_dir_make_tmp("mesorig-guardian-XXXXXX", NULL);
    fixture->rig = g_build_filename(fixture->folder, "rig.conf", NULL);
    fixture->said = g_build_filename(fixture->folder, "said", NULL);
    lines_open(&fixture->lines, WORLD);
    g_assert_true(g_file_set_contents(fixture->rig, fixture->lines.text->str, -1, NULL));
    g_string_truncate(told, 0);
}

static void end_guardians(struct fixture *fixture) {
    pid_t guardian;
    while ((guardian = find_guardian(fixture->rig))) {
        kill(guardian, SIGKILL);
        g_usleep(10000);
        while (g_main_context_iteration(NULL, FALSE))
            ;
    }
}

static void tear_down(struct fixture *fixture, gconstpointer data) {
    g_unsetenv(BEHAVIOR);
    end_guardians(fixture);
    lines_close(&fixture->lines);
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->rig);
    g_free(fixture->said);
}

static GLogWriterOutput keep_log(GLogLevelFlags level, const GLogField *fields, gsize n,
                                 gpointer data) {
    for (gsize i = 0; i < n; i++)
        if (strcmp(fields[i].key, "MESSAGE") == 0)
            g_string_append_printf(told, "%s\n", (const char *)fields[i].value);
    return G_LOG_WRITER_HANDLED;
}

/* Keeps what is said, and prints it: a failed assertion speaks in the same way. */
static void keep_text(const char *text) {
    g_string_append(told, text);
    fputs(text, stderr);
}

static Guardian *start(struct fixture *fixture) {
    Guardian *guardian = ok(guardian_start(fixture->rig, ERR));
    return guardian;
}

static void refused(struct fixture *fixture, enum device_error code, const char *words) {
    g_autoptr(GError) error = NULL;
    g_assert_null(guardian_start(fixture->rig, &error));
    g_assert_error(error, DEVICE_ERROR, code);
    assert_has(error->message, words);
}

/* Runs the main loop until another guardian answers. */
static void wait_another(struct fixture *fixture, Guardian *guardian, pid_t old) {
    pid_t now;
    UNTIL ((now = find_guardian(fixture->rig)) != 0 && now != old &&
           guardian_answers(guardian, NULL)) {
        g_main_context_iteration(NULL, FALSE);
        g_usleep(5000);
    }
}

static void wait_told(const char *words) {
    UNTIL (strstr(told->str, words)) {
        g_main_context_iteration(NULL, FALSE);
        g_usleep(5000);
    }
}

/* As long as the process runs, also while the main loop is busy. */
static void test_answers(struct fixture *fixture, gconstpointer data) {
    g_autoptr(GError) error = NULL;
    Guardian *guardian = start(fixture);
    const pid_t first = find_guardian(fixture->rig);
    for (int i = 0; i < 3; i++) {
        UNTIL (guardian_answers(guardian, NULL)) /* on a busy computer not always within 0.2 s */
            g_usleep(5000);
        g_usleep(G_USEC_PER_SEC * 3 / 2); /* the main loop is busy */
    }

    /* Frozen: known within the second, although the main loop does not run. */
    kill(first, SIGSTOP);
    g_usleep(G_USEC_PER_SEC * 11 / 10);
    g_assert_false(guardian_answers(guardian, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    assert_has(error->message, "does not answer");
    g_clear_error(&error);

    /* And replaced, once the main loop runs. */
    wait_another(fixture, guardian, first);
    assert_has(told->str, "has not answered for 3.0 s: killing it");
    assert_has(told->str, "has ended (status 0x0009)");
    guardian_end(guardian, GUARDIAN_SAFE);
}

/* However often it ends, and however soon. */
static void test_replaced(struct fixture *fixture, gconstpointer data) {
    Guardian *guardian = start(fixture);
    for (int i = 0; i < 3; i++) {
        const pid_t old = find_guardian(fixture->rig);
        kill(old, SIGKILL);
        wait_another(fixture, guardian, old);
    }
    assert_has(told->str, "starting another in 100 ms");
    assert_has(told->str, "starting another in 200 ms");
    assert_has(told->str, "starting another in 400 ms");
    guardian_end(guardian, GUARDIAN_SAFE);
}

/* The pauses grow, so that a guardian that cannot live costs little. */
static void test_pauses(struct fixture *fixture, gconstpointer data) {
    Guardian *guardian = start(fixture);
    g_setenv(BEHAVIOR, "ends", TRUE);
    const pid_t first = find_guardian(fixture->rig);
    kill(first, SIGKILL);
    wait_told("starting another in 1600 ms");
    g_assert_false(guardian_answers(guardian, NULL));
    g_unsetenv(BEHAVIOR);
    wait_another(fixture, guardian, first);
    guardian_end(guardian, GUARDIAN_SAFE);
}

static void test_not_started(struct fixture *fixture, gconstpointer data) {
    g_setenv(BEHAVIOR, "ends", TRUE);
    refused(fixture, DEVICE_ERROR_DISCONNECTED, "has ended");
    g_setenv(BEHAVIOR, "mute", TRUE);
    refused(fixture, DEVICE_ERROR_TIMEOUT, "has not answered within 6 s");
    g_unlink(fixture->rig);
    g_unsetenv(BEHAVIOR);
    refused(fixture, DEVICE_ERROR_BUSY, "No such file");
}

static void test_needed(struct fixture *fixture, gconstpointer data) {
    g_assert_true(guardian_is_needed(fixture->rig));
    g_assert_false(guardian_is_needed(SOURCE_DIR "/tests/small/rig.conf"));
    g_assert_false(guardian_is_needed("/nowhere/rig.conf"));
}

/* One that does not end does not keep others waiting, and the daemon between two guardians leaves
 * one behind. */
static void test_end_between(struct fixture *fixture, gconstpointer data) {
    Guardian *guardian = start(fixture);
    virtual_modbus_set_coil(fixture->lines.devices[LASER], LINES_LASER_COIL, TRUE);
    kill(find_guardian(fixture->rig), SIGKILL);
    wait_told("starting another");
    guardian_end(guardian, GUARDIAN_UNSAFE);
    UNTIL (!lines_has_light(fixture->lines.devices[LASER]))
        g_usleep(5000);
}

/* A rig belongs to one daemon, whatever the path to its file. */
static void test_one_daemon(struct fixture *fixture, gconstpointer data) {
    g_autofree char *link = g_build_filename(fixture->folder, "link.conf", NULL);
    g_autofree char *words = g_strdup_printf("open in another mesorigd (process %d)", getpid());
    g_autofree char *rig = g_steal_pointer(&fixture->rig);
    fixture->rig = g_strdup(rig);
    Guardian *guardian = start(fixture);
    g_assert_cmpint(symlink(rig, link), ==, 0);
    g_free(fixture->rig);
    fixture->rig = g_strdup(link);
    refused(fixture, DEVICE_ERROR_BUSY, words);
    g_assert_true(guardian_answers(guardian, NULL));
    guardian_end(guardian, GUARDIAN_SAFE);
    guardian_end(start(fixture), GUARDIAN_SAFE); /* the place is free again */
}

static void wait_guardian(struct fixture *fixture, gboolean there) {
    UNTIL ((find_guardian(fixture->rig) != 0) == there) {
        g_usleep(5000);
        while (g_main_context_iteration(NULL, FALSE)) /* reaps it */
            ;
    }
}

/* The guardian that makes the rig safe leaves it to that of the next daemon, also when it is
 * frozen, so that there is always one and never two. */
static void test_gives_way(struct fixture *fixture, gconstpointer data) {
    const gboolean frozen = GPOINTER_TO_INT(data);
    virtual_modbus_set_coil(fixture->lines.devices[LASER], LINES_LASER_COIL, TRUE);
    lines_fail(&fixture->lines, LASER, SILENT);
    guardian_end(start(fixture), GUARDIAN_UNSAFE);
    const pid_t first = find_guardian(fixture->rig);
    if (frozen) {
        g_usleep(G_USEC_PER_SEC / 2); /* it is at work */
        kill(first, SIGSTOP);
    }
    refused(fixture, DEVICE_ERROR_BUSY, "it has not been safe since an earlier mesorigd ended");
    while (g_main_context_iteration(NULL, FALSE)) /* reaps it */
        ;
    const pid_t second = find_guardian(fixture->rig);
    g_assert_cmpint(second, !=, 0);
    g_assert_cmpint(second, !=, first);
    g_assert_cmpint(kill(first, 0), !=, 0);

    lines_repair(&fixture->lines, LASER);
    wait_guardian(fixture, FALSE);
    g_assert_false(lines_has_light(fixture->lines.devices[LASER]));
    guardian_end(start(fixture), GUARDIAN_SAFE);
}

/* Holds the socket of a rig's guardian and answers nobody, until it is killed. Returns its process
 * when it holds the socket. */
static pid_t hold_place(const char *rig) {
    g_autofree char *sum = g_compute_checksum_for_string(G_CHECKSUM_SHA256, rig, -1);
    struct sockaddr_un name = {.sun_family = AF_UNIX};
    const int n =
        g_snprintf(name.sun_path + 1, sizeof name.sun_path - 1, "mesorigd-guardian-%s", sum);
    const socklen_t size = (socklen_t)(G_STRUCT_OFFSET(struct sockaddr_un, sun_path) + 1 + n);
    const int fd = socket(AF_UNIX, SOCK_SEQPACKET | SOCK_CLOEXEC, 0);
    g_assert_cmpint(bind(fd, (const struct sockaddr *)&name, size), ==, 0);
    g_assert_cmpint(listen(fd, 8), ==, 0);
    const pid_t pid = fork();
    for (int asker; pid == 0 && (asker = accept(fd, NULL, NULL)) >= 0;)
        close(asker);
    close(fd);
    return pid;
}

/* A process of the same user holds the socket without being a guardian. The guardian waits, says
 * so, and works without the socket. */
static void test_place_held(struct fixture *fixture, gconstpointer data) {
    const pid_t holder = hold_place(fixture->rig);
    struct place place;
    gboolean at_work = TRUE;
    pid_t other = 0;
    g_assert_true(place_take(&place, fixture->rig, &at_work, &other));
    g_assert_cmpint(place.listener, ==, -1);
    g_assert_false(at_work);
    assert_has(told->str, "an earlier guardian of this rig did not end within 3 s. This guardian "
                          "protects the rig too, but a later mesorigd does not find it;");
    kill(holder, SIGKILL);
    g_assert_cmpint(waitpid(holder, NULL, 0), ==, holder);
}

/* A daemon that begins while the rig is being made safe gets it as soon as that is done. */
static void test_taken_over(struct fixture *fixture, gconstpointer data) {
    virtual_modbus_set_coil(fixture->lines.devices[LASER], LINES_LASER_COIL, TRUE);
    lines_fail(&fixture->lines, LASER, LOST);
    guardian_end(start(fixture), GUARDIAN_UNSAFE);
    Guardian *guardian = NULL;
    UNTIL ((guardian = guardian_start(fixture->rig, NULL)))
        ;
    g_assert_false(lines_has_light(fixture->lines.devices[LASER]));
    g_assert_true(guardian_answers(guardian, NULL));
    guardian_end(guardian, GUARDIAN_SAFE);
}

static int count(const char *text, const char *words) {
    int n = 0;
    for (const char *at = text; (at = strstr(at, words)); at += strlen(words))
        n++;
    return n;
}

/* Starts a process that makes the rig safe. It is another process because a SafeWork needs one
 * without other threads, and the virtual devices are threads of this one. */
static GSubprocess *work_start(struct fixture *fixture, const char *kind, const char *repeat_s) {
    return process_start(
        G_SUBPROCESS_FLAGS_NONE, fixture->said,
        (const char *[]){"/proc/self/exe", "--work", fixture->rig, kind, repeat_s, NULL});
}

static void work_end(GSubprocess *work) {
    ok(g_subprocess_wait_check(work, NULL, ERR));
    g_object_unref(work);
}

/* Waits until the work has printed a text so often. Returns all that it has printed; g_free(). */
static char *work_until(struct fixture *fixture, const char *words, int n) {
    char *text = text_file_read(fixture->said);
    UNTIL (count(text, words) >= n) {
        g_free(text);
        g_usleep(5000);
        text = text_file_read(fixture->said);
    }
    return text;
}

/* Of each device once that it is not safe, again and again while that is so, and once that it is.
 */
static void test_told(struct fixture *fixture, gconstpointer data) {
    lines_fail(&fixture->lines, LASER, SILENT);
    GSubprocess *work = work_start(fixture, "loud", "4");
    g_autofree char *first = work_until(fixture, "is still trying", 1);
    *strstr(first, "is still trying") = '\0';
    g_assert_cmpint(count(first, "laser top: NOT safe: "), ==, 1);
    g_assert_cmpint(count(first, "lamps bank: off, read back"), ==, 1);
    for (int i = 2; i <= 3; i++) {
        g_autofree char *repeated = work_until(fixture, "laser top: NOT safe: ", i);
        g_assert_cmpint(count(repeated, "laser top: NOT safe: "), ==, i);
    }
    lines_repair(&fixture->lines, LASER);
    work_end(work);
    g_autofree char *text = text_file_read(fixture->said);
    g_assert_cmpint(count(text, "laser top: off, read back"), ==, 1);
    g_assert_cmpint(count(text, "lamps bank: "), ==, 1);
    g_assert_cmpint(count(text, "is still trying"), ==, 1);
    g_assert_cmpint(count(text, "lamps and lasers are off, axes stand"), ==, 1);
}

/* Returns the children of a process as text, "" if there are none; g_free(). */
static char *children(const char *pid) {
    g_autofree char *path = g_strdup_printf("/proc/%s/task/%s/children", pid, pid);
    char *text = text_file_read(path);
    return g_strstrip(text);
}

/* Kills the processes of the lines, and waits until they have been replaced. */
static void kill_children(const char *pid) {
    g_autofree char *old = children(pid);
    g_auto(GStrv) pids = g_strsplit(old, " ", -1);
    g_assert_cmpstr(old, !=, "");
    for (char **child = pids; *child; child++)
        kill((pid_t)g_ascii_strtoll(*child, NULL, 10), SIGKILL);
    char *now = children(pid);
    UNTIL (strcmp(now, "") != 0 && strcmp(now, old) != 0) {
        g_free(now);
        g_usleep(5000);
        now = children(pid);
    }
    g_free(now);
}

/* A line whose driver crashes gets another process. */
static void test_crash(struct fixture *fixture, gconstpointer data) {
    virtual_modbus_set_coil(fixture->lines.devices[LASER], LINES_LASER_COIL, TRUE);
    lines_fail(&fixture->lines, LASER, SILENT);
    GSubprocess *work = work_start(fixture, "loud", "60");
    g_free(work_until(fixture, "is still trying", 1));
    for (int i = 0; i < 3; i++)
        kill_children(g_subprocess_get_identifier(work));
    lines_repair(&fixture->lines, LASER);
    work_end(work);
    g_autofree char *text = text_file_read(fixture->said);
    g_assert_cmpint(count(text, "its driver has crashed"), ==, 1);
    g_assert_false(lines_has_light(fixture->lines.devices[LASER]));
}

/* The processes of the lines cannot be started, because no descriptor is left. Each device is
 * named, and is made safe as soon as its process starts. */
static void test_starved(struct fixture *fixture, gconstpointer data) {
    virtual_modbus_set_coil(fixture->lines.devices[LASER], LINES_LASER_COIL, TRUE);
    GSubprocess *work = work_start(fixture, "starved", "60");
    g_autofree char *before = work_until(fixture, "is still trying", 1);
    g_assert_true(lines_has_light(fixture->lines.devices[LASER]));
    const struct rlimit enough = {256, 256};
    const pid_t pid = (pid_t)g_ascii_strtoll(g_subprocess_get_identifier(work), NULL, 10);
    g_assert_cmpint(prlimit(pid, RLIMIT_NOFILE, &enough, NULL), ==, 0);
    work_end(work);
    g_autofree char *text = text_file_read(fixture->said);
    g_assert_cmpint(count(text, "laser top: NOT safe: the process that makes it safe cannot"), ==,
                    1);
    g_assert_cmpint(count(text, "lamps bank: NOT safe: the process that makes it safe cannot"), ==,
                    1);
    g_assert_false(lines_has_light(fixture->lines.devices[LASER]));
}

/* mesorigd --safe-state ends if the processes cannot be started. */
static void test_starved_once(struct fixture *fixture, gconstpointer data) {
    work_end(work_start(fixture, "once", "0"));
    g_autofree char *text = text_file_read(fixture->said);
    g_assert_cmpint(count(text, "laser top: NOT safe: "), ==, 1);
    g_assert_cmpint(count(text, "the rig is NOT safe: switch off by hand"), ==, 1);
}

/* Nothing is said of devices that never failed. */
static void test_quiet(struct fixture *fixture, gconstpointer data) {
    work_end(work_start(fixture, "quiet", "60"));
    g_autofree char *text = text_file_read(fixture->said);
    g_assert_cmpstr(text, ==, "");
}

/* Leaves this process no descriptor for a pipe. Returns the limit from before. */
static struct rlimit starve(void) {
    struct rlimit before;
    const int next = dup(0);
    close(next);
    g_assert_cmpint(getrlimit(RLIMIT_NOFILE, &before), ==, 0);
    const struct rlimit none = {(rlim_t)next, before.rlim_max};
    g_assert_cmpint(setrlimit(RLIMIT_NOFILE, &none), ==, 0);
    return before;
}

/* The process of work_start(). */
static int be_work(const char *rig, const char *kind, const char *repeat_s) {
    g_autoptr(SafeState) state = ok(safe_state_read(rig, ERR));
    if (strcmp(kind, "once") == 0) {
        g_assert_cmpint(dup2(STDERR_FILENO, STDOUT_FILENO), ==, STDOUT_FILENO);
        const struct rlimit before = starve();
        gboolean hope = FALSE;
        const gboolean done = safe_work_once(state, &hope);
        setrlimit(RLIMIT_NOFILE, &before);
        return !done && hope ? 0 : 1;
    }
    if (strcmp(kind, "starved") == 0)
        starve();
    SafeWork *work =
        safe_work_new(state, strcmp(kind, "quiet") == 0 ? SAFE_UNTIL_SAFE_QUIETLY : SAFE_UNTIL_SAFE,
                      g_ascii_strtod(repeat_s, NULL));
    while (safe_work_run(work, NULL, 0, -1))
        ;
    const gboolean safe = safe_work_is_safe(work);
    safe_work_free(work);
    return safe ? 0 : 1;
}

/* The process that the daemon starts. */
static int be_guardian(const char *rig) {
    const char *behavior = g_getenv(BEHAVIOR);
    if (g_strcmp0(behavior, "ends") == 0)
        return 3;
    while (g_strcmp0(behavior, "mute") == 0)
        pause();
    return guardian_main(rig);
}

int main(int argc, char **argv) {
    if (argc == 3 && strcmp(argv[1], "--guardian") == 0)
        return be_guardian(argv[2]);
    if (argc == 5 && strcmp(argv[1], "--work") == 0)
        return be_work(argv[2], argv[3], argv[4]);
    g_test_init(&argc, &argv, NULL);
    g_log_set_always_fatal(G_LOG_LEVEL_ERROR | G_LOG_LEVEL_CRITICAL);
    told = g_string_new(NULL);
    g_log_set_writer_func(keep_log, NULL, NULL);
    g_set_printerr_handler(keep_text);
#define ADD(path, func, data)                                                                      \
    g_test_add(path, struct fixture, GINT_TO_POINTER(data), set_up, func, tear_down)
    ADD("/guardian/answers", test_answers, 0);
    ADD("/guardian/replaced", test_replaced, 0);
    ADD("/guardian/pauses", test_pauses, 0);
    ADD("/guardian/not-started", test_not_started, 0);
    ADD("/guardian/needed", test_needed, 0);
    ADD("/guardian/end-between", test_end_between, 0);
    ADD("/guardian/one-daemon", test_one_daemon, 0);
    ADD("/guardian/gives-way", test_gives_way, FALSE);
    ADD("/guardian/gives-way-frozen", test_gives_way, TRUE);
    ADD("/guardian/taken-over", test_taken_over, 0);
    ADD("/guardian/place-held", test_place_held, 0);
    ADD("/safe-work/told", test_told, 0);
    ADD("/safe-work/crash", test_crash, 0);
    ADD("/safe-work/starved", test_starved, 0);
    ADD("/safe-work/starved-once", test_starved_once, 0);
    ADD("/safe-work/quiet", test_quiet, 0);
    const int code = g_test_run();
    g_string_free(told, TRUE);
    return code;
}
