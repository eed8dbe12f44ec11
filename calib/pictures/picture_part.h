/*
 * This module reads a part of a PNG row by row, with memory for that part only. The picture may
 * therefore be much larger than a picture that is decoded as a whole. Errors are
 * PICTURE_FILE_ERROR, INPUT_FILE_ERROR and, for errors of the system, G_FILE_ERROR. Any thread may
 * call the functions.
 */
#pragma once

#include "picture_read.h"

G_BEGIN_DECLS

struct picture_part {
    int x, y, width, height; /* pixels from the top left corner */
};

/* Returns whether the file is a PNG whose rows follow each other, and gives its size. Returns FALSE
 * for an interlaced PNG, whose rows are in another order, and if the file cannot be read. */
gboolean picture_part_can(const char *path, int *ret_width, int *ret_height);

/* Reads a part that lies within the picture, like picture_read_codes(). width and height of ret are
 * those of the part. */
gboolean picture_part_read(const char *path, const struct picture_part *part,
                           struct picture_codes *ret, GError **error);

G_END_DECLS
