/* Shared by exr.c, exr_read.c and exr_write.c. */
#pragma once

#include <glib.h>

struct exr_part;

guint64 exr_plane_bytes(const struct exr_part *part);
/* Bytes per pixel while a part is read or written in chunks of this many lines: packed, unpacked,
 * and in between. */
guint64 exr_chunk_bytes(const struct exr_part *part, int lines);

/* OpenEXR's buffers for one chunk, megabytes for PIZ. They are kept from part to part, of which a
 * file has up to thousands. */
struct exr_scratch {
    void *buffers[2];
    size_t bytes[2];
};

/* Exchanges these buffers with those of a pipeline: to be called before its first chunk, and before
 * it is destroyed. */
void exr_scratch_swap(struct exr_scratch *scratch, void **first, size_t *first_bytes, void **second,
                      size_t *second_bytes);
void exr_scratch_clear(struct exr_scratch *scratch);

GPtrArray *exr_attributes_new(void); /* of struct exr_attribute */

/* TRUE for attributes that EXR itself defines: size, channels, compression and so on. */
gboolean exr_is_standard_attribute(const char *name);
