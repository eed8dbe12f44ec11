/*
 * Cameras that the kernel's V4L2 serves: USB cameras (UVC) and others that stream by mmap.
 *
 * They run freely; a trigger is answered by the first frame that was exposed wholly after it and
 * after the last change of a setting, by the kernel's time stamps. Real time only.
 */
#pragma once

#include "drivers/camera.h"
#include "drivers/found.h"

extern const struct camera_driver v4l2_camera_driver;

gboolean v4l2_scan(GPtrArray *to, GError **error); /* see drivers/found.h */
