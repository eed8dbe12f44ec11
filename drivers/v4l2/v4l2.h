/*
 * Cameras that the kernel serves through V4L2: USB cameras (UVC) and others that stream by mmap.
 *
 * These cameras expose continuously. A trigger is answered by the first frame whose whole exposure
 * came after the trigger and after the last change of a setting, according to the kernel's time
 * stamps. The driver works in real time only.
 */
#pragma once

#include "drivers/camera.h"
#include "drivers/found.h"

extern const struct camera_driver v4l2_camera_driver;

gboolean v4l2_scan(GPtrArray *to, GError **error); /* see drivers/found.h */
