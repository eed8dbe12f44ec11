#include "answer.h"

#include <math.h>
#include <string.h>

/* The clock of the camera may run this much faster or slower than that of this computer, in µs per
 * µs. */
#define DRIFT       100e-6
#define ROUNDING_US 20

/* Block ids of GigE Vision have 16 bits, and 0 is left out: 1 follows ID_TURN. An id below ID_EARLY
 * after an id above ID_LATE shows that the camera has begun again with 1. */
#define ID_TURN  65535
#define ID_LATE  60000
#define ID_EARLY 5000

void answer_begin(struct answer_state *state) {
    state->base = state->last_raw = 0;
}

static guint64 extend_id(struct answer_state *state, guint64 raw) {
    if (raw < ID_EARLY && state->last_raw > ID_LATE && state->last_raw <= ID_TURN)
        state->base += ID_TURN;
    state->last_raw = raw;
    return state->base + raw;
}

/* Converts a time stamp of the camera to the start of the exposure on the scale of
 * g_get_monotonic_time(). Sets *ret_before_us to the time from that start to the trigger. Returns
 * FALSE if that time exceeds the uncertainty of the clocks, because the frame was then exposed
 * before the trigger. A start before the trigger by less than the uncertainty becomes the time of
 * the trigger. An end in the future by less than the uncertainty becomes the present time. */
static gboolean map_stamp(const struct answer_state *state, double stamp_us, gint64 *ret_start_us,
                          gint64 *ret_before_us) {
    gint64 now = g_get_monotonic_time();
    gint64 slack =
        (gint64)(state->clock.error_us + DRIFT * (double)(now - state->asked_us)) + ROUNDING_US;
    gint64 start = (gint64)(stamp_us + state->clock.offset_us);
    if (state->stamp_is_end)
        start -= state->exposure_us;
    *ret_before_us = state->sent_us - start;
    if (*ret_before_us > slack)
        return FALSE;
    gint64 ahead = start + state->exposure_us - now;
    if (ahead > 0 && ahead <= slack)
        start -= ahead;
    *ret_start_us = MAX(start, state->sent_us);
    return TRUE;
}

static gboolean map_time(const struct answer_state *state, ArvBuffer *buffer, gint64 *ret_start_us,
                         gint64 *ret_before_us) {
    guint64 stamp_ns = arv_buffer_get_timestamp(buffer);
    *ret_start_us = state->sent_us;
    if (state->clock.valid && stamp_ns > 0)
        return map_stamp(state, (double)stamp_ns / 1e3, ret_start_us, ret_before_us);
    if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS)
        return TRUE; /* the frame is incomplete, and drivers/camera.c refuses it */
    /* Without a clock of the camera, check only that the frame began to arrive after the
     * trigger. */
    gint64 real_us = (gint64)(arv_buffer_get_system_timestamp(buffer) / 1000);
    gint64 came_us = g_get_monotonic_time() - (g_get_real_time() - real_us);
    *ret_before_us = state->sent_us - came_us;
    return *ret_before_us <= 0;
}

static Frame *answer_unpack(const struct answer_state *state, ArvBuffer *buffer, GError **error) {
    const struct aravis_limits *limits = state->limits;
    gsize n = (gsize)limits->width * (gsize)limits->height;
    if (arv_buffer_get_status(buffer) != ARV_BUFFER_STATUS_SUCCESS) {
        Frame *frame = frame_new(limits->width, limits->height);
        memset(frame->pixels, 0, n * sizeof *frame->pixels);
        frame->incomplete = TRUE;
        return frame;
    }
    guint32 code = arv_buffer_get_image_pixel_format(buffer);
    int width = arv_buffer_get_image_width(buffer), height = arv_buffer_get_image_height(buffer);
    if (code != limits->format->code || width != limits->width || height != limits->height) {
        device_error_set(
            error, DEVICE_ERROR_PROTOCOL, NULL,
            "its frame has %d × %d pixels of the format 0x%08x, but the camera was set to %d × %d "
            "pixels of the format 0x%08x (%s)" ERROR_ADVICE
            "end any other program that changes the camera's settings",
            width, height, code, limits->width, limits->height, limits->format->code,
            limits->format->name);
        return NULL;
    }
    g_autoptr(Frame) frame = frame_new(width, height);
    gsize size = 0, needed = aravis_format_bytes(limits->format, width, height);
    const guint8 *bytes = arv_buffer_get_data(buffer, &size);
    if (size < needed) {
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                         "its frame has %zu bytes, but %d × %d pixels %s need %zu" ERROR_ADVICE
                         "check its cable",
                         size, width, height, limits->format->name, needed);
        return NULL;
    }
    aravis_unpack(limits->format, bytes, n, frame->pixels);
    guint all = 0;
    for (gsize i = 0; i < n; i++)
        all |= frame->pixels[i];
    if (all >> limits->bits) {
        device_error_set(error, DEVICE_ERROR_PROTOCOL, NULL,
                         "a value in its frame has more than %d bits" ERROR_ADVICE
                         "check bits and pixel_format in its section: a camera that shifts its "
                         "values to the upper bits of 16 needs bits = 16",
                         limits->bits);
        return NULL;
    }
    return g_steal_pointer(&frame);
}

Frame *answer_frame(struct answer_state *state, ArvBuffer *buffer, gint64 *ret_before_us,
                    GError **error) {
    const struct aravis_limits *limits = state->limits;
    gint64 start_us;
    if (!map_time(state, buffer, &start_us, ret_before_us))
        return NULL;
    Frame *frame = answer_unpack(state, buffer, error);
    if (!frame)
        return NULL;
    frame->shot = state->shot;
    frame->id = extend_id(state, arv_buffer_get_frame_id(buffer));
    frame->exposure_us = state->exposure_us;
    frame->exposure_start_us = start_us;
    frame->exposure_end_us = start_us + state->exposure_us;
    frame->cfa = limits->format->cfa;
    frame->bits = limits->bits;
    frame->black_level = limits->black_level;
    return frame;
}
