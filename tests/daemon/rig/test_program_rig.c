/* A rig whose turntable, lamps and camera are programs: the commands of an operator, and the
 * guardian after ends of the daemon and of the programs. */
#include "lib/find_guardian.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/program_model.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/text_file.h"
#include "lib/wait.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>

#define MESORIGD BUILD_DIR "/bin/mesorigd"
#define DARK     "{\"on\": [false, false, false, false]}"
#define LIT      "{\"on\": [true, true, true, true]}"

struct bench {
    const char *folder;
    char *lamps, *axis, *camera; /* folders of the devices */
    char *rig, *log, *address;
    GSubprocess *daemon;
};

static void write_rig(const struct bench *bench) {
    g_autofree char *text = g_strdup_printf(
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
    text_file_write(bench->folder, "rig.conf", text);
}

static char *make_folder(const char *in, const char *name) {
    char *path = g_build_filename(in, name, NULL);
    g_assert_cmpint(g_mkdir(path, 0700), ==, 0);
    return path;
}

static void begin(struct bench *bench, const char *folder) {
    *bench = (struct bench){.folder = folder,
                            .lamps = make_folder(folder, "lamps"),
                            .axis = make_folder(folder, "axis"),
                            .camera = make_folder(folder, "camera"),
                            .rig = g_build_filename(folder, "rig.conf", NULL),
                            .log = g_build_filename(folder, "log", NULL),
                            .address = g_strdup_printf("unix:path=%s/bus", folder)};
    write_rig(bench);
    /* What the guardian prints of each device is for the log as well. */
    bench->daemon = process_start_ready(G_SUBPROCESS_FLAGS_NONE, bench->log,
                                        (const char *[]){"/bin/sh", "-c", "exec \"$@\" >&2", "sh",
                                                         MESORIGD, "--listen", bench->address,
                                                         "--rig", bench->rig, NULL});
    g_assert_cmpint(find_guardian(bench->rig), !=, 0);
}

static void end(struct bench *bench) {
    g_subprocess_force_exit(bench->daemon);
    g_subprocess_wait(bench->daemon, NULL, NULL);
    end_guardian(bench->rig);
    UNTIL (program_model_processes(bench->lamps) == 0 &&
           program_model_processes(bench->axis) == 0 && program_model_processes(bench->camera) == 0)
        g_usleep(10000);
    g_object_unref(bench->daemon);
    g_free(bench->lamps);
    g_free(bench->axis);
    g_free(bench->camera);
    g_free(bench->rig);
    g_free(bench->log);
    g_free(bench->address);
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
    UNTIL (!find_guardian(bench->rig))
        g_usleep(10000);
    g_autofree char *log = text_file_read(bench->log);
    assert_has(log, "lamps bank: off, read back\n");
    assert_has(log, "axis turntable: stands, read back\n");
    assert_has(log, "lamps and lasers are off, axes stand\n");
}

TEST(operator) {
    TEMPORARY_FOLDER(folder);
    struct bench bench;
    begin(&bench, folder);
    g_autofree char *tested = process_mesorig(0, "test --address %s", bench.address);
    assert_has(tested, "3 of 3 are as they should be");
    g_autofree char *status = process_mesorig(0, "status --address %s", bench.address);
    assert_has(status, "program-camera   ok");
    g_assert_cmpint(program_model_asked(bench.lamps, "set"), ==, 2);
    g_assert_cmpint(program_model_asked(bench.axis, "move"), ==, 3);
    light_up(&bench);
    g_subprocess_send_signal(bench.daemon, SIGTERM);
    g_subprocess_wait(bench.daemon, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(bench.daemon), ==, 0);
    g_assert_true(is(&bench, DARK));
    g_autofree char *log = text_file_read(bench.log);
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
    g_subprocess_send_signal(bench.daemon, SIGKILL);
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
    g_subprocess_send_signal(bench.daemon, SIGSTOP);
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
    g_subprocess_send_signal(bench.daemon, SIGKILL);
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
    g_subprocess_send_signal(bench.daemon, SIGKILL);
    const int hellos = program_model_asked(bench.lamps, "hello");
    UNTIL (program_model_asked(bench.lamps, "hello") > hellos)
        g_usleep(5000);
    g_assert_true(is(&bench, LIT));
    program_model_fail(bench.lamps, "");
    wait_dark(&bench);
    assert_made_safe(&bench);
    end(&bench);
}
