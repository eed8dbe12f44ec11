/* An axis of a program: what every driver must do, where the axis truly was, and faults of the
 * program. The controller of the axis goes on by itself when the program ends. */
#include "lib/axis_bench.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/program_model.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/wait.h"
#include "program/devices.h"

#include <math.h>
#include <signal.h>
#include <stdio.h>
#include <sys/prctl.h>
#include <sys/wait.h>
#include <unistd.h>

#define MOTION "min_deg = 0\nmax_deg = 38\nspeed_deg_s = 30\naccel_deg_s2 = 300\n"

static void begin(struct axis_bench *bench, const char *folder, const char *keys) {
    g_autofree char *text = program_model_section("axis", folder, 20, keys);
    axis_bench_begin(bench, &program_axis_driver, clock_new_real(), text, "");
}

static void end(struct axis_bench *bench, const char *folder) {
    axis_bench_end(bench);
    UNTIL (program_model_processes(folder) == 0)
        g_usleep(10000);
}

/* Returns where the axis truly is. */
static double where(const char *folder, double *ret_speed) {
    double deg, speed;
    const char *const argv[] = {PROGRAM_PYTHON, PROGRAM_MODEL, "axis", folder, "where", NULL};
    g_autofree char *said = process_text(0, argv);
    g_assert_cmpint(sscanf(said, "%lf %lf", &deg, &speed), ==, 2);
    if (ret_speed)
        *ret_speed = speed;
    return deg;
}

static gboolean stands(const char *folder) {
    double speed;
    where(folder, &speed);
    return speed == 0;
}

static void assert_true_position(const char *folder, double deg) {
    g_assert_cmpfloat(fabs(where(folder, NULL) - deg), <, 0.001);
    g_assert_true(stands(folder));
}

TEST(truth) {
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, MOTION);
    g_assert_cmpfloat(axis_position_deg(bench.axis), ==, 3.5);
    axis_bench_home(&bench);
    assert_true_position(folder, 2);
    g_assert_cmpfloat(axis_position_deg(bench.axis), ==, 2);
    axis_bench_move(&bench, 31.25);
    assert_true_position(folder, 31.25);
    g_assert_cmpfloat(axis_position_deg(bench.axis), ==, 31.25);
    end(&bench, folder);
}

/* The count of an axis that turns without end goes on beyond 360. */
TEST(wraps) {
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, "wraps = yes\nspeed_deg_s = 300\naccel_deg_s2 = 3000\n");
    axis_bench_home(&bench);
    for (int i = 1; i <= 4; i++) {
        axis_bench_move(&bench, 100 * i % 360);
        assert_true_position(folder, 100 * i);
    }
    g_assert_cmpfloat(fabs(axis_position_deg(bench.axis) - 40), <, 1e-6);
    end(&bench, folder);
}

/* A motor that something else has left turning is stopped. */
TEST(left_moving) {
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, "speed_deg_s = 1\naccel_deg_s2 = 300\n");
    axis_bench_home(&bench);
    ok(axis_move(bench.axis, 300, ERR));
    conformance_pass(bench.clock, 0.3);
    program_model_fail(folder, "sleeps");
    g_clear_pointer(&bench.axis, axis_close);
    program_model_fail(folder, "");
    g_assert_false(stands(folder));
    clock_unref(bench.clock);
    begin(&bench, folder, "speed_deg_s = 1\naccel_deg_s2 = 300\n");
    UNTIL (stands(folder))
        conformance_pass(bench.clock, 0.01);
    g_assert_cmpfloat(where(folder, NULL), <, 100);
    end(&bench, folder);
}

/* Each fault comes before a move, or before homing. Afterwards the axis stands, its position is not
 * known, and it works again. */
static const struct fault {
    const char *name;
    enum device_error code;
    const char *says;
} faults[] = {
    {"unanswered", DEVICE_ERROR_TIMEOUT, "did not answer “move” within 1500 ms; it was ended"},
    {"cut", DEVICE_ERROR_TIMEOUT, "did not answer “move” within 1500 ms; it was ended"},
    {"dies", DEVICE_ERROR_DISCONNECTED, "has ended with exit code 3"},
    {"garbage", DEVICE_ERROR_PROTOCOL, "not a JSON object"},
    {"refuses", DEVICE_ERROR_PROTOCOL, "refused “move”: the fuse has?blown"},
    {"stalls", DEVICE_ERROR_STALLED, "it stands at 2.000° instead of 30.000°"},
    {"lies", DEVICE_ERROR_STALLED, "it stands at 31.000° instead of 30.000°"},
    {"no-number", DEVICE_ERROR_PROTOCOL, "sent an answer without the number “deg”"},
    {"far", DEVICE_ERROR_PROTOCOL, "answered deg = 1e+300, which is out of range"},
    {"no-switch", DEVICE_ERROR_STALLED, "homing ended at "},
};

