/* The files of a session's BTF, for exports that read them view by view. Any thread. */
#pragma once

#include "btf/btf_layout.h"
#include "session/session.h"

struct session_view_files {
    struct session_grid grid;
    GPtrArray *paths; /* of views that have a file, in order */
    struct direction_list views, lights;
};

/* Lists the files, and reads their headers. The lights are those of the first view. The lights of
 * another view are compared with these when that view is read. The error is DATA_ERROR_INCOMPLETE
 * if there is no BTF yet. Call session_view_files_clear() even after an error. */
gboolean session_view_files_open(struct session_view_files *ret, const char *session,
                                 GError **error);
void session_view_files_clear(struct session_view_files *files);

/* Callback for the picture of a view under a light. planes are R, G, B and "mark" (NULL if no texel
 * has a flag), borrowed. */
typedef gboolean (*SessionPicture)(int view, int light, const float *const planes[4], gpointer data,
                                   GError **error);

/* Calls func for each light of a view, in order. Reads the whole file if that takes at most 512
 * MiB, otherwise picture by picture. The error is DATA_ERROR_INVALID if the lights or the size
 * differ between the view and the first view. */
gboolean session_view_files_read(const struct session_view_files *files, int view,
                                 SessionPicture func, gpointer data, GError **error);
