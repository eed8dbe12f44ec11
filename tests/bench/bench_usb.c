/*
 * Latencies of the USB and V4L2 drivers against the protocol's own round trip in the same run, on
 * virtual devices behind umockdev (whose own cost is in both).
 *
 * USB: how soon a Tic's motor turns after axis_move(), and how long a relay takes until it is
 * switched and read back, against a bare control transfer.
 *
 * V4L2: from a trigger to the whole picture, against bare ioctls that wait for the first frame that
 * began after the same moment; then eight cameras of 1024 × 768 at 12 bits at the same time, every
 * picture asked for as soon as the one before is there.
 *
 * USB3 Vision: from a trigger to the whole picture of 1024 × 768, against the same by bare bulk
 * transfers.
 */
#include "bench.h"
#include "conformance/conformance.h"
#include "lib/camera_open.h"
#include "usb/relays.h"
#include "usb/tic.h"
#include "usb/usb.h"
#include "usb_u3v.h"
#include "v4l2/stream.h"
#include "v4l2/v4l2.h"
#include "virtual/cameras/v4l2.h"
#include "virtual/testbed.h"
#include "virtual/usb_relays.h"
#include "virtual/usb_tic.h"

#include <poll.h>
#include <stdio.h>
#include <stdlib.h>

#define N_TRANSFERS 300
#define N_MOVES     30
#define N_PICTURES  60
#define N_CAMERAS   8
#define WIDTH       1024
#define HEIGHT      768
#define EXPOSURE_US 2000

static Config *section_of(const char *text, const struct config_section **ret) {
    GError *error = NULL;
    gsize n;
    Config *config = config_parse(text, "./bench.conf", &error);
    bench_check(error);
    *ret = config_sections(config, &n);
    return config;
}

/* µs; of the bare protocol and of the driver. */
struct latency {
    struct bench_times raw, driver;
};

static void on_axis(Axis *axis, enum axis_event event, const GError *error, gpointer data) {
    bench_check(error);
    ++*(int *)data;
}

static struct latency measure_tic(Clock *clock) {
    struct latency latency = {0};
    double us[N_MOVES];
    const struct config_section *section;
    g_autoptr(VirtualTic) tic = virtual_tic_new("TIC", 1, 0, 0);
    g_autoptr(Config) config = section_of("[axis a]\ndriver = tic-axis\nsteps_per_deg = 100\n"
                                          "homing = here\nspeed_deg_s = 200\naccel_deg_s2 = 9000\n",
                                          &section);
    GError *error = NULL;
    int n = 0;
    static const guint16 products[] = {0x00b5, 0};
    const struct usb_match match = {
        .who = "bench", .vendor = 0x1ffb, .products = products, .interface_class = 0xff};
    const struct usb_request request = {0xc0, 0xa1, 0, 0, NULL, 1};
    double bare_us[N_TRANSFERS];
    guint8 answer[1];
    GError *failure = NULL;
    UsbDevice *usb = usb_open(&match, NULL, NULL, &failure);
    bench_check(failure);
    for (int i = 0; i < N_TRANSFERS; i++) {
        gint64 begun = g_get_monotonic_time();
        usb_control_sync(usb, &request, answer, &failure);
        bench_check(failure);
        bare_us[i] = (double)(g_get_monotonic_time() - begun);
    }
    usb_close(usb);
    latency.raw = bench_times(bare_us, N_TRANSFERS);
    g_autoptr(Axis) axis = axis_open(&tic_axis_driver, section, NULL, clock, &error);
    bench_check(error);
    axis_listen(axis, on_axis, &n);
    axis_home(axis, NULL);
    conformance_wait(clock, &n, 1, 10);
    for (int i = 0; i < N_MOVES; i++) {
        gint64 start = g_get_monotonic_time();
        axis_move(axis, i % 2 ? 0 : 5, &error);
        bench_check(error);
        while (virtual_tic_speed(tic) == 0)
            g_main_context_iteration(NULL, FALSE);
        us[i] = (double)(g_get_monotonic_time() - start);
        conformance_wait(clock, &n, i + 2, 10);
    }
    latency.driver = bench_times(us, N_MOVES);
    return latency;
}

static void on_lamp(LampBank *bank, int index, gboolean on, gint64 at_us, const GError *error,
                    gpointer data) {
    bench_check(error);
    ++*(int *)data;
}

