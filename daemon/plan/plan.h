/*
 * From a rig and a session file to an ordered list of poses and shots. A pure function: it opens
 * nothing and moves nothing, and the same input gives the same plan.
 *
 * Every view (camera at turntable angle τ) is taken under every light (lamp at arc angle
 * α = φ_l + τ, or that which stands by itself at azimuth φ_l + τ) and swept from every laser
 * position, so what is planned is a set of poses (τ, α), each with its shots. Cameras on an arm and
 * lamps on a probe have views and lights at each of their stops, so that with these axes poses are
 * (τ, α, β, γ), β and γ being the angles of arm and probe; a pose without a camera of the arm is
 * taken with the arm at the first stop of the rig, one without a lamp of the probe likewise. An
 * axis that the rig lacks stands at 0, and its struct rig_timing has the limits 0 to 0. Lamps that
 * stand by themselves give all lights of all views only if they look alike from all angles of the
 * turntable that the views need; shots under a light that no lamp gives are skipped. All axes move
 * together. All orders make the same exposures; they differ in the moves. The order is chosen by
 * predicted time.
 *
 * Predicted time counts what the sequencer does: before a shot everything is prepared at once (both
 * axes, lamp or laser and its warm-up, the sweep's first step) while frames are read out; a lamp
 * that the shot before has left on is warm. plan_time.c has the model, and proves the lower bound
 * of the time of any order: before each shot passes at least its warm-up or, if the lamp was left
 * on, the quickest move into its pose.
 *
 * Where lamps take longer to warm up than axes to move, the quickest order visits the poses once
 * for each lamp.
 *
 * With [capture] motion = continuous the turntable passes by the poses that differ in τ alone
 * without a stop (passes/passes.h); in the lower bound passes are as they are, in any order.
 *
 * Sweeps of a laser unit that is mounted by hand come in blocks, one for each of its mount
 * positions, its own first; this needs the fewest mountings. Predictions leave out the operator's
 * time and the homing of the axes afterwards; that at the beginning takes what the axes' homing_s
 * say.
 */
#pragma once

#include "conf/session_conf.h"
#include "coverage/coverage_model.h"
#include "passes/passes.h"
#include "rig/devices.h"
#include "session/session.h"

/* Limits of a plan. 200 views under 200 lights, each with a pose of its own, are planned within
 * minutes and half a gigabyte. */
#define PLAN_MAX_POSES      40000
#define PLAN_MAX_SHOTS      100000
#define PLAN_MAX_ARC_ANGLES 8192

/* Whether neither path is that of the other kind of file: a command takes the rig file first. */
gboolean plan_check_order(const char *rig_path, const char *session_path, GError **error);

struct plan {
    struct session_plan session; /* grid, directions, shots; owned by the plan */
    int n_poses;                 /* visits counted: a pose may be visited again for another lamp */
    int n_frames;                /* camera frames to be triggered, brackets and sweeps counted */
    guint64 bytes;               /* on disk, predicted: the cameras see the lines wherever they pass
                                    the sample, and all shots are taken */
    guint64 bytes_least;         /* they see none of them, and the first round suffices */
    double predicted_s;
    double lower_bound_s;
    int n_mounts;    /* by hand, that at the beginning counted; 0: no unit has a further place */
    double nested_s; /* predicted for the nested order: for τ, for α, for lamps */
    double first_s;  /* STOP_COVERED, SAMPLING_ADAPTIVE: predicted if the first round suffices;
                        else predicted_s */
    int n_first;     /* shots of the first round; they come first */
    int n_later_sweeps, n_later_lamps; /* shots that are taken only if it does not suffice */
    int n_passes, n_passing; /* MOTION_CONTINUOUS: passes, and the shots that are taken in them */
    struct passes_speed passes;
    double standing_s; /* the same: predicted with the turntable standing for all of them */
    GPtrArray *notes;  /* char *: what was re-planned or left out, and why */
};

#define PLAN_ERROR plan_error_quark()
GQuark plan_error_quark(void);
enum plan_error {
    PLAN_ERROR_NO_CAMERA, /* none at an asked elevation; lists those there are */
    PLAN_ERROR_NO_LAMP,
    PLAN_ERROR_NO_LASER,
    PLAN_ERROR_LIMITS,  /* an axis cannot get there, an exposure is out of range */
    PLAN_ERROR_BLOCKED, /* the arc stands in a camera's view, and on_blocked says refuse */
    PLAN_ERROR_SIZE,    /* more poses or shots than a plan may have */
};

/* Sets an error that begins with the place in the session file: "FILE:LINE: [section] key: ". key
 * may be NULL; a plan whose session was not read from a file has no place. */
void plan_set_error(GError **error, enum plan_error code, const struct session_conf *conf,
                    const char *section, const char *key, const char *format, ...)
    G_GNUC_PRINTF(6, 7);

/* rig is the nominal geometry: azimuths that differ by a calibration's hundredths of a degree would
 * not share poses. Step k of a sweep is meant to be at from + (to − from)·k/(steps − 1). */
struct plan *plan_build(const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, GError **error);
void plan_free(struct plan *plan); /* NULL is ignored */
typedef struct plan Plan;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Plan, plan_free)

