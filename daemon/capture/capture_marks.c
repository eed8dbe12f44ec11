#include "capture_marks.h"

#include "session/outputs.h"

/* The maximum error of a calibration in a picture, and the minimum rotation that counts as a
 * movement. */
#define SYSTEMATIC_PX 0.05
#define MIN_DEG       0.05
#define WINDOW        8          /* number of shots that are evaluated together */
#define TURNTABLE     (1u << 31) /* a bit of capture->moved; the other bits are cameras */
#define KEY           "accepted_moves"

static gboolean keep_outputs(Capture *capture, const struct flight *flight, GError **error) {
    const struct calibration *known = capture->calibration;
    const struct fiducial_seen *seen = (const struct fiducial_seen *)(void *)flight->marks->data;
    if (!known->lamp_radiometry[flight->shot->device].known)
        return TRUE;
    for (int c = 0; c < known->rig.n_cameras; c++) {
        g_autoptr(GArray) own = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
        double output, own_error;
        for (guint i = 0; i < flight->marks->len; i++)
            if (seen[i].camera == c)
                g_array_append_val(own, seen[i]);
        if (known->camera_radiometry[c].known &&
            fiducials_output((struct fiducial_seen *)(void *)own->data, (int)own->len, &output,
                             &own_error) &&
            !outputs_store(capture->session, flight->shot->id, known->rig.cameras[c].name, output,
                           own_error, error))
            return FALSE;
    }
    return TRUE;
}

static guint32 moved(const struct rig *rig, const struct fiducials_check *check) {
    guint32 bits = check->slipped ? TURNTABLE : 0;
    for (int c = 0; c < rig->n_cameras; c++)
        if (check->cameras[c].moved)
            bits |= 1u << c;
    return bits;
}

static guint32 accepted(const Capture *capture) {
    g_autofree char *text = session_value(capture->session, KEY);
    return text ? (guint32)g_ascii_strtoull(text, NULL, 10) : 0;
}

static void report_first_check(Capture *capture, const struct fiducials_check *check) {
    if (capture->marks_reported)
        return;
    capture->marks_reported = TRUE;
    g_autofree char *text =
        check->n_seen > 0
            ? g_strdup_printf(
                  "quick check: fiducials seen %d times, %.3f px off where calibration has them",
                  check->n_seen, check->rms_px)
            : g_strdup("no camera sees a mark: are the marks covered? It is not known whether the "
                       "rig has moved, nor how bright the lamps are");
    capture_add_event(capture, check->n_seen > 0 ? "info" : "warning", "fiducials", text);
}

/* One shot of a small camera is not enough evidence. The last few shots are therefore evaluated
 * together. */
static GArray *add_to_window(Capture *capture, const struct flight *flight) {
    if (!capture->marks)
        capture->marks = g_queue_new();
    g_queue_push_tail(capture->marks, g_array_ref(flight->marks));
    if (g_queue_get_length(capture->marks) > WINDOW)
        g_array_unref(g_queue_pop_head(capture->marks));
    GArray *all = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    for (const GList *at = capture->marks->head; at; at = at->next) {
        const GArray *one = at->data;
        g_array_append_vals(all, one->data, one->len);
    }
    return all;
}

static void check_seen(const Capture *capture, const GArray *seen, struct fiducials_check *ret) {
    fiducials_check(&capture->calibration->rig, (const struct fiducial_seen *)(void *)seen->data,
                    (int)seen->len, SYSTEMATIC_PX, MIN_DEG, ret);
}

char *capture_marks_check(Capture *capture, const struct flight *flight, GError **error) {
    const struct rig *rig = &capture->calibration->rig;
    if (flight->shot->kind != SHOT_LAMP || !flight->marks ||
        !keep_outputs(capture, flight, error) ||
        !capture->calibration->parts[CALIBRATION_CAMERAS].done)
        return NULL;
    struct fiducials_check check;
    g_autoptr(GArray) window = add_to_window(capture, flight);
    guint before = g_queue_get_length(capture->marks) - 1;
    check_seen(capture, flight->marks, &check);
    report_first_check(capture, &check);
    if (moved(rig, &check) != 0)
        before = 0;
    else
        check_seen(capture, window, &check);
    guint32 suspected = capture->suspected;
    capture->suspected = moved(rig, &check) & ~accepted(capture);
    if (capture->suspected == 0)
        return NULL;
    g_autofree char *what = fiducials_describe(rig, &check);
    capture->moved = capture->suspected & suspected;
    if (capture->moved == 0) {
        /* Light that a nearby sample reflects may make marks look displaced under one lamp. A real
         * movement is also visible under the next lamp. */
        g_autofree char *text = g_strdup_printf("something may have moved since the rig was "
                                                "calibrated: %s; the next shot will tell",
                                                what);
        capture_add_event(capture, "warning", "fiducials", text);
        return NULL;
    }
    capture_marks_forget(capture);
    return g_strdup_printf(
        "Something has moved since the rig was calibrated: %s. The last %u shots may be affected. "
        "Put it back or calibrate again. If you continue, the capture uses it as it is.",
        what, MAX(before, 1) + 1);
}

static void unref_array(gpointer array) {
    g_array_unref(array);
}

void capture_marks_forget(Capture *capture) {
    if (capture->marks)
        g_queue_free_full(g_steal_pointer(&capture->marks), unref_array);
    capture->suspected = 0;
}

void capture_marks_accept(Capture *capture) {
    if (capture->moved == 0)
        return;
    g_autofree char *text = g_strdup_printf("%u", accepted(capture) | capture->moved);
    session_set_value(capture->session, KEY, text, NULL);
    capture->moved = 0;
}
