/* Lasers that may still shine although they were switched off: a relay that sticks says that it is
 * open. The pictures show such a laser, and only the end of a sweep takes one for that. After a
 * pause without that picture the laser is not checked. */
#pragma once

#include "capture_private.h"

/* Before the frames under way are dropped: the lasers whose sweeps are among them. */
void capture_lasers_note(Capture *capture);

/* A session that is resumed: all lasers, since the daemon may have died within a sweep. */
void capture_lasers_note_all(Capture *capture);

/* A sweep is stored: its laser was seen to be off after it. */
void capture_lasers_clear(Capture *capture, const struct session_shot *shot);

/* Puts first, of each laser that is not checked, the next sweep that can be taken as the lasers are
 * mounted, behind dark frames that are still to be taken, since a sweep needs them. These dark
 * frames and sweeps are held: a laser that stays on may have lit any of them, so that they are
 * stored together, once the end of each of these sweeps has shown its laser to be off. */
void capture_lasers_put_first(Capture *capture);
