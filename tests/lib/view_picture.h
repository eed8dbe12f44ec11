/* The picture that the viewer saves of one material, for tests. */
#pragma once

#include "scene/compose.h"

/* Returns width × height × 3 bytes, sRGB, top row first. Free it with g_free(). */
static inline guint8 *view_picture(Viewer *viewer, const struct viewer_settings *settings,
                                   int width, int height, GError **error) {
    static const struct compose one = {COMPOSE_ONE, 0, 0};
    g_autoptr(Compose) compose = compose_new(error);
    return compose ? compose_render(compose, viewer, NULL, &one, settings, width, height, error)
                   : NULL;
}
