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

/* Finds a daemon for the rig of --rig, and opens the rig if necessary. Without --rig, finds the
 * daemon that the user means; if this daemon has no rig open, fails with G_IO_ERROR_NOT_FOUND. When
 * the connection of this process closes, its lights go off and its moves end. Free the link with
 * link_free(). */
Link *hand_link(GError **error);

/* The two steps of hand_link(). hand_find() finds the daemon, and sets *ret_rig to the absolute
 * path of the rig: that of --rig or, without --rig, that of the rig that the daemon has open. Free
 * *ret_rig with g_free(). hand_open() opens the rig if necessary. */
Link *hand_find(char **ret_rig, GError **error);
gboolean hand_open(Link *link, const char *rig, GError **error);

/* Record what devices say (docs/build-a-rig/recordings.md).
 *
 * hand_begin_recording() closes the rig if it is open, begins the recording, and opens the rig, so
 * that the recording shows how the devices are opened. *was_open is set to whether the rig was open
 * before. The function returns FALSE with an error if the rig cannot be closed, the recording
 * cannot begin, or the rig cannot be opened. In the last case, the recording goes on.
 *
 * hand_end_recording() closes the rig that is open, ends the recording and returns its text, to be
 * freed with g_free(). If was_open is TRUE, the function then opens the rig again, and returns NULL
 * with an error if this fails. */
gboolean hand_begin_recording(Link *link, const char *rig, gboolean *was_open, GError **error);
char *hand_end_recording(Link *link, const char *rig, gboolean was_open, GError **error);

/* Length of the lease that hand_light() gives a light, in seconds. A lease is the time for which
 * this process may have a light on. When the lease ends without being renewed, the daemon switches
 * the light off. hand_snap() and hand_renew() renew all leases of this process. hand_light() and
 * hand_light_for() renew them repeatedly while they wait. */
#define HAND_LEASE_S 30

/* Call a method of the daemon and wait for its answer. hand_snap() takes a picture, and
 * hand_light() switches a lamp or a laser.
 *
 * hand_snap() first renews all leases of this process. hand_light() renews them repeatedly while it
 * waits, because a light may have to warm up. A renewed lease ends HAND_LEASE_S after the renewal,
 * even if it was longer before. The caller owns the frame that hand_snap() returns; free it with
 * frame_unref(). */
Frame *hand_snap(Link *link, const char *camera, gint64 exposure_us, double gain_db,
                 GError **error);
gboolean hand_light(Link *link, gboolean laser, const char *name, gboolean on, GError **error);
/* Switches a light on with a lease of for_s seconds, and waits for the answer. The light may have
 * to warm up. Meanwhile, all leases of this process are renewed repeatedly, each time for for_s
 * seconds. */
gboolean hand_light_for(Link *link, gboolean laser, const char *name, double for_s, GError **error);

/* Asks the daemon to let the leases of all lights that this process has switched on end for_s
 * seconds from now. Does not wait for the answer, so a failure is not reported. */
void hand_renew(Link *link, double for_s);

/* hand_move() moves an axis to the angle deg. hand_home() homes an axis. *ret_deg is set to the
 * angle at which the axis then stands, in degrees. */
gboolean hand_move(Link *link, const char *axis, double deg, double *ret_deg, GError **error);
gboolean hand_home(Link *link, const char *axis, double *ret_deg, GError **error);
