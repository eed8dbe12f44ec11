/*
 * Camera raw (LibRaw): the numbers of a sensor behind its colour filter, linear in light. Any
 * thread.
 *
 * A pixel with the number n has the value (n − b) / (w − b), with b the black level at its place
 * and w white, both from the file or from LibRaw's table of cameras. 0 is black, 1 is white; noise
 * around black goes below 0. Nothing else is done to the numbers: no white balance, no demosaicing.
 * Orientation is ignored: pixels stay as on the sensor. LibRaw runs in a
 * program of its own (picture_child.h).
 */
#pragma once

#include "picture.h"
#include "picture_child.h"

G_BEGIN_DECLS

#define RAW_CFA 5 /* room for the name of a mosaic */

/* Whether a file is taken for camera raw: by the end of its name, .dng, .cr2, .nef and others. */
gboolean raw_is(const char *path);

/* Reads the visible part of the sensor. ret_cfa: "mono" or "rggb", "bggr", "grbg", "gbrg", the
 * filter at the top left. NULL: PICTURE_FILE_ERROR_IO; pictures that are no mosaic of 2 × 2 (linear
 * DNG, X-Trans, a sensor set diagonally) are refused. */
struct picture *raw_read(const char *path, char ret_cfa[RAW_CFA], GError **error);

/* The same as raw_read(), but as a grey picture for calibration: balanced (picture_balance()); a
 * pixel that is white in the file stays at 1 or above. */
struct picture *raw_read_grey(const char *path, GError **error);

/* Between raw_read() and the program: its output begins with this, and the values follow. */
struct raw_head {
    int width, height;
    char cfa[RAW_CFA], sum[65];
};

/* For the program that reads: raw_child.c. */
gboolean raw_child_read(const struct picture_job *job, GError **error);

G_END_DECLS
