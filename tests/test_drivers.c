#include "conformance.h"
#include "sim/devices.h"
#include "sim/world.h"

#include <math.h>
#include <string.h>

#define RIG   SOURCE_DIR "/tests/small/rig.conf"
#define WORLD SOURCE_DIR "/tests/small/world.conf"

static const struct conformance turntable = {
    .name = "sim-turntable",
    .path = RIG,
    .section = "[axis turntable]\nworld = world.conf\nwraps = yes\nspeed_deg_s = 60\n"
               "accel_deg_s2 = 120\nbacklash_deg = 0.05\nsettle_ms = 150\n",
};
static const struct conformance slide = {
    .name = "sim-slide",
    .section = "[axis slide]\nmin_deg = -15\nmax_deg = 15\nspeed_deg_s = 30\naccel_deg_s2 = 400\n"
               "backlash_deg = 0.2\nlatency_ms = 35\n",
};
static const struct conformance bank = {
    .name = "sim-lamps",
    .path = RIG,
    .section = "[lamps bank]\nworld = world.conf\n",
};
static const struct conformance camera = {
    .name = "sim-camera",
    .path = RIG,
    .section = "[camera cam30]\nworld = world.conf\n",
    .exposure_us = 20000,
};
static const struct conformance quick_camera = {
    .name = "sim-camera-real-time",
    .path = RIG,
    .section = "[camera cam30]\nworld = world.conf\nreadout_ms = 5\n",
    .real_clock = TRUE,
    .exposure_us = 2000,
};
static const struct conformance laser = {
    .name = "sim-laser",
    .path = RIG,
    .section = "[laser laser30]\nworld = world.conf\n",
};
static const struct conformance door = {
    .name = "sim-interlock",
    .section = "[interlock door]\n",
};

struct heard {
    int n;
    int event;
    GError *error;
    Frame *frame;
    gint64 at_us;
    Clock *clock;
};

static void heard_clear(struct heard *heard) {
    g_clear_error(&heard->error);
    g_clear_pointer(&heard->frame, frame_unref);
}

static void hear(struct heard *heard, int event, const GError *error) {
    heard->n++;
    heard->event = event;
    heard->at_us = clock_now_us(heard->clock);
    g_clear_error(&heard->error);
    heard->error = error ? g_error_copy(error) : NULL;
}

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    hear(data, (int)event, error);
}

static void on_camera(Camera *from, enum camera_event event, Frame *frame, const GError *error,
                      gpointer data) {
    struct heard *heard = data;
    if (event == CAMERA_EXPOSED)
        return;
    hear(heard, (int)event, error);
    g_clear_pointer(&heard->frame, frame_unref);
    heard->frame = frame ? frame_ref(frame) : NULL;
}

static void on_lamp(LampBank *from, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    hear(data, index, error);
}

static void on_laser(Laser *from, gboolean on, const GError *error, gpointer data) {
    hear(data, on, error);
}

/* Waits for the next event. */
static void next(struct heard *heard, int event) {
    conformance_wait(heard->clock, &heard->n, 1, 1000);
    g_assert_cmpint(heard->n, ==, 1);
    g_assert_cmpint(heard->event, ==, event);
    heard->n = 0;
}

static Axis *open_axis(const struct axis_driver *driver, const char *section, struct heard *heard) {
    const struct conformance with = {.section = section, .path = RIG};
    const struct config_section *found;
    g_autoptr(Config) config = conformance_config(&with, "", &found);
    GError *error = NULL;
    Axis *axis = axis_open(driver, found, NULL, heard->clock, &error);
    g_assert_no_error(error);
    axis_listen(axis, on_axis, heard);
    return axis;
}

static void home(Axis *axis, struct heard *heard) {
    g_assert_true(axis_home(axis, NULL));
    next(heard, AXIS_HOMED);
}

