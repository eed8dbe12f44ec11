/*
 * Reads the frames of a capture: a frame's file is checked against its row in the session before
 * it is used. Any thread.
 */
#pragma once

#include "base/data_error.h"
#include "exr/exr.h"

struct input {
    char *path;   /* absolute */
    char *sha256; /* as in the session; NULL: not checked */
    gint64 shot;
    int width, height;    /* size of the camera's pictures */
    double turntable_deg; /* while it was exposed, in the middle */
};

void input_clear(struct input *input);

/* Reads the first part of the file. DATA_ERROR_INVALID: checksum or size differ from the
 * session's, the file cannot be read, or one of the channels (NULL-terminated) is missing. */
struct exr_part *input_read(const struct input *input, const char *const *channels, GError **error);

/* The mosaic of a frame that input_read() or exr_read_part() has read from path: height × width,
 * borrowed, and its colour filter. For a picture in colour ("rgb"), the mosaic is what a sensor
 * behind "rggb" would have seen, so that measurements on mosaics can use it; it overwrites the
 * channel G. NULL: a channel or attribute is missing. */
const float *input_mosaic(const char *path, struct exr_part *part, const char **ret_cfa,
                          GError **error);

/* Adds a text to the hash of a product's inputs; the end of each text counts, too. */
void input_hash(GChecksum *checksum, const char *format, ...) G_GNUC_PRINTF(2, 3);
