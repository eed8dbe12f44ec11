/* The camera class: a picture that does not belong to the trigger is never accepted. */
#include "lib/camera_open.h"
#include "lib/heard.h"
#include "lib/ok.h"

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
    Camera *opened = ok(camera_open(driver, section, also, heard->clock, ERR));
    camera_listen(opened, on_camera, heard);
    g_assert_true(camera_configure(opened, &settings, NULL));
    g_assert_true(camera_arm(opened, NULL));
    return opened;
}

static void shoot(Camera *from, struct heard *heard, guint64 shot, int event) {
    ok(camera_trigger(from, shot, ERR));
    heard_next(heard, event);
}

/* Every second picture or so is stale; whatever is accepted must be what a good camera sees. */
static void test_stale(gconstpointer keys) {
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
        gsize bytes = sizeof *truth.frame->pixels * truth.frame->width * truth.frame->height;
        g_assert_cmpmem(heard.frame->pixels, bytes, truth.frame->pixels, bytes);
    }
    g_assert_cmpint(refused, >, 8);
    heard_clear(&heard);
    heard_clear(&truth);
}

static void test_lost(struct heard *heard, gconstpointer unused) {
    g_autoptr(Camera) lossy = open_camera(&sim_camera_driver, "fault_lost = 1\n", heard);
    gint64 start = clock_now_us(heard->clock);
    shoot(lossy, heard, 1, CAMERA_FAULT);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    g_assert_cmpint(heard->at_us - start, ==, 1000 + 20000 + 3 * 30000 + 2000000);
    g_assert_false(camera_is_armed(lossy));
    g_assert_true(camera_arm(lossy, NULL));
}

/* Later than its deadline: a fault, and the late picture is not taken for the next one's. */
static void test_slow(struct heard *heard, gconstpointer unused) {
    g_autoptr(Camera) slow = open_camera(&sim_camera_driver, "fault_slow_ms = 1500\n", heard);
    shoot(slow, heard, 1, CAMERA_FRAME);
    g_clear_pointer(&slow, camera_close);
    slow = open_camera(&sim_camera_driver, "fault_slow_ms = 3000\n", heard);
    shoot(slow, heard, 1, CAMERA_FAULT);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
}

