/* Checks before a capture moves anything: the free disk space, and whether a session fits the rig
 * on which it is resumed. Main loop's thread. */
#pragma once

#include "plan/plan.h"

/* Returns the free bytes of the file system that a path is or will be on; G_MAXUINT64 if
 * unknown. */
guint64 capture_free_bytes(const char *path);

/* Returns whether the disk is full: error says so, or less than 1 MiB is free in directory. */
gboolean capture_is_full(const char *directory, const GError *error);

/* Fails if the disk of path does not have this number of free bytes and a reserve of 64 MiB, or
 * if path is on no disk (/proc, for instance). The error says how many bytes are needed and how
 * many are free. */
gboolean capture_check_disk(const char *path, guint64 bytes, GError **error);

/* Fails for a session of another rig, if a camera has another name or size than in the session, or
 * if the shots name devices that this rig does not have. */
gboolean capture_check_rig(Session *session, const GPtrArray *shots, const struct devices *devices,
                           GError **error);

/* Returns a warning if the rig file now names other devices or options than when the session was
 * begun. The warning lists the differences. Returns NULL if there are none, or if a rig file
 * cannot be read; g_free(). */
char *capture_check_options(Session *session, const struct devices *devices);

/* Returns the text of the session's value CAPTURE_DEVICES_KEY, which stores the devices that answer
 * when the capture begins: one line for each device (devices_identities()). g_free() */
#define CAPTURE_DEVICES_KEY "devices"
char *capture_check_devices_text(const struct devices *devices);

/* Returns a warning that lists the devices if other devices answer now than when the session was
 * begun, otherwise NULL; g_free(). Only devices whose identity is known both times are compared. */
char *capture_check_devices(Session *session, const struct devices *devices);

/* Returns a warning if the rig's geometry or calibration has changed since the session was
 * begun, otherwise NULL; g_free(). */
char *capture_check_calibration(Session *session, const struct devices *devices);
