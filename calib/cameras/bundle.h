/*
 * Bundle adjustment of cameras, turntable angles and boards. It minimises the reprojection errors
 * of all corners with Ceres, behind a C interface.
 *
 * A board point X (mm) has z = b₀ x² + b₁ x y + b₂ y², where b is the bend that all boards have in
 * common. The board is in the position `lay`, with rotation R_l and translation t_l, and the
 * turntable is at the angle τ of `stop`. In the rig frame the point is at p = Rz(τ) (R_l X + t_l).
 * If the turntable's bearing wobbles (struct rig_wobble in rig.h), it is at W(τ) p, where W uses
 * the commanded angle. t_l has the parameters (t_x, t_y, h), where h is the height at which the
 * plane of the print meets the turntable's axis. This axis is the z axis of the rig and has no
 * parameters. A camera sees p at project(R_c p + t_c), with the camera model of rig.h.
 *
 * Rotations are R = R₀ exp([ω]×). Covariances are those of ω at R = R₀.
 *
 * The residuals of one picture are not independent. If the board is bent in one picture, if the
 * picture is compressed, or if the lens deviates from its model, neighbouring corners move
 * together. Covariances therefore contain the scatter between pictures (bundle_covariance()).
 */
#pragma once

#include "geometry/lens.h"

G_BEGIN_DECLS

#define BUNDLE_INTRINSICS 12 /* fx fy cx cy k1 k2 k3 p1 p2 k4 k5 k6 */
#define BUNDLE_CAMERA     18 /* parameters of a camera, in the order of its covariance */
/* The parameters of the wobble are the real and imaginary parts of z_n for n = −1, 2, −2, 3, −3, 4,
 * −4, with the tilt x + i y = Σ z_n exp(i n τ). A tilt with n = 1 turns with the board and is part
 * of its pose. */
#define BUNDLE_HARMONICS 4 /* as RIG_WOBBLE_HARMONICS */
#define BUNDLE_WOBBLE    (4 * BUNDLE_HARMONICS - 2)

struct bundle_camera {
    enum rig_lens lens; /* parameters that this model does not have are not changed */
    double intrinsics[BUNDLE_INTRINSICS];
    double prior[BUNDLE_INTRINSICS];       /* means of the priors */
    double prior_sigma[BUNDLE_INTRINSICS]; /* standard deviations of the priors; 0: no prior */
    double rotation[9], shift[3];          /* camera = rotation · rig + shift */
    /* centre of the camera by the rig file, mm; see fix_azimuth in struct bundle */
    double nominal_centre[3];
    gboolean fixed_pose, fixed_lens;
    /* index of this camera minus the index of the camera whose lens it shares; 0: the camera has
     * its own lens */
    int stop;
    double noise; /* factor by which `noise` of its observations is too small */
    /* Output: covariance in the order fx … p2, ω, shift, k4, k5, k6, as in enum
     * calibration_camera_parameter. Fixed parameters have 0. */
    double covariance[BUNDLE_CAMERA][BUNDLE_CAMERA];
};

/* A lay is one position of the board on the turntable. */
struct bundle_lay {
    double rotation[9], place[3]; /* place: t_x, t_y and h above, mm */
    gboolean fixed_height;
    gboolean fixed; /* position and rotation are not adjusted */
};

struct bundle_stop {
    int lay;
    double commanded_rad, angle_rad;
    double sigma_rad; /* standard deviation of angle_rad − commanded_rad; 0: the two are equal */
};

struct bundle_observation {
    /* Indices of the camera and of the stop. All observations of one picture have the same number
     * `picture`. The adjustment does not use `corner`; the caller may store a number there. */
    int camera, stop, picture, corner;
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
    double bend[3]; /* b₀, b₁, b₂, in 1 / mm */
    double bend_sigma; /* prior standard deviation of b₀, b₁ and b₂; 0: the bend is not adjusted */
    double wobble[BUNDLE_WOBBLE];
    int wobble_harmonics; /* highest harmonic that is adjusted; 0: the wobble is not adjusted */
    /* output: standard error of the tilt, RMS over a turn; 0 if the wobble is not adjusted */
    double wobble_error_rad;
    /* If TRUE, the cameras' mean azimuth stays at the nominal one, and each lay's mean angle at the
     * commanded one. */
    gboolean fix_azimuth;
    double robust; /* Huber's threshold in standard deviations; 0: plain least squares */
    /* If TRUE, the solver stops when a step lowers the cost by less than the fraction 1e-5. */
    gboolean coarse;
};

#define BUNDLE_ERROR bundle_error_quark()
GQuark bundle_error_quark(void);
enum bundle_error {
    BUNDLE_ERROR_FAILED,
    BUNDLE_ERROR_SINGULAR, /* the observations do not determine all parameters */
};
/* Minimises the cost, and changes the parameters in place. Returns FALSE with a BUNDLE_ERROR if
 * Ceres finds no usable solution. The parameters are then not changed. */
gboolean bundle_solve(struct bundle *bundle, GError **error);

/* Converts the parameters of the wobble to the form of rig.h. */
struct rig_wobble;
void bundle_wobble(const double wobble[BUNDLE_WOBBLE], struct rig_wobble *ret);

/* Sets the cameras' covariances and the error of the wobble.
 *
 * C = (JᵀJ)⁻¹ is the covariance if residuals are independent and have the given noise. The estimate
 * S is cluster-robust (Liang & Zeger 1986). A cluster is a picture i with the residuals r_i and the
 * rows J_i of J. The residuals are corrected for the part that the fit has absorbed (CR2, Bell &
 * McCaffrey 2002). With J_p the rows of priors,
 *   S = C J_pᵀ J_p C + Σ_i u_i u_iᵀ,  u_i = C J_iᵀ (I − J_i C J_iᵀ)^−½ r_i.
 * The expectation of S is C if C is right.
 *
 * S has only as many degrees of freedom as there are pictures, which is few for its many entries.
 * It is therefore shrunk towards a multiple of C. With n pictures and p parameters of the camera,
 *   V = g (n S + p f C) / (n + p),  f = max(1, tr(C⁻¹ S) / p).
 * ret_inflation gets f of each camera, in the order of the cameras; it may be NULL.
 *
 * Errors in units of a scatter that is estimated from n pictures follow Student's t with n − 1
 * degrees of freedom (Cameron & Miller 2015). Therefore g = 1 + (t² − 1)(1 − 1 / f), where t is the
 * 97.5 % quantile of Student's t divided by that of the normal distribution. g is 1 if f is 1. */
gboolean bundle_covariance(struct bundle *bundle, double *ret_inflation, GError **error);

/* Projects a board point to the picture. If straight is TRUE, the point is projected as by a lens
 * without distortion. Returns FALSE if the point is behind the camera (for a fisheye, straight
 * behind it), or beyond the range of a rational lens. */
gboolean bundle_project(const struct bundle *bundle, int camera, int stop, gboolean straight,
                        const double board_mm[2], double ret_px[2]);

G_END_DECLS
