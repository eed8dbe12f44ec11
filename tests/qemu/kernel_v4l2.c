/*
 * The V4L2 driver against the kernel's own virtual camera, vivid, with its fault controls. Vivid
 * has no exposure control, and its frames are stamped at their end. Run by tests/qemu/run, where
 * vivid's single-planar node is /dev/video0.
 */
#include "conformance/conformance.h"
#include "lib/camera_open.h"

#include "v4l2/controls.h"
#include "v4l2/v4l2.h"

#include <string.h>

#define NODE "/dev/video0"

/* 320 × 180 comes at 15 frames a second at least. */
#define COMMON "[camera test]\ndriver = v4l2-camera\ndevice = " NODE "\nwidth = 320\nheight = 180\n"

struct rig {
    Clock *clock;
    Camera *camera;
    struct video_node node; /* the same one, opened for its fault controls */
    int n;
    enum camera_event last;
    Frame *frame;
    GError *error;
};

static void on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                     gpointer data) {
    struct rig *rig = data;
    if (event == CAMERA_EXPOSED)
        return;
    rig->n++;
    rig->last = event;
    g_clear_error(&rig->error);
    g_clear_pointer(&rig->frame, frame_unref);
    if (error)
        rig->error = g_error_copy(error);
    if (frame)
        rig->frame = frame_ref(frame);
}

struct exposing {
    int exposure_us;
    const char *more; /* keys */
};

static void begin(struct rig *rig, gconstpointer data) {
    static const struct conformance with = {.section = COMMON};
    const struct exposing *how = data;
    const struct camera_settings settings = {how->exposure_us, 0};
    const struct config_section *section;
    GError *error = NULL;
    g_autofree char *keys =
        g_strdup_printf("fixed_exposure_us = %d\n%s", how->exposure_us, how->more);
    g_autoptr(Config) config = conformance_config(&with, keys, &section);
    *rig = (struct rig){.clock = clock_new_real()};
    rig->camera = camera_open(&v4l2_camera_driver, section, NULL, rig->clock, &error);
    g_assert_no_error(error);
    camera_listen(rig->camera, on_event, rig);
    g_assert_true(camera_configure(rig->camera, &settings, NULL));
    camera_arm(rig->camera, &error);
    g_assert_no_error(error);
    video_node_open(&rig->node, "test", NODE, NULL, &error);
    g_assert_no_error(error);
}

static void end(struct rig *rig, gconstpointer unused) {
    video_node_close(&rig->node);
    g_clear_pointer(&rig->camera, camera_close);
    g_clear_pointer(&rig->clock, clock_unref);
    g_clear_pointer(&rig->frame, frame_unref);
    g_clear_error(&rig->error);
}

static void trigger(struct rig *rig, guint64 shot) {
    GError *error = NULL;
    rig->n = 0;
    camera_trigger(rig->camera, shot, &error);
    g_assert_no_error(error);
}

/* What is written into the pictures is the time since the stream began: two streams may well send
 * the same picture, which is refused, rightly, and another taken. */
static gboolean is_same_again(const struct rig *rig) {
    return rig->last == CAMERA_REFUSED &&
           g_error_matches(rig->error, DEVICE_ERROR, DEVICE_ERROR_STALE) &&
           strstr(rig->error->message, "bit for bit");
}

static void shoot(struct rig *rig, guint64 shot, enum camera_event event) {
    for (int i = 0; i == 0 || (i < 5 && is_same_again(rig)); i++) {
        trigger(rig, shot);
        conformance_wait(rig->clock, &rig->n, 1, 30);
    }
    if (event == CAMERA_FRAME)
        g_assert_no_error(rig->error);
    g_assert_cmpint(rig->last, ==, event);
}

static void set(struct video_node *node, const char *setting) {
    GError *error = NULL;
    video_control_set_named(node, setting, &error);
    g_assert_no_error(error);
}

