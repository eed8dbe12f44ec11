/* The driver gcode-axis on the firmware of GRBL, which tests/grbl/run builds and runs:
 *
 *     grbl_conformance RUNNER FIRMWARE.elf FOLDER
 *
 * The conformance suite of the axis class, then what GRBL itself does after faults. The steps of
 * the motors are the truth. */
#include "conformance/conformance.h"
#include "lib/axis_bench.h"
#include "lib/ok.h"
#include "lib/wait.h"
#include "serial/devices.h"
#include "serial/port.h"

#include <gio/gio.h>
#include <math.h>
#include <poll.h>
#include <stdio.h>
#include <string.h>
#include <unistd.h>

#define STEPS_PER_MM 100
#define PULL_OFF_MM  1
/* The limit switches are at the upper end, and the axis homes there: at 100°. */
#define MOTION                                                                                     \
    "units_per_deg = 0.5\nmin_deg = -90\nmax_deg = 102\nhome_deg = 100\nspeed_deg_s = 120\n"       \
    "accel_deg_s2 = 1000\nbacklash_deg = 0.2\ntolerance_deg = 0.02\npoll_ms = 20\n"

static GSubprocess *runner;
static char *port, *section;

/* Sends a command to the runner, and reads where the motors are. */
static void tell(const char *command, long *ret_steps, unsigned *ret_resets) {
    static GDataInputStream *answers;
    GOutputStream *to = g_subprocess_get_stdin_pipe(runner);
    g_autofree char *line = g_strconcat(command, "\n", NULL);
    long steps[3];
    unsigned resets;
    if (!answers)
        answers = g_data_input_stream_new(g_subprocess_get_stdout_pipe(runner));
    if (*command)
        ok(g_output_stream_write_all(to, line, strlen(line), NULL, NULL, ERR));
    g_autofree char *answer = ok(g_data_input_stream_read_line(answers, NULL, NULL, ERR));
    g_assert_nonnull(answer);
    if (!*command) {
        g_assert_cmpstr(answer, ==, "ready");
        return;
    }
    g_assert_cmpint(sscanf(answer, "%ld %ld %ld %u", &steps[0], &steps[1], &steps[2], &resets), ==,
                    4);
    if (ret_steps)
        memcpy(ret_steps, steps, sizeof steps);
    if (ret_resets)
        *ret_resets = resets;
}

static double true_mm(int axis) {
    long steps[3];
    tell("position", steps, NULL);
    return (double)steps[axis] / STEPS_PER_MM;
}

static gboolean stands(void) {
    long first[3], second[3];
    tell("position", first, NULL);
    g_usleep(50000);
    tell("position", second, NULL);
    return memcmp(first, second, sizeof first) == 0;
}

static void fail(gpointer unused, enum conformance_fault fault) {
    tell(fault == CONFORMANCE_UNANSWERED ? "wire 1"
         : fault == CONFORMANCE_CUT      ? "wire 2"
                                         : "wire 0",
         NULL, NULL);
}

/* Writes settings into the board, as its owner does with a terminal. */
static void set_up(const char *const *lines) {
    int fd = ok(serial_port_open(port, 115200, ERR));
    g_autoptr(GString) heard = g_string_new(NULL);
    UNTIL (strstr(heard->str, "to unlock]") || strstr(heard->str, "Grbl 1.1")) {
        char byte;
        if (heard->len == 0)
            g_assert_cmpint(write(fd, "\x18", 1), ==, 1);
        g_usleep(100000);
        while (read(fd, &byte, 1) == 1)
            g_string_append_c(heard, byte);
    }
    for (; *lines; lines++) {
        g_string_truncate(heard, 0);
        g_assert_cmpint(write(fd, *lines, strlen(*lines)), ==, (gssize)strlen(*lines));
        UNTIL (strstr(heard->str, "ok\r\n")) {
            char byte;
            while (read(fd, &byte, 1) == 1)
                g_string_append_c(heard, byte);
            if (strstr(heard->str, "error:"))
                g_error("%s: %s", *lines, heard->str);
            g_usleep(1000);
        }
    }
    close(fd);
}

