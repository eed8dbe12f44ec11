/*
 * The mesostructure distance function (MDF) of one view, from laser sweeps (Wang et al. 2005 §3.2).
 * Each sweep gives a displacement image; the images of all laser positions are merged. The peak
 * time of a pixel is a sweep angle, and hence a sheet of light. The surface lies where the pixel's
 * ray intersects that sheet.
 *
 * The sheets are those of the calibration, corrected by the lines that were found in the sweep
 * (laser_lines.h). The sheets of a sweep diverge from the laser; they are not assumed to be
 * parallel. One thread per MdfView.
 */
#pragma once

#include "frames/laser_lines.h"
#include "geometry/rig.h"
#include "session/session.h"

#define MDF_MAX_SWEEPS 128

/* Version of the method. It increases when the same sweeps give other values. Products of an older
 * version are remade. */
#define MDF_METHOD 14

typedef struct MdfView MdfView;

MdfView *mdf_view_new(const struct rig_camera *camera, double turntable_rad,
                      const struct session_grid *grid);
void mdf_view_free(MdfView *view); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(MdfView, mdf_view_free)

/* Adds a sweep. At most MDF_MAX_SWEEPS can be added. Returns the number of texels that the sweep
 * saw. */
int mdf_view_add(MdfView *view, const struct laser_sweep *sweep);

/* Sets the covariance of the error, in pixels along x and y of the picture, with which the
 * calibrated camera model predicts where a point of the sample is seen. This error becomes part of
 * ret_error of mdf_view_merge(). Without this call, the model counts as exact. */
void mdf_view_set_sight(MdfView *view, const double px2[2][2]);

/* Makes mdf_view_merge() compute the plain weighted mean of Wang et al. 2005 §3.2 over the
 * brightest pulse of each sweep, for comparison. A reflection then shifts the distance. */
void mdf_view_set_plain(MdfView *view);

/* Merges all sweeps. Results have n_texels values each.
 *   ret_distance   mm, or −1 if unknown. It is unknown if no sweep saw the texel. With four sweeps
 *                  or more, it is also unknown if the sweeps contradict each other and none of
 *                  them continues the surface of the neighbours.
 *   ret_n          number of laser positions whose distances were averaged
 *   ret_error      standard error in mm, see mdf_errors.h; −1 for unknown texels. If ret_n
 *                  is 1, the error follows from the roughness of the surface around the texel */
void mdf_view_merge(const MdfView *view, float *ret_distance, float *ret_n, float *ret_error);

/* How the laser's light behaves on the sample. Speckle makes the times of the sweeps scatter.
 * Light that leaves the material at another place makes lines wider. */
struct mdf_light {
    /* Width of lines on the sample divided by their width on plates: the median over pixels, then
     * the mean over sweeps. 0 if unknown. */
    double width;
    /* Scatter of the times of the sweeps at a texel: the standard deviation from the mean of the
     * agreeing sweeps, divided by the standard deviation of the line. The median over texels; 0 if
     * unknown. */
    double scatter;
};
void mdf_view_light(const MdfView *view, struct mdf_light *ret);

/* Gives the second most likely distance of each texel in ret_other (n_texels). This distance is
 * merged from the candidates that do not agree with `distance`, or from all candidates where
 * `distance` is −1. Unlike in mdf_view_merge(), one laser position is enough. The result is −1 if
 * there is no candidate. */
void mdf_view_other(const MdfView *view, const float *distance, float *ret_other);

/* Returns the number of texels that have no distance because their surface lies above the reference
 * plane. At least two sweeps must show this. One is enough if the view has fewer than four
 * sweeps. */
int mdf_view_above(const MdfView *view, const float *distance);

/* Returns a measure of the depth resolution of a sweep, which grows with the resolution. It is the
 * volume of a tetrahedron in mm³. The corners of the tetrahedron are the laser source, the camera
 * centre, and two points 2 mm apart on the line that the laser draws through the turntable's
 * centre. Returns 0 if the sheet of light is parallel to the turntable. */
double mdf_weight(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                  struct vec3 camera_mm);
