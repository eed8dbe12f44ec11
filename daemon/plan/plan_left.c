/* Orders shots of a session that is being captured, and predicts the time of lamp shots. */
#include "plan_private.h"

#include <string.h>

static gboolean same_pose(const struct plan_pose *a, const struct plan_pose *b) {
    return a->turntable_udeg == b->turntable_udeg && a->arc_udeg == b->arc_udeg &&
           a->arm_udeg == b->arm_udeg && a->probe_udeg == b->probe_udeg;
}

static guint find(GArray *poses, const struct plan_pose *pose) {
    guint i = 0;
    while (i < poses->len && !same_pose(&g_array_index(poses, struct plan_pose, i), pose))
        i++;
    if (i == poses->len)
        g_array_append_vals(poses, pose, 1);
    return i;
}

int plan_set_passes(GArray *shots, const struct session_conf *conf, const struct rig *rig,
                    const struct rig_timing *timing, int number) {
    g_autofree struct session_shot **list = g_new(struct session_shot *, shots->len + 1);

    for (guint i = 0; i < shots->len; i++)
        list[i] = &g_array_index(shots, struct session_shot, i);
    return passes_set(list, (int)shots->len, conf, rig, timing, number);
}

void plan_order_left(struct session_shot **shots, int n, const struct session_conf *conf,
                     const struct rig *rig, const struct rig_timing *timing) {
    g_autoptr(GArray) list = g_array_new(FALSE, FALSE, sizeof(struct session_shot));
    g_autoptr(GArray) poses = g_array_new(FALSE, FALSE, sizeof(struct plan_pose));
    g_autofree struct session_shot **before = g_memdup2(shots, sizeof(gpointer) * (gsize)n);

    /* plan_order() sorts copies. The ids of the copies are their indices in the list. */
    for (int i = 0; i < n; i++) {
        struct session_shot shot = *shots[i];
        shot.state = SHOT_PLANNED;
        const struct plan_pose pose = plan_pose_of(&shot, rig);
        shot.id = i;
        shot.pose = (int)find(poses, &pose);
        g_array_append_val(list, shot);
    }
    if (n < 2)
        return;
    plan_order(list, (const struct plan_pose *)(gpointer)poses->data, (int)poses->len, conf, rig,
               timing);
    for (int i = 0; i < n; i++)
        shots[i] = before[g_array_index(list, struct session_shot, i).id];
}

double plan_lamps_s(const struct session_shot *const *shots, int n, const struct session_conf *conf,
                    const struct rig *rig, const struct rig_timing *timing) {
    g_autofree struct session_shot *copies = g_new(struct session_shot, n + 1);
    g_autofree struct session_shot **list = g_new(struct session_shot *, n + 1);

    if (n == 0)
        return 0;
    for (int i = 0; i < n; i++) {
        copies[i] = *shots[i];
        copies[i].state = SHOT_PLANNED;
        list[i] = &copies[i];
    }
    plan_order_left(list, n, conf, rig, timing);
    passes_set(list, n, conf, rig, timing, 0);
    return plan_homing_s(rig, timing) +
           plan_remaining_s((const struct session_shot *const *)list, n, conf, rig, timing, NULL);
}
