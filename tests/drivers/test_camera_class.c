/* The camera class: a picture that is not the one asked for is never taken for it. */
#include "lib/heard.h"

#include <math.h>
#include <string.h>

static void on_camera(Camera *from, enum camera_event event, Frame *frame, const GError *error,
                      gpointer data) {
    struct heard *heard = data;
    if (event == CAMERA_EXPOSED)
        return;
    heard_event(heard, (int)event, error);
    g_clear_pointer(&heard->frame, frame_unref);
    heard->frame = frame ? frame_ref(frame) : NULL;
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
    heard_next(heard, event);
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
            heard_next(&heard, i && flaw ? CAMERA_REFUSED : CAMERA_FRAME);
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
        heard_next(&heard, CAMERA_FRAME);
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
    heard_next(heard, event);
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
    heard_next(&heard, CAMERA_REFUSED);
    g_assert_error(heard.error, DEVICE_ERROR, DEVICE_ERROR_STALE);
    heard_clear(&heard);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_autoptr(World) built_once = world_get(WORLD, NULL);
    g_test_add_func("/camera/stale-old", test_stale_old);
    g_test_add_func("/camera/stale-relabelled", test_stale_relabelled);
    g_test_add_func("/camera/lost", test_lost);
    g_test_add_func("/camera/slow", test_slow);
    g_test_add_func("/camera/disconnect", test_disconnect);
    g_test_add_func("/camera/flaws", test_flaws);
    g_test_add_func("/camera/one-pixel", test_one_pixel);
    g_test_add_func("/camera/unasked", test_unasked);
    return g_test_run();
}
