/* A virtual GigE camera (sim/virtual/gige.h) and the driver's camera that looks through it. */
#pragma once

#include "aravis/camera.h"
#include "conformance/conformance.h"
#include "virtual/cameras/gige.h"

struct eye {
    VirtualGige *device;
    const char *where; /* of one that is not GigE; else NULL */
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

/* keys: further lines of its section. FALSE: error says why. */
gboolean eye_open(struct eye *eye, const char *keys, GError **error);
gboolean eye_ready(struct eye *eye, gint64 exposure_us, GError **error);
void eye_start(struct eye *eye, const char *keys, gint64 exposure_us); /* both; must succeed */
void eye_close(struct eye *eye);

/* The fixture of a test: a camera of its own, opened with these further lines, and ready. */
void eye_begin(struct eye *eye, gconstpointer keys);
void eye_end(struct eye *eye, gconstpointer unused);
void eye_trigger(struct eye *eye, guint64 shot);

/* Triggers once and waits for what comes of it. */
enum camera_event eye_shoot(struct eye *eye, guint64 shot);

/* Triggers all of them at the same time, so many times; each must give that many pictures. */
void eye_shoot_together(struct eye *eyes, int n, int shots);

/* Arms and shoots again until a picture comes, as the sequencer does; fails after limit_s. */
void eye_recover(struct eye *eye, guint64 shot);

#define eye_assert_said(eye, what, text)                                                           \
    do {                                                                                           \
        g_assert_error((eye)->error, DEVICE_ERROR, (int)(what));                                   \
        if (!strstr((eye)->error->message, text))                                                  \
            g_error("said \"%s\", not \"%s\"", (eye)->error->message, text);                       \
    } while (0)
