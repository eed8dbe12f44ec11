#include "device.h"

#include "connect.h"
#include "errors.h"
#include "raw.h"
#include "socket_buffer.h"

#include <errno.h>
#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define N_BUFFERS 6
#define N_ASKED   5

/* Bootstrap registers of the clock of a GigE Vision camera. */
#define STAMP_CONTROL 0x0944
#define STAMP_HIGH    0x0948
#define STAMP_LOW     0x094c
#define STAMP_LATCH   2

#define PULSE_US 1000

/* MAX_REPORT_US is the longest time that Aravis may take to report that a camera was unplugged.
 * LOOK_REPORT_US is the pause between two checks whether the report has ended. */
#define MAX_REPORT_US  G_USEC_PER_SEC
#define LOOK_REPORT_US 1000

/* Limit of resend requests, as a share of a frame's packets. */
#define REQUESTS 1.0

struct AravisDevice {
    const struct aravis_options *options;
    Lock *lock;
    ArvDevice *device;
    ArvCamera *camera;
    ArvStream *stream;
    struct aravis_limits limits;
    double ticks_per_us; /* clock frequency of a GigE Vision camera; 0 if it has no clock */
    gboolean sfnc_clock; /* the clock is read by TimestampLatch, in ns */
    char **warnings;
    gint unplugged; /* atomic: a USB camera has left the bus */
    gint n_refs;    /* references to the Aravis device at the end of the opening; 0 before that */
};

static gint count_refs(AravisDevice *device) {
    return g_atomic_int_get((gint *)&G_OBJECT(device->device)->ref_count);
}

static gboolean device_has(AravisDevice *device, const char *feature) {
    return arv_camera_is_feature_available(device->camera, feature, NULL);
}

static gboolean set_features(AravisDevice *device, GError **error) {
    for (char **f = device->options->features; f && *f; f++) {
        GError *why = NULL;
        g_autofree char *what = g_strdup_printf("features: %s", *f);
        arv_device_set_features_from_string(device->device, *f, &why);
        if (!aravis_error_take(why, what, error))
            return FALSE;
    }
    return TRUE;
}

/* Returns whether the option "features" in the rig file sets the feature on purpose. */
static gboolean device_asked_for(const AravisDevice *device, const char *feature) {
    gsize n = strcspn(feature, "[");
    for (char **f = device->options->features; f && *f; f++) {
        g_autofree char *name = g_strndup(*f, strcspn(*f, "="));
        if (strlen(g_strstrip(name)) == n && strncmp(name, feature, n) == 0)
            return TRUE;
    }
    return FALSE;
}

/* Switches off the functions of the camera that alter frames, because a measurement needs raw
 * values. Then sets the features that the rig file names. Fails if a function that is still on
 * makes values unsteady. Adds a warning for any other function that is still on. A function that
 * the rig file sets on purpose causes neither an error nor a warning. */
static gboolean set_raw(AravisDevice *device, GError **error) {
    GError *why = NULL;
    g_autoptr(GPtrArray) tried = aravis_raw_survey(device->device, TRUE, error);
    if (!tried || !set_features(device, error))
        return FALSE;
    g_autoptr(GPtrArray) left = aravis_raw_survey(device->device, FALSE, error);
    g_autoptr(GStrvBuilder) warnings = g_strv_builder_new();
    for (guint i = 0; left && i < left->len; i++) {
        const struct aravis_raw *raw = left->pdata[i];
        const char *refused = raw->why;
        if (!raw->why || device_asked_for(device, raw->feature))
            continue;
        for (guint k = 0; k < tried->len; k++) {
            const struct aravis_raw *before = tried->pdata[k];
            if (before->what == raw->what && before->why)
                refused = before->why;
        }
        g_autoptr(GError) told =
            device_error_new(DEVICE_ERROR_UNSUPPORTED, NULL,
                             "%s cannot be switched off (%s = %s: %s); %s" ERROR_ADVICE
                             "switch it off with the maker's program and save the settings in the "
                             "camera, or choose another pixel_format",
                             raw->what, raw->feature, raw->value, refused, raw->effect);
        if (raw->unsteady) {
            g_propagate_error(error, g_steal_pointer(&told));
            return FALSE;
        }
        g_strv_builder_add(warnings, told->message);
    }
    if (!left)
        return FALSE;
    device->warnings = g_strv_builder_end(warnings);
    if (device_has(device, "AcquisitionMode"))
        arv_camera_set_string(device->camera, "AcquisitionMode", "Continuous", &why);
    return aravis_error_take(why, "AcquisitionMode", error);
}

