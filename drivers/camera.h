/*
 * A camera that exposes when it is triggered. Every frame carries the device's own id and time
 * stamp; the class accepts it only if it answers the trigger that waits for it and was exposed
 * after that trigger. A stale or repeated frame is an error, never data.
 */
#pragma once

#include "device.h"
#include "frame.h"

typedef struct Camera Camera;

enum camera_event {
    CAMERA_EXPOSED, /* exposure is over: lamps and axes may change while the frame is read out */
    CAMERA_FRAME,   /* the frame, checked */
    CAMERA_REFUSED, /* stale, repeated, incomplete or of the wrong size: error says why; the
                       trigger is over and may be given again */
    CAMERA_FAULT, /* no frame before the deadline, or the camera is gone; it must be armed again */
};

/* A trigger ends in one CAMERA_FRAME, _REFUSED or _FAULT, with at most one CAMERA_EXPOSED before.
 * frame is set with CAMERA_FRAME (ref it to keep it), error with _REFUSED and _FAULT. */
typedef void (*CameraFunc)(Camera *camera, enum camera_event event, Frame *frame,
                           const GError *error, gpointer data);

struct camera_format { /* filled by the driver's open() */
    int width, height;
    enum cfa cfa;
    int bits;
    double black_level;
    gint64 min_exposure_us, max_exposure_us;
    gint64 trigger_us; /* from the trigger until the exposure begins */
    gint64 readout_us; /* from the end of the exposure until the frame is here */
    gint64 stamp_us;   /* largest error of a frame's exposure_start_us; −1: not known, or the rows
                          are exposed one after the other */
};

struct camera_settings {
    gint64 exposure_us;
    double gain_db;
};

struct camera_driver {
    struct driver_info info;
    gboolean (*open)(Camera *camera, GError **error); /* fills camera->format */
    /* May be NULL. If a camera takes long to open, open() only starts this in a thread, and
     * opened() waits until it is done and fills camera->format, so that several cameras are opened
     * at once. */
    gboolean (*opened)(Camera *camera, GError **error);
    void (*close)(Camera *camera);
    /* Takes effect for the next trigger; called only while no trigger waits. */
    gboolean (*configure)(Camera *camera, const struct camera_settings *settings, GError **error);
    gboolean (*arm)(Camera *camera, GError **error); /* ready for triggers; buffers queued */
    void (*disarm)(Camera *camera);
    /* Start one exposure. Ended by camera_report_frame() or camera_report_fault(). shot is to be
     * put into the frame; a simulated camera also makes its noise a function of it. */
    gboolean (*trigger)(Camera *camera, guint64 shot, GError **error);
};

struct Camera {
    struct device device;
    const struct camera_driver *driver;
    struct camera_format format;
    struct camera_state *state;
};

/* Opens in two steps, so that several cameras open at once. After the first step a camera may only
 * be finished or closed; if finishing fails it must still be closed. */
Camera *camera_open_begin(const struct camera_driver *driver, const struct config_section *section,
                          const char *const *also, Clock *clock, GError **error);
gboolean camera_open_finish(Camera *camera, GError **error);

/* Calls camera_open_begin() and camera_open_finish(). */
Camera *camera_open(const struct camera_driver *driver, const struct config_section *section,
                    const char *const *also, Clock *clock, GError **error);
void camera_close(Camera *camera); /* disarms; NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Camera, camera_close)

void camera_listen(Camera *camera, CameraFunc func, gpointer data);

/* Refuses an exposure outside the camera's range, and any change while a trigger waits. Setting
 * what is set already costs nothing. */
gboolean camera_configure(Camera *camera, const struct camera_settings *settings, GError **error);
gboolean camera_arm(Camera *camera, GError **error);
void camera_disarm(Camera *camera); /* a trigger that waits ends without an event */

/* Allows one trigger at a time. Each frame has its own shot number; a retake keeps it. */
gboolean camera_trigger(Camera *camera, guint64 shot, GError **error);
gboolean camera_is_armed(const Camera *camera);
gboolean camera_is_waiting(const Camera *camera);

/* For drivers, from the main loop's thread. report_frame takes the reference; a frame nobody waits
 * for is dropped and remembered, so that it is not taken for an answer later. */
void camera_report_exposed(Camera *camera);
void camera_report_frame(Camera *camera, Frame *frame);
void camera_report_fault(Camera *camera, GError *error); /* takes ownership */
