/* Finds lasers that may still be lit although they were switched off. A relay that sticks reports
 * that it is open, so only a picture shows that the laser is lit. The last frame of a sweep is such
 * a picture, taken after the laser was switched off. After a pause without that picture, the laser
 * counts as not checked. The struct belongs to the Capture. Main loop's thread. */
#pragma once

#include "capture_mount.h"

struct capture_lasers {
    guint32 unchecked; /* bit i is set if laser unit i is not checked */
};

/* Marks the laser of a sweep as not checked if the sweep is under way and will be dropped. Ignores
 * shots of other kinds. */
void capture_lasers_note(struct capture_lasers *lasers, const struct rig_timing *timing,
                         const struct session_shot *shot);

/* Marks all lasers as not checked. Call it for a session that is resumed, because the daemon may
 * have been killed within a sweep. */
void capture_lasers_note_all(struct capture_lasers *lasers);

/* Marks the laser of a sweep as checked. Call it when the sweep is stored: its last frame showed
 * that the laser was off. */
void capture_lasers_clear(struct capture_lasers *lasers, const struct rig_timing *timing,
                          const struct session_shot *shot);

/* Moves one sweep of each laser that is not checked to the front of the shots: the first sweep
 * that can be taken with the lasers at the places where they are mounted now. The dark frames
 * that are still to be taken come before these sweeps, because a sweep needs them. Returns the
 * number of these dark frames and sweeps, or 0 if there is no such sweep. They are held back,
 * because a laser that stays on may have lit any of them. They are stored together, once the
 * last frame of each of these sweeps has shown that its laser is off. */
guint capture_lasers_put_first(const struct capture_lasers *lasers,
                               const struct capture_mounts *mounts, const struct rig_timing *timing,
                               GPtrArray *shots);
