/* The dark levels of a camera at each exposure, which the intake subtracts. Any thread may call the
 * functions, but only one at a time. */
#pragma once

#include "drivers/frame.h"
#include "plan/shot_frames.h"

struct intake_dark {
    gint64 exposure_us;
    double mean_dn;
    float *pixels; /* dark level of each pixel in DN; NULL if it is not known */
};

struct intake_darks {
    struct intake_dark levels[SHOT_MAX_DARKS];
    /* Estimated levels for exposures without dark frames. The index is that of the frame in its
     * shot. */
    struct intake_dark guesses[PLAN_MAX_BRACKET];
};

/* Sets the dark level of an exposure. Takes ownership of pixels. `index` is that of the exposure in
 * the result of shot_dark_exposures(). */
void intake_darks_set(struct intake_darks *darks, int index, gint64 exposure_us, float *pixels,
                      double mean_dn);

/* Returns the dark level for a frame. `sub` is the index of the frame in its shot. For an exposure
 * without dark frames, the level is estimated from other exposures. The result is valid until the
 * next call of a function of this header. */
const struct intake_dark *intake_darks_at(struct intake_darks *darks, int sub, const Frame *frame);

void intake_darks_clear(struct intake_darks *darks);
