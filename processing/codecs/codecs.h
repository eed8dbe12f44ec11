/* This array lists all codecs. A new codec needs a folder and a row of the array in codecs.c. To
 * draw its files, it also needs a method in renderer/drawing/methods. contrib/new-codec writes a
 * skeleton of all three. */
#pragma once

#include "codec/codec.h"
#include "codec/material.h"

extern const struct codec *const codecs[]; /* NULL-ended; the first is the default */

const struct codec *codecs_find(const char *name); /* NULL if there is no such codec */

/* Returns the codec of a file: the codec whose name is the attribute mesorig.kind of the first part
 * with that attribute. If the file belongs to a session, the function first checks that the file is
 * as it was committed. */
const struct codec *codecs_of_file(const char *path, GError **error);

/* Opens a session directory, the directory products/btf of a session, or an EXR file that “mesorig
 * compress” or “mesorig process” wrote. Reports the progress stage "read" for BTFs only; work may
 * be NULL. */
Material *material_open(const char *path, const struct work *work, GError **error);
