/* Writes and reads the files that intake.h describes. Any thread may call the functions. */
#pragma once

#include "frames/sweep.h"
#include "plan/plan.h"

struct intake_file {
    const char *directory; /* the session directory */
    const struct session_shot *shot;
    int camera;
    const char *camera_name;
    const char *source_name; /* name of the lamp or laser; NULL for dark */
    const struct session_conf *conf;
    const struct rig *rig; /* the nominal rig, for the angles of arm and probe */
    const Frame *last;     /* the last of the frames that the file contains or was computed from */
    /* Angle of the turntable. If the turntable was turning, it is the angle in the middle of the
     * exposure of `last`. */
    double turntable_deg;
    gboolean turned; /* the turntable turned during the exposure */
    /* for SHOT_LAMP: the frames of all exposures, the shortest first */
    const Frame *const *bracket;
    double dark_dn;
    gint64 saturated; /* for SHOT_LAMP: number of pixels that are saturated in every exposure */
    /* For SHOT_LAMP: value in DN/ms from which pixels are saturated in the longest exposure. It is
     * 0 if there is only one exposure. */
    double shorter_from;
};

/* Write the file of a shot, sync it, and set path, sha256 and bytes of ret_frame. Return FALSE with
 * an error on failure. */
gboolean intake_write_lamp(const struct intake_file *file, const float *radiance,
                           struct session_frame *ret_frame, GError **error);
gboolean intake_write_dark(const struct intake_file *file, const gint64 *exposures_us,
                           const float *const *pixels, int n, struct session_frame *ret_frame,
                           GError **error);
gboolean intake_write_sweep(const struct intake_file *file, const Sweep *sweep,
                            struct session_frame *ret_frame, GError **error);

/* Writes one raw frame of a shot. The file is not synced. */
gboolean intake_write_raw(const struct intake_file *file, int sub, GError **error);

/* Reads the dark level of every pixel from the file of a dark shot. Free the result with g_free().
 * Returns NULL with an error on failure. */
float *intake_read_dark(const char *directory, const struct session_shot *shot,
                        const char *camera_name, const struct camera_format *format,
                        gint64 exposure_us, GError **error);
