#include "v4l2.h"

#include "controls.h"
#include "load.h"
#include "stream.h"

#include "drivers/lock.h"

#include <errno.h>
#include <gio/gio.h>
#include <glib-unix.h>
#include <math.h>
#include <stdlib.h>
#include <string.h>

/* Pause, in µs, after the kernel has said that a frame is ready but has returned none. */
#define AGAIN_US 2000

#define HWTIMESTAMPS "/sys/module/uvcvideo/parameters/hwtimestamps"

/* Black level of limited-range luma (ITU-R BT.601). */
#define LIMITED_BLACK 16

enum stamp { STAMP_AUTO, STAMP_START, STAMP_FIRST_DATA, STAMP_END };

struct v4l2_camera {
    char *path, *bus, *format;
    int width, height, stamp, settle_frames, gain_0db;
    double frame_rate, black_level, delay_ms, gain_per_db, fixed_exposure_us, exposure_unit_us;
    int white_balance_k;
    char **controls_set;
    gboolean check_bandwidth;

    const char *who; /* name of the device; not owned */
    struct video_node node;
    Lock *lock; /* lock of the node; it is given back when the camera is searched for again */
    struct video_setup setup;
    struct video_controls controls;
    struct video_stream stream;
    struct video_load *load;
    struct camera_settings settings; /* exposure_us is 0 before the first configuration */
    /* frames whose exposure began before this time may have older settings */
    gint64 settled_us;
    guint64 shot;
    gint64 earliest_us; /* earliest start of the exposure of the wanted frame */
    guint source, timer;
    int broken; /* errno of the stream if it broke while no frame was awaited; otherwise 0 */
};

#define FIELD(name) G_STRUCT_OFFSET(struct v4l2_camera, name)

static const char *const stamps[] = {"auto", "start", "first-data", "end", NULL};

static const struct option options[] = {
    {"device", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(path),
     "Device node such as /dev/video0, or a link in /dev/v4l/by-path, which stays the same after "
     "every start"},
    {"bus", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(bus),
     "Bus of the camera, as shown by \"mesorig devices\"; may be left out if there is only one "
     "camera"},
    {"format", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(format),
     "Four characters, such as RG10 or YUYV; default: the best for measuring that the camera "
     "offers"},
    {"width", OPTION_INT, NULL, 0, 65536, "0", NULL, FIELD(width),
     "Width of the frames; 0: not changed"},
    {"height", OPTION_INT, NULL, 0, 65536, "0", NULL, FIELD(height),
     "Height of the frames; 0: not changed"},
    {"frame_rate", OPTION_DOUBLE, "1/s", 0, 10000, "0", NULL, FIELD(frame_rate),
     "Rate at which the camera sends frames all the time; 0: not changed. An exposure cannot be "
     "longer than a frame"},
    {"black_level", OPTION_DOUBLE, "DN", -1, 65535, "-1", NULL, FIELD(black_level),
     "Value in the dark; -1: 16 for luma of limited range, otherwise 0"},
    {"stamp", OPTION_CHOICE, NULL, 0, 0, "auto", stamps, FIELD(stamp),
     "Meaning of its time stamps: the start of the exposure, the first data, the end of the data; "
     "auto: as the kernel reports, but first-data for UVC cameras unless the kernel uses the "
     "camera's own stamps"},
    {"delay_ms", OPTION_DOUBLE, "ms", -1, 60000, "-1", NULL, FIELD(delay_ms),
     "Largest delay of a time stamp after the end of the exposure, or after its start with "
     "stamp = start; -1: no delay with stamp = start, otherwise the duration of a frame"},
    {"settle_frames", OPTION_INT, NULL, 0, 100, "2", NULL, FIELD(settle_frames),
     "Frames after a change of exposure or gain that may still have the previous settings"},
    {"gain_0db", OPTION_INT, NULL, -1, G_MAXINT, "-1", NULL, FIELD(gain_0db),
     "Value of the gain control at 0 dB; -1: its minimum"},
    {"gain_per_db", OPTION_DOUBLE, "1/dB", 0, 100000, "0", NULL, FIELD(gain_per_db),
     "Change of the gain control for 1 dB; 0: not known, so only 0 dB can be used"},
    {"fixed_exposure_us", OPTION_DOUBLE, "µs", 0, 1e9, "0", NULL, FIELD(fixed_exposure_us),
     "The exposure of a camera that has no control for it"},
    {"exposure_unit_us", OPTION_DOUBLE, "µs", 0, 1e6, "0", NULL, FIELD(exposure_unit_us),
     "Duration of one step of the exposure control, if it counts in other units, such as lines of "
     "the sensor"},
    {"white_balance_k", OPTION_INT, "K", 0, 100000, "0", NULL, FIELD(white_balance_k),
     "Colour temperature of the white balance, if the camera has a control for it; 0: not changed"},
    {"controls", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(controls_set),
     "Other controls, such as \"gamma=100; sharpness=0\", with the names of v4l2-ctl"},
    {"check_bandwidth", OPTION_BOOL, NULL, 0, 0, "yes", NULL, FIELD(check_bandwidth),
     "Refuse cameras that together send more than their USB links can carry"},
    {NULL},
};

