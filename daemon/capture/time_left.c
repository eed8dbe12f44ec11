#include "time_left.h"

/* The mean delay is computed as if this number of further shots had had no delay, so that the first
 * shots do not have too much influence. */
#define DOUBTED 0.5

gboolean time_left_load(struct time_left *left, const struct capture_session *session,
                        GError **error) {
    return capture_session_load(session, "predicted_s", &left->predicted_s, error) &&
           capture_session_load(session, "lower_bound_s", &left->lower_bound_s, error);
}

void time_left_clear(struct time_left *left) {
    g_clear_pointer(&left->plan, g_free);
}

static struct shots_left *plan_shots(const struct capture_session *session,
                                     const struct session_shot *const *shots, guint n) {
    const struct devices *devices = session->devices;
    struct shots_left *ret = g_new0(struct shots_left, n + 1);
    g_autofree double *left_s = g_new(double, n + 1);
    plan_left_s(shots, (int)n, &session->conf, &devices->geometry, &devices->timing, NULL, left_s);
    ret[n].planned_s = left_s[n];
    for (guint i = n; i-- > 0;) {
        ret[i] = ret[i + 1];
        ret[i].n[shots[i]->kind]++;
        ret[i].planned_s = left_s[i];
    }
    return ret;
}

/* Returns the predicted time of the shots: the time of the plan and, for each shot, the mean delay
 * of the earlier shots of its kind. At least 0. */
static double predict(const struct time_left *left, const struct shots_left *shots) {
    double sum_s = shots->planned_s;
    for (int k = 0; k <= SHOT_SWEEP; k++)
        sum_s += shots->n[k] * left->learnt[k].late_s / (left->learnt[k].n + DOUBTED);
    return MAX(sum_s, 0);
}

void time_left_predict(struct time_left *left, guint n, double at_s) {
    left->n_exposed = n;
    left->at_s = at_s;
    left->left_s = predict(left, &left->plan[n]);
    left->min_s = predict(left, &left->plan[MIN(n + 1, left->n_shots)]);
}

void time_left_begin(struct time_left *left, const struct capture_session *session,
                     const struct session_shot *const *shots, guint n) {
    const struct devices *devices = session->devices;
    time_left_clear(left);
    left->plan = plan_shots(session, shots, n);
    left->n_shots = n;
    time_left_predict(left, 0, capture_session_now_s(session));
    left->min_s = left->left_s;
    left->left_s += plan_homing_s(&devices->geometry, &devices->timing);
}

void time_left_learn(struct time_left *left, enum session_shot_kind kind, guint n, double at_s) {
    const struct shots_left *plan = left->plan;
    left->learnt[kind].late_s +=
        at_s - left->at_s - (plan[left->n_exposed].planned_s - plan[n].planned_s);
    left->learnt[kind].n += (int)(n - left->n_exposed);
}

double time_left_at_s(const struct time_left *left, double now_s) {
    const double passed_s = now_s - left->at_s;
    return MAX(left->left_s - passed_s, left->min_s);
}

double time_left_of_new_run_s(const struct time_left *left, const struct capture_session *session,
                              const struct session_shot *const *shots, guint n, gboolean learnt) {
    const struct devices *devices = session->devices;
    g_autofree struct shots_left *plan = plan_shots(session, shots, n);
    return plan_homing_s(&devices->geometry, &devices->timing) +
           (learnt ? predict(left, plan) : plan->planned_s);
}