static void run_fault(gconstpointer data) {
    const struct fault *fault = data;
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, MOTION);
    axis_bench_home(&bench);
    program_model_fail(folder, fault->name);
    ok(g_str_equal(fault->name, "no-switch") ? axis_home(bench.axis, ERR)
                                             : axis_move(bench.axis, 30, ERR));
    axis_bench_expect(&bench, AXIS_FAULT);
    g_assert_error(bench.error, DEVICE_ERROR, (int)fault->code);
    g_assert_true(g_str_has_prefix(bench.error->message, "axis test: "));
    assert_has(bench.error->message, fault->says);
    g_assert_false(axis_is_homed(bench.axis));
    program_model_fail(folder, "");
    axis_bench_wait_safe(&bench);
    g_assert_true(stands(folder));
    g_assert_cmpint(bench.n, ==, 0); /* one cause, one fault */
    axis_bench_home(&bench);
    axis_bench_move(&bench, 5);
    assert_true_position(folder, 5);
    end(&bench, folder);
}

/* The program ends during a slow move. The controller moves on until the program was started again
 * and has stopped it. */
TEST(dies_moving) {
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, "speed_deg_s = 1\naccel_deg_s2 = 300\n");
    axis_bench_home(&bench);
    ok(axis_move(bench.axis, 300, ERR));
    conformance_pass(bench.clock, 0.3);
    program_model_kill(folder);
    axis_bench_expect(&bench, AXIS_FAULT);
    g_assert_error(bench.error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    axis_bench_wait_safe(&bench);
    g_assert_true(stands(folder));
    g_assert_cmpfloat(where(folder, NULL), <, 100);
    end(&bench, folder);
}

/* The program ends while the axis stands: the position is not known any more. */
TEST(dies_standing) {
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, MOTION);
    axis_bench_home(&bench);
    program_model_kill(folder);
    axis_bench_expect(&bench, AXIS_FAULT);
    g_assert_error(bench.error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_assert_false(axis_is_homed(bench.axis));
    axis_bench_wait_safe(&bench);
    axis_bench_home(&bench);
    end(&bench, folder);
}

/* The program reports that the axis was moved by something else. */
TEST(lost) {
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, MOTION);
    axis_bench_home(&bench);
    program_model_fail(folder, "loses");
    axis_bench_expect(&bench, AXIS_FAULT);
    assert_has(bench.error->message, "axis test: its program reports: a fuse has blown");
    g_assert_false(axis_is_homed(bench.axis));
    axis_bench_wait_safe(&bench);
    axis_bench_home(&bench);
    end(&bench, folder);
}

/* An axis that does not obey "stop" is not called safe while it moves. */
TEST(moves_on) {
    TEMPORARY_FOLDER(folder);
    struct axis_bench bench;
    begin(&bench, folder, "speed_deg_s = 1\naccel_deg_s2 = 300\n");
    axis_bench_home(&bench);
    ok(axis_move(bench.axis, 300, ERR));
    conformance_pass(bench.clock, 0.3);
    program_model_fail(folder, "moves-on");
    ok(axis_stop(bench.axis, ERR));
    axis_bench_expect(&bench, AXIS_FAULT);
    g_assert_error(bench.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(axis_safety(bench.axis), ==, DEVICE_UNSAFE);
    g_assert_false(stands(folder));
    program_model_fail(folder, "");
    axis_bench_wait_safe(&bench);
    g_assert_true(stands(folder));
    end(&bench, folder);
}

/* When this program is killed, the program of the device stops the axis and ends. */
TEST(parent_killed) {
    TEMPORARY_FOLDER(folder);
    int ends[2];
    char byte;
    g_assert_cmpint(pipe(ends), ==, 0);
    const pid_t pid = fork();
    g_assert_cmpint(pid, >=, 0);
    if (pid == 0) {
        struct axis_bench bench;
        prctl(PR_SET_PDEATHSIG, SIGKILL);
        begin(&bench, folder, "speed_deg_s = 1\naccel_deg_s2 = 300\n");
        axis_bench_home(&bench);
        ok(axis_move(bench.axis, 300, ERR));
        conformance_pass(bench.clock, 0.3);
        if (write(ends[1], "+", 1) == 1)
            pause();
        _exit(1);
    }
    close(ends[1]);
    g_assert_cmpint(read(ends[0], &byte, 1), ==, 1);
    close(ends[0]);
    g_assert_false(stands(folder));
    g_assert_cmpint(kill(pid, SIGKILL), ==, 0);
    g_assert_cmpint(waitpid(pid, NULL, 0), ==, pid);
    UNTIL (program_model_processes(folder) == 0)
        wait_ms(10);
    UNTIL (stands(folder)) /* it brakes */
        wait_ms(10);
    g_assert_cmpfloat(where(folder, NULL), <, 100);
}

static char *model_folder;

static struct conformance model = {
    .name = "program-axis", .real_clock = TRUE, .fail = program_model_conformance_fail};

BEFORE_TESTS {
    model_folder = remove_tree_begin();
    model.section = program_model_section(
        "axis", model_folder, 3,
        "min_deg = 0\nmax_deg = 38\nspeed_deg_s = 60\naccel_deg_s2 = 600\nbacklash_deg = 0.5\n"
        "settle_ms = 10\n");
    model.fail_data = model_folder;
    conformance_axis(&program_axis_driver, &model);
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++) {
        g_autofree char *path = g_strdup_printf("/program-axis/fault/%s", faults[i].name);
        g_test_add_data_func(path, &faults[i], run_fault);
    }
}

AFTER_TESTS {
    g_assert_true(stands(model_folder));
    remove_tree_end(&model_folder);
    g_free((gpointer)model.section);
}
