#include "plan_private.h"

#include "shot_frames.h"

/* Predicts the time that the sequencer takes. Before each picture, everything is prepared together:
 * all axes of the pose move, the lamp or laser is switched on and warms up, and the sweep axis
 * moves to its first step. Frames of the previous picture are read out at the same time. All of
 * this begins at the end of the last exposure of the previous picture. A lamp that is still on from
 * the previous shot stays on and is warm.
 *
 * Within a bracket the sequencer only waits for read-out, and within a sweep for read-out and the
 * step. A sweep ends with one picture from its middle, after the laser was switched off. */

/* Returns the longest time, in seconds, of the cameras of a shot. All of them are triggered
 * together, so the slowest one determines the time. */
static double slowest_s(const struct session_shot *shot, const gint64 *camera_us) {
    gint64 longest_us = 0;

    for (int c = camera_set_next(shot->cameras, -1); c >= 0; c = camera_set_next(shot->cameras, c))
        longest_us = MAX(longest_us, camera_us[c]);
    return longest_us / 1e6;
}

double plan_readout_s(const struct session_shot *shot, const struct rig_timing *timing) {
    return slowest_s(shot, timing->readout_us);
}

static double middle_deg(const struct session_shot *shot) {
    return (shot->sweep_from_deg + shot->sweep_to_deg) / 2;
}

double plan_shot_s(const struct session_shot *shot, const struct session_conf *conf,
                   const struct rig_timing *timing) {
    int n = shot_n_frames(conf, shot);
    double readout_s = plan_readout_s(shot, timing);
    double sum_s = (n - 1) * readout_s + n * slowest_s(shot, timing->trigger_us);

    if (shot->state == SHOT_SKIPPED)
        return 0;
    for (int i = 0; i < n; i++)
        sum_s += shot_exposure_us(conf, shot, i) / 1e6;
    if (shot->kind == SHOT_SWEEP) {
        const struct axis_motion *sweep = &timing->sweep[shot->device];
        double from_deg = shot->sweep_from_deg, to_deg = shot->sweep_to_deg;
        double step_deg = (to_deg - from_deg) / (shot->sweep_steps - 1);
        double step_s = axis_move_time_s(sweep, from_deg, from_deg + step_deg);
        double to_middle_s = axis_move_time_s(sweep, to_deg, middle_deg(shot));
        sum_s +=
            (shot->sweep_steps - 1) * MAX(0, step_s - readout_s) + MAX(0, to_middle_s - readout_s);
    }
    return sum_s;
}

/* For a sweep, the sweep axis is assumed to stand in the middle of the range of this sweep: the
 * last picture of the laser's previous sweep was taken in the middle of its range. */
double plan_light_s(const struct session_shot *previous, const struct session_shot *shot,
                    const struct rig *rig, const struct rig_timing *timing) {
    if (shot->kind == SHOT_SWEEP)
        return MAX(
            timing->laser_warm_up_s[shot->device],
            axis_move_time_s(&timing->sweep[shot->device], middle_deg(shot), shot->sweep_from_deg));
    if (shot->kind == SHOT_DARK ||
        (previous && previous->kind == SHOT_LAMP &&
         rig_lamp_unit(rig, previous->device) == rig_lamp_unit(rig, shot->device)))
        return 0;
    return timing->lamp_warm_up_s[shot->device];
}

double plan_lead_s(const struct session_shot *previous, const struct session_shot *shot,
                   const struct rig *rig, const struct rig_timing *timing) {
    double readout_s = previous ? plan_readout_s(previous, timing) : 0;

    return MAX(plan_light_s(previous, shot, rig, timing), readout_s);
}

struct plan_pose plan_pose_of(const struct session_shot *shot, const struct rig *rig) {
    const int lamp = shot->kind == SHOT_LAMP ? shot->device : -1;

    return (struct plan_pose){llround(shot->turntable_deg * UDEG), llround(shot->arc_deg * UDEG),
                              llround(rig_arm_deg(rig, shot->cameras) * UDEG),
                              llround(rig_probe_deg(rig, lamp) * UDEG)};
}

