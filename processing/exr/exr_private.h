/* Shared by exr.c, exr_read.c and exr_write.c. */
#pragma once

#include <glib.h>

struct exr_part;

guint64 exr_plane_bytes(const struct exr_part *part);
/* Bytes per pixel while a part is read or written in chunks of this many lines: packed, unpacked,
 * and in between. */
guint64 exr_chunk_bytes(const struct exr_part *part, int lines);

GPtrArray *exr_attributes_new(void); /* of struct exr_attribute */

/* TRUE for attributes that EXR itself defines: size, channels, compression and so on. */
gboolean exr_is_standard_attribute(const char *name);
