#include "camera.h"
#include "worker.h"

#include <math.h>

/* Time to wait for the right frame after one that was exposed before the trigger, in addition to
 * exposure and read-out. */
#define STALE_US G_USEC_PER_SEC

/* Longest accepted time from the reported end of an exposure to its end by the time stamp. A
 * smaller difference is within the uncertainty of the clocks. */
#define OVERTIME_US 1000
#define STAMP_US    1000 /* stamp_us of camera_format (drivers/camera.h) with a global shutter */

struct aravis_camera {
    /* must be the first member, because the option table describes it */
    struct aravis_options options;
    AravisWorker *worker;
    struct aravis_limits limits;
    struct camera_settings settings;
    GError *lost;
    guint exposed_timer, stale_timer;
    gint64 exposed_us; /* when the end of the exposure was reported; 0 before that */
    /* of the last frame that was too old: time from the start of its exposure to the trigger */
    gint64 before_us;
};

#define FIELD(name) G_STRUCT_OFFSET(struct aravis_options, name)

static const char *const stamps[] = {"start", "end", "none", NULL};

static const struct option options[] = {
    {"device", OPTION_STRING, NULL, 0, 0, NULL, NULL, FIELD(device),
     "The camera: its IP address, its serial number or its name in Aravis"},
    {"pixel_format", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(pixel_format),
     "Mono8, 10, 12 or 16, or Bayer of any phase, also packed; default: the best that the camera "
     "offers"},
    {"bits", OPTION_INT, NULL, 0, 16, "0", NULL, FIELD(bits),
     "Bits of a value in its frames; 0: those of the pixel format"},
    {"width", OPTION_INT, "px", 0, 65536, "0", NULL, FIELD(width),
     "Width of the region that is read out; 0: all of the sensor"},
    {"height", OPTION_INT, "px", 0, 65536, "0", NULL, FIELD(height),
     "Height of the region; 0: all of the sensor"},
    {"offset_x", OPTION_INT, "px", 0, 65536, "0", NULL, FIELD(offset_x),
     "Column of the sensor at which the region begins"},
    {"offset_y", OPTION_INT, "px", 0, 65536, "0", NULL, FIELD(offset_y),
     "Row of the sensor at which the region begins"},
    {"black_level", OPTION_DOUBLE, NULL, -1, 1e6, "-1", NULL, FIELD(black_level),
     "Value for the camera's BlackLevel; -1: not changed"},
    {"black_level_dn", OPTION_DOUBLE, "DN", 0, 65535, "0", NULL, FIELD(black_level_dn),
     "Value of frames in the dark; a dark frame above it shows that light has entered"},
    {"gain_zero", OPTION_DOUBLE, NULL, 0, 0, "0", NULL, FIELD(gain_zero),
     "Value of the camera's Gain at 0 dB"},
    {"gain_per_db", OPTION_DOUBLE, NULL, 1e-3, 1e6, "1", NULL, FIELD(gain_per_db),
     "Increase of the camera's Gain for 1 dB"},
    {"trigger", OPTION_STRING, NULL, 0, 0, "Software", NULL, FIELD(trigger),
     "Software, or the input of the camera that receives the trigger, such as Line1"},
    {"pulse_path", OPTION_PATH, NULL, 0, 0, "", NULL, FIELD(pulse_path),
     "For a trigger by an input: the file of the output that is wired to it; 1 and 0 are written "
     "to it, for example /sys/class/gpio/gpio17/value"},
    {"trigger_ms", OPTION_DOUBLE, "ms", 0, 60000, "1", NULL, FIELD(trigger_ms),
     "Longest time from the trigger to the start of the exposure"},
    {"readout_ms", OPTION_DOUBLE, "ms", 0, 60000, "30", NULL, FIELD(readout_ms),
     "Time from the end of the exposure to the arrival of the frame"},
    {"stamp", OPTION_CHOICE, NULL, 0, 0, "start", stamps, FIELD(stamp),
     "Meaning of the camera's time stamps: the start or the end of the exposure, or none of these"},
    {"packet_size", OPTION_INT, "bytes", 0, 65507, "0", NULL, FIELD(packet_size),
     "GigE: size of stream packets; 0: the largest that gets through"},
    {"packet_delay_ns", OPTION_INT, "ns", 0, 1000000000, "0", NULL, FIELD(packet_delay_ns),
     "GigE: delay between packets, for cameras that share a line"},
    {"socket_buffer_kib", OPTION_INT, "KiB", 64, 1048576, "4096", NULL, FIELD(socket_buffer_kib),
     "GigE: size of the buffer for packets that are not read yet; net.core.rmem_max must allow it"},
    {"packet_socket", OPTION_BOOL, NULL, 0, 0, "no", NULL, FIELD(packet_socket),
     "GigE: read packets from a packet socket instead of UDP, if this process may"},
    {"resend_ms", OPTION_DOUBLE, "ms", 0, 10000, "20", NULL, FIELD(resend_ms),
     "GigE: how long a packet may be missing before it is asked for again"},
    {"retention_ms", OPTION_DOUBLE, "ms", 1, 60000, "200", NULL, FIELD(retention_ms),
     "GigE: how long after its last packet a frame may still become complete"},
    {"features", OPTION_STRINGS, NULL, 0, 0, "", NULL, FIELD(features),
     "Further settings of the camera: Name=value, separated by ';'"},
    {NULL},
};

