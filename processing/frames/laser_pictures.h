/*
 * The laser's line found in each picture of a sweep, as Wang et al. 2005 §3.2 publish it: to
 * compare with laser_lines.h, which is more exact. In each Gaussian-filtered picture, the brightest
 * pixel of every row or column of the reference region, whichever the line crosses, is a candidate
 * if it exceeds a threshold; the sheet of light of that frame goes through the line fitted to them
 * and the laser's source. Neither calibration nor other frames count. One thread at a time.
 */
#pragma once

#include "laser_lines.h"

typedef struct LaserPictures LaserPictures;

/* Borrows region and sweep, of which it reads arc, laser, arc_rad, from_rad and step_rad. A pixel
 * can show the line if it is threshold_dn brighter than the median of the region's pixels. */
LaserPictures *laser_pictures_new(const LaserRegion *region, const struct laser_sweep *sweep,
                                  int width, int height, int n_frames, double threshold_dn);
void laser_pictures_free(LaserPictures *pictures); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LaserPictures, laser_pictures_free)

/* Adds the next frame, width × height values, taken as grey whatever their colour filter. */
void laser_pictures_add(LaserPictures *pictures, const guint16 *pixels);

/* turn_rad of frames without a line is that of the nearest one with a line; NULL: no frame had one.
 * The roll is the mean of all lines', weighted by their candidates; disagrees is FALSE. */
void laser_pictures_finish(const LaserPictures *pictures, struct laser_lines *ret);