/* Returns which moment of the exposure a time stamp marks. uvcvideo flags its time stamps as the
 * start of exposure, but takes the time of the first packet. It uses the clock of the camera only
 * if its module parameter says so. */
static enum stamp stamp_kind(const struct v4l2_camera *v4l2, guint32 flags) {
    if (v4l2->stamp != STAMP_AUTO)
        return (enum stamp)v4l2->stamp;
    if ((flags & V4L2_BUF_FLAG_TSTAMP_SRC_MASK) != V4L2_BUF_FLAG_TSTAMP_SRC_SOE)
        return STAMP_END;
    g_autofree char *used = NULL;
    if (strcmp(v4l2->node.driver, "uvcvideo") != 0)
        return STAMP_START;
    gboolean own =
        g_file_get_contents(HWTIMESTAMPS, &used, NULL, NULL) && *used != '0' && *used != 'N';
    return own ? STAMP_START : STAMP_FIRST_DATA;
}

static gint64 delay_us(const struct v4l2_camera *v4l2, enum stamp kind) {
    if (v4l2->delay_ms >= 0)
        return llrint(v4l2->delay_ms * 1000);
    return kind == STAMP_START ? 0 : v4l2->setup.interval_us;
}

/* Returns the earliest time at which the exposure of the frame may have begun. */
static gint64 start_of(const struct v4l2_camera *v4l2, const struct v4l2_buffer *buffer) {
    enum stamp kind = stamp_kind(v4l2, buffer->flags);
    gint64 stamp = (gint64)buffer->timestamp.tv_sec * G_USEC_PER_SEC + buffer->timestamp.tv_usec;
    return stamp - delay_us(v4l2, kind) - (kind == STAMP_START ? 0 : v4l2->settings.exposure_us);
}

static Frame *make_frame(const Camera *camera, const struct v4l2_buffer *buffer) {
    const struct v4l2_camera *v4l2 = camera->device.priv;
    const struct video_setup *setup = &v4l2->setup;
    Frame *frame = frame_new(setup->width, setup->height);
    frame->shot = v4l2->shot;
    frame->id = buffer->sequence;
    frame->exposure_start_us = start_of(v4l2, buffer);
    frame->exposure_us = v4l2->settings.exposure_us;
    frame->exposure_end_us = frame->exposure_start_us + frame->exposure_us;
    frame->cfa = setup->format->cfa;
    frame->bits = setup->format->bits;
    frame->black_level = camera->format.black_level;
    frame->incomplete = buffer->flags & V4L2_BUF_FLAG_ERROR || buffer->bytesused < setup->bytes;
    const guint8 *data = v4l2->stream.buffers[buffer->index].data + buffer->m.offset;
    video_format_unpack(setup->format, data, setup->stride, setup->width, setup->height,
                        frame->pixels);
    return frame;
}

/* Reports that the stream has broken with the errno code. Call it last, because the listener may
 * close the camera. */
static void report_failure(Camera *camera, int code) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    GError *error = NULL;
    video_set_error(&error, &v4l2->node, code, "stopped streaming");
    if (code == ENODEV)
        video_node_close(&v4l2->node);
    camera_report_fault(camera, error);
}

static void camera_watch(Camera *camera);

static void on_again(gpointer data) {
    Camera *camera = data;
    struct v4l2_camera *v4l2 = camera->device.priv;
    v4l2->timer = 0;
    camera_watch(camera);
}

