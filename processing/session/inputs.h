/*
 * Reading what a capture has left: a frame's file is checked against its row in the session before
 * anything is believed of it. Any thread.
 */
#pragma once

#include "base/data_error.h"
#include "exr/exr.h"

struct input {
    char *path;   /* absolute */
    char *sha256; /* as in the session; NULL: not checked */
    gint64 shot;
    int width, height; /* of the camera */
};

void input_clear(struct input *input);

/* The first part of the file. DATA_ERROR_INVALID if checksum or size differ from the session's, if
 * the file cannot be read, or if one of the channels (NULL-terminated) is missing. */
struct exr_part *input_read(const struct input *input, const char *const *channels, GError **error);

/* Adds a text to what a product is made of; the end of each text counts too. */
void input_hash(GChecksum *checksum, const char *format, ...) G_GNUC_PRINTF(2, 3);
