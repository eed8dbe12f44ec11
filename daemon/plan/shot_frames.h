/* The frames that a shot takes, and their exposures, as the plan predicts them and the intake
 * expects them. All functions are pure. */
#pragma once

#include "session_conf.h"

#define SHOT_MAX_DARKS (PLAN_MAX_BRACKET + 1)

/* Lists the distinct exposures of a dark shot in µs: those of the bracket and laser_exposure_us.
 * Returns their number. */
int shot_dark_exposures(const struct session_conf *conf, gint64 ret[SHOT_MAX_DARKS]);

/* Returns the number of frames that a camera takes for a shot. The last frame of a sweep is taken
 * at the middle position of the sweep, after the laser was switched off. */
int shot_n_frames(const struct session_conf *conf, const struct session_shot *shot);
/* Returns the exposure of a frame. `sub` is the index of the frame in the shot, from 0. */
gint64 shot_exposure_us(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* Returns the step of a sweep at which the frame `sub` is taken, counted from 0. For the frame
 * after the last step, returns the number of steps. */
int shot_sweep_step(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* Returns whether the frame `sub` of a sweep has the exposure laser_short_us. */
gboolean shot_is_short(const struct session_conf *conf, const struct session_shot *shot, int sub);
