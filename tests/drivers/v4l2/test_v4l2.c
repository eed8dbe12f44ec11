#include "conformance/conformance.h"

#include "lib/camera_open.h"
#include "lib/lock_keeper.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "v4l2/formats.h"
#include "v4l2/load.h"
#include "v4l2/v4l2.h"
#include "virtual/cameras/v4l2.h"
#include "virtual/testbed.h"

#include <fcntl.h>
#include <linux/videodev2.h>
#include <string.h>
#include <sys/ioctl.h>
#include <unistd.h>

/* Faults of the V4L2 driver against virtual cameras, in real time. */
struct rig {
    Clock *clock;
    VirtualV4l2 *device;
    Camera *camera;
    int n;
    enum camera_event last;
    Frame *frame;
    GError *error;
};

static const struct conformance with = {.section = "[camera test]\ndriver = v4l2-camera\n"};

static void on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                     gpointer data) {
    struct rig *rig = data;
    rig->n++;
    rig->last = event;
    g_clear_error(&rig->error);
    g_clear_pointer(&rig->frame, frame_unref);
    if (error)
        rig->error = g_error_copy(error);
    if (frame)
        rig->frame = frame_ref(frame);
}

static Camera *open_camera(Clock *clock, const char *more, GError **error) {
    const struct config_section *section;
    g_autoptr(Config) config = conformance_config(&with, more, &section);
    return camera_open(&v4l2_camera_driver, section, NULL, clock, error);
}

static gboolean configure(struct rig *rig, gint64 exposure_us, double gain_db, GError **error) {
    struct camera_settings settings = {exposure_us, gain_db};
    return camera_configure(rig->camera, &settings, error);
}

static void begin(struct rig *rig, const struct virtual_v4l2_config *config, const char *more) {
    *rig = (struct rig){.clock = clock_new_real(), .device = virtual_v4l2_new(config)};
    rig->camera = ok(open_camera(rig->clock, more, ERR));
    camera_listen(rig->camera, on_event, rig);
    ok(configure(rig, 2000, 0, ERR));
    ok(camera_arm(rig->camera, ERR));
}

static void begin_plain(struct rig *rig, gconstpointer more) {
    begin(rig, &(struct virtual_v4l2_config){0}, more);
}

static void end(struct rig *rig, gconstpointer unused) {
    g_clear_pointer(&rig->camera, camera_close);
    g_clear_pointer(&rig->device, virtual_v4l2_free);
    g_clear_pointer(&rig->clock, clock_unref);
    g_clear_pointer(&rig->frame, frame_unref);
    g_clear_error(&rig->error);
}

static void trigger(struct rig *rig, guint64 shot) {
    rig->n = 0;
    ok(camera_trigger(rig->camera, shot, ERR));
}

static void shoot(struct rig *rig, guint64 shot, enum camera_event event) {
    trigger(rig, shot);
    conformance_wait(rig->clock, &rig->n, 1, 10);
    if (event == CAMERA_FRAME)
        g_assert_no_error(rig->error);
    g_assert_cmpint(rig->last, ==, event);
    g_assert_false(camera_is_waiting(rig->camera));
    g_assert_cmpint(camera_is_armed(rig->camera), ==, event != CAMERA_FAULT);
}

static void expect_text(GError **error, int code, const char *text) {
    g_assert_nonnull(*error);
    g_assert_true(g_str_has_prefix((*error)->message, "camera test: "));
    conformance_expect_error(error, DEVICE_ERROR, code, text);
}

/* A camera with this fault ends a trigger so, and is well again after it. */
struct fault {
    const char *name;
    enum virtual_v4l2_fault fault;
    enum camera_event event;
    int code;
    const char *text;
};

static const struct fault faults[] = {
    {"error-flag", VIRTUAL_V4L2_ERROR_FLAG, CAMERA_REFUSED, DEVICE_ERROR_PROTOCOL,
     "lost on the way"},
    {"short", VIRTUAL_V4L2_SHORT, CAMERA_REFUSED, DEVICE_ERROR_PROTOCOL, "lost on the way"},
    {"future", VIRTUAL_V4L2_FUTURE, CAMERA_REFUSED, DEVICE_ERROR_PROTOCOL, "in the future"},
    {"silent", VIRTUAL_V4L2_SILENT, CAMERA_FAULT, DEVICE_ERROR_TIMEOUT, "no frame"},
    {"other-clock", VIRTUAL_V4L2_OTHER_CLOCK, CAMERA_FAULT, DEVICE_ERROR_UNSUPPORTED,
     "monotonic clock"},
    {"breaks", VIRTUAL_V4L2_STREAM_BREAKS, CAMERA_FAULT, DEVICE_ERROR_PROTOCOL,
     "stopped streaming"},
};

