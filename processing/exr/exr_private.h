/* Sizes, scratch buffers and attributes, which exr.c, exr_read.c and exr_write.c share. */
#pragma once

#include <glib.h>

struct exr_part;

guint64 exr_plane_bytes(const struct exr_part *part);
/* Returns the number of bytes of three buffers together (packed, unpacked and intermediate), which
 * are needed while a part is read or written in chunks of this many lines. */
guint64 exr_chunk_bytes(const struct exr_part *part, int lines);

/* OpenEXR's buffers for one chunk, several megabytes with PIZ. The buffers are reused for all parts
 * of a file, because a file may have thousands of parts. */
struct exr_scratch {
    void *buffers[2];
    size_t bytes[2];
};

/* Exchanges the buffers in `scratch` with those of an OpenEXR pipeline. To be called before the
 * first chunk of the pipeline, and again before the pipeline is destroyed. */
void exr_scratch_swap(struct exr_scratch *scratch, void **first, size_t *first_bytes, void **second,
                      size_t *second_bytes);
void exr_scratch_clear(struct exr_scratch *scratch);

GPtrArray *exr_attributes_new(void); /* of struct exr_attribute */

/* Returns TRUE for attributes that EXR itself defines, such as size, channels and compression.
 * Readers skip them, and writers refuse them. */
gboolean exr_is_standard_attribute(const char *name);
