/* The parts of bench_calibration, a file each. Each adds its figures to the object that is open. */
#pragma once

#include <glib.h>

/* Lamps, the light arc and laser sheets: simulated rigs with noise, distortion and position errors,
 * whose cameras look aside by some 0.04 px; the largest errors of each world. */
void bench_lights(int n_seeds);

void bench_radiometry(int n_seeds);

/* How long the whole calibration of a large rig computes, in CPU seconds without rendering: a world
 * of 8 cameras, 8 lamps and 26 laser positions. Pictures are rendered, then lamps and laser sheets
 * calibrated from them and timed; the caller has timed the cameras, cameras_s for so many pictures.
 */
void bench_whole(double cameras_s, int cameras_pictures);
