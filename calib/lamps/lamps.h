/*
 * Where the lamps are and how their arc turns, from what is seen of them on a target whose size is
 * known: the shadows of posts on a plate (Bouguet and Perona 1998), or the lamps' mirror images in
 * glossy balls.
 *
 * What a post hides of the plate from a camera is its shadow with the camera for a lamp, whose
 * place is known: that tells where it stands. From shadows alone a wider plate and nearer lamps
 * look nearly alike.
 *
 * A post's shadow ends where the ray from the lamp over its top comes down; a ball shows the lamp
 * where its normal halves the angle between camera and lamp. All sights of all lamps, at all angles
 * of arc and turntable, are adjusted together: the lamps' positions, the lean and place of the
 * arc's axis, and where on the plate each post or ball stands. Cameras must have been calibrated.
 *
 * Drives do not stand quite where they were sent, and sights at one angle of theirs share that
 * error: by what the turntable and the arc were off at each angle is adjusted too, and from all of
 * them how far each is off as a rule. The same goes for the marks' sizes within their tolerance.
 *
 * A camera that looks aside by some hundredths of a pixel would move all it sees; how far each does
 * is adjusted too, from 0 as far as LAMPS_CAMERA_PX allows.
 *
 * The zero of the arc's angle and a turn of all lamps about its axis cannot be told apart: the zero
 * is the one that brings the nominal lamps nearest to those found.
 *
 * Pure; any thread.
 */
#pragma once

#include "geometry/rig.h"
#include "pictures/picture.h"

#define LAMPS_ERROR lamps_error_quark()
GQuark lamps_error_quark(void);
enum lamps_error {
    LAMPS_ERROR_TARGET,     /* the target's description makes no sense */
    LAMPS_ERROR_PICTURES,   /* what should be seen is not */
    LAMPS_ERROR_DEGENERATE, /* the pictures do not determine what is asked for */
};

/* What cameras may look aside, standard deviation: what is left of a calibration's errors. */
#define LAMPS_CAMERA_PX 0.1

#define LAMP_MAX_MARKS 64

enum lamp_target_kind { LAMP_POLES, LAMP_BALLS };

struct lamp_mark {
    double x_mm, y_mm; /* of its foot in the sample frame, as well as it is known */
    double size_mm;    /* a post's height above the plate, a ball's radius */
};

struct lamp_target {
    enum lamp_target_kind kind;
    double plane_mm;    /* height of the plate's top above the turntable */
    double radius_mm;   /* of the posts */
    double plate_mm[2]; /* the plate's size along x and y; centred */
    struct lamp_mark marks[LAMP_MAX_MARKS];
    int n;
    double tolerance_mm; /* of the marks' sizes, standard deviation */
};

/* A key file; see etc/demo/poles.conf. */
gboolean lamp_target_load(struct lamp_target *target, const char *path, GError **error);

/* What one picture shows of one post or ball. */
struct lamp_sight {
    int picture; /* for messages; any number */
    int lamp; /* −1: poles only, the post itself: where its top hides the plate from the camera */
    int camera, mark;
    double turntable_rad, arc_rad;
    double x, y;  /* poles: end of the top's shadow on the plate, mm, sample frame; balls: px */
    double sigma; /* standard deviation of x and y */
};

struct lamps_result {
    struct rig rig; /* with lamps and arc as found; the aim keeps its angle to the origin */
    gboolean seen[RIG_MAX_LAMPS];
    double covariance_mm2[RIG_MAX_LAMPS][3][3]; /* of the lamp's place with the arc at 0 */
    int sights[RIG_MAX_LAMPS];                  /* used */
    double zero_error_rad;
    gboolean arc_known; /* whether the axis could be told; else it is as it was */
    double tilt_error_rad[2], centre_error_mm[2];
    struct lamp_target target;       /* with the marks where they stand */
    double rms;                      /* of the sights used: mm on the plate, or px */
    double sigma;                    /* how much larger errors are than the sights' sigma */
    double turntable_rad, drive_rad; /* what turntable and arc were off by, as a rule */
    int n_used, degrees_of_freedom;
    guint8 *rejected; /* a sight; owned */
};

/* Adjusts. rig: calibrated cameras, nominal lamps and arc. */
gboolean lamps_fit(const struct rig *rig, const struct lamp_target *target,
                   const struct lamp_sight *sights, int n, struct lamps_result *ret,
                   GError **error);
void lamps_result_clear(struct lamps_result *result);

/* The two kinds of sight as they should be. FALSE: it cannot be seen. lamp and centre in the same
 * frame, z up from the turntable. */
gboolean lamp_shadow_mm(const struct lamp_target *target, int mark, struct vec3 foot_mm,
                        struct vec3 lamp_mm, struct vec3 *ret_end_mm, double *ret_radius_mm);
gboolean lamp_highlight_px(const struct rig_camera *camera, struct vec3 centre_mm, double radius_mm,
                           struct vec3 lamp_mm, double *ret_x, double *ret_y);

/* Where a mark's foot, or a ball's centre, is in the rig frame. */
struct vec3 lamp_mark_mm(const struct lamp_target *target, int mark, double turntable_rad);
