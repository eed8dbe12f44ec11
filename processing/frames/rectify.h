/*
 * Rectification: from a camera's mosaic to the texels of the reference plane. For one camera at one
 * turntable angle, each texel has a row of weights over the pixels. Rectifying a frame is then a
 * sparse matrix–vector product: texel_c = Σ_p w_p · ratio_pc · mosaic_p.
 *
 * The value of a texel is the mean radiance over its area as the camera sees it. A pixel is itself
 * a mean over its area. The variation within the pixel is interpolated from the neighbouring
 * pixels. Every pixel contributes to all colours. The two colours that a pixel does not measure
 * follow from their ratios to the pixel's own colour in a guide picture. The best guide is the mean
 * picture under all lights: shadows and highlights are then as sharp as without a colour filter.
 * Any thread; immutable once made and given a guide.
 */
#pragma once

#include "radiometry/radiometry.h"
#include "session/session.h"

typedef struct Rectify Rectify;

/* Makes the rectification of one pose.
 *   cfa          "mono" (three equal colours), "rggb", "bggr", "grbg", "gbrg", or "rgb" (three
 *                planes)
 *   radiometry   of the camera; if it is NULL or not calibrated, vignetting is nominal and colour
 *                gains are equal
 * Texels outside of the picture are holes. Returns NULL with DATA_ERROR_INVALID if cfa is unknown,
 * or if more than 1 % of the texels lie outside of the picture. */
Rectify *rectify_new(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                     const char *cfa, double turntable_rad, const struct session_grid *grid,
                     GError **error);
/* Makes a rectification like rectify_new(), but for a list of n_texels texels (row · width +
 * column), in the order of the list. If the list is NULL, all texels of the grid are used.
 * rectify_errors() cannot be used on the result if there is a list, because that function needs the
 * neighbours of a texel in the grid. */
Rectify *rectify_new_at(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                        const char *cfa, double turntable_rad, const struct session_grid *grid,
                        const int *texels, int n_texels, GError **error);
void rectify_free(Rectify *rectify); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Rectify, rectify_free)

/* Sets the guide: a mosaic as in rectify_apply(), from the same camera at the same turntable
 * angle, in any unit. Without a guide, each frame is its own guide. For "rgb" the guide is
 * ignored, because none is needed. */
void rectify_guide(Rectify *rectify, const float *mosaic);

/* Rectifies a frame. Returns the number of holes.
 *   mosaic      height × width, DN/ms at 0 dB; "rgb": 3 × height × width, planes of R, G, B
 *   ret_rgb     n_texels × 3, R, G, B in W·sr⁻¹·m⁻², corrected for flat field and colour gains;
 *               0 for holes
 *   ret_holes   n_texels, whether each texel is a hole; may be NULL
 * A texel is a hole if it lies outside of the picture or if any pixel that contributes to it is not
 * finite. */
int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb, guint8 *ret_holes);

/* Sets the flags of each texel to the OR of the flags of its pixels. Only pixels with a share of at
 * least 2 % in the texel count. pixels: height × width. ret_texels: n_texels. */
void rectify_flags(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels);

/* Computes squared errors of the result of rectify_apply() for this mosaic. Results are n_texels ×
 * 3 each (R, G, B), and 0 for texels outside of the picture.
 *   pixels       variances of the mosaic's pixels, of the size of the mosaic, in (DN/ms)², finite;
 *                pixels are taken as independent, and a guide as exact
 *   ret_noise    variance caused by the variances of the pixels
 *   ret_detail   variance, without noise, caused by what the picture does not show: where in a
 *                pixel an edge lies, and the colours that pixels do not see
 *   ret_shift    square of the change of the value when the picture is shifted by one pixel,
 *                summed over two perpendicular directions
 * Pixels on the border of the picture do not count in ret_detail and ret_shift. */
void rectify_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                    float *ret_noise, float *ret_detail, float *ret_shift);

/* Returns the point of the reference plane at a fractional column and row, in the sample frame.
 * Texel (i, j) spans columns i … i+1 and rows j … j+1. */
struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row);

/* Gives the irradiance of a lamp at each texel's centre, on a plane that faces the lamp, in
 * W·m⁻². ret_irradiance has n_texels values. */
void rectify_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                        double turntable_rad, const struct session_grid *grid,
                        float *ret_irradiance);
