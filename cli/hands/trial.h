/* Trial pictures before a capture, for test shots (guard.h) and for exposures that are "auto"
 * (auto_exposure.h). This module moves the rig to a pose, and chooses the devices that are
 * tried. */
#pragma once

#include "common/link.h"
#include "plan/plan.h"

/* Number of lamps that are tried first. These and a dark shot make five shots. */
#define TRIAL_FIRST_LAMPS 4

struct trial {
    Link *link;
    const struct session_conf *conf;
    const struct rig *rig;                   /* the nominal rig */
    int cameras[RIG_MAX_CAMERAS], n_cameras; /* the cameras in the session's plan */
    /* The lamps in the session's plan. If there are more than four, four of them come first,
     * ordered by their irradiance on the sample according to the rig file: the brightest, the
     * dimmest, and two between them. */
    int lamps[RIG_MAX_LAMPS], n_lamps;
    int lasers[RIG_MAX_LASERS], n_lasers;
};

void trial_init(struct trial *trial, Link *link, const struct session_conf *conf,
                const struct rig *rig);

/* Homes turntable, arc, arm and probe, as far as the rig has them. Then turns the arc to a position
 * on the first planned ring of lights or, if lasers is TRUE, of lasers. Of the positions on the
 * ring, the one that is farthest from all cameras is taken, so that the arc is not in their
 * pictures. *ret_arc_deg is the angle of the arc, or 0 if there is none. */
gboolean trial_pose(const struct trial *trial, gboolean lasers, double *ret_arc_deg,
                    GError **error);

/* Moves the arm to the camera's stop and takes a picture. For a dark picture, the arm does not
 * move. The caller owns the frame; free it with frame_unref(). */
Frame *trial_snap(const struct trial *trial, int camera, double exposure_us, gboolean dark,
                  GError **error);
/* Switches a lamp on or off. Before a lamp on the probe is switched on, the probe moves to the stop
 * of the lamp. */
gboolean trial_light(const struct trial *trial, int lamp, gboolean on, GError **error);

/* Rounds an exposure to two significant digits, because it is not known more exactly. */
double trial_rounded_us(double us);
