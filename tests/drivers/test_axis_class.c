/* The axis class, with simulated axes and with an axis that reports only what the test makes it
 * report. */
#include "lib/heard.h"
#include "lib/ok.h"

#include <math.h>
#include <string.h>

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    heard_event(data, (int)event, error);
}

static Axis *open_axis(const struct axis_driver *driver, const char *section, struct heard *heard) {
    const struct conformance with = {.section = section, .path = RIG};
    const struct config_section *found;
    g_autoptr(Config) config = conformance_config(&with, "", &found);
    Axis *axis = ok(axis_open(driver, found, NULL, heard->clock, ERR));
    axis_listen(axis, on_axis, heard);
    return axis;
}

static void home(Axis *axis, struct heard *heard) {
    g_assert_true(axis_home(axis, NULL));
    heard_next(heard, AXIS_HOMED);
}

static void go(Axis *axis, struct heard *heard, double to_deg) {
    ok(axis_move(axis, to_deg, ERR));
    heard_next(heard, AXIS_ARRIVED);
}

/* Worked out by hand: v = 10, a = 10, so that the ramps together take 10° and 2 s. */
static void test_move_time(void) {
    struct axis_motion m = {-100, 100, FALSE, 10, 10, 0, 500};
    g_assert_cmpfloat_with_epsilon(axis_move_time_s(&m, 0, 20), 3.5, 1e-12);
    g_assert_cmpfloat_with_epsilon(axis_move_time_s(&m, 0, 10), 2.5, 1e-12);
    g_assert_cmpfloat_with_epsilon(axis_move_time_s(&m, 0, 2.5), 1.5, 1e-12);
    g_assert_cmpfloat_with_epsilon(axis_move_time_s(&m, 20, 0), 3.5, 1e-12);
    g_assert_cmpfloat(axis_move_time_s(&m, 7, 7), ==, 0);
    m.backlash_deg = 0.4; /* back by 0.4°: 2 sqrt(0.04) = 0.4 s */
    g_assert_cmpfloat_with_epsilon(axis_move_time_s(&m, 20, 0), 3.54 + 0.4, 1e-12);
    g_assert_cmpfloat_with_epsilon(axis_move_time_s(&m, 0, 20), 3.5, 1e-12);
    g_assert_cmpfloat_with_epsilon(axis_move_time_s(&m, -80, -100), 3.5, 1e-12);
    m.wraps = TRUE;
    g_assert_cmpfloat(axis_way_deg(&m, 350, 10), ==, 20);
    g_assert_cmpfloat(axis_way_deg(&m, 10, 350), ==, -20);
    g_assert_cmpfloat(axis_way_deg(&m, 0, 180), ==, 180);
    g_assert_cmpfloat(axis_way_deg(&m, 180, 0), ==, 180);
    g_assert_cmpfloat(axis_way_deg(&m, 725, 5), ==, 0);
}

static void test_predicted_time(struct heard *heard, gconstpointer unused) {
    static const double targets[] = {30, 350, 170, 169.9, 169.95, 0, 180, 0, 0.001, -725.5};
    g_autoptr(Axis) axis = open_axis(&sim_axis_driver, turntable.section, heard);
    home(axis, heard);
    for (gsize i = 0; i < G_N_ELEMENTS(targets); i++) {
        double from = axis_position_deg(axis);
        double predicted = axis_move_time_s(&axis->motion, from, targets[i]);
        gint64 start = clock_now_us(heard->clock);
        go(axis, heard, targets[i]);
        double took = (double)(clock_now_us(heard->clock) - start) / 1e6;
        g_assert_cmpfloat_with_epsilon(took, predicted, 1e-3);
    }
    g_assert_cmpfloat_with_epsilon(axis_position_deg(axis), 360 * 3 - 725.5, 1e-6);
}

/* An axis that records its commands, and reports only what the test makes it report. */
struct silent_axis {
    double targets[8];
    int n_targets, n_stops, n_homings;
    gint64 stopped_us[32];
    gboolean refuses;     /* stop() fails */
    int n_unsafe, n_safe; /* what the watch has heard */
    double position;
};

