/* Shared by the subcommands of `mesorig calibrate`. Each subcommand has a file calibrate_NAME.c and
 * a row in the table in calibrate.c. The subcommands read captured sessions. They pass plain
 * pictures to calib/, which does not know sessions. */
#pragma once

#include "base/work.h"
#include "calibration/calibration.h"
#include "common/cli.h"
#include "pictures/picture.h"
#include "session/session.h"

extern const struct command cli_calibrate;

/* The subcommands. Each is named "calibrate NAME", so that usage and help show the full command. */
extern const struct command calibrate_cameras, calibrate_lights, calibrate_laser,
    calibrate_radiometry, calibrate_colour, calibrate_show, calibrate_report;

extern char *calibrate_output, *calibrate_from; /* values of the options -o and -c */
extern gboolean calibrate_incomplete;           /* --incomplete */
/* The text in calibration_part.method of a laser that was calibrated from photographs
 * (--images). */
#define CALIBRATE_LASER_PHOTOGRAPHS "its line on a board in photographs"
#define CALIBRATE_INCOMPLETE                                                                       \
    {                                                                                              \
        "incomplete", 0, 0, G_OPTION_ARG_NONE, &calibrate_incomplete,                              \
            "Also use sessions that lack shots; the calibration lists them", NULL                  \
    }
#define CALIBRATE_OUTPUT(what)                                                                     \
    { "output", 'o', 0, G_OPTION_ARG_FILENAME, &calibrate_output, what, "FILE" }
