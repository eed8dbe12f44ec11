/*
 * Settings of a camera that libgphoto2 has opened. A value that the camera does not offer is an
 * error that names the nearest value. The library itself would silently set that nearest value.
 * Every value is read back after it was set. Errors are G_IO_ERROR without a subject.
 */
#pragma once

#include <glib.h>
#include <gphoto2/gphoto2.h>

/* Returns the value as a text, or NULL if the camera has no such setting. Free it with g_free(). */
char *setting_get(Camera *camera, GPContext *context, const char *name);

/* Returns the values that the camera offers, or NULL if the setting is no list or does not exist.
 * Free them with g_strfreev(). */
char **setting_choices(Camera *camera, GPContext *context, const char *name);

/* Sets a value, and waits until the camera reports it. If the camera is busy, the function tries
 * again until deadline_us, a time of g_get_monotonic_time(). */
gboolean setting_set(Camera *camera, GPContext *context, const char *name, const char *value,
                     gint64 deadline_us, GError **error);