static gboolean silent_open(Axis *axis, GError **error) {
    axis->motion = (struct axis_motion){-50, 50, FALSE, 10, 10, 2, 500};
    return TRUE;
}

static void silent_close(Axis *axis) {
}

static gboolean silent_home(Axis *axis, GError **error) {
    ((struct silent_axis *)axis->device.priv)->n_homings++;
    return TRUE;
}

static gboolean silent_move(Axis *axis, double target_deg, GError **error) {
    struct silent_axis *silent = axis->device.priv;
    silent->targets[silent->n_targets++] = target_deg;
    return TRUE;
}

static gboolean silent_stop(Axis *axis, GError **error) {
    struct silent_axis *silent = axis->device.priv;
    g_assert_cmpint(silent->n_stops, <, (int)G_N_ELEMENTS(silent->stopped_us));
    silent->stopped_us[silent->n_stops++] = clock_now_us(axis->device.clock);
    return !silent->refuses ||
           device_error_set(error, DEVICE_ERROR_DISCONNECTED, axis->device.who, "is gone");
}

static double silent_position(Axis *axis) {
    return ((struct silent_axis *)axis->device.priv)->position;
}

static const struct axis_driver silent_driver = {
    .info = {"axis", "silent", "Says nothing", NULL, sizeof(struct silent_axis)},
    .open = silent_open,
    .close = silent_close,
    .home = silent_home,
    .move = silent_move,
    .stop = silent_stop,
    .position = silent_position,
};

static void arrive(Axis *axis) {
    struct silent_axis *silent = axis->device.priv;
    silent->position = silent->targets[silent->n_targets - 1];
    axis_report(axis, AXIS_ARRIVED, NULL);
}

static void test_backlash(struct heard *heard, gconstpointer unused) {
    g_autoptr(Axis) axis = open_axis(&silent_driver, "[axis a]", heard);
    struct silent_axis *silent = axis->device.priv;
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_HOMED, NULL);
    heard_next(heard, AXIS_HOMED);

    g_assert_true(axis_move(axis, 20, NULL)); /* upwards: straight */
    arrive(axis);
    heard_next(heard, AXIS_ARRIVED);
    g_assert_cmpint(silent->n_targets, ==, 1);
    g_assert_true(axis_move(axis, 10, NULL)); /* downwards: past it and back */
    g_assert_cmpfloat(silent->targets[1], ==, 8);
    arrive(axis);
    g_assert_cmpint(heard->n, ==, 0);
    g_assert_cmpfloat(silent->targets[2], ==, 10);
    gint64 arrived = clock_now_us(heard->clock);
    arrive(axis);
    heard_next(heard, AXIS_ARRIVED);
    g_assert_cmpint(heard->at_us - arrived, ==, 500000); /* settled */
    g_assert_true(axis_move(axis, -50, NULL));           /* no room below */
    g_assert_cmpfloat(silent->targets[3], ==, -50);
    arrive(axis);
    heard_next(heard, AXIS_ARRIVED);
    g_assert_cmpint(silent->n_targets, ==, 4);
}

static void test_axis_deadline(struct heard *heard, gconstpointer unused) {
    g_autoptr(Axis) axis = open_axis(&silent_driver, "[axis a]", heard);
    struct silent_axis *silent = axis->device.priv;
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_HOMED, NULL);
    heard_next(heard, AXIS_HOMED);
    gint64 start = clock_now_us(heard->clock);
    g_assert_true(axis_move(axis, 20, NULL));
    heard_next(heard, AXIS_FAULT);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(heard->at_us - start, ==, (gint64)(3.5 * 1.5e6) + 4000000);
    g_assert_false(axis_is_homed(axis));
    g_assert_cmpint(axis_safety(axis), ==, DEVICE_TOLD);
    conformance_pass(heard->clock, 0.01);
    g_assert_cmpint(silent->n_stops, ==, 1);
    axis_report(axis, AXIS_STOPPED, NULL);
    g_assert_cmpint(axis_safety(axis), ==, DEVICE_SAFE);
    axis_report(axis, AXIS_ARRIVED, NULL); /* too late */
    axis_report(axis, AXIS_STOPPED, NULL);
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_ARRIVED, NULL); /* still too late: no answer to home */
    conformance_pass(heard->clock, 1);
    g_assert_cmpint(heard->n, ==, 0);
    heard_next(heard, AXIS_FAULT); /* homing has its deadline too */
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
}

