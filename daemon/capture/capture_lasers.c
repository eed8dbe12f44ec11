#include "capture_lasers.h"

#include "capture_mount.h"

static guint32 unit_bit(const Capture *capture, const struct session_shot *shot) {
    return 1u << rig_laser_unit(&capture->devices->timing, shot->device);
}

static void note_sweep(Capture *capture, const struct session_shot *shot) {
    if (shot && shot->kind == SHOT_SWEEP && shot->state != SHOT_DONE)
        capture->unchecked_lasers |= unit_bit(capture, shot);
}

void capture_lasers_note(Capture *capture) {
    note_sweep(capture, sequencer_last_shot(capture->sequencer));
    for (const GList *at = capture->flights.head; at; at = at->next)
        note_sweep(capture, ((const struct flight *)at->data)->shot);
}

void capture_lasers_note_all(Capture *capture) {
    capture->unchecked_lasers = G_MAXUINT32;
}

void capture_lasers_clear(Capture *capture, const struct session_shot *shot) {
    if (shot->kind == SHOT_SWEEP)
        capture->unchecked_lasers &= ~unit_bit(capture, shot);
}

void capture_lasers_put_first(Capture *capture) {
    GPtrArray *shots = capture->remaining;
    guint32 unchecked = capture->unchecked_lasers;
    guint n_first = 0, n_dark = 0;
    while (n_dark < shots->len && ((struct session_shot *)shots->pdata[n_dark])->kind == SHOT_DARK)
        n_dark++;
    for (guint i = n_dark; i < shots->len && unchecked; i++) {
        struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_SWEEP || !(unchecked & unit_bit(capture, shot)) ||
            !capture_mount_is_in_place(capture, shot))
            continue;
        unchecked &= ~unit_bit(capture, shot);
        g_ptr_array_remove_index(shots, i);
        g_ptr_array_insert(shots, (int)(n_dark + n_first), shot);
        n_first++;
    }
    capture->n_held = n_first > 0 ? n_dark + n_first : 0;
}
