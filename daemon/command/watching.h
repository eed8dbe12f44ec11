/* What a watcher sees above the progress bar of a terminal: the pose, and the cameras' last
 * pictures. */
#pragma once

#include "link.h"
#include "progress.h"

typedef struct Watching Watching;

/* Borrows both. pictures: the cameras', too, in half blocks, where standard error is a terminal
 * that shows them. Each is fetched as it changes, from the main loop. */
Watching *watching_new(BusRig1 *rig, Progress *progress, gboolean pictures);
void watching_free(Watching *watching); /* NULL is ignored */

/* Brings the pose up to date. */
void watching_show(Watching *watching);

/* "turntable 30°, arc 195°: lamp30, light from θ 30°, φ 165° of the sample"; NULL: no shot was
 * taken yet. g_free() */
char *watching_pose(BusRig1 *rig);