static gboolean on_ready(gint fd, GIOCondition condition, gpointer data) {
    Camera *camera = data;
    struct v4l2_camera *v4l2 = camera->device.priv;
    struct v4l2_buffer buffer;
    v4l2->source = 0;
    int taken;
    while ((taken = video_stream_take(&v4l2->stream, &v4l2->node, &buffer)) > 0) {
        gboolean monotonic =
            (buffer.flags & V4L2_BUF_FLAG_TIMESTAMP_MASK) == V4L2_BUF_FLAG_TIMESTAMP_MONOTONIC;
        g_autoptr(Frame) frame = NULL;
        if (monotonic && start_of(v4l2, &buffer) >= v4l2->earliest_us)
            frame = make_frame(camera, &buffer);
        video_stream_give_back(&v4l2->node, &buffer);
        if (!monotonic)
            camera_report_fault(
                camera,
                device_error_new(
                    DEVICE_ERROR_UNSUPPORTED, v4l2->who,
                    "%s does not stamp its frames with the monotonic clock, so that "
                    "frames exposed before and after a trigger cannot be told apart" ERROR_ADVICE
                    "use another camera",
                    v4l2->node.path));
        else if (frame)
            camera_report_frame(camera, g_steal_pointer(&frame));
        else
            continue;
        return G_SOURCE_REMOVE;
    }
    if (taken < 0)
        report_failure(camera, errno);
    else
        v4l2->timer = clock_call_in(camera->device.clock, AGAIN_US, on_again, camera);
    return G_SOURCE_REMOVE;
}

/* Watches the device. Called only while a frame is awaited. At other times the buffers stay full,
 * and the kernel drops further frames. */
static void camera_watch(Camera *camera) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    v4l2->source = g_unix_fd_add(v4l2->node.fd, G_IO_IN | G_IO_ERR | G_IO_HUP, on_ready, camera);
}

static void on_broken(gpointer data) {
    Camera *camera = data;
    struct v4l2_camera *v4l2 = camera->device.priv;
    v4l2->timer = 0;
    report_failure(camera, v4l2->broken);
}

static gboolean v4l2_camera_trigger(Camera *camera, guint64 shot, GError **error) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    struct v4l2_buffer buffer;
    int taken = 1;
    /* Discard the frames in the buffers, because they are old whatever their time stamps say. */
    for (int i = 0; i < v4l2->stream.n && taken > 0; i++) {
        taken = video_stream_take(&v4l2->stream, &v4l2->node, &buffer);
        if (taken > 0)
            video_stream_give_back(&v4l2->node, &buffer);
    }
    v4l2->broken = taken < 0 ? errno : 0;
    v4l2->shot = shot;
    v4l2->earliest_us = MAX(clock_now_us(camera->device.clock), v4l2->settled_us);
    if (v4l2->broken)
        v4l2->timer = clock_call_in(camera->device.clock, 0, on_broken, camera);
    else
        camera_watch(camera);
    return TRUE;
}

static double exposure_unit_us(const struct v4l2_camera *v4l2) {
    return v4l2->exposure_unit_us > 0 ? v4l2->exposure_unit_us : v4l2->controls.exposure_unit_us;
}

static gboolean set_exposure(const struct v4l2_camera *v4l2, gint64 exposure_us, GError **error) {
    const struct video_range *range = &v4l2->controls.exposure;
    double unit = exposure_unit_us(v4l2);
    if (v4l2->fixed_exposure_us > 0)
        return TRUE; /* drivers/camera.c has checked that exposure_us is the fixed exposure */
    gint64 value = video_range_nearest(range, (double)exposure_us / unit);
    if (fabs((double)value * unit / (double)exposure_us - 1) > 0.01)
        return video_refuse(error, DEVICE_ERROR_RANGE, &v4l2->node,
                            "cannot expose for %" G_GINT64_FORMAT
                            " µs, only in steps of %g µs: the nearest is %g µs",
                            exposure_us, (double)range->step * unit, (double)value * unit);
    return video_control_set(&v4l2->node, range->id, value, error);
}

static gboolean set_gain(const struct v4l2_camera *v4l2, double gain_db, GError **error) {
    const struct video_range *range = &v4l2->controls.gain;
    if (gain_db != 0 && (range->id == 0 || v4l2->gain_per_db == 0))
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, &v4l2->node,
                            "cannot be set to a gain of %g dB: %s" ERROR_ADVICE "use gain_db = 0",
                            gain_db,
                            range->id ? "the unit of its gain control is not known (gain_per_db)"
                                      : "it has no gain control");
    if (range->id == 0)
        return TRUE;
    double zero = v4l2->gain_0db >= 0 ? v4l2->gain_0db : (double)range->min;
    double wanted = zero + gain_db * v4l2->gain_per_db;
    if (wanted < (double)range->min || wanted > (double)range->max)
        return video_refuse(
            error, DEVICE_ERROR_RANGE, &v4l2->node,
            "cannot be set to a gain of %g dB: its control goes from %" G_GINT64_FORMAT
            " to %" G_GINT64_FORMAT ", and this gain would be %g" ERROR_ADVICE
            "correct gain_db, or gain_0db and gain_per_db in its section",
            gain_db, range->min, range->max, wanted);
    return video_control_set(&v4l2->node, range->id, video_range_nearest(range, wanted), error);
}

