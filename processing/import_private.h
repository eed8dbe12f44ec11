/* What the sources of import.h share. */
#pragma once

#include "import.h"

#define IMPORT_MOST_HOLES 0.5 /* of a picture */

/* Always FALSE, "FILE: …" or "FILE:LINE: …" (line from 1; 0: none). */
void import_report(const char *file, int line, GError **error, const char *format, ...)
    G_GNUC_PRINTF(4, 5);
#define import_fail(...) (import_report(__VA_ARGS__), FALSE)

/* A picture in colour. EXR: R, G, B of the first part, or a grey "Y" as all three; else what OpenCV
 * reads. NULL: IMPORT_ERROR_DATA. */
struct import_picture {
    int width, height;
    gboolean grey;
    float *rgb; /* height × width × 3 */
};
struct import_picture *import_picture_read(const char *path, GError **error);
void import_picture_free(struct import_picture *picture); /* NULL is ignored */
gboolean import_is_picture(const char *name);

/* A new session under a hidden name, for the time of filling it. */
struct import_place {
    char *path, *folder, *session;
};
gboolean import_place_begin(struct import_place *place, const char *path, GError **error);
/* Closes it, and moves it to its name; or removes it. */
gboolean import_place_end(struct import_place *place, Session *session, gboolean good,
                          GError **error);

/* Tells how far it is; FALSE: it was cancelled. */
gboolean import_tell(const struct import_progress *progress, const char *stage, int done, int total,
                     gint64 begun_us, GError **error);
