/*
 * Shared by the subcommands of `mesorig calibrate`. Each has a file of its own, calibrate_NAME.c,
 * and a row in the table in calibrate.c.
 *
 * They read captured sessions and hand plain pictures to calib/, which knows no sessions.
 */
#pragma once

#include "base/work.h"
#include "calibration/calibration.h"
#include "common/cli.h"
#include "pictures/picture.h"
#include "session/session.h"

extern const struct command cli_calibrate;

/* Their names are "calibrate NAME", so that usage and help speak of that. */
extern const struct command calibrate_cameras, calibrate_lights, calibrate_laser,
    calibrate_radiometry, calibrate_colour, calibrate_show, calibrate_report;

extern char *calibrate_output, *calibrate_from; /* -o and -c */
extern gboolean calibrate_incomplete;           /* --incomplete */
#define CALIBRATE_INCOMPLETE                                                                       \
    {                                                                                              \
        "incomplete", 0, 0, G_OPTION_ARG_NONE, &calibrate_incomplete,                              \
            "Use sessions that lack shots, too; the calibration says so", NULL                     \
    }
#define CALIBRATE_OUTPUT(what)                                                                     \
    { "output", 'o', 0, G_OPTION_ARG_FILENAME, &calibrate_output, what, "FILE" }
#define CALIBRATE_FROM(what)                                                                       \
    { "calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibrate_from, what, "FILE" }

#define CALIBRATE_LINEAR 0.01 /* of a signal: a camera that is further off has a gamma */

struct calibrate_job;

struct calibrate_method {
    /* Finds calibration, from the sessions. */
    gboolean (*find)(struct calibrate_job *job, GError **error);
    /* Adds the result to the record, which has "file" already. Warnings are added to the job: the
     * caller records them as "warnings", and says them after the result. */
    void (*tell)(Record *to, const struct calibrate_job *job);
    gboolean adds; /* without -c, to the file that is written, if it is there */
};

/* One run of a subcommand, from captured sessions to a calibration file; the first member of the
 * subcommand's own struct job. */
struct calibrate_job {
    const struct calibrate_method *method;
    const char *part; /* of the command: "laser" */
    char *const *sessions;
    int n_sessions;
    struct calibration *calibration; /* is improved, and written at the end */
    GPtrArray *frames;               /* struct calibrate_frame *, the pictures that are used */
    GPtrArray *rejected;             /* char *, pictures or parts of them that are not, and why */
    GPtrArray *incomplete;           /* char *, sessions that lack shots, and how many */
    GPtrArray *warnings;             /* char *, of the result: sentences */
    OutputFile *to;                  /* the calibration file, and */
    OutputFile *corners;             /* a further file of the subcommand, or NULL */
    const struct work *work;
    gint64 begun_us; /* of the work */
    double seconds;  /* which it took */
};

/* Runs a method with progress, writes the calibration to -o, and reports the result. Fills job,
 * and in the end frees what its members own. Before the work it refuses a -o that may not be
 * replaced. Returns an exit code: that of bad usage if -o is missing. */
int calibrate_run(const struct call *call, const struct calibrate_method *method,
                  struct calibrate_job *job, GError **error);

/* Opens one of the job's sessions. One that lacks shots is refused without --incomplete. The first
 * session decides which calibration is improved on: that of -c, else the file that the method adds
 * to, else the session's own. The other sessions, and the file, are refused if they belong to
 * another rig. */
Session *calibrate_open(struct calibrate_job *job, int i, GError **error);

/* Records in the calibration how a part of it was found: from all of the job's frames but the
 * rejected ones, whose list the calibration then owns. */
void calibrate_set_part(struct calibrate_job *job, enum calibration_kind kind, const char *method,
                        double residual_rms, const char *residual_unit, int degrees_of_freedom);

/* Returns which of the sessions that a part was calibrated from lacked shots, as the calibration
 * file says; part has the command's name, "laser". NULL: all were complete. g_strfreev(). */
char **calibrate_lacking(const struct calibration *calibration, const char *part);

/* The name of the observations that a part leaves out one by one, as in "sights". */
const char *calibrate_left_out(enum calibration_kind kind);

/* Whether more was left out of a part than used, which is worth a look; of sights up to a half is
 * usual. */
gboolean calibrate_left_out_most(const struct calibration_part *part, enum calibration_kind kind);

/* Adds the last lines for people: how many items were left out (what: "sights"), and whether
 * cameras should be calibrated first. */
void calibrate_say_doubts(Record *to, const struct calibrate_job *job,
                          const struct calibration_part *part, const char *what);

/* Adds a warning with its causes if noise does not explain a residual. */
struct residual;
void calibrate_warn_residual(const struct calibrate_job *job, const struct residual *residual);

/* Returns the sorted paths of the photographs in a folder, at most `most`; none is an error. Hidden
 * files are skipped and added to skipped, as "path: reason". */
GPtrArray *calibrate_photographs(const char *folder, guint most, GPtrArray *skipped,
                                 GError **error);

/* Reads one of them as grey, linear: by pictures/vision.h, or the first part of an EXR file, Y or
 * the luminance of R, G and B (ITU-R BT.709). */
struct picture *calibrate_read_photograph(const char *path, GError **error);

/* How far a bend takes a laser's sheet from a plane at CALIBRATE_BEND_AT_MM from the middle of its
 * line, at the turntable's centre: bend_rad · at² / distance. */
#define CALIBRATE_BEND_AT_MM 36.0
double calibrate_bend_mm(const struct rig_laser *laser, double bend_rad);

/* Keeps a table in the calibration file, a list of numbers for each column, for the report. rows:
 * of double, row by row. */
struct calibrate_column {
    const char *key, *format; /* of one double */
};
void calibrate_keep(struct calibrate_job *job, const char *group,
                    const struct calibrate_column *columns, guint n_columns, const GArray *rows);

/* Parses exactly n finite numbers; separator: the text between them. */
gboolean calibrate_parse(const char *text, const char *separator, int n, double *ret);

/* A frame that the session holds; its pixels are read when they are needed. */
struct calibrate_frame {
    char *path;       /* of the file */
    char *sha256;     /* as the session has it; NULL: a photograph of no session */
    int camera, lamp; /* of the calibration; lamp −1: dark, or a sweep */
    int laser;        /* of the calibration; −1: no sweep */
    double turntable_deg, arc_deg;
};
void calibrate_frame_free(struct calibrate_frame *frame); /* NULL is ignored */

/* Frames of one kind in planned order, with a free function. */
GPtrArray *calibrate_frames(Session *session, enum session_shot_kind kind, GError **error);

/* Checks that the frame's file is the one that was captured. */
gboolean calibrate_check_sum(const struct calibrate_frame *frame, GError **error);

/* Reads a frame of a lamp shot: its mosaic in DN per millisecond above the dark level, with
 * balanced colours. Compares the file's checksum with the session's. */
struct picture *calibrate_read(const struct calibrate_frame *frame, GError **error);

/* `mesorig board`: a calibration board as a file to print. */
extern const struct command cli_board;
