/*
 * A GenICam camera through Aravis, GigE Vision or USB3 Vision, with calls that block: for the
 * driver's own thread (worker.h). Errors are DEVICE_ERROR, without the camera's name.
 */
#pragma once

#include <arv.h>

#include "drivers/device.h"
#include "pixels.h"

enum aravis_stamp { ARAVIS_STAMP_START, ARAVIS_STAMP_END, ARAVIS_STAMP_NONE };

struct aravis_options { /* as the rig file says; camera.c has their table */
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
    double black_level;
    gint64 min_exposure_us, max_exposure_us;
    double min_gain_db, max_gain_db; /* both 0: it has none */
    gboolean rolling;                /* it says that its rows are exposed one after the other */
    char model[128], serial[64];     /* as the camera reports them; "": it does not */
};

/* Connects, takes control (waiting up to control_s for another program to release it), sets
 * everything up and creates the stream. func is called in Aravis's stream thread. */
AravisDevice *aravis_device_open(const struct aravis_options *options, double control_s,
                                 ArvStreamCallback func, gpointer data, GError **error);
void aravis_device_close(AravisDevice *device); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(AravisDevice, aravis_device_close)

const struct aravis_limits *aravis_device_limits(const AravisDevice *device);

/* The functions that alter the camera's frames and could not be switched off, one text each,
 * NULL-terminated. Owned by the device. */
const char *const *aravis_device_warnings(const AravisDevice *device);

/* Tells what Aravis knows, without a request to the camera. */
gboolean aravis_device_has_control(AravisDevice *device);

/* TRUE: the camera has to be opened again after a frame has not come. The endpoint of a USB
 * camera's stream may be halted then, and Aravis clears that only when it opens the camera. */
gboolean aravis_device_may_halt(const AravisDevice *device);

/* Fails if the camera rounds the exposure by more than 0.5 % + 1 µs. */
gboolean aravis_device_set_exposure(AravisDevice *device, gint64 exposure_us, GError **error);
gboolean aravis_device_set_gain(AravisDevice *device, double gain_db, GError **error);

gboolean aravis_device_start(AravisDevice *device, GError **error);
gboolean aravis_device_stop(AravisDevice *device, GError **error);

/* Triggers the camera by its software command, or by a pulse on its input line. */
gboolean aravis_device_trigger(AravisDevice *device, GError **error);

/* Returns a buffer that has arrived, or NULL. The caller returns it by aravis_device_push(). */
ArvBuffer *aravis_device_pop(AravisDevice *device);
void aravis_device_push(AravisDevice *device, ArvBuffer *buffer);

/* The camera's clock relative to g_get_monotonic_time(): ours = camera's + offset, known to ±
 * error_us. valid is FALSE if it has no clock that can be asked. */
struct aravis_clock {
    gboolean valid;
    double offset_us, error_us;
};
void aravis_device_ask_clock(AravisDevice *device, struct aravis_clock *ret);

/* Replaces why, an error of Aravis, by an error that names what failed. Returns TRUE if why is
 * NULL. */
gboolean aravis_device_check(GError *why, const char *what, GError **error);

/* TRUE for errors after which the camera has to be opened again. */
gboolean aravis_device_is_lost(const GError *error);
