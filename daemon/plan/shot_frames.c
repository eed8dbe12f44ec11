#include "shot_frames.h"

#include <math.h>

int shot_dark_exposures(const struct session_conf *conf, gint64 ret[SHOT_MAX_DARKS]) {
    int n = 0;
    for (int i = 0; i <= conf->n_exposures; i++) {
        gint64 us =
            llround(i < conf->n_exposures ? conf->exposures_us[i] : conf->laser_exposure_us);
        gboolean known = FALSE;
        for (int k = 0; k < n; k++)
            known |= ret[k] == us;
        if (!known)
            ret[n++] = us;
    }
    return n;
}

/* Returns the number of frames at each step of a sweep. */
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
        return shot_dark_exposures(conf, exposures) * conf->dark_frames;
    case SHOT_SWEEP:
        return frames_a_step(conf) * shot->sweep_steps + 1;
    default:
        return conf->n_exposures;
    }
}

gint64 shot_exposure_us(const struct session_conf *conf, const struct session_shot *shot, int sub) {
    gint64 exposures[SHOT_MAX_DARKS];
    switch (shot->kind) {
    case SHOT_DARK:
        shot_dark_exposures(conf, exposures);
        return exposures[sub / conf->dark_frames];
    case SHOT_SWEEP:
        return llround(shot_is_short(conf, shot, sub) ? conf->laser_short_us
                                                      : conf->laser_exposure_us);
    default:
        return llround(conf->exposures_us[sub]);
    }
}
