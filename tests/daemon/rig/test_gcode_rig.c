/* A rig whose turntable and arc are on one G-code board: the commands of an operator, and the
 * guardian after the end of the daemon in the middle of a move. */
#include "lib/find_guardian.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/replaying.h"
#include "lib/rig_daemon.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"
#include "virtual/gcode.h"

#include <fcntl.h>
#include <math.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#define SMALL SOURCE_DIR "/tests/small/"

struct bench {
    VirtualGcode *board;
    struct rig_daemon run;
    GSubprocess *mover;
};

static void begin(struct bench *bench, const char *folder, enum virtual_gcode_language language,
                  gboolean resets_on_open) {
    const gboolean klipper = language == VIRTUAL_KLIPPER;
    const char *keys = klipper ? "dialect = klipper\nhoming = axis\n" : "";
    const struct virtual_gcode_options options = {.language = language,
                                                  .n_axes = 3,
                                                  .units_s = 200,
                                                  .units_s2 = 2000,
                                                  .steps = 1000,
                                                  .boot_ms = resets_on_open || klipper ? 200 : 0,
                                                  .resets_on_open = resets_on_open};
    *bench = (struct bench){.board = ok(virtual_gcode_new(&options, ERR))};
    const char *port = virtual_gcode_port(bench->board);
    g_autofree char *text = g_strdup_printf(
        "[rig]\nid = board\nclock = real\narc_radius_mm = 500\n"
        "[axis turntable]\ndriver = gcode-axis\nport = %s\nletter = X\nunits_per_deg = 1\n"
        "wraps = yes\nspeed_deg_s = 20\naccel_deg_s2 = 200\n%s"
        "[axis arc]\ndriver = gcode-axis\nport = %s\nletter = Y\nunits_per_deg = 1\n"
        "min_deg = -10\nmax_deg = 100\nspeed_deg_s = 20\naccel_deg_s2 = 200\n%s",
        port, keys, port, keys);
    /* A rig needs a camera and a lamp as well. */
    g_autofree char *whole =
        g_strconcat(text,
                    "[lamps bank]\ndriver = sim-lamps\nworld = " SMALL "world.conf\n"
                    "[lamp lamp30]\nbank = bank\nindex = 0\ntheta_deg = 30\ndistance_mm = "
                    "500\n" RIG_DAEMON_CAMERA,
                    NULL);
    rig_daemon_begin(&bench->run, folder, whole);
}

static void end(struct bench *bench) {
    rig_daemon_end(&bench->run);
    g_clear_object(&bench->mover);
    virtual_gcode_free(bench->board);
}

static struct virtual_gcode_state state_of(const struct bench *bench) {
    struct virtual_gcode_state state;
    virtual_gcode_state(bench->board, &state);
    return state;
}

TEST(operator) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, VIRTUAL_GRBL, TRUE);
    g_autofree char *tested = process_mesorig(0, "test --address %s", bench.run.address);
    assert_has(tested, "4 of 4 are as they should be");
    g_free(process_mesorig(0, "home --address %s turntable", bench.run.address));
    g_free(process_mesorig(0, "home --address %s arc", bench.run.address));
    g_free(process_mesorig(0, "move --address %s turntable 12.5", bench.run.address));
    g_free(process_mesorig(0, "move --address %s arc 30", bench.run.address));
    g_assert_cmpfloat(fabs(state_of(&bench).at[0] - 12.5), <, 0.002);
    g_assert_cmpfloat(fabs(state_of(&bench).at[1] - 30), <, 0.002);
    g_autofree char *status = process_mesorig(0, "status --address %s", bench.run.address);
    assert_has(status, "gcode-axis");
    end(&bench);
}

/* What the board has said to two axes in a test by the operator can be replayed. The rig stays open
 * for others. */
TEST(recorded) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, VIRTUAL_GRBL, TRUE);
    g_autofree char *path = g_build_filename(folder, "board.rec", NULL);
    g_autofree char *page = g_build_filename(folder, "board.html", NULL);
    g_free(process_mesorig(0, "test --address %s --record %s --report %s", bench.run.address, path,
                           page));
    g_autofree char *status = process_mesorig(0, "status --address %s", bench.run.address);
    assert_has(status, "gcode-axis");
    end(&bench);
    g_autofree char *text = text_file_read(path), *html = text_file_read(page);
    assert_has(text, "\n@1 = serial\n");
    assert_has(text, "[axis arc] move to 5.0000\n");
    g_assert_null(strstr(text, folder));
    g_assert_null(strstr(html, folder));
    assert_has(html, "<h1>Test of the rig board</h1>");
    replaying_well(text, path);
}

/* A board that answers nothing: the command fails, and its files say what happened. */
TEST(recorded__silence) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    const struct virtual_gcode_faults silent = {.silent = TRUE};
    begin(&bench, folder, VIRTUAL_GRBL, FALSE);
    g_free(process_mesorig(0, "close --address %s", bench.run.address));
    virtual_gcode_fail(bench.board, &silent);
    g_autofree char *path = g_build_filename(folder, "board.rec", NULL);
    g_autofree char *page = g_build_filename(folder, "board.html", NULL);
    g_free(process_mesorig(1, "test --address %s --rig %s --record %s --report %s",
                           bench.run.address, bench.run.rig, path, page));
    g_autofree char *text = text_file_read(path), *html = text_file_read(page);
    assert_has(text, "[axis turntable] = failed: axis turntable: @1: the board has not answered");
    assert_has(html, "<span class=\"failure\">failure</span>");
    assert_has(html, "<th>axis turntable</th><td>axis turntable: @1: the board has not answered");
    end(&bench);
}

