#include "conformance.h"

#include "drivers/v4l2/v4l2.h"
#include "sim/virtual/testbed.h"
#include "sim/virtual/v4l2.h"

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

int main(int argc, char **argv) {
    testbed_enter(argv);
    g_test_init(&argc, &argv, NULL);
    g_autoptr(VirtualV4l2) first = virtual_v4l2_new(
        &(struct virtual_v4l2_config){.number = 0, .port = "2-1.2", .cfa = CFA_GBRG, .bits = 12});
    g_autoptr(VirtualV4l2) second = virtual_v4l2_new(&(struct virtual_v4l2_config){
        .number = 2, .port = "2-1.3", .stamp = VIRTUAL_V4L2_FIRST_DATA, .bits = 8});
    g_autoptr(VirtualV4l2) third = virtual_v4l2_new(&(struct virtual_v4l2_config){
        .number = 7, .port = "2-2", .stamp = VIRTUAL_V4L2_END, .bits = 10, .width = 61});
    conformance_camera(&v4l2_camera_driver, &bayer);
    conformance_camera(&v4l2_camera_driver, &uvc);
    conformance_camera(&v4l2_camera_driver, &end_of_frame);
    return g_test_run();
}
