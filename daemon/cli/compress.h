/* What the sources of compress share. */
#pragma once

#include <gio/gio.h>

/* That no other process makes this file, whose left-overs are removed: file_lock_give(lock,
 * *ret_lock). −1: error; ret_lock is the caller's all the same. */
int compress_lock(const char *path, char **ret_lock, GError **error);

/* --method=mdf or mdf-views. */
enum compress_mdf_kind {
    COMPRESS_MDF_MAPS,
    COMPRESS_MDF_HALF,
    COMPRESS_MDF_8BIT,
    COMPRESS_MDF_4BIT
};
struct compress_mdf {
    const char *path;            /* a session, or an mdf.exr */
    enum compress_mdf_kind kind; /* few maps; or each view on its own */
    int terms;                   /* maps; 0: not asked for */
    double target;               /* of maps: RMS in texels, 0: none */
    const char *output;
    const char *made_by; /* what session_add_product_file() is told */
};
int compress_mdf(const struct compress_mdf *asked);