static void test_fault(gconstpointer data) {
    const struct fault *with_fault = data;
    struct rig rig;
    begin(&rig, &(struct virtual_v4l2_config){0}, "");
    shoot(&rig, 1, CAMERA_FRAME);
    virtual_v4l2_set_fault(rig.device, with_fault->fault);
    conformance_pass(rig.clock, 0.03); /* frames under way are still well */
    shoot(&rig, 2, with_fault->event);
    expect_text(&rig.error, with_fault->code, with_fault->text);
    conformance_pass(rig.clock, 0.05);
    g_assert_cmpint(rig.n, ==, 1); /* one cause, one event */
    virtual_v4l2_set_fault(rig.device, VIRTUAL_V4L2_WELL);
    conformance_pass(rig.clock, 0.03);
    ok(camera_arm(rig.camera, ERR));
    shoot(&rig, 2, CAMERA_FRAME);
    end(&rig, NULL);
}

/* The picture that it has frozen in may have been shown to nobody; the next one has. */
static void test_frozen(struct rig *rig, gconstpointer unused) {
    shoot(rig, 1, CAMERA_FRAME);
    virtual_v4l2_set_fault(rig->device, VIRTUAL_V4L2_FROZEN);
    conformance_pass(rig->clock, 0.05);
    trigger(rig, 2);
    conformance_wait(rig->clock, &rig->n, 1, 10);
    shoot(rig, 3, CAMERA_REFUSED);
    expect_text(&rig->error, DEVICE_ERROR_STALE, "bit for bit");
    virtual_v4l2_set_fault(rig->device, VIRTUAL_V4L2_WELL);
    conformance_pass(rig->clock, 0.05);
    shoot(rig, 3, CAMERA_FRAME);
}

/* Unplugged while a frame is waited for, then back at another number: found by where it is. */
TEST(fault__unplugged) {
    struct rig rig;
    GError *error = NULL;
    begin(&rig, &(struct virtual_v4l2_config){.port = "2-1.4", .frame_rate = 10},
          "bus = usb-virtual-2-1.4\nwhite_balance_k = 5200\ngain_per_db = 10\n");
    ok(configure(&rig, 30000, 3, ERR));
    trigger(&rig, 1);
    conformance_pass(rig.clock, 0.02);
    g_assert_cmpint(rig.n, ==, 0);
    virtual_v4l2_unplug(rig.device);
    conformance_wait(rig.clock, &rig.n, 1, 10);
    g_assert_cmpint(rig.last, ==, CAMERA_FAULT);
    expect_text(&rig.error, DEVICE_ERROR_DISCONNECTED, "check its cable");
    g_assert_false(camera_is_armed(rig.camera));
    g_assert_false(camera_arm(rig.camera, &error));
    expect_text(&error, DEVICE_ERROR_DISCONNECTED, "usb-virtual-2-1.4");

    virtual_v4l2_plug(rig.device, 3);
    ok(camera_arm(rig.camera, ERR));
    shoot(&rig, 1, CAMERA_FRAME);
    g_assert_cmpint(rig.frame->exposure_us, ==, 30000);
    g_assert_cmpint(virtual_v4l2_control(rig.device, V4L2_CID_EXPOSURE_ABSOLUTE), ==, 300);
    g_assert_cmpint(virtual_v4l2_control(rig.device, V4L2_CID_WHITE_BALANCE_TEMPERATURE), ==, 5200);
    end(&rig, NULL);
}

/* Another daemon has it, named by its node; the kernel would let both set it up. */
TEST(locked) {
    g_autoptr(Clock) clock = clock_new_real();
    VirtualV4l2 *device = virtual_v4l2_new(&(struct virtual_v4l2_config){0});
    g_autofree char *key = lock_key_of_node("video", "/dev/video0");
    GSubprocess *keeper = lock_keeper_start(key);
    GError *error = NULL;
    g_assert_null(open_camera(clock, "", &error));
    lock_keeper_expect(keeper, &error);
    lock_keeper_end(keeper);
    Camera *camera = ok(open_camera(clock, "", ERR));
    camera_close(camera);
    virtual_v4l2_free(device);
}

