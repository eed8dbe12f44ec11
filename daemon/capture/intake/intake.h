/*
 * Processes accepted frames: dark level, merging of brackets, laser sweeps, files. Each camera has
 * a worker thread that takes its frames in order, and a second thread that finishes its sweeps. All
 * functions belong to the main loop's thread.
 *
 * Processing reads the files that this module writes. session_frame_path() gives their names. Every
 * part of a file has these attributes:
 *   mesorig.camera (string)
 *   mesorig.shot (int)
 *   mesorig.turntable_deg, mesorig.arc_deg (double): as commanded. If the picture was taken while
 *     the turntable turned, mesorig.turntable_deg is its angle in the middle of the exposure, and
 *     mesorig.turning_deg_s is its speed.
 *   mesorig.arm_deg, mesorig.probe_deg (double): if the rig has a camera arm or a light probe
 *   mesorig.cfa (string): cfa_name()
 *   mesorig.exposures_us (string): "500;2000;8000". The first is shorter than planned if too many
 *     pixels were saturated.
 *   mesorig.dark_dn (double): mean dark level at the longest exposure
 *   mesorig.saturated (int): number of pixels that are saturated in every exposure
 *   mesorig.unit (string)
 *
 * SHOT_LAMP has one part "radiance" with the channel "Y" (half): the mosaic as it lies on the
 * sensor. mesorig.unit is "DN/ms" (radiance.h). mesorig.lamp (string) names the lamp. If
 * mesorig.saturated is not 0, the channel "saturated" is 1 in these pixels, whose values are too
 * low. For a bracket, mesorig.shorter_from (double, DN/ms) is the value from which pixels are
 * saturated in the longest exposure.
 *
 * SHOT_DARK has a part "dark_500_us" for each exposure, with the channel "Y" (float). mesorig.unit
 * is "DN".
 *
 * SHOT_SWEEP has one part "sweep" with the channels "intensity", "peak", "second_intensity",
 * "second_peak" and "width" (float), as in frames/sweep.h. mesorig.unit is "DN". mesorig.laser
 * (string) names the laser. Step k of the sweep is taken at the angle from + (to − from)·k/(steps
 * − 1), which the attributes sweep.from_deg, sweep.to_deg (double) and sweep.steps (int) give. With
 * laser_short_us, two frames are taken at each step, the one with the short exposure first
 * (sweep_set_shorter()).
 *
 * With keep_laser_frames, each frame of a sweep is also kept as a raw frame, in the file
 * laser/SHOT_CAMERA/0000.exr or, with the short exposure, 0000_short.exr. The number is the step.
 * The file has a part "frame" with the channel "Y" in raw DN: float, or half for at most 11 bits.
 * With keep_exposures, each frame of the other shots is kept in the same way; the number is then
 * the index of the frame in the shot. Raw frames also have the attributes mesorig.exposure_us
 * (double) and mesorig.bits (int).
 *
 * The time when a frame was taken is stored only in the database of the session. The files of a
 * shot that is taken again are therefore equal, byte for byte, to those of an undisturbed shot.
 */
#pragma once

#include "calibration/calibration.h"
#include "plan/shot_frames.h"
#include "rig/devices.h"
#include "taken_frame.h"

typedef struct Intake Intake;

struct intake_setup {
    struct devices *devices;
    const struct session_conf *conf;
    const char *directory; /* of the session */
    /* Number of bytes of waiting frames and sweeps from which the intake is full. 0 means 512
     * MiB. */
    gsize full_bytes;
    /* Calibration with the fiducials and the linearity of the sensors. If it is NULL, fiducials are
     * not searched for, and sensors count as linear. */
    const struct calibration *calibration;
};

/* The result of a camera for a shot. If `error`, `uneven` or laser_seen is set, no file was
 * written. */
struct intake_result {
    const struct session_shot *shot;
    /* The row of the frame. path, sha256 and bytes are set if the file was written. */
    struct session_frame frame;
    GError *error;
    double signal_dn; /* for SHOT_LAMP: mean of the longest exposure above dark, in DN */
    /* For SHOT_DARK: mean dark level in DN of the exposure for which it is highest. */
    double dark_dn;
    /* for SHOT_LAMP: marks that this camera saw, as struct fiducial_seen, or NULL */
    const GArray *marks;
    /* for SHOT_LAMP: the exposures contradict each other, and nothing was written */
    gboolean uneven;
    gint64 saturated; /* for SHOT_LAMP: number of pixels that are saturated in every exposure */
    /* for SHOT_SWEEP: the frame after the laser was switched off still shows the laser */
    gboolean laser_seen;
};

struct intake_hooks {
    void (*result)(const struct intake_result *result, gpointer data); /* valid during the call */
    void (*room)(gpointer data); /* called when the intake was full and can take frames again */
    gpointer data;
};

/* Makes an intake. Everything in setup is borrowed, and so are the shots of frames that are given
 * later. */
Intake *intake_new(const struct intake_setup *setup, const struct intake_hooks *hooks);

/* Drops the shots under way and waits for the workers. NULL is ignored. */
void intake_free(Intake *intake);
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Intake, intake_free)

/* Takes the next frame of a camera. The frames of a shot come in the order of their `sub`.
 * taken->row.captured_s must be set. The intake takes a reference of the frame. */
void intake_take(Intake *intake, const struct taken_frame *taken);

/* Returns whether too many frames wait for the workers. If so, no camera may be triggered until the
 * hook `room` is called. A virtual clock stands meanwhile, because writing takes no simulated
 * time. */
gboolean intake_is_full(const Intake *intake);

/* Forgets all shots whose results have not been returned, and drops their results. */
void intake_discard(Intake *intake);

/* Reads a camera's dark levels from the file of an earlier dark shot. Call it before the first
 * frame. Returns FALSE with an error if the file cannot be read. */
gboolean intake_load_dark(Intake *intake, const struct session_shot *shot, int camera,
                          GError **error);
