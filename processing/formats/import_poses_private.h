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

/* Properties of a camera's first picture. */
struct import_camera {
    gboolean seen, doubled; /* doubled: its pictures are in colour */
    int width, height;      /* of pictures */
};

struct import_set {
    const struct import_poses *wish;
    const char *table;
    GArray *rows; /* of struct import_row, in order of shot, camera, sweep_deg */
    struct calibration *known;
    struct import_camera cameras[RIG_MAX_CAMERAS];
    GArray *views, *lights, *lasers; /* of struct session_direction */
    GArray *shots;                   /* of struct session_shot */
    Session *session;
    struct import_poses_result *ret;
};

/* Reads the first picture of each camera and adapts the calibration to it. */
gboolean import_frames_prepare(struct import_set *set, GError **error);

/* Determines range and steps of each sweep for the plan. */
gboolean import_frames_plan(struct import_set *set, GError **error);

/* Writes files and rows of all shots; stage "import". */
gboolean import_frames_write(struct import_set *set, const struct work *work, GError **error);
