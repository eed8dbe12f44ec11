/* Calls that use devices by hand, for the commands snap, live, lamp, laser, move, home and test. */
#pragma once

#include "common/link.h"
#include "drivers/frame.h"

extern char *hand_rig; /* --rig */

#define HAND_RIG_ENTRY                                                                             \
    {                                                                                              \
        "rig", 0, 0, G_OPTION_ARG_FILENAME, &hand_rig,                                             \
            "Rig file, if no daemon has a rig open; a simulated rig needs no daemon", "RIG"        \
    }

/* Finds a daemon for the rig of --rig, and opens the rig if necessary. Without --rig, finds a
 * daemon, and fails with G_IO_ERROR_NOT_FOUND if this daemon has no rig open. Lights and moves that
 * this process has begun end when its connection closes. Free the link with link_free(). */
Link *hand_link(GError **error);

/* The same in two steps. hand_find() finds the daemon. *ret_rig is the absolute path of the rig of
 * --rig, or of the rig that the daemon has open; g_free(). hand_open() opens the rig if
 * necessary. */
Link *hand_find(char **ret_rig, GError **error);
gboolean hand_open(Link *link, const char *rig, GError **error);

/* Record what devices say (docs/build-a-rig/recordings.md). hand_begin_recording() closes the rig
 * if it is open, begins the recording, and opens the rig, so that the recording shows how its
 * devices are opened. If the rig cannot be opened, the function returns FALSE, but the recording
 * goes on. It also returns FALSE if the rig cannot be closed, or if the recording cannot begin.
 * hand_end_recording() closes the rig that is open, ends the recording and returns its text;
 * g_free(). hand_end_recording() opens the rig again if was_open is TRUE, and returns NULL if the
 * rig cannot be opened. was_open is the value that hand_begin_recording() has set. */
gboolean hand_begin_recording(Link *link, const char *rig, gboolean *was_open, GError **error);
char *hand_end_recording(Link *link, const char *rig, gboolean was_open, GError **error);

/* Length of the lease that hand_light() gives a light, in seconds. A lease belongs to this process.
 * When it ends, the daemon switches the light off, unless this process has renewed the lease
 * before. hand_snap() and hand_renew() renew all leases of this process. hand_light() and
 * hand_light_for() do so repeatedly while they wait. */
#define HAND_LEASE_S 30

/* hand_snap() takes a picture, and hand_light() switches a lamp or a laser. Both call a method of
 * the daemon and wait for its answer. hand_snap() first renews all leases of this process.
 * hand_light() renews them repeatedly while it waits, because a light may have to warm up. A
 * renewed lease ends HAND_LEASE_S after the renewal, even if it was longer before. The caller owns
 * the frame of hand_snap(); frame_unref(). */
Frame *hand_snap(Link *link, const char *camera, gint64 exposure_us, double gain_db,
                 GError **error);
gboolean hand_light(Link *link, gboolean laser, const char *name, gboolean on, GError **error);
/* Switches a light on with a lease of for_s seconds, and waits for the answer. While the light
 * warms up, all leases of this process are renewed repeatedly, each time for for_s seconds. */
gboolean hand_light_for(Link *link, gboolean laser, const char *name, double for_s, GError **error);

/* Asks the daemon to renew the leases of all lights that this process has switched on, so that they
 * end for_s seconds later. Does not wait for the answer, so a failure is not reported. */
void hand_renew(Link *link, double for_s);

/* hand_move() moves an axis to deg, hand_home() moves it to its home position. *ret_deg is the
 * angle at which the axis then stands, in degrees. */
gboolean hand_move(Link *link, const char *axis, double deg, double *ret_deg, GError **error);
gboolean hand_home(Link *link, const char *axis, double *ret_deg, GError **error);
