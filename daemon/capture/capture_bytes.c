#include "capture_bytes.h"

#include <math.h>

#include "capture_check.h"

/* Minimum relative change of a session's expected size on disk for which an event is added. */
#define BYTES_PART 0.05

/* Returns an array with the footprint of each camera. It has values only for cameras whose frames
 * vary in size, and is zero for others. The footprints are computed only once, because neither the
 * cameras nor the sample plane move. */
static const struct plan_footprint *footprints(struct capture_bytes *bytes,
                                               const struct capture_session *session) {
    const struct rig *rig = &session->devices->geometry;
    if (bytes->footprints)
        return bytes->footprints;
    bytes->footprints = g_new0(struct plan_footprint, rig->n_cameras);
    for (int c = 0; c < rig->n_cameras; c++)
        if (plan_bytes_vary(&rig->cameras[c]))
            bytes->footprints[c] = plan_footprint(&session->conf, &rig->cameras[c]);
    return bytes->footprints;
}

static double planned_bytes(struct capture_bytes *bytes, const struct capture_session *session,
                            const struct session_shot *shot, int camera) {
    return (double)plan_shot_bytes(&session->conf, &session->devices->geometry, shot, camera,
                                   session->devices->timing.bits[camera],
                                   &footprints(bytes, session)[camera]);
}

/* Returns whether the sizes of a camera's frames vary and are therefore measured. If exposures or
 * laser frames are kept, the result is FALSE, because the rows of the database lack the sizes of
 * kept frames. All frames then count with their planned sizes. */
static gboolean vary(const struct capture_session *session, int camera) {
    return plan_bytes_vary(&session->devices->geometry.cameras[camera]) &&
           !session->conf.keep_exposures && !session->conf.keep_laser_frames;
}

static void count(struct capture_bytes *bytes, const struct capture_session *session,
                  const struct session_shot *shot, const struct session_frame *frame) {
    const int c = frame->camera;
    if (c < 0 || c >= session->devices->geometry.n_cameras)
        return;
    const double planned = planned_bytes(bytes, session, shot, c);
    const double is =
        vary(session, c) ? (double)plan_stored_bytes((guint64)MAX(frame->bytes, 0)) : planned;
    bytes->of[shot->kind][c].sum += is;
    bytes->of[shot->kind][c].planned += planned;
    bytes->stored += is;
}

/* Returns the ratio of stored to planned bytes for frames of this kind and camera. If no such frame
 * is stored yet, returns the ratio for frames of this kind of all cameras, or 1 if none of them is
 * stored. Returns 1 if the sizes do not vary. */
static double ratio(const struct capture_bytes *bytes, const struct capture_session *session,
                    int kind, int camera) {
    double sum = 0, planned = 0;
    if (!vary(session, camera))
        return 1;
    if (bytes->of[kind][camera].planned > 0)
        return bytes->of[kind][camera].sum / bytes->of[kind][camera].planned;
    for (int c = 0; c < session->devices->geometry.n_cameras; c++)
        if (vary(session, c)) {
            sum += bytes->of[kind][c].sum;
            planned += bytes->of[kind][c].planned;
        }
    return planned > 0 ? sum / planned : 1;
}

/* Returns the expected bytes of the shots that are still to be taken. In an adaptive capture, only
 * the chosen shots are counted (capture_session_is_chosen()). */
