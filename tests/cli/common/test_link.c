/* Which daemon a command uses: the only one that is running. If several are running, the command is
 * refused. */
#include <signal.h>
#include <string.h>

#include "lib/long_session.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/test.h"
#include "lib/wait.h"

#define MESORIGD BUILD_DIR "/bin/mesorigd"

static const struct change real_clock = {"[rig]", "clock = real"};

/* A small rig whose clock is real, and a daemon that has it open at an address of its own. */
struct lab {
    struct operation *run;
    char *address;
    GSubprocess *daemon;
};

static struct lab lab_new(void) {
    struct lab lab = {.run = operator_new((const struct change[]){real_clock, {0}})};
    lab.address = g_strdup_printf("unix:path=%s/socket", lab.run->directory);
    lab.daemon = process_start_ready(
        G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
        (const char *[]){MESORIGD, "--listen", lab.address, "--rig", lab.run->rig, NULL});
    return lab;
}

static void lab_clear(struct lab *lab, int number) {
    g_subprocess_send_signal(lab->daemon, number);
    g_subprocess_wait(lab->daemon, NULL, NULL);
    g_object_unref(lab->daemon);
    operator_free(lab->run);
    g_free(lab->address);
}

/* Until “mesorig status --json DIR” says so. */
static void lab_waits(struct lab *lab, const char *what) {
    operator_does(lab->run, 0, "status", "--address", lab->address, "--json", NULL);
    UNTIL (strstr(lab->run->out, what)) {
        g_usleep(G_USEC_PER_SEC / 20);
        operator_does(lab->run, 0, "status", "--address", lab->address, "--json", NULL);
    }
}

static GSubprocess *lab_captures(struct lab *lab, const char *conf) {
    GSubprocess *capture =
        process_start(G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                      (const char *[]){BUILD_DIR "/bin/mesorig", "capture", lab->run->rig, conf,
                                       "-o", lab->run->session, "--yes", NULL});
    lab_waits(lab, "\"state\": \"running\"");
    return capture;
}

/* A daemon that listens anywhere is found, until it ends; one that was killed is not. */
TEST(found) {
    struct operation *run = operator_new(NULL);
    operator_does(run, 1, "status", NULL);
    assert_has(run->err, "no mesorigd is running");
    assert_has(run->err, "MESORIG_ADDRESS");
    struct lab lab = lab_new();
    operator_does(run, 0, "status", NULL);
    assert_has(run->out, lab.run->rig);
    operator_does(run, 0, "watch", NULL);
    assert_has(run->out, "nothing is being captured (rig ");
    lab_clear(&lab, SIGTERM);
    operator_does(run, 1, "status", NULL);
    lab = lab_new();
    lab_clear(&lab, SIGKILL);
    operator_does(run, 1, "status", NULL);
    assert_has(run->err, "no mesorigd is running");
    operator_free(run);
}

/* A rig with a real device needs a daemon, whose command the error gives. */
TEST(real_rig) {
    struct operation *run = operator_new(NULL);
    g_autofree char *text = NULL;
    g_autofree char *real = g_build_filename(run->directory, "real.conf", NULL);
    g_autofree char *words =
        g_strdup_printf("mesorigd --listen unix:path=/tmp/NAME --rig %s", real);
    g_assert_true(g_file_get_contents(run->rig, &text, NULL, NULL));
    g_autoptr(GString) with_board = g_string_new(text);
    g_string_replace(with_board, "driver = sim-interlock",
                     "driver = modbus-inputs\nbus = /dev/null", 1);
    g_string_replace(with_board, "clock = virtual", "clock = real", 1);
    ok(g_file_set_contents(real, with_board->str, -1, ERR));
    operator_does(run, 1, "test", "--rig", real, NULL);
    assert_has(run->err, "real.conf has real devices");
    assert_has(run->err, words);
    operator_free(run);
}

