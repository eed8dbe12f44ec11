/* Devices that are operated by hand, with the programs: what the devices do, and when a command is
 * refused. When the program that holds a device has ended, its light is off and its axis stands. */
#include <glib/gstdio.h>
#include <math.h>
#include <signal.h>
#include <string.h>

#include "exr/exr.h"
#include "lib/ok.h"
#include "lib/operator.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/wait.h"

#define MESORIG  BUILD_DIR "/bin/mesorig"
#define MESORIGD BUILD_DIR "/bin/mesorigd"

/* A small rig on a real clock, and a daemon that has it open. */
struct desk {
    struct operation *run;
    char *address;
    GSubprocess *daemon;
};

static const struct change real_clock = {"[rig]", "clock = real"};

static void desk_does(struct desk *desk, int code, const char *line) {
    g_auto(GStrv) words = g_strsplit(line, " ", -1);
    g_autofree char *address = g_strconcat("--address=", desk->address, NULL);
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_ptr_array_add(argv, (gpointer)MESORIG);
    g_ptr_array_add(argv, words[0]);
    g_ptr_array_add(argv, address);
    for (char **word = words + 1; *word; word++)
        g_ptr_array_add(argv, *word);
    g_ptr_array_add(argv, NULL);
    g_clear_pointer(&desk->run->out, g_free);
    g_clear_pointer(&desk->run->err, g_free);
    const int is = process_run((const char *const *)argv->pdata, &desk->run->out, &desk->run->err);
    if (is != code)
        g_error("mesorig %s: exit code %d, not %d\n%s%s", line, is, code, desk->run->out,
                desk->run->err);
}

static GSubprocess *desk_begins(struct desk *desk, const char *line) {
    g_auto(GStrv) words = g_strsplit(line, " ", -1);
    g_autofree char *address = g_strconcat("--address=", desk->address, NULL);
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    g_ptr_array_add(argv, (gpointer)MESORIG);
    g_ptr_array_add(argv, words[0]);
    g_ptr_array_add(argv, address);
    for (char **word = words + 1; *word; word++)
        g_ptr_array_add(argv, *word);
    g_ptr_array_add(argv, NULL);
    return process_start(G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_SILENCE,
                         NULL, (const char *const *)argv->pdata);
}

static void desk_ends(GSubprocess *program, int signal) {
    g_subprocess_send_signal(program, signal);
    g_subprocess_wait(program, NULL, NULL);
    g_object_unref(program);
}

/* Whether the daemon's devices have this, which is written as in JSON, without a start of mesorig.
 */
static gboolean daemon_has(const struct desk *desk, const char *device) {
    g_autoptr(GVariant) properties = operator_properties(desk->address);
    g_autoptr(GVariant) devices = g_variant_lookup_value(properties, "Devices", NULL);
    g_autofree char *text = g_variant_print(devices, FALSE),
                    *wanted = g_strdelimit(g_strdup(device), "\"", '\'');
    return strstr(text, wanted) != NULL;
}

/* Until the daemon says this of a device. */
static void desk_waits(struct desk *desk, const char *device) {
    UNTIL (daemon_has(desk, device))
        g_usleep(20000);
    desk_does(desk, 0, "status --json");
    assert_has(desk->run->out, device);
}

static void desk_waits_for_state(struct desk *desk, const char *state) {
    g_autofree char *wanted = g_strdup_printf("\"state\": \"%s\"", state);
    desk_does(desk, 0, "status --json");
    UNTIL (strstr(desk->run->out, wanted)) {
        g_usleep(50000);
        desk_does(desk, 0, "status --json");
    }
}

static struct desk desk_new(const struct change *changes) {
    struct desk desk = {.run = operator_new(changes)};
    desk.address = g_strdup_printf("unix:path=%s/bus", desk.run->directory);
    desk.daemon = process_start_ready(
        G_SUBPROCESS_FLAGS_STDOUT_SILENCE | G_SUBPROCESS_FLAGS_STDERR_SILENCE, NULL,
        (const char *[]){MESORIGD, "--listen", desk.address, "--rig", desk.run->rig, NULL});
    desk_waits_for_state(&desk, "idle");
    return desk;
}

static void desk_clear(struct desk *desk) {
    desk_ends(desk->daemon, SIGTERM);
    operator_free(desk->run);
    g_free(desk->address);
}

/* A number of the last command's JSON. */
static double number(const struct desk *desk, const char *key) {
    g_autofree char *name = g_strdup_printf("\"%s\": ", key);
    const char *at = strstr(desk->run->out, name);
    if (!at)
        g_error("no %s in %s", key, desk->run->out);
    return g_ascii_strtod(at + strlen(name), NULL);
}

