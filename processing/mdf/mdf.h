/*
 * The mesostructure distance function of one view from laser sweeps (Wang et al. 2005 §3.2): each
 * sweep gives a displacement image, and those of all laser positions are merged.
 *
 * A pixel's peak time is a sweep angle, hence a sheet of light; where the pixel's ray meets it the
 * surface is. All sheets are intersected as they are, near the laser and not parallel to each
 * other. One thread a MdfView.
 */
#pragma once

#include "frames/laser_lines.h"
#include "geometry/rig.h"
#include "session/session.h"

#define MDF_MAX_SWEEPS 128

/* Counts up whenever the same sweeps give other numbers: what older ones made is made again. */
#define MDF_METHOD 7

typedef struct MdfView MdfView;

MdfView *mdf_view_new(const struct rig_camera *camera, double turntable_rad,
                      const struct session_grid *grid);
void mdf_view_free(MdfView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfView, mdf_view_free)

/* At most MDF_MAX_SWEEPS. Returns how many texels it saw. */
int mdf_view_add(MdfView *view, const struct laser_sweep *sweep);

/* Of each texel, row by row: the distance in mm (−1: not seen; of four sweeps or more by one alone,
 * unless it continues the surface around, counts as that), the number of laser positions it is the
 * mean of, and its standard error in mm (−1 where there is one only). */
void mdf_view_merge(const MdfView *view, float *ret_distance, float *ret_n, float *ret_error);

/* What lasers say of each texel next to what was merged: of one that a single position saw, and was
 * not believed for it, that; else what the next most of them agree on, elsewhere. −1: nothing. */
void mdf_view_other(const MdfView *view, const float *distance, float *ret_other);

/* The volume in mm³ of the tetrahedron of laser source, camera centre and two points 2 mm apart on
 * the line that the laser draws through the turntable's centre: how well a sweep can tell depth. */
double mdf_weight(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                  struct vec3 camera_mm);
