/*
 * What JPEG, PNG and TIFF files say of their size, read before they are decoded. Any thread.
 */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* FALSE: it is none of the three, or larger than input_file_check_pixels() allows. A decoder that
 * says later what is wrong with a header is not anticipated. */
gboolean picture_header_check(const char *path, const guint8 *bytes, gsize length, GError **error);

G_END_DECLS
