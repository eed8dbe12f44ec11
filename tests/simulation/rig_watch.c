#include "rig_watch.h"

#include <string.h>

/* Lamps and lasers have two seconds to answer before they are said not to be off; the axes of the
 * small rig brake within 0.8 s. */
#define DARK_US  (5 * G_USEC_PER_SEC / 2)
#define STILL_US (3 * G_USEC_PER_SEC / 2)

gboolean rig_watch_begin(struct rig_watch *watch, struct scene *scene, const struct life *life,
                         struct devices *devices) {
    g_autofree char *path = g_build_filename(scene->folder, "world.conf", NULL);
    *watch = (struct rig_watch){.scene = scene,
                                .life = life,
                                .devices = devices,
                                .world = world_get(path, NULL),
                                .since_us = -1,
                                .open_since_us = -1};
    return watch->world != NULL;
}

/* A laser that stays on cannot be switched off. One that does not answer is excused if the operator
 * was told. */
static gboolean is_excused(const struct rig_watch *watch, const char *laser) {
    g_autofree char *section = g_strdup_printf("[laser %s]", laser);
    for (int i = 0; i < watch->life->n_devices; i++) {
        const struct device_fault *fault = &watch->life->devices[i];
        if (strcmp(fault->section, section) == 0 &&
            (strstr(fault->line, "stays_on") ||
             (strstr(fault->line, "deaf") && watch->unsafe_told)))
            return TRUE;
    }
    return FALSE;
}

static void check_lasers(struct rig_watch *watch, const struct world_state *state,
                         const char *when) {
    const struct rig *rig = &watch->devices->geometry;
    for (int i = 0; i < rig->n_lasers; i++) {
        const int at = world_find_laser(watch->world, rig->lasers[i].name);
        if (state->laser_on[at] && !is_excused(watch, rig->lasers[i].name))
            scene_break(watch->scene, "safe", "laser %s shines %s", rig->lasers[i].name, when);
    }
}

static void check_lamps(struct rig_watch *watch, const struct world_state *state,
                        const char *when) {
    const struct rig *rig = &watch->devices->geometry;
    for (int i = 0; i < rig->n_lamps; i++)
        if (state->lamp_output[world_find_lamp(watch->world, rig->lamps[i].name)] > 0)
            scene_break(watch->scene, "safe", "lamp %s shines %s", rig->lamps[i].name, when);
}

static void get_angles(const struct world_state *state, double *ret_deg) {
    ret_deg[0] = state->turntable_deg;
    ret_deg[1] = state->arc_deg;
    memcpy(ret_deg + 2, state->sweep_deg, sizeof state->sweep_deg);
}

static void check_axes(struct rig_watch *watch, const struct world_state *state) {
    double angles[G_N_ELEMENTS(watch->still_deg)];
    get_angles(state, angles);
    if (watch->still_known && memcmp(angles, watch->still_deg, sizeof angles) != 0)
        scene_break(watch->scene, "safe", "an axis moves while the capture rests");
    memcpy(watch->still_deg, angles, sizeof angles);
    watch->still_known = TRUE;
}

void rig_watch_look(struct rig_watch *watch, gboolean rests) {
    const gint64 now_us = clock_now_us(watch->devices->clock);
    gboolean open = FALSE;
    for (int i = 0; i < watch->devices->n_interlocks; i++)
        open |= !interlock_is_closed(watch->devices->interlocks[i]);
    if (!open)
        watch->open_since_us = -1;
    else if (watch->open_since_us < 0)
        watch->open_since_us = now_us;
    if (!rests) {
        watch->since_us = -1;
        watch->still_known = FALSE;
    } else if (watch->since_us < 0) {
        watch->since_us = now_us;
    }
    const gboolean is_open = open && now_us - watch->open_since_us > DARK_US;
    const gboolean is_dark = rests && now_us - watch->since_us > DARK_US;
    const gboolean is_still = rests && now_us - watch->since_us > STILL_US;
    struct world_state state;
    if (!is_open && !is_dark && !is_still)
        return;
    world_snapshot(watch->world, now_us, 1, &state);
    if (is_open || is_dark)
        check_lasers(watch, &state,
                     is_open ? "while the interlock is open" : "while the capture rests");
    if (is_dark)
        check_lamps(watch, &state, "while the capture rests");
    if (is_still)
        check_axes(watch, &state);
}

void rig_watch_end(struct rig_watch *watch, const char *when) {
    struct world_state state;
    world_snapshot(watch->world, clock_now_us(watch->devices->clock), 1, &state);
    check_lasers(watch, &state, when);
    check_lamps(watch, &state, when);
}
