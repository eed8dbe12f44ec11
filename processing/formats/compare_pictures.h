/*
 * How far two pictures are apart for the eye: renderings of two forms of a material, from the same
 * camera under the same light (mesorig-view --render). Any thread.
 */
#pragma once

#include <glib.h>

struct picture_comparison {
    int width, height;
    double delta_e;           /* mean CIEDE2000 of all pixels */
    double delta_e_different; /* of those alone that are not the same; 0 if all are */
    double p95, largest;      /* of those */
    double different;         /* their share */
};

/* An attribute that EXR pictures have, and materials have not. */
#define COMPARE_PICTURE_KIND "mesorig.kind"

/* Whether a file's name is that of a PNG, TIFF or JPEG, or it is an EXR that says it is a picture.
 */
gboolean compare_is_picture(const char *path);

/* Of the same size; 8 bits are sRGB, EXR is linear. DATA_ERROR_INVALID if one cannot be read. */
gboolean compare_pictures(const char *a, const char *b, struct picture_comparison *ret,
                          GError **error);
