/* Which frames a shot takes, and at which exposures: what the plan predicts and the intake expects.
 * Pure functions. */
#pragma once

#include "plan.h"

#define SHOT_MAX_DARKS (2 * PLAN_MAX_BRACKET + 1)

/* The distinct exposures of a dark shot: those of the bracket, that of the lasers, and those of
 * shots of several lamps, if the session has such. Returns their number. */
int shot_dark_exposures(const struct session_conf *conf, const struct session_shot *dark,
                        gint64 ret[SHOT_MAX_DARKS]);

/* The number of frames that a camera takes for a shot, and the exposure of each; sub counts from 0.
 * Those of a sweep end with one from its middle, taken after the laser was switched off. */
int shot_n_frames(const struct session_conf *conf, const struct session_shot *shot);
gint64 shot_exposure_us(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* Whether a lamp is lit in a frame of a shot of a lamp: that one, or one of its group. The last
 * shot of a group has a frame more than its exposures, as long as the longest, in which the lamps
 * of the group are lit that its pattern leaves out: with the pattern it shows whether a lamp has
 * changed since the group began (shot_is_check()). */
gboolean shot_lights(const struct session_conf *conf, const struct session_shot *shot, int sub,
                     int lamp);
gboolean shot_is_check(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* The step of a sweep at which a frame is taken, from 0; its number of steps: the one after it. */
int shot_sweep_step(const struct session_conf *conf, const struct session_shot *shot, int sub);

/* Whether it is one of laser_short_us. */
gboolean shot_is_short(const struct session_conf *conf, const struct session_shot *shot, int sub);
