/* Makes an ordered list of poses and shots from a rig and a session file. The planner is a pure
 * function: it opens no devices and moves nothing, and the same input gives the same plan.
 *
 * Every view is taken under every light and swept from every laser position. A view is a camera
 * with the turntable at an angle τ. A light is a direction of azimuth φ_l relative to the
 * turntable: a lamp on the arc at the arc angle α = φ_l + τ, or a lamp that is fixed at the
 * azimuth φ_l + τ. The plan is therefore a set of poses (τ, α), each with its shots.
 *
 * Cameras on an arm and lamps on a probe have views and lights at each of their stops. With these
 * axes poses are (τ, α, β, γ), where β and γ are the angles of arm and probe. A pose without a
 * camera of the arm is taken with the arm at the first stop of the rig. A pose without a lamp of
 * the probe is taken with the probe at its first stop. An axis that the rig does not have stands
 * at 0, and its struct rig_timing has the limits 0 to 0.
 *
 * Fixed lamps give all lights of all views only if their arrangement looks the same from all angles
 * of the turntable that the views need. Shots under a light that no lamp gives are skipped.
 *
 * All axes move together. All orders make the same exposures and differ only in the moves. The
 * planner chooses the order with the shortest predicted time.
 *
 * The prediction follows the sequencer. Before a shot, everything is prepared together while
 * frames are read out: the axes move, the lamp or laser is switched on and warms up, the sweep
 * axis moves to its first step. A lamp that the previous shot has left on is warm. plan_time.c has
 * the model and proves a lower bound of the time of any order. Each shot takes at least the
 * warm-up of its lamp or, if the lamp was left on, the quickest move into its pose.
 *
 * If lamps take longer to warm up than axes take to move, the quickest order visits the poses once
 * for each lamp.
 *
 * With [capture] motion = continuous, the turntable passes poses that differ only in τ without a
 * stop (passes.h). The lower bound assumes the given passes in any order.
 *
 * Sweeps of a laser unit that is mounted by hand come in blocks, one for each of its mount
 * positions. The block of the present position comes first, because this needs the fewest
 * mountings. Predictions include the homing of the axes at the beginning, which takes the axes'
 * homing_s. They do not include the time that the operator needs for a mounting, nor the homing
 * after it. */
#pragma once

#include "passes.h"
#include "rig/devices.h"
#include "selection/coverage_model.h"
#include "session/session.h"
#include "session_conf.h"

/* Limits of a plan. 200 views under 200 lights, each with its own pose, are planned within minutes
 * and with half a gigabyte of memory. */
#define PLAN_MAX_POSES      40000
#define PLAN_MAX_SHOTS      100000
#define PLAN_MAX_ARC_ANGLES 8192

/* Checks that a user has not given the rig file and the session file in the wrong order. Returns
 * FALSE with an error if rig_path is a session file, or if session_path is a rig file. */
gboolean plan_check_order(const char *rig_path, const char *session_path, GError **error);

struct plan {
    struct session_plan session; /* grid, directions, shots; owned by the plan */
    /* number of visits of poses; a pose may be visited several times, for different lamps */
    int n_poses;
    /* number of camera frames to be triggered, including those of brackets and sweeps */
    int n_frames;
    /* predicted bytes on disk if the cameras see the laser lines wherever they pass the sample, and
     * all shots are taken */
    guint64 bytes;
    /* predicted bytes on disk if the cameras see no laser lines, and the first round is
     * sufficient */
    guint64 bytes_least;
    double predicted_s;
    double lower_bound_s;
    /* number of mountings by hand, including the one at the beginning; 0 if every laser unit has
     * only one place */
    int n_mounts;
    double nested_s; /* predicted time of the nested order: loops over τ, α and lamps */
    /* with STOP_COVERED or SAMPLING_ADAPTIVE the predicted time if the first round is sufficient;
     * otherwise predicted_s */
    double first_s;
    int n_first; /* number of shots of the first round, which come first in session.shots */
    /* numbers of shots that are taken only if the first round is not sufficient */
    int n_later_sweeps, n_later_lamps;
    /* With MOTION_CONTINUOUS: the number of passes, and the number of shots that are taken in
     * passes. */
    int n_passes, n_passing;
    struct passes_speed passes;
    /* with MOTION_CONTINUOUS the predicted time if the turntable stands still for all shots */
    double standing_s;
    GPtrArray *notes; /* of char *: changes of the plan and shots left out, with the reasons */
};