static void test_disconnect(struct heard *heard, gconstpointer unused) {
    GError *error = NULL;
    g_autoptr(Camera) loose = open_camera(
        &sim_camera_driver, "fault_disconnect_after = 2\nfault_reconnect_s = 8\n", heard);
    shoot(loose, heard, 1, CAMERA_FRAME);
    shoot(loose, heard, 2, CAMERA_FRAME);
    shoot(loose, heard, 3, CAMERA_FAULT);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_assert_false(camera_arm(loose, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_clear_error(&error);
    conformance_pass(heard->clock, 8.1);
    g_assert_true(camera_arm(loose, NULL));
    for (guint64 shot = 3; shot < 8; shot++)
        shoot(loose, heard, shot, CAMERA_FRAME);
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

/* What differs from the picture that is wanted, number 11 of shot 701. */
static const struct flaw {
    gboolean stale; /* refused as such */
    int id, shot, width, height, cfa, pixels;
    gint64 start_us, end_us, exposure_us;
    gboolean incomplete;
} flaws[] = {
    {0},
    {TRUE, .id = -6},
    {TRUE, .id = -1},
    {TRUE, .start_us = -10001, .end_us = -10001},
    {FALSE, .end_us = -10000},
    {FALSE, .exposure_us = -10000},
    {FALSE, .start_us = 3000000, .end_us = 3000000},
    {FALSE, .width = -1, .height = 1},
    {FALSE, .cfa = CFA_BGGR - CFA_RGGB},
    {FALSE, .incomplete = TRUE},
    {TRUE, .shot = -1},
    {TRUE, .pixels = -1}, /* those of the frame before */
};

static Frame *flawed_frame(Clock *clock, const struct flaw *flaw) {
    Frame *frame = good_frame(clock, 701 + (guint64)flaw->shot, 11);
    frame->id += (guint64)flaw->id;
    frame->exposure_start_us += flaw->start_us;
    frame->exposure_end_us += flaw->end_us;
    frame->exposure_us += flaw->exposure_us;
    frame->width += flaw->width;
    frame->height += flaw->height;
    frame->cfa = (enum cfa)((int)frame->cfa + flaw->cfa);
    frame->incomplete = flaw->incomplete;
    for (int i = 0; i < 12; i++)
        frame->pixels[i] = (guint16)(frame->pixels[i] + flaw->pixels);
    return frame;
}

static void test_flaws(struct heard *heard, gconstpointer unused) {
    for (gsize i = 0; i < G_N_ELEMENTS(flaws); i++) {
        int code = flaws[i].stale ? DEVICE_ERROR_STALE : DEVICE_ERROR_PROTOCOL;
        g_autoptr(Camera) null = open_camera(&null_driver, "", heard);
        g_assert_true(camera_trigger(null, 700, NULL));
        conformance_pass(heard->clock, 0.03);
        camera_report_frame(null, good_frame(heard->clock, 700, 10));
        heard_next(heard, CAMERA_FRAME);
        g_assert_true(camera_trigger(null, 701, NULL));
        conformance_pass(heard->clock, 0.03);
        camera_report_frame(null, flawed_frame(heard->clock, &flaws[i]));
        heard_next(heard, i ? CAMERA_REFUSED : CAMERA_FRAME);
        if (i)
            g_assert_error(heard->error, DEVICE_ERROR, code);
        g_assert_true(camera_trigger(null, 701, NULL)); /* may be given again immediately */
        conformance_pass(heard->clock, 0.03);
        camera_report_frame(null, good_frame(heard->clock, 701, 12));
        heard_next(heard, CAMERA_FRAME);
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
static void test_one_pixel(struct heard *heard, gconstpointer unused) {
    struct camera_driver odd = null_driver;
    odd.open = odd_open;
    g_autoptr(Camera) from = open_camera(&odd, "", heard);
    guint64 shot = 1;
    report_odd(heard, from, shot++, -1, 0, CAMERA_FRAME);
    for (int i = 0; i < 143; i++) {
        for (int bit = 0; bit < 12; bit++)
            report_odd(heard, from, shot++, i, bit, CAMERA_FRAME);
        report_odd(heard, from, shot++, -1, 0, CAMERA_FRAME);
        report_odd(heard, from, shot++, -1, 0, CAMERA_REFUSED);
    }
}

/* A picture that arrives without a trigger, and again after a trigger. */
static void test_unasked(struct heard *heard, gconstpointer unused) {
    g_autoptr(Camera) null = open_camera(&null_driver, "", heard);
    camera_report_frame(null, good_frame(heard->clock, 1, 10));
    g_assert_cmpint(heard->n, ==, 0);
    g_assert_true(camera_trigger(null, 2, NULL));
    conformance_pass(heard->clock, 0.03);
    camera_report_frame(null, good_frame(heard->clock, 2, 10));
    heard_next(heard, CAMERA_REFUSED);
    g_assert_error(heard->error, DEVICE_ERROR, DEVICE_ERROR_STALE);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_autoptr(World) built_once = world_get(WORLD, NULL);
    g_test_add_data_func("/camera/stale-old", "fault_stale = 0.5\nfault_seed = 3\n", test_stale);
    g_test_add_data_func("/camera/stale-relabelled",
                         "fault_stale = 0.5\nfault_stale_kind = relabelled\nfault_seed = 4\n",
                         test_stale);
    g_test_add("/camera/lost", struct heard, NULL, heard_begin, test_lost, heard_end);
    g_test_add("/camera/slow", struct heard, NULL, heard_begin, test_slow, heard_end);
    g_test_add("/camera/disconnect", struct heard, NULL, heard_begin, test_disconnect, heard_end);
    g_test_add("/camera/flaws", struct heard, NULL, heard_begin, test_flaws, heard_end);
    g_test_add("/camera/one-pixel", struct heard, NULL, heard_begin, test_one_pixel, heard_end);
    g_test_add("/camera/unasked", struct heard, NULL, heard_begin, test_unasked, heard_end);
    return g_test_run();
}