static void on_safety(struct device *device, const GError *error, gpointer data) {
    struct silent_axis *silent = device->priv;
    *(error ? &silent->n_unsafe : &silent->n_safe) += 1;
}

static Axis *open_moving(struct heard *heard) {
    Axis *axis = open_axis(&silent_driver, "[axis a]", heard);
    device_watch_safety(&axis->device, on_safety, NULL);
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_HOMED, NULL);
    heard_next(heard, AXIS_HOMED);
    g_assert_true(axis_move(axis, 20, NULL));
    return axis;
}

/* A stop that fails is repeated until the axis says that it stands. */
static void test_stop_fails(struct heard *heard, gconstpointer unused) {
    static const int pauses_ms[] = {100, 200, 300, 300};
    g_autoptr(Axis) axis = open_moving(heard);
    struct silent_axis *silent = axis->device.priv;
    g_assert_true(axis_stop(axis, NULL));
    axis_report(axis, AXIS_FAULT, NULL);
    heard_next(heard, AXIS_FAULT);
    for (gsize i = 0; i < G_N_ELEMENTS(pauses_ms); i++) {
        const gint64 failed = clock_now_us(heard->clock);
        g_assert_cmpint(axis_safety(axis), ==, DEVICE_UNSAFE);
        g_assert_true(device_is_unsafe(&axis->device));
        while (silent->n_stops < 2 + (int)i)
            g_main_context_iteration(NULL, TRUE);
        g_assert_cmpint(silent->stopped_us[1 + i] - failed, ==, pauses_ms[i] * 1000);
        if (i % 2) /* not answered at all, or with a fault */
            axis_report(axis, AXIS_FAULT, NULL);
        else
            conformance_pass(heard->clock, 1.5 + 4);
    }
    while (silent->n_stops < 6)
        g_main_context_iteration(NULL, TRUE);
    axis_report(axis, AXIS_STOPPED, NULL);
    g_assert_cmpint(axis_safety(axis), ==, DEVICE_SAFE);
    conformance_pass(heard->clock, 20);
    g_assert_cmpint(silent->n_stops, ==, 6);
    g_assert_cmpint(heard->n, ==, 0);
    g_assert_cmpint(silent->n_unsafe, ==, 1);
    g_assert_cmpint(silent->n_safe, ==, 1);
}

