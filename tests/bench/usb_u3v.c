#include "usb_u3v.h"

#include "aravis/camera.h"
#include "conformance/conformance.h"
#include "lib/camera_open.h"
#include "virtual/cameras/u3v.h"

#include <libusb.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>

#define WIDTH       1024
#define HEIGHT      768
#define EXPOSURE_US 2000
#define TIMEOUT_MS  2000

/* What the driver has left set up: it is only begun, triggered and ended by hand. */
#define STREAM_CONTROL 0x504
#define ACQUISITION    0x1114
#define TRIGGER        0x112c

static void fail(const char *what) {
    fprintf(stderr, "bench_usb: USB3 Vision: %s\n", what);
    exit(1);
}

static void expose(const struct virtual_exposure *exposure, gpointer data, guint16 *pixels) {
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        pixels[i] = (guint16)((guint64)i + exposure->n) & 0xff;
}

static void put(guint8 *to, guint64 value, int n) {
    for (int i = 0; i < n; i++)
        to[i] = (guint8)(value >> 8 * i);
}

static int bulk(libusb_device_handle *handle, guint8 endpoint, guint8 *data, int size) {
    int n = 0;
    if (libusb_bulk_transfer(handle, endpoint, data, size, &n, TIMEOUT_MS))
        fail("a bare transfer failed");
    return n;
}

static void write_register(libusb_device_handle *handle, guint64 address, guint32 value) {
    guint8 command[24] = {0}, answer[64];
    put(command, 0x43563355, 4);
    put(command + 4, 0x4000, 2); /* an answer is wanted */
    put(command + 6, 0x0802, 2);
    put(command + 8, 12, 2);
    put(command + 10, 1, 2);
    put(command + 12, address, 8);
    put(command + 20, value, 4);
    bulk(handle, 0x01, command, sizeof command);
    if (bulk(handle, 0x81, answer, sizeof answer) < 12 || answer[4] || answer[5])
        fail("a register was not written");
}

struct seen {
    int n;
    gint64 came_us;
};

static void on_camera(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                      gpointer data) {
    struct seen *seen = data;
    if (event == CAMERA_EXPOSED)
        return;
    if (error)
        fail(error->message);
    seen->n++;
    seen->came_us = g_get_monotonic_time();
}

static Camera *open_camera(Clock *clock, struct seen *seen) {
    const struct camera_settings settings = {EXPOSURE_US, 0};
    g_autoptr(Config) config = config_parse("[camera c]\ndriver = aravis\ndevice = BENCH\n"
                                            "pixel_format = BayerRG8\n",
                                            "./bench.conf", NULL);
    GError *error = NULL;
    Camera *camera =
        camera_open(&aravis_camera_driver, config_find(config, "camera", "c"), NULL, clock, &error);
    if (!camera)
        fail(error->message);
    camera_listen(camera, on_camera, seen);
    if (!camera_configure(camera, &settings, &error) || !camera_arm(camera, &error))
        fail(error->message);
    return camera;
}

void u3v_measure(Clock *clock, int n, double *ret_raw_us, double *ret_driver_us) {
    struct virtual_camera_options options = {.serial = "BENCH",
                                             .width = WIDTH,
                                             .height = HEIGHT,
                                             .bits = 8,
                                             .cfa = CFA_RGGB,
                                             .picture = expose};
    g_autoptr(VirtualU3v) device = virtual_u3v_new(&options, 3);
    struct seen seen = {0};
    GError *error = NULL;
    Camera *camera = open_camera(clock, &seen);
    for (int i = 0; i < n; i++) {
        gint64 begun = g_get_monotonic_time();
        if (!camera_trigger(camera, (guint64)i + 1, &error))
            fail(error->message);
        conformance_wait(clock, &seen.n, i + 1, 10);
        ret_driver_us[i] = (double)(seen.came_us - begun);
    }
    camera_close(camera);
    libusb_context *context;
    g_autofree guint8 *picture = g_malloc(WIDTH * HEIGHT);
    if (libusb_init(&context))
        fail("no libusb");
    libusb_device_handle *handle = libusb_open_device_with_vid_pid(context, 0x1d50, 0x60ff);
    if (!handle || libusb_claim_interface(handle, 0) || libusb_claim_interface(handle, 1))
        fail("it cannot be opened by hand");
    write_register(handle, STREAM_CONTROL, 1);
    write_register(handle, ACQUISITION, 1);
    for (int i = 0; i < n; i++) {
        guint8 head[64];
        gint64 begun_bare = g_get_monotonic_time();
        write_register(handle, TRIGGER, 1);
        bulk(handle, 0x82, head, sizeof head);
        if (bulk(handle, 0x82, picture, WIDTH * HEIGHT) != WIDTH * HEIGHT)
            fail("half a picture came");
        bulk(handle, 0x82, head, sizeof head);
        ret_raw_us[i] = (double)(g_get_monotonic_time() - begun_bare);
    }
    write_register(handle, ACQUISITION, 0);
    libusb_close(handle);
    libusb_exit(context);
}
