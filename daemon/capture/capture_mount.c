#include "capture_mount.h"

#include <string.h>

static const struct rig_timing *timing_of(const Capture *capture) {
    return &capture->devices->timing;
}

static const char *name_of(const Capture *capture, int laser) {
    return capture->devices->geometry.lasers[laser].name;
}

static char *key_of(const Capture *capture, int unit) {
    return g_strdup_printf("mount.%s", name_of(capture, unit));
}

gboolean capture_mount_load(Capture *capture, GError **error) {
    capture->wanted_mount = -1;
    for (int i = 0; i < capture->devices->geometry.n_lasers; i++) {
        capture->mounted[i] = i;
        if (!timing_of(capture)->mounts[i])
            continue;
        g_autofree char *key = key_of(capture, i);
        g_autofree char *said = NULL;
        if (!session_read_value(capture->session, key, &said, error))
            return FALSE;
        capture->mounted[i] =
            -1; /* the session does not say, or names a laser that the rig no longer has */
        for (int k = 0; said && k < capture->devices->geometry.n_lasers; k++)
            if (rig_laser_unit(timing_of(capture), k) == i && !strcmp(name_of(capture, k), said))
                capture->mounted[i] = k;
        if (capture->mounted[i] >= 0 && !laser_mount(capture->devices->lasers[i], said, error))
            return FALSE;
    }
    return TRUE;
}

/* Returns whether the unit that a shot needs is in its place: −1 if its place is not known, 0 if it
 * is at another place, 1 if it is there or if the shot needs none. */
static int in_place(const Capture *capture, const struct session_shot *shot) {
    if (shot->kind != SHOT_SWEEP)
        return 1;
    int place = capture->mounted[rig_laser_unit(timing_of(capture), shot->device)];
    return place < 0 ? -1 : place == shot->device;
}

gboolean capture_mount_is_in_place(const Capture *capture, const struct session_shot *shot) {
    return in_place(capture, shot) == 1;
}

static void put_in_place_first(Capture *capture) {
    GPtrArray *shots = capture->remaining;
    guint end = 0;
    for (guint i = 0; i < shots->len; i++) {
        const struct session_shot *shot = shots->pdata[i];
        if (shot->kind == SHOT_SWEEP && capture_mount_is_in_place(capture, shot) &&
            timing_of(capture)->mounts[rig_laser_unit(timing_of(capture), shot->device)] != 0)
            end = i + 1;
    }
    g_autoptr(GPtrArray) sorted = g_ptr_array_sized_new(end);
    for (int wanted = 1; wanted >= 0; wanted--) {
        for (guint i = 0; i < end; i++) {
            if (capture_mount_is_in_place(capture, shots->pdata[i]) == wanted)
                g_ptr_array_add(sorted, shots->pdata[i]);
        }
    }
    for (guint i = 0; i < end; i++)
        shots->pdata[i] = sorted->pdata[i];
}

guint capture_mount_reach(Capture *capture) {
    GPtrArray *shots = capture->remaining;
    guint reach = 0;
    put_in_place_first(capture);
    while (reach < shots->len && capture_mount_is_in_place(capture, shots->pdata[reach]))
        reach++;
    for (guint i = reach; i < shots->len; i++) {
        if (in_place(capture, shots->pdata[i]) < 0)
            return 0;
    }
    return reach;
}

static char *describe_place(const Capture *capture, int laser) {
    double theta_rad, phi_rad;
    rig_angles(capture->devices->geometry.lasers[laser].position_mm, &theta_rad, &phi_rad);
    return g_strdup_printf("at %.4g° (%s)", theta_rad * 180 / G_PI, name_of(capture, laser));
}

void capture_mount_ask(Capture *capture) {
    int wanted = -1;
    /* Units whose places are not known are asked for first, while the operator who began the
     * session is still present. */
    for (guint i = capture->committed; i < capture->remaining->len; i++) {
        const struct session_shot *shot = capture->remaining->pdata[i];
        int known = in_place(capture, shot);
        if (known < 0 || (known == 0 && wanted < 0))
            wanted = shot->device;
        if (known < 0)
            break;
    }
    g_return_if_fail(wanted >= 0);
    const char *unit = name_of(capture, rig_laser_unit(timing_of(capture), wanted));
    g_autofree char *place = describe_place(capture, wanted);
    g_autofree char *prompt = g_strdup_printf("mount laser unit %s %s, then continue", unit, place);
    capture->wanted_mount = wanted;
    capture_pause_for(capture, CAPTURE_FAULT_NONE, unit, prompt);
}

gboolean capture_mount_answer(Capture *capture, GError **error) {
    int wanted = capture->wanted_mount;
    if (wanted < 0)
        return TRUE;
    int unit = rig_laser_unit(timing_of(capture), wanted);
    g_autofree char *key = key_of(capture, unit);
    g_autofree char *place = describe_place(capture, wanted);
    g_autofree char *told = g_strdup_printf("is mounted %s", place);
    if (!session_set_value(capture->session, key, name_of(capture, wanted), error) ||
        !laser_mount(capture->devices->lasers[unit], name_of(capture, wanted), error))
        return FALSE;
    capture->mounted[unit] = wanted;
    capture->wanted_mount = -1;
    capture_add_event(capture, "info", name_of(capture, unit), told);
    return TRUE;
}
