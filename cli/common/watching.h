/* The lines above the progress bar of a terminal that show the pose and the cameras' last
 * pictures. */
#pragma once

#include "link.h"
#include "progress.h"

typedef struct Watching Watching;

/* Creates the lines for the pose. If pictures is TRUE and standard error is a terminal that can
 * show them, the cameras' pictures are shown as well, in half blocks. The main loop fetches each
 * picture when it changes. rig and progress are borrowed. */
Watching *watching_new(BusRig1 *rig, Progress *progress, gboolean pictures);
void watching_free(Watching *watching); /* NULL is ignored */

/* Updates the pose above the bar, and the pictures if they are shown. */
void watching_show(Watching *watching);

/* Returns a text such as "turntable 30°, arc 195°: lamp30, light from θ 30°, φ 165° of the sample",
 * or NULL if no shot was taken yet. Free it with g_free(). */
char *watching_pose(BusRig1 *rig);