static void go(Axis *axis, struct heard *heard, double to_deg) {
    GError *error = NULL;
    axis_move(axis, to_deg, &error);
    g_assert_no_error(error);
    next(heard, AXIS_ARRIVED);
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

static void test_predicted_time(void) {
    static const double targets[] = {30, 350, 170, 169.9, 169.95, 0, 180, 0, 0.001, -725.5};
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(Axis) axis = open_axis(&sim_axis_driver, turntable.section, &heard);
    home(axis, &heard);
    for (gsize i = 0; i < G_N_ELEMENTS(targets); i++) {
        double from = axis_position_deg(axis);
        double predicted = axis_move_time_s(&axis->motion, from, targets[i]);
        gint64 start = clock_now_us(clock);
        go(axis, &heard, targets[i]);
        double took = (double)(clock_now_us(clock) - start) / 1e6;
        g_assert_cmpfloat_with_epsilon(took, predicted, 1e-3);
    }
    g_assert_cmpfloat_with_epsilon(axis_position_deg(axis), 360 * 3 - 725.5, 1e-6);
}

/* An axis that notes what it is told and says nothing by itself. */
struct silent_axis {
    double targets[8];
    int n_targets, n_stops;
    double position;
};

static gboolean silent_open(Axis *axis, GError **error) {
    axis->motion = (struct axis_motion){-50, 50, FALSE, 10, 10, 2, 500};
    return TRUE;
}

static void silent_close(Axis *axis) {
}

static gboolean silent_home(Axis *axis, GError **error) {
    return TRUE;
}

static gboolean silent_move(Axis *axis, double target_deg, GError **error) {
    struct silent_axis *silent = axis->device.priv;
    silent->targets[silent->n_targets++] = target_deg;
    return TRUE;
}

static gboolean silent_stop(Axis *axis, GError **error) {
    ((struct silent_axis *)axis->device.priv)->n_stops++;
    return TRUE;
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

static void test_backlash(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(Axis) axis = open_axis(&silent_driver, "[axis a]", &heard);
    struct silent_axis *silent = axis->device.priv;
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_HOMED, NULL);
    next(&heard, AXIS_HOMED);

    g_assert_true(axis_move(axis, 20, NULL)); /* upwards: straight */
    arrive(axis);
    next(&heard, AXIS_ARRIVED);
    g_assert_cmpint(silent->n_targets, ==, 1);
    g_assert_true(axis_move(axis, 10, NULL)); /* downwards: past it and back */
    g_assert_cmpfloat(silent->targets[1], ==, 8);
    arrive(axis);
    g_assert_cmpint(heard.n, ==, 0);
    g_assert_cmpfloat(silent->targets[2], ==, 10);
    gint64 arrived = clock_now_us(clock);
    arrive(axis);
    next(&heard, AXIS_ARRIVED);
    g_assert_cmpint(heard.at_us - arrived, ==, 500000); /* settled */
    g_assert_true(axis_move(axis, -50, NULL));          /* no room below */
    g_assert_cmpfloat(silent->targets[3], ==, -50);
    arrive(axis);
    next(&heard, AXIS_ARRIVED);
    g_assert_cmpint(silent->n_targets, ==, 4);
    heard_clear(&heard);
}

static void test_axis_deadline(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(Axis) axis = open_axis(&silent_driver, "[axis a]", &heard);
    struct silent_axis *silent = axis->device.priv;
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_HOMED, NULL);
    next(&heard, AXIS_HOMED);
    gint64 start = clock_now_us(clock);
    g_assert_true(axis_move(axis, 20, NULL));
    next(&heard, AXIS_FAULT);
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(heard.at_us - start, ==, (gint64)(3.5 * 1.5e6) + 2000000);
    g_assert_cmpint(silent->n_stops, ==, 1);
    g_assert_false(axis_is_homed(axis));
    axis_report(axis, AXIS_ARRIVED, NULL); /* too late */
    axis_report(axis, AXIS_STOPPED, NULL);
    g_assert_true(axis_home(axis, NULL));
    axis_report(axis, AXIS_ARRIVED, NULL); /* still too late: no answer to home */
    conformance_pass(clock, 1);
    g_assert_cmpint(heard.n, ==, 0);
    next(&heard, AXIS_FAULT); /* homing has its deadline too */
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    heard_clear(&heard);
}

static double true_turntable(Clock *clock) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct world_state state;
    world_snapshot(world, clock_now_us(clock), 1, &state);
    return state.turntable_deg;
}

