/* The predicted time until a session is complete. The plan gives the time of each shot. It does not
 * know how fast this rig is, so the prediction learns from the shots of each kind how late they
 * are. Owned by the Capture. Main loop's thread. */
#pragma once

#include "capture_session.h"

/* The work that is left before a shot: the time according to the plan, and the number of shots of
 * each kind (enum session_shot_kind). */
struct shots_left {
    double planned_s;
    int n[SHOT_SWEEP + 1];
};

struct time_left {
    double predicted_s, lower_bound_s; /* of the whole session, by the plan */
    /* The work that is left before each of the n_shots shots of this run and, in the last element,
     * after the last shot. NULL before the run. */
    struct shots_left *plan;
    guint n_shots;
    /* The time by which the shots of each kind took longer than planned, and the number of these
     * shots. */
    struct {
        double late_s;
        int n;
    } learnt[SHOT_SWEEP + 1];
    guint n_exposed; /* the number of exposed shots when the time left was last predicted */
    double at_s;     /* the time of that prediction */
    double left_s;   /* the prediction */
    double min_s;    /* lower bound until the next exposure */
};

gboolean time_left_load(struct time_left *left, const struct capture_session *session,
                        GError **error);
void time_left_clear(struct time_left *left);

/* Begins a run of these n shots, which begins with homing. */
void time_left_begin(struct time_left *left, const struct capture_session *session,
                     const struct session_shot *const *shots, guint n);

/* Predicts the time left from the moment at_s at which the first n shots of the run were exposed.
 */
void time_left_predict(struct time_left *left, guint n, double at_s);

/* Assigns the time since the last prediction to the shots that were exposed since then. The last of
 * them is shot n of the run and is of this kind. Call it before time_left_predict(). If several
 * cameras end the same shot, each adds its additional time. */
void time_left_learn(struct time_left *left, enum session_shot_kind kind, guint n, double at_s);

/* Returns the time left at now_s, counted down from the last prediction. */
double time_left_at_s(const struct time_left *left, double now_s);

/* Returns the time left if a run begins anew with these n shots. learnt says whether the times that
 * this run has measured are used. */
double time_left_of_new_run_s(const struct time_left *left, const struct capture_session *session,
                              const struct session_shot *const *shots, guint n, gboolean learnt);