/* Returns the time in seconds of a move between two poses. All axes move together. */
static double pose_move_s(const struct plan_pose *from, const struct plan_pose *to,
                          const struct rig_timing *timing) {
    const struct {
        const struct axis_motion *motion;
        gint64 from, to;
    } axes[] = {{&timing->turntable, from->turntable_udeg, to->turntable_udeg},
                {&timing->arc, from->arc_udeg, to->arc_udeg},
                {&timing->arm, from->arm_udeg, to->arm_udeg},
                {&timing->probe, from->probe_udeg, to->probe_udeg}};
    double longest_s = 0;

    for (gsize i = 0; i < G_N_ELEMENTS(axes); i++)
        longest_s = MAX(longest_s, axis_move_time_s(axes[i].motion, (double)axes[i].from / UDEG,
                                                    (double)axes[i].to / UDEG));
    return longest_s;
}

double plan_shots_move_s(const struct session_shot *from, const struct session_shot *to,
                         const struct rig *rig, const struct rig_timing *timing) {
    const struct plan_pose a = plan_pose_of(from, rig), b = plan_pose_of(to, rig);

    return pose_move_s(&a, &b, timing);
}

/* The positions of the axes after a shot. exit_s is the time from the end of the shot's exposure
 * until the turntable stands still after a pass; 0 if it stands. */
struct place {
    struct plan_pose pose;
    double exit_s;
};

/* Returns the first exposure of a shot in seconds. A shot in a pass has only one exposure. */
static double exposure_s(const struct session_shot *shot, const struct session_conf *conf) {
    return shot_exposure_us(conf, shot, 0) * 1e-6;
}

/* Returns the time in seconds from the end of the last exposure of the previous shot, when the axes
 * are at from, to the first trigger of a shot. *ret_to is the place of the axes after the shot. */
static double enter_s(const struct place *from, const struct session_shot *previous,
                      const struct session_shot *shot, const struct session_conf *conf,
                      const struct rig *rig, const struct rig_timing *timing,
                      struct place *ret_to) {
    const struct session_pass *pass = &shot->pass;
    const double frame_s = plan_shot_s(shot, conf, timing), light_s = exposure_s(shot, conf);
    struct plan_pose to = plan_pose_of(shot, rig), entry = to;

    *ret_to = (struct place){.pose = to};
    if (pass->number > 0) {
        entry.turntable_udeg = llround(pass->from_deg * UDEG);
        ret_to->pose.turntable_udeg = llround((pass->from_deg + pass->by_deg) * UDEG);
        ret_to->exit_s = passes_exit_s(shot, light_s, &timing->turntable);
        if (session_follows_in_pass(previous, shot))
            return passes_lead_s(previous, shot, frame_s, light_s, &timing->turntable);
    }
    struct plan_pose others = from->pose;
    others.turntable_udeg = entry.turntable_udeg;
    const double lead = plan_lead_s(previous, shot, rig, timing),
                 table_s = from->exit_s + pose_move_s(&from->pose, &others, timing);
    others = entry;
    others.turntable_udeg = from->pose.turntable_udeg;
    const double s = MAX(MAX(lead, table_s), pose_move_s(&from->pose, &others, timing));
    return pass->number > 0 ? s + passes_lead_s(NULL, shot, frame_s, light_s, &timing->turntable)
                            : s;
}

void plan_left_s(const struct session_shot *const *shots, int n, const struct session_conf *conf,
                 const struct rig *rig, const struct rig_timing *timing,
                 const struct session_shot *from, double *ret_left_s) {
    const struct session_shot *previous = NULL;
    struct place at = {0}, to;

    if (from)
        at.pose = plan_pose_of(from, rig);

    for (int i = 0; i < n; i++) {
        ret_left_s[i] = 0;
        if (shots[i]->state != SHOT_PLANNED)
            continue;
        ret_left_s[i] = enter_s(&at, previous, shots[i], conf, rig, timing, &to) +
                        plan_shot_s(shots[i], conf, timing);
        previous = shots[i];
        at = to;
    }
    ret_left_s[n] = previous ? plan_readout_s(previous, timing) : 0;
    for (int i = n - 1; i >= 0; i--)
        ret_left_s[i] += ret_left_s[i + 1];
}

