/*
 * Shared by the parts of the planner: plan_directions.c finds the angles that show each direction,
 * plan.c makes shots of them, plan_blocked.c keeps the arc out of the pictures, plan_tour.c orders
 * poses, plan_order.c the shots, plan_search.c improves both, plan_time.c predicts time,
 * plan_bytes.c disk space, plan_notes.c tells what was decided.
 */
#pragma once

#include "plan.h"

/* Angles of poses are counted in millionths of a degree, so that equal ones are equal. */
#define UDEG           1000000
#define PLAN_FULL_TURN ((gint64)360 * UDEG)

struct plan_pose {
    gint64 turntable_udeg, arc_udeg, arm_udeg, probe_udeg;
};

/* An angle that some direction needs: of the turntable, with the cameras that show a view there, or
 * the light's azimuth α − τ (no cameras). All lamps and lasers that stand by themselves have one
 * together (fixed), at which the arc, if there is one, stands at 0. Where one of the cameras is on
 * the arm (on_arm), all of those on it are at one of its stops, arm_udeg. */
struct plan_angle {
    gint64 udeg;
    guint32 cameras;
    gboolean fixed;
    gboolean on_arm;
    gint64 arm_udeg;
};

struct plan_build {
    const struct session_conf *conf;
    const struct rig *rig;
    const struct rig_timing *timing;
    double radius_mm;                /* around the sample */
    GArray *views, *lights, *lasers; /* of struct session_direction */
    GArray *turns, *azimuths;        /* of struct plan_angle */
    GArray *light_at, *laser_at; /* of int: which of them each light and laser position is lit at */
    GArray *poses;               /* of struct plan_pose */
    GHashTable *pose_index;      /* of poses, number + 1 */
    GArray *shots;               /* of struct session_shot; pose: index into poses */
    gboolean *is_first;          /* of each shot, before they are ordered: of the first round */
    GArray *notes;               /* of struct plan_note */
};

struct plan_note { /* what was re-planned or left out, how often */
    char *text;
    const char *unit; /* "pose", "shot" */
    int n;
};

/* Adds a note to b->notes, or counts it if there is one of the same text. */
void plan_add_note(struct plan_build *b, const char *unit, const char *text);
void plan_clear_note(gpointer note); /* a GDestroyNotify */

/* The plan's notes, of char *, from b->notes and what the plan has come to: its times and
 * frames are set. */
GPtrArray *plan_tell_notes(const struct plan_build *b, const struct plan *plan);

/* Views, lights and laser positions of a session, with the angles of turntable and arc that show
 * them. Errors PLAN_ERROR_NO_CAMERA, _NO_LAMP, _NO_LASER, _LIMITS. */
gboolean plan_add_directions(struct plan_build *b, GError **error);

/* The lamp (SHOT_LAMP) or laser (SHOT_SWEEP) that stands by itself nearest to where a direction of
 * the sample points with the turntable at an angle, and how far from there; −1: none does. */
int plan_fixed_device(const struct rig *rig, enum session_shot_kind kind, double theta_deg,
                      double phi_deg, double turntable_deg, double *ret_off_deg);
/* How far that may be: and from a ring's elevation to a camera's, lamp's or laser's. */
#define PLAN_TOLERANCE_DEG 0.5

gint64 plan_wrap(gint64 udeg); /* into [0, PLAN_FULL_TURN) */

/* An axis that the rig lacks. */
gboolean plan_is_absent(const struct axis_motion *motion);

/* The position of an axis for an angle: that in [0, 360) if the axis wraps, else the one within its
 * limits that is nearest to 0. FALSE if there is none. */
gboolean plan_axis_reach(const struct axis_motion *motion, gint64 udeg, gint64 *ret_udeg);

/* Which of the cameras (bits) cannot see the disc of radius_mm around the origin because the arc or
 * one of the lights (of struct vec3, positions at arc 0) is in the way, or shade one of the lights.
 */
guint32 plan_blocked(const struct rig *rig, guint32 cameras, double arc_deg, double radius_mm,
                     const GArray *lights);
/* The same for one light that stands by itself, the arc aside. */
guint32 plan_blocked_by(const struct rig *rig, guint32 cameras, struct vec3 light_mm,
                        double radius_mm);

/* The smallest turn of the arc, up to 20°, after which none of the cameras is blocked; FALSE if
 * there is none that the axis can reach. */
gboolean plan_shift(const struct rig *rig, const struct axis_motion *arc, guint32 cameras,
                    gint64 arc_udeg, double radius_mm, const GArray *lights,
                    gint64 *ret_shift_udeg);

