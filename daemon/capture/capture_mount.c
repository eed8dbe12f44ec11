#include "capture_mount.h"

#include <string.h>

static const char *name_of(const struct capture_session *session, int laser) {
    return session->devices->geometry.lasers[laser].name;
}

static char *key_of(const struct capture_session *session, int unit) {
    return g_strdup_printf("mount.%s", name_of(session, unit));
}

gboolean capture_mount_load(struct capture_mounts *mounts, const struct capture_session *session,
                            GError **error) {
    const struct rig_timing *timing = &session->devices->timing;
    mounts->wanted = -1;
    for (int i = 0; i < session->devices->geometry.n_lasers; i++) {
        mounts->mounted[i] = i;
        if (!timing->mounts[i])
            continue;
        g_autofree char *key = key_of(session, i);
        g_autofree char *said = NULL;
        if (!session_read_value(session->store, key, &said, error))
            return FALSE;
        mounts->mounted[i] =
            /* The place is not known if the session has none, or if the session names a laser that
             * the rig no longer has. */
            -1;
        for (int k = 0; said && k < session->devices->geometry.n_lasers; k++)
            if (rig_laser_unit(timing, k) == i && !strcmp(name_of(session, k), said))
                mounts->mounted[i] = k;
        if (mounts->mounted[i] >= 0 && !laser_mount(session->devices->lasers[i], said, error))
            return FALSE;
    }
    return TRUE;
}

/* Returns 1 if the shot needs no laser, or if the laser unit that it needs is mounted at the right
 * place. Returns 0 if the unit is at another place, and −1 if the place of the unit is not
 * known. */
static int in_place(const struct capture_mounts *mounts, const struct rig_timing *timing,
                    const struct session_shot *shot) {
    if (shot->kind != SHOT_SWEEP)
        return 1;
    int place = mounts->mounted[rig_laser_unit(timing, shot->device)];
    return place < 0 ? -1 : place == shot->device;
}

gboolean capture_mount_is_in_place(const struct capture_mounts *mounts,
                                   const struct rig_timing *timing,
                                   const struct session_shot *shot) {
    return in_place(mounts, timing, shot) == 1;
}

static void put_in_place_first(const struct capture_mounts *mounts, const struct rig_timing *timing,
                               GPtrArray *shots) {
    guint end = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_SWEEP && capture_mount_is_in_place(mounts, timing, shot) &&
            timing->mounts[rig_laser_unit(timing, shot->device)] != 0)
            end = i + 1;
    }
    g_autoptr(GPtrArray) sorted = g_ptr_array_sized_new(end);
    for (int wanted = 1; wanted >= 0; wanted--) {
        for (guint i = 0; i < end; i++) {
            if (capture_mount_is_in_place(mounts, timing, shots->pdata[i]) == wanted)
                g_ptr_array_add(sorted, shots->pdata[i]);
        }
    }
    for (guint i = 0; i < end; i++)
        shots->pdata[i] = sorted->pdata[i];
}

guint capture_mount_reach(const struct capture_mounts *mounts, const struct rig_timing *timing,
                          GPtrArray *shots) {
    guint reach = 0;
    put_in_place_first(mounts, timing, shots);
    while (reach < shots->len && capture_mount_is_in_place(mounts, timing, shots->pdata[reach]))
        reach++;
    for (guint i = reach; i < shots->len; i++) {
        if (in_place(mounts, timing, shots->pdata[i]) < 0)
            return 0;
    }
    return reach;
}

static char *describe_place(const struct capture_session *session, int laser) {
    double theta_rad, phi_rad;
    rig_angles(session->devices->geometry.lasers[laser].position_mm, &theta_rad, &phi_rad);
    return g_strdup_printf("at %.4g° (%s)", theta_rad * 180 / G_PI, name_of(session, laser));
}

char *capture_mount_ask(struct capture_mounts *mounts, const struct capture_session *session,
                        const struct session_shot *const *shots, guint n, const char **ret_unit) {
    const struct rig_timing *timing = &session->devices->timing;
    int wanted = -1;
    /* A unit whose place is not known comes first, because the operator who began the session is
     * still present. */
    for (guint i = 0; i < n; i++) {
        const int known = in_place(mounts, timing, shots[i]);
        if (known < 0 || (known == 0 && wanted < 0))
            wanted = shots[i]->device;
        if (known < 0)
            break;
    }
    g_return_val_if_fail(wanted >= 0, NULL);
    *ret_unit = name_of(session, rig_laser_unit(timing, wanted));
    g_autofree char *place = describe_place(session, wanted);
    mounts->wanted = wanted;
    return g_strdup_printf("mount laser unit %s %s, then continue", *ret_unit, place);
}

gboolean capture_mount_answer(struct capture_mounts *mounts, const struct capture_session *session,
                              GError **error) {
    const int wanted = mounts->wanted;
    if (wanted < 0)
        return TRUE;
    const int unit = rig_laser_unit(&session->devices->timing, wanted);
    g_autofree char *key = key_of(session, unit);
    g_autofree char *place = describe_place(session, wanted);
    g_autofree char *told = g_strdup_printf("is mounted %s", place);
    if (!session_set_value(session->store, key, name_of(session, wanted), error) ||
        !laser_mount(session->devices->lasers[unit], name_of(session, wanted), error))
        return FALSE;
    mounts->mounted[unit] = wanted;
    mounts->wanted = -1;
    capture_session_add_event(session, "info", name_of(session, unit), told);
    return TRUE;
}
