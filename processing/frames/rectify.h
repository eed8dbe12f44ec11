/*
 * Rectification: from a camera's mosaic to the texels of the reference plane. For one camera at
 * one turntable angle each texel has a row of weights over the pixels, so that rectifying a frame
 * is a sparse matrix–vector product: texel_c = Σ_p w_p · ratio_pc · mosaic_p.
 *
 * A texel's value is the mean radiance over its area as the camera sees it. A pixel is itself the
 * mean over its own area, and is taken to vary within it as its neighbours suggest. Every pixel
 * contributes to all three colours: the two that it does not measure follow from their ratio to
 * its own colour in a guide picture. The mean picture under all lights is the best guide: shadows
 * and highlights, which change sharply from light to light, are then as sharp as without a colour
 * filter. Any thread; immutable once made and given a guide.
 */
#pragma once

#include "radiometry/radiometry.h"
#include "session/session.h"

typedef struct Rectify Rectify;

/* cfa: "mono", "rggb", "bggr", "grbg" or "gbrg"; a mono camera gives three equal colours. "rgb": a
 * pixel has all three, and each is rectified from its own plane with the same weights. Texels
 * outside of the picture are holes; DATA_ERROR_INVALID if there are more than 1 % of them.
 * radiometry: of the camera; NULL or unknown: nominal vignetting, equal colour gains. */
Rectify *rectify_new(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                     const char *cfa, double turntable_rad, const struct session_grid *grid,
                     GError **error);
/* The same as rectify_new() for the n_texels texels (row · width + column) of a list, in its order;
 * NULL: for all texels of the grid. Not for rectify_errors(), which looks at a texel's neighbours
 * in the grid. */
Rectify *rectify_new_at(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                        const char *cfa, double turntable_rad, const struct session_grid *grid,
                        const int *texels, int n_texels, GError **error);
void rectify_free(Rectify *rectify); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Rectify, rectify_free)

int rectify_outside(const Rectify *rectify); /* number of texels outside of the picture */

/* Sets the guide: a mosaic as below, of the same camera at the same turntable angle, in any unit.
 * Without a guide each frame is its own. "rgb" needs none and ignores it. */
void rectify_guide(Rectify *rectify, const float *mosaic);

/* mosaic: height × width, DN per millisecond at 0 dB; "rgb": 3 × height × width, the planes of red,
 * green and blue. ret_rgb: n_texels × 3, R, G, B in
 * W·sr⁻¹·m⁻², corrected for flat field and colour gains of the sensor. Texels that are outside,
 * or whose pixels are not all finite, are holes: 0. ret_holes (n_texels; may be NULL): whether
 * each is a hole. Returns the number of holes. */
int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb, guint8 *ret_holes);

/* Transfers flags from pixels (height × width) to texels: a texel gets (by OR) the bits of every
 * pixel that has a share of 2 % or more in it. */
void rectify_flags(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels);

/* Squared errors of what rectify_apply() finds in this mosaic; n_texels × 3 each, of R, G, B,
 * and 0 for texels outside. pixels (as many as the mosaic, in (DN/ms)²; finite): the variances
 * of its pixels, which are independent of each other. The guide, if there is one, is taken as
 * exact. ret_noise: variance that pixels cause. ret_detail: variance from what the picture does
 * not show: where in a pixel an edge lies, and the colours that pixels do not see. It includes
 * neither noise nor pixels on the picture's border. ret_shift: square of the value's change for
 * a shift of the picture by one pixel, summed over two directions at right angles; without
 * pixels on the border. */
void rectify_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                    float *ret_noise, float *ret_detail, float *ret_shift);

/* Point of the reference plane in the sample frame; texel (i, j) covers columns i … i+1, rows j …
 * j+1. */
struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row);

/* Irradiance in W·m⁻² that a lamp causes at each texel's centre on a plane facing it.
 * ret_irradiance: n_texels. */
void rectify_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                        double turntable_rad, const struct session_grid *grid,
                        float *ret_irradiance);
