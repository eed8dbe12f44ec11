/* What exr.c, exr_read.c and exr_write.c share. */
#pragma once

#include <glib.h>

GPtrArray *exr_attributes_new(void); /* of struct exr_attribute */

/* TRUE for what EXR itself says about a part: its size, channels, compression and so on. */
gboolean exr_is_standard_attribute(const char *name);