/* What backlash and errors do to the truth, and that the class undoes the first. */
static void test_true_position(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct heard heard = {.clock = clock};
    g_autoptr(Axis) axis =
        open_axis(&sim_axis_driver,
                  "[axis turntable]\nworld = world.conf\nwraps = yes\nbacklash_deg = 0.5\n"
                  "position_error_deg = 0.1\nsettle_ms = 100\n",
                  &heard);
    home(axis, &heard);
    go(axis, &heard, 40);
    double from_below = true_turntable(clock);
    g_assert_cmpfloat(fabs(from_below - 40), <=, 0.1);
    g_assert_cmpfloat(fabs(from_below - 40), >, 0);
    go(axis, &heard, 170);
    go(axis, &heard, 290); /* round and round: the same truth to the last bit */
    go(axis, &heard, 50);
    go(axis, &heard, 40);
    g_assert_cmpfloat(true_turntable(clock), ==, from_below);

    g_assert_true(axis_move(axis, 30, NULL)); /* half way down the load lags, and moves */
    conformance_pass(clock, 0.3);
    double lag = true_turntable(clock) - axis_position_deg(axis);
    g_assert_cmpfloat(lag, >, 0.35);
    g_assert_cmpfloat(lag, <, 2.0);
    g_assert_cmpfloat(true_turntable(clock), <, 40);
    next(&heard, AXIS_ARRIVED);
}

/* Straight after arrival the load still swings, until the settling time is over. */
static void test_settling(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct heard heard = {.clock = clock};
    g_autoptr(Axis) axis = open_axis(&sim_axis_driver, turntable.section, &heard);
    home(axis, &heard);
    double predicted = axis_move_time_s(&axis->motion, 0, 40);
    g_assert_true(axis_move(axis, 40, NULL));
    conformance_pass(clock, predicted - 0.01);
    g_assert_cmpint(heard.n, ==, 0);
    g_assert_cmpfloat(true_turntable(clock), !=, 40);
    next(&heard, AXIS_ARRIVED);
    g_assert_cmpfloat(true_turntable(clock), ==, 40);
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
        next(&heard, AXIS_FAULT);
        int code = kind ? DEVICE_ERROR_TIMEOUT : DEVICE_ERROR_STALLED;
        g_assert_error(heard.error, DEVICE_ERROR, code);
        g_assert_false(axis_is_homed(axis));
        g_assert_false(axis_move(axis, 20, NULL));
        home(axis, &heard);
        go(axis, &heard, 100);
        heard_clear(&heard);
    }
}

static Camera *open_camera(const struct camera_driver *driver, const char *keys,
                           struct heard *heard) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&camera, keys, &section);
    const struct camera_settings settings = {20000, 0};
    const char *const also[] = {"world", NULL};
    GError *error = NULL;
    Camera *opened = camera_open(driver, section, also, heard->clock, &error);
    g_assert_no_error(error);
    camera_listen(opened, on_camera, heard);
    g_assert_true(camera_configure(opened, &settings, NULL));
    g_assert_true(camera_arm(opened, NULL));
    return opened;
}

static void shoot(Camera *from, struct heard *heard, guint64 shot, int event) {
    GError *error = NULL;
    camera_trigger(from, shot, &error);
    g_assert_no_error(error);
    next(heard, event);
}

static gboolean same_pixels(const Frame *a, const Frame *b) {
    return memcmp(a->pixels, b->pixels, sizeof *a->pixels * a->width * a->height) == 0;
}

/* Every second picture or so is stale; whatever is accepted must be what a good camera sees. */
static void check_stale(const char *keys) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock}, truth = {.clock = clock};
    g_autoptr(Camera) bad = open_camera(&sim_camera_driver, keys, &heard);
    g_autoptr(Camera) good = open_camera(&sim_camera_driver, "part = cam30\n", &truth);
    int refused = 0;
    shoot(good, &truth, 1, CAMERA_FRAME);
    for (guint64 shot = 1; shot < 30; shot++) {
        shoot(good, &truth, shot, CAMERA_FRAME);
        g_assert_true(camera_trigger(bad, shot, NULL));
        conformance_wait(clock, &heard.n, 1, 60);
        while (heard.event == CAMERA_REFUSED) {
            g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_STALE);
            refused++;
            heard.n = 0;
            g_assert_true(camera_trigger(bad, shot, NULL));
            conformance_wait(clock, &heard.n, 1, 60);
        }
        heard.n = 0;
        g_assert_cmpint(heard.event, ==, CAMERA_FRAME);
        g_assert_true(same_pixels(heard.frame, truth.frame));
    }
    g_assert_cmpint(refused, >, 8);
    heard_clear(&heard);
    heard_clear(&truth);
}

