/* Writes PNG and EXR files. */
#pragma once

#include <glib.h>
#include <locale.h>

#define PICTURE_KIND "picture" /* kind for output_file.h */

#define PICTURE_ERROR picture_error_quark()
GQuark picture_error_quark(void);
enum picture_error { PICTURE_ERROR_IO };

/* Writes a PNG. rgb has width × height × 3 bytes, sRGB, top row first. texts is a list of key,
 * value, key, value, …, NULL, or is NULL. The texts are stored in the file as text chunks (UTF-8).
 * The file appears under its name when it is complete. If a user has given the name, path must be
 * the result of output_file_path(). */
gboolean picture_write_png(const char *path, const guint8 *rgb, int width, int height,
                           const char *const *texts, GError **error);

/* Writes an EXR. rgb has width × height × 3 floats, linear, top row first. The texts are stored as
 * string attributes; "Shape" becomes "picture.shape". The file is marked as a picture; see
 * compare_is_picture(). */
gboolean picture_write_exr(const char *path, const float *rgb, int width, int height,
                           const char *const *texts, GError **error);

/* Between these two calls, printf() and similar functions write numbers with a decimal point in
 * this thread, whatever the user's locale. Call them around code that formats numbers for texts.
 * picture_numbers_end() takes the result of picture_numbers_begin(). */
locale_t picture_numbers_begin(void);
void picture_numbers_end(locale_t before);
