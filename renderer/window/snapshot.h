/* Writes a picture with all settings that are needed to reproduce it. In a PNG file the settings
 * are text chunks, and in an EXR file attributes. */
#pragma once

#include "viewer_options.h"

struct snapshot {
    const char *material; /* path of the material; written as NAME, or as SESSION/products/NAME */
    const char *shape;
    /* `first` is the method that draws the picture. `second` is the method with which `first` is
     * compared, or NULL. */
    const struct method *first, *second;
    const struct compose *how;
    gboolean reference;                     /* the picture is a reference from the whole BTF */
    const struct viewer_settings *settings; /* with the actual numbers of tiles, not 0 */
    /* Options of the program. They give the files from which the picture was made, and the floor.
     */
    const struct viewer_options *options;
    /* For a live session, `n_views` is the number of measured views, and `n_planned` the number of
     * planned views. Otherwise both are 0. */
    int n_views, n_planned;
};

/* Writes a PNG or an EXR. For a PNG, rgb is a result of compose_render(), and light is NULL. For an
 * EXR, light is a result of viewer_render_light(), and rgb is NULL. */
gboolean snapshot_write(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                        const float *light, int width, int height, GError **error);
