/*
 * From a camera's mosaic to the texels of the reference plane. For one camera at one turntable
 * angle each texel has rows of weights over the pixels, so that rectifying a frame is a sparse
 * product.
 *
 * A texel's value is the mean over its area as the camera sees it. A pixel is itself the mean over
 * its area, and is taken to vary over it as its neighbours suggest. Every pixel counts for all
 * three colours: the two that it does not see follow from how they are, relative to its own, in a
 * guide. The mean picture under all lights is the best guide: shadows and highlights, which are
 * what changes sharply from light to light, then come out as sharp as if there were no colour
 * filter. Any thread; not changed after it was made and given a guide.
 */
#pragma once

#include "radiometry/radiometry.h"
#include "session/session.h"

typedef struct Rectify Rectify;

/* cfa: "mono", "rggb", "bggr", "grbg" or "gbrg"; a mono camera gives three colours alike. Texels
 * outside of the picture are holes; more than 1 % of them are DATA_ERROR_INVALID. radiometry: of
 * the camera; NULL or not known: nominal vignetting, colours alike. */
Rectify *rectify_new(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                     const char *cfa, double turntable_rad, const struct session_grid *grid,
                     GError **error);
void rectify_free(Rectify *rectify); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Rectify, rectify_free)

int rectify_outside(const Rectify *rectify); /* texels that are holes in every picture */

/* The guide: a mosaic as below, of the same camera at the same turntable angle, in any unit.
 * Without one, each frame is its own. */
void rectify_guide(Rectify *rectify, const float *mosaic);

/* mosaic: height rows of width, DN a millisecond at 0 dB. ret_rgb: a texel's R, G, B in
 * W·sr⁻¹·m⁻², flat field and colours of the sensor taken out. Texels that are outside, or whose
 * pixels are not all finite, are 0; returns how many. ret_holes, if not NULL: whether each is. */
int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb, guint8 *ret_holes);

/* Pixels carry bits; a texel gets (by OR) those of every pixel that is 2 % of it or more. */
void rectify_marks(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels);

/* Sample frame, in the reference plane; texel (i, j) covers column i … i+1, row j … j+1. */
struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row);

/* A lamp's irradiance at each texel's centre on a plane that faces it, W·m⁻². */
void rectify_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                        double turntable_rad, const struct session_grid *grid,
                        float *ret_irradiance);