/* The driver cannot send the stop of a motion that goes on. */
static void test_stop_refused(struct heard *heard, gconstpointer unused) {
    g_autoptr(Axis) axis = open_moving(heard);
    struct silent_axis *silent = axis->device.priv;
    GError *error = NULL;
    silent->refuses = TRUE;
    g_assert_false(axis_stop(axis, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_clear_error(&error);
    g_assert_cmpint(axis_safety(axis), ==, DEVICE_UNSAFE);
    conformance_pass(heard->clock, 1);
    g_assert_cmpint(silent->n_unsafe, ==, 1);
    silent->refuses = FALSE;
    conformance_pass(heard->clock, 0.31);
    axis_report(axis, AXIS_STOPPED, NULL);
    heard_next(heard, AXIS_STOPPED); /* the one end of the move */
    g_assert_true(axis_is_homed(axis));
    g_assert_cmpint(axis_safety(axis), ==, DEVICE_SAFE);
    conformance_pass(heard->clock, 0.01);
    g_assert_cmpint(silent->n_safe, ==, 1);

    silent->refuses = TRUE; /* it arrives before it could be stopped, and does not go back */
    g_assert_true(axis_move(axis, -20, NULL));
    g_assert_false(axis_stop(axis, NULL));
    const int n = silent->n_targets;
    arrive(axis);
    heard_next(heard, AXIS_STOPPED);
    g_assert_cmpint(silent->n_targets, ==, n);
    g_assert_cmpint(axis_safety(axis), ==, DEVICE_SAFE);
}

/* Homing after a fault is not stopped by the class. */
static void test_home_after_fault(struct heard *heard, gconstpointer unused) {
    g_autoptr(Axis) axis = open_moving(heard);
    struct silent_axis *silent = axis->device.priv;
    axis_report(axis, AXIS_FAULT, NULL);
    heard_next(heard, AXIS_FAULT);
    conformance_pass(heard->clock, 0.01);
    g_assert_cmpint(silent->n_stops, ==, 1);
    axis_report(axis, AXIS_FAULT, NULL);
    g_assert_true(axis_home(axis, NULL));
    conformance_pass(heard->clock, 2);
    g_assert_cmpint(silent->n_stops, ==, 1);
    axis_report(axis, AXIS_HOMED, NULL);
    heard_next(heard, AXIS_HOMED);
    g_assert_cmpint(axis_safety(axis), ==, DEVICE_SAFE);
    conformance_pass(heard->clock, 2);
    g_assert_cmpint(silent->n_stops, ==, 1);
    g_assert_cmpint(silent->n_safe, ==, 1);
}

static gboolean refuse(const struct device *device, gpointer data, GError **error) {
    return device_error_set(error, DEVICE_ERROR_BUSY, device->who, "the rig is in its safe state");
}

static void test_axis_permit(struct heard *heard, gconstpointer unused) {
    g_autoptr(Axis) axis = open_moving(heard);
    struct silent_axis *silent = axis->device.priv;
    device_set_permit(&axis->device, refuse, NULL);
    g_assert_true(axis_stop(axis, NULL));
    axis_report(axis, AXIS_STOPPED, NULL);
    heard_next(heard, AXIS_STOPPED);
    GError *error = NULL;
    g_assert_false(axis_move(axis, 10, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_BUSY, "in its safe state");
    g_assert_true(axis_is_homed(axis));
    g_assert_false(axis_home(axis, &error));
    conformance_expect_error(&error, DEVICE_ERROR, DEVICE_ERROR_BUSY, "in its safe state");
    g_assert_true(axis_is_homed(axis));
    g_assert_true(axis_halt(axis, NULL));
    axis_report(axis, AXIS_STOPPED, NULL);
    heard_next(heard, AXIS_STOPPED);
    g_assert_cmpint(silent->n_targets, ==, 1);
    g_assert_cmpint(silent->n_homings, ==, 1);
    device_set_permit(&axis->device, NULL, NULL);
    g_assert_true(axis_move(axis, 30, NULL));
}

/* The fault that the simulated devices have for runs of the whole rig: the move is carried out. */
static void test_sim_axis_unheard(struct heard *heard, gconstpointer unused) {
    g_autoptr(Axis) axis = open_axis(&sim_axis_driver,
                                     "[axis a]\nspeed_deg_s = 10\naccel_deg_s2 = 100\n"
                                     "fault_unheard = 2\nfault_dead_s = 5\n",
                                     heard);
    home(axis, heard);
    const gint64 start = clock_now_us(heard->clock);
    g_assert_true(axis_move(axis, 300, NULL));
    heard_next(heard, AXIS_FAULT);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    const double at = axis_position_deg(axis);
    conformance_pass(heard->clock, 2);
    g_assert_cmpfloat(axis_position_deg(axis), >, at + 15);
    while (axis_safety(axis) != DEVICE_SAFE)
        g_main_context_iteration(NULL, TRUE);
    g_assert_cmpint(clock_now_us(heard->clock) - start, >, 5000000);
    g_assert_cmpint(clock_now_us(heard->clock) - start, <, 6000000);
    const double stopped = axis_position_deg(axis);
    conformance_pass(heard->clock, 2);
    g_assert_cmpfloat(axis_position_deg(axis), ==, stopped);
    g_assert_cmpfloat(stopped, <, 61);
    g_assert_cmpint(heard->n, ==, 0);
    home(axis, heard);
}

static double true_turntable(Clock *clock) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct world_state state;
    world_snapshot(world, clock_now_us(clock), 1, &state);
    return state.turntable_deg;
}

/* What backlash and errors do to the truth, and that the class undoes the first. */
static void test_true_position(struct heard *heard, gconstpointer unused) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    g_autoptr(Axis) axis =
        open_axis(&sim_axis_driver,
                  "[axis turntable]\nworld = world.conf\nwraps = yes\nbacklash_deg = 0.5\n"
                  "position_error_deg = 0.1\nsettle_ms = 100\n",
                  heard);
    home(axis, heard);
    go(axis, heard, 40);
    double from_below = true_turntable(heard->clock);
    g_assert_cmpfloat(fabs(from_below - 40), <=, 0.1);
    g_assert_cmpfloat(fabs(from_below - 40), >, 0);
    go(axis, heard, 170);
    go(axis, heard, 290); /* round and round: the same truth to the last bit */
    go(axis, heard, 50);
    go(axis, heard, 40);
    g_assert_cmpfloat(true_turntable(heard->clock), ==, from_below);

    g_assert_true(axis_move(axis, 30, NULL)); /* half way down the load lags, and moves */
    conformance_pass(heard->clock, 0.3);
    double lag = true_turntable(heard->clock) - axis_position_deg(axis);
    g_assert_cmpfloat(lag, >, 0.35);
    g_assert_cmpfloat(lag, <, 2.0);
    g_assert_cmpfloat(true_turntable(heard->clock), <, 40);
    heard_next(heard, AXIS_ARRIVED);
}

/* Straight after arrival the load still swings, until the settling time is over. */
static void test_settling(struct heard *heard, gconstpointer unused) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    g_autoptr(Axis) axis = open_axis(&sim_axis_driver, turntable.section, heard);
    home(axis, heard);
    double predicted = axis_move_time_s(&axis->motion, 0, 40);
    g_assert_true(axis_move(axis, 40, NULL));
    conformance_pass(heard->clock, predicted - 0.01);
    g_assert_cmpint(heard->n, ==, 0);
    g_assert_cmpfloat(true_turntable(heard->clock), !=, 40);
    heard_next(heard, AXIS_ARRIVED);
    g_assert_cmpfloat(true_turntable(heard->clock), ==, 40);
}

