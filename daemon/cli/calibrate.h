/*
 * What the subcommands of `mesorig calibrate` share. Each has a file of its own,
 * mesorig_calibrate_NAME.c, and a row in the table in mesorig_calibrate.c.
 *
 * They read captured sessions and hand plain pictures to calib/, which knows no sessions.
 */
#pragma once

#include "calibration/calibration.h"
#include "cli.h"
#include "pictures/picture.h"
#include "session/session.h"

/* Their names are "calibrate NAME", so that cli_parse() and cli_usage() speak of that. */
extern const struct command calibrate_cameras, calibrate_lights, calibrate_laser,
    calibrate_radiometry, calibrate_colour, calibrate_show, calibrate_report;

/* The calibration to improve on: that of a file if there is one (path may be NULL or not exist
 * yet), else that of the session. It is refused if it is not of the session's rig. */
struct calibration *calibrate_begin(const char *path, Session *session, GError **error);

/* A frame that the session holds; its pixels are read when they are needed. */
struct calibrate_frame {
    char *path;   /* of the file */
    char *sha256; /* as the session has it */
    enum session_shot_kind kind;
    int camera, lamp; /* of the calibration; lamp −1: dark, or a sweep */
    int laser;        /* of the calibration; −1: no sweep */
    double turntable_deg, arc_deg;
};
void calibrate_frame_free(struct calibrate_frame *frame); /* NULL is ignored */

/* Frames of one kind in planned order, with a free function. */
GPtrArray *calibrate_frames(Session *session, enum session_shot_kind kind, GError **error);

/* Whether its file is the one that was captured. */
gboolean calibrate_check_sum(const struct calibrate_frame *frame, GError **error);

/* Lamp frames only: the mosaic in DN a millisecond, above dark, its colours as they are. ret_cfa
 * (may be NULL): "rggb" …; g_free(). The checksum of the file is compared. */
struct picture *calibrate_read(const struct calibrate_frame *frame, char **ret_cfa, GError **error);