/* A program ends while its stream runs. As in the kernel, the stream ends with the program. */
TEST(program_ends) {
    g_autoptr(Clock) clock = clock_new_real();
    g_autoptr(VirtualV4l2) device = virtual_v4l2_new(&(struct virtual_v4l2_config){0});
    int type = V4L2_BUF_TYPE_VIDEO_CAPTURE;
    struct v4l2_requestbuffers request = {
        .count = 2, .type = (guint32)type, .memory = V4L2_MEMORY_MMAP};
    struct v4l2_format format = {.type = (guint32)type};
    const int fd = open("/dev/video0", O_RDWR | O_CLOEXEC);
    g_assert_cmpint(fd, >=, 0);
    format.fmt.pix.pixelformat = V4L2_PIX_FMT_YUYV;
    g_assert_cmpint(ioctl(fd, VIDIOC_S_FMT, &format), ==, 0);
    g_assert_cmpint(ioctl(fd, VIDIOC_REQBUFS, &request), ==, 0);
    g_assert_cmpint(ioctl(fd, VIDIOC_STREAMON, &type), ==, 0);
    close(fd);
    conformance_pass(clock, 0.05);
    Camera *camera = ok(open_camera(clock, "", ERR));
    const struct camera_settings settings = {2000, 0};
    ok(camera_configure(camera, &settings, ERR));
    ok(camera_arm(camera, ERR));
    camera_close(camera);
}

/* No frame is expected: the fault is reported at the next trigger, which fails. */
static void test_unplugged_idle(struct rig *rig, gconstpointer unused) {
    g_assert_nonnull(strstr(rig->camera->device.identity, ", at "));
    virtual_v4l2_unplug(rig->device);
    conformance_pass(rig->clock, 0.05);
    g_assert_cmpint(rig->n, ==, 0);
    shoot(rig, 1, CAMERA_FAULT);
    expect_text(&rig->error, DEVICE_ERROR_DISCONNECTED, "check its cable");
    virtual_v4l2_plug(rig->device, 0);
    g_assert_true(camera_arm(rig->camera, NULL));
    shoot(rig, 1, CAMERA_FRAME);
}

/* Another one is plugged in instead. */
static void test_exchanged(struct rig *rig, gconstpointer unused) {
    GError *error = NULL;
    virtual_v4l2_unplug(rig->device);
    shoot(rig, 1, CAMERA_FAULT);
    virtual_v4l2_free(rig->device);
    rig->device = virtual_v4l2_new(&(struct virtual_v4l2_config){.width = 32});
    g_assert_false(camera_arm(rig->camera, &error));
    expect_text(&error, DEVICE_ERROR_UNSUPPORTED, "another format, size or frame rate");
    virtual_v4l2_free(rig->device);
    rig->device = virtual_v4l2_new(&(struct virtual_v4l2_config){0});
    g_assert_true(camera_arm(rig->camera, NULL));
    shoot(rig, 1, CAMERA_FRAME);
}

static void test_no_bandwidth(struct rig *rig, gconstpointer unused) {
    GError *error = NULL;
    camera_disarm(rig->camera);
    virtual_v4l2_set_fault(rig->device, VIRTUAL_V4L2_NO_BANDWIDTH);
    g_assert_false(camera_arm(rig->camera, &error));
    expect_text(&error, DEVICE_ERROR_UNSUPPORTED, "no bandwidth left");
    virtual_v4l2_set_fault(rig->device, VIRTUAL_V4L2_WELL);
    g_assert_true(camera_arm(rig->camera, NULL));
    shoot(rig, 1, CAMERA_FRAME);
}

static void test_disobeys(struct rig *rig, gconstpointer unused) {
    GError *error = NULL;
    virtual_v4l2_set_fault(rig->device, VIRTUAL_V4L2_DISOBEYS);
    g_assert_false(configure(rig, 4000, 0, &error));
    expect_text(&error, DEVICE_ERROR_PROTOCOL, "Exposure Time, Absolute was set to 40, but is 1");
    virtual_v4l2_set_fault(rig->device, VIRTUAL_V4L2_WELL);
    g_assert_true(configure(rig, 4000, 0, NULL));
    shoot(rig, 1, CAMERA_FRAME);
}

/* What the sensor saw: whether the lamp shone during all of the exposure, and the exposure. */
struct lamp {
    GMutex mutex;
    gint64 on_us; /* G_MAXINT64: off */
};

static void expose_lamp(gpointer user, gint64 start_us, gint64 exposure_us, double gain_db,
                        guint64 number, guint16 *ret_pixels) {
    struct lamp *lamp = user;
    g_mutex_lock(&lamp->mutex);
    gboolean lit = lamp->on_us <= start_us;
    g_mutex_unlock(&lamp->mutex);
    memset(ret_pixels, 0, 64 * 48 * sizeof *ret_pixels);
    ret_pixels[0] = lit;
    ret_pixels[1] = (guint16)(exposure_us / 100);
    ret_pixels[2] = (guint16)(gain_db * 10);
    ret_pixels[3] = number & 0xfff;
}

