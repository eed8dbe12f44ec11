/*
 * Error bars of a BTF: the standard error σ of each value ρ, next to the values in a view's file
 * (pipeline.h). Errors that differ from value to value are in a channel, since they depend on the
 * exposures that a texel's pixels were merged from, and on edges within them. To keep files small,
 * one channel serves all three colours, and holds 5 significant bits (σ to 3 %).
 *
 *   channel "sigma"              of each texel, in the unit of ρ; 0 for holes. Noise of the sensor;
 *                                edges within pixels and colours that a pixel does not see; and
 *                                misregistration, as large as the calibration's residual of the
 *                                camera (rectify.h, docs/research/accuracy.md); the error of the
 * veiling glare; and what the white tile's residuals have in excess of noise sigma.colour (v3d) f_R
 * f_G f_B: σ_c(x) = f_c · sigma(x) sigma.rms (double)           root mean square of σ_c(x) over
 * texels and colours, without holes sigma.value (double)         root mean square of ρ over the
 * same sigma.median (double)        median over texels of sigma(x), without holes sigma.relative
 * (double)      median over texels of σ / max(ρ, BTF_SIGMA_DARK), of colours' RMS sigma.scale (v3d)
 * of R, G, B: relative standard error that all values of the light have in common, from the
 * calibrated response, intensity and colours, and from the flicker of the lamp; it is in none of
 * the others, and 0 where the radiometry is not calibrated. Errors of flat field, fall-off and aim
 * are left out: the calibration file does not say how they are correlated
 *
 * Pictures that were left out on purpose and are predicted (pipeline/prediction_product.h) have
 * error bars of their prediction only. Errors of parts without the channel (other predicted
 * lights, cameras whose noise is not calibrated) are not known. Any thread.
 */
#pragma once

#include "exr/exr.h"
#include "radiometry/photon_transfer.h"
#include "radiometry/radiometry.h"

/* Version of the method, as BTF_METHOD is that of the values. */
#define BTF_SIGMA_METHOD 4

#define BTF_SIGMA_DARK 0.02 /* of ρ: what relative errors of dark values relate to */

/* The exposures of a frame, from its attributes mesorig.exposures_us and mesorig.shorter_from. */
#define BTF_SIGMA_EXPOSURES 16
struct btf_exposures {
    int n; /* 0: not known */
    double ms[BTF_SIGMA_EXPOSURES];
    float shorter; /* DN/ms from which on the longest exposure is saturated; 0: never */
};
/* DATA_ERROR_INVALID with path for exposures that are not rising numbers. */
gboolean btf_exposures_read(const struct exr_part *frame, const char *path,
                            struct btf_exposures *ret, GError **error);

/* Variances of a frame's pixels in (DN/ms)². values, ret_variances: n. */
void btf_sigma_pixels(const struct transfer *transfer, const struct btf_exposures *exposures,
                      const float *values, gsize n, float *ret_variances);

/* Fills the channel "sigma" of a part, which has B, G and R, and sets the attributes.
 * variances: n_texels × 3, of R, G, B in ρ². holes: n_texels; values without meaning. */
void btf_sigma_fill(struct exr_part *part, const float *variances, const guint8 *holes);

/* Relative errors of R, G, B by camera and lamp together; either may be NULL or unknown.
 * output_error: of the lamp's output in this shot; 0: it was not measured. */
void btf_sigma_scale(const struct radiometry_camera *camera, const struct radiometry_lamp *lamp,
                     double output_error, double ret[3]);

struct btf_sigma {
    double colour[3]; /* R, G, B */
    double rms, value, median, relative;
    double scale[3]; /* R, G, B */
};
/* Of a part's headers. FALSE: not known. */
gboolean btf_sigma_read(const struct exr_part *part, struct btf_sigma *ret);

/* Error bars of a session's whole BTF. */
struct btf_sigma_sums {
    int lights, known; /* pictures, and those of them whose errors are known */
    double median;     /* of the known pictures' sigma.median */
    double relative;   /* and of their sigma.relative */
    double share;      /* Σ σ² / Σ ρ² over the known ones */
    int large;         /* pictures whose sigma.relative is above BTF_SIGMA_LARGE */
    int worse;         /* those of them in which it is more than twice the median: what all have is
                          told by the median */
    double worst;      /* largest sigma.relative, in */
    double worst_view_theta_deg, worst_view_phi_deg, worst_light_theta_deg, worst_light_phi_deg;
};
#define BTF_SIGMA_LARGE 0.05

/* Reads the headers of all views in products/btf of a session's directory; views that cannot be
 * read are left out, as are those of a session without any. */
void btf_sigma_sum(const char *directory, struct btf_sigma_sums *ret);