static void set_all(void) {
    static const char *const settings[] = {
        "$X\n",        "$1=255\n",    "$22=1\n",    "$24=600\n",  "$25=3000\n", "$27=1\n",
        "$21=0\n",     "$20=0\n",     "$100=100\n", "$101=100\n", "$102=100\n", "$110=3600\n",
        "$111=3600\n", "$112=3600\n", "$120=500\n", "$121=500\n", "$122=500\n", "$130=300\n",
        "$131=300\n",  "$132=300\n",  NULL};
    set_up(settings);
}

static void begin_with(struct axis_bench *bench, Clock *clock, const char *keys) {
    axis_bench_begin(bench, &gcode_axis_driver, clock, section, keys);
}

static void begin(struct axis_bench *bench) {
    begin_with(bench, clock_new_real(), "");
}

static void end(struct axis_bench *bench) {
    axis_bench_end(bench);
    g_assert_true(stands());
}

static void start(struct axis_bench *bench, double deg) {
    ok(axis_move(bench->axis, deg, ERR));
    conformance_pass(bench->clock, 0.5);
    g_assert_false(stands());
}

static void expect_fault(struct axis_bench *bench, const char *words) {
    axis_bench_expect(bench, AXIS_FAULT);
    g_test_message("%s", bench->error->message);
    if (!strstr(bench->error->message, words))
        g_error("\"%s\" does not say \"%s\"", bench->error->message, words);
    g_assert_false(axis_is_homed(bench->axis));
    axis_bench_wait_safe(bench);
    g_assert_true(stands());
    g_assert_cmpint(bench->n, ==, 0);
}

static void truth(void) {
    struct axis_bench bench;
    begin(&bench);
    axis_bench_home(&bench);
    const double home_mm = true_mm(0), y_mm = true_mm(1);
    axis_bench_move(&bench, 31.25);
    g_assert_cmpfloat(fabs(true_mm(0) - (home_mm + (31.25 - 100) * 0.5)), <, 0.011);
    g_assert_cmpfloat(true_mm(1), ==, y_mm);
    start(&bench, -80);
    ok(axis_stop(bench.axis, ERR));
    axis_bench_expect(&bench, AXIS_STOPPED);
    g_assert_true(axis_is_homed(bench.axis));
    g_assert_cmpfloat(axis_position_deg(bench.axis), >, -80);
    g_assert_cmpfloat(axis_position_deg(bench.axis), <, 31);
    /* No step was lost: the position that was reported is the true one. */
    g_assert_cmpfloat(fabs(true_mm(0) - (home_mm + (axis_position_deg(bench.axis) - 100) * 0.5)), <,
                      0.011);
    axis_bench_move(&bench, 0);
    g_assert_cmpfloat(fabs(true_mm(0) - (home_mm - 50)), <, 0.011);
    end(&bench);
}

/* Two axes take turns. "$H" for one of them moves both, and the other one is moved back. */
static void two_axes(void) {
    struct axis_bench x, y;
    begin(&x);
    begin_with(&y, clock_ref(x.clock), "letter = Y\n");
    axis_bench_home(&x);
    const double x_mm = true_mm(0), y_mm = true_mm(1);
    axis_bench_move(&x, 31.25);
    axis_bench_home(&y);
    g_assert_true(axis_is_homed(x.axis));
    g_assert_cmpfloat(fabs(true_mm(0) - (x_mm + (31.25 - 100) * 0.5)), <, 0.021);
    ok(axis_move(x.axis, -50, ERR));
    ok(axis_move(y.axis, 50, ERR));
    conformance_pass(x.clock, 0.3);
    ok(axis_stop(y.axis, ERR)); /* it waits; the other one goes on */
    axis_bench_expect(&y, AXIS_STOPPED);
    axis_bench_expect(&x, AXIS_ARRIVED);
    axis_bench_move(&y, 50);
    g_assert_cmpfloat(fabs(true_mm(0) - (x_mm + (-50 - 100) * 0.5)), <, 0.021);
    g_assert_cmpfloat(fabs(true_mm(1) - (y_mm + (50 - 100) * 0.5)), <, 0.021);
    end(&y);
    end(&x);
}