static gboolean device_is_grey(AravisDevice *device) {
    return device_has(device, "PixelColorFilter") &&
           g_strcmp0(arv_camera_get_string(device->camera, "PixelColorFilter", NULL), "None") == 0;
}

static gboolean device_set_format(AravisDevice *device, GError **error) {
    const char *wanted = device->options->pixel_format;
    guint n = 0;
    g_autoptr(GString) names = g_string_new(NULL);
    GError *why = NULL;
    const struct aravis_format *format = NULL, *coloured = NULL;
    g_autofree gint64 *codes = arv_camera_dup_available_pixel_formats(device->camera, &n, &why);
    if (!aravis_error_take(why, "PixelFormat", error))
        return FALSE;
    for (const struct aravis_format *f = aravis_formats; f->name; f++)
        for (guint i = 0; i < n; i++)
            if (codes[i] == f->code && (!*wanted || g_str_equal(wanted, f->name))) {
                format = format ? format : f;
                coloured = coloured || f->cfa == CFA_MONO ? coloured : f;
            }
    /* Prefer a Bayer format, because a camera with colour filters computes each Mono value from
     * several pixels. */
    if (coloured && !device_is_grey(device))
        format = coloured;
    for (guint i = 0; i < n; i++) {
        const struct aravis_format *f = aravis_format_by_code((guint32)codes[i]);
        if (f)
            g_string_append_printf(names, "%s%s", names->len ? ", " : "", f->name);
    }
    if (!format && !names->len)
        return device_error_set(
            error, DEVICE_ERROR_UNSUPPORTED, NULL,
            "it offers no Mono or Bayer format that can be used for measuring" ERROR_ADVICE
            "use another camera");
    if (!format)
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, NULL,
                                "pixel_format: it does not offer \"%s\"" ERROR_ADVICE
                                "choose from: %s",
                                wanted, names->str);
    device->limits.format = format;
    device->limits.bits = device->options->bits > 0 ? device->options->bits : format->bits;
    arv_camera_set_pixel_format(device->camera, format->code, &why);
    return aravis_error_take(why, format->name, error);
}

static gboolean set_region(AravisDevice *device, GError **error) {
    const struct aravis_options *options = device->options;
    int sensor_width = 0, sensor_height = 0, x, y;
    struct aravis_limits *limits = &device->limits;
    GError *why = NULL;
    arv_camera_get_sensor_size(device->camera, &sensor_width, &sensor_height, &why);
    if (!aravis_error_take(why, "SensorWidth", error))
        return FALSE;
    int width = options->width > 0 ? options->width : sensor_width - options->offset_x;
    int height = options->height > 0 ? options->height : sensor_height - options->offset_y;
    if (width + options->offset_x > sensor_width || height + options->offset_y > sensor_height)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, NULL,
            "a region of %d × %d at %d, %d does not fit its sensor of %d × %d" ERROR_ADVICE
            "correct width, height, offset_x and offset_y",
            width, height, options->offset_x, options->offset_y, sensor_width, sensor_height);
    arv_camera_set_region(device->camera, options->offset_x, options->offset_y, width, height,
                          &why);
    if (why == NULL)
        arv_camera_get_region(device->camera, &x, &y, &limits->width, &limits->height, &why);
    return aravis_error_take(why, "Width, Height, OffsetX, OffsetY", error);
}

static gboolean set_trigger(AravisDevice *device, GError **error) {
    const char *source = device->options->trigger;
    GError *why = NULL;
    if (device_has(device, "TriggerSource") &&
        !arv_camera_is_enumeration_entry_available(device->camera, "TriggerSource", source, NULL)) {
        guint n = 0;
        g_autofree const char **names =
            arv_camera_dup_available_trigger_sources(device->camera, &n, NULL);
        g_autoptr(GString) list = g_string_new(NULL);
        for (guint i = 0; names && i < n; i++)
            g_string_append_printf(list, "%s%s", i ? ", " : "", names[i]);
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, NULL,
                                "trigger: it has no source \"%s\"" ERROR_ADVICE "choose from: %s",
                                source, list->str);
    }
    arv_camera_set_trigger(device->camera, source, &why);
    return aravis_error_take(why, "TriggerSource", error);
}