static void set_lamp(struct lamp *lamp, gboolean on) {
    g_mutex_lock(&lamp->mutex);
    lamp->on_us = on ? g_get_monotonic_time() : G_MAXINT64;
    g_mutex_unlock(&lamp->mutex);
}

/* Every picture after a lamp was switched on is wholly lit by it, at whatever moment of the
 * camera's frame that was, and has the exposure that was asked for. */
static void test_trigger(gconstpointer stamp) {
    struct lamp lamp = {.on_us = G_MAXINT64};
    struct rig rig;
    g_mutex_init(&lamp.mutex);
    begin(&rig,
          &(struct virtual_v4l2_config){.stamp = (enum virtual_v4l2_stamp)GPOINTER_TO_INT(stamp),
                                        .frame_rate = 50,
                                        .expose = expose_lamp,
                                        .user = &lamp},
          "format = Y12\ngain_per_db = 10\n");
    for (guint64 shot = 0; shot < 24; shot++) {
        gint64 exposure_us = shot % 4 < 2 ? 2000 : 15000;
        double gain_db = shot % 4 == 3 ? 6 : 0;
        set_lamp(&lamp, FALSE);
        ok(configure(&rig, exposure_us, gain_db, ERR));
        conformance_pass(rig.clock, (double)(shot * 7 % 24) * 1e-3);
        set_lamp(&lamp, TRUE);
        shoot(&rig, shot, CAMERA_FRAME);
        g_assert_cmpint(rig.frame->pixels[0], ==, 1);
        g_assert_cmpint(rig.frame->pixels[1], ==, exposure_us / 100);
        g_assert_cmpint(rig.frame->pixels[2], ==, gain_db * 10);
    }
    end(&rig, NULL);
    g_mutex_clear(&lamp.mutex);
}

/* What the checks above are for: stamps that are taken for the start of exposures, but are not,
 * bring pictures from before the lamp, and settings that are not waited for older ones. */
TEST(trigger__matters) {
    struct lamp lamp = {.on_us = G_MAXINT64};
    struct rig rig;
    int n_dark = 0, n_older = 0;
    g_mutex_init(&lamp.mutex);
    begin(&rig,
          &(struct virtual_v4l2_config){.stamp = VIRTUAL_V4L2_FIRST_DATA,
                                        .frame_rate = 50,
                                        .expose = expose_lamp,
                                        .user = &lamp},
          "format = Y12\nstamp = start\nsettle_frames = 0\n");
    for (guint64 shot = 0; shot < 200 && (n_dark == 0 || n_older == 0); shot++) {
        set_lamp(&lamp, FALSE);
        conformance_pass(rig.clock, (double)(shot * 7 % 20) * 1e-3);
        g_assert_true(configure(&rig, shot & 1 ? 2000 : 4000, 0, NULL));
        set_lamp(&lamp, TRUE);
        trigger(&rig, shot);
        conformance_wait(rig.clock, &rig.n, 1, 10);
        if (rig.last != CAMERA_FRAME)
            continue;
        n_dark += rig.frame->pixels[0] == 0;
        n_older += rig.frame->pixels[1] != (shot & 1 ? 20 : 40);
    }
    g_assert_cmpint(n_dark, >, 0);
    g_assert_cmpint(n_older, >, 0);
    end(&rig, NULL);
    g_mutex_clear(&lamp.mutex);
}

/* Buffers that were filled before the trigger and say that they are from after it, looked at so
 * late that they no longer lie in the future. */
TEST(trigger__stale_from_future) {
    struct lamp lamp = {.on_us = G_MAXINT64};
    struct rig rig;
    g_mutex_init(&lamp.mutex);
    begin(&rig,
          &(struct virtual_v4l2_config){.frame_rate = 50, .expose = expose_lamp, .user = &lamp},
          "format = Y12\n");
    virtual_v4l2_set_fault(rig.device, VIRTUAL_V4L2_FUTURE);
    conformance_pass(rig.clock, 0.15);
    virtual_v4l2_set_fault(rig.device, VIRTUAL_V4L2_WELL);
    conformance_pass(rig.clock, 0.03);
    set_lamp(&lamp, TRUE);
    trigger(&rig, 1);
    g_usleep(150000);
    conformance_wait(rig.clock, &rig.n, 1, 10);
    g_assert_cmpint(rig.last, ==, CAMERA_FRAME);
    g_assert_cmpint(rig.frame->pixels[0], ==, 1);
    end(&rig, NULL);
    g_mutex_clear(&lamp.mutex);
}

