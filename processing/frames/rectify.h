/*
 * Rectification: from a camera's mosaic to the texels of the reference plane. For one camera at one
 * turntable angle each texel has a row of weights over the pixels, so that rectifying a frame is a
 * sparse matrix–vector product: texel_c = Σ_p w_p · ratio_pc · mosaic_p.
 *
 * A texel's value is the mean radiance over its area as the camera sees it; a pixel, itself a mean
 * over its area, is taken to vary within it as its neighbours suggest. Every pixel contributes to
 * all colours: the two that it does not measure follow from their ratio to its own in a guide
 * picture. The mean picture under all lights is the best guide: shadows and highlights are then as
 * sharp as without a colour filter. Any thread; immutable once made and given a guide.
 */
#pragma once

#include "radiometry/radiometry.h"
#include "session/session.h"

typedef struct Rectify Rectify;

/* cfa: "mono" (three equal colours), "rggb", "bggr", "grbg", "gbrg"; "rgb": three planes, the same
 * weights for each. radiometry: of the camera; NULL or unknown: nominal vignetting, equal colour
 * gains. Texels outside of the picture are holes; DATA_ERROR_INVALID: more than 1 % are. */
Rectify *rectify_new(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                     const char *cfa, double turntable_rad, const struct session_grid *grid,
                     GError **error);
/* As rectify_new(), for the n_texels texels (row · width + column) of a list, in its order; NULL:
 * the whole grid. Not for rectify_errors(), which looks at a texel's neighbours in the grid. */
Rectify *rectify_new_at(const struct rig_camera *camera, const struct radiometry_camera *radiometry,
                        const char *cfa, double turntable_rad, const struct session_grid *grid,
                        const int *texels, int n_texels, GError **error);
void rectify_free(Rectify *rectify); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Rectify, rectify_free)

/* Sets the guide: a mosaic as below, of the same camera at the same turntable angle, in any unit.
 * Without a guide each frame is its own. "rgb" needs none and ignores it. */
void rectify_guide(Rectify *rectify, const float *mosaic);

/* mosaic: height × width, DN/ms at 0 dB; "rgb": 3 × height × width, planes of R, G, B. ret_rgb:
 * n_texels × 3, R, G, B in W·sr⁻¹·m⁻², corrected for flat field and colour gains. Texels outside,
 * or with pixels that are not finite, are holes: 0. ret_holes (n_texels; may be NULL): whether each
 * is a hole. Returns the number of holes. */
int rectify_apply(const Rectify *rectify, const float *mosaic, float *ret_rgb, guint8 *ret_holes);

/* A texel gets (by OR) the flags of the pixels (height × width) with a share of ≥ 2 % in it. */
void rectify_flags(const Rectify *rectify, const guint8 *pixels, guint8 *ret_texels);

/* Squared errors of what rectify_apply() finds in this mosaic: n_texels × 3 each (R, G, B), 0 for
 * texels outside. pixels: variances of the mosaic's pixels, of its size, in (DN/ms)², finite;
 * pixels are independent, and a guide counts as exact. ret_noise: variance that pixels cause.
 * ret_detail: variance, without noise, from what the picture does not show: where in a pixel an
 * edge lies, and the colours that pixels do not see. ret_shift: square of the value's change for a
 * shift of the picture by one pixel, summed over two directions at right angles. Pixels on the
 * picture's border do not count in ret_detail and ret_shift. */
void rectify_errors(const Rectify *rectify, const float *mosaic, const float *pixels,
                    float *ret_noise, float *ret_detail, float *ret_shift);

/* Point of the reference plane, sample frame; texel (i, j) spans columns i … i+1, rows j … j+1. */
struct vec3 rectify_point_mm(const struct session_grid *grid, double column, double row);

/* ret_irradiance (n_texels): a lamp's W·m⁻² at each texel's centre on a plane facing the lamp. */
void rectify_irradiance(const struct rig_arc *arc, const struct rig_lamp *lamp, double arc_rad,
                        double turntable_rad, const struct session_grid *grid,
                        float *ret_irradiance);
