/*
 * From a camera's mosaic to the texels of the reference plane. For one camera at one turntable
 * angle each texel has rows of weights over the pixels, so that rectifying a frame is a sparse
 * product.
 *
 * A texel's value is the average, over its area as the camera sees it, of the mosaic's
 * interpolation: an average where pixels are smaller than texels, an interpolation where they are
 * larger. Green is interpolated with a Laplacian correction; red and blue between their own pixels,
 * and sharpened by as much as green is sharper than it would be at those alone. Pictures that are
 * linear in x and y, with slopes of their own for each colour, come out exactly, whatever the phase
 * of the colour filter. Any thread; not changed after it was made.
 */
#pragma once

#include "calib/rig.h"
#include "session.h"

typedef struct Rectify Rectify;

/* cfa: "mono", "rggb", "bggr", "grbg" or "gbrg"; a mono camera gives three colours alike. Texels
 * outside of the picture are holes; more than 1 % of them are PIPELINE_ERROR_DATA. */
Rectify *rectify_new(const struct rig_camera *camera, const char *cfa, double turntable_rad,
                     const struct session_grid *grid, GError **error);
void rectify_free(Rectify *rectify); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Rectify, rectify_free)

int rectify_outside(const Rectify *rectify); /* texels that are holes in every picture */

/* mosaic: height rows of width, DN a millisecond at 0 dB. ret_rgb: a texel's R, G, B in
 * W·sr⁻¹·m⁻², vignetting taken out. Texels that are outside, or whose pixels are not all finite,
 * are 0; returns how many. */
int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb);

/* Sample frame, in the reference plane; texel (i, j) covers column i … i+1, row j … j+1. */
struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row);

/* A lamp's irradiance at each texel's centre on a plane that faces it, W·m⁻². */
void rectify_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                        double turntable_rad, const struct session_grid *grid,
                        float *ret_irradiance);
