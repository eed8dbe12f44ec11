/*
 * A camera that exposes when it is triggered. Every frame carries an id and a time stamp from the
 * device. The class accepts a frame only if it answers the trigger that waits for it and was
 * exposed after that trigger. A stale or repeated frame is an error and is never used as data.
 */
#pragma once

#include "device.h"
#include "frame.h"

typedef struct Camera Camera;

enum camera_event {
    /* The exposure has ended. Lamps may be switched and axes may move while the frame is read
     * out. */
    CAMERA_EXPOSED,
    CAMERA_FRAME, /* the frame has arrived and was checked */
    /* The frame is stale, repeated or incomplete, or its format or its times are not as set;
     * error says which. The trigger has ended and may be given again. */
    CAMERA_REFUSED,
    /* No frame arrived before the deadline, or the camera is disconnected. The camera must be armed
     * again. */
    CAMERA_FAULT,
};

/* A trigger ends in one CAMERA_FRAME, CAMERA_REFUSED or CAMERA_FAULT. At most one CAMERA_EXPOSED
 * comes before it. frame is set with CAMERA_FRAME; call frame_ref() to keep it. error is set with
 * CAMERA_REFUSED and CAMERA_FAULT. */
typedef void (*CameraFunc)(Camera *camera, enum camera_event event, Frame *frame,
                           const GError *error, gpointer data);

struct camera_format { /* filled by the driver's open() or opened() */
    int width, height;
    enum cfa cfa;
    int bits;
    double black_level;
    gint64 min_exposure_us, max_exposure_us;
    gint64 trigger_us; /* time from the trigger to the beginning of the exposure */
    gint64 readout_us; /* time from the end of the exposure to the arrival of the frame */
    /* The largest error of a frame's exposure_start_us. It is −1 if the error is not known, or if
     * the rows are exposed one after the other. */
    gint64 stamp_us;
    /* The exposure times of a camera that offers only a list of them, such as a DSLR. NULL if the
     * camera can expose for every time of its range. The driver owns the list. */
    const gint64 *exposures_us;
    int n_exposures;
};

struct camera_settings {
    gint64 exposure_us;
    double gain_db;
};

struct camera_driver {
    struct driver_info info;
    gboolean (*open)(Camera *camera,
                     GError **error); /* fills camera->format unless opened() does */
    /* May be NULL. For a camera that takes long to open, open() only starts to open it in a thread.
     * opened() waits until it is open and fills camera->format. In this way several cameras are
     * opened at the same time. */
    gboolean (*opened)(Camera *camera, GError **error);
    void (*close)(Camera *camera);
    /* Changes the settings for the next trigger. The class calls it only while no trigger waits. */
    gboolean (*configure)(Camera *camera, const struct camera_settings *settings, GError **error);
    /* Makes the camera ready for triggers, with its buffers queued. */
    gboolean (*arm)(Camera *camera, GError **error);
    void (*disarm)(Camera *camera);
    /* Starts one exposure. The driver ends it with camera_report_frame() or camera_report_fault().
     * The driver puts shot into the frame. A simulated camera also derives its noise from shot. */
    gboolean (*trigger)(Camera *camera, guint64 shot, GError **error);
    /* TRUE if the camera offers only a list of exposure times, which is not known before the camera
     * is opened. A session that lets the program choose the exposures ("auto") is then refused. */
    gboolean listed_exposures;
    /* TRUE if stamp_us is −1 for each camera of this driver. A session with motion = continuous is
     * then refused before the camera is opened. */
    gboolean no_stamps;
};

struct Camera {
    struct device device;
    const struct camera_driver *driver;
    struct camera_format format;
    struct camera_state *state;
};

/* Opens a camera in two steps, so that several cameras can be opened at the same time. After the
 * first step a camera may only be finished or closed. If finishing fails, the camera must still be
 * closed. */
Camera *camera_open_begin(const struct camera_driver *driver, const struct config_section *section,
                          const char *const *also, Clock *clock, GError **error);
gboolean camera_open_finish(Camera *camera, GError **error);

void camera_close(Camera *camera); /* disarms the camera; NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Camera, camera_close)

void camera_listen(Camera *camera, CameraFunc func, gpointer data);

/* Changes exposure and gain. Fails while a trigger waits, if the camera does not have the
 * exposure (camera_can_expose()), if the gain is not finite, or if the driver cannot set them.
 * If the settings are the present ones, nothing is sent to the camera. */
gboolean camera_configure(Camera *camera, const struct camera_settings *settings, GError **error);
/* Returns whether the camera has this exposure time. A difference of 0.1 % or 1 µs from a time of
 * the camera's list is allowed, because a time such as 1/60 s is rounded to microseconds. */
gboolean camera_can_expose(const Camera *camera, gint64 exposure_us);
gboolean camera_arm(Camera *camera, GError **error);
void camera_disarm(Camera *camera); /* a trigger that waits ends without an event */

/* Starts one exposure. Only one trigger may wait at a time. shot is the number that the frame will
 * have. A retake has the number of the frame that it repeats. All other frames have different
 * numbers. */
gboolean camera_trigger(Camera *camera, guint64 shot, GError **error);
gboolean camera_is_armed(const Camera *camera);
gboolean camera_is_waiting(const Camera *camera); /* for tests: whether a trigger waits */

/* For drivers: these functions are called from the main loop's thread. camera_report_frame() takes
 * ownership of the reference to the frame. A frame that nobody waits for is dropped. Its id is
 * remembered, so that the same frame is not taken for an answer later. */
void camera_report_exposed(Camera *camera);
void camera_report_frame(Camera *camera, Frame *frame);
void camera_report_fault(Camera *camera, GError *error); /* takes ownership */
