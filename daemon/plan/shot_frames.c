#include "shot_frames.h"

#include <math.h>

int shot_dark_exposures(const struct session_conf *conf, const struct session_shot *dark,
                        gint64 ret[SHOT_MAX_DARKS]) {
    const int bracket = conf->n_exposures;
    const int wanted = dark->multiplex.part > 0 ? 2 * bracket + 1 : bracket + 1;
    int n = 0;
    for (int i = 0; i < wanted; i++) {
        gint64 us =
            llround(i < bracket    ? conf->exposures_us[i]
                    : i == bracket ? conf->laser_exposure_us
                                   : conf->exposures_us[i - bracket - 1] * dark->multiplex.part);
        gboolean known = FALSE;
        for (int k = 0; k < n; k++)
            known |= ret[k] == us;
        if (!known)
            ret[n++] = us;
    }
    return n;
}

/* Frames at each step, the shortest exposure first. */
static int frames_a_step(const struct session_conf *conf) {
    return conf->laser_short_us > 0 ? 2 : 1;
}

int shot_sweep_step(const struct session_conf *conf, const struct session_shot *shot, int sub) {
    return MIN(sub / frames_a_step(conf), shot->sweep_steps);
}

gboolean shot_is_short(const struct session_conf *conf, const struct session_shot *shot, int sub) {
    return conf->laser_short_us > 0 && sub % 2 == 0 &&
           shot_sweep_step(conf, shot, sub) < shot->sweep_steps;
}

int shot_n_frames(const struct session_conf *conf, const struct session_shot *shot) {
    gint64 exposures[SHOT_MAX_DARKS];
    switch (shot->kind) {
    case SHOT_DARK:
        return shot_dark_exposures(conf, shot, exposures) * conf->dark_frames;
    case SHOT_SWEEP:
        return frames_a_step(conf) * shot->sweep_steps + 1;
    default:
        return conf->n_exposures + session_ends_group(shot);
    }
}

gint64 shot_exposure_us(const struct session_conf *conf, const struct session_shot *shot, int sub) {
    gint64 exposures[SHOT_MAX_DARKS];
    switch (shot->kind) {
    case SHOT_DARK:
        shot_dark_exposures(conf, shot, exposures);
        return exposures[sub / conf->dark_frames];
    case SHOT_SWEEP:
        return llround(shot_is_short(conf, shot, sub) ? conf->laser_short_us
                                                      : conf->laser_exposure_us);
    default:
        return llround(conf->exposures_us[MIN(sub, conf->n_exposures - 1)] *
                       (shot->multiplex.group > 0 ? shot->multiplex.part : 1));
    }
}

gboolean shot_is_check(const struct session_conf *conf, const struct session_shot *shot, int sub) {
    return shot->kind == SHOT_LAMP && sub == conf->n_exposures;
}

gboolean shot_lights(const struct session_conf *conf, const struct session_shot *shot, int sub,
                     int lamp) {
    const struct session_multiplex *t = &shot->multiplex;
    const gboolean lit = t->lit[lamp / 64] >> lamp % 64 & 1,
                   ours = t->all[lamp / 64] >> lamp % 64 & 1;
    if (t->group == 0)
        return lamp == shot->device;
    return shot_is_check(conf, shot, sub) ? ours && !lit : lit;
}
