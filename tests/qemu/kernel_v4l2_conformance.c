/*
 * What every driver must do, asked of the V4L2 driver with the kernel's own virtual camera, vivid.
 * Run by tests/qemu/run.
 */
#include "tests/conformance.h"

#include "drivers/v4l2/controls.h"
#include "drivers/v4l2/v4l2.h"

#define NODE "/dev/video0"

static const struct conformance vivid = {
    .name = "vivid",
    .section = "[camera test]\ndriver = v4l2-camera\ndevice = " NODE "\nwidth = 320\n"
               "height = 180\nfixed_exposure_us = 5000\nformat = YUYV\n",
    .real_clock = TRUE,
    .exposure_us = 5000,
};

static gboolean over;

/* No two pictures are to be the same, which vivid's may be: it writes the time since the stream
 * began into them. So their colours change all the time. */
static gpointer change_colours(gpointer data) {
    struct video_node *node = data;
    for (int i = 0; !g_atomic_int_get(&over); i++) {
        g_autofree char *setting = g_strdup_printf("saturation=%d", i % 256);
        video_control_set_named(node, "test", setting, NULL);
        g_usleep(5000);
    }
    return NULL;
}

int main(int argc, char **argv) {
    struct video_node node;
    GError *error = NULL;
    g_test_init(&argc, &argv, NULL);
    video_node_open(&node, "test", NODE, NULL, &error);
    g_assert_no_error(error);
    GThread *thread = g_thread_new("colours", change_colours, &node);
    conformance_camera(&v4l2_camera_driver, &vivid);
    int failed = g_test_run();
    g_atomic_int_set(&over, TRUE);
    g_thread_join(thread);
    video_node_close(&node);
    return failed;
}