/* While nobody waits the buffers stay full: a camera that runs freely costs nothing. */
TEST(idle) {
    struct rig rig;
    begin(&rig, &(struct virtual_v4l2_config){.frame_rate = 200}, "");
    shoot(&rig, 1, CAMERA_FRAME);
    conformance_pass(rig.clock, 0.2);
    int n = virtual_v4l2_n_exposed(rig.device);
    conformance_pass(rig.clock, 0.2);
    g_assert_cmpint(virtual_v4l2_n_exposed(rig.device), ==, n);
    shoot(&rig, 2, CAMERA_FRAME);
    g_assert_cmpint(virtual_v4l2_n_exposed(rig.device), >, n);
    end(&rig, NULL);
}

#define SIDE 62 /* no multiple of what any format packs together */

static guint16 known_pixel(int x, int y, int bits) {
    guint32 value = ((guint32)x * 2654435761u) ^ ((guint32)y * 40503u * 65536u);
    return (guint16)(value >> 8 & ((1u << bits) - 1));
}

static void expose_known(gpointer user, gint64 start_us, gint64 exposure_us, double gain_db,
                         guint64 number, guint16 *ret_pixels) {
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
            ret_pixels[y * SIDE + x] = known_pixel(x, y, *(int *)user);
}

static void check_format(const char *format, enum cfa cfa, int sensor_bits, int bits) {
    struct rig rig;
    g_autofree char *more = g_strdup_printf("format = %s\nwidth = 62\nheight = 62\n", format);
    begin(&rig,
          &(struct virtual_v4l2_config){.width = SIDE,
                                        .height = SIDE,
                                        .cfa = cfa,
                                        .bits = sensor_bits,
                                        .expose = expose_known,
                                        .user = &sensor_bits},
          more);
    shoot(&rig, 1, CAMERA_FRAME);
    g_assert_cmpint(rig.frame->cfa, ==, cfa);
    g_assert_cmpint(rig.frame->bits, ==, bits);
    g_assert_cmpfloat(rig.frame->black_level, ==, 0);
    for (int y = 0; y < SIDE; y++)
        for (int x = 0; x < SIDE; x++)
            g_assert_cmpint(rig.frame->pixels[y * SIDE + x], ==,
                            known_pixel(x, y, sensor_bits) >> (sensor_bits - bits));
    end(&rig, NULL);
}

TEST(formats) {
    check_format("RGGB", CFA_RGGB, 12, 8);
    check_format("BA81", CFA_BGGR, 12, 8);
    check_format("GB10", CFA_GBRG, 12, 10);
    check_format("pgAA", CFA_GRBG, 12, 10);
    check_format("RG12", CFA_RGGB, 12, 12);
    check_format("pBCC", CFA_BGGR, 12, 12);
    check_format("RG16", CFA_RGGB, 16, 16);
    check_format("GREY", CFA_MONO, 8, 8);
    check_format("Y10P", CFA_MONO, 10, 10);
    check_format("Y16", CFA_MONO, 16, 16);
}

/* Luma of limited range: 16 to 235, and black is 16. */
TEST(luma) {
    int bits = 8;
    struct rig rig;
    for (int i = 0; i < 2; i++) {
        begin(
            &rig,
            &(struct virtual_v4l2_config){
                .width = SIDE, .height = SIDE, .bits = bits, .expose = expose_known, .user = &bits},
            i ? "format = UYVY\n" : "format = YUYV\n");
        shoot(&rig, 1, CAMERA_FRAME);
        g_assert_cmpint(rig.frame->cfa, ==, CFA_MONO);
        g_assert_cmpfloat(rig.frame->black_level, ==, 16);
        for (int y = 0; y < SIDE; y++)
            for (int x = 0; x < SIDE; x++)
                g_assert_cmpfloat_with_epsilon(rig.frame->pixels[y * SIDE + x],
                                               16 + known_pixel(x, y, bits) * 219.0 / 255, 0.51);
        end(&rig, NULL);
    }
}

/* Bytes as in the examples of the kernel's documentation of these formats. */
static void check_unpack(const char *name, const guint8 *bytes, int width,
                         const guint16 *expected) {
    guint32 fourcc;
    guint16 pixels[8];
    g_assert_true(video_fourcc_parse(name, &fourcc));
    const struct video_format *format = video_format_find(fourcc);
    g_assert_nonnull(format);
    video_format_unpack(format, bytes, 0, width, 1, pixels);
    for (int x = 0; x < width; x++)
        g_assert_cmphex(pixels[x], ==, expected[x]);
    g_autofree char *again = video_fourcc_name(fourcc);
    g_assert_cmpstr(again, ==, name);
}

