/*
 * Finds the laser's line in each picture of a sweep, as published in Wang et al. 2005 §3.2. It
 * exists for comparison with laser_lines.h, which is more accurate.
 *
 * Each picture is filtered with a Gaussian. Every row of the reference region (or every column,
 * whichever the line crosses) has one candidate, its brightest pixel, if that exceeds a threshold.
 * A line is fitted to the candidates. The sheet of light of that frame is the plane through this
 * line and the laser's source. Neither the calibration nor other frames are used. One thread at a
 * time.
 */
#pragma once

#include "laser_lines.h"

typedef struct LaserPictures LaserPictures;

/* Borrows region and sweep. Of the sweep, only arc, laser, arc_rad, from_rad and step_rad are read.
 * A pixel can show the line if it is more than threshold_dn brighter than the median of the
 * region's pixels. */
LaserPictures *laser_pictures_new(const LaserRegion *region, const struct laser_sweep *sweep,
                                  int width, int height, int n_frames, double threshold_dn);
void laser_pictures_free(LaserPictures *pictures); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LaserPictures, laser_pictures_free)

/* Adds the next frame, width × height values. They are treated as grey, whatever their colour
 * filter. */
void laser_pictures_add(LaserPictures *pictures, const guint16 *pixels);

/* Gives the lines of all frames. turn_rad of a frame without a line is copied from the nearest
 * frame with a line; turn_rad is NULL if no frame has a line. The roll is the mean over all
 * lines, weighted by their number of candidates. disagrees is FALSE. */
void laser_pictures_finish(const LaserPictures *pictures, struct laser_lines *ret);
