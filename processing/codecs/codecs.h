/*
 * All codecs there are. To add one: its folder, a line in the array in codecs.c, a line in
 * processing/CMakeLists.txt, and a drawing method in renderer/methods/.
 */
#pragma once

#include "codec/codec.h"
#include "codec/material.h"

extern const struct codec *const codecs[]; /* NULL-ended; the first is the default */

const struct codec *codecs_find(const char *name); /* NULL: there is none */

/* Returns the codec of a file: that of the attribute mesorig.kind, in the first part that has it.
 * If the file belongs to a session, checks first that it is as it was committed. */
const struct codec *codecs_of_file(const char *path, GError **error);

/* A session directory, its products/btf, or an EXR that “mesorig compress” or “mesorig process”
 * wrote. Stage "read", of BTFs alone; work may be NULL. */
Material *material_open(const char *path, const struct work *work, GError **error);
