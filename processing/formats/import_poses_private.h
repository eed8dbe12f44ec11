/* import_poses.c, import_coding.c and import_frames.c share the rows of the table and the data that
 * are made from the rows. */
#pragma once

#include "base/text_table.h"
#include "calibration/calibration.h"
#include "import_poses.h"
#include "import_private.h"

/* How the numbers in the file of a picture are converted to light. */
struct import_coding {
    double black_level; /* the number that a pixel has without light */
    int bits;           /* white is 2^bits − 1; 0 means all bits of the file */
    /* tone curve; PICTURE_TONES_UNSAID: the curve that the file states */
    enum picture_tones transfer;
    char *flat_path; /* a picture of an even surface by the same camera, or NULL */
    char *dark_path; /* a picture without light by the same camera, or NULL */
};

struct import_row {
    const char *name; /* as in the table; owned by the table */
    char *path;
    int line;
    int camera;
    int device; /* index of the lamp or laser in the calibration */
    gboolean sweep;
    double turntable_deg, arc_deg, exposure_ms, sweep_deg;
    struct import_coding coding;
    int view, shot; /* indices in the lists of struct import_set */
};

struct import_set {
    const struct import_poses *wish;
    const char *table;
    GArray *rows; /* of struct import_row, sorted by shot, camera, sweep_deg */
    struct calibration *known;
    GArray *views, *lights, *lasers; /* of struct session_direction */
    const struct import_row **first; /* for each view, the first row with a picture for the BTF */
    /* for each view, whether the picture of `first` is in colour */
    gboolean *in_colour;
    GArray *shots; /* of struct session_shot */
    /* flat fields, used by import_coding.c: key → struct import_picture of factors */
    GHashTable *flats;
    GHashTable *darks; /* dark frames, used by import_coding.c: path → struct dark */
    struct import_look *look;
    Session *session;
    struct import_poses_result *ret;
};

/* Reads the columns black_level, dark_frame, bits, transfer and flat_field of a row. folder is the
 * folder of the table. */
gboolean import_coding_read(const struct import_set *set, const TextTable *table, int index,
                            const char *folder, struct import_row *row, GError **error);

void import_coding_free_dark(gpointer dark); /* frees a value of struct import_set.darks */

/* Reads a row's picture: linear, with white at 1, not yet divided by its flat field. Fails if the
 * picture cannot be read, or if its numbers do not fit `bits`. Fails too if the picture has another
 * size than its camera, another colour filter than the given one, or another format than its dark
 * frame. */
struct import_picture *import_coding_picture(const struct import_set *set,
                                             const struct import_row *row, GError **error);

/* Multiplies a row's picture by the factors of its flat field, if it has one. Pixels that are dark
 * in the flat field become NaN. */
gboolean import_coding_flatten(const struct import_set *set, const struct import_row *row,
                               struct import_picture *picture, GError **error);

/* Reads the first picture of each view and of each camera's sweeps. A picture of the wrong size is
 * then found before anything is written. */
gboolean import_frames_prepare(struct import_set *set, GError **error);

/* Sets the range and the steps of each sweep in set->shots, from which the plan is made. */
gboolean import_frames_plan(struct import_set *set, GError **error);

/* Writes the frames of all shots, and records them in the session. The progress stage is
 * "import". */
gboolean import_frames_write(struct import_set *set, const struct work *work, GError **error);