#define PLAN_ERROR plan_error_quark()
GQuark plan_error_quark(void);
enum plan_error {
    /* no camera at the given polar angle; the message lists those of the rig */
    PLAN_ERROR_NO_CAMERA,
    PLAN_ERROR_NO_LAMP,
    PLAN_ERROR_NO_LASER,
    /* An axis cannot reach a position, or an exposure is out of range. Also used if the session
     * asks for a mode that the rig or the rest of the session does not allow. */
    PLAN_ERROR_LIMITS,
    /* The arc or a light is in a camera's way, or a camera is in a light's way, and on_blocked is
     * refuse. */
    PLAN_ERROR_BLOCKED,
    PLAN_ERROR_SIZE, /* more poses or shots than a plan may have */
};

/* Sets an error that begins with the place in the session file: "FILE:LINE: [section] key: ".
 * key may be NULL. For a session that was not read from a file, FILE and LINE are left out; LINE
 * is also left out if the file has no such section. */
void plan_set_error(GError **error, enum plan_error code, const struct session_conf *conf,
                    const char *section, const char *key, const char *format, ...)
    G_GNUC_PRINTF(6, 7);

/* Makes a plan. rig is the nominal geometry. With a calibrated geometry, azimuths would differ by
 * hundredths of a degree and could not share poses. Step k of a sweep is at from + (to −
 * from)·k/(steps − 1). */
struct plan *plan_build(const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, GError **error);
void plan_free(struct plan *plan); /* NULL is ignored */
typedef struct plan Plan;
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Plan, plan_free)

/* Points of the reference plane that the pixels of a camera show, on a grid over its picture. */
#define PLAN_FOOTPRINT 16
struct plan_footprint {
    struct vec3 points_mm[PLAN_FOOTPRINT * PLAN_FOOTPRINT]; /* rig frame */
    int n;
};
struct plan_footprint plan_footprint(const struct session_conf *conf,
                                     const struct rig_camera *camera);

/* Returns the disk space of one camera's part of a shot, including kept frames and the row.
 * footprint is the footprint of this camera. Pictures for which plan_bytes_vary() is true are
 * compressed, and their size depends on their noise. A sweep is assumed to be visible wherever it
 * passes the sample. Pixels without a line take almost no space. */
guint64 plan_shot_bytes(const struct session_conf *conf, const struct rig *rig,
                        const struct session_shot *shot, int camera, int bits,
                        const struct plan_footprint *footprint);
gboolean plan_bytes_vary(const struct rig_camera *camera);

/* Returns the bytes that a stored frame takes: those of its file and of its row in the database. */
guint64 plan_stored_bytes(guint64 file_bytes);
/* Returns the bytes of a session's database without the rows of its frames and directions. */
guint64 plan_database_bytes(int n_shots);

/* Returns the time that the axes take to home, all together. */
double plan_homing_s(const struct rig *rig, const struct rig_timing *timing);

/* Sets ret_first[i] to whether shot i of n belongs to the first round of [lasers] stop = covered.
 * The first round has all shots that are not sweeps, and the sweeps that may add much according to
 * the rig's geometry. The sweeps of each turntable angle are chosen one after the other, and at
 * most as many as the key `first` of [lasers] says. The next sweep is always the one with the
 * largest sum of coverage_model_adds() over its cameras. The order of the shots does not matter.
 * Without STOP_COVERED, all shots belong to the first round. */
void plan_first_sweeps(const struct session_conf *conf, const struct rig *rig,
                       const struct session_shot *const *shots, int n, gboolean *ret_first);

