/*
 * The mesostructure distance function (MDF) of one view from laser sweeps (Wang et al. 2005 §3.2):
 * each sweep gives a displacement image, and those of all laser positions are merged. A pixel's
 * peak time is a sweep angle, hence a sheet of light; the surface lies where the pixel's ray
 * intersects it. Sheets are as calibrated, neither parallel nor from afar. One thread per MdfView.
 */
#pragma once

#include "frames/laser_lines.h"
#include "geometry/rig.h"
#include "session/session.h"

#define MDF_MAX_SWEEPS 128

/* Version of the method: rises if the same sweeps give other values; older products are remade. */
#define MDF_METHOD 14

typedef struct MdfView MdfView;

MdfView *mdf_view_new(const struct rig_camera *camera, double turntable_rad,
                      const struct session_grid *grid);
void mdf_view_free(MdfView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfView, mdf_view_free)

/* Adds a sweep, at most MDF_MAX_SWEEPS. Returns the number of texels that it saw. */
int mdf_view_add(MdfView *view, const struct laser_sweep *sweep);

/* Gives the covariance of where the calibrated camera sees the sample, in px², for the errors. */
void mdf_view_set_sight(MdfView *view, const double px2[2][2]);

/* Merges all sweeps; n_texels each: distance in mm (−1: unknown: no sweep saw the texel; or, with
 * four sweeps or more, those that did contradict each other, and none continues the surface
 * around), number of laser positions averaged, standard error in mm (−1: unknown texels) by
 * mdf_errors.h; of what one position alone saw, by the roughness of the surface around. */
void mdf_view_merge(const MdfView *view, float *ret_distance, float *ret_n, float *ret_error);

/* How the laser's light lies on the sample: speckle makes the sweeps' times scatter, and light that
 * comes out of the material elsewhere makes lines wider. */
struct mdf_light {
    double width; /* of lines, over that on plates: median of pixels, mean of sweeps; 0: unknown */
    double scatter; /* standard deviation of a sweep's time at a texel, from what the sweeps of the
                       texel agree on, in standard deviations of the line: median; 0: unknown */
};
void mdf_view_light(const MdfView *view, struct mdf_light *ret);

/* The second most likely distance of each texel: one that a single position saw and that was not
 * accepted, else what most of the remaining candidates agree on. −1: none. */
void mdf_view_other(const MdfView *view, const float *distance, float *ret_other);

/* Number of texels without a distance whose surface, according to two sweeps (one, if there are
 * fewer than four), lies above the reference plane. */
int mdf_view_above(const MdfView *view, const float *distance);

/* A sweep's depth resolution: the volume in mm³ of the tetrahedron of laser source, camera centre
 * and two points 2 mm apart on the line that the laser draws through the turntable's centre. */
double mdf_weight(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                  struct vec3 camera_mm);
