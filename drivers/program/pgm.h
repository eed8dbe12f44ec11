/* Pictures that programs write: PGM (netpbm's P5) with 8 or 16 bits, one value for each pixel. Any
 * thread may call the functions. Errors are DEVICE_ERROR_PROTOCOL without a subject. */
#pragma once

#include "drivers/frame.h"

/* Reads width × height values, each of at most `bits` bits, from the bytes of a file. pixels gets
 * the values, top row first. If the file ends early, *ret_complete is FALSE and the missing pixels
 * are 0. */
gboolean pgm_parse(const guint8 *bytes, gsize n, int width, int height, int bits, guint16 *pixels,
                   gboolean *ret_complete, GError **error);

/* Reads a picture in a folder and removes its file. name comes from a program: it must be the
 * name of a regular file, without a path. Returns a frame of which only pixels, width, height, bits
 * and incomplete are set, or NULL with an error. */
Frame *pgm_take(const char *folder, const char *name, int width, int height, int bits,
                GError **error);
