/*
 * Imports a folder of pictures with a table that contains the pose and light of each picture, and a
 * calibration file or nominal values (nominal.h). The result is a session like a captured one;
 * “mesorig process” makes its BTF and MDF.
 *
 * The table (text_table.h) has a row for each picture:
 *   file            path from the table's folder; JPEG, PNG, TIFF, EXR or camera raw
 *   camera          a camera of the calibration
 *   lamp, or laser  a lamp or a laser of the calibration; a picture with a lamp is for the BTF, a
 *                   picture with a laser is part of a sweep
 *   turntable_deg   0 if empty
 *   arc_deg         angle of the arc that carries lamps and lasers; 0 if empty
 *   exposure_ms     1 if empty
 *   sweep_deg       for sweeps: the angle of the laser, in even steps
 *   black_level     the number that a pixel has without light; 0 if empty
 *   dark_frame      a picture without light of the same exposure and coding; its numbers are
 *                   subtracted pixel by pixel instead of black_level
 *   bits            white is 2^bits − 1; if empty, all bits of the file
 *   transfer        linear or srgb; if empty, the file decides (PNG, ICC profile, EXIF), and
 *                   otherwise files of 8 bits are srgb and others are linear
 *   flat_field      a picture of an even surface with the same coding; the pictures for the BTF
 *                   are divided by it, relative to its middle
 *
 * White (1) of a picture becomes 4095 DN, the scale of the calibration's responses. Grey pictures
 * are from a grey camera, or are mosaics if a colour filter is named. Colour pictures keep all
 * three channels (colour filter "rgb" of rectify.h). The pictures of one view for the BTF must all
 * be grey or all be in colour. The pictures of a sweep may be grey or in colour. Saturated pixels
 * become lower bounds.
 *
 * Every view of the BTF needs pictures under at least nine lights in ten; “mesorig process”
 * predicts the pictures under the other lights. Pictures of a calibration target may lack any
 * light. A light is a lamp at an angle of the arc relative to the sample. If lamps stand still and
 * the sample turns, same_light_deg joins lamps that have the same direction from the sample. The
 * joined lamps are one light, with the direction of the lamp that comes first in the plan. The
 * files of the BTF contain, for each picture, the direction of its own lamp. In a sweep one picture
 * in ten may be missing, but never two in a row. Pixels whose peak would be next to a missing
 * picture count as not seen. Pixels that are not numbers or are masked (transparent) are holes. Any
 * thread.
 */
#pragma once

#include "import.h"
#include "pictures/picture_says.h"

enum import_edge {
    IMPORT_LINE, /* a bright line moves over the sample */
    /* The edge of a shadow moves over the sample, which becomes darker or lighter. The calibration
     * describes the sheet of this edge as a laser. */
    IMPORT_DARKENS,
    IMPORT_LIGHTENS,
};

struct import_poses {
    const char *table, *calibration; /* paths */
    const char *cfa;                 /* colour filter of grey pictures: "mono", "rggb" … */
    struct session_grid grid;
    enum import_edge edge;
    double threshold_dn; /* minimum height of a peak */
    /* lamps whose directions from the sample differ by at most this angle are joined to one light;
     * 0 joins no lamps */
    double same_light_deg;
    /* tone curve for rows without `transfer`; PICTURE_TONES_UNSAID means the tone curve that each
     * file states */
    enum picture_tones transfer;
    GPtrArray *notes; /* NULL, or receives sentences for the user, g_free() */
    gboolean target;  /* pictures of a calibration target, whose views need not have all lights */
};

struct import_poses_result {
    int n_views, n_lights, n_lasers, n_shots, n_frames;
    int n_missing;      /* number of missing pictures of sweeps and lamps together */
    gint64 not_numbers; /* number of pixels that are not numbers */
};

/* Imports the pictures as a new session at path, which must not exist. *ret is set even after an
 * error. The progress stage is "import". */
gboolean import_poses(const char *path, const struct import_poses *poses, const struct work *work,
                      struct import_poses_result *ret, GError **error);
