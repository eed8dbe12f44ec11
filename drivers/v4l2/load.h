/*
 * Checks that the USB links between cameras and computer have enough bandwidth. The load of each
 * open camera is added to every link on its path. The speeds of the links come from sysfs. The
 * functions belong to the main loop's thread.
 */
#pragma once

#include <glib.h>

struct video_load; /* the load of one camera */

/* Adds the load of a camera. `who` names the camera in errors. mb_s is the load in 10⁶ bytes per
 * second. `sysfs` is the folder of the device. If `sysfs` is NULL or the device is not on USB,
 * nothing is counted and *ret is NULL.
 *
 * Fails with DEVICE_ERROR_UNSUPPORTED if a link would carry more than it can. The error names the
 * link, the cameras on it and the sum of their loads. */
gboolean video_load_add(const char *who, const char *sysfs, double mb_s, struct video_load **ret,
                        GError **error);
void video_load_remove(struct video_load *load); /* NULL is ignored */

/* Returns the load that a link of mbit_s (in Mbit/s) can carry in isochronous transfers, in 10⁶
 * bytes per second. */
double video_link_mb_s(double mbit_s);
