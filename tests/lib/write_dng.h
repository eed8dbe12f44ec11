/* Writes a DNG of dng.h to a file. */
#pragma once

#include "lib/ok.h"
#include "virtual/cameras/dng.h"

static inline void write_dng(const char *path, const struct dng *dng) {
    g_autoptr(GBytes) file = dng_new(dng);
    ok(g_file_set_contents(path, g_bytes_get_data(file, NULL), (gssize)g_bytes_get_size(file),
                           ERR));
}
