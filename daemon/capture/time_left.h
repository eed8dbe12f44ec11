/* The predicted time until a session is complete. The plan gives the time of each shot. The rig may
 * be slower or faster than the plan, so the prediction learns the mean delay of the shots of each
 * kind. Owned by the Capture. Main loop's thread. */
#pragma once

#include "capture_session.h"

/* The work that is left from a shot on, including that shot: its time according to the plan, and
 * the number of shots of each kind (enum session_shot_kind). */
struct shots_left {
    double planned_s;
    int n[SHOT_SWEEP + 1];
};

struct time_left {
    /* according to the plan: predicted time of the whole session, and a lower bound of the time */
    double predicted_s, lower_bound_s;
    /* n_shots + 1 elements: the work that is left before each of the n_shots shots of this run, and
     * after the last shot. NULL before the run. */
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
    double min_s;    /* minimum of the time left that is shown until the next prediction */
};

gboolean time_left_load(struct time_left *left, const struct capture_session *session,
                        GError **error);
void time_left_clear(struct time_left *left);

/* Begins a run of these n shots, and predicts its time, including homing. */
void time_left_begin(struct time_left *left, const struct capture_session *session,
                     const struct session_shot *const *shots, guint n);

/* Predicts the time left from the moment at_s at which the first n shots of the run were exposed.
 */
void time_left_predict(struct time_left *left, guint n, double at_s);

/* Learns from the shots that were exposed since the last prediction, up to shot n of the run, which
 * was exposed at at_s. Their delay since the last prediction, compared with the plan, is added to
 * the delays of this kind of shot (the kind of shot n). Call time_left_predict() after each call.
 * The function may then be called for each camera of shot n. */
void time_left_learn(struct time_left *left, enum session_shot_kind kind, guint n, double at_s);

/* Returns the time left at now_s: the last prediction minus the time since then, but at least
 * min_s. */
double time_left_at_s(const struct time_left *left, double now_s);

/* Returns the time of a new run of these n shots, including homing. learnt is TRUE if the delays
 * that this run has measured are added. */
double time_left_of_new_run_s(const struct time_left *left, const struct capture_session *session,
                              const struct session_shot *const *shots, guint n, gboolean learnt);
