/* The container of a glTF file in one piece (.glb). Any thread. */
#pragma once

#include <glib.h>

/* Returns a GLB file with a JSON text and one binary chunk. Both are padded to a multiple of four
 * bytes. */
GBytes *glb_new(const char *json, const GByteArray *binary);