double plan_remaining_s(const struct session_shot *const *shots, int n,
                        const struct session_conf *conf, const struct rig *rig,
                        const struct rig_timing *timing, const struct session_shot *from) {
    g_autofree double *left_s = g_new(double, n + 1);

    plan_left_s(shots, n, conf, rig, timing, from, left_s);
    return left_s[0];
}

double plan_homing_s(const struct rig *rig, const struct rig_timing *timing) {
    double longest_s = MAX(MAX(timing->turntable.homing_s, timing->arc.homing_s),
                           MAX(timing->arm.homing_s, timing->probe.homing_s));

    for (int i = 0; i < rig->n_lasers; i++)
        longest_s = MAX(longest_s, timing->sweep[i].homing_s);
    return longest_s;
}

double plan_total_s(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, double *ret_first_s) {
    g_autofree const struct session_shot **list = g_new(const struct session_shot *, shots->len);
    const struct session_shot *first = NULL;

    for (guint i = 0; i < shots->len; i++) {
        list[i] = &g_array_index(shots, struct session_shot, i);
        if (!first && list[i]->state == SHOT_PLANNED)
            first = list[i];
    }
    const double total_s =
        first ? plan_remaining_s(list, (int)shots->len, conf, rig, timing, first) : 0;
    *ret_first_s = plan_remaining_s(list, (int)shots->len, conf, rig, timing, NULL) - total_s;
    return total_s;
}

/* The lower bound. In any order, a shot s either follows another shot in the same pose p, or it
 * enters p by a move. Let
 *   R be the shortest read-out of any shot,
 *   M the time of the quickest move into p from any other pose of the plan,
 *   M' the time of the quickest move into p from any other pose with the same lamp,
 *   W the time in which the light of s becomes ready.
 *
 * Then the time before s is at least
 *   l = max(W, R)                    if s is a sweep: its laser was off before;
 *   l = min(max(W, R), max(M', R))   if s has a lamp: the lamp warms up, or it was left on in
 *                                    another pose. A move must then leave that pose.
 *   l = R                            instead, if W > max(M, R) and another shot in p has the same
 *                                    lamp: that shot may have left the lamp on.
 *
 * Every pose except the first is entered by a move, and the time before the shot that enters it is
 * at least max(M, R, l). Pose p therefore takes at least Σ l + min over its shots of max(0, max(M,
 * R) − l). For the first pose, the move and the largest l do not count, because no time may pass
 * before the first shot. All exposures, the read-out and the steps between them, and the last
 * read-out are added. */
struct pose_bound {
    double sum_s;   /* Σ l */
    double extra_s; /* minimum over the shots of max(0, max(M, R) − l) */
    double largest_s;
    double into_s; /* M */
};

/* Returns the time in seconds of the quickest move into a pose from another pose p for which
 * counts[p] is not 0. Returns `none` if there is no such pose. */
static double quickest_into(const struct plan_moves *moves, int pose, const int *counts,
                            double none) {
    double quickest = G_MAXDOUBLE;

    for (int p = 0; p < moves->n; p++)
        if (p != pose && counts[p] > 0)
            quickest = MIN(quickest, plan_move_s(moves, p, pose));
    return quickest < G_MAXDOUBLE ? quickest : none;
}

/* Returns l of a shot in seconds (defined above struct pose_bound). into_s is M, and readout_s is
 * R. with_lamp has the number of shots with the same lamp in each pose; it is NULL for a sweep. */
