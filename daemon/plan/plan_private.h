/* Declarations that the parts of the planner share. plan_directions.c finds the angles of the axes
 * that show each direction. plan.c makes the shots at these angles. plan_blocked.c keeps the arc
 * out of the pictures. plan_lamps.c and plan_sweeps.c choose the shots of the first round.
 * plan_tour.c orders poses, plan_order.c shots, and plan_search.c improves both. plan_left.c orders
 * the shots that a session under way still has to take. plan_time.c predicts time, plan_bytes.c
 * disk space. plan_notes.c describes changes of the plan to the user. */
#pragma once

#include "plan.h"

/* The angles of poses are counted in millionths of a degree, so that equal angles compare equal. */
#define UDEG           1000000
#define PLAN_FULL_TURN ((gint64)360 * UDEG)

struct plan_pose {
    gint64 turntable_udeg, arc_udeg, arm_udeg, probe_udeg;
};

/* An angle that some view or light needs. */
struct plan_angle {
    /* If cameras is not empty, an angle of the turntable at which these cameras show a view.
     * Otherwise the entry is for lights, and udeg is the angle of the arc minus that of the
     * turntable. */
    gint64 udeg;
    struct camera_set cameras;
    /* TRUE in the one entry of the lamps and lasers that are not on the arc. The arc stands at 0
     * for this entry. */
    gboolean fixed;
    gboolean on_arm; /* whether one of the cameras is on the arm */
    gint64 arm_udeg; /* if on_arm: the stop of all cameras of this entry that are on the arm */
};

struct plan_build {
    const struct session_conf *conf;
    const struct rig *rig;
    const struct rig_timing *timing;
    /* radius of the circle around the sample, with the origin as its centre */
    double radius_mm;
    GArray *views, *lights, *lasers; /* of struct session_direction */
    GArray *turns, *azimuths;        /* of struct plan_angle */
    /* Of int, for each light and for each laser position: index of its azimuth in azimuths. */
    GArray *light_at, *laser_at;
    GArray *poses;          /* of struct plan_pose */
    GHashTable *pose_index; /* maps a struct plan_pose to its index in poses + 1 */
    GArray *shots;          /* of struct session_shot, whose pose is an index into poses */
    /* for each shot, in the order before plan_order(): whether it belongs to the first round */
    gboolean *is_first;
    GArray *notes; /* of struct plan_note */
};

struct plan_note { /* a reason why shots or poses were changed or left out, and their number */
    char *text;
    const char *unit; /* "pose", "shot" */
    int n;
};

/* Adds a note to b->notes. If there is a note of the same text, its count is increased. */
void plan_add_note(struct plan_build *b, const char *unit, const char *text);
void plan_clear_note(gpointer note); /* a GDestroyNotify */

/* Returns the plan's notes (of char *) from b->notes and from the times and frames of the plan,
 * which must be set. */
GPtrArray *plan_tell_notes(const struct plan_build *b, const struct plan *plan);

/* Adds the views, lights and laser positions of a session, with the angles of turntable and arc
 * that show them. Errors are PLAN_ERROR_NO_CAMERA, _NO_LAMP, _NO_LASER and _LIMITS. */
gboolean plan_add_directions(struct plan_build *b, GError **error);

/* Returns the fixed lamp (SHOT_LAMP) or laser (SHOT_SWEEP) that is nearest to a direction of the
 * sample when the turntable is at an angle. ret_off_deg is the angle between the device and that
 * direction. Returns −1 if there is no such device. */
int plan_fixed_device(const struct rig *rig, enum session_shot_kind kind, double theta_deg,
                      double phi_deg, double turntable_deg, double *ret_off_deg);
/* Maximum angle between a direction of the plan and the fixed device that gives it. It is also the
 * maximum difference between the polar angle of a ring and that of a camera, lamp or laser.
 */
#define PLAN_TOLERANCE_DEG 0.5

gint64 plan_wrap(gint64 udeg); /* returns the angle modulo 360°, from 0 to below PLAN_FULL_TURN */

