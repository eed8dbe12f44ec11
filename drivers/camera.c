#include "camera.h"

#include "recording.h"

#include <math.h>
#include <string.h>

/* The deadline of a trigger is its delay + exposure + 3 read-outs + 2 s. */
#define DEADLINE_READOUTS 3
#define DEADLINE_EXTRA_US (2 * G_USEC_PER_SEC)

/* Largest accepted error of the start and end of an exposure, which come from the camera's time
 * stamp and are converted to the Clock's scale. */
#define STAMP_TOLERANCE_US 1000

#define N_SEEN     8
#define HASH_LANES 8

struct seen {
    guint64 hash, shot;
};

struct camera_state {
    CameraFunc func;
    gpointer data;
    struct camera_settings settings;
    gboolean configured, armed, waiting, exposed;
    guint64 shot;
    gint64 triggered_us;
    guint deadline;
    guint64 last_id;
    gboolean has_last_id;
    struct seen seen[N_SEEN]; /* the latest frames, in a ring buffer */
    guint n_seen;
};

static void camera_free(Camera *camera) {
    device_clear(&camera->device);
    g_free(camera->state);
    g_free(camera);
}

Camera *camera_open_begin(const struct camera_driver *driver, const struct config_section *section,
                          const char *const *also, Clock *clock, GError **error) {
    Camera *camera = g_new0(Camera, 1);
    camera->driver = driver;
    camera->state = g_new0(struct camera_state, 1);
    if (!device_init(&camera->device, &driver->info, section, also, clock, error) ||
        !driver->open(camera, error)) {
        camera_free(camera);
        return NULL;
    }
    return camera;
}

gboolean camera_open_finish(Camera *camera, GError **error) {
    const struct camera_format *f = &camera->format;
    const char *who = camera->device.who;
    if (!device_record_opened(&camera->device,
                              !camera->driver->opened || camera->driver->opened(camera, error),
                              error))
        return FALSE;
    if (f->width < 1 || f->height < 1 || f->width > 65536 || f->height > 65536)
        return device_error_set(
            error, DEVICE_ERROR_PROTOCOL, who,
            "its driver reports frames of %d × %d pixels, but 1 to 65536 pixels are "
            "possible in each direction" ERROR_ADVICE "correct the size in its section",
            f->width, f->height);
    if (f->bits < 1 || f->bits > 16)
        return device_error_set(
            error, DEVICE_ERROR_PROTOCOL, who,
            "its driver reports values of %d bits, but 1 to 16 bits are possible" ERROR_ADVICE
            "correct the pixel format in its section",
            f->bits);
    if (f->min_exposure_us < 1 || f->min_exposure_us > f->max_exposure_us)
        return device_error_set(
            error, DEVICE_ERROR_PROTOCOL, who,
            "its driver reports exposures of %" G_GINT64_FORMAT " to %" G_GINT64_FORMAT
            " µs, which is not a range above 0" ERROR_ADVICE
            "correct the exposures in its section or in the answer of its program",
            f->min_exposure_us, f->max_exposure_us);
    if (f->readout_us < 0 || f->trigger_us < 0 || f->stamp_us < -1)
        return device_error_set(
            error, DEVICE_ERROR_PROTOCOL, who,
            "its driver reports a negative time: read-out %" G_GINT64_FORMAT
            " µs, delay of the trigger %" G_GINT64_FORMAT
            " µs, error of time stamps %" G_GINT64_FORMAT " µs (−1: not known)" ERROR_ADVICE
            "correct these times in its section or in the answer of its program",
            f->readout_us, f->trigger_us, f->stamp_us);
    return isfinite(f->black_level) ||
           device_error_set(
               error, DEVICE_ERROR_PROTOCOL, who,
               "its driver reports the black level %g, which is not a finite number" ERROR_ADVICE
               "correct the black level in its section or in the answer of its program",
               f->black_level);
}

void camera_close(Camera *camera) {
    if (!camera)
        return;
    camera->state->func = NULL;
    camera_disarm(camera);
    recording_device(camera->device.who, "close");
    camera->driver->close(camera);
    camera_free(camera);
}

void camera_listen(Camera *camera, CameraFunc func, gpointer data) {
    camera->state->func = func;
    camera->state->data = data;
}

