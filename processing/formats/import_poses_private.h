/* Shared by the sources of import_poses.h. */
#pragma once

#include "base/text_table.h"
#include "calibration/calibration.h"
#include "import_poses.h"
#include "import_private.h"

#define IMPORT_WHITE_DN 4095

/* The names of the table's columns, ending with NULL. */
extern const char *const import_poses_columns[];

/* How a picture's numbers stand for light. */
struct import_coding {
    double black_level;          /* the number without light */
    int bits;                    /* white is 2^bits − 1; 0: as many as the file has */
    enum picture_tones transfer; /* PICTURE_TONES_UNSAID: as the file says */
    char *flat_path;             /* a picture of an even surface by the same camera; NULL: none */
};

struct import_row {
    const char *name; /* as in the table */
    char *path;
    int line;
    int camera;
    int device; /* lamp or laser */
    gboolean sweep;
    double turntable_deg, arc_deg, exposure_ms, sweep_deg;
    struct import_coding coding;
    int view, shot; /* indices */
};

struct import_set {
    const struct import_poses *wish;
    const char *table;
    GArray *rows; /* of struct import_row, in order of shot, camera, sweep_deg */
    struct calibration *known;
    GArray *views, *lights, *lasers; /* of struct session_direction */
    const struct import_row **first; /* of each view, its first picture for the BTF */
    gboolean *in_colour;             /* of each view, whether that one is in colour */
    GArray *shots;                   /* of struct session_shot */
    GHashTable *flats; /* of import_coding.c: key → struct import_picture of factors */
    struct import_look *look;
    Session *session;
    struct import_poses_result *ret;
};

/* Reads the columns black_level, bits, transfer and flat_field of a row. folder: the table's. */
gboolean import_coding_read(const struct import_set *set, const TextTable *table, int index,
                            const char *folder, struct import_row *row, GError **error);

/* Reads a row's picture: linear, with white at 1, not yet divided by its flat field. It has the
 * size of its camera's pictures. */
struct import_picture *import_coding_picture(const struct import_set *set,
                                             const struct import_row *row, GError **error);

/* Multiplies a row's picture by the factors of its flat field, if it has one: pixels that show
 * nothing in the flat field become NaN. */
gboolean import_coding_flatten(const struct import_set *set, const struct import_row *row,
                               struct import_picture *picture, GError **error);

/* Reads the first picture of each view and of each camera's sweeps, so that a picture of the wrong
 * size is found before any is written. */
gboolean import_frames_prepare(struct import_set *set, GError **error);

/* Determines range and steps of each sweep for the plan. */
gboolean import_frames_plan(struct import_set *set, GError **error);

/* Writes files and rows of all shots; stage "import". */
gboolean import_frames_write(struct import_set *set, const struct work *work, GError **error);
