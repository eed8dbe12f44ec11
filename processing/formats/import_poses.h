/*
 * A folder of pictures with a table that says from where each was taken and how it was lit, and a
 * calibration file or nominal values (nominal.h), made into a session as a capture would have left
 * it; “mesorig process” makes BTF and MDF of it.
 *
 * The table (text_table.h) has a row per picture:
 *   file            next to the table, or in a folder below; JPEG, PNG, TIFF or EXR
 *   camera          a camera of the calibration
 *   lamp, or laser  one of the calibration's: a picture for the BTF, or one of a sweep
 *   turntable_deg   0 if it says nothing
 *   arc_deg         0 likewise: of the arc that lamps and lasers stand on
 *   exposure_ms     1 likewise
 *   sweep_deg       of sweeps, how far the laser has turned; evenly spaced
 *   black_level     what a pixel shows without light, a number of the file; 0 if it says nothing
 *   bits            of a number: white is 2^bits − 1; all that the file has
 *   transfer        linear or srgb; if it says nothing, what the file says (PNG, ICC profile,
 *                   EXIF), else srgb of files of 8 bits, and linear of others
 *   flat_field      a picture of an even surface, coded likewise, which those for the BTF are
 *                   divided by; it is 1 around its middle
 *
 * A picture's white (1) is 4095 DN, which the calibration's responses are for. Grey pictures are of
 * a grey camera, or mosaics if a colour filter is named. Of a picture in colour all three channels
 * are kept (colour filter "rgb" of rectify.h). Of one view all pictures for the BTF are grey, or
 * all are in colour; those of its sweeps may be either. Saturated pixels become lower bounds.
 *
 * Every light must be there for every view of the BTF, but for one in ten, which “mesorig process”
 * predicts; pictures of a calibration target may lack any. A light is a lamp at an angle of the arc
 * against the sample; where lamps stand still and the sample turns, same_light_deg makes those one
 * light that lie in one direction of the sample. It then has the direction of the first of them in
 * the plan, and the BTF's files say where each lamp was. In a sweep one picture in ten may be
 * missing, never two in a row: pixels whose peak would lie next to it are not seen. Pixels that are
 * no numbers, or masked (transparent), are holes. Any thread.
 */
#pragma once

#include "import.h"
#include "pictures/picture_says.h"

enum import_edge {
    IMPORT_LINE,    /* a bright line moves over the sample */
    IMPORT_DARKENS, /* a shadow's edge is the sheet that the calibration describes as a laser */
    IMPORT_LIGHTENS,
};

struct import_poses {
    const char *table, *calibration; /* paths */
    const char *cfa;                 /* of grey pictures: "mono", "rggb" … */
    struct session_grid grid;
    enum import_edge edge;
    double threshold_dn;   /* least height of a peak */
    double same_light_deg; /* lamps whose directions differ by no more are one light; 0: none */
    enum picture_tones transfer; /* of rows that say none; PICTURE_TONES_UNSAID: as the files say */
    GPtrArray *notes;            /* NULL, or where sentences for the user are added, g_free() */
    gboolean target; /* pictures of a calibration target: views need not have all lights */
};

struct import_poses_result {
    int n_views, n_lights, n_lasers, n_shots, n_frames;
    int n_missing;      /* missing pictures, of sweeps and under lamps */
    gint64 not_numbers; /* number of pixels */
};

gboolean import_poses(const char *path, const struct import_poses *poses, const struct work *work,
                      struct import_poses_result *ret, GError **error);
