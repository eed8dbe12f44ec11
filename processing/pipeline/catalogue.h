/* The state of a session for processing: the input files of each view, and whether they are
 * complete. One thread at a time. */
#pragma once

#include "btf/btf.h"
#include "calibration/calibration.h"
#include "mdf/mdf.h"
#include "session/outputs.h"

struct catalogue {
    struct calibration *known; /* the calibration that is used */
    /* the calibration with which the session was captured; NULL if it is the one that is used */
    struct calibration *captured;
    struct rig rig; /* rig of known */
    /* Maps a turntable angle in degrees (double) to the struct rig as the sample sees it there.
     * Empty if the turntable does not wobble. */
    GHashTable *rigs;
    struct session_grid grid;
    struct laser_reference reference; /* radius_mm is 0 if there is none */
    char *calibration;                /* text of the calibration `known` */
    /* output of the lamp in each shot, relative to the calibration that is used */
    struct outputs *outputs;
    /* elements are struct session_direction; those of shots are struct session_shot */
    GPtrArray *views, *lights, *lasers, *shots;
    GHashTable *frames; /* shot and camera → struct session_frame */
    GPtrArray *frame_rows;
    GHashTable *by_source; /* maps kind, source and turntable angle to a GPtrArray of shots */
    const char *directory;
    /* set to FALSE by catalogue_load(); see struct pipeline_options */
    gboolean lines_in_pictures, plain_merge;
};

/* Reads the state of a session. calibration is as in struct pipeline_options. */
struct catalogue *catalogue_load(Session *session, const char *calibration, GError **error);
void catalogue_free(struct catalogue *catalogue); /* NULL is ignored */

/* Reads the session's frames, shots and lamp outputs again, because a capture may have added some.
 * Frees the old ones. Fails if the database cannot be read, or if a row or a stored output is not
 * valid. */
gboolean catalogue_refresh(struct catalogue *catalogue, Session *session, GError **error);

/* Returns the number of planned shots that are not taken yet. */
int catalogue_planned(const struct catalogue *catalogue);

enum catalogue_state {
    CATALOGUE_READY,
    CATALOGUE_WAITING,    /* frames are planned, but not taken yet */
    CATALOGUE_IMPOSSIBLE, /* the plan lacks a necessary shot, or skips too many shots of the view */
};

/* Looks up the inputs of a view's BTF, and returns their state. ret may be NULL. If the view is
 * ready, *ret becomes these inputs, which borrow from the catalogue; free them with
 * btf_view_free(). */
enum catalogue_state catalogue_btf(const struct catalogue *catalogue, int view,
                                   struct btf_view **ret);

struct mdf_input {
    const struct rig_arc *arc;
    const struct rig_laser *laser;
    double arc_rad, from_rad, to_rad;
    int steps, position; /* position: index of the laser position */
    struct laser_known known;
    /* errors of the laser's sheet; NULL if the calibration does not have them */
    const struct rig_sheet_errors *errors;
    /* standard deviation of the line's profile on plates, as a sweep angle; 0 if unknown */
    double line_rad;
    struct input input;
};

struct mdf_job {
    const struct session_direction *view;
    const struct rig_camera *camera;
    double turntable_rad;
    const struct rig *rig;
    const struct laser_reference *reference;
    /* covariance, in pixels along x and y, of the error with which the camera model predicts where
     * a point of the sample is seen; 0 if unknown */
    double sight_px2[2][2];
    GArray *sweeps; /* of struct mdf_input, in order of laser position */
    gboolean lines_in_pictures, plain_merge;
    char *inputs; /* hash of all members above */
};
void mdf_job_free(struct mdf_job *job); /* NULL is ignored */

/* Looks up the sweeps of a view, like catalogue_btf(). If the plan leaves sweeps out, the view can
 * be ready without them, as long as at least one sweep remains. At most MDF_MAX_SWEEPS sweeps are
 * used. Free *ret with mdf_job_free(). */
enum catalogue_state catalogue_mdf(const struct catalogue *catalogue, int view,
                                   struct mdf_job **ret);

/* Begins a hash of a product's inputs. It contains what all views share: kind ("btf", "mdf" or
 * another name), versions, calibration and grid. */
GChecksum *catalogue_checksum(const struct catalogue *catalogue, const char *kind);
