#include "capture_marks.h"

#include <string.h>

#include "session/outputs.h"

/* SYSTEMATIC_PX is the maximum error in pixels that a calibration has at a mark in a picture.
 * MIN_DEG is the minimum rotation in degrees of a camera or the turntable that counts as a
 * movement. */
#define SYSTEMATIC_PX 0.05
#define MIN_DEG       0.05
#define WINDOW        8 /* number of shots that are evaluated together */
#define KEY           "accepted_moves"
#define TURNTABLE     "turntable"
#define CAMERAS       "cameras "

static const struct fiducial_seen *seen_of(const GArray *array) {
    return (const struct fiducial_seen *)(void *)array->data;
}

static gboolean keep_outputs(const struct capture_session *session, const struct session_shot *shot,
                             const GArray *array, GError **error) {
    const struct calibration *known = session->calibration;
    const struct fiducial_seen *seen = seen_of(array);
    if (!known->lamp_radiometry[shot->device].known)
        return TRUE;
    for (int c = 0; c < known->rig.n_cameras; c++) {
        g_autoptr(GArray) own = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
        double output, own_error;
        for (guint i = 0; i < array->len; i++)
            if (seen[i].camera == c)
                g_array_append_val(own, seen[i]);
        if (known->camera_radiometry[c].known &&
            fiducials_output(seen_of(own), (int)own->len, &output, &own_error) &&
            !outputs_store(session->store, shot->id, known->rig.cameras[c].name, output, own_error,
                           error))
            return FALSE;
    }
    return TRUE;
}

/* Returns the movements that somebody has accepted. They are stored as a text: TURNTABLE, or
 * CAMERAS followed by the numbers of the cameras, or both with ", " between them. Any other text
 * means that nothing is accepted. */
static struct fiducials_moved accepted(const struct capture_session *session) {
    struct fiducials_moved ret = {.turntable = FALSE};
    g_autofree char *text = session_value(session->store, KEY);
    g_auto(GStrv) parts = g_strsplit(text ? text : "", ", ", -1);
    for (char **part = parts; *part; part++)
        if (strcmp(*part, TURNTABLE) == 0)
            ret.turntable = TRUE;
        else if (g_str_has_prefix(*part, CAMERAS))
            camera_set_from_text(*part + strlen(CAMERAS), &ret.cameras);
    return ret;
}

static void accept(const struct capture_session *session, struct fiducials_moved moved) {
    const gboolean cameras = !camera_set_is_empty(moved.cameras);
    g_autofree char *numbers = camera_set_to_text(moved.cameras);
    g_autofree char *text =
        g_strconcat(moved.turntable ? TURNTABLE : "", moved.turntable && cameras ? ", " : "",
                    cameras ? CAMERAS : "", numbers, NULL);
    session_set_value(session->store, KEY, text, NULL);
}

static void report_first_check(struct capture_marks *marks, const struct capture_session *session,
                               const struct fiducials_check *check) {
    if (marks->reported)
        return;
    marks->reported = TRUE;
    g_autofree char *text =
        check->n_seen > 0
            ? g_strdup_printf("fiducials were seen %d times, %.3f px (RMS) from where the "
                              "calibration expects them",
                              check->n_seen, check->rms_px)
            : g_strdup("no camera sees a mark: are the marks covered? It is not known whether the "
                       "rig has moved, nor how bright the lamps are");
    capture_session_add_event(session, check->n_seen > 0 ? "info" : "warning", "fiducials", text);
}

/* Adds the marks of this shot to those of the last few shots, and returns all of them. The shots
 * are evaluated together, because one shot of a camera with few pixels is not enough evidence. */
static GArray *add_to_window(struct capture_marks *marks, GArray *seen) {
    if (!marks->window)
        marks->window = g_queue_new();
    g_queue_push_tail(marks->window, g_array_ref(seen));
    if (g_queue_get_length(marks->window) > WINDOW)
        g_array_unref(g_queue_pop_head(marks->window));
    GArray *all = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    for (const GList *at = marks->window->head; at; at = at->next) {
        const GArray *one = at->data;
        g_array_append_vals(all, one->data, one->len);
    }
    return all;
}

static void check_seen(const struct rig *rig, const GArray *seen, struct fiducials_check *ret) {
    fiducials_check(rig, seen_of(seen), (int)seen->len, SYSTEMATIC_PX, MIN_DEG, ret);
}

char *capture_marks_check(struct capture_marks *marks, const struct capture_session *session,
                          const struct session_shot *shot, GArray *seen, GError **error) {
    const struct rig *rig = &session->calibration->rig;
    if (shot->kind != SHOT_LAMP || !seen || !keep_outputs(session, shot, seen, error) ||
        !session->calibration->parts[CALIBRATION_CAMERAS].done)
        return NULL;
    struct fiducials_check check;
    g_autoptr(GArray) window = add_to_window(marks, seen);
    guint before = g_queue_get_length(marks->window) - 1;
    check_seen(rig, seen, &check);
    report_first_check(marks, session, &check);
    if (fiducials_moved_any(fiducials_moved(rig, &check)))
        before = 0;
    else
        check_seen(rig, window, &check);
    const struct fiducials_moved suspected = marks->suspected;
    marks->suspected = fiducials_moved_without(fiducials_moved(rig, &check), accepted(session));
    if (!fiducials_moved_any(marks->suspected))
        return NULL;
    g_autofree char *what = fiducials_describe(rig, &check);
    marks->moved = fiducials_moved_both(marks->suspected, suspected);
    if (!fiducials_moved_any(marks->moved)) {
        /* A movement is reported only if the next shot shows it too. Under one lamp, marks may look
         * displaced because of light that a nearby sample reflects. A real movement is also visible
         * under the next lamp. */
        g_autofree char *text = g_strdup_printf("something may have moved since the rig was "
                                                "calibrated: %s; the next shot will tell",
                                                what);
        capture_session_add_event(session, "warning", "fiducials", text);
        return NULL;
    }
    capture_marks_forget(marks);
    return g_strdup_printf(
        "Something has moved since the rig was calibrated: %s. The last %u shots may be affected. "
        "Put it back, or calibrate the rig again. If you continue, the capture uses the rig as it "
        "is.",
        what, MAX(before, 1) + 1);
}

static void unref_array(gpointer array) {
    g_array_unref(array);
}

void capture_marks_forget(struct capture_marks *marks) {
    if (marks->window)
        g_queue_free_full(g_steal_pointer(&marks->window), unref_array);
    marks->suspected = (struct fiducials_moved){.turntable = FALSE};
}

void capture_marks_accept(struct capture_marks *marks, const struct capture_session *session) {
    if (!fiducials_moved_any(marks->moved))
        return;
    accept(session, fiducials_moved_union(accepted(session), marks->moved));
    marks->moved = (struct fiducials_moved){.turntable = FALSE};
}
