/*
 * Calibrates the positions of the lamps and the axis of their arc from a target of known size. The
 * target shows either the shadows of posts on a plate (Bouguet and Perona 1998), or the lamps'
 * mirror images in glossy balls.
 *
 * The part of the plate that a post hides from a camera counts as a shadow whose lamp is the
 * camera. The position of this lamp is known, so that the shadow locates the post. The shadows of
 * the lamps alone would not be sufficient, because lamps that are nearer shift the ends of the
 * shadows in nearly the same way as posts that stand farther apart.
 *
 * A post's shadow ends where the ray from the lamp over its top meets the plate. A ball shows the
 * lamp where its normal bisects the angle between camera and lamp. All sights of all lamps, at all
 * angles of arc and turntable, are adjusted together. The adjusted parameters are the lamps'
 * positions, the tilt and position of the arc's axis, and the position of each post or ball on the
 * plate. Cameras must be calibrated.
 *
 * Drives deviate from their commanded angles, and sights at the same angle share that error. The
 * errors of turntable and arc at each angle are therefore parameters as well, and their standard
 * deviations are estimated. The marks' sizes are also parameters, within their tolerance.
 *
 * A pointing error of a camera of some hundredths of a pixel would shift everything that the camera
 * sees. Such an error is a parameter with mean 0 and standard deviation LAMPS_CAMERA_PX.
 *
 * A shift of the zero of the arc's angle is equivalent to a rotation of all lamps about the arc's
 * axis. The zero is chosen so that the lamps are closest to the nominal ones. If the arc angles
 * cover less than 60°, the tilt and position of the axis stay nominal. If no lamp is on the arc,
 * the zero stays nominal as well, and each lamp's position is estimated directly in the rig frame.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "geometry/rig.h"
#include "pictures/picture.h"

#define LAMPS_ERROR lamps_error_quark()
GQuark lamps_error_quark(void);
enum lamps_error {
    LAMPS_ERROR_PICTURES,   /* posts, balls or lamps that should be visible are not */
    LAMPS_ERROR_DEGENERATE, /* the pictures do not determine all parameters */
    LAMPS_ERROR_MISTAKE, /* the given facts about the pictures are wrong; the message says which */
};

/* Advice of an error about two exchanged lamps. The printf arguments are the names of both. */
#define LAMPS_EXCHANGE_THEM                                                                        \
    "exchange the indexes of [lamp %s] and [lamp %s] in the rig file, or their wiring, or for "    \
    "imported pictures their names in the table, and capture or import again"

/* Standard deviation of the pointing error of cameras after calibration. */
#define LAMPS_CAMERA_PX 0.1

#define LAMP_MAX_MARKS 64

enum lamp_target_kind { LAMP_POLES, LAMP_BALLS };

struct lamp_mark {
    double x_mm, y_mm; /* approximate position of the mark's foot in the sample frame */
    double size_mm;    /* height of a post above the plate, or radius of a ball */
};

struct lamp_target {
    enum lamp_target_kind kind;
    double plane_mm;    /* height of the plate's top above the turntable */
    double radius_mm;   /* radius of the posts */
    double plate_mm[2]; /* size of the plate along x and y; its middle is the origin */
    struct lamp_mark marks[LAMP_MAX_MARKS];
    int n;
    double tolerance_mm; /* standard deviation of the marks' sizes */
};

/* Reads the description of a target (base/config.h). etc/demo/poles.conf is an example. The error
 * lists all mistakes of the file. */
gboolean lamp_target_load(struct lamp_target *target, const char *path, GError **error);

/* A sight: the measured shadow, highlight or outline of one post or ball in one picture. */
struct lamp_sight {
    int picture; /* any number, for the caller's messages */
    /* −1 for a sight of the post itself, which is the part of the plate that the post hides from
     * the camera. Only posts have such sights. */
    int lamp;
    int camera, mark;
    double turntable_rad, arc_rad;
    /* For a post: the end of the shadow of its top on the plate, in mm, in the sample frame. For a
     * ball: the highlight in the picture, in px. */
    double x, y;
    double sigma; /* standard deviation of x and of y, in their unit */
};

struct lamps_result {
    /* The rig with estimated lamps and arc. The aim of a lamp keeps its angle to the origin. */
    struct rig rig;
    gboolean seen[RIG_MAX_LAMPS];
    /* covariance of the lamp's position with the arc at 0 */
    double covariance_mm2[RIG_MAX_LAMPS][3][3];
    int sights[RIG_MAX_LAMPS]; /* number of sights that were used */
    /* standard error of the zero of the arc's angle */
    double zero_error_rad;
    /* whether the arc's axis was determined; if not, rig has the nominal axis */
    gboolean arc_known;
    /* standard errors of the arc's axis; 0 if it was not determined */
    double tilt_error_rad[2], centre_error_mm[2];
    struct lamp_target target;      /* the target with the estimated positions of its marks */
    double size_mm[LAMP_MAX_MARKS]; /* the marks' sizes as estimated within their tolerance */
    /* standard errors of these sizes; 0 for marks that were not seen */
    double size_error_mm[LAMP_MAX_MARKS];
    double rms;   /* RMS residual of the used sights: mm on the plate, or px */
    double sigma; /* RMS residual divided by its expected standard deviation */
    /* standard deviation of the angle errors of the turntable (turntable_rad) and of the arc
     * (drive_rad) */
    double turntable_rad, drive_rad;
    int n_used, degrees_of_freedom;
    guint8 *rejected; /* one flag per sight; owned */
};

/* Estimates lamps and arc. rig has calibrated cameras, and nominal lamps and arc. The error is
 * LAMPS_ERROR_MISTAKE if a lamp is found five times nearer to the nominal place of another lamp
 * than to its own place. Call lamps_result_clear() after success. After LAMPS_ERROR_DEGENERATE, ret
 * owns nothing and has rms, sigma and n_used of the attempt, or 0 if there was no attempt. */
gboolean lamps_fit(const struct rig *rig, const struct lamp_target *target,
                   const struct lamp_sight *sights, int n, struct lamps_result *ret,
                   GError **error);

/* Tests whether the marks have other sizes than the target says, if the sights disagree by more
 * than noise. For this the estimate is repeated with weak priors of the sizes. as_said is what
 * lamps_fit() has written for the same sights, on success or with LAMPS_ERROR_DEGENERATE. Returns
 * FALSE with LAMPS_ERROR_MISTAKE, whose message names the sizes, if the sights fit at least three
 * times better with other sizes. Otherwise returns TRUE. */
gboolean lamps_check_sizes(const struct rig *rig, const struct lamp_target *target,
                           const struct lamp_sight *sights, int n,
                           const struct lamps_result *as_said, GError **error);
void lamps_result_clear(struct lamps_result *result);

/* Predict the end of a post's shadow, and a ball's highlight. They return FALSE if the shadow or
 * highlight does not exist or is not visible. lamp_mm, foot_mm and centre_mm are in the same frame,
 * with z up from the turntable. ret_radius_mm gets the radius of the shadow's end. ret_radius_mm
 * may be NULL. */
gboolean lamp_shadow_mm(const struct lamp_target *target, int mark, struct vec3 foot_mm,
                        struct vec3 lamp_mm, struct vec3 *ret_end_mm, double *ret_radius_mm);
gboolean lamp_highlight_px(const struct rig_camera *camera, struct vec3 centre_mm, double radius_mm,
                           struct vec3 lamp_mm, double *ret_x, double *ret_y);

/* Returns the position of a post's foot, or of a ball's centre, in the rig frame. */
struct vec3 lamp_mark_mm(const struct lamp_target *target, int mark, double turntable_rad);
