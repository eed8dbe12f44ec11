/* What exr.c, exr_read.c and exr_write.c share. */
#pragma once

#include <glib.h>

struct exr_part;

guint64 exr_plane_bytes(const struct exr_part *part);
/* While it is read or written by chunks of so many lines: packed, unpacked, and in between. */
guint64 exr_chunk_bytes(const struct exr_part *part, int lines);

GPtrArray *exr_attributes_new(void); /* of struct exr_attribute */

/* TRUE for what EXR itself says about a part: its size, channels, compression and so on. */
gboolean exr_is_standard_attribute(const char *name);