static gboolean silent_turn(Axis *axis, double target_deg, double speed_deg_s, GError **error) {
    return silent_move(axis, target_deg, error);
}

static gboolean silent_open_turning(Axis *axis, GError **error) {
    axis->motion = (struct axis_motion){
        .min_deg = -50, .max_deg = 50, .speed_deg_s = 10, .accel_deg_s2 = 10, .report_ms = 100};
    return TRUE;
}

static void on_turning(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    if (event != AXIS_PASSING)
        heard_event(data, (int)event, error);
}

/* What the class makes of the reports of an axis that turns from 0 at 5°/s, 0.5 s after which it
 * has that speed. */
static void test_turning(struct heard *heard, gconstpointer unused) {
    struct axis_driver driver = silent_driver;
    gint64 us;
    double deg;
    driver.open = silent_open_turning;
    driver.turn = silent_turn;
    g_autoptr(Axis) axis = open_axis(&driver, "[axis a]", heard);
    axis_listen(axis, on_turning, heard);
    g_assert_true(axis_can_turn(axis));
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_HOMED, NULL);
    heard_next(heard, AXIS_HOMED);
    g_assert_cmpfloat_with_epsilon(axis_ramp_deg(&axis->motion, 5), 1.25, 1e-12);
    g_assert_false(axis_turn(axis, 51, 5, NULL)); /* beyond its limit */
    g_assert_false(axis_was_at(axis, clock_now_us(heard->clock), &deg));

    const gint64 t0 = clock_now_us(heard->clock);
    g_assert_true(axis_turn(axis, 20, 5, NULL));
    g_assert_false(axis_turn(axis, 1, 5, NULL)); /* busy */
    axis_report_position(axis, 0, t0);
    axis_report_position(axis, 1, t0 + 450000);
    g_assert_false(axis_passes_at(axis, 10, &us)); /* it may still accelerate */
    axis_report_position(axis, 2.5, t0 + 750000);
    g_assert_true(axis_passes_at(axis, 10, &us));
    g_assert_cmpint(us, ==, t0 + 2250000);
    axis_report_position(axis, 9, t0 + 700000); /* out of order */
    g_assert_true(axis_passes_at(axis, 10, &us));
    g_assert_cmpint(us, ==, t0 + 2250000);
    g_assert_true(axis_was_at(axis, t0 + 600000, &deg));
    g_assert_cmpfloat_with_epsilon(deg, 1.75, 1e-9);
    g_assert_true(axis_was_at(axis, t0 + 225000, &deg));
    g_assert_cmpfloat_with_epsilon(deg, 0.5, 1e-9);
    g_assert_false(axis_was_at(axis, t0 + 750001, &deg));
    g_assert_false(axis_was_at(axis, t0 - 1, &deg));
    arrive(axis);
    heard_next(heard, AXIS_ARRIVED);
    g_assert_true(axis_was_at(axis, t0 + 600000, &deg)); /* still known */
    g_assert_false(axis_passes_at(axis, 10, &us));

    g_assert_true(axis_turn(axis, 10, 5, NULL));
    g_assert_cmpfloat(axis_turned_from_deg(axis), ==, 20);
    g_assert_false(axis_was_at(axis, t0 + 600000, &deg)); /* that was another turn */
    heard_next(heard, AXIS_FAULT);                        /* it never says that it has arrived */
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
}