static double least_lead(const struct session_shot *shot, const struct plan_moves *moves,
                         const struct rig *rig, const struct rig_timing *timing,
                         const int *with_lamp, double into_s, double readout_s) {
    double warm_s = plan_light_s(NULL, shot, rig, timing);

    if (shot->kind == SHOT_SWEEP || warm_s <= MAX(into_s, readout_s))
        return MAX(warm_s, readout_s);
    // NOLINTNEXTLINE(clang-analyzer-core.NullDereference): lamp shots have counts
    if (with_lamp[shot->pose] > 1) /* another shot in this pose may have left the lamp on */
        return readout_s;
    double from_same_s = quickest_into(moves, shot->pose, with_lamp, G_MAXDOUBLE);
    return MIN(MAX(warm_s, readout_s), MAX(from_same_s, readout_s));
}

static void bound_poses(GPtrArray *shots, const struct plan_moves *moves, const struct rig *rig,
                        const struct rig_timing *timing, double readout_s,
                        struct pose_bound *bounds) {
    g_autofree int *used = g_new0(int, moves->n);
    g_autofree int *lamps = g_new0(int, (gsize)moves->n *(gsize)rig->n_lamps + 1);

    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        used[shot->pose]++;
        if (shot->kind == SHOT_LAMP)
            lamps[rig_lamp_unit(rig, shot->device) * moves->n + shot->pose]++;
    }
    for (int p = 0; p < moves->n; p++)
        if (used[p])
            bounds[p] = (struct pose_bound){.into_s = quickest_into(moves, p, used, 0),
                                            .extra_s = G_MAXDOUBLE};
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        struct pose_bound *b = &bounds[shot->pose];
        const int *with_lamp =
            shot->kind == SHOT_LAMP ? lamps + rig_lamp_unit(rig, shot->device) * moves->n : NULL;
        double lead = least_lead(shot, moves, rig, timing, with_lamp, b->into_s, readout_s);
        b->sum_s += lead;
        b->largest_s = MAX(b->largest_s, lead);
        b->extra_s = MIN(b->extra_s, MAX(0, MAX(b->into_s, readout_s) - lead));
    }
}

/* Returns a lower bound of the time in seconds of the shot with index i, which is in a pass. It is
 * counted from the end of the previous shot in the same pass. For the first shot of a pass, it is
 * only the time of the frame. */
static double passing_s(GArray *shots, guint i, const struct session_conf *conf,
                        const struct rig_timing *timing) {
    const struct session_shot *shot = &g_array_index(shots, struct session_shot, i);
    const struct session_shot *before =
        i > 0 ? &g_array_index(shots, struct session_shot, i - 1) : NULL;
    const double s = plan_shot_s(shot, conf, timing);

    return session_follows_in_pass(before, shot)
               ? s + passes_lead_s(before, shot, s, exposure_s(shot, conf), &timing->turntable)
               : s;
}

double plan_lower_bound_s(GArray *shots, const struct plan_pose *poses, int n_poses,
                          const struct session_conf *conf, const struct rig *rig,
                          const struct rig_timing *timing) {
    g_autoptr(GPtrArray) lit = g_ptr_array_new(); /* shots that are not in a pass */
    double total_s = 0, readout_s = G_MAXDOUBLE, spared_s = 0;

    for (guint i = 0; i < shots->len; i++) {
        struct session_shot *shot = &g_array_index(shots, struct session_shot, i);
        if (shot->state != SHOT_PLANNED)
            continue;
        if (shot->pass.number > 0) {
            total_s += passing_s(shots, i, conf, timing);
            continue;
        }
        total_s += plan_shot_s(shot, conf, timing);
        readout_s = MIN(readout_s, plan_readout_s(shot, timing));
        if (shot->kind != SHOT_DARK)
            g_ptr_array_add(lit, shot);
    }
    if (total_s == 0)
        return 0;
    struct plan_moves *moves = plan_moves_new(poses, n_poses, timing);
    g_autofree struct pose_bound *bounds = g_new0(struct pose_bound, n_poses);
    bound_poses(lit, moves, rig, timing, readout_s, bounds);
    for (int p = 0; p < n_poses; p++) {
        total_s += bounds[p].sum_s + bounds[p].extra_s;
        spared_s = MAX(spared_s, bounds[p].largest_s + bounds[p].extra_s);
    }
    plan_moves_free(moves);
    return total_s - spared_s + readout_s;
}
