/*
 * Checks that the USB links between cameras and computer have enough bandwidth: the load of each
 * open camera is added to every link on its path, whose speeds sysfs gives. Main loop's thread.
 */
#pragma once

#include <glib.h>

struct video_load; /* one camera's share */

/* Refused (DEVICE_ERROR_UNSUPPORTED) if a link would carry more than it can; the error names the
 * link, the cameras on it and what they need. sysfs: folder of the device; if it is NULL or not on
 * USB, nothing is counted and *ret is NULL. */
gboolean video_load_add(const char *who, const char *sysfs, double mb_s, struct video_load **ret,
                        GError **error);
void video_load_remove(struct video_load *load); /* NULL is ignored */

/* Capacity for isochronous transfers of a link of mbit Mbit/s, in 10⁶ bytes per second. */
double video_link_mb_s(double mbit_s);
