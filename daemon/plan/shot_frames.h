/* Which frames a shot takes, and at which exposures: what the plan predicts and the intake expects.
 * Pure functions. */
#pragma once

#include "plan.h"

#define SHOT_MAX_DARKS (PLAN_MAX_BRACKET + 1)

/* The exposures that a dark shot has, each once: those of the bracket, that of the lasers. How many
 * there are. */
int shot_dark_exposures(const struct session_conf *conf, gint64 ret[SHOT_MAX_DARKS]);

/* How many frames a camera takes for a shot, and at which exposure each; sub counts from 0. Those
 * of a sweep end with one from its middle, taken after the laser was switched off. */
int shot_n_frames(const struct session_conf *conf, const struct session_shot *shot);
gint64 shot_exposure_us(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* The step of a sweep at which a frame is taken, from 0; its number of steps: the one after it. */
int shot_sweep_step(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* Whether it is one of laser_short_us. */
gboolean shot_is_short(const struct session_conf *conf, const struct session_shot *shot, int sub);