/* The daemon ends while the turntable is on a way of 9 s. */
static void abandoned(int signal, enum virtual_gcode_language language, gboolean resets_on_open) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder, language, resets_on_open);
    g_free(process_mesorig(0, "home --address %s turntable", bench.run.address));
    bench.mover = process_start(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                                (const char *[]){BUILD_DIR "/bin/mesorig", "move", "--address",
                                                 bench.run.address, "turntable", "180", NULL});
    UNTIL (state_of(&bench).moving &&fabs(state_of(&bench).at[0]) > 2)
        g_usleep(1000);
    const gint64 begun = g_get_monotonic_time();
    g_subprocess_send_signal(bench.run.daemon, signal);
    UNTIL (!state_of(&bench).moving)
        g_usleep(1000);
    g_test_message("the turntable stands %.2f s after the end of the daemon",
                   (double)(g_get_monotonic_time() - begun) * 1e-6);
    UNTIL (!find_guardian(bench.run.rig))
        g_usleep(10000);
    g_autofree char *log = text_file_read(bench.run.log);
    g_test_message("%s", log);
    g_assert_false(state_of(&bench).moving);
    g_assert_cmpfloat(fabs(state_of(&bench).at[0]), <, 175);
    /* What the daemon or its guardian says. */
    if (signal == SIGTERM) {
        assert_has(log, "mesorigd: the rig is safe\n");
    } else {
        assert_has(log, "axis turntable: stands, read back\n");
        assert_has(log, "axis arc: stands, read back\n");
    }
    end(&bench);
}

/* Two boards. The first one is silent, which is known after 20 s at the earliest. Meanwhile the
 * second one must be stopped, whose way takes 9 s. */
TEST(beside_a_silent_board) {
    static const char way[] = "$X\nG21G90G94G53G1X180F1200\n";
    const struct virtual_gcode_options options = {
        .n_axes = 3, .units_s = 200, .units_s2 = 2000, .steps = 1000};
    const struct virtual_gcode_faults silent = {.silent = TRUE};
    TEMPORARY_FOLDER(folder);
    struct bench bench = {.board = ok(virtual_gcode_new(&options, ERR))};
    VirtualGcode *other = ok(virtual_gcode_new(&options, ERR));
    virtual_gcode_fail(other, &silent);
    g_autofree char *path = g_build_filename(folder, "rig.conf", NULL);
    g_autofree char *text = g_strdup_printf(
        "[rig]\nid = boards\nclock = real\narc_radius_mm = 500\n"
        "[axis arc]\ndriver = gcode-axis\nport = %s\nletter = X\nunits_per_deg = 1\n"
        "boot_ms = 20000\nspeed_deg_s = 20\naccel_deg_s2 = 200\n"
        "[axis turntable]\ndriver = gcode-axis\nport = %s\nletter = X\nunits_per_deg = 1\n"
        "wraps = yes\nspeed_deg_s = 20\naccel_deg_s2 = 200\n",
        virtual_gcode_port(other), virtual_gcode_port(bench.board));
    g_assert_true(g_file_set_contents(path, text, -1, NULL));
    const int fd = open(virtual_gcode_port(bench.board), O_RDWR | O_NOCTTY | O_CLOEXEC);
    g_assert_cmpint(write(fd, way, strlen(way)), ==, strlen(way));
    UNTIL (state_of(&bench).moving)
        g_usleep(1000);
    close(fd);
    GSubprocess *making =
        process_start(G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
                      (const char *[]){BUILD_DIR "/bin/mesorigd", "--safe-state", path, NULL});
    UNTIL (!state_of(&bench).moving)
        g_usleep(1000);
    g_test_message("the turntable stands at %.1f°", state_of(&bench).at[0]);
    g_assert_cmpfloat(state_of(&bench).at[0], <, 170);
    g_subprocess_force_exit(making);
    g_object_unref(making);
    virtual_gcode_free(other);
    virtual_gcode_free(bench.board);
}

TEST(killed) {
    abandoned(SIGKILL, VIRTUAL_GRBL, FALSE);
}

TEST(killed_arduino) {
    abandoned(SIGKILL, VIRTUAL_GRBL, TRUE);
}

TEST(hangs) {
    abandoned(SIGSTOP, VIRTUAL_GRBL, FALSE);
}

TEST(told_to_end) {
    abandoned(SIGTERM, VIRTUAL_GRBL, FALSE);
}

TEST(killed_klipper) {
    abandoned(SIGKILL, VIRTUAL_KLIPPER, FALSE);
}

TEST(hangs_klipper) {
    abandoned(SIGSTOP, VIRTUAL_KLIPPER, FALSE);
}
