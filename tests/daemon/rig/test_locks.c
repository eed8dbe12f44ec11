/* One daemon has a device at a time: two daemons on the same boards and lines, which are virtual
 * ones; programs that make a rig safe next to a daemon; and a daemon that follows a killed one. */
#include "lib/find_guardian.h"
#include "lib/lines.h"
#include "lib/process.h"
#include "lib/remove_tree.h"

#include <glib/gstdio.h>
#include <signal.h>
#include <string.h>
#include <unistd.h>

#define MESORIGD BUILD_DIR "/bin/mesorigd"
#define MESORIG  BUILD_DIR "/bin/mesorig"
#define WORLD    SOURCE_DIR "/tests/small/world.conf"

struct fixture {
    char *folder, *rig, *other_rig;
    struct lines lines;
    GSubprocess *daemon;
    int pid;
};

static void set_up(struct fixture *fixture, gconstpointer unused) {
    fixture->folder = g_dir_make_tmp("mesorig-locks-XXXXXX", NULL);
    fixture->rig = g_build_filename(fixture->folder, "rig.conf", NULL);
    fixture->other_rig = g_build_filename(fixture->folder, "other.conf", NULL);
    lines_open(&fixture->lines, WORLD);
    g_assert_true(g_file_set_contents(fixture->rig, fixture->lines.text->str, -1, NULL));
}

static GSubprocess *start_daemon(struct fixture *fixture, const char *rig) {
    static int n;
    g_autofree char *address = g_strdup_printf("unix:path=%s/bus%d", fixture->folder, n++);
    return process_start_ready(G_SUBPROCESS_FLAGS_NONE, NULL,
                               (const char *[]){MESORIGD, "--rig", rig, "--listen", address, NULL});
}

static void set_up_daemon(struct fixture *fixture, gconstpointer unused) {
    set_up(fixture, NULL);
    fixture->daemon = start_daemon(fixture, fixture->rig);
    fixture->pid = atoi(g_subprocess_get_identifier(fixture->daemon));
}

static void stop_daemon(struct fixture *fixture, int signal) {
    g_subprocess_send_signal(fixture->daemon, signal);
    g_assert_true(g_subprocess_wait(fixture->daemon, NULL, NULL));
    g_clear_object(&fixture->daemon);
}

static void tear_down(struct fixture *fixture, gconstpointer unused) {
    if (fixture->daemon)
        stop_daemon(fixture, SIGTERM);
    end_guardian(fixture->rig);
    end_guardian(fixture->other_rig);
    lines_close(&fixture->lines);
    remove_tree(fixture->folder);
    g_free(fixture->folder);
    g_free(fixture->rig);
    g_free(fixture->other_rig);
}

static void light_up(struct fixture *fixture) {
    virtual_modbus_set_coil(fixture->lines.devices[LASER], LINES_LASER_COIL, TRUE);
    virtual_modbus_set_coil(fixture->lines.devices[BANK], 0, TRUE);
}

static gboolean is_lit(struct fixture *fixture, enum line line) {
    return lines_has_light(fixture->lines.devices[line]);
}

/* A rig with a camera, an axis on one line and lamps on another. */
static void write_other_rig(struct fixture *fixture, const char *axis_bus, const char *lamps_bus) {
    g_autofree char *text = g_strdup_printf(
        "[rig]\nid = other\nclock = real\n"
        "[camera cam30]\ndriver = sim-camera\nworld = %s\ntheta_deg = 30\nphi_deg = 0\n"
        "distance_mm = 650\nwidth = 32\nheight = 32\nfocal_px = 333\nresponse = 6000\n"
        "[axis turntable]\nmin_deg = -90\nmax_deg = 90\nspeed_deg_s = 2\naccel_deg_s2 = 40\n"
        "driver = modbus-axis\nsteps_per_deg = 100\ntarget_register = 0\nposition_register = 21\n"
        "status_register = 20\nmoving_bit = 0\nhomed_bit = 1\nfault_bit = 2\nstart = 2=1\n"
        "home = 2=2\nstop = 2=3\npoll_ms = 5\nbus = %s\n"
        "[lamps b]\ndriver = modbus-relays\nn = 2\nbus = %s\n"
        "[lamp l]\nbank = b\nindex = 0\ntheta_deg = 30\nphi_deg = 0\ndistance_mm = 500\n",
        WORLD, axis_bus, lamps_bus);
    g_assert_true(g_file_set_contents(fixture->other_rig, text, -1, NULL));
}

