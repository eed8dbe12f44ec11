/* Each camera's dark levels, by exposure, as the intake subtracts them. One thread at a time. */
#pragma once

#include "plan.h"

#define INTAKE_MAX_DARKS (PLAN_MAX_BRACKET + 1)

struct intake_dark {
    gint64 exposure_us;
    double mean_dn;
    float *pixels; /* NULL: not known */
};

struct intake_darks {
    struct intake_dark levels[INTAKE_MAX_DARKS];
    struct intake_dark guesses[PLAN_MAX_BRACKET]; /* by sub, for exposures that have none */
};

/* The exposures that a dark shot has, each once: those of the bracket, that of the lasers. How many
 * there are. */
int intake_dark_exposures(const struct session_conf *conf, gint64 ret[INTAKE_MAX_DARKS]);

/* Takes pixels. index: of intake_dark_exposures(). */
void intake_darks_set(struct intake_darks *darks, int index, gint64 exposure_us, float *pixels,
                      double mean_dn);

/* That of a frame, which is number sub of its shot; of exposures without dark frames what others
 * say of it. Valid until the next call of the above. */
const struct intake_dark *intake_darks_at(struct intake_darks *darks, int sub, const Frame *frame);

void intake_darks_clear(struct intake_darks *darks);