static gboolean set_limits(AravisDevice *device, GError **error) {
    struct aravis_limits *limits = &device->limits;
    const struct aravis_options *options = device->options;
    double low = 0, high = 0;
    GError *why = NULL;
    limits->black_level = options->black_level_dn;
    limits->rolling =
        device_has(device, "SensorShutterMode") &&
        g_strcmp0(arv_camera_get_string(device->camera, "SensorShutterMode", NULL), "Rolling") == 0;
    if (options->black_level >= 0)
        arv_camera_set_black_level(device->camera, options->black_level, &why);
    if (!aravis_error_take(why, "black_level", error))
        return FALSE;
    arv_camera_get_exposure_time_bounds(device->camera, &low, &high, &why);
    if (!aravis_error_take(why, "ExposureTime", error))
        return FALSE;
    limits->min_exposure_us = (gint64)CLAMP(ceil(low), 1, 1e12);
    limits->max_exposure_us = (gint64)CLAMP(floor(high), (double)limits->min_exposure_us, 1e12);
    if (!arv_camera_is_gain_available(device->camera, NULL))
        return TRUE;
    arv_camera_get_gain_bounds(device->camera, &low, &high, &why);
    limits->min_gain_db = (low - options->gain_zero) / options->gain_per_db;
    limits->max_gain_db = (high - options->gain_zero) / options->gain_per_db;
    return aravis_error_take(why, "Gain", error);
}

static gboolean set_transport(AravisDevice *device, GError **error) {
    const struct aravis_options *options = device->options;
    GError *why = NULL;
    if (!arv_camera_is_gv_device(device->camera))
        return TRUE;
    arv_camera_gv_set_stream_options(
        device->camera, options->packet_socket ? ARV_GV_STREAM_OPTION_NONE
                                               : ARV_GV_STREAM_OPTION_PACKET_SOCKET_DISABLED);
    /* The packet size is negotiated below, so that an error can be reported. */
    arv_camera_gv_set_packet_size_adjustment(device->camera, ARV_GV_PACKET_SIZE_ADJUSTMENT_NEVER);
    if (options->packet_delay_ns > 0)
        arv_camera_gv_set_packet_delay(device->camera, options->packet_delay_ns, &why);
    if (why == NULL && options->packet_size > 0)
        arv_camera_gv_set_packet_size(device->camera, options->packet_size, &why);
    else if (why == NULL)
        arv_camera_gv_auto_packet_size(device->camera, &why);
    return aravis_error_take(why, "packet size", error);
}

static gboolean make_stream(AravisDevice *device, ArvStreamCallback func, gpointer data,
                            GError **error) {
    GError *why = NULL;
    const struct aravis_options *options = device->options;
    const struct aravis_limits *limits = &device->limits;
    int room = options->socket_buffer_kib * 1024;
    device->stream = arv_camera_create_stream(device->camera, func, data, &why);
    guint payload = why ? 0 : arv_camera_get_payload(device->camera, &why);
    if (!aravis_error_take(why, "stream", error))
        return FALSE;
    gsize bytes = aravis_format_bytes(limits->format, limits->width, limits->height);
    if (payload < bytes)
        return device_error_set(
            error, DEVICE_ERROR_PROTOCOL, NULL,
            "it reports frames of %u bytes, but %d × %d pixels %s need %zu" ERROR_ADVICE
            "choose another pixel_format",
            payload, limits->width, limits->height, limits->format->name, bytes);
    if (ARV_IS_GV_STREAM(device->stream)) {
        g_object_set(device->stream, "socket-buffer", ARV_GV_STREAM_SOCKET_BUFFER_FIXED,
                     "socket-buffer-size", room, "initial-packet-timeout",
                     (guint)(options->resend_ms * 1000), "packet-timeout",
                     (guint)(options->resend_ms * 4000), "frame-retention",
                     (guint)(options->retention_ms * 1000), "packet-request-ratio", REQUESTS, NULL);
        /* Aravis sets the size of the receive buffer when the first packet arrives. This is too
         * late for the first frame. */
        socket_buffer_set(arv_gv_stream_get_port(ARV_GV_STREAM(device->stream)), room);
    }
    for (int i = 0; i < N_BUFFERS; i++)
        arv_stream_push_buffer(device->stream, arv_buffer_new(payload, NULL));
    return TRUE;
}