TEST(unpack) {
    check_unpack("pRAA", (guint8[]){0x00, 0xff, 0x12, 0x80, 0xe4, 0x01, 0, 0, 0, 0x03}, 5,
                 (guint16[]){0x000, 0x3fd, 0x04a, 0x203, 0x007});
    check_unpack("pRCC", (guint8[]){0xab, 0x12, 0x3c, 0xff, 0x00, 0x0f}, 3,
                 (guint16[]){0xabc, 0x123, 0xfff});
    check_unpack("RG10", (guint8[]){0xff, 0x03, 0x34, 0x02, 0x00, 0x04}, 3,
                 (guint16[]){0x3ff, 0x234, 0x3ff}); /* the last has more bits than it may */
    check_unpack("YUYV", (guint8[]){1, 128, 2, 129, 3, 0, 4, 0}, 4, (guint16[]){1, 2, 3, 4});
    check_unpack("UYVY", (guint8[]){128, 1, 129, 2}, 2, (guint16[]){1, 2});
    g_assert_null(video_format_find(V4L2_PIX_FMT_MJPEG));
    g_assert_null(video_format_find(V4L2_PIX_FMT_H264));
    g_assert_null(video_format_find(0));
}

static void expect_not_opened(const char *more, int code, const char *text) {
    g_autoptr(Clock) clock = clock_new_real();
    GError *error = NULL;
    g_assert_null(open_camera(clock, more, &error));
    expect_text(&error, code, text);
}

TEST(compressed) {
    g_autoptr(VirtualV4l2) webcam =
        virtual_v4l2_new(&(struct virtual_v4l2_config){.only_compressed = TRUE});
    expect_not_opened("", DEVICE_ERROR_UNSUPPORTED, "offers only MJPG");
    g_clear_pointer(&webcam, virtual_v4l2_free);
    webcam = virtual_v4l2_new(&(struct virtual_v4l2_config){0});
    expect_not_opened("format = MJPG\n", DEVICE_ERROR_UNSUPPORTED, "offers format MJPG, but only");
    expect_not_opened("format = RG16\n", DEVICE_ERROR_UNSUPPORTED, "format RG16");
    expect_not_opened("format = nonsense\n", DEVICE_ERROR_UNSUPPORTED, "format nonsense");
}

TEST(not_opened) {
    expect_not_opened("", DEVICE_ERROR_DISCONNECTED, "no such camera");
    expect_not_opened("device = /dev/video0\n", DEVICE_ERROR_DISCONNECTED, "could not be opened");
    g_autoptr(VirtualV4l2) one = virtual_v4l2_new(&(struct virtual_v4l2_config){.number = 0});
    g_autoptr(VirtualV4l2) two =
        virtual_v4l2_new(&(struct virtual_v4l2_config){.number = 1, .port = "2-2"});
    expect_not_opened("", DEVICE_ERROR_RANGE, "more than one");
    expect_not_opened("bus = usb-virtual-2-3\n", DEVICE_ERROR_DISCONNECTED, "usb-virtual-2-2");
    expect_not_opened("device = /dev/null\n", DEVICE_ERROR_UNSUPPORTED, "not a camera");
    expect_not_opened("device = /dev/video0\nwidth = 640\n", DEVICE_ERROR_UNSUPPORTED, "64 × 48");
    expect_not_opened("device = /dev/video0\nframe_rate = 5000\n", DEVICE_ERROR_UNSUPPORTED,
                      "but 1000");
    expect_not_opened("device = /dev/video0\ncontrols = pan_absolute=1\n", DEVICE_ERROR_UNSUPPORTED,
                      "brightness");
    expect_not_opened("device = /dev/video0\ncontrols = gamma\n", DEVICE_ERROR_RANGE,
                      "NAME=NUMBER");
    expect_not_opened("device = /dev/video0\ncontrols = gamma=99\n", DEVICE_ERROR_RANGE,
                      "100 to 500");
    GError *error = NULL;
    g_autoptr(Clock) clock = clock_new_virtual();
    g_assert_null(open_camera(clock, "device = /dev/video0\n", &error));
    g_assert_error(error, CONFIG_ERROR, CONFIG_ERROR_VALUE);
    g_clear_error(&error);
}

