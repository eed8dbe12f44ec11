/*
 * All codecs there are. To add one: its folder, a line in the array in codecs.c, a line in
 * processing/CMakeLists.txt, and a drawing method in renderer/methods/.
 */
#pragma once

#include "codec/codec.h"
#include "codec/material.h"

extern const struct codec *const codecs[]; /* NULL-ended; the first is the default */

const struct codec *codecs_find(const char *name); /* NULL: there is none */

/* The codec of a file, by mesorig.kind of its first part that has one. Checks first that a file of
 * a session is as it was committed. */
const struct codec *codecs_of_file(const char *path, GError **error);

/* A session directory, its products/btf, or an EXR that “mesorig compress” or “mesorig process”
 * wrote. Stage "read", of BTFs alone; work may be NULL. */
Material *material_open(const char *path, const struct work *work, GError **error);