#define CALIBRATE_FROM(what)                                                                       \
    { "calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibrate_from, what, "FILE" }

/* Largest relative deviation of a camera's signal from a signal that is proportional to the
 * exposure time. A camera with a larger deviation counts as not linear. */
#define CALIBRATE_LINEAR 0.01

struct calibrate_job;

struct calibrate_method {
    /* Calibrates job->calibration from the sessions. */
    gboolean (*find)(struct calibrate_job *job, GError **error);
    /* Adds the result to the record. The record already contains "file", and its text begins with
     * "FILE: ". Warnings go to job->warnings; the caller writes them to the record after the
     * result. */
    void (*tell)(Record *to, const struct calibrate_job *job);
    /* If TRUE and -c is not given, the result is added to the output file if that file exists. */
    gboolean adds;
};

/* One run of a subcommand, from captured sessions to a calibration file. It is the first member of
 * the subcommand's own struct job. */
struct calibrate_job {
    const struct calibrate_method *method;
    const char *part; /* name of the part on the command line, such as "laser" */
    char *const *sessions;
    int n_sessions;
    /* read at the beginning, improved by the method, and written at the end */
    struct calibration *calibration;
    GPtrArray *frames;     /* pictures on which the result is based, as struct calibrate_frame */
    GPtrArray *rejected;   /* rejected pictures or parts of them, with reasons, as char * */
    GPtrArray *incomplete; /* sessions that lack shots, each with its number of shots, as char * */
    GPtrArray *warnings;   /* of char *: sentences about the result */
    OutputFile *to;        /* the calibration file */
    OutputFile *corners;   /* a further file of the subcommand, or NULL */
    const struct work *work;
    gint64 begun_us; /* start of the work */
    double seconds;  /* duration of the work */
    GArray *marks;   /* of struct found_mark */
    /* Text on the page that explains the marks. NULL if the marks are places that were seen and
     * have errors. */
    const char *marks_say;
    /* the marks show where the target must be, and are not counted as observations */
    gboolean is_outline;
    OutputFile *found; /* the page of --found, or NULL */
};

/* Runs a method with progress, writes the calibration to -o, and reports the result. Fills job, and
 * frees the members of job at the end. If the file of -o must not be replaced, the function fails
 * before the work begins. Returns an exit code. If -o is missing, the exit code is CLI_USAGE. */
int calibrate_run(const struct call *call, const struct calibrate_method *method,
                  struct calibrate_job *job, GError **error);

/* Opens session i of the job. A session that lacks shots is refused without --incomplete. A session
 * or a file of another rig is refused.
 *
 * The first session decides with which calibration the job begins. This is the first of the
 * following: the file of -c, the existing output file if the method adds to it, the session's own
 * calibration. */
Session *calibrate_open(struct calibrate_job *job, int i, GError **error);

/* Records in the calibration how a part was found: the method, the residual, and the number and
 * checksum of all frames of the job. Takes ownership of the list of rejected frames. */
void calibrate_set_part(struct calibrate_job *job, enum calibration_kind kind, const char *method,
                        double residual_rms, const char *residual_unit, int degrees_of_freedom);

/* Returns the sessions that lacked shots among those from which a part was calibrated, according to
 * the calibration file. part is the name of a part on the command line, for instance "laser".
 * Returns NULL if all sessions were complete. Free the result with g_strfreev(). */
char **calibrate_lacking(const struct calibration *calibration, const char *part);

/* Returns the name of the observations that a part leaves out one by one, for instance "sights". */
const char *calibrate_left_out(enum calibration_kind kind);

/* Returns whether a part has left out more observations than it has used. If so, the user should
 * find out why. Up to half of the sights of lamps are usually left out. */
gboolean calibrate_left_out_most(const struct calibration_part *part, enum calibration_kind kind);

/* Adds the last lines of the text for people: how many items were left out, and a hint if the
 * cameras should be calibrated first. `what` is the name of the items, such as "sights". */
void calibrate_say_doubts(Record *to, const struct calibrate_job *job,
                          const struct calibration_part *part, const char *what);

/* Adds a warning with possible causes to job->warnings if a residual is more than RESIDUAL_LIMIT
 * times the residual that noise explains (base/residual.h). */
struct residual;
void calibrate_warn_residual(const struct calibrate_job *job, const struct residual *residual);

/* Returns the paths of the photographs in a folder, sorted by name. Returns NULL with an error if
 * there are none or more than `most`. Hidden files are skipped and added to skipped as
 * "path: reason". */
GPtrArray *calibrate_photographs(const char *folder, guint most, GPtrArray *skipped,
                                 GError **error);

/* Reads a photograph as linear grey values. Of an EXR file, the values are the channel Y of its
 * first part or, if there is none, the luminance of R, G and B (ITU-R BT.709). Other files are read
 * by pictures/picture_read.h. */
struct picture *calibrate_read_photograph(const char *path, GError **error);

/* Returns the distance in mm between a bent laser sheet and the same sheet without its bend:
 * bend_rad · s² / r. The distance s = CALIBRATE_BEND_AT_MM is measured on the turntable from the
 * middle of the line. The distance r of the laser from the turntable's centre is measured across
 * the laser's axis. Returns 0 if r is 0. */
#define CALIBRATE_BEND_AT_MM 36.0
double calibrate_bend_mm(const struct rig_laser *laser, double bend_rad);

/* A column of calibrate_keep(): the key of its list, and the printf() format of one double. */
struct calibrate_column {
    const char *key, *format;
};
/* Keeps a table in the calibration file, from which the report draws. Each column becomes a list of
 * numbers. rows contains the table as double, row by row. */
void calibrate_keep(struct calibrate_job *job, const char *group,
                    const struct calibrate_column *columns, guint n_columns, const GArray *rows);

/* Parses exactly n finite numbers with `separator` between them. Returns FALSE for any other
 * text. */
gboolean calibrate_parse(const char *text, const char *separator, int n, double *ret);

/* A frame of a session, or a photograph. Its pixels are read when they are needed. */
struct calibrate_frame {
    char *path; /* path of the file */
    /* Checksum that the session has stored. For a photograph it is the checksum of the file or
     * NULL. */
    char *sha256;
    /* indices in the calibration; lamp is −1 for a frame without light and for a sweep */
    int camera, lamp;
    int laser; /* index in the calibration; −1 if the frame is not a sweep */
    double turntable_deg, arc_deg;
};
void calibrate_frame_free(struct calibrate_frame *frame); /* NULL is ignored */

/* Returns the frames of all finished shots of one kind, as struct calibrate_frame. The array has a
 * free function. Returns NULL with an error if the session cannot be read. */
GPtrArray *calibrate_frames(Session *session, enum session_shot_kind kind, GError **error);

/* Checks that the checksum of the frame's file is frame->sha256, which must not be NULL. */
gboolean calibrate_check_sum(const struct calibrate_frame *frame, GError **error);

/* Reads a frame of a lamp shot. The result is the mosaic in DN per millisecond above the dark
 * level, with balanced colours. Returns NULL with an error if the file cannot be read, differs from
 * the checksum that the session has stored, or has an unknown colour filter. */
struct picture *calibrate_read(const struct calibrate_frame *frame, GError **error);

/* The page of --found shows the pictures of a calibration with what was found in them. Marks are
 * drawn at the places that were seen. A line at a mark points to the place that the calibration
 * predicts. The lines are drawn longer than these errors, all by the same factor. If a calibration
 * fails, the page has the pictures and the reasons, without marks. */
#define CALIBRATE_FOUND_PICTURES 24 /* maximum number of pictures of a page */

extern char *calibrate_found; /* --found */
#define CALIBRATE_FOUND                                                                            \
    {                                                                                              \
        "found", 0, 0, G_OPTION_ARG_FILENAME, &calibrate_found,                                    \
            "Also write a page with the pictures, and what was found in them", "FILE.html"         \
    }

struct found_mark {
    int frame; /* index in job->frames */
    /* place at which it was seen; (0, 0) is the centre of the top left pixel */
    double x_px, y_px;
    double dx_px, dy_px;  /* predicted minus seen place; 0 if no place is predicted */
    gboolean is_left_out; /* it did not fit what the others show */
};

/* Adds a mark to the page, or does nothing without --found. Any thread may call the function, but
 * only one at a time. */
void calibrate_found_add(struct calibrate_job *job, const struct found_mark *mark);

/* Writes the page to job->found. `why` is the error of a calibration that failed, or NULL. */
gboolean calibrate_found_write(struct calibrate_job *job, const GError *why, GError **error);

/* The command `mesorig board`: draws a calibration board as a file to print. */
extern const struct command cli_board;
