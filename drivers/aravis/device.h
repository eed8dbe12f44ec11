/*
 * A GenICam camera (GigE Vision or USB3 Vision) through Aravis. The calls block, so they are made
 * by the driver's own thread (worker.h). Errors are DEVICE_ERROR, without the camera's name.
 */
#pragma once

#include <arv.h>

#include "drivers/device.h"
#include "pixels.h"

enum aravis_stamp { ARAVIS_STAMP_START, ARAVIS_STAMP_END, ARAVIS_STAMP_NONE };

struct aravis_options { /* values from the rig file; their table is in camera.c */
    char *device, *pixel_format, *trigger, *pulse_path;
    int width, height, offset_x, offset_y, bits;
    double black_level, black_level_dn;
    double gain_zero, gain_per_db;
    double trigger_ms, readout_ms;
    int stamp;
    int packet_size, packet_delay_ns, socket_buffer_kib;
    gboolean packet_socket;
    double resend_ms, retention_ms;
    char **features;
};

typedef struct AravisDevice AravisDevice;

struct aravis_limits {
    int width, height;
    const struct aravis_format *format;
    int bits;
    double black_level; /* black_level_dn of the rig file: value of frames in the dark, in DN */
    gint64 min_exposure_us, max_exposure_us;
    double min_gain_db, max_gain_db; /* both 0 if the camera has no gain */
    gboolean rolling;            /* the camera reports that rows are exposed one after the other */
    char model[128], serial[64]; /* as the camera reports them, or empty */
};

/* Connects, takes control of the camera, sets everything up and creates the stream. Waits up to
 * control_s seconds for another program to release the camera. The struct `options` is not copied
 * and must stay valid until the device is closed. `func` is called in Aravis's stream thread.
 * Returns NULL with an error on failure. */
AravisDevice *aravis_device_open(const struct aravis_options *options, double control_s,
                                 ArvStreamCallback func, gpointer data, GError **error);
void aravis_device_close(AravisDevice *device); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(AravisDevice, aravis_device_close)

const struct aravis_limits *aravis_device_limits(const AravisDevice *device);

/* Returns one text for each function that alters the camera's frames and that could not be switched
 * off. The array is NULL-terminated and owned by the device. */
const char *const *aravis_device_warnings(const AravisDevice *device);

/* Returns whether this program still controls the camera (GigE), or whether the camera is still
 * plugged in (USB), as far as Aravis knows. Sends no request to the camera. */
gboolean aravis_device_has_control(AravisDevice *device);

/* Returns TRUE if the camera has to be opened again after a frame that did not come. The
 * endpoint of a USB camera's stream may be halted then, and Aravis clears it only when it opens
 * the camera. */
gboolean aravis_device_may_halt(const AravisDevice *device);

/* Fails with DEVICE_ERROR_RANGE if the camera rounds the exposure by more than 0.5 % + 1 µs. */
gboolean aravis_device_set_exposure(AravisDevice *device, gint64 exposure_us, GError **error);
/* Does nothing if the camera has no gain. */
gboolean aravis_device_set_gain(AravisDevice *device, double gain_db, GError **error);

/* Start and stop the acquisition. */
gboolean aravis_device_start(AravisDevice *device, GError **error);
gboolean aravis_device_stop(AravisDevice *device, GError **error);

/* Triggers the camera by its software command, or by a pulse on its input line. */
gboolean aravis_device_trigger(AravisDevice *device, GError **error);

/* Returns a buffer that has arrived, or NULL. The caller returns it by aravis_device_push(). */
ArvBuffer *aravis_device_pop(AravisDevice *device);
void aravis_device_push(AravisDevice *device, ArvBuffer *buffer);

/* The camera's clock relative to g_get_monotonic_time(). The time of g_get_monotonic_time() is the
 * camera's time in µs + offset_us, with an uncertainty of ± error_us. `valid` is FALSE if the
 * camera has no clock that can be read. */
struct aravis_clock {
    gboolean valid;
    double offset_us, error_us;
};
void aravis_device_ask_clock(AravisDevice *device, struct aravis_clock *ret);