/* The button marks the buffer that is filled next, which may be one that began before the trigger
 * and is passed over: so it is pressed again. */
static void test_error_flag(struct rig *rig, gconstpointer unused) {
    int n_refused = 0;
    for (guint64 shot = 1; shot <= 20 && n_refused == 0; shot++) {
        trigger(rig, shot);
        conformance_pass(rig->clock, (double)(shot * 17 % 70) * 1e-3);
        set(&rig->node, "inject_v4l2_buf_flag_error=0");
        conformance_wait(rig->clock, &rig->n, 1, 30);
        if (rig->last == CAMERA_REFUSED) {
            g_assert_error(rig->error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
            g_assert_true(strstr(rig->error->message, "lost on the way") != NULL);
            n_refused++;
        }
    }
    g_assert_cmpint(n_refused, >, 0);
    shoot(rig, 99, CAMERA_FRAME);
}

/* Told to stamp frames at the start of their exposure, vivid hands them over at the same time: an
 * exposure of 60 ms that began just now is said to be over. That end lies in the future, and is
 * refused. */
static void test_future(struct rig *rig, gconstpointer unused) {
    int n_refused = 0;
    shoot(rig, 1, CAMERA_FRAME);
    camera_disarm(rig->camera);
    set(&rig->node, "timestamp_source=1");
    g_assert_true(camera_arm(rig->camera, NULL));
    for (int i = 0; i < 20 && n_refused == 0; i++) {
        trigger(rig, 2);
        conformance_wait(rig->clock, &rig->n, 1, 30);
        if (rig->last != CAMERA_REFUSED)
            continue; /* looked at so late that it is over, with a machine as slow as this */
        g_assert_error(rig->error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
        g_assert_true(strstr(rig->error->message, "in the future") != NULL);
        n_refused++;
    }
    g_assert_cmpint(n_refused, >, 0);
    camera_disarm(rig->camera);
    set(&rig->node, "timestamp_source=0");
    g_assert_true(camera_arm(rig->camera, NULL));
    shoot(rig, 3, CAMERA_FRAME);
}

/* Half of the frames are dropped: every trigger is answered all the same. */
static void test_dropped(struct rig *rig, gconstpointer unused) {
    set(&rig->node, "percentage_of_dropped_buffers=50");
    for (guint64 shot = 1; shot <= 5; shot++)
        shoot(rig, shot, CAMERA_FRAME);
    set(&rig->node, "percentage_of_dropped_buffers=100");
    shoot(rig, 6, CAMERA_FAULT);
    g_assert_error(rig->error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT);
    set(&rig->node, "percentage_of_dropped_buffers=0");
    g_assert_true(camera_arm(rig->camera, NULL));
    shoot(rig, 6, CAMERA_FRAME);
}

/* All nodes of vivid vanish until everybody has closed them. */
static void test_disconnected(struct rig *rig, gconstpointer unused) {
    shoot(rig, 1, CAMERA_FRAME);
    trigger(rig, 2);
    struct v4l2_control button = {V4L2_CID_USER_BASE | 0xf000, 1};
    struct v4l2_queryctrl control = {.id = V4L2_CTRL_FLAG_NEXT_CTRL};
    while (video_ioctl(&rig->node, VIDIOC_QUERYCTRL, &control) == 0 &&
           strcmp((char *)control.name, "Disconnect") != 0)
        control.id |= V4L2_CTRL_FLAG_NEXT_CTRL;
    button.id = control.id;
    g_assert_cmpint(video_ioctl(&rig->node, VIDIOC_S_CTRL, &button), ==, 0);
    conformance_wait(rig->clock, &rig->n, 1, 30);
    g_assert_cmpint(rig->last, ==, CAMERA_FAULT);
    g_assert_error(rig->error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
    g_assert_false(camera_is_armed(rig->camera));
    g_assert_false(camera_arm(rig->camera, NULL)); /* the test itself still holds it */
    video_node_close(&rig->node);
    GError *error = NULL;
    camera_arm(rig->camera, &error);
    g_assert_no_error(error);
    shoot(rig, 2, CAMERA_FRAME);
}

static void test_no_start(struct rig *rig, gconstpointer unused) {
    GError *error = NULL;
    camera_disarm(rig->camera);
    set(&rig->node, "inject_vidioc_streamon_error=0");
    g_assert_false(camera_arm(rig->camera, &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_PROTOCOL);
    g_clear_error(&error);
    g_assert_true(camera_arm(rig->camera, NULL));
    shoot(rig, 1, CAMERA_FRAME);
}

static void test_breaks(struct rig *rig, gconstpointer unused) {
    shoot(rig, 1, CAMERA_FRAME);
    trigger(rig, 2);
    set(&rig->node, "inject_fatal_streaming_error=0");
    conformance_wait(rig->clock, &rig->n, 1, 30);
    g_assert_cmpint(rig->last, ==, CAMERA_FAULT);
    g_assert_true(camera_arm(rig->camera, NULL));
    shoot(rig, 2, CAMERA_FRAME);
}

/* Vivid shows colour bars of 75 %, the first one white, the last one black. */
static void check_bars(const char *format, int bits) {
    struct rig rig;
    g_autofree char *more = g_strdup_printf("format = %s\n", format);
    begin(&rig, &(struct exposing){5000, more});
    shoot(&rig, 1, CAMERA_FRAME);
    g_assert_cmpint(rig.frame->bits, ==, bits);
    int most = (1 << bits) - 1, y = 176; /* below what vivid writes into the picture */
    double black = rig.camera->format.black_level;
    double white = black + 0.75 * (black > 0 ? 219 : most);
    for (int x = 4; x < 30; x++) {
        g_assert_cmpfloat_with_epsilon(rig.frame->pixels[y * 320 + x], white, most * 0.01);
        g_assert_cmpfloat_with_epsilon(rig.frame->pixels[y * 320 + 319 - x], black, most * 0.01);
    }
    g_print("# %s: white %d, black %d of %d\n", format, rig.frame->pixels[y * 320 + 10],
            rig.frame->pixels[y * 320 + 309], most);
    end(&rig, NULL);
}

static void test_formats(void) {
    check_bars("YUYV", 8);
    check_bars("UYVY", 8);
    check_bars("GREY", 8);
    check_bars("RGGB", 8);
    check_bars("RG10", 10);
    check_bars("BG12", 12);
    check_bars("GB16", 16);
    check_bars("Y10", 10);
}

static void test_scan(void) {
    g_autoptr(GPtrArray) all = found_list_new();
    g_assert_true(v4l2_scan(all, NULL));
    g_assert_cmpuint(all->len, ==, 2); /* the other is multi-planar */
    const struct found *found = all->pdata[0];
    g_assert_cmpstr(found->address, ==, NODE);
    g_assert_nonnull(found->section);
    g_print("# %s\n# %s\n", found->what, found->note);
}

int main(int argc, char **argv) {
    static const struct exposing quick = {5000, "format = YUYV\n"};
    static const struct exposing slow = {60000, "format = YUYV\nframe_rate = 15\n"};
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/vivid/scan", test_scan);
    g_test_add_func("/vivid/formats", test_formats);
    g_test_add("/vivid/error-flag", struct rig, &quick, begin, test_error_flag, end);
    g_test_add("/vivid/future", struct rig, &slow, begin, test_future, end);
    g_test_add("/vivid/dropped", struct rig, &quick, begin, test_dropped, end);
    g_test_add("/vivid/no-start", struct rig, &quick, begin, test_no_start, end);
    g_test_add("/vivid/breaks", struct rig, &quick, begin, test_breaks, end);
    g_test_add("/vivid/disconnected", struct rig, &quick, begin, test_disconnected, end);
    return g_test_run();
}