/* A daemon on a rig, part of which the first daemon has: it fails, and says who has it. */
static void assert_refused(struct fixture *fixture, const char *words) {
    g_autofree char *address = g_strdup_printf("unix:path=%s/refused", fixture->folder);
    g_autofree char *rig = g_strconcat("--rig ", fixture->rig, NULL);
    g_autofree char *process =
        g_strdup_printf(" (process %d) uses it; use that daemon instead", fixture->pid);
    g_autofree char *said = process_text(
        1, (const char *[]){MESORIGD, "--listen", address, "--rig", fixture->other_rig, NULL});
    g_test_message("%s", said);
    assert_has(said, words);
    assert_has(said, rig);
    assert_has(said, process);
    /* Its guardian leaves the devices to the first daemon. */
    for (int i = 0; i < 3000 && find_guardian(fixture->other_rig); i++)
        g_usleep(10000);
    g_assert_cmpint(find_guardian(fixture->other_rig), ==, 0);
}

/* The board is named as localhost this time. Its lamps stay on. */
static void test_board(struct fixture *fixture, gconstpointer unused) {
    const char *port = strrchr(virtual_modbus_bus(fixture->lines.devices[BANK]), ':');
    g_autofree char *bus = g_strconcat("tcp:localhost", port, NULL);
    g_autofree char *words =
        g_strdup_printf("[lamps b] bus: cannot open unit 1 at %s: mesorigd --rig", bus);
    VirtualModbus *axis = lines_new_device(TRUE);
    write_other_rig(fixture, virtual_modbus_bus(axis), bus);
    light_up(fixture);
    assert_refused(fixture, words);
    g_assert_true(is_lit(fixture, BANK));
    virtual_modbus_free(axis);
}

/* Another unit of the same board is another device. */
static void test_other_unit(struct fixture *fixture, gconstpointer unused) {
    VirtualModbus *axis = lines_new_device(TRUE);
    g_autofree char *bus = g_strdup_printf("%s\nunit = 2\nretries = 0",
                                           virtual_modbus_bus(fixture->lines.devices[BANK]));
    g_autofree char *address = g_strdup_printf("unix:path=%s/refused", fixture->folder);
    write_other_rig(fixture, virtual_modbus_bus(axis), bus);
    light_up(fixture);
    g_autofree char *said = process_text(
        1, (const char *[]){MESORIGD, "--listen", address, "--rig", fixture->other_rig, NULL});
    assert_has(said, " unit 2, "); /* which is not there, and is not refused */
    assert_has(said, "no answer");
    g_assert_true(is_lit(fixture, BANK));
    virtual_modbus_free(axis);
}

/* The line is named by a link this time. */
static void test_line(struct fixture *fixture, gconstpointer unused) {
    g_autofree char *link = g_build_filename(fixture->folder, "by-id", NULL);
    g_autofree char *words =
        g_strdup_printf("[axis turntable] bus: cannot open %s: mesorigd --rig", link);
    VirtualModbus *lamps = lines_new_device(FALSE);
    g_assert_cmpint(symlink(virtual_modbus_bus(fixture->lines.devices[ARC]), link), ==, 0);
    write_other_rig(fixture, link, virtual_modbus_bus(lamps));
    assert_refused(fixture, words);
    virtual_modbus_free(lamps);
}

/* The guardian makes the rig safe while the next daemon starts. */
static void test_after_a_kill(struct fixture *fixture, gconstpointer unused) {
    light_up(fixture);
    stop_daemon(fixture, SIGKILL);
    fixture->daemon = start_daemon(fixture, fixture->rig);
    g_assert_false(is_lit(fixture, LASER));
    g_assert_false(is_lit(fixture, BANK));
}

static void test_after_an_end(struct fixture *fixture, gconstpointer unused) {
    stop_daemon(fixture, SIGTERM);
    fixture->daemon = start_daemon(fixture, fixture->rig);
}

