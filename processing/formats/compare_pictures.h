/*
 * Measures the perceived difference of two pictures, for example of renderings of two forms of a
 * material from the same camera under the same light (mesorig-view --render). Any thread.
 */
#pragma once

#include <glib.h>

struct picture_comparison {
    int width, height;
    double delta_e;           /* mean CIEDE2000 of all pixels */
    double delta_e_different; /* mean CIEDE2000 of the pixels that differ; 0 if there are none */
    /* p95: 95th percentile of CIEDE2000 over the pixels that differ; 0 if there are none
     * largest: maximum of CIEDE2000; 0 if no pixel differs */
    double p95, largest;
    double different; /* share of the pixels that differ */
    /* psnr(), ssim() and flip_ldr() of metrics/, at FLIP_PIXELS_PER_DEGREE */
    double psnr_db, ssim, flip;
    double flip_hdr; /* flip_hdr() of metrics/; NaN if picture a has no values above 1 */
};

/* The attribute of an EXR whose value is "picture" if the EXR is a picture and not a material. */
#define COMPARE_PICTURE_KIND "mesorig.kind"

/* Returns whether a file is a picture. An EXR is a picture if it has one part and the attribute
 * COMPARE_PICTURE_KIND is "picture". Another file is a picture if its name is that of a picture
 * (import_is_picture()). */
gboolean compare_is_picture(const char *path);

/* Compares two pictures of the same size. A picture has the tone curve that its file states. If the
 * file states none, 8-bit values are sRGB, and other values are linear. Values that are masked or
 * not finite count as black. Fails if a picture cannot be read or the sizes differ; the error is
 * then DATA_ERROR_INVALID. */
gboolean compare_pictures(const char *a, const char *b, struct picture_comparison *ret,
                          GError **error);