static void test_stale_old(void) {
    check_stale("fault_stale = 0.5\nfault_seed = 3\n");
}

static void test_stale_relabelled(void) {
    check_stale("fault_stale = 0.5\nfault_stale_kind = relabelled\nfault_seed = 4\n");
}

static void test_lost(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(Camera) lossy = open_camera(&sim_camera_driver, "fault_lost = 1\n", &heard);
    gint64 start = clock_now_us(clock);
    shoot(lossy, &heard, 1, CAMERA_FAULT);
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(heard.at_us - start, ==, 1000 + 20000 + 3 * 30000 + 2000000);
    g_assert_false(camera_is_armed(lossy));
    g_assert_true(camera_arm(lossy, NULL));
    heard_clear(&heard);
}

/* Later than its deadline: a fault, and the late picture is not taken for the next one's. */
static void test_slow(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(Camera) slow = open_camera(&sim_camera_driver, "fault_slow_ms = 1500\n", &heard);
    shoot(slow, &heard, 1, CAMERA_FRAME);
    g_clear_pointer(&slow, camera_close);
    slow = open_camera(&sim_camera_driver, "fault_slow_ms = 3000\n", &heard);
    shoot(slow, &heard, 1, CAMERA_FAULT);
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    heard_clear(&heard);
}

