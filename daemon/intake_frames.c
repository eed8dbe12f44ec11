/* Which frames a shot takes. */
#include "intake.h"

#include <math.h>

#include "intake_darks.h"

/* Frames at each step, the shortest exposure first. */
static int frames_a_step(const struct session_conf *conf) {
    return conf->laser_short_us > 0 ? 2 : 1;
}

int intake_sweep_step(const struct session_conf *conf, const struct session_shot *shot, int sub) {
    return MIN(sub / frames_a_step(conf), shot->sweep_steps);
}

gboolean intake_is_short(const struct session_conf *conf, const struct session_shot *shot,
                         int sub) {
    return conf->laser_short_us > 0 && sub % 2 == 0 &&
           intake_sweep_step(conf, shot, sub) < shot->sweep_steps;
}

int intake_n_frames(const struct session_conf *conf, const struct session_shot *shot) {
    gint64 exposures[INTAKE_MAX_DARKS];
    switch (shot->kind) {
    case SHOT_DARK:
        return intake_dark_exposures(conf, exposures) * conf->dark_frames;
    case SHOT_SWEEP:
        return frames_a_step(conf) * shot->sweep_steps + 1;
    default:
        return conf->n_exposures;
    }
}

gint64 intake_exposure_us(const struct session_conf *conf, const struct session_shot *shot,
                          int sub) {
    gint64 exposures[INTAKE_MAX_DARKS];
    switch (shot->kind) {
    case SHOT_DARK:
        intake_dark_exposures(conf, exposures);
        return exposures[sub / conf->dark_frames];
    case SHOT_SWEEP:
        return llround(intake_is_short(conf, shot, sub) ? conf->laser_short_us
                                                        : conf->laser_exposure_us);
    default:
        return llround(conf->exposures_us[sub]);
    }
}