static void record(const Camera *camera, enum camera_event event, const Frame *frame,
                   const GError *error) {
    const char *who = camera->device.who;
    if (event == CAMERA_EXPOSED)
        recording_device(who, "= exposed");
    else if (frame)
        recording_device(who, "= frame of %d x %d pixels, %d bits, %s", frame->width, frame->height,
                         frame->bits, cfa_name(frame->cfa));
    else
        recording_device(who, "= %s: %s", event == CAMERA_REFUSED ? "refused" : "fault",
                         error->message);
}

/* Tells the listener of an event. Call it last, because the listener may close the camera. */
static void notify(Camera *camera, enum camera_event event, Frame *frame, const GError *error) {
    record(camera, event, frame, error);
    if (camera->state->func)
        camera->state->func(camera, event, frame, error, camera->state->data);
}

static gboolean check_not_waiting(const Camera *camera, GError **error) {
    if (!camera->state->waiting)
        return TRUE;
    return device_error_set(
        error, DEVICE_ERROR_BUSY, camera->device.who,
        "it still waits for the frame of its last trigger, of shot %" G_GUINT64_FORMAT ERROR_ADVICE
        "try again when that frame has arrived",
        camera->state->shot);
}

/* Returns the exposure time of the camera's list that is nearest to exposure_us. Returns
 * exposure_us if the camera has no list. */
static gint64 nearest_us(const Camera *camera, gint64 exposure_us) {
    const struct camera_format *format = &camera->format;
    gint64 nearest = exposure_us;
    for (int i = 0; i < format->n_exposures; i++)
        if (i == 0 || ABS(format->exposures_us[i] - exposure_us) < ABS(nearest - exposure_us))
            nearest = format->exposures_us[i];
    return nearest;
}

gboolean camera_can_expose(const Camera *camera, gint64 exposure_us) {
    const gint64 nearest = nearest_us(camera, exposure_us);
    return exposure_us >= camera->format.min_exposure_us &&
           exposure_us <= camera->format.max_exposure_us &&
           ABS(nearest - exposure_us) <= MAX(1, nearest / 1000);
}

gboolean camera_configure(Camera *camera, const struct camera_settings *settings, GError **error) {
    struct camera_state *state = camera->state;
    const struct camera_format *format = &camera->format;
    if (!check_not_waiting(camera, error))
        return FALSE;
    if (settings->exposure_us < format->min_exposure_us ||
        settings->exposure_us > format->max_exposure_us)
        return device_error_set(
            error, DEVICE_ERROR_RANGE, camera->device.who,
            "it cannot expose for %" G_GINT64_FORMAT " µs, only %" G_GINT64_FORMAT
            " to %" G_GINT64_FORMAT " µs" ERROR_ADVICE "choose an exposure in this range",
            settings->exposure_us, format->min_exposure_us, format->max_exposure_us);
    if (!camera_can_expose(camera, settings->exposure_us))
        return device_error_set(error, DEVICE_ERROR_RANGE, camera->device.who,
                                "it cannot expose for %" G_GINT64_FORMAT
                                " µs; the nearest time that it has is %" G_GINT64_FORMAT " µs",
                                settings->exposure_us, nearest_us(camera, settings->exposure_us));
    if (!isfinite(settings->gain_db))
        return device_error_set(error, DEVICE_ERROR_RANGE, camera->device.who,
                                "a gain of %g dB is not a finite number" ERROR_ADVICE
                                "correct gain_db",
                                settings->gain_db);
    if (state->configured && state->settings.exposure_us == settings->exposure_us &&
        state->settings.gain_db == settings->gain_db)
        return TRUE;
    recording_device(camera->device.who, "expose for %" G_GINT64_FORMAT " us, gain %g dB",
                     settings->exposure_us, settings->gain_db);
    state->configured = camera->driver->configure(camera, settings, error);
    state->settings = *settings;
    return state->configured;
}

gboolean camera_arm(Camera *camera, GError **error) {
    struct camera_state *state = camera->state;
    if (state->armed)
        return TRUE;
    recording_device(camera->device.who, "arm");
    if (!camera->driver->arm(camera, error))
        return FALSE;
    state->armed = TRUE;
    state->has_last_id = FALSE; /* many cameras restart their frame ids here */
    return TRUE;
}

static void end_wait(Camera *camera) {
    clock_cancel(camera->device.clock, &camera->state->deadline);
    camera->state->waiting = FALSE;
}

void camera_disarm(Camera *camera) {
    end_wait(camera);
    if (!camera->state->armed)
        return;
    camera->state->armed = FALSE;
    recording_device(camera->device.who, "disarm");
    camera->driver->disarm(camera);
}