/* Sets ret_first[i] for those of n shots that are of lamps: whether the shot belongs to the first
 * round of [lights] sampling = adaptive. The elements of other shots do not change. For each
 * turntable angle, the first round has on average as many shots as the key `first` of [lights]
 * says. The shots are spread over all pairs of a view and a light of this rig. Shots that take less
 * time are preferred. The first round is the same for all materials. A larger value of `first` adds
 * shots to those of a smaller value. Without SAMPLING_ADAPTIVE nothing is set. */
void plan_first_lamps(const struct session_conf *conf, const struct rig *rig,
                      const struct rig_timing *timing, const struct session_shot *const *shots,
                      int n, gboolean *ret_first);

/* Gives the time that each of n shots adds to a round if its pose is visited only for this shot,
 * coming from the nearest pose of another shot. ret_s has n values in seconds. The time is 0 for
 * shots that are skipped or not of lamps. */
void plan_lamp_prices_s(const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, const struct session_shot *const *shots,
                        int n, double *ret_s);

/* Makes a chain of lamp shots that follow each other quickly. The caller sets chain[0], the index
 * of the first shot. Each next shot is the one of the n shots that takes the least time after the
 * shot before it. The chain ends when it has `most` shots, or when no shot is left. chain receives
 * the indices of the shots, and has room for `most`. Returns the number of shots in the chain.
 * *ret_s is the time of all its shots except the first. */
int plan_lamp_chain(const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, const struct session_shot *const *shots, int n,
                    int most, int *chain, double *ret_s);

/* Puts some shots of a session, done or not, into a quick order according to [capture] order. Dark
 * shots come first. The pointers are moved; the shots do not change. */
void plan_order_left(struct session_shot **shots, int n, const struct session_conf *conf,
                     const struct rig *rig, const struct rig_timing *timing);

/* Returns the time that counts against the budget of lamps. It is the time of the given lamp shots,
 * done or not, in the order of plan_order_left(), including the homing of the axes before them. */
double plan_lamps_s(const struct session_shot *const *shots, int n, const struct session_conf *conf,
                    const struct rig *rig, const struct rig_timing *timing);

/* Groups n shots into sweeps of the same turntable angle. Returns a GPtrArray, in order of angle,
 * of GArrays of int: indices of shots in order of laser position. A group has at most
 * COVERAGE_MAX_SWEEPS sweeps. Further sweeps are in no group. */
GPtrArray *plan_sweep_groups(const struct session_shot *const *shots, int n);

/* Returns the coverage model of a camera and the sweeps of a group. w is the depth resolution of a
 * sweep (mdf_weight()). The variance of a distance is proportional to 1/w², but the MDF weighs
 * sweeps by w. A sweep with a small w therefore adds noise to every texel that it lights. For this
 * reason, the model gives each sweep the quality (w / max w)⁴, where max w is the largest w of the
 * group. */
CoverageModel *plan_sweep_model(const struct rig *rig, int camera,
                                const struct session_shot *const *shots, const GArray *group);

/* Computes the angles of the sweep axis between which a laser's sheet passes over the sample's box
 * with its margin: from *ret_from_deg to *ret_to_deg. */
void plan_sweep_deg(const struct session_conf *conf, const struct rig *rig, int laser,
                    double turntable_deg, double arc_deg, double *ret_from_deg, double *ret_to_deg);

/* Predict the time in seconds for those of the n shots that are still planned, in this order. The
 * moves begin at the pose of the shot `from`. If `from` is NULL, they begin at 0, where homing
 * leaves every axis with home_deg 0; other values of home_deg are ignored. ret_left_s has n + 1
 * values. Value i is the time from the end of the last exposure before shot i until all shots are
 * taken. Value n is the time left after the last shot. plan_remaining_s() returns value 0. */
void plan_left_s(const struct session_shot *const *shots, int n, const struct session_conf *conf,
                 const struct rig *rig, const struct rig_timing *timing,
                 const struct session_shot *from, double *ret_left_s);
double plan_remaining_s(const struct session_shot *const *shots, int n,
                        const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, const struct session_shot *from);