static gboolean camera_apply_settings(Camera *camera, GError **error) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    if (!set_exposure(v4l2, v4l2->settings.exposure_us, error) ||
        !set_gain(v4l2, v4l2->settings.gain_db, error))
        return FALSE;
    v4l2->settled_us =
        clock_now_us(camera->device.clock) + v4l2->settle_frames * v4l2->setup.interval_us;
    return TRUE;
}

/* The settings of a camera that is not connected are kept, and applied when it is found again. */
static gboolean v4l2_camera_configure(Camera *camera, const struct camera_settings *settings,
                                      GError **error) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    v4l2->settings = *settings;
    return v4l2->node.fd < 0 || camera_apply_settings(camera, error);
}

static gboolean set_controls(const struct v4l2_camera *v4l2, GError **error) {
    const struct video_range *white = &v4l2->controls.white_balance;
    if (!video_controls_by_hand(&v4l2->node, error))
        return FALSE;
    if (v4l2->white_balance_k > 0 && white->id == 0)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, &v4l2->node,
                            "has no white balance control; leave white_balance_k out");
    if (v4l2->white_balance_k > 0 &&
        !video_control_set(&v4l2->node, white->id, v4l2->white_balance_k, error))
        return FALSE;
    for (int i = 0; v4l2->controls_set && v4l2->controls_set[i]; i++)
        if (!video_control_set_named(&v4l2->node, v4l2->controls_set[i], error))
            return FALSE;
    return TRUE;
}

static gboolean camera_check_exposure(const struct v4l2_camera *v4l2, GError **error) {
    if (v4l2->fixed_exposure_us > 0)
        return TRUE;
    if (v4l2->controls.exposure.id == 0)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, &v4l2->node,
                            "(%s) has no control for its exposure" ERROR_ADVICE
                            "if it is fixed and known, write fixed_exposure_us",
                            v4l2->node.card);
    if (exposure_unit_us(v4l2) <= 0)
        return video_refuse(error, DEVICE_ERROR_UNSUPPORTED, &v4l2->node,
                            "(%s) counts its exposure in steps of an unknown length" ERROR_ADVICE
                            "write that length as exposure_unit_us",
                            v4l2->node.card);
    return TRUE;
}

static void camera_disconnect(struct v4l2_camera *v4l2) {
    video_node_close(&v4l2->node);
    g_clear_pointer(&v4l2->lock, lock_release);
    g_clear_pointer(&v4l2->load, video_load_remove);
}

/* Locks the camera, because the kernel allows several programs to set it up. */
static gboolean lock_camera(struct v4l2_camera *v4l2, GError **error) {
    g_autofree char *key = lock_key_of_node("video", v4l2->node.path);
    if (key && !(v4l2->lock = lock_take(key, LOCK_ALONE, v4l2->node.path, error)))
        error_details_add_subject(error, v4l2->who);
    return !key || v4l2->lock;
}

static gboolean connect_camera(struct v4l2_camera *v4l2, GError **error) {
    const struct video_request request = {v4l2->format, v4l2->width, v4l2->height,
                                          v4l2->frame_rate};
    g_clear_pointer(&v4l2->load, video_load_remove);
    g_clear_pointer(&v4l2->lock, lock_release);
    if (!video_node_open(&v4l2->node, v4l2->who, v4l2->path, v4l2->bus, error))
        return FALSE;
    video_controls_read(&v4l2->node, &v4l2->controls);
    if (lock_camera(v4l2, error) && video_setup_apply(&v4l2->node, &request, &v4l2->setup, error) &&
        camera_check_exposure(v4l2, error)) {
        g_autofree char *sysfs = video_node_sysfs(&v4l2->node);
        double mb_s = video_setup_mb_s(&v4l2->setup);
        if ((!v4l2->check_bandwidth ||
             video_load_add(v4l2->who, sysfs, mb_s, &v4l2->load, error)) &&
            set_controls(v4l2, error))
            return TRUE;
    }
    camera_disconnect(v4l2);
    return FALSE;
}

