/* The driver gcode-axis on Klipper itself, which tests/klipper/run builds and starts:
 *
 *     klipper_conformance PORT PINS
 *
 * PINS is the file in which pins.c counts the steps of the motors, which are the truth. The limit
 * switches are at the upper end, at 100°, where Klipper homes. */
#include "conformance/conformance.h"
#include "lib/axis_bench.h"
#include "lib/ok.h"
#include "lib/wait.h"
#include "serial/devices.h"

#include <fcntl.h>
#include <gio/gio.h>
#include <math.h>
#include <string.h>
#include <sys/mman.h>
#include <unistd.h>

#define STEPS_PER_DEG (3200 / 360.0)
#define NEAR_DEG      0.12 /* a step */
#define HOME_DEG      100
#define MOTION                                                                                     \
    "units_per_deg = 1\nhoming = axis\nmin_deg = -90\nmax_deg = 102\nhome_deg = 100\n"             \
    "speed_deg_s = 24\naccel_deg_s2 = 400\nboot_ms = 20000\n"

/* as in pins.c */
static volatile struct { gint64 steps[3], switch_at[3]; } * pins;
static char *section;

/* Returns the angle of an axis by the steps of its motor. */
static double true_deg(int axis) {
    return HOME_DEG + (double)(pins->steps[axis] - pins->switch_at[axis]) / STEPS_PER_DEG;
}

static gboolean stands(void) {
    const gint64 before = pins->steps[0];
    g_usleep(100000);
    return pins->steps[0] == before;
}

static void begin(struct axis_bench *bench) {
    axis_bench_begin(bench, &gcode_axis_driver, clock_new_real(), section, "");
}

static void end(struct axis_bench *bench) {
    axis_bench_end(bench);
    g_assert_true(stands());
}

static void home(struct axis_bench *bench) {
    axis_bench_home(bench);
    g_assert_cmpfloat(fabs(true_deg(0) - HOME_DEG), <, NEAR_DEG);
}

static void move(struct axis_bench *bench, double deg) {
    axis_bench_move(bench, deg);
    g_assert_cmpfloat(fabs(true_deg(0) - deg), <, NEAR_DEG);
}

static void wait_moving(const struct axis_bench *bench) {
    UNTIL (!stands())
        conformance_pass(bench->clock, 0.05);
}

/* The axis is where the driver says, also after stops at any time. */
static void truth(void) {
    struct axis_bench bench;
    begin(&bench);
    home(&bench);
    const gint64 y = pins->steps[1];
    move(&bench, 31.25);
    g_assert_cmpint(pins->steps[1], ==, y);
    for (int i = 0; i < 4; i++) {
        ok(axis_move(bench.axis, i & 1 ? 90 : -85, ERR));
        wait_moving(&bench);
        conformance_pass(bench.clock, 0.37 * i);
        const gint64 begun = g_get_monotonic_time();
        ok(axis_stop(bench.axis, ERR));
        axis_bench_expect(&bench, AXIS_STOPPED);
        g_test_message("the axis stands %.2f s after the stop",
                       (double)(g_get_monotonic_time() - begun) * 1e-6);
        g_assert_true(stands());
        g_assert_true(axis_is_homed(bench.axis));
        g_assert_cmpfloat(fabs(true_deg(0) - axis_position_deg(bench.axis)), <, NEAR_DEG);
    }
    move(&bench, 0);
    end(&bench);
}

/* A move is not interrupted between its pieces: it takes as long as predicted. */
static void steady(void) {
    struct axis_bench bench;
    begin(&bench);
    home(&bench);
    move(&bench, 90);
    const gint64 begun = g_get_monotonic_time();
    move(&bench, -90);
    const double took_s = (double)(g_get_monotonic_time() - begun) * 1e-6;
    const double predicted_s = axis_move_time_s(&bench.axis->motion, 90, -90);
    g_test_message("a move took %.2f s, and %.2f s were predicted", took_s, predicted_s);
    g_assert_cmpfloat(took_s, >, predicted_s);
    g_assert_cmpfloat(took_s, <, predicted_s + 1);
    end(&bench);
}

/* M112 stops a homing, and the next homing restarts Klipper. */
static void stops_homing(void) {
    struct axis_bench bench;
    begin(&bench);
    home(&bench);
    move(&bench, -90);
    ok(axis_home(bench.axis, ERR));
    wait_moving(&bench);
    ok(axis_stop(bench.axis, ERR));
    axis_bench_expect(&bench, AXIS_STOPPED);
    g_assert_true(stands());
    g_assert_cmpfloat(true_deg(0), <, HOME_DEG - 10);
    g_assert_false(axis_is_homed(bench.axis));
    home(&bench);
    move(&bench, 20);
    end(&bench);
}

/* An axis is closed in the middle of a move, as by a program that ends. */
static void closed(void) {
    struct axis_bench bench;
    begin(&bench);
    home(&bench);
    ok(axis_move(bench.axis, -90, ERR));
    wait_moving(&bench);
    end(&bench);
    g_assert_cmpfloat(true_deg(0), >, -80);
}

int main(int argc, char **argv) {
    static struct conformance klipper = {.name = "klipper", .real_clock = TRUE};
    g_test_init(&argc, &argv, NULL);
    if (argc != 3) {
        g_printerr("usage: %s PORT PINS\n", argv[0]);
        return 2;
    }
    const int fd = open(argv[2], O_RDWR | O_CLOEXEC);
    pins =
        fd < 0 ? MAP_FAILED : mmap(NULL, sizeof *pins, PROT_READ | PROT_WRITE, MAP_SHARED, fd, 0);
    g_assert_true(pins != MAP_FAILED);
    for (int i = 0; i < 3; i++)
        pins->switch_at[i] = lround(40 * STEPS_PER_DEG);
    UNTIL (g_file_test(argv[1], G_FILE_TEST_EXISTS))
        g_usleep(10000);
    section = g_strdup_printf(
        "[axis test]\ndriver = gcode-axis\ndialect = klipper\nport = %s\n" MOTION, argv[1]);
    klipper.section = section;
    conformance_axis(&gcode_axis_driver, &klipper);
    g_test_add_func("/klipper/truth", truth);
    g_test_add_func("/klipper/steady", steady);
    g_test_add_func("/klipper/stops-homing", stops_homing);
    g_test_add_func("/klipper/closed", closed);
    return g_test_run();
}