static void fault(Camera *camera, const GError *error) {
    camera_disarm(camera);
    notify(camera, CAMERA_FAULT, NULL, error);
}

static void on_deadline(gpointer data) {
    Camera *camera = data;
    camera->state->deadline = 0;
    g_autoptr(GError) error = device_error_new(
        DEVICE_ERROR_TIMEOUT, camera->device.who,
        "no frame has arrived %.1f s after the trigger (exposure %" G_GINT64_FORMAT
        " µs)" ERROR_ADVICE "check the camera's cable",
        (double)(clock_now_us(camera->device.clock) - camera->state->triggered_us) / 1e6,
        camera->state->settings.exposure_us);
    fault(camera, error);
}

gboolean camera_trigger(Camera *camera, guint64 shot, GError **error) {
    struct camera_state *state = camera->state;
    if (!check_not_waiting(camera, error))
        return FALSE;
    if (!state->armed || !state->configured)
        return device_error_set(error, DEVICE_ERROR_UNSUPPORTED, camera->device.who,
                                "it cannot be triggered before it is %s",
                                state->armed ? "configured" : "armed");
    recording_device(camera->device.who, "trigger");
    state->waiting = TRUE;
    state->exposed = FALSE;
    state->shot = shot;
    state->triggered_us = clock_now_us(camera->device.clock);
    if (!camera->driver->trigger(camera, shot, error)) {
        state->waiting = FALSE;
        return FALSE;
    }
    gint64 wait_us = camera->format.trigger_us + state->settings.exposure_us +
                     DEADLINE_READOUTS * camera->format.readout_us + DEADLINE_EXTRA_US;
    state->deadline = clock_call_in(camera->device.clock, wait_us, on_deadline, camera);
    return TRUE;
}

gboolean camera_is_armed(const Camera *camera) {
    return camera->state->armed;
}

gboolean camera_is_waiting(const Camera *camera) {
    return camera->state->waiting;
}

/* Adds a word to a hash. For a given hash, different words give different results. The rotation
 * moves the highest bits of a word to a place from which the multiplication spreads them. */
static inline guint64 hash_step(guint64 hash, guint64 word) {
    hash = (hash ^ word) * 0x9e3779b97f4a7c15u;
    return hash << 29 | hash >> 35;
}

/* Returns the hash of a frame. It is computed in independent lanes, so that the processor can
 * overlap their multiplications. Returns 0 for a frame with the same value in all pixels, as a
 * covered or saturated camera may give. A repetition of such a frame cannot be recognised. */
static guint64 hash_frame(const Frame *frame) {
    gsize n = (gsize)frame->width * (gsize)frame->height, i = 0;
    if (memcmp(frame->pixels, frame->pixels + 1, (n - 1) * sizeof *frame->pixels) == 0)
        return 0;
    guint64 lanes[HASH_LANES], hash = n;
    for (guint64 k = 0; k < HASH_LANES; k++)
        lanes[k] = 0xcbf29ce484222325u + k;
    for (; i + 4 * HASH_LANES <= n; i += 4 * HASH_LANES) {
        guint64 words[HASH_LANES];
        memcpy(words, frame->pixels + i, sizeof words);
#pragma GCC unroll 8
        for (int k = 0; k < HASH_LANES; k++)
            lanes[k] = hash_step(lanes[k], words[k]);
    }
    for (; i < n; i++)
        hash = hash_step(hash, frame->pixels[i]);
    for (int k = 0; k < HASH_LANES; k++)
        hash = hash_step(hash, lanes[k]);
    return hash ? hash : 1;
}

static void remember(Camera *camera, const Frame *frame, guint64 hash) {
    struct camera_state *state = camera->state;
    if (!state->has_last_id || frame->id > state->last_id)
        state->last_id = frame->id;
    state->has_last_id = TRUE;
    state->seen[state->n_seen++ % N_SEEN] = (struct seen){hash, frame->shot};
}

static gboolean refuse(const Camera *camera, enum device_error code, GError **error,
                       const char *format, ...) G_GNUC_PRINTF(4, 5);
