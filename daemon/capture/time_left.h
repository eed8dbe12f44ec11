/* The predicted time until a session is complete. The plan gives the time of each shot. The rig may
 * be slower or faster than the plan, so the prediction learns the mean delay of the shots of each
 * kind. A Capture owns the struct. All functions belong to the main loop's thread. */
#pragma once

#include "capture_session.h"

/* The work that is left from a shot on, including that shot: its time according to the plan, and
 * the number of shots of each kind (enum session_shot_kind). */
struct shots_left {
    double planned_s;
    int n[SHOT_SWEEP + 1];
};

struct time_left {
    /* predicted time of the whole session according to the plan, and the plan's lower bound */
    double predicted_s, lower_bound_s;
    /* Array of n_shots + 1 elements. Element i is the work that is left before shot i of this run.
     * Element n_shots is the work that is left after the last shot. NULL before the run. */
    struct shots_left *plan;
    guint n_shots;
    /* For each kind of shots: the total time by which shots took longer than planned, and the
     * number of these shots. */
    struct {
        double late_s;
        int n;
    } learnt[SHOT_SWEEP + 1];
    guint n_exposed; /* the number of exposed shots when the time left was last predicted */
    double at_s;     /* time of the last prediction on the session's clock */
    double left_s;   /* time left at at_s */
    /* the time left that is shown is not less than this until the next prediction */
    double min_s;
};

gboolean time_left_load(struct time_left *left, const struct capture_session *session,
                        GError **error);
void time_left_clear(struct time_left *left);

/* Begins a run of these n shots, and predicts its time, including homing. */
void time_left_begin(struct time_left *left, const struct capture_session *session,
                     const struct session_shot *const *shots, guint n);

/* Predicts the time left at the time at_s, when the first n shots of the run have been exposed. */
void time_left_predict(struct time_left *left, guint n, double at_s);

/* Learns from the shots that were exposed since the last prediction, up to shot n of the run, which
 * was exposed at at_s. The time that they took longer than planned is added to the delays of one
 * kind of shots: that of shot n. Call time_left_predict() after each call. Then this function may
 * be called again for another camera of shot n. */
void time_left_learn(struct time_left *left, enum session_shot_kind kind, guint n, double at_s);

/* Returns the time left at now_s: the last prediction minus the time since then, but at least
 * min_s. */
double time_left_at_s(const struct time_left *left, double now_s);

/* Returns the time of a new run of these n shots, including homing. learnt is TRUE if the delays
 * that this run has measured are added. */
double time_left_of_new_run_s(const struct time_left *left, const struct capture_session *session,
                              const struct session_shot *const *shots, guint n, gboolean learnt);