/* Somebody asks for the safe state of a rig that a daemon has: boards are switched off. */
static void test_operator(struct fixture *fixture, gconstpointer unused) {
    g_autofree char *note = g_strdup_printf(
        " (process %d) has the device open, and may switch it on again: end that process, or use "
        "“mesorig safe”",
        fixture->pid);
    g_autofree char *line = g_strdup_printf(" (process %d) uses it; use", fixture->pid);
    light_up(fixture);
    g_autofree char *said =
        process_text(1, (const char *[]){MESORIGD, "--safe-state", fixture->rig, NULL});
    g_test_message("%s", said);
    g_assert_false(is_lit(fixture, LASER));
    g_assert_false(is_lit(fixture, BANK));
    assert_has(said, "laser top: off, read back; mesorigd --rig");
    assert_has(said, note);
    assert_has(said, "axis arc: NOT safe: ");
    assert_has(said, line);
}

/* systemd does so after a service that failed because this daemon has the rig. */
static void test_service(struct fixture *fixture, gconstpointer unused) {
    g_autofree char *line = g_strdup_printf(" (process %d) uses it; use", fixture->pid);
    light_up(fixture);
    g_autofree char *said =
        process_text(1, (const char *[]){"/usr/bin/env", "SERVICE_RESULT=exit-code", MESORIGD,
                                         "--safe-state", fixture->rig, NULL});
    g_test_message("%s", said);
    g_assert_true(is_lit(fixture, LASER));
    g_assert_true(is_lit(fixture, BANK));
    assert_has(said, "laser top: NOT safe: ");
    assert_has(said, line);

    /* By another name of the rig file: no guardian is left for what another daemon has. */
    g_autofree char *other = g_strconcat(fixture->rig, ".other", NULL);
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(fixture->rig, &text, NULL, NULL));
    g_assert_true(g_file_set_contents(other, text, -1, NULL));
    g_autofree char *left =
        process_text(1, (const char *[]){"/usr/bin/env", "SERVICE_RESULT=exit-code", MESORIGD,
                                         "--safe-state", other, NULL});
    assert_has(left, "laser top: NOT safe: ");
    g_assert_cmpint(find_guardian(other), ==, 0);
    g_assert_true(is_lit(fixture, LASER));

    stop_daemon(fixture, SIGKILL);
    g_autofree char *after =
        process_text(0, (const char *[]){"/usr/bin/env", "SERVICE_RESULT=signal", MESORIGD,
                                         "--safe-state", fixture->rig, NULL});
    assert_has(after, "lamps and lasers are off, axes stand");
    g_assert_false(is_lit(fixture, LASER));
}

/* Looking for devices on a line that a daemon has. */
static void test_scan(struct fixture *fixture, gconstpointer unused) {
    g_autofree char *line = g_strdup_printf(" (process %d) uses it; use", fixture->pid);
    g_autofree char *board = g_strdup_printf(" (process %d) uses it\n", fixture->pid);
    const char *pty = virtual_modbus_bus(fixture->lines.devices[ARC]);
    const char *tcp = virtual_modbus_bus(fixture->lines.devices[BANK]);
    g_autofree char *on_line = process_text(
        1, (const char *[]){MESORIG, "devices", "--modbus", pty, "--units", "1", NULL});
    g_test_message("%s", on_line);
    assert_has(on_line, line);
    g_autofree char *on_board = process_text(
        0, (const char *[]){MESORIG, "devices", "--modbus", tcp, "--units", "1", NULL});
    g_test_message("%s", on_board);
    assert_has(on_board, board);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
#define ADD(path, func) g_test_add(path, struct fixture, NULL, set_up_daemon, func, tear_down)
    ADD("/locks/board", test_board);
    ADD("/locks/other-unit", test_other_unit);
    ADD("/locks/line", test_line);
    ADD("/locks/after-a-kill", test_after_a_kill);
    ADD("/locks/after-an-end", test_after_an_end);
    ADD("/locks/operator", test_operator);
    ADD("/locks/service", test_service);
    ADD("/locks/scan", test_scan);
    return g_test_run();
}