/* Every function that would alter pictures by itself is off from the start. */
TEST(by_hand) {
    struct rig rig;
    GError *error = NULL;
    begin(&rig, &(struct virtual_v4l2_config){0},
          "white_balance_k = 5600\ncontrols = contrast=40; brightness = -3\n");
    static const struct {
        guint32 id;
        int value;
    } expected[] = {{V4L2_CID_EXPOSURE_AUTO, V4L2_EXPOSURE_MANUAL},
                    {V4L2_CID_EXPOSURE_AUTO_PRIORITY, 0},
                    {V4L2_CID_AUTO_WHITE_BALANCE, 0},
                    {V4L2_CID_WHITE_BALANCE_TEMPERATURE, 5600},
                    {V4L2_CID_GAMMA, 100},
                    {V4L2_CID_SHARPNESS, 0},
                    {V4L2_CID_FOCUS_AUTO, 0},
                    {V4L2_CID_WIDE_DYNAMIC_RANGE, 0},
                    {V4L2_CID_CONTRAST, 40},
                    {V4L2_CID_BRIGHTNESS, -3},
                    {V4L2_CID_GAIN, 0},
                    {V4L2_CID_EXPOSURE_ABSOLUTE, 20}};
    for (gsize i = 0; i < G_N_ELEMENTS(expected); i++)
        g_assert_cmpint(virtual_v4l2_control(rig.device, expected[i].id), ==, expected[i].value);
    g_assert_false(configure(&rig, 2040, 0, &error));
    expect_text(&error, DEVICE_ERROR_RANGE, "steps of 100 µs");
    g_assert_false(configure(&rig, 2000, 6, &error));
    expect_text(&error, DEVICE_ERROR_UNSUPPORTED, "gain_per_db");
    end(&rig, NULL);
    begin(&rig, &(struct virtual_v4l2_config){0}, "gain_0db = 20\ngain_per_db = 10\n");
    g_assert_cmpint(virtual_v4l2_control(rig.device, V4L2_CID_GAIN), ==, 20);
    g_assert_true(configure(&rig, 2000, 12, NULL));
    g_assert_cmpint(virtual_v4l2_control(rig.device, V4L2_CID_GAIN), ==, 140);
    g_assert_false(configure(&rig, 2000, 30, &error));
    expect_text(&error, DEVICE_ERROR_RANGE, "0 to 240");
    end(&rig, NULL);
}

static GLogWriterOutput count_lacking(GLogLevelFlags level, const GLogField *fields, gsize n,
                                      gpointer data) {
    for (gsize i = 0; i < n; i++)
        if (strcmp(fields[i].key, "MESSAGE") == 0 &&
            strstr(fields[i].value, "has no control for: exposure, gain, white balance"))
            g_print("# told what is lacking\n");
    return G_LOG_WRITER_HANDLED;
}

static GLogWriterOutput print_warning(GLogLevelFlags level, const GLogField *fields, gsize n,
                                      gpointer data) {
    for (gsize i = 0; i < n; i++)
        if (level == G_LOG_LEVEL_WARNING && strcmp(fields[i].key, "MESSAGE") == 0)
            g_print("# %s\n", (const char *)fields[i].value);
    return G_LOG_WRITER_HANDLED;
}

/* A gamma whose unit is not known is told; one that the rig file sets is its owner's. */
TEST(gamma_told) {
    const struct virtual_v4l2_config odd = {.odd_gamma = TRUE};
    struct rig rig;
    if (g_test_subprocess()) {
        g_log_set_writer_func(print_warning, NULL, NULL);
        begin(&rig, &odd, "");
        g_assert_cmpint(virtual_v4l2_control(rig.device, V4L2_CID_GAMMA), ==, 16);
        end(&rig, NULL);
        return;
    }
    g_test_trap_subprocess(NULL, 20 * G_USEC_PER_SEC, 0);
    g_test_trap_assert_passed();
    g_test_trap_assert_stdout("*gamma = 16 (0 to 31) cannot be switched off: it is not known which "
                              "value has no effect; values are not proportional to the light;*");
    begin(&rig, &odd, "controls = gamma=0\n"); /* without a warning, which would be fatal */
    g_assert_cmpint(virtual_v4l2_control(rig.device, V4L2_CID_GAMMA), ==, 0);
    end(&rig, NULL);
}

/* Missing controls are reported, and settings that need them are refused. */
TEST(lacking_told) {
    if (g_test_subprocess()) {
        g_log_set_writer_func(count_lacking, NULL, NULL);
        struct rig rig;
        begin(&rig,
              &(struct virtual_v4l2_config){.lacks = VIRTUAL_V4L2_NO_EXPOSURE |
                                                     VIRTUAL_V4L2_NO_GAIN |
                                                     VIRTUAL_V4L2_NO_WHITE_BALANCE},
              "fixed_exposure_us = 2000\n");
        end(&rig, NULL);
        return;
    }
    g_test_trap_subprocess(NULL, 20 * G_USEC_PER_SEC, 0);
    g_test_trap_assert_passed();
    g_test_trap_assert_stdout("*told what is lacking*");
}