TEST(snap) {
    struct desk desk = desk_new((const struct change[]){real_clock, {0}});
    desk_does(&desk, 0, "status --json");
    assert_has(desk.run->out, "\"simulated\": true"); /* though its clock is not */
    desk_does(&desk, 0, "snap cam30 --json");
    const double dark_dn = number(&desk, "mean_dn");
    g_assert_cmpfloat(number(&desk, "dark_pct"), >, 90);
    desk_does(&desk, 0, "snap cam30 --lamp lamp30 --json");
    const double lit_dn = number(&desk, "mean_dn");
    g_assert_cmpfloat(number(&desk, "dark_pct"), <, 50);
    g_assert_cmpfloat(number(&desk, "saturated_pct"), ==, 0);
    /* Light grows with the exposure. */
    desk_does(&desk, 0, "snap cam30 --lamp lamp30 -e 20000 --json");
    g_assert_cmpfloat_with_epsilon((number(&desk, "mean_dn") - dark_dn) / (lit_dn - dark_dn), 2,
                                   0.1);
    desk_does(&desk, 0, "snap cam30 --lamp lamp30 -e 500000 --json");
    g_assert_cmpfloat(number(&desk, "saturated_pct"), >, 40);
    desk_does(&desk, 0, "snap cam30");
    assert_has(desk.run->out, "the picture is dark: --lamp NAME");
    desk_does(&desk, 0, "snap cam30 --lamp lamp30");
    g_assert_null(strstr(desk.run->out, "the picture is dark"));
    assert_has(desk.run->out, "cam30  32 × 32 pixels of 12 bits (rggb), exposed for 10000 µs");
    desk_waits(&desk, "\"lamps\", \"bank\", \"sim-lamps\", \"off\"");
    desk_does(&desk, 1, "snap nobody");
    assert_has(desk.run->err, "no camera “nobody”; choose from: cam30, cam60");
    desk_does(&desk, 1, "snap cam30 -e 100000000000");
    assert_has(desk.run->err, "cam30");
    desk_does(&desk, 2, "snap cam30 -e -5");
    desk_clear(&desk);
}

/* The file of what the sensor gave has what was told of it. */
TEST(files) {
    struct desk desk = desk_new((const struct change[]){real_clock, {0}});
    g_autofree char *exr = g_build_filename(desk.run->directory, "x.exr", NULL);
    g_autofree char *png = g_build_filename(desk.run->directory, "x.png", NULL);
    g_autofree char *jpg = g_build_filename(desk.run->directory, "x.jpg", NULL);
    g_autofree char *to_exr = g_strdup_printf("snap cam60 --lamp lamp60 --json -o %s", exr);
    g_autofree char *to_png = g_strdup_printf("snap cam60 --lamp lamp60 -o %s", png);
    g_autofree char *to_jpg = g_strdup_printf("snap cam60 --lamp lamp60 -o %s", jpg);
    g_autofree char *data = NULL;
    desk_does(&desk, 0, to_exr);
    struct exr_part *part = ok(exr_read_part(exr, "frame", ERR));
    const float *values = exr_part_plane(part, "Y");
    double sum = 0, most = 0;
    for (int i = 0; i < 32 * 32; i++) {
        sum += values[i];
        most = fmax(most, values[i]);
    }
    g_assert_cmpfloat_with_epsilon(sum / (32 * 32), number(&desk, "mean_dn"), 1e-6);
    g_assert_cmpfloat(most, ==, number(&desk, "max_dn"));
    exr_part_free(part);
    desk_does(&desk, 0, to_png);
    ok(g_file_get_contents(png, &data, NULL, ERR));
    g_assert_true(g_str_has_prefix(data, "\x89PNG"));
    desk_does(&desk, 1, to_jpg);
    assert_has(desk.run->err, "give a name that ends in .png or .exr");
    desk_does(&desk, 0, "live cam30 -n 3 --json");
    g_auto(GStrv) lines = g_strsplit(g_strstrip(desk.run->out), "\n", -1);
    g_assert_cmpint(g_strv_length(lines), ==, 3);
    desk_clear(&desk);
}

