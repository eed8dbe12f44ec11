/* The kind of a file or folder that a user opens in the window. */
#pragma once

#include "drawing/methods/method.h"

enum file_kind {
    FILE_KIND_SESSION,     /* a session's folder */
    FILE_KIND_MATERIAL,    /* a compressed BTF */
    FILE_KIND_MDF,         /* an MDF in any of its forms */
    FILE_KIND_SHAPE,       /* .obj, .gltf, .glb */
    FILE_KIND_NORMALS,     /* a normal map */
    FILE_KIND_ENVIRONMENT, /* an EXR with R, G, B that is twice as wide as high */
};

struct file_opened {
    enum file_kind kind;
    /* Path of the file or folder. For session.db or products of a session, the path of the
     * session. */
    char *path;
    const struct method *method; /* FILE_KIND_MATERIAL: the method that draws it */
};

/* Finds the kind of a file. Only the headers of an EXR are read. The error names the file and lists
 * the kinds that can be opened. Free the result with file_opened_clear(). */
gboolean file_kind_find(const char *path, struct file_opened *ret, GError **error);
void file_opened_clear(struct file_opened *opened);

/* Returns whether the ending of a file name is that of a kind that can be opened, so that a file
 * dialog shows the file. */
gboolean file_kind_is_shown(const char *name);
/* Returns whether a folder contains session.db or products. */
gboolean file_kind_is_session(const char *folder);
