/* Both steps of a session in one process, for tests. The daemon takes the first step in a process
 * of its own (preparer.h). */
#pragma once

#include "capture/capture.h"

/* Makes and starts a session. */
static inline Capture *capture_start(struct devices *devices, const struct session_conf *conf,
                                     const char *directory,
                                     const struct capture_callbacks *callbacks, GError **error) {
    return capture_create(devices, conf, directory, error)
               ? capture_begin(devices, directory, callbacks, error)
               : NULL;
}

/* Examines and continues a session. */
static inline Capture *capture_resume(struct devices *devices, const char *directory,
                                      const struct capture_callbacks *callbacks, GError **error) {
    g_autofree char *warning = NULL;
    return capture_examine(devices, directory, &warning, error)
               ? capture_go_on(devices, directory, warning, callbacks, error)
               : NULL;
}
