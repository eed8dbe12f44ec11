/*
 * Finds the laser's line in each frame of a sweep, as published in Wang et al. 2005 §3.2. This
 * module exists for comparison with laser_lines.h, which is more accurate.
 *
 * Each frame is filtered with a Gaussian. If the line crosses the rows of the reference region, the
 * brightest pixel of each row is a candidate. If the line crosses the columns, the brightest pixel
 * of each column is a candidate. Pixels below a threshold are no candidates. A line is fitted to
 * the candidates of the frame. The sheet of light of the frame is the plane through this line and
 * the laser's calibrated position. The calibrated angle of the sheet is not used; laser_lines.h
 * combines it with the lines. The roll of the sheet is the mean over all frames. One thread at a
 * time.
 */
#pragma once

#include "laser_lines.h"

typedef struct LaserPictures LaserPictures;

/* Borrows region and sweep. Of the sweep, only arc, laser, arc_rad, from_rad and step_rad are read.
 * A pixel can show the line if its filtered value exceeds the median of the region's filtered
 * values by more than threshold_dn. */
LaserPictures *laser_pictures_new(const LaserRegion *region, const struct laser_sweep *sweep,
                                  int width, int height, int n_frames, double threshold_dn);
void laser_pictures_free(LaserPictures *pictures); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LaserPictures, laser_pictures_free)

/* Adds the next frame, width × height values. Call it at most n_frames times. The values of all
 * pixels are compared with each other, whatever their colour filter. */
void laser_pictures_add(LaserPictures *pictures, const guint16 *pixels);

/* Gives the lines of all frames. Free the result with laser_lines_clear(). turn_rad of a frame
 * without a line is copied from the nearest frame with a line. The roll is the mean over all lines,
 * weighted by their number of candidates. disagrees is FALSE. The standard errors are unknown, and
 * are stored as INFINITY, so the error bars of the MDF are those of the calibration. If no frame
 * has a line, turn_rad is NULL, and roll, offset and their standard errors are 0. */
void laser_pictures_finish(const LaserPictures *pictures, struct laser_lines *ret);
