/* Laser units that are mounted by hand. A unit may be mounted at several places, and each place is
 * a laser section of the rig file. This module knows the place of each unit according to the
 * session, and finds the shots that can be taken with the units at these places. The struct belongs
 * to the Capture. All functions belong to the main loop's thread. */
#pragma once

#include "capture_session.h"

struct capture_mounts {
    /* For each unit: the laser section whose place it is mounted at; −1 if not known. */
    int mounted[RIG_MAX_LASERS];
    int wanted; /* laser section of the place at which a unit must be mounted next; −1 if none */
};

/* Reads the last place of each unit from the session and passes it to the driver of the unit.
 * Returns FALSE with an error on failure. */
gboolean capture_mount_load(struct capture_mounts *mounts, const struct capture_session *session,
                            GError **error);

/* Returns whether a shot can be taken with the laser units at their present places. */
gboolean capture_mount_is_in_place(const struct capture_mounts *mounts,
                                   const struct rig_timing *timing,
                                   const struct session_shot *shot);

/* Moves the sweeps that can be taken with the units at their present places to the front of shots.
 * Such sweeps may be behind others, for instance because they are repeated. Returns the number of
 * shots at the front that can be taken before a unit must be mounted at another place. If any shot
 * needs a unit whose place is not known, returns 0. */
guint capture_mount_reach(const struct capture_mounts *mounts, const struct rig_timing *timing,
                          GPtrArray *shots);

/* Chooses the mounting that is needed next for the n shots. If a shot needs a unit whose place is
 * not known, it is the mounting for the first such shot. Otherwise it is the mounting for the first
 * shot whose unit is at another place. There must be such a shot.
 *
 * Returns the prompt for the user, to be freed with g_free(), and sets *ret_unit to the name of the
 * unit. The caller then pauses the session with this prompt. */
char *capture_mount_ask(struct capture_mounts *mounts, const struct capture_session *session,
                        const struct session_shot *const *shots, guint n, const char **ret_unit);

/* Call this when the user has confirmed the requested mounting. Stores the mounting in the session
 * and passes it to the driver. If no mounting was requested, does nothing and returns TRUE. Returns
 * FALSE with an error on failure. */
gboolean capture_mount_answer(struct capture_mounts *mounts, const struct capture_session *session,
                              GError **error);
