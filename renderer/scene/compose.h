/* Joins two pictures of one scene, either side by side or as their difference. */
#pragma once

#include "viewer.h"

enum compose_mode { COMPOSE_ONE, COMPOSE_SPLIT, COMPOSE_DIFFERENCE, COMPOSE_MODES };

struct compose {
    enum compose_mode mode;
    double at; /* with COMPOSE_SPLIT: position of the border, from 0 (left) to 1 */
    /* with COMPOSE_DIFFERENCE: factor by which the difference of brightness is amplified around
     * middle grey */
    double gain;
};

typedef struct Compose Compose; /* belongs to the thread of the GL context */

Compose *compose_new(GError **error);
void compose_free(Compose *compose); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Compose, compose_free)

/* compose_draw() works like viewer_draw(). compose_render() returns the same picture as width ×
 * height × 3 bytes, sRGB, top row first, or NULL on error. Free it with g_free(). With COMPOSE_ONE,
 * second may be NULL. */
gboolean compose_draw(Compose *compose, Viewer *first, Viewer *second, const struct compose *how,
                      const struct viewer_settings *settings, guint framebuffer, int width,
                      int height, GError **error);
guint8 *compose_render(Compose *compose, Viewer *first, Viewer *second, const struct compose *how,
                       const struct viewer_settings *settings, int width, int height,
                       GError **error);
