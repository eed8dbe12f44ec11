/* Finds lasers that stay lit although they were switched off. A relay that sticks reports that it
 * is open, so only a picture shows that the laser is lit. The last frame of a sweep is such a
 * picture, because it is taken after the laser was switched off. If a sweep is interrupted by a
 * pause, this picture is missing, and the laser counts as not checked.
 *
 * The struct belongs to the Capture. All functions belong to the main loop's thread. */
#pragma once

#include "capture_mount.h"

struct capture_lasers {
    guint32 unchecked; /* bit i is set if laser unit i is not checked */
};

/* Marks the laser of a shot as not checked, if the shot is a sweep that is under way. Call it
 * before the shot is dropped. */
void capture_lasers_note(struct capture_lasers *lasers, const struct rig_timing *timing,
                         const struct session_shot *shot);

/* Marks all lasers as not checked. Call it for a session that is resumed, because the daemon may
 * have been killed during a sweep. */
void capture_lasers_note_all(struct capture_lasers *lasers);

/* Marks the laser of a shot as checked, if the shot is a sweep. Call it when the sweep is stored,
 * because its last frame has then shown that the laser was off. */
void capture_lasers_clear(struct capture_lasers *lasers, const struct rig_timing *timing,
                          const struct session_shot *shot);

/* Reorders the shots so that the lasers that are not checked are checked first. For each of these
 * lasers, one sweep is moved to the front. It is the first sweep that can be taken with the lasers
 * at the places where they are mounted now. Only the dark frames that are still to be taken come
 * before these sweeps, because a sweep needs them.
 *
 * Returns the number of these dark frames and sweeps, or 0 if there is no such sweep. The caller
 * must not store them one by one, because a laser that stays on may have lit any of them. They are
 * stored together, when the last frame of each of these sweeps has shown that its laser is off. */
guint capture_lasers_put_first(const struct capture_lasers *lasers,
                               const struct capture_mounts *mounts, const struct rig_timing *timing,
                               GPtrArray *shots);
