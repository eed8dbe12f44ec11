/* Reads the frames of a capture. The file of a frame is compared with its row in the session before
 * it is used. Any thread. */
#pragma once

#include "base/data_error.h"
#include "exr/exr.h"

struct input {
    char *path;   /* absolute */
    char *sha256; /* checksum in the session; NULL or empty if the file is not to be checked */
    gint64 shot;
    int width, height;    /* size of the camera's pictures */
    double turntable_deg; /* angle of the turntable in the middle of the exposure */
};

void input_clear(struct input *input);

/* Reads the first part of the file. channels is NULL-terminated. The error is DATA_ERROR_INVALID if
 * the checksum differs from the session's, if the picture is not width × height, if the file cannot
 * be read or has no parts, or if one of the channels is missing. Free the part with
 * exr_part_free(). */
struct exr_part *input_read(const struct input *input, const char *const *channels, GError **error);

/* Returns the mosaic of a frame that input_read() or exr_read_part() has read from path: height ×
 * width, borrowed. *ret_cfa receives the colour filter of the mosaic (borrowed). path is for
 * messages. Returns NULL with an error if a channel or an attribute is missing.
 *
 * For a picture in colour ("rgb"), the function computes the mosaic that a sensor behind "rggb"
 * would have recorded, so that code for mosaics can use it. This mosaic overwrites the channel
 * G. */
const float *input_mosaic(const char *path, struct exr_part *part, const char **ret_cfa,
                          GError **error);

/* Adds a text to the hash of a product's inputs. The end of the text is hashed as well, so that two
 * texts give another hash than their concatenation. */
void input_hash(GChecksum *checksum, const char *format, ...) G_GNUC_PRINTF(2, 3);
