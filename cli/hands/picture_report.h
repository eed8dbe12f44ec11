/* Exposure and focus of a camera's frame, and the frame as a file. */
#pragma once

#include "common/record.h"
#include "drivers/frame.h"

#define PICTURE_BINS 64

struct picture_report {
    double mean_dn, max_dn;
    double high_dn;           /* 99th percentile */
    double saturated;         /* part of the pixels at the end of the converter's range */
    double dark;              /* part of the pixels less than 1/256 of the range above black */
    double focus;             /* see below; 0: it is dark */
    guint bins[PICTURE_BINS]; /* pixels in equal parts of the range 0 … 2^bits − 1 */
};

/* focus: RMS of the Laplacian 4 I(x, y) − I(x ± s, y) − I(x, y ± s) over the mean of I, both above
 * black, where s = 2 behind a colour filter, else 1 (Pech-Pacheco et al. 2000 take its variance).
 * It grows as the picture becomes sharper, and compares pictures of one scene under one light only.
 */
struct picture_report picture_report(const Frame *frame);

/* Adds the values, with a text of three lines. */
void picture_report_tell(Record *to, const char *camera, const Frame *frame,
                         const struct picture_report *report);

/* Writes the file: .png 8 bits for people (sRGB, white at the 99th percentile), .exr what the
 * sensor gave, in DN. */
gboolean picture_write(const char *path, const char *camera, const Frame *frame, GError **error);
