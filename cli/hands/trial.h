/* Pictures on trial before a capture, for test shots (guard.h) and for exposures that are "auto"
 * (auto_exposure.h): where the rig stands meanwhile, and which devices they are of. */
#pragma once

#include "common/link.h"
#include "plan/plan.h"

/* Lamps that are tried first: with a dark shot they make five. */
#define TRIAL_FIRST_LAMPS 4

struct trial {
    Link *link;
    const struct session_conf *conf;
    const struct rig *rig;                   /* nominal */
    int cameras[RIG_MAX_CAMERAS], n_cameras; /* the session plans with these */
    /* The session plans with these lamps. By the rig file, the first four are the brightest and the
     * dimmest on the sample and two between. */
    int lamps[RIG_MAX_LAMPS], n_lamps;
    int lasers[RIG_MAX_LASERS], n_lasers;
};

void trial_init(struct trial *trial, Link *link, const struct session_conf *conf,
                const struct rig *rig);

/* Homes turntable, arc, arm and probe, and turns the arc to the planned light or laser position
 * (lasers) farthest from the cameras, where it stands in no picture. An axis that the rig lacks is
 * left out. ret_arc_deg: where the arc stands now. */
gboolean trial_pose(const struct trial *trial, gboolean lasers, double *ret_arc_deg,
                    GError **error);

/* Takes a picture, after the arm has moved to the camera's stop; a dark picture is taken wherever
 * the arm stands. */
Frame *trial_snap(const struct trial *trial, int camera, double exposure_us, gboolean dark,
                  GError **error);
/* Switches a lamp, after the probe has moved to the lamp's stop. */
gboolean trial_light(const struct trial *trial, int lamp, gboolean on, GError **error);

/* Rounds an exposure to two digits, since it is not known more exactly. */
double trial_rounded_us(double us);