static gboolean find_again(Camera *camera, GError **error) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    const struct video_setup before = v4l2->setup;
    if (!connect_camera(v4l2, error)) {
        v4l2->setup = before;
        return FALSE;
    }
    device_set_identity(&camera->device, v4l2->node.card, NULL, v4l2->node.bus);
    if (v4l2->setup.format == before.format && v4l2->setup.width == before.width &&
        v4l2->setup.height == before.height && v4l2->setup.interval_us == before.interval_us)
        return v4l2->settings.exposure_us == 0 || camera_apply_settings(camera, error);
    v4l2->setup = before;
    video_refuse(error, DEVICE_ERROR_UNSUPPORTED, &v4l2->node,
                 "came back with another format, size or frame rate: it is another camera, or "
                 "another program has set it" ERROR_ADVICE
                 "start the rig again, or write format, width, height and frame_rate");
    camera_disconnect(v4l2);
    return FALSE;
}

static gboolean v4l2_camera_arm(Camera *camera, GError **error) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    if (v4l2->node.fd < 0 && !find_again(camera, error))
        return FALSE;
    if (video_stream_start(&v4l2->stream, &v4l2->node, &v4l2->setup, error))
        return TRUE;
    camera_disconnect(v4l2); /* the next attempt connects again */
    return FALSE;
}

static void v4l2_camera_disarm(Camera *camera) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    clock_cancel(camera->device.clock, &v4l2->timer);
    g_clear_handle_id(&v4l2->source, g_source_remove);
    video_stream_stop(&v4l2->stream, &v4l2->node);
}

static void fill_format(Camera *camera) {
    const struct v4l2_camera *v4l2 = camera->device.priv;
    const struct video_setup *setup = &v4l2->setup;
    gboolean limited = video_format_is_luma(setup->format) && !setup->full_range;
    double unit = exposure_unit_us(v4l2);
    gint64 least = MAX(v4l2->controls.exposure.min, 1), most = v4l2->controls.exposure.max;
    camera->format = (struct camera_format){
        .width = setup->width,
        .height = setup->height,
        .cfa = setup->format->cfa,
        .bits = setup->format->bits,
        .black_level = v4l2->black_level >= 0 ? v4l2->black_level
                       : limited              ? LIMITED_BLACK
                                              : 0,
        .min_exposure_us = (gint64)ceil((double)least * unit),
        .max_exposure_us = MIN((gint64)((double)most * unit), setup->interval_us),
        .trigger_us = setup->interval_us / 2 + delay_us(v4l2, (enum stamp)v4l2->stamp),
        .readout_us = setup->interval_us,
        /* exposure_start_us is only the earliest possible start, and most cameras have rolling
         * shutters. */
        .stamp_us = -1,
    };
    if (v4l2->fixed_exposure_us > 0)
        camera->format.min_exposure_us = camera->format.max_exposure_us =
            llrint(v4l2->fixed_exposure_us);
}

static void camera_needs(gconstpointer given, GPtrArray *to) {
    const struct v4l2_camera *v4l2 = given;
    char *node = *v4l2->path ? realpath(v4l2->path, NULL) : NULL;
    const char *path = node ? node : v4l2->path;
    g_ptr_array_add(to, *path        ? g_strdup_printf("the camera %s", path)
                        : *v4l2->bus ? g_strdup_printf("the camera on bus %s", v4l2->bus)
                                     : g_strdup("the only V4L2 camera"));
    free(node);
}

static gboolean camera_open_camera(Camera *camera, GError **error) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    v4l2->node.fd = -1;
    v4l2->who = camera->device.who;
    if (!device_check_real_clock(&camera->device, error))
        return FALSE;
    if (!connect_camera(v4l2, error))
        return FALSE;
    device_set_identity(&camera->device, v4l2->node.card, NULL, v4l2->node.bus);
    fill_format(camera);
    g_autofree char *lacking = video_controls_lacking(&v4l2->controls);
    if (lacking)
        g_message("%s: %s (%s) has no control for: %s", v4l2->who, v4l2->node.path, v4l2->node.card,
                  lacking);
    g_auto(GStrv) left = video_controls_left(&v4l2->node, v4l2->controls_set);
    for (char **text = left; *text; text++)
        g_warning("%s: %s (%s): %s", v4l2->who, v4l2->node.path, v4l2->node.card, *text);
    return TRUE;
}

static void camera_close_camera(Camera *camera) {
    struct v4l2_camera *v4l2 = camera->device.priv;
    camera_disconnect(v4l2);
}

const struct camera_driver v4l2_camera_driver = {
    .info = {"camera", "v4l2-camera",
             "A USB (UVC) or other camera that the kernel serves through V4L2", options,
             sizeof(struct v4l2_camera), NULL, camera_needs},
    .open = camera_open_camera,
    .close = camera_close_camera,
    .configure = v4l2_camera_configure,
    .arm = v4l2_camera_arm,
    .disarm = v4l2_camera_disarm,
    .trigger = v4l2_camera_trigger,
    .no_stamps = TRUE,
};
