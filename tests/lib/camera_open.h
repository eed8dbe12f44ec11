/* Opens a camera in one step, for tests. A rig opens all of its cameras at the same time. */
#pragma once

#include "drivers/camera.h"

static inline Camera *camera_open(const struct camera_driver *driver,
                                  const struct config_section *section, const char *const *also,
                                  Clock *clock, GError **error) {
    Camera *camera = camera_open_begin(driver, section, also, clock, error);
    if (!camera || camera_open_finish(camera, error))
        return camera;
    camera_close(camera);
    return NULL;
}