/* Disk space of the session's frames and database, in blocks of 4 KiB; without products. ret_least:
 * if only the first n_first shots are taken, and no camera sees a laser's line. */
guint64 plan_bytes(const struct plan_build *b, guint n_first, guint64 *ret_least);

/* Describes the effect of skipped shots on the BTF: pictures that it will interpolate, views that
 * it will lack. g_free(); NULL: none. */
char *plan_missing(const struct session_plan *plan);

/* Steps of a sweep of span_deg by a laser: as fine as [lasers] line_mm asks for, sweep_steps at
 * most. */
int plan_sweep_steps(const struct session_conf *conf, const struct rig_laser *laser,
                     double span_deg);

/* Times of moves between poses, all axes together; tables, so that orders are tried quickly. */
struct plan_axis_moves {
    gboolean wraps;
    int *at;   /* row of each pose in the table */
    int n;     /* different positions of the axis */
    double *s; /* n × n: time from the position of the row to that of the column */
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

/* A path through numbered elements, with a cost for every step, also for that to the first (from
 * −1) and from the last (to −1). The search changes the order in place until no change reduces the
 * cost, the lower bound (least) is reached or the budget of cost evaluations is spent. */
struct plan_path {
    int *order;
    int n;
    double (*cost)(gconstpointer data, int from, int to);
    gconstpointer data;
    int longest_moved; /* Or-opt: longest segment that is moved at once */
    double least;
};

double plan_path_cost(const struct plan_path *path);
void plan_path_improve(struct plan_path *path, gint64 budget);

/* Orders some of the poses (indices, permuted in place) so that the moves take little time. A move
 * shorter than floor_s costs floor_s: something else takes that long meanwhile. */
void plan_tour(const struct plan_moves *moves, int *poses, int n, double floor_s);

/* Puts shots into an order, those of a group of lamps one after the other. shots[i].pose is an
 * index into poses; on return it is the number of the visit. Returns how many visits there are.
 * SHOT_DARK come first, skipped shots last, with visits of their own. Sweeps of a laser unit that
 * is mounted by hand come in blocks, one for each of its places.
 *
 * ORDER_QUICKEST: the quickest that is found. ORDER_VIEWS: that of a program that does not plan:
 * for τ, for the arm, for α, for the probe, for lamps, for lasers.
 *
 * MOTION_CONTINUOUS: the quickest of two orders, with shots of lamps that differ in τ alone
 * following each other, as the table passes them, or not. Sets the passes; their numbers begin at
 * 1. */
int plan_order(GArray *shots, const struct plan_pose *poses, int n_poses,
               const struct session_conf *conf, const struct rig *rig,
               const struct rig_timing *timing);
/* The same in an order of choice, with the turntable standing for all shots. */
int plan_order_standing(GArray *shots, const struct plan_pose *poses, int n_poses,
                        const struct rig *rig, const struct rig_timing *timing,
                        enum session_order wanted);

/* passes_set() for an array of shots; the numbers begin behind number. Returns the last one. */
int plan_set_passes(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, int number);

/* From the first exposure of a shot to the end of its last. */
double plan_shot_s(const struct session_shot *shot, const struct session_conf *conf,
                   const struct rig_timing *timing);

/* Least time between the last exposure of a shot and the first of the next one in the same pose:
 * warm-up, the sweep's way back, read-out. previous may be NULL. */
double plan_lead_s(const struct session_shot *previous, const struct session_shot *shot,
                   const struct rig *rig, const struct rig_timing *timing);

/* The angles of a shot's pose. */
struct plan_pose plan_pose_of(const struct session_shot *shot, const struct rig *rig);

/* Time of the move from one shot's pose to that of another, all axes together. */
double plan_shots_move_s(const struct session_shot *from, const struct session_shot *to,
                         const struct rig *rig, const struct rig_timing *timing);

/* Read-out of the slowest camera of a shot. */
double plan_readout_s(const struct session_shot *shot, const struct rig_timing *timing);

/* From the pose of the first shot on. ret_first_s: what the move from where homing leaves the axes,
 * at 0, into that pose adds. */
double plan_total_s(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, double *ret_first_s);

/* shots[i].pose is an index into poses; see plan.h and plan_time.c for the argument. */
double plan_lower_bound_s(GArray *shots, const struct plan_pose *poses, int n_poses,
                          const struct session_conf *conf, const struct rig *rig,
                          const struct rig_timing *timing);
