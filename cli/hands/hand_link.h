/* Calls of devices by hand, for the commands snap, live, lamp, laser, move, home and test. */
#pragma once

#include "common/link.h"
#include "drivers/frame.h"

extern char *hand_rig; /* --rig */

#define HAND_RIG_ENTRY                                                                             \
    {                                                                                              \
        "rig", 0, 0, G_OPTION_ARG_FILENAME, &hand_rig,                                             \
            "Rig file, if no daemon has a rig open; a simulated rig needs no daemon", "RIG"        \
    }

/* Finds a daemon with a rig open: that of --rig, or whichever rig it has. Lights and moves that
 * this process has begun end with its connection. */
Link *hand_link(GError **error);

/* How long a light stays on unless hand_snap(), hand_light() or hand_renew() is called. */
#define HAND_LEASE_S 30

/* Each calls the method of the same name and waits for the answer. hand_snap() and hand_light()
 * renew the leases of the lights that are on, hand_light() also while a light warms up. */
Frame *hand_snap(Link *link, const char *camera, gint64 exposure_us, double gain_db,
                 GError **error);
gboolean hand_light(Link *link, gboolean laser, const char *name, gboolean on, GError **error);
/* The same for at most for_s from now, or from the last renewal while the light warms up. */
gboolean hand_light_for(Link *link, gboolean laser, const char *name, double for_s, GError **error);

/* Renews the leases of the lights that this process has switched on, without waiting for the
 * answer. */
void hand_renew(Link *link, double for_s);

gboolean hand_move(Link *link, const char *axis, double deg, double *ret_deg, GError **error);
gboolean hand_home(Link *link, const char *axis, double *ret_deg, GError **error);
