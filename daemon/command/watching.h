/* What a watcher sees above the progress bar of a terminal: the pose, and the cameras' last
 * pictures. */
#pragma once

#include "link.h"
#include "progress.h"

typedef struct Watching Watching;

/* Borrows rig and progress. pictures: also shows the cameras' pictures, in half blocks, if standard
 * error is a terminal that can show them. The main loop fetches each picture when it changes. */
Watching *watching_new(BusRig1 *rig, Progress *progress, gboolean pictures);
void watching_free(Watching *watching); /* NULL is ignored */

/* Brings the pose up to date. */
void watching_show(Watching *watching);

/* "turntable 30°, arc 195°: lamp30, light from θ 30°, φ 165° of the sample"; NULL: no shot was
 * taken yet. g_free() */
char *watching_pose(BusRig1 *rig);
