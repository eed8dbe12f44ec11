/* Shared by the sources of import_poses.h. */
#pragma once

#include "base/text_table.h"
#include "calibration/calibration.h"
#include "import_poses.h"
#include "import_private.h"

#define IMPORT_WHITE_DN 4095

struct import_row {
    const char *name; /* as in the table */
    char *path;
    int line;
    int camera;
    int device; /* lamp or laser */
    gboolean sweep;
    double turntable_deg, arc_deg, exposure_ms, sweep_deg;
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
    Session *session;
    struct import_poses_result *ret;
};

/* Reads the first picture of each view and of each camera's sweeps, so that a picture of the wrong
 * size is found before any is written. */
gboolean import_frames_prepare(struct import_set *set, GError **error);

/* Determines range and steps of each sweep for the plan. */
gboolean import_frames_plan(struct import_set *set, GError **error);

/* Writes files and rows of all shots; stage "import". */
gboolean import_frames_write(struct import_set *set, const struct work *work, GError **error);