static void clear_timers(Camera *camera) {
    struct aravis_camera *priv = camera->device.priv;
    clock_cancel(camera->device.clock, &priv->exposed_timer);
    clock_cancel(camera->device.clock, &priv->stale_timer);
    priv->exposed_us = 0;
}

static void camera_on_exposed(gpointer data) {
    Camera *camera = data;
    struct aravis_camera *priv = camera->device.priv;
    priv->exposed_timer = 0;
    priv->exposed_us = clock_now_us(camera->device.clock);
    camera_report_exposed(camera);
}

/* Reports the end of the exposure when the camera begins to send the frame. Some cameras announce
 * the frame earlier, so the report waits until trigger_us and the exposure have passed since the
 * trigger was sent, at sent_us. */
static void on_sending(gint64 sent_us, gpointer data) {
    Camera *camera = data;
    struct aravis_camera *priv = camera->device.priv;
    gint64 over_us = sent_us + camera->format.trigger_us + priv->settings.exposure_us;
    if (priv->exposed_timer == 0 && priv->exposed_us == 0)
        priv->exposed_timer =
            clock_call_at(camera->device.clock, over_us, camera_on_exposed, camera);
}

/* Reports a fault instead of a frame whose exposure went on for more than OVERTIME_US after the
 * driver had reported its end, because lamps and axes may have changed by then. Passes a frame from
 * the future to the class, which refuses it. */
static void camera_on_frame(Frame *frame, gpointer data) {
    Camera *camera = data;
    struct aravis_camera *priv = camera->device.priv;
    gint64 over_us = priv->exposed_us > 0 ? frame->exposure_end_us - priv->exposed_us : 0;
    gboolean future = frame->exposure_end_us > clock_now_us(camera->device.clock);
    clear_timers(camera);
    if (over_us <= OVERTIME_US || future) {
        camera_report_frame(camera, frame);
        return;
    }
    frame_unref(frame);
    camera_report_fault(
        camera,
        device_error_new(DEVICE_ERROR_PROTOCOL, camera->device.who,
                         "it was still exposing %.1f ms after the end that trigger_ms and the "
                         "exposure time give" ERROR_ADVICE "increase trigger_ms by %.1f",
                         (double)over_us / 1e3, (double)over_us / 1e3));
}

static void on_only_stale(gpointer data) {
    Camera *camera = data;
    struct aravis_camera *priv = camera->device.priv;
    priv->stale_timer = 0;
    clear_timers(camera);
    camera_report_fault(
        camera,
        device_error_new(
            DEVICE_ERROR_STALE, camera->device.who,
            "it sent a frame that was exposed %.1f ms before its trigger, and no frame after "
            "that" ERROR_ADVICE "check that nothing else triggers the camera",
            (double)priv->before_us / 1e3));
}

static void camera_on_stale(gint64 before_us, gpointer data) {
    Camera *camera = data;
    struct aravis_camera *priv = camera->device.priv;
    gint64 wait_us = priv->settings.exposure_us + camera->format.readout_us + STALE_US;
    priv->before_us = before_us;
    if (priv->stale_timer == 0)
        priv->stale_timer = clock_call_in(camera->device.clock, wait_us, on_only_stale, camera);
}

static void on_failed(GError *error, gpointer data) {
    Camera *camera = data;
    error_details_add_subject(&error, camera->device.who);
    clear_timers(camera);
    camera_report_fault(camera, error);
}

static void camera_on_lost(const GError *error, gpointer data) {
    Camera *camera = data;
    struct aravis_camera *priv = camera->device.priv;
    g_clear_error(&priv->lost);
    if (error) {
        priv->lost = g_error_copy(error);
        error_details_add_subject(&priv->lost, camera->device.who);
    }
}

static const struct aravis_hooks hooks = {.sending = on_sending,
                                          .frame = camera_on_frame,
                                          .stale = camera_on_stale,
                                          .failed = on_failed,
                                          .lost = camera_on_lost};