TEST(axes) {
    struct desk desk = desk_new((const struct change[]){real_clock, {0}});
    desk_does(&desk, 1, "move turntable 30");
    assert_has(desk.run->err, "home it first");
    desk_does(&desk, 0, "home turntable --json");
    desk_does(&desk, 0, "move turntable 30 --json");
    g_assert_cmpfloat_with_epsilon(number(&desk, "position_deg"), 30, 0.05);
    desk_does(&desk, 0, "home sweep30");
    desk_does(&desk, 1, "move sweep30 80");
    assert_has(desk.run->err, "outside its limits, -15 to 15°");
    desk_does(&desk, 0, "move -- sweep30 -10");
    assert_has(desk.run->out, "sweep30 stands at -10°");
    desk_does(&desk, 1, "move lid 3");
    assert_has(desk.run->err, "turntable, arc, sweep30, sweep60");
    desk_does(&desk, 2, "move turntable far");
    desk_clear(&desk);
}

/* Whoever holds a light or an axis is killed. */
TEST(killed) {
    struct desk desk = desk_new(
        (const struct change[]){real_clock, {"[axis turntable]", "speed_deg_s = 0.5"}, {0}});
    GSubprocess *lamp = desk_begins(&desk, "lamp lamp30");
    desk_waits(&desk, "\"bank\", \"sim-lamps\", \"1 on\"");
    GSubprocess *laser = desk_begins(&desk, "laser laser60");
    desk_waits(&desk, "\"laser60\", \"sim-laser\", \"on\"");
    desk_ends(laser, SIGKILL);
    desk_waits(&desk, "\"laser60\", \"sim-laser\", \"off\"");
    assert_has(desk.run->out, "\"bank\", \"sim-lamps\", \"1 on\""); /* another's stays */
    desk_ends(lamp, SIGKILL);
    desk_waits(&desk, "\"bank\", \"sim-lamps\", \"off\"");
    desk_does(&desk, 0, "home turntable");
    GSubprocess *move = desk_begins(&desk, "move turntable 179"); /* 6 min */
    desk_waits(&desk, "\"turntable\", \"sim-axis\", \"moving\"");
    desk_does(&desk, 1, "move turntable 3");
    assert_has(desk.run->err, "busy");
    desk_ends(move, SIGKILL);
    desk_waits(&desk, "\"turntable\", \"sim-axis\", \"ok\"");
    lamp = desk_begins(&desk, "lamp lamp30");
    desk_waits(&desk, "\"bank\", \"sim-lamps\", \"1 on\"");
    desk_does(&desk, 0, "safe");
    assert_has(desk.run->out, "mesorig release");
    desk_waits(&desk, "\"bank\", \"sim-lamps\", \"off\"");
    desk_ends(lamp, SIGKILL);
    desk_does(&desk, 1, "lamp lamp30 --for 1");
    assert_has(desk.run->err, "mesorig release");
    desk_does(&desk, 0, "status");
    assert_has(desk.run->out, "held in the safe state until");
    desk_does(&desk, 0, "release");
    assert_has(desk.run->out, "may use light and move again");
    desk_does(&desk, 0, "lamp lamp30 --for 3");
    /* The daemon measures the time of a command that is stopped, as by Ctrl-Z. */
    GSubprocess *stopped = desk_begins(&desk, "laser laser60 --for 10");
    desk_waits(&desk, "\"laser60\", \"sim-laser\", \"on\"");
    g_subprocess_send_signal(stopped, SIGSTOP);
    desk_waits(&desk, "\"laser60\", \"sim-laser\", \"off\"");
    desk_ends(stopped, SIGKILL);
    /* By Ctrl-C it is off before the command ends. */
    lamp = desk_begins(&desk, "lamp lamp60");
    desk_waits(&desk, "\"bank\", \"sim-lamps\", \"1 on\"");
    desk_ends(lamp, SIGINT);
    desk_does(&desk, 0, "status --json");
    assert_has(desk.run->out, "\"bank\", \"sim-lamps\", \"off\"");
    desk_clear(&desk);
}

/* During a session no device can be operated by hand, not even while the session is paused.
 * Operations by hand end when a session begins. */
TEST(capture) {
    static const char *const refused[] = {"snap cam30",     "lamp lamp30", "laser laser30",
                                          "home turntable", "test",        "live cam30"};
    struct desk desk = desk_new((const struct change[]){real_clock, {0}});
    GSubprocess *lamp = desk_begins(&desk, "lamp lamp60");
    desk_waits(&desk, "\"bank\", \"sim-lamps\", \"1 on\"");
    g_autofree char *line =
        g_strdup_printf("capture %s %s -o %s", desk.run->rig, desk.run->conf, desk.run->session);
    GSubprocess *capture = desk_begins(&desk, line);
    desk_waits_for_state(&desk, "running");
    for (gsize i = 0; i < G_N_ELEMENTS(refused); i++) {
        desk_does(&desk, 1, refused[i]);
        assert_has(desk.run->err, "is being captured");
    }
    desk_does(&desk, 0, "pause");
    desk_waits_for_state(&desk, "paused");
    desk_does(&desk, 1, "lamp lamp30");
    assert_has(desk.run->err, "is being captured on this rig (state: paused)");
    desk_does(&desk, 0, "abort");
    desk_does(&desk, 0, "lamp lamp30 --for 3");
    desk_ends(capture, SIGKILL);
    desk_ends(lamp, SIGKILL);
    desk_clear(&desk);
}

