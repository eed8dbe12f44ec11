#include "conformance/conformance.h"
#include "lib/camera_open.h"

#include "lib/ok.h"
#include "v4l2/v4l2.h"
#include "virtual/cameras/v4l2.h"
#include "virtual/testbed.h"

#include <string.h>

/* What every driver must do, asked of the V4L2 driver in real time, of cameras that stamp their
 * frames in each of the three ways, all plugged in together. */
static const struct conformance bayer = {
    .name = "v4l2-bayer",
    .section = "[camera test]\ndriver = v4l2-camera\ndevice = /dev/video0\n",
    .real_clock = TRUE,
    .exposure_us = 1000,
};

static const struct conformance uvc = {
    .name = "v4l2-uvc",
    .section = "[camera test]\ndriver = v4l2-camera\nbus = usb-virtual-2-1.3\nformat = YUYV\n"
               "frame_rate = 200\nwhite_balance_k = 5000\ncontrols = gamma=100\n",
    .real_clock = TRUE,
    .exposure_us = 1000,
};

static const struct conformance end_of_frame = {
    .name = "v4l2-end-of-frame",
    .section = "[camera test]\ndriver = v4l2-camera\ndevice = /dev/video7\nformat = Y10P\n",
    .real_clock = TRUE,
    .exposure_us = 1000,
};

/* What cameras behind an image processor have: the multi-planar interface. */
static const struct conformance planar = {
    .name = "v4l2-multi-planar",
    .section = "[camera test]\ndriver = v4l2-camera\ndevice = /dev/video8\n",
    .real_clock = TRUE,
    .exposure_us = 1000,
};

struct seen {
    int n;
    enum camera_event last;
    guint64 sum; /* of the picture's values */
    GError *error;
};

static void on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                     gpointer data) {
    struct seen *seen = data;
    if (event == CAMERA_EXPOSED)
        return;
    seen->n++;
    seen->last = event;
    g_clear_error(&seen->error);
    seen->error = error ? g_error_copy(error) : NULL;
    for (int i = 0; frame && i < frame->width * frame->height; i++)
        seen->sum += frame->pixels[i];
}

static Camera *open_camera(Clock *clock, const char *section, GError **error) {
    const struct conformance described = {.section = section};
    const struct config_section *found;
    g_autoptr(Config) config = conformance_config(&described, "", &found);
    return camera_open(&v4l2_camera_driver, found, NULL, clock, error);
}

static void expose_flat(gpointer user, gint64 start_us, gint64 exposure_us, double gain_db,
                        guint64 number, guint16 *pixels) {
    for (int i = 0; i < 64 * 48; i++)
        pixels[i] = (guint16)(i % 1000);
}

/* A complete picture arrives, and half a picture is reported as a fault. */
static void planes(void) {
    g_autoptr(VirtualV4l2) device = virtual_v4l2_new(&(struct virtual_v4l2_config){
        .number = 9, .port = "2-4", .bits = 10, .planes = 1, .expose = expose_flat});
    g_autoptr(Clock) clock = clock_new_real();
    struct camera_settings settings = {1000, 0};
    struct seen seen = {0};
    guint64 sum = 0;
    Camera *camera = ok(open_camera(
        clock, "[camera test]\ndriver = v4l2-camera\ndevice = /dev/video9\nformat = Y10P\n", ERR));
    camera_listen(camera, on_event, &seen);
    g_assert_true(camera_configure(camera, &settings, NULL));
    g_assert_true(camera_arm(camera, NULL));
    g_assert_true(camera_trigger(camera, 1, NULL));
    conformance_wait(clock, &seen.n, 1, 5);
    for (int i = 0; i < 64 * 48; i++)
        sum += (guint64)(i % 1000);
    g_assert_cmpint(seen.last, ==, CAMERA_FRAME);
    g_assert_cmpuint(seen.sum, ==, sum);
    virtual_v4l2_set_fault(device, VIRTUAL_V4L2_SHORT);
    conformance_pass(clock, 0.05);
    g_assert_true(camera_trigger(camera, 2, NULL));
    conformance_wait(clock, &seen.n, 2, 5);
    g_assert_cmpint(seen.last, ==, CAMERA_REFUSED);
    g_assert_nonnull(strstr(seen.error->message, "lost on the way"));
    g_clear_error(&seen.error);
    camera_close(camera);
}

static void two_planes(void) {
    g_autoptr(VirtualV4l2) device =
        virtual_v4l2_new(&(struct virtual_v4l2_config){.number = 9, .port = "2-4", .planes = 2});
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    g_assert_null(
        open_camera(clock, "[camera test]\ndriver = v4l2-camera\ndevice = /dev/video9\n", &error));
    g_assert_error(error, DEVICE_ERROR, DEVICE_ERROR_UNSUPPORTED);
    g_assert_nonnull(strstr(error->message, "/dev/video9 spreads a frame of format"));
    g_assert_nonnull(strstr(error->message, "over 2 planes of memory"));
    g_clear_error(&error);
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    g_test_init(&argc, &argv, NULL);
    g_autoptr(VirtualV4l2) first = virtual_v4l2_new(
        &(struct virtual_v4l2_config){.number = 0, .port = "2-1.2", .cfa = CFA_GBRG, .bits = 12});
    g_autoptr(VirtualV4l2) second = virtual_v4l2_new(&(struct virtual_v4l2_config){
        .number = 2, .port = "2-1.3", .stamp = VIRTUAL_V4L2_FIRST_DATA, .bits = 8});
    g_autoptr(VirtualV4l2) third = virtual_v4l2_new(&(struct virtual_v4l2_config){
        .number = 7, .port = "2-2", .stamp = VIRTUAL_V4L2_END, .bits = 10, .width = 61});
    g_autoptr(VirtualV4l2) fourth = virtual_v4l2_new(&(struct virtual_v4l2_config){
        .number = 8, .port = "2-3", .cfa = CFA_RGGB, .bits = 10, .planes = 1});
    conformance_camera(&v4l2_camera_driver, &bayer);
    conformance_camera(&v4l2_camera_driver, &uvc);
    conformance_camera(&v4l2_camera_driver, &end_of_frame);
    conformance_camera(&v4l2_camera_driver, &planar);
    g_test_add_func("/v4l2/planes", planes);
    g_test_add_func("/v4l2/two-planes", two_planes);
    return g_test_run();
}
