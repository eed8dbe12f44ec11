/* Finds the pose of the plate by grid search. The score of a pose is the mean darkness, 1 − value,
 * along the centre lines of all predicted shadows. */
#include "shadows_private.h"

#include <math.h>

#define MAX_SHOTS 40 /* largest number of pictures that are used */
/* Largest number of pictures in the first round, which tries most of the poses. */
#define COARSE_SHOTS 12

/* Pose of the plate relative to the nominal one. */
struct plate_pose {
    double x_mm, y_mm, turn_rad;
};

static void move_marks(const struct lamp_target *from, const struct plate_pose *pose,
                       struct lamp_target *to) {
    struct lamp_target moved = *from;
    *to = moved;
    for (int i = 0; i < to->n; i++) {
        struct vec3 p = rig_turn(vec3(moved.marks[i].x_mm, moved.marks[i].y_mm, 0), pose->turn_rad);
        to->marks[i].x_mm = p.x + pose->x_mm;
        to->marks[i].y_mm = p.y + pose->y_mm;
    }
}

struct score {
    double sum;
    int n;
};

/* Adds the darkness along the centre line of a shadow to the score, up to the border of the
 * picture. */
static void score_streak(const ShadowView *view, const struct shot *shot, const struct streak *s,
                         struct score *score) {
    const struct rig_camera *camera = &view->rig->cameras[view->camera];
    double length = vec3_length(vec3_sub(s->to, s->from));
    for (double at = 2 * s->from_mm; at <= length; at += 1.5 * s->from_mm) {
        struct vec3 p = vec3_add(s->from, vec3_scale(vec3_sub(s->to, s->from), at / length));
        double x, y;
        if (!rig_project(camera, p, &x, &y) || !(x > 0 && y > 0) || x > camera->width - 1 ||
            y > camera->height - 1)
            return;
        double value =
            shadow_value(view, shot, (gsize)lround(y) * (gsize)camera->width + (gsize)lround(x));
        if (!isfinite(value))
            continue;
        score->sum += 1 - CLAMP(value, 0, 1);
        score->n++;
    }
}

/* Returns the score of a pose of the plate, or 0 if no shadow is visible. Of each `every`
 * successive pictures, only the first is used. */
static double score_pose(ShadowView *const *views, int n, const struct lamp_target *target,
                         const struct plate_pose *pose, int every) {
    struct lamp_target moved;
    struct score score = {0, 0};
    int count = 0;
    move_marks(target, pose, &moved);
    for (int v = 0; v < n; v++) {
        const struct rig *rig = views[v]->rig;
        for (guint i = 0; i < views[v]->shots->len; i++) {
            const struct shot *shot = &g_array_index(views[v]->shots, struct shot, i);
            struct vec3 lamp =
                rig_lamp_position_mm(&rig->arc, &rig->lamps[shot->lamp], shot->arc_rad);
            if (count++ % every)
                continue;
            for (int mark = 0; mark < moved.n; mark++) {
                struct streak streak;
                if (shadow_streak(&moved, mark, views[v]->turntable_rad, lamp, &streak))
                    score_streak(views[v], shot, &streak, &score);
            }
        }
    }
    return score.n ? score.sum / score.n : 0;
}

/* Searches a grid around the best pose so far, and halves the step in each round. reach has the
 * range of x and y in mm, the range of the angle in rad, and the first step of x and y in mm.
 * Returns the score of the best pose. */
static double search(ShadowView *const *views, int n, const struct lamp_target *target,
                     const double reach[3], int n_shots, struct plate_pose *best) {
    double span[3] = {reach[0], reach[0], reach[1]}, step[3] = {reach[2], reach[2], 0}, most = -1;
    step[2] = reach[2] / (0.35 * (target->plate_mm[0] + target->plate_mm[1]) / 2);
    for (int round = 0; round < 4; round++) {
        const struct plate_pose middle = *best;
        const int every = 1 + n_shots / (round == 0 ? COARSE_SHOTS : MAX_SHOTS);
        most = -1; /* scores from other pictures cannot be compared */
        for (double t = -span[2]; t <= span[2] + 1e-12; t += step[2])
            for (double y = -span[1]; y <= span[1] + 1e-12; y += step[1])
                for (double x = -span[0]; x <= span[0] + 1e-12; x += step[0]) {
                    struct plate_pose pose = {middle.x_mm + x, middle.y_mm + y,
                                              middle.turn_rad + t};
                    double score = score_pose(views, n, target, &pose, every);
                    if (score > most) {
                        most = score;
                        *best = pose;
                    }
                }
        for (int k = 0; k < 3; k++) {
            span[k] = step[k];
            step[k] /= 2;
        }
    }
    return most;
}

/* Finds the pose of the plate with the highest score, and returns this score. *ret_shots is the
 * number of pictures. */
static double find_pose(ShadowView *const *views, int n, const struct lamp_target *target,
                        double reach_mm, double reach_rad, struct plate_pose *ret, int *ret_shots) {
    *ret_shots = 0;
    for (int i = 0; i < n; i++) {
        shadow_find_pattern(views[i]);
        *ret_shots += (int)views[i]->shots->len;
    }
    /* The first steps equal a post's radius, so that one of the poses always meets the shadow. */
    const double reach[3] = {reach_mm, reach_rad, target->radius_mm};
    *ret = (struct plate_pose){0, 0, 0};
    return search(views, n, target, reach, *ret_shots, ret);
}

double shadows_score(ShadowView *const *views, int n, const struct lamp_target *target,
                     double reach_mm, double reach_rad) {
    struct plate_pose pose;
    int shots;
    return find_pose(views, n, target, reach_mm, reach_rad, &pose, &shots);
}

gboolean shadows_locate(ShadowView *const *views, int n, struct lamp_target *target,
                        double reach_mm, double reach_rad, GError **error) {
    struct plate_pose pose;
    int shots;
    const double score = find_pose(views, n, target, reach_mm, reach_rad, &pose, &shots);
    if (score < SHADOWS_MIN_SCORE) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s and %d other picture(s): no position of the target within %g mm and %.3g° "
                    "of its description fits the shadows: only %.0f %% of the predicted shadows is "
                    "dark; check that it is this target, that its x axis lies along the "
                    "turntable's x axis, and the heights of the posts",
                    shots ? g_array_index(views[0]->shots, struct shot, 0).name : "no picture",
                    MAX(shots - 1, 0), reach_mm, reach_rad * 180 / G_PI, 100 * score);
        return FALSE;
    }
    move_marks(target, &pose, target);
    return TRUE;
}
