/* Writes a picture with all settings that are needed to reproduce it. In a PNG file the settings
 * are text chunks, and in an EXR file attributes. */
#pragma once

#include "viewer_options.h"

struct snapshot {
    const char *material; /* path; written as NAME, or as SESSION/products/NAME */
    const char *shape;
    /* `second` is the method with which `first` is compared, or NULL. */
    const struct method *first, *second;
    const struct compose *how;
    gboolean reference;                     /* the picture is a reference from the whole BTF */
    const struct viewer_settings *settings; /* with the actual numbers of tiles, not 0 */
    /* the options, which give the files from which the picture was made, and the floor */
    const struct viewer_options *options;
    /* For a live session, `n_views` is the number of measured views, and `n_planned` the number of
     * planned views. Otherwise both are 0. */
    int n_views, n_planned;
};

/* Writes a PNG if rgb is given, and an EXR if light is given; the other of the two must be NULL.
 * rgb is a result of compose_render(), and light a result of viewer_render_light(). */
gboolean snapshot_write(const char *path, const struct snapshot *snapshot, const guint8 *rgb,
                        const float *light, int width, int height, GError **error);
