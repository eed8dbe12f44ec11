/* Checks before a capture moves anything: free disk space, and whether a session fits the rig on
 * which it is resumed. Main loop's thread. */
#pragma once

#include "plan/plan.h"

/* Free bytes where a path is or will be; G_MAXUINT64 if unknown. */
guint64 capture_free_bytes(const char *path);

/* Whether writing failed because there is no room. */
gboolean capture_is_full(const char *directory, const GError *error);

/* Refuses if that much does not fit, and says how much is missing. */
gboolean capture_check_disk(const char *path, guint64 bytes, GError **error);

/* Refuses a session of another rig, or one whose shots name devices this rig lacks. */
gboolean capture_check_rig(Session *session, const GPtrArray *shots, const struct devices *devices,
                           GError **error);

/* A warning if the rig file names other devices or options than when the session was begun, which
 * lists them; else NULL; g_free(). */
char *capture_check_options(Session *session, const struct devices *devices);

/* What the session keeps of the devices that answered when its capture began, for the value
 * CAPTURE_DEVICES_KEY: a line each (devices_identities()); g_free() */
#define CAPTURE_DEVICES_KEY "devices"
char *capture_check_devices_text(const struct devices *devices);

/* A warning if other devices answer now, which lists them, else NULL; g_free(). A device of which
 * then or now nothing is known is not compared. */
char *capture_check_devices(Session *session, const struct devices *devices);

/* A warning if the rig's calibration is not that of the session any more, else NULL; g_free(). */
char *capture_check_calibration(Session *session, const struct devices *devices);