static void limit_switch(void) {
    static const char *const on[] = {"$X\n", "$21=1\n", NULL}, *const off[] = {"$X\n", "$21=0\n",
                                                                               NULL};
    struct axis_bench bench;
    set_up(on);
    begin(&bench);
    axis_bench_home(&bench);
    start(&bench, -80);
    tell("press 1", NULL, NULL);
    conformance_wait(bench.clock, &bench.n, 1, 60);
    tell("press 0", NULL, NULL);
    expect_fault(&bench, "alarm 1: a limit switch stopped it");
    axis_bench_home(&bench);
    end(&bench);
    set_up(off);
}

static void soft_limit(void) {
    static const char *const on[] = {"$X\n", "$20=1\n", "$130=40\n", NULL}, *const off[] = {
                                                                                "$X\n", "$20=0\n",
                                                                                "$130=300\n", NULL};
    struct axis_bench bench;
    set_up(on);
    begin(&bench);
    axis_bench_home(&bench);
    ok(axis_move(bench.axis, 0, ERR)); /* 50 mm */
    expect_fault(&bench, "alarm 2: the target is beyond the travel");
    axis_bench_home(&bench);
    end(&bench);
    set_up(off);
}

static void reset_moving(void) {
    struct axis_bench bench;
    begin(&bench);
    axis_bench_home(&bench);
    start(&bench, -80);
    tell("reset", NULL, NULL);
    expect_fault(&bench, "the board was reset");
    axis_bench_home(&bench);
    end(&bench);
}

static void no_switch(void) {
    struct axis_bench bench;
    static const char *const near[] = {"$X\n", "$130=20\n", "$131=20\n", "$132=20\n", NULL};
    begin(&bench);
    axis_bench_home(&bench);
    end(&bench);
    set_up(near); /* the search ends before the switch */
    tell("switch 1000000", NULL, NULL);
    begin(&bench);
    ok(axis_home(bench.axis, ERR));
    expect_fault(&bench, "alarm 9: homing did not find the limit switch");
    end(&bench);
    set_all();
}

int main(int argc, char **argv) {
    static struct conformance grbl = {.name = "grbl-1.1h", .real_clock = TRUE, .fail = fail};
    g_test_init(&argc, &argv, NULL);
    if (argc != 4) {
        g_printerr("usage: %s RUNNER FIRMWARE.elf FOLDER\n", argv[0]);
        return 2;
    }
    port = g_build_filename(argv[3], "port", NULL);
    runner = ok(g_subprocess_new(G_SUBPROCESS_FLAGS_STDIN_PIPE | G_SUBPROCESS_FLAGS_STDOUT_PIPE,
                                 ERR, argv[1], argv[2], port, NULL));
    section = g_strdup_printf("[axis test]\ndriver = gcode-axis\nport = %s\n" MOTION, port);
    grbl.section = section;
    grbl.tolerance_deg = 0.03;
    tell("", NULL, NULL);
    tell("switch 3000", NULL, NULL);
    set_all();
    conformance_axis(&gcode_axis_driver, &grbl);
    g_test_add_func("/grbl/truth", truth);
    g_test_add_func("/grbl/two-axes", two_axes);
    g_test_add_func("/grbl/limit-switch", limit_switch);
    g_test_add_func("/grbl/soft-limit", soft_limit);
    g_test_add_func("/grbl/reset-moving", reset_moving);
    g_test_add_func("/grbl/no-switch", no_switch);
    const int result = g_test_run();
    g_subprocess_force_exit(runner);
    ok(g_subprocess_wait(runner, NULL, ERR));
    return result;
}
