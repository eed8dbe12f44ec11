/* A rig whose turntable, lamps and camera are programs: the commands of an operator, and the
 * guardian after ends of the daemon and of the programs. */
#include "lib/find_guardian.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/program_model.h"
#include "lib/remove_tree.h"
#include "lib/rig_daemon.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>

#define DARK "{\"on\": [false, false, false, false]}"
#define LIT  "{\"on\": [true, true, true, true]}"

struct bench {
    char *lamps, *axis, *camera; /* folders of the devices */
    struct rig_daemon run;
};

static char *rig_text(const struct bench *bench) {
    return g_strdup_printf(
        "[rig]\nid = programs\narc_radius_mm = 500\n"
        "[axis turntable]\ndriver = program-axis\nprogram = " PROGRAM_PYTHON
        "\narguments = " PROGRAM_MODEL ";axis;%s\nwraps = yes\nspeed_deg_s = 90\n"
        "accel_deg_s2 = 400\nstart_s = 20\n"
        "[lamps bank]\ndriver = program-lamps\nprogram = " PROGRAM_PYTHON
        "\narguments = " PROGRAM_MODEL ";lamps;%s\nstart_s = 20\n"
        "[lamp l]\nbank = bank\nindex = 2\ntheta_deg = 30\nphi_deg = 10\ndistance_mm = 500\n"
        "[camera top]\ndriver = program-camera\nprogram = " PROGRAM_PYTHON
        "\narguments = " PROGRAM_MODEL ";camera;%s\nstart_s = 20\ntheta_deg = 0\nphi_deg = 0\n"
        "distance_mm = 650\nwidth = 8\nheight = 6\nfocal_px = 83\n",
        bench->axis, bench->lamps, bench->camera);
}

static char *make_folder(const char *in, const char *name) {
    char *path = g_build_filename(in, name, NULL);
    g_assert_cmpint(g_mkdir(path, 0700), ==, 0);
    return path;
}

static void begin(struct bench *bench, const char *folder) {
    *bench = (struct bench){.lamps = make_folder(folder, "lamps"),
                            .axis = make_folder(folder, "axis"),
                            .camera = make_folder(folder, "camera")};
    g_autofree char *text = rig_text(bench);
    rig_daemon_begin(&bench->run, folder, text);
}

static void end(struct bench *bench) {
    rig_daemon_end(&bench->run);
    UNTIL (program_model_processes(bench->lamps) == 0 &&
           program_model_processes(bench->axis) == 0 && program_model_processes(bench->camera) == 0)
        g_usleep(10000);
    g_free(bench->lamps);
    g_free(bench->axis);
    g_free(bench->camera);
}

/* As if the daemon had switched them on. */
static void light_up(const struct bench *bench) {
    text_file_write(bench->lamps, "hardware.json", LIT);
}

static gboolean is(const struct bench *bench, const char *state) {
    g_autofree char *hardware = program_model_read(bench->lamps, "hardware.json");
    return strcmp(g_strchomp(hardware), state) == 0;
}

static void wait_dark(const struct bench *bench) {
    UNTIL (is(bench, DARK))
        g_usleep(5000);
}

/* The guardian has read the devices back. */
static void assert_made_safe(const struct bench *bench) {
    UNTIL (!find_guardian(bench->run.rig))
        g_usleep(10000);
    g_autofree char *log = text_file_read(bench->run.log);
    assert_has(log, "lamps bank: off, read back\n");
    assert_has(log, "axis turntable: stands, read back\n");
    assert_has(log, "lamps and lasers are off, axes stand\n");
}

TEST(operator) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    g_autofree char *tested = process_mesorig(0, "test --address %s", bench.run.address);
    assert_has(tested, "3 of 3 are as they should be");
    g_autofree char *status = process_mesorig(0, "status --address %s", bench.run.address);
    assert_has(status, "program-camera   ok");
    g_assert_cmpint(program_model_asked(bench.lamps, "set"), ==, 2);
    g_assert_cmpint(program_model_asked(bench.axis, "move"), ==, 3);
    light_up(&bench);
    g_subprocess_send_signal(bench.run.daemon, SIGTERM);
    g_subprocess_wait(bench.run.daemon, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(bench.run.daemon), ==, 0);
    g_assert_true(is(&bench, DARK));
    g_autofree char *log = text_file_read(bench.run.log);
    assert_has(log, "mesorigd: the rig is safe\n");
    end(&bench);
}

/* The programs do not make their devices safe at the end of their input. */
TEST(killed) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    program_model_fail(bench.lamps, "stays");
    light_up(&bench);
    g_subprocess_send_signal(bench.run.daemon, SIGKILL);
    wait_dark(&bench);
    assert_made_safe(&bench);
    end(&bench);
}

/* The daemon hangs: the guardian kills it. */
TEST(stopped) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    program_model_fail(bench.lamps, "stays");
    light_up(&bench);
    g_subprocess_send_signal(bench.run.daemon, SIGSTOP);
    wait_dark(&bench);
    assert_made_safe(&bench);
    end(&bench);
}

/* The daemon and the program are killed together. */
TEST(killed_together) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    light_up(&bench);
    program_model_kill(bench.lamps);
    g_subprocess_send_signal(bench.run.daemon, SIGKILL);
    wait_dark(&bench);
    assert_made_safe(&bench);
    end(&bench);
}

/* The program hangs when the daemon is killed, and so does each one that the guardian starts, until
 * the fault is gone. */
TEST(hangs) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    light_up(&bench);
    program_model_fail(bench.lamps, "sleeps");
    const int pings = program_model_asked(bench.lamps, "ping");
    UNTIL (program_model_asked(bench.lamps, "ping") > pings) /* it sleeps now */
        g_usleep(5000);
    g_subprocess_send_signal(bench.run.daemon, SIGKILL);
    const int hellos = program_model_asked(bench.lamps, "hello");
    UNTIL (program_model_asked(bench.lamps, "hello") > hellos)
        g_usleep(5000);
    g_assert_true(is(&bench, LIT));
    program_model_fail(bench.lamps, "");
    wait_dark(&bench);
    assert_made_safe(&bench);
    end(&bench);
}
