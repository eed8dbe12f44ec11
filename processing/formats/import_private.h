/* Shared by the sources of import.h. */
#pragma once

#include "import.h"
#include "pictures/picture_says.h"

#define IMPORT_MAX_HOLES  0.5  /* of a picture's pixels that are not masked */
#define IMPORT_MAX_MASKED 0.98 /* of all of them */
#define IMPORT_NO_TEXT    "# none: imported\n"

typedef struct import_picture {
    int width, height;
    gboolean grey;
    char cfa[5];               /* of a mosaic that says it itself, "rggb"; else "" */
    struct import_region part; /* of the picture, that rgb shows; all of it unless asked for less */
    float *rgb;                /* height × width × 3 of the part; NaN: not known */
    gsize transparent;         /* number of pixels that are NaN since they are masked */
    int bits;                  /* 8 or 16 of each number in the file; 0: floating-point */
    struct picture_tone tone;  /* what the file says of its tone curve */
    int left_px, top_px;       /* where an EXR's display window begins; else 0 */
} ImportPicture;

/* Reads a colour picture as linear light: EXR (R, G and B of the first part, or of its only layer
 * that has them, or a grey "Y" for all three); camera raw, a pixel for each 2 × 2 of the mosaic,
 * with the mean of its two green ones; else what OpenCV reads, by the tone curve wanted or that of
 * the file (picture_tone_choose()). Pixels outside of an EXR's data window are NaN. NULL:
 * DATA_ERROR_INVALID. */
struct import_picture *import_picture_read(const char *path, enum picture_tones wanted,
                                           GError **error);
/* The same of a part (NULL: all), which must lie within the picture if the picture is read before.
 * Of a PNG that is not interlaced only that part is decoded, so that the picture may be larger than
 * one that is read as a whole; of others, part is all. */
struct import_picture *import_picture_read_part(const char *path, const struct import_region *part,
                                                enum picture_tones wanted, GError **error);
/* The same with the numbers in the file. Camera raw is a grey mosaic of floating-point numbers, 0
 * its black level and 1 its white. */
struct import_picture *import_picture_read_codes(const char *path, GError **error);
/* FALSE: two pictures, which are to show the same, differ in size or in the place of their display
 * windows. name, line: for the message, of the second; line 0: none. */
gboolean import_picture_check_same(const struct import_picture *first,
                                   const struct import_picture *second, const char *list, int line,
                                   const char *name, GError **error);
/* FALSE: more than half of its pixels that are not masked are no numbers, or nearly all are masked.
 * n_bad: all that are NaN, of n_pixels. name may be NULL: list is the picture. */
gboolean import_picture_check_holes(const struct import_picture *picture, gsize n_bad,
                                    gsize n_pixels, const char *list, int line, const char *name,
                                    GError **error);
void import_picture_free(struct import_picture *picture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ImportPicture, import_picture_free)
gboolean import_is_picture(const char *name);

/* What is noticed about the pictures of a set while they are imported (import_look.c). */
struct import_look *import_look_new(enum picture_tones transfer, int n_views, int n_lights,
                                    const float *theta_deg, const float *phi_deg, int view);
void import_look_free(struct import_look *look); /* NULL is ignored */
/* Counts what was taken for a picture's tone curve. */
void import_look_count(struct import_look *look, const struct import_picture *picture);
/* Looks at a picture of n texels, step floats apart, linear with white at 1; NaN: not known. gain:
 * the light's irradiance, in any unit. */
void import_look_add(struct import_look *look, int view, int light, const float *const rgb[3],
                     gsize step, gsize n, double gain);
/* Adds sentences to notes (NULL: none), and keeps those about mistakes in the session
 * (session_suspect()). */
gboolean import_look_tell(const struct import_look *look, Session *session, GPtrArray *notes,
                          GError **error);

/* A line of a list of lights. */
struct import_light {
    char *name; /* of the picture, as in the list; NULL: no line has one */
    double theta_deg, phi_deg;
    gboolean on_horizon; /* it lights nothing, and is to be left out */
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