/* The door is open from the beginning for two seconds. */
TEST(interlock) {
    struct desk desk = desk_new(
        (const struct change[]){real_clock, {"[interlock door]", "open_after_s = 0.001"}, {0}});
    desk_waits(&desk, "\"door\", \"sim-interlock\", \"open\"");
    desk_does(&desk, 1, "laser laser30");
    assert_has(desk.run->err, "door");
    desk_does(&desk, 1, "home turntable");
    assert_has(desk.run->err, "door");
    desk_does(&desk, 0, "lamp lamp30 --for 3");
    desk_does(&desk, 0, "snap cam30");
    desk_does(&desk, 1, "test");
    assert_has(desk.run->out, "FAIL interlock  door");
    assert_has(desk.run->out, "FAIL laser      laser30");
    assert_has(desk.run->out, "ok   lamp       lamp30");
    desk_clear(&desk);
}

/* Returns FALSE if the door is open before the laser is on and the axis moves. */
static gboolean opens_in_between(int after_s) {
    g_autofree char *opens = g_strdup_printf("open_after_s = %d", after_s);
    struct desk desk = desk_new((const struct change[]){
        real_clock, {"[axis turntable]", "speed_deg_s = 1"}, {"[interlock door]", opens}, {0}});
    static const char open[] = "\"door\", \"sim-interlock\", \"open\"";
    static const char moving[] = "\"turntable\", \"sim-axis\", \"moving\"";
    static const char on[] = "\"laser60\", \"sim-laser\", \"on\"";
    g_autoptr(GSubprocess) home = desk_begins(&desk, "home turntable");
    g_subprocess_wait(home, NULL, NULL);
    GSubprocess *move = desk_begins(&desk, "move turntable 179");
    GSubprocess *laser = desk_begins(&desk, "laser laser60");
    gboolean both = FALSE, opened = FALSE;
    UNTIL (both || opened) {
        both = daemon_has(&desk, moving) && daemon_has(&desk, on);
        opened = daemon_has(&desk, open);
    }
    desk_waits(&desk, open);
    desk_waits(&desk, "\"laser60\", \"sim-laser\", \"off\"");
    desk_waits(&desk, "\"turntable\", \"sim-axis\", \"ok\"");
    g_subprocess_wait(laser, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(laser), ==, 1);
    g_subprocess_wait(move, NULL, NULL);
    g_assert_cmpint(g_subprocess_get_exit_status(move), ==, 1);
    g_object_unref(laser);
    g_object_unref(move);
    desk_clear(&desk);
    return both;
}

/* It opens while a laser is on and an axis moves. On a busy computer they begin later. */
TEST(opened) {
    int after_s = 12;
    UNTIL (opens_in_between(after_s))
        after_s *= 2;
}

/* test passes a rig that is as it should be, and names what is not. Virtual time: no daemon runs.
 */
TEST(test) {
    struct operation *run = operator_new(NULL);
    operator_does(run, 0, "test", "--rig", run->rig, NULL);
    assert_has(run->out, "11 of 11 are as they should be");
    operator_does(run, 1, "test", NULL); /* whichever rig */
    operator_free(run);
    run = operator_new((const struct change[]){{"[lamps bank]", "fault_dead = lamp60"}, {0}});
    operator_does(run, 1, "test", "--rig", run->rig, NULL);
    assert_has(run->out, "FAIL lamp       lamp60           switched on and off, but none of 2");
    assert_has(run->out, "10 of 11");
    operator_free(run);
    run = operator_new((const struct change[]){{"[camera cam60]", "fault_lost = 1"}, {0}});
    operator_does(run, 1, "test", "--rig", run->rig, "--json", NULL);
    assert_has(run->out, "{\"class\": \"camera\", \"name\": \"cam60\", \"good\": false");
    assert_has(run->out, "{\"class\": \"lamp\", \"name\": \"lamp60\", \"good\": true");
    operator_free(run);
}

TESTS_RUN_BY(operator_tests);