/* Points of the reference plane that a camera's pixels show, on a grid over its picture. */
#define PLAN_FOOTPRINT 16
struct plan_footprint {
    struct vec3 points_mm[PLAN_FOOTPRINT * PLAN_FOOTPRINT]; /* rig frame */
    int n;
};
struct plan_footprint plan_footprint(const struct session_conf *conf,
                                     const struct rig_camera *camera);

/* Disk space that one camera's part of a shot takes, kept frames and row included. Pictures for
 * which plan_bytes_vary() is true are compressed: they take what their noise needs. A sweep is
 * assumed to be seen wherever it passes the sample; pixels without a line take next to nothing.
 * footprint is the camera's. */
guint64 plan_shot_bytes(const struct session_conf *conf, const struct rig *rig,
                        const struct session_shot *shot, int camera, int bits,
                        const struct plan_footprint *footprint);
gboolean plan_bytes_vary(const struct rig_camera *camera);

/* Bytes that a stored frame takes, its file and its row in the database. */
guint64 plan_stored_bytes(guint64 file_bytes);
/* Bytes of a session's database without the rows of its frames and directions. */
guint64 plan_database_bytes(int n_shots);

/* How long the axes take to home, all at once. */
double plan_homing_s(const struct rig *rig, const struct rig_timing *timing);

/* Which of n shots belong to the first round of [lasers] stop = covered (ret_first, n): all but the
 * sweeps that the rig's geometry says may add little. Of the sweeps of each turntable angle those
 * are chosen, one after the other, that coverage_model_adds() says most of for all of their cameras
 * together. The order of the shots does not matter. Without STOP_COVERED: all. */
void plan_first_sweeps(const struct session_conf *conf, const struct rig *rig,
                       const struct session_shot *const *shots, int n, gboolean *ret_first);

/* Which of n shots of lamps belong to the first round of [lights] sampling = adaptive (ret_first,
 * n, is set for these alone): [lights] first for each turntable angle, spread over all pairs of a
 * view and a light of this rig, those that take less time first. Every material has the same, and
 * a larger first has those of a smaller one. Without SAMPLING_ADAPTIVE nothing is set. */
void plan_first_lamps(const struct session_conf *conf, const struct rig *rig,
                      const struct rig_timing *timing, const struct session_shot *const *shots,
                      int n, gboolean *ret_first);

/* The time that each of n shots adds to a round that visits its pose for it alone, coming from
 * the nearest pose of another one; 0 for those that are not of lamps, or skipped. */
void plan_lamp_prices_s(const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, const struct session_shot *const *shots,
                        int n, double *ret_s);

/* Shots that follow each other quickly, all of lamps: from chain[0] on, always the one of the n
 * that takes least time after the last, until the chain has most of them or no other is left.
 * Returns its length; ret_s: the time of all but the first. */
int plan_lamp_chain(const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, const struct session_shot *const *shots, int n,
                    int most, int *chain, double *ret_s);

/* Puts shots, some of a session's, done or not, into a quick order of their own ([capture] order is
 * kept to); dark ones come first. The pointers are moved, the shots stay as they are. */
void plan_order_left(struct session_shot **shots, int n, const struct session_conf *conf,
                     const struct rig *rig, const struct rig_timing *timing);

/* The time that the budget of lamps is counted in: that of these shots, all of them of lamps, done
 * or not, in the order of plan_order_left(), with the homing of the axes before them. */
double plan_lamps_s(const struct session_shot *const *shots, int n, const struct session_conf *conf,
                    const struct rig *rig, const struct rig_timing *timing);

/* Sweeps of the same turntable angle: numbers of n shots, in order of laser position; a GPtrArray
 * of GArrays of int, in order of angle. At most COVERAGE_MAX_SWEEPS each; others are in none. */
GPtrArray *plan_sweep_groups(const struct session_shot *const *shots, int n);

/* The model of a camera and the sweeps of a group. The variance of a distance goes with the inverse
 * square of a sweep's depth resolution w (mdf_weight()), while the MDF weighs sweeps by w: one of
 * low resolution adds noise to every texel that it lights. It therefore counts for little here, q =
 * (w / max w)⁴, until nothing else lights what it lights. */
CoverageModel *plan_sweep_model(const struct rig *rig, int camera,
                                const struct session_shot *const *shots, const GArray *group);

/* The sweep angles at which a laser's sheet passes the edges of the sample's box and its margin. */
void plan_sweep_deg(const struct session_conf *conf, const struct rig *rig, int laser,
                    double turntable_deg, double arc_deg, double *ret_from_deg, double *ret_to_deg);

/* Predicted time of those of the shots that are still planned, in this order and from the pose of a
 * shot, or, if from is NULL, from where homing leaves the axes, at 0; for the time left. ret_left_s
 * (n + 1): what is left before each of them, when the last exposure of the one before has ended,
 * and after the last one. plan_remaining_s: the first of these. */
void plan_left_s(const struct session_shot *const *shots, int n, const struct session_conf *conf,
                 const struct rig *rig, const struct rig_timing *timing,
                 const struct session_shot *from, double *ret_left_s);
double plan_remaining_s(const struct session_shot *const *shots, int n,
                        const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, const struct session_shot *from);