static void test_stall(void) {
    static const char *const kinds[] = {"reported", "silent"};
    for (int kind = 0; kind < 2; kind++) {
        g_autoptr(Clock) clock = clock_new_virtual();
        g_autofree char *section =
            g_strdup_printf("[axis a]\nfault_stall_at = 2\nfault_stall_kind = %s", kinds[kind]);
        struct heard heard = {.clock = clock};
        g_autoptr(Axis) axis = open_axis(&sim_axis_driver, section, &heard);
        home(axis, &heard);
        go(axis, &heard, 10);
        g_assert_true(axis_move(axis, 100, NULL));
        heard_next(&heard, AXIS_FAULT);
        int code = kind ? DEVICE_ERROR_TIMEOUT : DEVICE_ERROR_STALLED;
        g_assert_error(heard.error, DEVICE_ERROR, code);
        g_assert_false(axis_is_homed(axis));
        g_assert_false(axis_move(axis, 20, NULL));
        for (int again = 0; again < 2; again++) { /* one that still answers says that it stands */
            g_assert_true(axis_halt(axis, NULL));
            heard_next(&heard, kind ? AXIS_FAULT : AXIS_STOPPED);
            g_assert_cmpint(axis_safety(axis), ==, kind ? DEVICE_UNSAFE : DEVICE_SAFE);
        }
        home(axis, &heard);
        go(axis, &heard, 100);
        heard_clear(&heard);
    }
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_autoptr(World) built_once = world_get(WORLD, NULL);
    g_test_add_func("/axis/move-time", test_move_time);
    g_test_add("/axis/predicted-time", struct heard, NULL, heard_begin, test_predicted_time,
               heard_end);
    g_test_add("/axis/backlash", struct heard, NULL, heard_begin, test_backlash, heard_end);
    g_test_add("/axis/deadline", struct heard, NULL, heard_begin, test_axis_deadline, heard_end);
    g_test_add("/axis/stop-fails", struct heard, NULL, heard_begin, test_stop_fails, heard_end);
    g_test_add("/axis/stop-refused", struct heard, NULL, heard_begin, test_stop_refused, heard_end);
    g_test_add("/axis/home-after-fault", struct heard, NULL, heard_begin, test_home_after_fault,
               heard_end);
    g_test_add("/axis/permit", struct heard, NULL, heard_begin, test_axis_permit, heard_end);
    g_test_add("/axis/sim-unheard", struct heard, NULL, heard_begin, test_sim_axis_unheard,
               heard_end);
    g_test_add("/axis/true-position", struct heard, NULL, heard_begin, test_true_position,
               heard_end);
    g_test_add("/axis/settling", struct heard, NULL, heard_begin, test_settling, heard_end);
    g_test_add("/axis/turning", struct heard, NULL, heard_begin, test_turning, heard_end);
    g_test_add_func("/axis/stall", test_stall);
    return g_test_run();
}
