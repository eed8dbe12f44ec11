/* Errors of Aravis as DEVICE_ERROR. Any thread. */
#pragma once

#include <glib.h>

/* Converts why, an error of Aravis, to an error that says what failed, and frees why. Returns TRUE
 * and sets no error if why is NULL. */
gboolean aravis_error_take(GError *why, const char *what, GError **error);

/* Returns TRUE for errors after which the camera has to be opened again. */
gboolean aravis_error_is_lost(const GError *error);