static void device_read_identity(AravisDevice *device) {
    const char *vendor = arv_camera_get_vendor_name(device->camera, NULL);
    const char *model = arv_camera_get_model_name(device->camera, NULL);
    const char *serial = arv_camera_get_device_serial_number(device->camera, NULL);
    g_snprintf(device->limits.model, sizeof device->limits.model, "%s%s%s", vendor ? vendor : "",
               vendor && model ? " " : "", model ? model : "");
    g_strlcpy(device->limits.serial, serial ? serial : "", sizeof device->limits.serial);
}

static void on_unplugged(ArvDevice *arv, gpointer data) {
    AravisDevice *device = data;
    g_atomic_int_set(&device->unplugged, TRUE);
}

AravisDevice *aravis_device_open(const struct aravis_options *options, double control_s,
                                 ArvStreamCallback func, gpointer data, GError **error) {
    g_autoptr(AravisDevice) device = g_new0(AravisDevice, 1);
    GError *why = NULL;
    device->options = options;
    device->device = aravis_connect(options->device, control_s, &device->lock, error);
    if (!device->device)
        return NULL;
    if (ARV_IS_UV_DEVICE(device->device))
        g_signal_connect(device->device, "control-lost", G_CALLBACK(on_unplugged), device);
    device->camera = arv_camera_new_with_device(device->device, &why);
    if (!aravis_error_take(why, options->device, error))
        return NULL;
    if (!device_set_format(device, error) || !set_region(device, error) ||
        !set_raw(device, error) || !set_trigger(device, error) || !set_limits(device, error) ||
        !set_transport(device, error) || !make_stream(device, func, data, error))
        return NULL;
    device_read_identity(device);
    gboolean stamped = options->stamp != ARAVIS_STAMP_NONE;
    if (stamped && ARV_IS_GV_DEVICE(device->device))
        device->ticks_per_us = (double)arv_gv_device_get_timestamp_tick_frequency(
                                   ARV_GV_DEVICE(device->device), NULL) /
                               1e6;
    else if (stamped)
        device->sfnc_clock =
            device_has(device, "TimestampLatch") && device_has(device, "TimestampLatchValue");
    device->n_refs = count_refs(device);
    return g_steal_pointer(&device);
}

/* Waits until Aravis's thread that reports the unplugging has dropped its reference to the device,
 * because that thread must not drop the last one. */
static void await_report(AravisDevice *device) {
    const gint64 limit_us = g_get_monotonic_time() + MAX_REPORT_US;
    while (g_atomic_int_get(&device->unplugged) && count_refs(device) > device->n_refs &&
           g_get_monotonic_time() < limit_us)
        g_usleep(LOOK_REPORT_US);
}

void aravis_device_close(AravisDevice *device) {
    if (!device)
        return;
    await_report(device);
    g_clear_object(&device->stream);
    g_clear_object(&device->camera);
    g_clear_object(&device->device);
    lock_release(device->lock);
    g_strfreev(device->warnings);
    g_free(device);
}

const struct aravis_limits *aravis_device_limits(const AravisDevice *device) {
    return &device->limits;
}

const char *const *aravis_device_warnings(const AravisDevice *device) {
    return (const char *const *)device->warnings;
}

gboolean aravis_device_has_control(AravisDevice *device) {
    if (ARV_IS_GV_DEVICE(device->device))
        return arv_gv_device_is_controller(ARV_GV_DEVICE(device->device));
    return !g_atomic_int_get(&device->unplugged);
}

gboolean aravis_device_may_halt(const AravisDevice *device) {
    return ARV_IS_UV_DEVICE(device->device);
}

