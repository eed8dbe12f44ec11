/*
 * How far two pictures are apart for the eye: renderings of two forms of a material, from the same
 * camera under the same light (mesorig-view --render). Any thread.
 */
#pragma once

#include <glib.h>

struct picture_comparison {
    int width, height;
    double delta_e;         /* mean CIEDE2000 of all pixels */
    double delta_e_covered; /* of those alone that differ from the first picture's corner, where
                               nothing is drawn; 0 if none does */
    double p95, largest;    /* of those */
    double covered;         /* their share */
};

/* Whether a file's name is that of a PNG, TIFF or JPEG. */
gboolean compare_is_picture(const char *path);

/* Of the same size; 8 bits are sRGB. IMPORT_ERROR_DATA if one cannot be read. */
gboolean compare_pictures(const char *a, const char *b, struct picture_comparison *ret,
                          GError **error);
