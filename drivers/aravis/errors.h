/* Converts errors of Aravis to DEVICE_ERROR. Any thread may call these functions. */
#pragma once

#include <glib.h>

/* Returns TRUE if `why` is NULL. Otherwise `why` is an error of Aravis. The function then sets a
 * DEVICE_ERROR with the same meaning, frees `why` and returns FALSE. `what` names the feature or
 * step that failed. */
gboolean aravis_error_take(GError *why, const char *what, GError **error);

/* Returns TRUE for errors after which the camera has to be opened again. */
gboolean aravis_error_is_lost(const GError *error);
