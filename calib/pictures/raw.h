/*
 * This module reads camera raw files, which have the numbers of a sensor with a colour filter,
 * linear in light. Any thread may call the functions.
 *
 * A pixel with the number n has the value (n − b) / (w − b). b is the black level at its place, and
 * w is white. Both come from the file or from LibRaw's table of cameras. 0 is black and 1 is white.
 * Noise around black gives values below 0. The numbers are not changed otherwise: there is no white
 * balance and no demosaicing. Orientation is ignored: pixels stay as on the sensor. LibRaw runs in
 * a separate program (picture_child.h).
 */
#pragma once

#include "picture.h"
#include "picture_child.h"

G_BEGIN_DECLS

#define RAW_CFA 5 /* number of bytes of the name of a mosaic, with the NUL */

/* Returns whether a file counts as camera raw. The end of its name decides: .dng, .cr2, .nef and
 * others. */
gboolean raw_is(const char *path);

/* Reads the visible part of the sensor. ret_cfa gets the colour filter, beginning at the top left:
 * "mono", "rggb", "bggr", "grbg" or "gbrg". Pictures that are not a 2 × 2 mosaic (linear DNG,
 * X-Trans, a diagonal sensor) are refused. On failure returns NULL with an error of
 * input_file_open() or picture_child_run(), or with PICTURE_FILE_ERROR_IO if the result of the
 * program is incomplete. */
struct picture *raw_read(const char *path, char ret_cfa[RAW_CFA], GError **error);

/* Reads like raw_read(), but returns a grey picture for calibration, balanced with
 * picture_balance(). A pixel that is white in the file is at 1 or above. */
struct picture *raw_read_grey(const char *path, GError **error);

/* A raw_head is the first part of what the separate program writes for raw_read(). The values of
 * the picture follow it. `sum` is the checksum of struct picture. */
struct raw_head {
    int width, height;
    char cfa[RAW_CFA], sum[65];
};

G_END_DECLS