static void test_disconnect(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    GError *error = NULL;
    g_autoptr(Camera) loose = open_camera(
        &sim_camera_driver, "fault_disconnect_after = 2\nfault_reconnect_s = 8\n", &heard);
    shoot(loose, &heard, 1, CAMERA_FRAME);
    shoot(loose, &heard, 2, CAMERA_FRAME);
    shoot(loose, &heard, 3, CAMERA_FAULT);
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_assert_false(camera_arm(loose, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_clear_error(&error);
    conformance_pass(clock, 8.1);
    g_assert_true(camera_arm(loose, NULL));
    for (guint64 shot = 3; shot < 8; shot++)
        shoot(loose, &heard, shot, CAMERA_FRAME);
    heard_clear(&heard);
}

/* A camera whose pictures the test makes. */
static gboolean null_open(Camera *from, GError **error) {
    from->format = (struct camera_format){4, 3, CFA_RGGB, 12, 64, 1, 1000000, 30000};
    return TRUE;
}

static void null_close(Camera *from) {
}

static gboolean null_configure(Camera *from, const struct camera_settings *settings,
                               GError **error) {
    return TRUE;
}

static gboolean null_arm(Camera *from, GError **error) {
    return TRUE;
}

static gboolean null_trigger(Camera *from, guint64 shot, GError **error) {
    return TRUE;
}

static const struct camera_driver null_driver = {
    .info = {"camera", "null", "Does nothing"},
    .open = null_open,
    .close = null_close,
    .configure = null_configure,
    .arm = null_arm,
    .disarm = null_close,
    .trigger = null_trigger,
};

static Frame *good_frame(Clock *clock, guint64 shot, guint64 id) {
    Frame *frame = frame_new(4, 3);
    for (int i = 0; i < 12; i++)
        frame->pixels[i] = (guint16)(100 + id + (guint64)(i * i));
    frame->shot = shot;
    frame->id = id;
    frame->cfa = CFA_RGGB;
    frame->bits = 12;
    frame->exposure_us = 20000;
    frame->exposure_end_us = clock_now_us(clock);
    frame->exposure_start_us = frame->exposure_end_us - 20000;
    return frame;
}

enum flaw {
    NONE,
    OLD_ID,
    SAME_ID,
    EARLY,
    SHORT,
    OTHER_EXPOSURE,
    FUTURE,
    SIZE,
    COLOURS,
    INCOMPLETE,
    OTHER_SHOT,
    REPEATED,
    N_FLAWS
};

static Frame *flawed_frame(Clock *clock, guint64 shot, guint64 id, enum flaw flaw) {
    Frame *frame = good_frame(clock, shot, id);
    switch (flaw) {
    case OLD_ID:
        frame->id = 5;
        break;
    case SAME_ID:
        frame->id = id - 1;
        break;
    case EARLY:
        frame->exposure_start_us -= 10001;
        frame->exposure_end_us -= 10001;
        break;
    case SHORT:
        frame->exposure_end_us -= 10000;
        break;
    case OTHER_EXPOSURE:
        frame->exposure_us = 10000;
        break;
    case FUTURE:
        frame->exposure_start_us += 3000000;
        frame->exposure_end_us += 3000000;
        break;
    case SIZE:
        frame->width = 3;
        frame->height = 4;
        break;
    case COLOURS:
        frame->cfa = CFA_BGGR;
        break;
    case INCOMPLETE:
        frame->incomplete = TRUE;
        break;
    case OTHER_SHOT:
        frame->shot--;
        break;
    case REPEATED:
        for (int i = 0; i < 12; i++)
            frame->pixels[i]--; /* those of the frame before */
        break;
    default:
        break;
    }
    return frame;
}

static void test_flaws(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    for (int flaw = NONE; flaw < N_FLAWS; flaw++) {
        struct heard heard = {.clock = clock};
        g_autoptr(Camera) null = open_camera(&null_driver, "", &heard);
        for (guint64 i = 0; i < 2; i++) {
            g_assert_true(camera_trigger(null, 700 + i, NULL));
            conformance_pass(clock, 0.03);
            camera_report_frame(null,
                                flawed_frame(clock, 700 + i, 10 + i, i ? (enum flaw)flaw : NONE));
            next(&heard, i && flaw ? CAMERA_REFUSED : CAMERA_FRAME);
        }
        if (flaw)
            g_assert_cmpint(heard.error->code, ==,
                            flaw == OLD_ID || flaw == SAME_ID || flaw == EARLY ||
                                    flaw == OTHER_SHOT || flaw == REPEATED
                                ? DEVICE_ERROR_STALE
                                : DEVICE_ERROR_PROTOCOL);
        g_assert_true(camera_trigger(null, 701, NULL)); /* may be given again at once */
        conformance_pass(clock, 0.03);
        camera_report_frame(null, good_frame(clock, 701, 12));
        next(&heard, CAMERA_FRAME);
        heard_clear(&heard);
    }
}

/* 13 × 11 pixels: words and pixels that are left over from them. */
static gboolean odd_open(Camera *from, GError **error) {
    from->format = (struct camera_format){13, 11, CFA_RGGB, 12, 64, 1, 1000000, 30000};
    return TRUE;
}

static Frame *odd_frame(Clock *clock, guint64 shot, int changed, int bit) {
    g_autoptr(Frame) small = good_frame(clock, shot, shot);
    Frame *frame = frame_new(13, 11);
    guint16 *pixels = frame->pixels;
    *frame = *small;
    frame->ref_count = 1;
    frame->width = 13;
    frame->height = 11;
    frame->pixels = pixels;
    for (int i = 0; i < 143; i++)
        pixels[i] = (guint16)(64 + i * i % 501);
    if (changed >= 0)
        pixels[changed] ^= (guint16)(1 << bit);
    return frame;
}

static void report_odd(struct heard *heard, Camera *from, guint64 shot, int changed, int bit,
                       enum camera_event event) {
    g_assert_true(camera_trigger(from, shot, NULL));
    conformance_pass(heard->clock, 0.03);
    camera_report_frame(from, odd_frame(heard->clock, shot, changed, bit));
    next(heard, event);
}

/* One bit of one pixel makes another picture, whichever it is. */
static void test_one_pixel(void) {
    struct camera_driver odd = null_driver;
    odd.open = odd_open;
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(Camera) from = open_camera(&odd, "", &heard);
    guint64 shot = 1;
    report_odd(&heard, from, shot++, -1, 0, CAMERA_FRAME);
    for (int i = 0; i < 143; i++) {
        for (int bit = 0; bit < 12; bit++)
            report_odd(&heard, from, shot++, i, bit, CAMERA_FRAME);
        report_odd(&heard, from, shot++, -1, 0, CAMERA_FRAME);
        report_odd(&heard, from, shot++, -1, 0, CAMERA_REFUSED);
    }
    heard_clear(&heard);
}

/* A picture that comes while nobody waits, and once more when somebody does. */
static void test_unasked(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(Camera) null = open_camera(&null_driver, "", &heard);
    camera_report_frame(null, good_frame(clock, 1, 10));
    g_assert_cmpint(heard.n, ==, 0);
    g_assert_true(camera_trigger(null, 2, NULL));
    conformance_pass(clock, 0.03);
    camera_report_frame(null, good_frame(clock, 2, 10));
    next(&heard, CAMERA_REFUSED);
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_STALE);
    heard_clear(&heard);
}

static LampBank *open_lamps(const struct lamps_driver *driver, const char *keys,
                            struct heard *heard) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&bank, keys, &section);
    const char *const also[] = {"world", NULL};
    GError *error = NULL;
    LampBank *opened = lamps_open(driver, section, also, heard->clock, &error);
    g_assert_no_error(error);
    lamps_listen(opened, on_lamp, heard);
    return opened;
}

