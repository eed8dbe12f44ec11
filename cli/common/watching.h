/* The lines above the progress bar of a terminal that show the pose and the cameras' last
 * pictures. */
#pragma once

#include "link.h"
#include "progress.h"

typedef struct Watching Watching;

/* Borrows rig and progress. If pictures is TRUE, the cameras' pictures are shown as well, in half
 * blocks, if standard error is a terminal that can show them. The main loop fetches each picture
 * when it changes. */
Watching *watching_new(BusRig1 *rig, Progress *progress, gboolean pictures);
void watching_free(Watching *watching); /* NULL is ignored */

/* Updates the pose and, if they are shown, the pictures above the bar. */
void watching_show(Watching *watching);

/* Returns a text such as "turntable 30°, arc 195°: lamp30, light from θ 30°, φ 165° of the sample",
 * or NULL if no shot was taken yet. g_free() */
char *watching_pose(BusRig1 *rig);