gboolean aravis_device_set_exposure(AravisDevice *device, gint64 exposure_us, GError **error) {
    GError *why = NULL;
    arv_camera_set_exposure_time(device->camera, (double)exposure_us, &why);
    double is_us = why ? 0 : arv_camera_get_exposure_time(device->camera, &why);
    if (!aravis_error_take(why, "ExposureTime", error))
        return FALSE;
    return fabs(is_us - (double)exposure_us) <= 1 + 0.005 * (double)exposure_us ||
           device_error_set(error, DEVICE_ERROR_RANGE, NULL,
                            "it exposes for %.1f µs instead of the requested %" G_GINT64_FORMAT
                            " µs" ERROR_ADVICE "choose an exposure that the camera supports",
                            is_us, exposure_us);
}

gboolean aravis_device_set_gain(AravisDevice *device, double gain_db, GError **error) {
    const struct aravis_options *options = device->options;
    GError *why = NULL;
    if (device->limits.min_gain_db == 0 && device->limits.max_gain_db == 0)
        return TRUE;
    arv_camera_set_gain(device->camera, options->gain_zero + gain_db * options->gain_per_db, &why);
    return aravis_error_take(why, "Gain", error);
}

gboolean aravis_device_start(AravisDevice *device, GError **error) {
    GError *why = NULL;
    arv_camera_start_acquisition(device->camera, &why);
    return aravis_error_take(why, "AcquisitionStart", error);
}

gboolean aravis_device_stop(AravisDevice *device, GError **error) {
    GError *why = NULL;
    arv_camera_stop_acquisition(device->camera, &why);
    return aravis_error_take(why, "AcquisitionStop", error);
}

static gboolean pulse(const char *path, GError **error) {
    int fd = open(path, O_WRONLY | O_CLOEXEC | O_NONBLOCK);
    gboolean done = fd >= 0 && write(fd, "1", 1) == 1;
    if (done)
        g_usleep(PULSE_US);
    done = done && write(fd, "0", 1) == 1;
    if (!done)
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                         "pulse_path: cannot make a pulse with %s: %s" ERROR_ADVICE
                         "check the output and who may write to it",
                         path, g_strerror(errno));
    if (fd >= 0)
        close(fd);
    return done;
}

gboolean aravis_device_trigger(AravisDevice *device, GError **error) {
    GError *why = NULL;
    if (!g_str_equal(device->options->trigger, "Software"))
        return pulse(device->options->pulse_path, error);
    arv_camera_software_trigger(device->camera, &why);
    return aravis_error_take(why, "TriggerSoftware", error);
}

ArvBuffer *aravis_device_pop(AravisDevice *device) {
    return arv_stream_try_pop_buffer(device->stream);
}

void aravis_device_push(AravisDevice *device, ArvBuffer *buffer) {
    arv_stream_push_buffer(device->stream, buffer);
}

static gboolean read_clock(AravisDevice *device, double *ret_us, double *ret_after_us) {
    g_autoptr(GError) why = NULL;
    guint32 high = 0, low = 0;
    gint64 ns = 0;
    if (device->ticks_per_us > 0) {
        gboolean latched =
            arv_device_write_register(device->device, STAMP_CONTROL, STAMP_LATCH, NULL);
        *ret_after_us = (double)g_get_monotonic_time();
        gboolean read = latched &&
                        arv_device_read_register(device->device, STAMP_HIGH, &high, NULL) &&
                        arv_device_read_register(device->device, STAMP_LOW, &low, NULL);
        *ret_us = (double)((guint64)high << 32 | low) / device->ticks_per_us;
        return read;
    }
    arv_device_execute_command(device->device, "TimestampLatch", &why);
    *ret_after_us = (double)g_get_monotonic_time();
    if (!why)
        ns = arv_device_get_integer_feature_value(device->device, "TimestampLatchValue", &why);
    *ret_us = (double)ns / 1e3;
    return why == NULL;
}

/* The camera latches its time between request and answer. Of several attempts, the one with the
 * shortest delay is the most exact. */
void aravis_device_ask_clock(AravisDevice *device, struct aravis_clock *ret) {
    *ret = (struct aravis_clock){.error_us = HUGE_VAL};
    if (device->ticks_per_us <= 0 && !device->sfnc_clock)
        return;
    for (int i = 0; i < N_ASKED; i++) {
        double before = (double)g_get_monotonic_time(), theirs = 0, after = 0;
        if (!read_clock(device, &theirs, &after))
            return;
        double error_us = (after - before) / 2;
        if (error_us < ret->error_us)
            *ret = (struct aravis_clock){TRUE, (before + after) / 2 - theirs, error_us};
    }
}