static struct latency measure_relay(Clock *clock, const struct latency *tic) {
    struct latency latency = {.raw = tic->raw};
    double us[N_TRANSFERS];
    const struct config_section *section;
    g_autoptr(VirtualRelays) board = virtual_relays_new("USBRelay2", "LAMPS", 2, FALSE);
    g_autoptr(Config) config = section_of("[lamps l]\ndriver = usb-relays\n", &section);
    GError *error = NULL;
    int n = 0;
    g_autoptr(LampBank) bank = lamps_open(&usb_relays_driver, section, NULL, clock, &error);
    bench_check(error);
    lamps_listen(bank, on_lamp, &n);
    for (int i = 0; i < N_TRANSFERS; i++) {
        gint64 start = g_get_monotonic_time();
        lamps_set(bank, 0, i % 2 == 0, &error);
        bench_check(error);
        conformance_wait(clock, &n, i + 1, 10);
        us[i] = (double)(g_get_monotonic_time() - start);
    }
    latency.driver = bench_times(us, N_TRANSFERS);
    return latency;
}

/* Cheap, and never the same. */
static void expose(gpointer user, gint64 start_us, gint64 exposure_us, double gain_db,
                   guint64 number, guint16 *ret_pixels) {
    for (int i = 0; i < WIDTH * HEIGHT; i++)
        ret_pixels[i] = (guint16)((guint64)i + number) & 0xfff;
}

static VirtualV4l2 *plug_in(int number, double frame_rate) {
    g_autofree char *port = g_strdup_printf("2-1.%d", number + 1);
    return virtual_v4l2_new(&(struct virtual_v4l2_config){.number = number,
                                                          .port = port,
                                                          .speed_mbit_s = 5000,
                                                          .width = WIDTH,
                                                          .height = HEIGHT,
                                                          .cfa = CFA_RGGB,
                                                          .frame_rate = frame_rate,
                                                          .expose = expose});
}

struct eye {
    Camera *camera;
    gint64 triggered_us, took_us;
    guint64 shot;
    int n_frames, n_lost;
};

static void on_camera(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                      gpointer data) {
    struct eye *eye = data;
    if (event == CAMERA_EXPOSED)
        return;
    eye->took_us = g_get_monotonic_time() - eye->triggered_us;
    eye->n_frames += event == CAMERA_FRAME;
    eye->n_lost += event != CAMERA_FRAME;
    if (error)
        fprintf(stderr, "bench_usb: %s\n", error->message);
}

static void open_eye(struct eye *eye, Clock *clock, int number) {
    const struct config_section *section;
    g_autofree char *text = g_strdup_printf("[camera c%d]\ndriver = v4l2-camera\n"
                                            "device = /dev/video%d\n",
                                            number, number);
    g_autoptr(Config) config = section_of(text, &section);
    const struct camera_settings settings = {EXPOSURE_US, 0};
    GError *error = NULL;
    *eye = (struct eye){.camera = camera_open(&v4l2_camera_driver, section, NULL, clock, &error)};
    bench_check(error);
    camera_listen(eye->camera, on_camera, eye);
    camera_configure(eye->camera, &settings, &error);
    bench_check(error);
    camera_arm(eye->camera, &error);
    bench_check(error);
}

static void trigger(struct eye *eye) {
    GError *error = NULL;
    eye->triggered_us = g_get_monotonic_time();
    camera_trigger(eye->camera, ++eye->shot, &error);
    bench_check(error);
}

/* Bare ioctls: buffers are emptied, then the first one that began later is waited for. */
static double wait_raw(const struct video_node *node, const struct video_stream *stream) {
    struct v4l2_buffer buffer;
    gint64 from = g_get_monotonic_time();
    for (;;) {
        while (video_stream_take(stream, node, &buffer) > 0) {
            gint64 stamp =
                (gint64)buffer.timestamp.tv_sec * G_USEC_PER_SEC + buffer.timestamp.tv_usec;
            video_stream_give_back(node, &buffer);
            if (stamp >= from)
                return (double)(g_get_monotonic_time() - from);
        }
        g_usleep(500); /* the mocked node is always ready for poll() */
    }
}

static void time_raw(struct latency *ret) {
    const struct video_request wish = {.format = "RG12"};
    struct video_node node;
    struct video_setup setup;
    struct video_stream stream;
    double us[N_PICTURES];
    GError *error = NULL;
    video_node_open(&node, "bench", "/dev/video0", NULL, &error);
    bench_check(error);
    video_setup_apply(&node, &wish, &setup, &error);
    bench_check(error);
    video_stream_start(&stream, &node, &setup, &error);
    bench_check(error);
    for (int i = 0; i < N_PICTURES; i++) {
        g_usleep((gulong)(i * 7 % 33) * 1000);
        us[i] = wait_raw(&node, &stream);
    }
    video_stream_stop(&stream, &node);
    video_node_close(&node);
    ret->raw = bench_times(us, N_PICTURES);
}

