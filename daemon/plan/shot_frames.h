/* Which frames a shot takes, and at which exposures: what the plan predicts and the intake expects.
 * Pure functions. */
#pragma once

#include "plan.h"

#define SHOT_MAX_DARKS (PLAN_MAX_BRACKET + 1)

/* The distinct exposures of a dark shot: those of the bracket, and that of the lasers. Returns
 * their number. */
int shot_dark_exposures(const struct session_conf *conf, gint64 ret[SHOT_MAX_DARKS]);

/* The number of frames that a camera takes for a shot, and the exposure of each; sub counts from 0.
 * Those of a sweep end with one from its middle, taken after the laser was switched off. */
int shot_n_frames(const struct session_conf *conf, const struct session_shot *shot);
gint64 shot_exposure_us(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* The step of a sweep at which a frame is taken, from 0; its number of steps: the one after it. */
int shot_sweep_step(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* Whether it is one of laser_short_us. */
gboolean shot_is_short(const struct session_conf *conf, const struct session_shot *shot, int sub);