TEST(lacking) {
    guint all = VIRTUAL_V4L2_NO_EXPOSURE | VIRTUAL_V4L2_NO_GAIN | VIRTUAL_V4L2_NO_WHITE_BALANCE;
    struct rig rig;
    GError *error = NULL;
    VirtualV4l2 *bare = virtual_v4l2_new(&(struct virtual_v4l2_config){.lacks = all});
    expect_not_opened("", DEVICE_ERROR_UNSUPPORTED, "no control for its exposure");
    expect_not_opened("fixed_exposure_us = 2000\nwhite_balance_k = 5000\n",
                      DEVICE_ERROR_UNSUPPORTED, "no white balance control");
    virtual_v4l2_free(bare);
    begin(&rig, &(struct virtual_v4l2_config){.lacks = all}, "fixed_exposure_us = 2000\n");
    g_assert_cmpint(rig.camera->format.min_exposure_us, ==, 2000);
    g_assert_cmpint(rig.camera->format.max_exposure_us, ==, 2000);
    g_assert_false(configure(&rig, 2000, 1, &error));
    expect_text(&error, DEVICE_ERROR_UNSUPPORTED, "no gain control");
    end(&rig, NULL);
}

/* Eight cameras of 640 × 480 at 8 bits on one hub of 480 Mbit/s: 2.46 MB/s each at 8 frames a
 * second, 12.3 at 40. */
static void open_eight(double mbit_s, const char *rate, int n_expected) {
    VirtualV4l2 *devices[8];
    Camera *cameras[8] = {NULL};
    g_autoptr(Clock) clock = clock_new_real();
    int n = 0;
    for (int i = 0; i < 8; i++) {
        g_autofree char *port = g_strdup_printf("2-1.%d", i + 1);
        devices[i] = virtual_v4l2_new(&(struct virtual_v4l2_config){.number = i,
                                                                    .port = port,
                                                                    .speed_mbit_s = mbit_s,
                                                                    .width = 640,
                                                                    .height = 480,
                                                                    .cfa = CFA_RGGB});
    }
    for (int i = 0; i < 8; i++) {
        GError *error = NULL;
        g_autofree char *more =
            g_strdup_printf("device = /dev/video%d\nformat = RGGB\nframe_rate = %s\n", i, rate);
        cameras[i] = open_camera(clock, more, &error);
        if (cameras[i])
            n++;
        else
            expect_text(&error, DEVICE_ERROR_UNSUPPORTED, "MB/s that the USB link");
    }
    g_assert_cmpint(n, ==, n_expected);
    for (int i = 0; i < 8; i++) {
        camera_close(cameras[i]);
        virtual_v4l2_free(devices[i]);
    }
}

TEST(bandwidth) {
    /* The USB 2.0 specification's bounds: 8192 packets of three times 1024 bytes in a second are
     * one endpoint's most, 80 % of 60 MB/s all endpoints'. */
    g_assert_cmpfloat(video_link_mb_s(480), >, 24.6);
    g_assert_cmpfloat(video_link_mb_s(480), <, 48);
    g_assert_cmpfloat(video_link_mb_s(12), <, 1.35);
    g_assert_cmpfloat(video_link_mb_s(5000), >, 350);
    g_assert_cmpfloat(video_link_mb_s(5000), <, 450);
    open_eight(480, "8", 8);
    open_eight(480, "40", 3);
    open_eight(5000, "100", 8);
}

static const struct {
    const char *name;
    void (*run)(struct rig *rig, gconstpointer unused);
} plain[] = {
    {"/v4l2/fault/frozen", test_frozen},       {"/v4l2/fault/unplugged-idle", test_unplugged_idle},
    {"/v4l2/fault/exchanged", test_exchanged}, {"/v4l2/fault/no-bandwidth", test_no_bandwidth},
    {"/v4l2/fault/disobeys", test_disobeys},
};

BEFORE_TESTS {
    g_test_add_data_func("/v4l2/trigger/start", GINT_TO_POINTER(VIRTUAL_V4L2_START), test_trigger);
    g_test_add_data_func("/v4l2/trigger/first-data", GINT_TO_POINTER(VIRTUAL_V4L2_FIRST_DATA),
                         test_trigger);
    g_test_add_data_func("/v4l2/trigger/end", GINT_TO_POINTER(VIRTUAL_V4L2_END), test_trigger);
    for (gsize i = 0; i < G_N_ELEMENTS(plain); i++)
        g_test_add(plain[i].name, struct rig, "", begin_plain, plain[i].run, end);
    for (gsize i = 0; i < G_N_ELEMENTS(faults); i++) {
        g_autofree char *path = g_strconcat("/v4l2/fault/", faults[i].name, NULL);
        g_test_add_data_func(path, &faults[i], test_fault);
    }
}

int main(int argc, char **argv) {
    testbed_enter(argv);
    return tests_run(argc, argv);
}
