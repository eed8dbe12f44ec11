/*
 * Processes accepted frames: dark level, bracket merge, laser sweep, file. Each camera has a worker
 * thread that takes its frames in order, and a second one that finishes its sweeps; everything else
 * here belongs to the main loop's thread.
 *
 * The files, and with them the contract with processing. Every part has these attributes
 * (session_frame_path() gives the names):
 *   mesorig.camera (string), mesorig.shot (int), mesorig.turntable_deg, mesorig.arc_deg (double, as
 *   commanded; of a picture that was taken while the turntable turned, mesorig.turntable_deg is
 * where it was in the middle of the exposure, and mesorig.turning_deg_s its speed; with a camera
 * arm or a light probe mesorig.arm_deg, mesorig.probe_deg as well), mesorig.cfa (string,
 * cfa_name()), mesorig.exposures_us (string, "500;2000;8000"; the first is shorter than planned
 * where too much was saturated), mesorig.dark_dn (double, mean dark level at the longest exposure),
 * mesorig.saturated (int, pixels)
 *
 * SHOT_LAMP: one part "radiance", channel "Y", half, the mosaic as it lies on the sensor;
 * mesorig.unit = "DN/ms" (see radiance.h), mesorig.lamp (string). Where mesorig.saturated is not 0,
 * a channel "saturated" is 1 in those pixels, whose values are too low; of a bracket,
 * mesorig.shorter_from (double, DN/ms) is what pixels have for which the longest was too long.
 *
 * SHOT_DARK: a part "dark_500_us" an exposure, channel "Y", float; mesorig.unit = "DN"
 *
 * SHOT_SWEEP: one part "sweep", channels "intensity", "peak",
 * "second_intensity", "second_peak", "width", float, as in frames/sweep.h; mesorig.unit = "DN",
 * mesorig.laser (string), sweep.from_deg,
 * sweep.to_deg (double), sweep.steps (int): frame k is taken at from + (to − from)·k/(steps − 1).
 * With laser_short_us two frames are taken there, the short one first: see sweep_set_shorter().
 * With keep_laser_frames each frame is kept too, as laser/SHOT_CAMERA/0000.exr (0000_short.exr),
 * part "frame", channel "Y", raw DN, float, or half up to 11 bits. When it was taken is said by the
 * session only, so that a retaken shot's files, and what is made of them, are to the byte those of
 * an undisturbed one.
 */
#pragma once

#include "calibration/calibration.h"
#include "plan/shot_frames.h"
#include "taken_frame.h"

typedef struct Intake Intake;

struct intake_setup {
    struct devices *devices;
    const struct session_conf *conf;
    const char *directory; /* of the session */
    gsize full_bytes; /* of frames and sweeps that wait for workers, at which it is full; 0: 512 MiB
                       */
    /* Radiometry of the fiducials and linearity of the sensors. NULL: fiducials are not searched
     * for, and sensors are taken as linear. */
    const struct calibration *calibration;
};

/* One camera's part of a shot is on disk, or could not be written. */
struct intake_result {
    const struct session_shot *shot;
    /* The row of the frame. path, sha256 and bytes are set if the file was written. */
    struct session_frame frame;
    GError *error;
    double signal_dn;    /* SHOT_LAMP: mean above dark of the longest exposure */
    double dark_dn;      /* SHOT_DARK: highest mean of any exposure */
    const GArray *marks; /* SHOT_LAMP: of struct fiducial_seen, what this camera saw; or NULL */
    gboolean uneven;     /* SHOT_LAMP: the exposures disagree; nothing is written */
    gint64 saturated;    /* SHOT_LAMP: pixels, in the shortest exposure */
    gboolean laser_seen; /* SHOT_SWEEP: the frame after the laser was switched off is not dark */
};

struct intake_hooks {
    void (*result)(const struct intake_result *result, gpointer data); /* valid during the call */
    void (*room)(gpointer data); /* it was full and is no longer */
    gpointer data;
};

/* Borrows everything in setup, and the shots given later; all must live longer. */
Intake *intake_new(const struct intake_setup *setup, const struct intake_hooks *hooks);

/* Drops what is under way and waits for the workers. NULL is ignored. */
void intake_free(Intake *intake);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Intake, intake_free)

/* Takes the next frame of a camera, in order of sub. row.captured_s must be set. The intake takes a
 * reference of the frame. */
void intake_take(Intake *intake, const struct taken_frame *taken);

/* Too much waits for the workers: trigger nothing until room() is called. A virtual clock is
 * held meanwhile, since writing takes no simulated time. */
gboolean intake_is_full(const Intake *intake);

/* Forgets all shots that have not been handed back; no result of theirs comes any more. */
void intake_discard(Intake *intake);

/* Takes a camera's dark levels from the file of an earlier dark shot. Before the first frame. */
gboolean intake_load_dark(Intake *intake, const struct session_shot *shot, int camera,
                          GError **error);
