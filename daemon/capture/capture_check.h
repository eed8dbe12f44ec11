/* Checks before a capture moves anything: whether the disk has enough free space, and whether a
 * session fits the rig on which it is resumed. All functions belong to the main loop's thread. */
#pragma once

#include "plan/plan.h"

/* Returns the free bytes of the file system of a path, which need not exist yet. Returns
 * G_MAXUINT64 if they are not known. */
guint64 capture_free_bytes(const char *path);

/* Returns whether the disk is full. It is full if error says so, or if less than 1 MiB is free in
 * directory. */
gboolean capture_is_full(const char *directory, const GError *error);

/* Returns TRUE if the disk of path has this number of free bytes and a reserve of 64 MiB. Otherwise
 * returns FALSE with an error that says how many bytes are needed and how many are free. Also
 * returns FALSE if path is on no disk, such as in /proc. */
gboolean capture_check_disk(const char *path, guint64 bytes, GError **error);

/* Checks whether a session fits this rig. Returns FALSE with an error if the session is of another
 * rig, if a camera has another name or size than in the session, or if the shots name devices that
 * this rig does not have. */
gboolean capture_check_rig(Session *session, const GPtrArray *shots, const struct devices *devices,
                           GError **error);

/* Compares the devices and options in the rig file with those when the session was begun. If they
 * differ, returns a warning that lists the differences, to be freed with g_free(). Returns NULL if
 * they are the same, or if one of the two rig files cannot be read. */
char *capture_check_options(Session *session, const struct devices *devices);

/* Returns the text of the session's value CAPTURE_DEVICES_KEY. It lists the devices that answer
 * when the capture begins, one line for each device (devices_identities()). Free it with
 * g_free(). */
#define CAPTURE_DEVICES_KEY "devices"
char *capture_check_devices_text(const struct devices *devices);

/* Compares the identities of the devices that answer with those when the session was begun. If they
 * differ, returns a warning that lists these devices, to be freed with g_free(). Otherwise returns
 * NULL. A device is compared only if its identity is known both times. */
char *capture_check_devices(Session *session, const struct devices *devices);

/* Returns a warning if the rig's geometry or calibration has changed since the session was begun,
 * to be freed with g_free(). Otherwise returns NULL. */
char *capture_check_calibration(Session *session, const struct devices *devices);
