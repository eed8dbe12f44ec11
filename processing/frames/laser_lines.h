/*
 * The laser's line on the flat face around the sample (the reference region of Wang et al. 2005
 * §3.2), and the plane of light of each frame that follows from it.
 *
 * The paper searches each frame for the line. Here the frames no longer exist, and only the time of
 * each pixel's peak is known. The candidates of frame k are the pixels of the region whose peak
 * time rounds to k. A robust fit in sweep angle gives the deviation of the sheet from the
 * calibration, and the roll of the sheet about the beam. The plane is the mean of lines and
 * calibration, weighted by their inverse variances. If lines and calibration differ significantly,
 * only the lines are used, because they were seen in this very sweep. Any thread, one at a time.
 */
#pragma once

#include "geometry/rig.h"

/* A flat, level face around the sample, fixed to the turntable; sample frame. */
struct laser_reference {
    /* height of the face above the turntable, and the standard error of this height */
    double plane_mm, plane_error_mm;
    double hole_mm[2]; /* size in x and y of the box about the origin that holds the sample */
    /* height of the top of the box above the turntable; points that the box hides are not used */
    double top_mm;
    double radius_mm; /* radius at which the face ends; 0 if there is no face */
};

/* Convert a reference without its top_mm to and from a line of text, which is stored as the
 * session's value LASER_REFERENCE_KEY. Free the text with g_free(). laser_reference_from_text()
 * sets top_mm to 0. It returns FALSE if the text is NULL, or is not five numbers of at least 0 with
 * “;” between them. */
#define LASER_REFERENCE_KEY "reference_region"
char *laser_reference_to_text(const struct laser_reference *reference);
gboolean laser_reference_from_text(const char *text, struct laser_reference *ret);

/* The pixels of one view that show the face. Pixels behind the sample or on a fiducial are left
 * out. There are no pixels if the reference has no face. */
typedef struct LaserRegion LaserRegion;
LaserRegion *laser_region_new(const struct rig *rig, const struct rig_camera *camera,
                              double turntable_rad, const struct laser_reference *reference);
void laser_region_free(LaserRegion *region); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(LaserRegion, laser_region_free)
int laser_region_pixels(const LaserRegion *region);
/* Returns the index in the picture of the region's pixel i. ret_at_mm (may be NULL) is the point
 * where the pixel's ray meets the face, in the rig frame. */
guint32 laser_region_pixel(const LaserRegion *region, int i, struct vec3 *ret_at_mm);

/* Standard errors of a laser's calibration, for the zero of the sweep and for the roll. */
struct laser_known {
    double turn_rad, roll_rad;
};

/* A sweep from sweep_finish(), in camera pixels. Frame k has the sweep angle from_rad +
 * k·step_rad. */
struct laser_sweep {
    const struct rig_laser *laser;
    double arc_rad;
    double from_rad, step_rad;
    const float *peak, *width, *intensity;       /* maps of the first pulse (sweep.h) */
    const struct rig_arc *arc;                   /* NULL means an ideal arc (rig.h) */
    const float *second_peak, *second_intensity; /* maps of the second pulse; both may be NULL */
    const struct laser_lines *lines;             /* NULL: only the calibration is used */
    /* standard errors of the sheet's calibration; NULL if the sheet is known exactly */
    const struct rig_sheet_errors *errors;
    /* standard deviation of the line's profile on plates, as a sweep angle; 0 if unknown */
    double line_rad;
};

struct laser_lines {
    int n_frames;
    float *turn_rad; /* of each frame: correction of the sweep's angle; NULL if no line was found */
    double roll_rad; /* roll of the sheets of all frames about the beam, left-handed */
    /* unit vector from the source towards the origin, perpendicular to the sweep's axis */
    struct vec3 beam;
    struct vec3 source_mm;
    /* Measured from the lines only, without the calibration: */
    int pixels, frames; /* number of pixels on lines, and number of frames with a line */
    /* mean over the frames of the measured minus the commanded sheet angle, and its standard
     * error */
    double offset_rad, offset_error_rad;
    /* roll of the sheets about the beam, and the standard error of this roll */
    double roll_seen_rad, roll_error_rad;
    double scatter_mm; /* RMS distance of pixels from their line, across the sheet */
    int frames_off;    /* number of frames whose level contradicts the calibration */
    /* whether the calibration is contradicted by the offset, by the roll, or by more than a quarter
     * of the frames */
    gboolean disagrees;
};

/* Finds the lines of a sweep with n_frames frames. turn_rad is NULL in three cases: too few pixels
 * of the whole sweep saw the line, too few pixels of each single frame did, or no roll can be
 * fitted. Free the result with laser_lines_clear(). */
void laser_lines_find(const LaserRegion *region, const struct laser_sweep *sweep, int n_frames,
                      const struct laser_known *known, struct laser_lines *ret);
void laser_lines_clear(struct laser_lines *lines);

/* The bent sheets of light of a sweep, prepared for computations of many points. The sheets follow
 * from the calibration and from sweep->lines. sweep, sweep->laser and sweep->lines are not
 * copied. */
struct laser_sheets {
    const struct laser_sweep *sweep;
    struct rig_laser_pose pose;
    struct rig_rotation roll;
};
struct laser_sheets laser_lines_sheets(const struct laser_sweep *sweep);

/* Returns the distance from eye_mm along a ray (a unit vector) to the sheet of light at a
 * fractional frame index. Returns NAN if the sine of the angle between ray and sheet is at most
 * least_sine. */
double laser_lines_range_mm(const struct laser_sheets *sheets, double frame, struct vec3 eye_mm,
                            struct vec3 ray, double least_sine);
