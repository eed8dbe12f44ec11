/* Writes and reads the intake's files; intake.h describes their content. Any thread. */
#pragma once

#include "frames/sweep.h"
#include "plan/plan.h"

struct intake_file {
    const char *directory; /* of the session */
    const struct session_shot *shot;
    int camera;
    const char *camera_name;
    const char *source_name; /* lamp or laser; NULL for dark */
    const struct session_conf *conf;
    const struct rig *rig; /* nominal, for the angles of arm and probe */
    const Frame *last;     /* of those that went into it */
    double turntable_deg;  /* where the table stood, or, if it turned, was in the middle of last */
    gboolean turned;
    const Frame *const *bracket; /* SHOT_LAMP: all of them */
    double dark_dn;
    gint64 saturated;    /* SHOT_LAMP: pixels, in every exposure */
    double shorter_from; /* SHOT_LAMP: DN/ms, see intake.h; 0: there is one exposure only */
};

/* These write and sync the file, and fill path, sha256 and bytes of ret_frame. */
gboolean intake_write_lamp(const struct intake_file *file, const float *radiance,
                           struct session_frame *ret_frame, GError **error);
gboolean intake_write_dark(const struct intake_file *file, const gint64 *exposures_us,
                           const float *const *pixels, int n, struct session_frame *ret_frame,
                           GError **error);
gboolean intake_write_sweep(const struct intake_file *file, const Sweep *sweep,
                            struct session_frame *ret_frame, GError **error);

/* Keeps one raw frame of a shot, not synced. */
gboolean intake_write_raw(const struct intake_file *file, int sub, GError **error);

/* The dark level of every pixel from a dark shot's file; g_free(). */
float *intake_read_dark(const char *directory, const struct session_shot *shot,
                        const char *camera_name, const struct camera_format *format,
                        gint64 exposure_us, GError **error);