static gboolean aravis_camera_configure(Camera *camera, const struct camera_settings *settings,
                                        GError **error) {
    struct aravis_camera *priv = camera->device.priv;
    const struct aravis_limits *limits = &priv->limits;
    if (settings->gain_db < limits->min_gain_db - 1e-9 ||
        settings->gain_db > limits->max_gain_db + 1e-9)
        return device_error_set(error, DEVICE_ERROR_RANGE, camera->device.who,
                                "cannot have a gain of %g dB, only %g to %g dB" ERROR_ADVICE
                                "correct gain_db",
                                settings->gain_db, limits->min_gain_db, limits->max_gain_db);
    priv->settings = *settings;
    aravis_worker_configure(priv->worker, settings->exposure_us, settings->gain_db);
    return TRUE;
}

static gboolean camera_is_there(const Camera *camera, GError **error) {
    const struct aravis_camera *priv = camera->device.priv;
    if (!priv->lost)
        return TRUE;
    g_propagate_error(error, g_error_copy(priv->lost));
    return FALSE;
}

static gboolean aravis_camera_arm(Camera *camera, GError **error) {
    struct aravis_camera *priv = camera->device.priv;
    if (!camera_is_there(camera, error))
        return FALSE;
    clear_timers(camera);
    aravis_worker_arm(priv->worker);
    return TRUE;
}

static void aravis_camera_disarm(Camera *camera) {
    struct aravis_camera *priv = camera->device.priv;
    clear_timers(camera);
    aravis_worker_disarm(priv->worker);
}

static gboolean aravis_camera_trigger(Camera *camera, guint64 shot, GError **error) {
    struct aravis_camera *priv = camera->device.priv;
    if (!camera_is_there(camera, error))
        return FALSE;
    clear_timers(camera);
    aravis_worker_trigger(priv->worker, shot);
    return TRUE;
}

static void camera_check(gconstpointer given, const struct config_section *section,
                         Mistakes *mistakes) {
    const struct aravis_options *said = &((const struct aravis_camera *)given)->options;
    if (*said->pixel_format && !aravis_format_by_name(said->pixel_format))
        config_mistake(mistakes, CONFIG_ERROR_VALUE, section, "pixel_format",
                       "\"%s\" cannot be used for measuring; choose Mono or BayerRG, BayerBG, "
                       "BayerGR, BayerGB with 8, 10, 10p, 10Packed, 12, 12p, 12Packed or 16",
                       said->pixel_format);
    if (!g_str_equal(said->trigger, "Software") && !*said->pulse_path)
        config_mistake(mistakes, CONFIG_ERROR_MISSING, section, "pulse_path",
                       "must be given for a trigger by %s", said->trigger);
}

static void camera_needs(gconstpointer given, GPtrArray *to) {
    g_ptr_array_add(to, g_strdup_printf("the camera %s",
                                        ((const struct aravis_camera *)given)->options.device));
}

static gboolean camera_open_camera(Camera *camera, GError **error) {
    struct aravis_camera *priv = camera->device.priv;
    priv->worker = aravis_worker_new(camera->device.name, &priv->options, &hooks, camera);
    return TRUE;
}

static gboolean opened(Camera *camera, GError **error) {
    struct aravis_camera *priv = camera->device.priv;
    const struct aravis_options *given = &priv->options;
    if (!aravis_worker_await(priv->worker, &priv->limits, error)) {
        error_details_add_subject(error, camera->device.who);
        return FALSE;
    }
    const char *const *warning = aravis_worker_warnings(priv->worker);
    for (; warning && *warning; warning++)
        g_warning("%s: %s", camera->device.who, *warning);
    device_set_identity(&camera->device, priv->limits.model, priv->limits.serial, NULL);
    camera->format = (struct camera_format){
        .width = priv->limits.width,
        .height = priv->limits.height,
        .cfa = priv->limits.format->cfa,
        .bits = priv->limits.bits,
        .black_level = priv->limits.black_level,
        .min_exposure_us = priv->limits.min_exposure_us,
        .max_exposure_us = priv->limits.max_exposure_us,
        .trigger_us = (gint64)(given->trigger_ms * 1000),
        .readout_us = (gint64)(given->readout_ms * 1000),
        .stamp_us = priv->limits.rolling ? -1 : STAMP_US,
    };
    return TRUE;
}

static void camera_close_camera(Camera *camera) {
    struct aravis_camera *priv = camera->device.priv;
    clear_timers(camera);
    g_clear_pointer(&priv->worker, aravis_worker_free);
    g_clear_error(&priv->lost);
}

const struct camera_driver aravis_camera_driver = {
    .info = {"camera", "aravis", "A GigE Vision or USB3 Vision camera", options,
             sizeof(struct aravis_camera), camera_check, camera_needs},
    .open = camera_open_camera,
    .opened = opened,
    .close = camera_close_camera,
    .configure = aravis_camera_configure,
    .arm = aravis_camera_arm,
    .disarm = aravis_camera_disarm,
    .trigger = aravis_camera_trigger,
};