/* Returns whether the rig does not have this axis. */
gboolean plan_is_absent(const struct axis_motion *motion);

/* Computes the position *ret_udeg at which an axis has an angle (modulo 360°). If the axis wraps,
 * this is the position in [0°, 360°). Otherwise it is the position within the limits of the axis
 * that is nearest to 0. Returns FALSE if there is none. */
gboolean plan_axis_reach(const struct axis_motion *motion, gint64 udeg, gint64 *ret_udeg);

/* Returns those of the cameras that cannot see the whole disc of radius_mm around the origin
 * because the arc or a light is in the way, or that shade the disc from a light. lights contains
 * the positions of the lights (struct vec3) with the arc at 0. */
struct camera_set plan_blocked(const struct rig *rig, struct camera_set cameras, double arc_deg,
                               double radius_mm, const GArray *lights);
/* The same as plan_blocked() for one fixed light, without the arc. */
struct camera_set plan_blocked_by(const struct rig *rig, struct camera_set cameras,
                                  struct vec3 light_mm, double radius_mm);

/* Finds the smallest turn of the arc, *ret_shift_udeg, after which none of the cameras is blocked.
 * Turns are tried in steps of 0.1° up to 20°. Returns FALSE if there is none within the limits of
 * the axis. */
gboolean plan_shift(const struct rig *rig, const struct axis_motion *arc, struct camera_set cameras,
                    gint64 arc_udeg, double radius_mm, const GArray *lights,
                    gint64 *ret_shift_udeg);

/* Returns the disk space in bytes of the session's frames and database, without products. Each
 * file takes a multiple of 4 KiB. ret_least is the disk space if only the first n_first shots
 * are taken and no camera sees a laser's line. */
guint64 plan_bytes(const struct plan_build *b, guint n_first, guint64 *ret_least);

/* Describes the effect of skipped shots on the BTF: the number of pictures that will be predicted,
 * or the number of views without a BTF. Returns NULL if no shot of a lamp is skipped. g_free() */
char *plan_missing(const struct session_plan *plan);

/* Returns the number of steps of a sweep of span_deg: as many as a line of the width [lasers]
 * line_mm needs, but at least 24 and at most [capture] sweep_steps. Returns sweep_steps if
 * line_mm is 0. */
int plan_sweep_steps(const struct session_conf *conf, const struct rig_laser *laser,
                     double span_deg);

/* Times of moves between poses with all axes moving together. They are stored in tables, so that
 * orders can be compared quickly. */
struct plan_axis_moves {
    gboolean wraps;
    int *at;   /* for each pose: index of the axis's position at this pose */
    int n;     /* number of different positions of the axis */
    double *s; /* n × n: s[i · n + j] is the time of the move from position i to position j */
};

struct plan_moves {
    int n;
    const struct plan_pose *poses; /* borrowed */
    struct plan_axis_moves turntable, arc, arm, probe;
};

struct plan_moves *plan_moves_new(const struct plan_pose *poses, int n,
                                  const struct rig_timing *timing);
void plan_moves_free(struct plan_moves *moves); /* NULL is ignored */

static inline double plan_axis_move_s(const struct plan_axis_moves *axis, int from, int to) {
    return axis->s[(gsize)axis->at[from] * (gsize)axis->n + (gsize)axis->at[to]];
}

static inline double plan_move_s(const struct plan_moves *m, int from, int to) {
    double turn = plan_axis_move_s(&m->turntable, from, to);
    double arc = plan_axis_move_s(&m->arc, from, to);
    double arm = plan_axis_move_s(&m->arm, from, to);
    double probe = plan_axis_move_s(&m->probe, from, to);
    double longest = turn > arc ? turn : arc;
    longest = arm > longest ? arm : longest;
    return probe > longest ? probe : longest;
}

/* A path through numbered elements. Each step has a cost, including the step to the first element
 * (from −1) and the step from the last (to −1). The search changes the order in place. It stops
 * when no change reduces the cost, when the cost reaches the lower bound (least), or when the
 * budget of cost evaluations is spent. */
