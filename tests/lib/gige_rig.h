/* A virtual GigE camera (sim/virtual/cameras/gige.h), and the driver's camera that is connected to
 * it. */
#pragma once

#include "aravis/camera.h"
#include "conformance/conformance.h"
#include "virtual/cameras/gige.h"

struct eye {
    VirtualGige *device;
    const char *where; /* device address of a camera that is not GigE; otherwise NULL */
    Clock *clock;
    Camera *camera;
    int n_ended, n_frames, n_exposed;
    enum camera_event last;
    Frame *frame;
    GError *error;
};
VirtualGige *eye_device(const char *serial, int width, int height, enum cfa cfa);
void eye_on_event(Camera *camera, enum camera_event event, Frame *frame, const GError *error,
                  gpointer data);

/* Opens the camera. keys has further lines of its section. Returns FALSE with an error on
 * failure. */
gboolean eye_open(struct eye *eye, const char *keys, GError **error);
gboolean eye_ready(struct eye *eye, gint64 exposure_us, GError **error);
/* calls eye_open() and eye_ready(), which must succeed */
void eye_start(struct eye *eye, const char *keys, gint64 exposure_us);
void eye_close(struct eye *eye);

/* Fixture of a test: makes a camera, opens it with these further lines, and waits until it is
 * ready. */
void eye_begin(struct eye *eye, gconstpointer keys);
void eye_end(struct eye *eye, gconstpointer unused);
void eye_trigger(struct eye *eye, guint64 shot);

/* Triggers once. Waits for the result and returns it. */
enum camera_event eye_shoot(struct eye *eye, guint64 shot);

/* Triggers n cameras at the same time, shots times. Each camera must deliver a picture for every
 * trigger. */
void eye_shoot_together(struct eye *eyes, int n, int shots);

/* Arms and triggers again until a picture arrives, as the sequencer does. Fails after WAIT_S. */
void eye_recover(struct eye *eye, guint64 shot);

/* Waits until the driver refuses to arm a camera that was lost, with this error. */
void eye_expect_lost(struct eye *eye, enum device_error code, const char *words);

/* Checks the time stamps of frames, which the driver maps from the camera's clock to that of this
 * computer, against the times at which the virtual camera was triggered. triggered_us() returns the
 * time of the last trigger. exposure_us is the exposure time of the frames. */
void eye_check_times(struct eye *eye, int shots, gint64 exposure_us,
                     gint64 (*triggered_us)(const struct eye *eye));

/* A pixel format and its bits for eye_check_formats(), which takes a picture of painted.h in each
 * of n formats, and checks that the frame shows what was painted. name is the end of the format's
 * name, such as "12Packed". more has further lines of the section. */
struct eye_depth {
    const char *name;
    int bits;
};
void eye_check_formats(struct eye *eye, enum cfa cfa, const struct eye_depth *depths, int n,
                       const char *more);

/* Checks a part of the picture, the exposure, the gain and the black level of a camera of painted.h
 * with 12 bits and a black level of 64 DN. The camera must be open with EYE_PART. */
#define EYE_PART "width = 32\nheight = 16\noffset_x = 4\noffset_y = 6\nblack_level = 72\n"
void eye_check_part(struct eye *eye);
void eye_check_settings(const struct virtual_camera_state *state);

/* Fails the test unless the last error of the eye has the DEVICE_ERROR code `what` and a message
 * that contains text. */
#define eye_assert_said(eye, what, text)                                                           \
    do {                                                                                           \
        g_assert_error((eye)->error, DEVICE_ERROR, (int)(what));                                   \
        if (!strstr((eye)->error->message, text))                                                  \
            g_error("said \"%s\", not \"%s\"", (eye)->error->message, text);                       \
    } while (0)