static double bytes_left(struct capture_bytes *bytes, const struct capture_session *session) {
    const int n_cameras = session->devices->geometry.n_cameras;
    double left = 0;
    if (!bytes->planned) {
        bytes->planned = g_new0(float, session->shots->len *(gsize)n_cameras);
        for (guint i = 0; i < session->shots->len; i++) {
            const struct session_shot *at = session->shots->pdata[i];
            for (int c = 0; c < n_cameras; c++)
                if (at->state == SHOT_PLANNED && camera_set_has(at->cameras, c))
                    bytes->planned[i * (guint)n_cameras + (guint)c] =
                        (float)planned_bytes(bytes, session, at, c);
        }
    }
    double ratios[SHOT_SWEEP + 1][RIG_MAX_CAMERAS];
    for (int kind = 0; kind <= SHOT_SWEEP; kind++)
        for (int c = 0; c < n_cameras; c++)
            ratios[kind][c] = ratio(bytes, session, kind, c);
    for (guint i = 0; i < session->shots->len; i++) {
        const struct session_shot *at = session->shots->pdata[i];
        if (at->state != SHOT_PLANNED || !capture_session_is_chosen(session, at))
            continue;
        for (int c = 0; c < n_cameras; c++)
            left += ratios[at->kind][c] * (double)bytes->planned[i * (guint)n_cameras + (guint)c];
    }
    return left;
}

gboolean capture_bytes_load(struct capture_bytes *bytes, const struct capture_session *session,
                            GError **error) {
    double predicted = 0;
    if (!capture_session_load(session, "predicted_bytes", &predicted, error) ||
        !capture_session_load(session, "expected_bytes", &bytes->said, error))
        return FALSE;
    if (bytes->said <= 0)
        bytes->said = predicted;
    bytes->expected = bytes->said;
    return TRUE;
}

void capture_bytes_clear(struct capture_bytes *bytes) {
    g_clear_pointer(&bytes->footprints, g_free);
    g_clear_pointer(&bytes->planned, g_free);
}

void capture_bytes_begin(struct capture_bytes *bytes, const struct capture_session *session,
                         const GPtrArray *frames) {
    g_autoptr(GHashTable) shots = g_hash_table_new(g_int64_hash, g_int64_equal);
    for (guint i = 0; i < session->shots->len; i++) {
        struct session_shot *shot = session->shots->pdata[i];
        g_hash_table_insert(shots, &shot->id, shot);
    }
    for (guint i = 0; i < frames->len; i++) {
        const struct session_frame *frame = frames->pdata[i];
        const struct session_shot *shot = g_hash_table_lookup(shots, &frame->shot);
        if (shot && shot->state == SHOT_DONE)
            count(bytes, session, shot, frame);
    }
}

/* Returns whether the estimate is updated after shot n of this run, which is so for n = 1, 2, 3, 4,
 * 6, 8, 12, … It is not updated after every shot, because an update examines the whole list of
 * shots and takes longer than storing a shot. */
static gboolean is_due(guint n) {
    while (n > 3 && n % 2 == 0)
        n /= 2;
    return n <= 3;
}

void capture_bytes_add(struct capture_bytes *bytes, const struct capture_session *session,
                       const struct session_shot *shot, const struct session_frame *frames, int n,
                       guint n_committed, gboolean is_last) {
    gboolean first = FALSE;
    for (int i = 0; i < n; i++) {
        first |= bytes->of[shot->kind][frames[i].camera].planned == 0;
        count(bytes, session, shot, &frames[i]);
    }
    if (!first && !is_last && !is_due(n_committed))
        return;
    const double left = bytes_left(bytes, session);
    const double all = bytes->stored + left + (double)plan_database_bytes((int)session->shots->len);
    bytes->expected = all;
    if (fabs(all / MAX(bytes->said, 1) - 1) <= BYTES_PART)
        return;
    const guint64 free_bytes = capture_free_bytes(session_path(session->store));
    g_autofree char *size = g_format_size((guint64)all);
    g_autofree char *before = g_format_size((guint64)bytes->said);
    g_autofree char *more = g_format_size((guint64)left);
    g_autofree char *room = g_format_size(free_bytes);
    const gboolean full = left > (double)free_bytes;
    g_autofree char *text =
        g_strdup_printf("judging by the frames stored so far, the session will take about %s "
                        "(expected before: %s), of which %s are still to be stored%s%s%s",
                        size, before, more, full ? "; the disk has only " : "", full ? room : "",
                        full ? " free: make room, or the session will pause when it is full" : "");
    bytes->said = all;
    capture_session_save(session->store, "expected_bytes", all);
    capture_session_add_event(session, full ? "warning" : "info", "disk", text);
}
