/*
 * The laser's line on what lies flat around the sample (Wang et al. 2005 §3.2: the reference
 * region), and from it the plane of light of each frame.
 *
 * The paper searches each picture for the line. Here pictures are gone by then, and each pixel has
 * the time of its own peak, by a Gaussian fitted to all it saw: the candidates of frame k are the
 * pixels of the region whose peak is next to it. A line is fitted to them robustly, in the angle of
 * the sweep that the calibration would give each: it says how much further the sheet had turned
 * than the calibration has it, and how it is rolled about the beam. Both are known to some error,
 * and the plane is the mean of the two by it. Where they differ by more than errors can, the line
 * is right: it was seen in this very sweep.
 *
 * Any thread, one at a time.
 */
#pragma once

#include "geometry/rig.h"

/* A flat, level face around the sample, fixed to the turntable; sample frame. */
struct laser_reference {
    double plane_mm, plane_error_mm; /* its height above the turntable, and standard error */
    double hole_mm[2];               /* x and y of the box about the origin that the sample is in */
    double top_mm;                   /* how high that box is: what it hides is not looked at */
    double radius_mm;                /* where the face ends; 0: there is none */
};

/* One line of text, for session_set_value(); g_free(). FALSE: it is none. top_mm is not in it. */
#define LASER_REFERENCE_KEY "reference_region"
char *laser_reference_to_text(const struct laser_reference *reference);
gboolean laser_reference_from_text(const char *text, struct laser_reference *ret);

/* The pixels of one view that show it: not behind the sample, not a mark of the rig. */
typedef struct LaserRegion LaserRegion;
LaserRegion *laser_region_new(const struct rig *rig, const struct rig_camera *camera,
                              double turntable_rad, const struct laser_reference *reference);
void laser_region_free(LaserRegion *region); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LaserRegion, laser_region_free)
int laser_region_pixels(const LaserRegion *region);

/* How well the calibration knows a laser: standard errors of the sweep's zero, and of the roll. */
struct laser_known {
    double turn_rad, roll_rad;
};

/* A sweep as sweep_finish() left it, in the camera's pixels; frame k was taken at sweep angle
 * from + k·step. */
struct laser_sweep {
    const struct rig_laser *laser;
    double arc_rad;
    double from_rad, step_rad;
    const float *peak, *width, *intensity;
    const struct rig_arc *arc;                   /* NULL: an ideal one */
    const float *second_peak, *second_intensity; /* of the second pulse; both may be NULL */
    const struct laser_lines *lines;             /* NULL: planes by the calibration alone */
};

struct laser_lines {
    int n_frames;
    float *turn_rad;  /* of each frame, added to the sweep's angle; NULL: no line was found */
    double roll_rad;  /* of all frames' sheets, about the beam: left-handed */
    struct vec3 beam; /* unit, from the source */
    struct vec3 source_mm;
    /* What the lines alone say. */
    int pixels, frames;                  /* on lines, frames with one */
    double offset_rad, offset_error_rad; /* of the sweep as a whole, against the calibration */
    double roll_seen_rad, roll_error_rad;
    double scatter_mm;  /* of pixels from their lines, across the sheet */
    int frames_off;     /* that contradict the calibration, and those around them too */
    gboolean disagrees; /* with the calibration: offset, roll or a quarter of the frames */
};

/* n_frames: of the sweep. Without enough pixels that saw the line turn_rad is NULL. */
void laser_lines_find(const LaserRegion *region, const struct laser_sweep *sweep, int n_frames,
                      const struct laser_known *known, struct laser_lines *ret);
void laser_lines_clear(struct laser_lines *lines);

/* The sheet at a time between frames, by calibration and lines. */
struct rig_plane laser_lines_sheet(const struct laser_lines *lines, const struct laser_sweep *sweep,
                                   double frame);
