/* How long the whole calibration of a large rig computes. */
#pragma once

#include <glib.h>

/* A world of 8 cameras, 8 lamps and 26 laser positions: pictures are rendered, then lamps and laser
 * sheets calibrated from them and timed; the caller has timed the cameras, cameras_s of processor
 * for so many pictures. Processor's seconds without rendering, each part; a JSON object, g_free().
 */
char *bench_whole(double cameras_s, int cameras_pictures, gboolean tell);
