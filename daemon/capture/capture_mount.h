/* Laser units that are mounted by hand: the place of each unit according to the session, and the
 * shots that can be taken with the unit at that place. The struct belongs to the Capture. Main
 * loop's thread. */
#pragma once

#include "capture_session.h"

struct capture_mounts {
    /* for each unit: the laser section at whose place it is mounted; −1 if not known */
    int mounted[RIG_MAX_LASERS];
    int wanted; /* laser section of the place where its unit must be mounted next; −1 if none */
};

/* Reads the last place of each unit from the session and passes it to the driver of the unit. */
gboolean capture_mount_load(struct capture_mounts *mounts, const struct capture_session *session,
                            GError **error);

/* Returns whether a shot can be taken with the laser units at their present places. */
gboolean capture_mount_is_in_place(const struct capture_mounts *mounts,
                                   const struct rig_timing *timing,
                                   const struct session_shot *shot);

/* Moves the sweeps that can be taken with the units at their present places to the front of shots.
 * They may stand behind other sweeps, for instance sweeps that are repeated. Returns the number of
 * shots at the front that can be taken before a unit must be mounted at another place. Returns 0 if
 * any shot needs a unit whose place is not known. */
guint capture_mount_reach(const struct capture_mounts *mounts, const struct rig_timing *timing,
                          GPtrArray *shots);

/* Chooses the mounting that is needed next. It is the mounting for the first of the n shots whose
 * unit has no known place. If the places of all units are known, it is the mounting for the first
 * shot whose unit is at another place. There must be such a shot. Returns the prompt for the user
 * (g_free()), and sets *ret_unit to the name of the unit. The caller then pauses the session with
 * this prompt. */
char *capture_mount_ask(struct capture_mounts *mounts, const struct capture_session *session,
                        const struct session_shot *const *shots, guint n, const char **ret_unit);

/* Call it when the user has confirmed the requested mounting. Stores the mounting in the session
 * and passes it to the driver. Does nothing and returns TRUE if no mounting was requested. */
gboolean capture_mount_answer(struct capture_mounts *mounts, const struct capture_session *session,
                              GError **error);