static struct latency measure_camera(Clock *clock, double frame_rate) {
    struct latency latency = {0};
    double us[N_PICTURES];
    struct eye eye;
    g_autoptr(VirtualV4l2) device = plug_in(0, frame_rate);
    open_eye(&eye, clock, 0);
    for (int i = 0; i < N_PICTURES; i++) {
        conformance_pass(clock, i * 7 % 33 * 1e-3);
        int before = eye.n_frames + eye.n_lost;
        trigger(&eye);
        while (eye.n_frames + eye.n_lost == before)
            g_main_context_iteration(NULL, TRUE);
        us[i] = (double)eye.took_us;
    }
    camera_close(eye.camera);
    time_raw(&latency); /* with the exposure that the driver has set */
    latency.driver = bench_times(us, N_PICTURES);
    return latency;
}

struct eight {
    double seconds, cpu_s;
    int n_frames, n_lost;
};

static struct eight measure_eight(Clock *clock, double frame_rate, double seconds) {
    VirtualV4l2 *devices[N_CAMERAS];
    struct eye eyes[N_CAMERAS];
    struct eight eight = {0};
    for (int i = 0; i < N_CAMERAS; i++)
        devices[i] = plug_in(i, frame_rate);
    for (int i = 0; i < N_CAMERAS; i++)
        open_eye(&eyes[i], clock, i);
    gint64 start = g_get_monotonic_time(), end = start + (gint64)(seconds * 1e6);
    double cpu = bench_cpu_s();
    while (g_get_monotonic_time() < end) {
        for (int i = 0; i < N_CAMERAS; i++)
            if (!camera_is_waiting(eyes[i].camera) && camera_is_armed(eyes[i].camera))
                trigger(&eyes[i]);
        g_main_context_iteration(NULL, TRUE);
    }
    eight.seconds = (double)(g_get_monotonic_time() - start) * 1e-6;
    eight.cpu_s = bench_cpu_s() - cpu;
    for (int i = 0; i < N_CAMERAS; i++) {
        eight.n_frames += eyes[i].n_frames;
        eight.n_lost += eyes[i].n_lost;
        camera_close(eyes[i].camera);
    }
    for (int i = 0; i < N_CAMERAS; i++)
        virtual_v4l2_free(devices[i]);
    return eight;
}

static void print_latency(const char *name, const struct latency *l) {
    bench_row(name, "%.0f{raw_us} %.0f{raw_p99_us} %.0f{driver_us} %.0f{driver_p99_us} %.3f{ratio}",
              l->raw.median, l->raw.p99, l->driver.median, l->driver.p99,
              l->driver.median / l->raw.median);
}

static void print_eight(const char *name, const struct eight *e) {
    bench_row(name, "%.1f{seconds} %d{frames} %d{lost} %.2f{frames_s_camera} %.3f{cpu}", e->seconds,
              e->n_frames, e->n_lost, e->n_frames / e->seconds / N_CAMERAS, e->cpu_s / e->seconds);
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    static double seconds = 5;
    static const GOptionEntry entries[] = {{"seconds", 0, 0, G_OPTION_ARG_DOUBLE, &seconds,
                                            "How long eight cameras run at each rate", "S"},
                                           {NULL}};
    bench_parse(&argc, &argv, entries, "- latencies of USB, V4L2 and USB3 Vision drivers");
    testbed_ref(); /* one for all: Aravis looks at the same USB as long as the process lives */
    g_autoptr(Clock) clock = clock_new_real();
    struct latency tic = measure_tic(clock), relay = measure_relay(clock, &tic);
    struct latency camera = measure_camera(clock, 30);
    double raw[N_PICTURES], driver[N_PICTURES];
    u3v_measure(clock, N_PICTURES, raw, driver);
    struct latency u3v = {bench_times(raw, N_PICTURES), bench_times(driver, N_PICTURES)};
    struct eight slow = measure_eight(clock, 15, seconds), fast = measure_eight(clock, 30, seconds);
    bench_begin(NULL);
    print_latency("tic_move", &tic);
    print_latency("relay_switch", &relay);
    print_latency("v4l2_trigger_to_frame", &camera);
    print_latency("u3v_trigger_to_frame", &u3v);
    print_eight("v4l2_eight_15_hz", &slow);
    print_eight("v4l2_eight_30_hz", &fast);
    bench_end();
    testbed_unref();
    return slow.n_lost || fast.n_lost;
}
