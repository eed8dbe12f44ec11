/*
 * The joint refinement of cameras, turntable and boards: what geometry makes all corners appear
 * where they were seen. Ceres does the work, behind C.
 *
 * A board point X (mm, z = 0) of a board laid down as `lay`, with the turntable at angle τ of
 * `stop`, is at p = Rz(τ) (R_l X + t_l) in the rig, where t_l is written as (t_x, t_y, h): h is the
 * height at which the print's plane meets the turntable's axis. A camera sees it at project(R_c p +
 * t_c), rig.h's model. The axis itself is the rig's z: it has no parameters.
 *
 * Rotations are R = R_0 (1 + [ω]×…) = R_0 exp(ω); covariances are those of ω at R = R_0.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

#define BUNDLE_INTRINSICS 9 /* fx fy cx cy k1 k2 k3 p1 p2 */

struct bundle_camera {
    double intrinsics[BUNDLE_INTRINSICS];
    double prior[BUNDLE_INTRINSICS];       /* what is known before, and */
    double prior_sigma[BUNDLE_INTRINSICS]; /* how well; 0: nothing. */
    double aspect_sigma;                   /* of fx / fy, around prior's; 0: not known */
    double rotation[9], shift[3];          /* camera = rotation · rig + shift */
    double nominal_centre[3];              /* for the azimuth's mean */
    gboolean fixed_pose, fixed_lens;
    double noise;              /* all its observations' sigmas are that many times too small */
    double covariance[15][15]; /* out: intrinsics, ω, shift; 0 where fixed */
};

struct bundle_lay {
    double rotation[9], place[3]; /* t_x, t_y, h */
    gboolean fixed_height;
    gboolean fixed; /* all of it */
};

struct bundle_stop {
    int lay;
    double commanded_rad, angle_rad;
    double sigma_rad; /* of what they differ by; 0: they do not */
};

struct bundle_observation {
    int camera, stop, point; /* point: of the board; not looked at here */
    double board_mm[2], seen_px[2];
    /* whiten · (projected − seen) has the deviation of the camera's noise times this. */
    double whiten[2][2], noise;
    gboolean rejected;
};

struct bundle {
    struct bundle_camera *cameras;
    struct bundle_lay *lays;
    struct bundle_stop *stops;
    struct bundle_observation *observations;
    int n_cameras, n_lays, n_stops, n_observations;
    gboolean fix_azimuth; /* gauge: the cameras' mean azimuth, and each lay's mean angle */
    double robust;        /* residuals beyond that many sigmas count less */
};

/* Improves everything in place. FALSE with a reason (BUNDLE_ERROR) if it does not converge. */
#define BUNDLE_ERROR bundle_error_quark()
GQuark bundle_error_quark(void);
enum bundle_error {
    BUNDLE_ERROR_FAILED,
    BUNDLE_ERROR_SINGULAR, /* the observations do not determine what is asked */
};
gboolean bundle_solve(struct bundle *bundle, GError **error);

/* Fills in the cameras' covariances, for the noise as it is set. */
gboolean bundle_covariance(struct bundle *bundle, GError **error);

/* Where an observation should be seen; FALSE: behind the camera. */
gboolean bundle_project(const struct bundle *bundle, int camera, int stop, const double board_mm[2],
                        double ret_px[2]);

/* The same, had the lens no distortion. */
gboolean bundle_project_straight(const struct bundle *bundle, int camera, int stop,
                                 const double board_mm[2], double ret_px[2]);

G_END_DECLS