static gboolean refuse(const Camera *camera, enum device_error code, GError **error,
                       const char *format, ...) {
    va_list args;
    va_start(args, format);
    g_autofree char *what = g_strdup_vprintf(format, args);
    va_end(args);
    return device_error_set(error, code, camera->device.who, "frame refused: %s", what);
}
static gboolean check_times(const Camera *camera, const Frame *frame, GError **error) {
    const struct camera_state *state = camera->state;
    gint64 before_us = state->triggered_us - frame->exposure_start_us;
    if (before_us > 0)
        return refuse(camera, DEVICE_ERROR_STALE, error,
                      "its exposure began %" G_GINT64_FORMAT " µs before the trigger", before_us);
    gint64 asked_us = state->settings.exposure_us;
    gint64 took_us = frame->exposure_end_us - frame->exposure_start_us;
    if (frame->exposure_us != asked_us)
        return refuse(camera, DEVICE_ERROR_PROTOCOL, error,
                      "it was exposed with the setting %" G_GINT64_FORMAT
                      " µs instead of the requested %" G_GINT64_FORMAT " µs",
                      frame->exposure_us, asked_us);
    if (ABS(took_us - asked_us) > STAMP_TOLERANCE_US + asked_us / 20)
        return refuse(camera, DEVICE_ERROR_PROTOCOL, error,
                      "by its time stamps it was exposed for %" G_GINT64_FORMAT
                      " µs instead of the requested %" G_GINT64_FORMAT " µs",
                      took_us, asked_us);
    if (frame->exposure_end_us > clock_now_us(camera->device.clock) + STAMP_TOLERANCE_US)
        return refuse(camera, DEVICE_ERROR_PROTOCOL, error,
                      "its time stamp is in the future, by %" G_GINT64_FORMAT " µs",
                      frame->exposure_end_us - clock_now_us(camera->device.clock));
    return TRUE;
}

static gboolean check_frame(const Camera *camera, const Frame *frame, guint64 hash,
                            GError **error) {
    const struct camera_state *state = camera->state;
    const struct camera_format *format = &camera->format;
    if (frame->shot != state->shot)
        return refuse(camera, DEVICE_ERROR_STALE, error,
                      "it belongs to shot %" G_GUINT64_FORMAT ", but shot %" G_GUINT64_FORMAT
                      " was triggered",
                      frame->shot, state->shot);
    if (state->has_last_id && frame->id <= state->last_id)
        return refuse(camera, DEVICE_ERROR_STALE, error,
                      "it is an old frame: its frame id %" G_GUINT64_FORMAT
                      " is not above that of the last frame, %" G_GUINT64_FORMAT,
                      frame->id, state->last_id);
    if (frame->width != format->width || frame->height != format->height ||
        frame->cfa != format->cfa || frame->bits != format->bits)
        return refuse(camera, DEVICE_ERROR_PROTOCOL, error,
                      "it has %d × %d pixels %s of %d bits, but the camera is set to %d × %d "
                      "pixels %s of %d bits",
                      frame->width, frame->height, cfa_name(frame->cfa), frame->bits, format->width,
                      format->height, cfa_name(format->cfa), format->bits);
    if (frame->incomplete)
        return refuse(camera, DEVICE_ERROR_PROTOCOL, error,
                      "some of its data was lost on the way" ERROR_ADVICE
                      "check the camera's cable");
    if (!check_times(camera, frame, error))
        return FALSE;
    for (guint i = 0; hash && i < MIN(state->n_seen, N_SEEN); i++)
        if (state->seen[i].hash == hash && state->seen[i].shot != state->shot)
            return refuse(camera, DEVICE_ERROR_STALE, error,
                          "it repeats the frame of shot %" G_GUINT64_FORMAT " bit for bit",
                          state->seen[i].shot);
    return TRUE;
}

void camera_report_exposed(Camera *camera) {
    struct camera_state *state = camera->state;
    if (!state->waiting || state->exposed)
        return;
    state->exposed = TRUE;
    notify(camera, CAMERA_EXPOSED, NULL, NULL);
}

void camera_report_frame(Camera *camera, Frame *frame) {
    g_autoptr(Frame) owned = frame;
    g_autoptr(GError) error = NULL;
    guint64 hash = hash_frame(frame);
    if (!camera->state->waiting) {
        remember(camera, frame, hash);
        return;
    }
    gboolean accepted = check_frame(camera, frame, hash, &error);
    if (accepted)
        remember(camera, frame, hash);
    end_wait(camera);
    notify(camera, accepted ? CAMERA_FRAME : CAMERA_REFUSED, accepted ? frame : NULL, error);
}

void camera_report_fault(Camera *camera, GError *error) {
    g_autoptr(GError) owned = error;
    if (!owned)
        owned = device_error_new(DEVICE_ERROR_DISCONNECTED, camera->device.who,
                                 "it has reported a fault without a reason" ERROR_ADVICE
                                 "check the camera and its cable");
    fault(camera, owned);
}