/* With two daemons, a command that names none is refused, and both are listed. */
TEST(two) {
    static const char *const refused[] = {"status", "watch", "pause", "continue", "abort",
                                          "safe",   "test",  "close", NULL};
    struct lab mine = lab_new(), other = lab_new();
    g_autofree char *long_conf = long_session_write(other.run->directory, LONG_RINGS);
    GSubprocess *capture = lab_captures(&other, long_conf);
    for (int i = 0; refused[i]; i++) {
        operator_does(mine.run, 1, refused[i], NULL);
        assert_has(mine.run->err, mine.address);
        assert_has(mine.run->err, other.address);
        assert_has(mine.run->err, mine.run->rig);
        assert_has(mine.run->err, other.run->rig);
        assert_has(mine.run->err, other.run->session);
    }
    operator_does(mine.run, 1, "lamp", "lamp30", "--for", "0.1", NULL);
    assert_has(mine.run->err, other.address);
    lab_waits(&other, "\"state\": \"running\"");

    /* Rig file, session directory, option, environment: each says which. */
    operator_does(mine.run, 0, "lamp", "lamp30", "--for", "0.1", "--rig", mine.run->rig, NULL);
    assert_has(mine.run->out, mine.run->rig);
    operator_does(mine.run, 0, "status", other.run->session, NULL);
    assert_has(mine.run->out, other.run->rig);
    operator_does(mine.run, 1, "pause", other.run->session, "--address", mine.address, NULL);
    assert_has(mine.run->err, "does not capture");
    g_setenv("MESORIG_ADDRESS", mine.address, TRUE);
    operator_does(mine.run, 0, "status", NULL);
    assert_has(mine.run->out, mine.run->rig);
    operator_does(mine.run, 1, "pause", NULL);
    assert_has(mine.run->err, "nothing is being captured");
    operator_does(mine.run, 0, "pause", other.run->session, NULL);
    assert_has(mine.run->out, other.run->session);
    assert_has(mine.run->out, other.run->rig);
    g_unsetenv("MESORIG_ADDRESS");
    operator_does(mine.run, 0, "abort", "--address", other.address, NULL);
    assert_has(mine.run->out, other.run->session);
    g_autofree char *next =
        g_strdup_printf("“mesorig resume %s --address %s”", other.run->session, other.address);
    assert_has(mine.run->out, next);
    g_subprocess_wait(capture, NULL, NULL);
    g_object_unref(capture);
    lab_clear(&mine, SIGTERM);
    lab_clear(&other, SIGTERM);
}

/* “resume” reaches the daemon that has the session's rig open, even if other daemons run. */
TEST(resume) {
    struct lab mine = lab_new(), other = lab_new();
    GSubprocess *capture = lab_captures(&mine, mine.run->conf);
    operator_does(mine.run, 0, "abort", mine.run->session, NULL);
    g_subprocess_wait(capture, NULL, NULL);
    g_object_unref(capture);
    operator_does(mine.run, 0, "resume", mine.run->session, NULL);
    lab_waits(&mine, "\"state\": \"done\""); /* not "aborted", as it was before */
    assert_has(mine.run->out, mine.run->session);
    operator_does(mine.run, 1, "resume", mine.run->session, "--address", other.address, NULL);
    assert_has(mine.run->err, other.address);
    assert_has(mine.run->err, mine.run->rig);
    lab_clear(&mine, SIGTERM);
    lab_clear(&other, SIGTERM);
}

/* A daemon closes its rig when asked, but not during a capture. */
TEST(close) {
    struct lab lab = lab_new();
    GSubprocess *capture = lab_captures(&lab, lab.run->conf);
    operator_does(lab.run, 1, "close", NULL);
    assert_has(lab.run->err, "mesorig abort");
    lab_waits(&lab, "\"state\": \"running\"");
    operator_does(lab.run, 0, "abort", NULL);
    g_subprocess_wait(capture, NULL, NULL);
    g_object_unref(capture);
    operator_does(lab.run, 0, "close", NULL);
    assert_has(lab.run->out, lab.run->rig);
    lab_waits(&lab, "\"state\": \"closed\"");
    lab_clear(&lab, SIGTERM);
}

TEST(errors) {
    struct operation *run = operator_new(NULL);
    operator_does(run, 1, "status", "--address", "unix:path=/no/such/bus", NULL);
    assert_has(run->err, "no mesorigd answers at unix:path=/no/such/bus (No such file");
    assert_has(run->err, "mesorigd --listen unix:path=/no/such/bus --rig RIG");
    operator_does(run, 1, "status", "--address", "nonsense", NULL);
    assert_has(run->err, "“nonsense” is not the address of a mesorigd");
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
