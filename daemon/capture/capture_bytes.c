#include "capture_bytes.h"

#include <math.h>

#include "capture_check.h"
#include "capture_private.h"

/* Minimum relative change of a session's expected disk space that is reported in an event. */
#define BYTES_PART 0.05

/* The footprints of cameras whose frames vary in size. They are computed only once, because neither
 * the camera nor the plane moves. */
static const struct plan_footprint *footprints(Capture *capture) {
    const struct rig *rig = &capture->devices->geometry;
    if (capture->footprints)
        return capture->footprints;
    capture->footprints = g_new0(struct plan_footprint, rig->n_cameras);
    for (int c = 0; c < rig->n_cameras; c++)
        if (plan_bytes_vary(&rig->cameras[c]))
            capture->footprints[c] = plan_footprint(&capture->conf, &rig->cameras[c]);
    return capture->footprints;
}

static double capture_bytes_planned(Capture *capture, const struct session_shot *shot, int camera) {
    return (double)plan_shot_bytes(&capture->conf, &capture->devices->geometry, shot, camera,
                                   capture->devices->timing.bits[camera],
                                   &footprints(capture)[camera]);
}

/* Kept exposures and laser frames have no rows, and have their planned size. */
static gboolean vary(const Capture *capture, int camera) {
    return plan_bytes_vary(&capture->devices->geometry.cameras[camera]) &&
           !capture->conf.keep_exposures && !capture->conf.keep_laser_frames;
}

static void count(Capture *capture, const struct session_shot *shot,
                  const struct session_frame *frame) {
    const int c = frame->camera;
    if (c < 0 || c >= capture->devices->geometry.n_cameras)
        return;
    const double planned = capture_bytes_planned(capture, shot, c);
    const double is =
        vary(capture, c) ? (double)plan_stored_bytes((guint64)MAX(frame->bytes, 0)) : planned;
    capture->bytes[shot->kind][c].sum += is;
    capture->bytes[shot->kind][c].planned += planned;
    capture->stored_bytes += is;
}

/* Returns the ratio of stored to planned bytes for the frames of a kind and camera. Until such a
 * frame is stored, it is the ratio of the other cameras. */
static double ratio(const Capture *capture, int kind, int camera) {
    double sum = 0, planned = 0;
    if (!vary(capture, camera))
        return 1;
    if (capture->bytes[kind][camera].planned > 0)
        return capture->bytes[kind][camera].sum / capture->bytes[kind][camera].planned;
    for (int c = 0; c < capture->devices->geometry.n_cameras; c++)
        if (vary(capture, c)) {
            sum += capture->bytes[kind][c].sum;
            planned += capture->bytes[kind][c].planned;
        }
    return planned > 0 ? sum / planned : 1;
}

/* Returns the expected bytes of the planned shots. Shots that have not been chosen yet are not
 * counted. */
static double capture_bytes_left(Capture *capture) {
    const int n_cameras = capture->devices->geometry.n_cameras;
    double left = 0;
    if (!capture->shot_bytes) {
        capture->shot_bytes = g_new0(float, capture->shots->len *(gsize)n_cameras);
        for (guint i = 0; i < capture->shots->len; i++) {
            const struct session_shot *at = capture->shots->pdata[i];
            for (int c = 0; c < n_cameras; c++)
                if (at->state == SHOT_PLANNED && at->cameras & 1u << c)
                    capture->shot_bytes[i * (guint)n_cameras + (guint)c] =
                        (float)capture_bytes_planned(capture, at, c);
        }
    }
    double ratios[SHOT_SWEEP + 1][RIG_MAX_CAMERAS];
    for (int kind = 0; kind <= SHOT_SWEEP; kind++)
        for (int c = 0; c < n_cameras; c++)
            ratios[kind][c] = ratio(capture, kind, c);
    for (guint i = 0; i < capture->shots->len; i++) {
        const struct session_shot *at = capture->shots->pdata[i];
        if (at->state != SHOT_PLANNED ||
            (capture->adaptive && !adaptive_is_chosen(capture->adaptive, at)))
            continue;
        for (int c = 0; c < n_cameras; c++)
            left +=
                ratios[at->kind][c] * (double)capture->shot_bytes[i * (guint)n_cameras + (guint)c];
    }
    return left;
}

void capture_bytes_begin(Capture *capture, const GPtrArray *frames) {
    g_autoptr(GHashTable) shots = g_hash_table_new(g_int64_hash, g_int64_equal);
    for (guint i = 0; i < capture->shots->len; i++) {
        struct session_shot *shot = capture->shots->pdata[i];
        g_hash_table_insert(shots, &shot->id, shot);
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = g_hash_table_lookup(shots, &frame->shot);
        if (shot && shot->state == SHOT_DONE)
            count(capture, shot, frame);
    }
}

/* The whole list of shots is examined after 1, 2, 3, 4, 6, 8, 12 … shots of this run, and after the
 * first shot of each kind. */
static gboolean is_due(const Capture *capture, gboolean first) {
    guint n = capture->committed;
    while (n > 3 && n % 2 == 0)
        n /= 2;
    return first || n <= 3 || capture->committed == capture->remaining->len;
}

void capture_bytes_add(Capture *capture, const struct session_shot *shot,
                       const struct session_frame *frames, int n) {
    gboolean first = FALSE;
    for (int i = 0; i < n; i++) {
        first |= capture->bytes[shot->kind][frames[i].camera].planned == 0;
        count(capture, shot, &frames[i]);
    }
    if (!is_due(capture, first))
        return;
    const double left = capture_bytes_left(capture);
    const double all =
        capture->stored_bytes + left + (double)plan_database_bytes((int)capture->shots->len);
    capture->expected_bytes = all;
    if (fabs(all / MAX(capture->said_bytes, 1) - 1) <= BYTES_PART)
        return;
    const guint64 free_bytes = capture_free_bytes(session_path(capture->session));
    g_autofree char *size = g_format_size((guint64)all);
    g_autofree char *before = g_format_size((guint64)capture->said_bytes);
    g_autofree char *more = g_format_size((guint64)left);
    g_autofree char *room = g_format_size(free_bytes);
    const gboolean full = left > (double)free_bytes;
    g_autofree char *text =
        g_strdup_printf("judging by the frames stored so far, the session will take about %s "
                        "(expected before: %s), %s more%s%s%s",
                        size, before, more, full ? "; the disk has only " : "", full ? room : "",
                        full ? " free: make room, or the session will pause when it is full" : "");
    capture->said_bytes = all;
    capture_save_value(capture->session, "expected_bytes", all);
    capture_add_event(capture, full ? "warning" : "info", "disk", text);
}
