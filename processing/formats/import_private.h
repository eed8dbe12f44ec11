/* Shared by the sources of import.h. */
#pragma once

#include "import.h"

#define IMPORT_MOST_HOLES 0.5 /* of a picture */
#define IMPORT_NO_TEXT    "# none: imported\n"

/* Reads a colour picture. EXR: R, G, B of the first part, or a grey "Y" for all three; camera raw:
 * a pixel for each 2 × 2 of the mosaic, with the mean of its two green ones; else what OpenCV
 * reads. NULL: DATA_ERROR_INVALID. */
typedef struct import_picture {
    int width, height;
    gboolean grey;
    char cfa[5]; /* of a mosaic that says it itself, "rggb"; else "" */
    float *rgb;  /* height × width × 3 */
} ImportPicture;
struct import_picture *import_picture_read(const char *path, GError **error);
/* The same with the numbers in the file; ret_bits: 8 or 16 of each, 0: floating-point. Camera raw
 * is a grey mosaic of floating-point numbers, 0 its black level and 1 its white. */
struct import_picture *import_picture_read_codes(const char *path, int *ret_bits, GError **error);
void import_picture_free(struct import_picture *picture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ImportPicture, import_picture_free)
gboolean import_is_picture(const char *name);

/* A line of a list of lights. */
struct import_light {
    char *name; /* of the picture, without a folder; NULL: no line has one */
    double theta_deg, phi_deg;
    int line;
};
/* Reads a list as import_rti() does. Returns an array of struct import_light, with at least one. */
GArray *import_lights_read(const char *path, GError **error);

/* A new session, which has a hidden name until it is filled. */
struct import_place {
    char *path, *folder, *session;
    char *name; /* of the session */
};
gboolean import_place_begin(struct import_place *place, const char *path, GError **error);
/* Closes the session and renames it, or removes it. */
gboolean import_place_end(struct import_place *place, Session *session, gboolean good,
                          GError **error);