static double lamp_output(Clock *clock, int lamp) {
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct world_state state;
    world_snapshot(world, clock_now_us(clock), 1000, &state);
    return state.lamp_output[lamp];
}

static void switch_lamp(LampBank *to, struct heard *heard, int index, gboolean on) {
    g_assert_true(lamps_set(to, index, on, NULL));
    next(heard, index);
    if (on)
        conformance_pass(heard->clock, to->warm_up_s);
}

static void test_dead_lamp(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct heard heard = {.clock = clock};
    g_autoptr(LampBank) lit =
        open_lamps(&sim_lamps_driver,
                   "lamps = lamp60; lamp30\nfault_dead = lamp30\nfault_dead_after = 2\n", &heard);
    int lamp60 = world_find_lamp(world, "lamp60"), lamp30 = world_find_lamp(world, "lamp30");
    for (int i = 0; i < 4; i++) {
        switch_lamp(lit, &heard, 0, TRUE);
        g_assert_cmpfloat(lamp_output(clock, lamp60), >, 0.9);
        g_assert_cmpfloat(lamp_output(clock, lamp30), ==, 0);
        switch_lamp(lit, &heard, 0, FALSE);
        switch_lamp(lit, &heard, 1, TRUE);
        g_assert_cmpint(lamp_output(clock, lamp30) > 0.9, ==, i < 2);
        g_assert_true(lamps_is_on(lit, 1)); /* its switch answers all the same */
        switch_lamp(lit, &heard, 1, FALSE);
    }
    switch_lamp(lit, &heard, 0, TRUE);
    g_clear_pointer(&lit, lamps_close);
    conformance_pass(clock, 0.1);
    g_assert_cmpfloat(lamp_output(clock, lamp60), ==, 0);
}

static gboolean silent_lamps_open(LampBank *from, GError **error) {
    from->n = 3;
    return TRUE;
}

static void silent_lamps_close(LampBank *from) {
}

static gboolean silent_lamps_set(LampBank *from, int index, gboolean on, GError **error) {
    return TRUE;
}

static const struct lamps_driver silent_lamps_driver = {
    .info = {"lamps", "silent", "Says nothing"},
    .open = silent_lamps_open,
    .close = silent_lamps_close,
    .set = silent_lamps_set,
};

static void test_lamp_deadline(void) {
    g_autoptr(Clock) clock = clock_new_virtual();
    struct heard heard = {.clock = clock};
    g_autoptr(LampBank) silent = open_lamps(&silent_lamps_driver, "", &heard);
    gint64 start = clock_now_us(clock);
    g_assert_true(lamps_set(silent, 1, TRUE, NULL));
    next(&heard, 1);
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(heard.at_us - start, ==, 2000000);
    g_assert_false(lamps_is_on(silent, 1));
    lamps_report(silent, 1, TRUE, NULL); /* too late */
    g_assert_cmpint(heard.n, ==, 0);
    heard_clear(&heard);
}

