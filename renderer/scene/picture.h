/* PNG and EXR files. */
#pragma once

#include <glib.h>
#include <locale.h>

#define PICTURE_KIND "picture" /* of output_file.h */

#define PICTURE_ERROR picture_error_quark()
GQuark picture_error_quark(void);
enum picture_error { PICTURE_ERROR_IO };

/* rgb: width × height × 3 bytes, sRGB, top row first. texts: key, value, key, value, …, NULL; kept
 * in the file as text chunks (UTF-8). The file appears under its
 * name when it is whole; of a user's name, path is that of output_file_path(). */
gboolean picture_write_png(const char *path, const guint8 *rgb, int width, int height,
                           const char *const *texts, GError **error);

/* rgb: width × height × 3 floats, linear, top row first. The texts are string attributes,
 * "picture.shape" for "Shape". The file says that it is a picture: see compare_is_picture(). */
gboolean picture_write_exr(const char *path, const float *rgb, int width, int height,
                           const char *const *texts, GError **error);

/* Between these two calls, printf() and its like write numbers with a decimal point in this thread,
 * whatever the user's locale: for the texts above. */
locale_t picture_numbers_begin(void);
void picture_numbers_end(locale_t before);
