/*
 * Calibrates the positions of the lamps and the axis of their arc from a target of known size:
 * the shadows of posts on a plate (Bouguet and Perona 1998), or the lamps' mirror images in
 * glossy balls.
 *
 * The part of the plate that a post hides from a camera is its shadow with the camera as the
 * lamp, whose position is known: it locates the post. From shadows alone a wider plate and nearer
 * lamps look nearly alike.
 *
 * A post's shadow ends where the ray from the lamp over its top meets the plate; a ball shows the
 * lamp where its normal bisects the angle between camera and lamp. All sights of all lamps, at
 * all angles of arc and turntable, are adjusted together: the lamps' positions, the tilt and
 * position of the arc's axis, and the position of each post or ball on the plate. Cameras must be
 * calibrated.
 *
 * Drives deviate from their commanded angles, and sights at the same angle share that error: the
 * errors of turntable and arc at each angle are parameters as well, and their standard deviations
 * are estimated. The same applies to the marks' sizes within their tolerance.
 *
 * A pointing error of a camera of some hundredths of a pixel would shift all that it sees; it is
 * a parameter with mean 0 and the standard deviation LAMPS_CAMERA_PX.
 *
 * The zero of the arc's angle and a rotation of all lamps about its axis are equivalent: the zero
 * is chosen so that the lamps are closest to the nominal ones. Where no lamp is on the arc, there
 * is neither: each lamp's position is found as it is, in the rig frame.
 *
 * Pure; any thread.
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

/* Advice of an error about two exchanged lamps; printf arguments: the names of both. */
#define LAMPS_EXCHANGE_THEM                                                                        \
    "exchange the indexes of [lamp %s] and [lamp %s] in the rig file, or their wiring, or for "    \
    "imported pictures their names in the table, and capture or import again"

/* Standard deviation of the pointing error of cameras after calibration. */
#define LAMPS_CAMERA_PX 0.1

#define LAMP_MAX_MARKS 64

enum lamp_target_kind { LAMP_POLES, LAMP_BALLS };

struct lamp_mark {
    double x_mm, y_mm; /* approximate position of its foot in the sample frame */
    double size_mm;    /* a post's height above the plate, a ball's radius */
};

struct lamp_target {
    enum lamp_target_kind kind;
    double plane_mm;    /* height of the plate's top above the turntable */
    double radius_mm;   /* radius of the posts */
    double plate_mm[2]; /* the plate's size along x and y; centred */
    struct lamp_mark marks[LAMP_MAX_MARKS];
    int n;
    double tolerance_mm; /* standard deviation of the marks' sizes */
};

/* Reads the description of a target (base/config.h), as etc/demo/poles.conf. The error lists all
 * mistakes of the file. */
gboolean lamp_target_load(struct lamp_target *target, const char *path, GError **error);

/* A measurement of one post or ball in one picture. */
struct lamp_sight {
    int picture; /* for messages; any number */
    int lamp;    /* −1: poles only, the post itself: the part of the plate that it hides from the
                    camera */
    int camera, mark;
    double turntable_rad, arc_rad;
    double x, y;  /* poles: end of the top's shadow on the plate, mm, sample frame; balls: px */
    double sigma; /* standard deviation of x and y */
};

struct lamps_result {
    struct rig rig; /* with lamps and arc as estimated; the aim keeps its angle to the origin */
    gboolean seen[RIG_MAX_LAMPS];
    double covariance_mm2[RIG_MAX_LAMPS][3][3]; /* of the lamp's position with the arc at 0 */
    int sights[RIG_MAX_LAMPS];                  /* number of sights that were used */
    double zero_error_rad;
    gboolean arc_known; /* whether the axis was determined; else it is the nominal one */
    double tilt_error_rad[2], centre_error_mm[2];
    struct lamp_target target;      /* the target with the estimated positions of its marks */
    double size_mm[LAMP_MAX_MARKS]; /* the marks' sizes as estimated within their tolerance, */
    double size_error_mm[LAMP_MAX_MARKS]; /* and their standard errors; 0: not seen */
    double rms;   /* RMS residual of the used sights: mm on the plate, or px */
    double sigma; /* residuals over their expected standard deviation */
    double turntable_rad,
        drive_rad; /* standard deviation of the angle errors of turntable and arc */
    int n_used, degrees_of_freedom;
    guint8 *rejected; /* one flag per sight; owned */
};

/* Estimates lamps and arc. rig: calibrated cameras, nominal lamps and arc. A lamp that is found
 * five times nearer to the nominal place of another one than to its own is LAMPS_ERROR_MISTAKE.
 * After LAMPS_ERROR_DEGENERATE ret has rms, sigma and n_used of the attempt, 0 if there was none;
 * it owns nothing then. */
gboolean lamps_fit(const struct rig *rig, const struct lamp_target *target,
                   const struct lamp_sight *sights, int n, struct lamps_result *ret,
                   GError **error);

/* Tries whether the marks have other sizes than the target's, if more than noise keeps the sights
 * from fitting: estimates once more with sizes that are hardly known. as_said: the result of
 * lamps_fit() on the same sights, or what is left of it after LAMPS_ERROR_DEGENERATE. FALSE and
 * LAMPS_ERROR_MISTAKE: the sights fit at least three times better with other sizes, which the
 * message names. */
gboolean lamps_check_sizes(const struct rig *rig, const struct lamp_target *target,
                           const struct lamp_sight *sights, int n,
                           const struct lamps_result *as_said, GError **error);
void lamps_result_clear(struct lamps_result *result);

/* Predicts the two kinds of sight. FALSE: it is not visible. lamp and centre are in the same
 * frame, z up from the turntable. */
gboolean lamp_shadow_mm(const struct lamp_target *target, int mark, struct vec3 foot_mm,
                        struct vec3 lamp_mm, struct vec3 *ret_end_mm, double *ret_radius_mm);
gboolean lamp_highlight_px(const struct rig_camera *camera, struct vec3 centre_mm, double radius_mm,
                           struct vec3 lamp_mm, double *ret_x, double *ret_y);

/* Position of a mark's foot, or of a ball's centre, in the rig frame. */
struct vec3 lamp_mark_mm(const struct lamp_target *target, int mark, double turntable_rad);
