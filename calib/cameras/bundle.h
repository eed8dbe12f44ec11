/*
 * Bundle adjustment of cameras, turntable angles and boards: minimises the reprojection errors of
 * all corners (with Ceres, behind a C interface).
 *
 * A board point X (mm, z = b₀ x² + b₁ x y + b₂ y², b being the bend that all boards have in common)
 * of a board in the position `lay`, with the turntable at angle τ of `stop`, is at p = Rz(τ) (R_l X
 * + t_l) in the rig frame, or at W(τ) p if the turntable's bearing wobbles (struct rig_wobble in
 * rig.h; τ is the commanded angle there). t_l is parametrised as (t_x, t_y, h), h being the height
 * at which the print's plane meets the turntable's axis, which is the rig's z axis and has no
 * parameters. A camera sees p at project(R_c p + t_c), rig.h's model.
 *
 * Rotations are R = R₀ exp([ω]×); covariances are those of ω at R = R₀.
 *
 * Residuals of one picture are not independent: a board that is bent in it, compression or a lens
 * that is not quite as its model says move neighbouring corners together. Covariances therefore
 * contain the scatter between pictures (bundle_covariance()).
 */
#pragma once

#include "geometry/lens.h"

G_BEGIN_DECLS

#define BUNDLE_INTRINSICS 12 /* fx fy cx cy k1 k2 k3 p1 p2 k4 k5 k6 */
#define BUNDLE_CAMERA     18 /* parameters of a camera, in the order of its covariance */
/* Parameters of the wobble: real and imaginary part of z_n, x + i y = Σ z_n exp(i n τ), for n = −1,
 * 2, −2, 3, −3, 4, −4. A tilt with n = 1 turns with the board and is part of its pose. */
#define BUNDLE_HARMONICS 4 /* as RIG_WOBBLE_HARMONICS */
#define BUNDLE_WOBBLE    (4 * BUNDLE_HARMONICS - 2)

struct bundle_camera {
    enum rig_lens lens; /* parameters that the model does not have are not changed */
    double intrinsics[BUNDLE_INTRINSICS];
    double prior[BUNDLE_INTRINSICS];       /* prior values, */
    double prior_sigma[BUNDLE_INTRINSICS]; /* and their standard deviations; 0: no prior */
    double rotation[9], shift[3];          /* camera = rotation · rig + shift */
    double nominal_centre[3];              /* for the gauge of the azimuth */
    gboolean fixed_pose, fixed_lens;
    int stop;     /* offset back to the camera whose lens it shares; 0: it has its own */
    double noise; /* factor by which the sigmas of its observations are too small */
    /* Out: fx … p2, ω, shift, k4, k5, k6, the order of enum calibration_camera_parameter; 0 where
     * fixed. */
    double covariance[BUNDLE_CAMERA][BUNDLE_CAMERA];
};

struct bundle_lay {
    double rotation[9], place[3]; /* t_x, t_y, h */
    gboolean fixed_height;
    gboolean fixed; /* position and rotation */
};

struct bundle_stop {
    int lay;
    double commanded_rad, angle_rad;
    double sigma_rad; /* standard deviation of their difference; 0: they are equal */
};

struct bundle_observation {
    int camera, stop, picture, corner; /* picture and corner are only for the caller */
    double board_mm[2], seen_px[2];
    /* whiten · (projected − seen) has the standard deviation camera.noise · noise. */
    double whiten[2][2], noise;
    gboolean rejected;
};

struct bundle {
    struct bundle_camera *cameras;
    struct bundle_lay *lays;
    struct bundle_stop *stops;
    struct bundle_observation *observations;
    int n_cameras, n_lays, n_stops, n_observations;
    double bend[3];    /* b₀, b₁, b₂, in 1 / mm */
    double bend_sigma; /* standard deviation of each about 0, a prior; 0: they stay as they are */
    double wobble[BUNDLE_WOBBLE];
    int wobble_harmonics; /* the highest harmonic that is adjusted; 0: the wobble stays as it is */
    double wobble_error_rad; /* out: standard deviation of the tilt, mean over a turn; 0: fixed */
    gboolean fix_azimuth;    /* gauge: fixes the cameras' mean azimuth and each lay's mean angle */
    double robust;           /* Huber's threshold in standard deviations; 0: plain least squares */
    gboolean coarse;         /* stops when a step lowers the cost by less than 1e-5 of it */
};

/* Minimises in place. FALSE with a BUNDLE_ERROR if it does not converge. */
#define BUNDLE_ERROR bundle_error_quark()
GQuark bundle_error_quark(void);
enum bundle_error {
    BUNDLE_ERROR_FAILED,
    BUNDLE_ERROR_SINGULAR, /* the observations do not determine all parameters */
};
gboolean bundle_solve(struct bundle *bundle, GError **error);

/* The wobble of the parameters, in rig.h's form. */
struct rig_wobble;
void bundle_wobble(const double wobble[BUNDLE_WOBBLE], struct rig_wobble *ret);

/* Sets the cameras' covariances, and the error of the wobble. C = (JᵀJ)⁻¹ holds if residuals are
 * independent and of the noise given. The cluster-robust estimate, a cluster being a picture i with
 * residuals r_i (Liang & Zeger 1986), with residuals corrected for what the fit has taken from them
 * (CR2, Bell & McCaffrey 2002), is S = C J_pᵀ J_p C + Σ_i u_i u_iᵀ,  u_i = C J_iᵀ (I − J_i C
 * J_iᵀ)^−½ r_i, J_p being the rows of priors; its expectation is C if C is right. It has as many
 * degrees of freedom as there are pictures, few for so many entries, so that it is shrunk towards a
 * multiple of C: with n pictures and p parameters of the camera V = g (n S + p f C) / (n + p), f =
 * max(1, tr(C⁻¹ S) / p). f is ret_inflation of each camera (may be NULL). Errors in units of a
 * scatter that n pictures show follow Student's t of n − 1 degrees of freedom (Cameron & Miller
 * 2015): g = 1 + (t² − 1)(1 − 1 / f), t being its 97.5 % over that of normal errors, if f is
 * above 1. */
gboolean bundle_covariance(struct bundle *bundle, double *ret_inflation, GError **error);

/* Projects a board point. straight: as if the lens had no distortion. FALSE: behind the camera. */
gboolean bundle_project(const struct bundle *bundle, int camera, int stop, gboolean straight,
                        const double board_mm[2], double ret_px[2]);

G_END_DECLS
