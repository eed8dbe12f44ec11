/*
 * What every driver must do, asked of the V4L2 driver with the kernel's own virtual camera, vivid,
 * once by each of the kernel's two interfaces, single- and multi-planar. Run by tests/qemu/run.
 */
#include "conformance/conformance.h"

#include "v4l2/controls.h"
#include "v4l2/v4l2.h"

#define SECTION(node)                                                                              \
    "[camera test]\ndriver = v4l2-camera\ndevice = " node "\nwidth = 320\nheight = 180\n"          \
    "fixed_exposure_us = 5000\nformat = YUYV\n"

static const struct conformance vivids[] = {
    {.name = "vivid", .section = SECTION("/dev/video0"), .real_clock = TRUE, .exposure_us = 5000},
    {.name = "vivid-multi-planar",
     .section = SECTION("/dev/video1"),
     .real_clock = TRUE,
     .exposure_us = 5000}};

static gboolean over;

/* No two pictures are to be the same, which vivid's may be: it writes the time since the stream
 * began into them. So their colours change all the time. */
static gpointer change_colours(gpointer data) {
    struct video_node *nodes = data;
    for (int i = 0; !g_atomic_int_get(&over); i++) {
        g_autofree char *setting = g_strdup_printf("saturation=%d", i / 2 % 256);
        video_control_set_named(&nodes[i % 2], setting, NULL);
        g_usleep(2500);
    }
    return NULL;
}

int main(int argc, char **argv) {
    struct video_node nodes[2];
    GError *error = NULL;
    g_test_init(&argc, &argv, NULL);
    video_node_open(&nodes[0], "test", "/dev/video0", NULL, &error);
    g_assert_no_error(error);
    video_node_open(&nodes[1], "test", "/dev/video1", NULL, &error);
    g_assert_no_error(error);
    g_assert_cmpuint(nodes[0].type, ==, V4L2_BUF_TYPE_VIDEO_CAPTURE);
    g_assert_cmpuint(nodes[1].type, ==, V4L2_BUF_TYPE_VIDEO_CAPTURE_MPLANE);
    GThread *thread = g_thread_new("colours", change_colours, nodes);
    for (int i = 0; i < 2; i++)
        conformance_camera(&v4l2_camera_driver, &vivids[i]);
    int failed = g_test_run();
    g_atomic_int_set(&over, TRUE);
    g_thread_join(thread);
    for (int i = 0; i < 2; i++)
        video_node_close(&nodes[i]);
    return failed;
}
