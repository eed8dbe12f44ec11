/* The files import*.c share the reading of pictures and of lists of lights, the checks of pictures,
 * and the creation of a session. */
#pragma once

#include "base/vec.h"
#include "import.h"
#include "pictures/picture_says.h"

/* White of an imported picture in DN. The responses in nominal.h refer to this scale. */
#define IMPORT_WHITE_DN 4095

/* maximum share of pixels without a number among the pixels that are not masked */
#define IMPORT_MAX_HOLES  0.5
#define IMPORT_MAX_MASKED 0.98 /* maximum share of masked pixels among all pixels */
#define IMPORT_NO_TEXT    "# none: imported\n"

typedef struct import_picture {
    int width, height;
    gboolean grey;
    /* colour filter of a mosaic whose file states it, for instance "rggb"; otherwise "" */
    char cfa[5];
    /* the region of the picture that rgb contains: the requested part, or the whole picture */
    struct import_region part;
    float *rgb;        /* height × width × 3 of the part; NaN means unknown */
    gsize transparent; /* number of pixels that are NaN because they are masked */
    /* number of bits of each number in the file, 8 or 16; 0 means floating-point */
    int bits;
    struct picture_tone tone; /* the tone curve that the file states */
    int left_px, top_px;      /* upper left corner of an EXR's display window; otherwise 0 */
} ImportPicture;

/* Reads a colour picture as linear light. An EXR has R, G and B in its first part, or in its only
 * layer with these channels, or a grey "Y" for all three. Camera raw has one pixel for each 2 × 2
 * of the mosaic, with the mean of the two green pixels. Numbers are converted with the tone curve
 * `wanted`, or else with the tone curve of the file (picture_tone_choose()). Pixels outside an
 * EXR's data window are NaN. The error is DATA_ERROR_INVALID. */
struct import_picture *import_picture_read(const char *path, enum picture_tones wanted,
                                           GError **error);
/* Reads a part of a picture as import_picture_read() does; NULL means the whole picture. If
 * picture_part_can() allows it, only the part is decoded, and the picture may be too large to be
 * read as a whole. Otherwise the whole picture is read. The member `part` of the result says what
 * was read. The requested part must lie within the picture. */
struct import_picture *import_picture_read_part(const char *path, const struct import_region *part,
                                                enum picture_tones wanted, GError **error);
/* Reads the numbers in the file, without a conversion to linear light. Camera raw becomes a grey
 * mosaic of floating-point numbers, with 0 at its black level and 1 at its white level. */
struct import_picture *import_picture_read_codes(const char *path, GError **error);
/* Two pictures must show the same part of the scene. Returns FALSE with an error if they differ in
 * size or in the position of their display windows. In the message, `list` and `line` say where the
 * second picture is named, and `name` is its name. If `line` is 0, the message has no line. */
gboolean import_picture_check_same(const struct import_picture *first,
                                   const struct import_picture *second, const char *list, int line,
                                   const char *name, GError **error);
/* Returns FALSE if more than half of the pixels that are not masked are not numbers, or if nearly
 * all pixels are masked. n_bad of the n_pixels pixels are NaN. The message begins with `list`
 * and `line`, and contains `name`. If `name` is NULL, `list` is the path of the picture. */
gboolean import_picture_check_holes(const struct import_picture *picture, gsize n_bad,
                                    gsize n_pixels, const char *list, int line, const char *name,
                                    GError **error);
void import_picture_free(struct import_picture *picture); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(ImportPicture, import_picture_free)
/* Returns whether a file name ends like that of a JPEG, PNG, TIFF, EXR or camera raw. */
gboolean import_is_picture(const char *name);

/* Makes the state in which import_look.c examines the pictures of a set while they are imported.
 * view is the index of the view whose values are fitted. */
struct import_look *import_look_new(enum picture_tones transfer, int n_views, int n_lights,
                                    const float *theta_deg, const float *phi_deg, int view);
void import_look_free(struct import_look *look); /* NULL is ignored */
/* Counts the tone curve that was used for a picture. */
void import_look_count(struct import_look *look, const struct import_picture *picture);
/* Adds a picture of n texels, linear with white at 1. rgb are its three planes, in which
 * consecutive texels are `step` floats apart. NaN means unknown. gain is the light's irradiance, in
 * any unit. */
void import_look_add(struct import_look *look, int view, int light, const float *const rgb[3],
                     gsize step, gsize n, double gain);
/* Adds sentences to notes, if notes is not NULL. Sentences about mistakes are also stored in the
 * session (session_suspect()). */
gboolean import_look_tell(const struct import_look *look, Session *session, GPtrArray *notes,
                          GError **error);

/* A line of a list of lights. */
struct import_light {
    char *name; /* name of the picture as in the list; NULL if no line has a name */
    double theta_deg, phi_deg;
    /* whether the light is too low to light the sample, so that the picture is left out */
    gboolean on_horizon;
    /* Whether position_mm and exponent are known. position_mm is the position of the lamp, from the
     * middle of the imported texels. The lamp aims at this middle. exponent is the n of cos^n, by
     * which the lamp's light falls with the angle from its aim. */
    gboolean placed;
    struct vec3 position_mm;
    double exponent;
    int line;
};
/* Reads a list as import_rti() does. Returns an array of struct import_light, with at least one. */
GArray *import_lights_read(const char *path, GError **error);

/* A new session, which is in a hidden folder until it is filled. */
struct import_place {
    /* path: where the session appears at the end
     * folder: the hidden folder next to path
     * session: the session in the hidden folder */
    char *path, *folder, *session;
    char *name; /* name of the session */
};
gboolean import_place_begin(struct import_place *place, const char *path, GError **error);
/* Closes the session. If good is FALSE, removes the session. If good is TRUE, moves it to its final
 * path. A session that cannot be moved stays in the hidden folder. Returns whether the session is
 * at its final path. */
gboolean import_place_end(struct import_place *place, Session *session, gboolean good,
                          GError **error);
