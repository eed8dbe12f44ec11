/* Finds lasers that may still be lit although they were switched off. A relay that sticks reports
 * that it is open, so only a picture shows that the laser is lit. The last frame of a sweep is such
 * a picture, taken after the laser was switched off. After a pause without that picture, the laser
 * counts as not checked. */
#pragma once

#include "capture_private.h"

/* Notes the lasers whose sweeps are under way. To be called before the frames under way are
 * dropped. */
void capture_lasers_note(Capture *capture);

/* Notes all lasers of a session that is resumed, because the daemon may have died within a
 * sweep. */
void capture_lasers_note_all(Capture *capture);

/* Clears the note for the laser of a sweep that is stored: its last frame showed that the laser was
 * off. */
void capture_lasers_clear(Capture *capture, const struct session_shot *shot);

/* Moves one sweep of each laser that is not checked to the front: its next sweep that can be taken
 * as the lasers are mounted. The dark frames that are still to be taken come before these sweeps,
 * since a sweep needs them. These dark frames and sweeps are held back, because a laser that stays
 * on may have lit any of them. They are stored together, once the last frame of each of these
 * sweeps has shown that its laser is off. */
void capture_lasers_put_first(Capture *capture);