static void test_laser_stays_on(void) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&laser, "fault_stays_on = yes\n", &section);
    g_autoptr(Clock) clock = clock_new_virtual();
    g_autoptr(World) world = world_get(WORLD, NULL);
    struct heard heard = {.clock = clock};
    struct world_state state;
    int index = world_find_laser(world, "laser30");
    g_autoptr(Laser) stuck = laser_open(&sim_laser_driver, section, NULL, clock, NULL);
    laser_listen(stuck, on_laser, &heard);
    for (int on = 1; on >= 0; on--) {
        g_assert_true(laser_set(stuck, on, NULL));
        next(&heard, on);
        g_assert_cmpint(laser_is_on(stuck), ==, on);
        world_snapshot(world, clock_now_us(clock), 1, &state);
        g_assert_true(state.laser_on[index]);
    }
    g_clear_pointer(&stuck, laser_close);
    world_snapshot(world, clock_now_us(clock), 1, &state);
    g_assert_false(state.laser_on[index]);
}

static void test_door(void) {
    const struct config_section *section;
    g_autoptr(Config) config =
        conformance_config(&door, "open_after_s = 10\nopen_for_s = 5\n", &section);
    g_autoptr(Clock) clock = clock_new_virtual();
    g_autoptr(Interlock) opened = interlock_open(&sim_interlock_driver, section, NULL, clock, NULL);
    g_assert_true(interlock_is_closed(opened));
    conformance_pass(clock, 9.9);
    g_assert_true(interlock_is_closed(opened));
    conformance_pass(clock, 0.2);
    g_assert_false(interlock_is_closed(opened));
    conformance_pass(clock, 5);
    g_assert_true(interlock_is_closed(opened));
}

static void test_wrong_parts(void) {
    static const char *const keys[] = {"part = nothing\n", "world = missing.conf\n"};
    g_autoptr(Clock) clock = clock_new_virtual();
    for (gsize i = 0; i < G_N_ELEMENTS(keys); i++) {
        g_autofree char *text =
            g_strconcat("[camera x]\n", i ? "" : "world = world.conf\n", keys[i], NULL);
        g_autoptr(Config) config = config_parse(text, RIG, NULL);
        const struct config_section *section = config_find(config, "camera", "x");
        g_autoptr(GError) error = NULL;
        g_assert_null(camera_open(&sim_camera_driver, section, NULL, clock, &error));
        g_assert_nonnull(error);
        g_autoptr(GError) second = NULL;
        g_assert_null(axis_open(&sim_axis_driver, section, NULL, clock, &second));
        g_assert_nonnull(second);
    }
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_autoptr(World) built_once = world_get(WORLD, NULL);
    conformance_axis(&sim_axis_driver, &turntable);
    conformance_axis(&sim_axis_driver, &slide);
    conformance_lamps(&sim_lamps_driver, &bank);
    conformance_camera(&sim_camera_driver, &camera);
    conformance_camera(&sim_camera_driver, &quick_camera);
    conformance_laser(&sim_laser_driver, &laser);
    conformance_interlock(&sim_interlock_driver, &door);
    g_test_add_func("/axis/move-time", test_move_time);
    g_test_add_func("/axis/predicted-time", test_predicted_time);
    g_test_add_func("/axis/backlash", test_backlash);
    g_test_add_func("/axis/deadline", test_axis_deadline);
    g_test_add_func("/axis/true-position", test_true_position);
    g_test_add_func("/axis/settling", test_settling);
    g_test_add_func("/axis/stall", test_stall);
    g_test_add_func("/camera/stale-old", test_stale_old);
    g_test_add_func("/camera/stale-relabelled", test_stale_relabelled);
    g_test_add_func("/camera/lost", test_lost);
    g_test_add_func("/camera/slow", test_slow);
    g_test_add_func("/camera/disconnect", test_disconnect);
    g_test_add_func("/camera/flaws", test_flaws);
    g_test_add_func("/camera/one-pixel", test_one_pixel);
    g_test_add_func("/camera/unasked", test_unasked);
    g_test_add_func("/lamps/dead", test_dead_lamp);
    g_test_add_func("/lamps/deadline", test_lamp_deadline);
    g_test_add_func("/laser/stays-on", test_laser_stays_on);
    g_test_add_func("/interlock/door", test_door);
    g_test_add_func("/options/wrong-parts", test_wrong_parts);
    return g_test_run();
}
