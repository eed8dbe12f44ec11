/*
 * Error bars of a BTF: the standard error σ of each value ρ, stored next to the values in a view's
 * file (pipeline.h).
 *
 * Errors that differ from value to value are stored in a channel, because they depend on the
 * exposures from which a texel's pixels were merged, and on edges within the pixels. To keep files
 * small, one channel serves all three colours and holds 5 significant bits (σ to 3 %). Sums, means
 * and medians leave out holes.
 *
 *   channel "sigma"
 *       Error of each texel, in the unit of ρ; 0 for holes. It includes
 *       - noise of the sensor
 *       - edges within pixels, and colours that a pixel does not see
 *       - misregistration, as large as the residual of the camera's calibration
 *         (rectify.h, docs/research/accuracy.md)
 *       - the error of the veiling glare
 *       - the white tile's residuals in excess of noise
 *   sigma.colour (v3d)
 *       f_R, f_G, f_B: σ_c(x) = f_c · sigma(x)
 *   sigma.rms (double)
 *       Root mean square of σ_c(x) over texels and colours.
 *   sigma.value (double)
 *       Root mean square of ρ over texels and colours.
 *   sigma.median (double)
 *       Median of sigma(x) over texels.
 *   sigma.relative (double)
 *       Median of sigma(x) / max(ρ, BTF_SIGMA_DARK) over texels; ρ here is the
 *       root mean square of the three colours.
 *   sigma.scale (v3d)
 *       Relative standard error of R, G, B that all values of the light have in
 *       common: from the calibrated response, intensity and colours, and from
 *       the flicker of the lamp. It is not included in the other values. It is 0
 *       if the radiometry is not calibrated. Errors of flat field, fall-off and
 *       aim are left out, because the calibration file does not say how they
 *       are correlated.
 *
 * Pictures that were left out on purpose and are predicted (pipeline/prediction_product.h) have
 * only the error bars of their prediction. Parts without the channel have unknown errors. Such
 * parts belong to other predicted lights, and to cameras whose noise is not calibrated. Any thread.
 */
#pragma once

#include "exr/exr.h"
#include "radiometry/photon_transfer.h"
#include "radiometry/radiometry.h"

/* Version of the method for error bars. BTF_METHOD is the version of the method for values. */
#define BTF_SIGMA_METHOD 4

#define BTF_SIGMA_DARK 0.02 /* sigma.relative divides by this if ρ is smaller */

/* The exposures of a frame, from its attributes mesorig.exposures_us and mesorig.shorter_from. A
 * frame has at most BTF_SIGMA_EXPOSURES of them. */
#define BTF_SIGMA_EXPOSURES 16
struct btf_exposures {
    int n;                          /* number of exposures; 0 if they are unknown */
    double ms[BTF_SIGMA_EXPOSURES]; /* exposure times, rising */
    /* DN/ms from which the longest exposure is saturated; 0 if no pixel is saturated in it */
    float shorter;
};
/* Reads the exposures. If the frame lacks the attribute mesorig.exposures_us, or the attribute is
 * empty, n is 0. The error is DATA_ERROR_INVALID, with path, if the attribute does not hold 1 to
 * BTF_SIGMA_EXPOSURES rising numbers above 0. */
gboolean btf_exposures_read(const struct exr_part *frame, const char *path,
                            struct btf_exposures *ret, GError **error);

/* Computes the variances of a picture's n pixels from their values. values (n) are in DN/ms, and
 * ret_variances (n) are in (DN/ms)². */
void btf_sigma_pixels(const struct transfer *transfer, const struct btf_exposures *exposures,
                      const float *values, gsize n, float *ret_variances);

/* Fills the channel "sigma" of a part whose channels B, G and R are set. Sets all attributes above
 * except sigma.scale. variances: n_texels × 3 (R, G, B), in the unit of ρ². holes: n_texels, TRUE
 * for values without meaning. */
void btf_sigma_fill(struct exr_part *part, const float *variances, const guint8 *holes);

/* Computes the relative errors of R, G, B that come from camera and lamp together. A camera or lamp
 * that is NULL or not calibrated adds no error. output_error is the standard error of the lamp's
 * output in this shot, or 0 if the output was not measured; the flicker of the calibrated lamp then
 * takes its place. */
void btf_sigma_scale(const struct radiometry_camera *camera, const struct radiometry_lamp *lamp,
                     double output_error, double ret[3]);

struct btf_sigma {
    double colour[3]; /* R, G, B */
    double rms, value, median, relative;
    double scale[3]; /* R, G, B */
};
/* Reads the attributes sigma.* of a part. Returns FALSE if any of them is missing. */
gboolean btf_sigma_read(const struct exr_part *part, struct btf_sigma *ret);

/* Error bars of a session's whole BTF. */
struct btf_sigma_sums {
    int lights, known; /* lights: number of pictures; known: number of pictures with known errors */
    double median;     /* median of sigma.median over the known pictures */
    double relative;   /* median of sigma.relative over the known pictures */
    double share;      /* Σ sigma.rms² / Σ sigma.value² over the known pictures */
    int large;         /* number of pictures whose sigma.relative is above BTF_SIGMA_LARGE */
    double worst;      /* largest sigma.relative */
    /* Number of captured pictures whose sigma.relative is above BTF_SIGMA_LARGE and above twice the
     * usual value. The usual value is the median of sigma.relative over the captured pictures with
     * the same polar angles of view and light. If fewer than BTF_SIGMA_RING pictures have these
     * angles, it is the median over all captured pictures. */
    int worse;
    /* sigma.relative and directions of the picture with the largest ratio of sigma.relative to the
     * usual value */
    double worse_relative;
    double worse_view_theta_deg, worse_view_phi_deg, worse_light_theta_deg, worse_light_phi_deg;
};
#define BTF_SIGMA_LARGE 0.05
#define BTF_SIGMA_RING  6

/* Collects the error bars from the headers of all files in products/btf of a session's directory.
 * Files that cannot be read are left out. If there are no files, all members are 0. */
void btf_sigma_sum(const char *directory, struct btf_sigma_sums *ret);
