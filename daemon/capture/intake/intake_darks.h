/* Each camera's dark levels, by exposure, as the intake subtracts them. One thread at a time. */
#pragma once

#include "plan/shot_frames.h"

struct intake_dark {
    gint64 exposure_us;
    double mean_dn;
    float *pixels; /* NULL: not known */
};

struct intake_darks {
    struct intake_dark levels[SHOT_MAX_DARKS];
    struct intake_dark guesses[PLAN_MAX_BRACKET]; /* by sub, for exposures that have none */
};

/* Takes pixels. index: of shot_dark_exposures(). */
void intake_darks_set(struct intake_darks *darks, int index, gint64 exposure_us, float *pixels,
                      double mean_dn);

/* The dark level for a frame; sub is the frame's index in its shot. For an exposure without dark
 * frames it is interpolated from other exposures. Valid until the next call of a function above. */
const struct intake_dark *intake_darks_at(struct intake_darks *darks, int sub, const Frame *frame);

void intake_darks_clear(struct intake_darks *darks);