struct plan_path {
    int *order;
    int n;
    double (*cost)(gconstpointer data, int from, int to);
    gconstpointer data;
    int longest_moved; /* maximum length of a segment that is moved (Or-opt) */
    double least;
};

double plan_path_cost(const struct plan_path *path);
void plan_path_improve(struct plan_path *path, gint64 budget);

/* Orders some of the poses (indices, permuted in place) so that the moves take little time. A move
 * shorter than floor_s costs floor_s, because something else takes that long during the move. */
void plan_tour(const struct plan_moves *moves, int *poses, int n, double floor_s);

/* Orders the shots. On entry shots[i].pose is an index into poses. On return it is the number of
 * the visit of the pose. Returns the number of visits. SHOT_DARK come first. Skipped shots come
 * last and have numbers of further visits; the first of them share the last visit if they have its
 * pose. Sweeps of a laser unit that is mounted by hand come in blocks, one for each of its places.
 *
 * ORDER_QUICKEST uses the quickest order that is found. ORDER_VIEWS uses the order of a program
 * that does not plan: nested loops over τ, the arm, α, the probe, the lamps and the lasers.
 *
 * MOTION_CONTINUOUS compares two orders and uses the quicker one. In one of them, shots of lamps
 * that differ only in τ follow each other, so that the turntable passes them in one movement. Sets
 * the numbers of the passes, which begin at 1. */
int plan_order(GArray *shots, const struct plan_pose *poses, int n_poses,
               const struct session_conf *conf, const struct rig *rig,
               const struct rig_timing *timing);
/* The same as plan_order(), but with the order `wanted` instead of [capture] order, and with the
 * turntable standing still for all shots. */
int plan_order_standing(GArray *shots, const struct plan_pose *poses, int n_poses,
                        const struct rig *rig, const struct rig_timing *timing,
                        enum session_order wanted);

/* Calls passes_set() for an array of shots. The first pass gets the number `number` + 1. Returns
 * the number of the last pass, or `number` if there is no pass. */
int plan_set_passes(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, int number);

/* Returns the time in seconds from the start of the first exposure of a shot to the end of its last
 * exposure. */
double plan_shot_s(const struct session_shot *shot, const struct session_conf *conf,
                   const struct rig_timing *timing);

/* Returns the time in seconds in which the light of a shot becomes ready after another shot.
 * previous is NULL if no shot precedes. */
double plan_light_s(const struct session_shot *previous, const struct session_shot *shot,
                    const struct rig *rig, const struct rig_timing *timing);

/* Returns the minimum time between the last exposure of a shot and the first exposure of the next
 * shot in the same pose: warm-up, return of the sweep axis, read-out. previous is NULL if no shot
 * precedes. */
double plan_lead_s(const struct session_shot *previous, const struct session_shot *shot,
                   const struct rig *rig, const struct rig_timing *timing);

/* Returns the angles of a shot's pose. */
struct plan_pose plan_pose_of(const struct session_shot *shot, const struct rig *rig);

/* Returns the time of the move between the poses of two shots, with all axes moving together. */
double plan_shots_move_s(const struct session_shot *from, const struct session_shot *to,
                         const struct rig *rig, const struct rig_timing *timing);

/* Returns the read-out time of the slowest camera of a shot. */
double plan_readout_s(const struct session_shot *shot, const struct rig_timing *timing);

/* Returns the predicted time of the shots, counted from the moment when the axes are in the pose of
 * the first shot. *ret_first_s is the additional time of the move into that pose from 0, where
 * homing leaves every axis with home_deg 0; other values of home_deg are ignored. */
double plan_total_s(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, double *ret_first_s);

/* Returns a lower bound of the time of the shots in any order, without homing. shots[i].pose is an
 * index into poses. plan_time.c has the proof. */
double plan_lower_bound_s(GArray *shots, const struct plan_pose *poses, int n_poses,
                          const struct session_conf *conf, const struct rig *rig,
                          const struct rig_timing *timing);
