#include "capture_lasers.h"

static guint32 unit_bit(const struct rig_timing *timing, const struct session_shot *shot) {
    return 1u << rig_laser_unit(timing, shot->device);
}

void capture_lasers_note(struct capture_lasers *lasers, const struct rig_timing *timing,
                         const struct session_shot *shot) {
    if (shot->kind == SHOT_SWEEP && shot->state != SHOT_DONE)
        lasers->unchecked |= unit_bit(timing, shot);
}

void capture_lasers_note_all(struct capture_lasers *lasers) {
    lasers->unchecked = G_MAXUINT32;
}

void capture_lasers_clear(struct capture_lasers *lasers, const struct rig_timing *timing,
                          const struct session_shot *shot) {
    if (shot->kind == SHOT_SWEEP)
        lasers->unchecked &= ~unit_bit(timing, shot);
}

guint capture_lasers_put_first(const struct capture_lasers *lasers,
                               const struct capture_mounts *mounts, const struct rig_timing *timing,
                               GPtrArray *shots) {
    guint32 unchecked = lasers->unchecked;
    guint n_first = 0, n_dark = 0;
    while (n_dark < shots->len && ((struct session_shot *)shots->pdata[n_dark])->kind == SHOT_DARK)
        n_dark++;
    for (guint i = n_dark; i < shots->len && unchecked; i++) {
        struct session_shot *shot = shots->pdata[i];
        if (shot->kind != SHOT_SWEEP || !(unchecked & unit_bit(timing, shot)) ||
            !capture_mount_is_in_place(mounts, timing, shot))
            continue;
        unchecked &= ~unit_bit(timing, shot);
        g_ptr_array_remove_index(shots, i);
        g_ptr_array_insert(shots, (int)(n_dark + n_first), shot);
        n_first++;
    }
    return n_first > 0 ? n_dark + n_first : 0;
}
