/* The session directory, the only interface between capture, processing and viewer.
 *
 *   NAME.session/
 *     session.db     SQLite (WAL): rig and session files, plan, shots, frames, events, products
 *     frames/…exr    one per shot and camera: the picture of a lamp shot (linear, half float), or
 *                    the dark levels of a dark shot (float)
 *     laser/…exr     one per shot and camera: the peaks of a laser sweep (float)
 *     frames/…/…exr  single raw frames of a shot and camera, if the session keeps them
 *     laser/…/…exr   single raw frames of a laser sweep, if the session keeps them
 *     products/…     results of processing
 *
 * daemon/capture/intake/intake.h describes the files below frames and laser.
 *
 * The row of a frame is committed after its file is on disk, so that every row has its file. One
 * process writes the plan, shots and frames, and has an exclusive lock (SESSION_CAPTURE). Any
 * number of processes may read the session, or write products, at the same time. A Session belongs
 * to one thread at a time. */
#pragma once

#include "base/camera_set.h"
#include "base/work.h"

#include <glib.h>

#define SESSION_FORMAT 1

#define SESSION_ERROR session_error_quark()
GQuark session_error_quark(void);
enum session_error {
    SESSION_ERROR_IO, /* a file or the database cannot be read, written or locked */
    /* the session is damaged, not valid, of another version, or not suitable for what is asked; or
     * the directory is not a session */
    SESSION_ERROR_FORMAT,
    SESSION_ERROR_LOCKED, /* another process captures into the session */
    SESSION_ERROR_EXISTS, /* a new session would replace something */
    /* the disk is full; nothing is lost, and the caller can try again when there is free space */
    SESSION_ERROR_FULL,
    /* the file of a product is missing, cannot be read, or differs from its row in the database */
    SESSION_ERROR_DAMAGED,
};

typedef struct Session Session;

/* What a Session may write:
 * SESSION_READ      nothing
 * SESSION_PRODUCTS  values, events and products
 * SESSION_CAPTURE   also the state and the frames of shots. The Session locks capture.lock, so
 *                   that only one process captures into the session. */
enum session_mode { SESSION_READ, SESSION_PRODUCTS, SESSION_CAPTURE };

/* The texts that describe the session. They never change. */
struct session_texts {
    const char *rig_conf, *session_conf; /* as the user wrote them */
    const char *calibration;             /* as rig_to_text() writes it */
    /* absolute path of the rig's file, stored as the value "rig_path"; NULL if unknown */
    const char *rig_path;
    /* further values, each a name and a value; a value of NULL is not stored */
    const char *const (*values)[2];
    int n_values;
};

struct session_grid {  /* the texels of the reference plane, in the sample frame */
    int width, height; /* texels */
    double width_mm, height_mm;
    double reference_mm; /* height of the reference plane above the turntable */
    double depth_mm;     /* maximum depth of the structure below that plane */
};

/* The planned direction of a view, light or laser position, in the sample frame. */
struct session_direction {
    int index;  /* position among the directions of its kind, from 0 */
    int device; /* index of the camera, lamp or laser in the calibration */
    /* planned angles; for a view, those with the turntable at turntable_deg */
    double theta_deg, phi_deg;
    double turntable_deg; /* for a view, the turntable angle that shows it */
    char *note;           /* what was changed in the plan, or NULL */
};

enum session_shot_kind { SHOT_DARK, SHOT_LAMP, SHOT_SWEEP };
enum session_shot_state { SHOT_PLANNED, SHOT_DONE, SHOT_SKIPPED };

/* A turn of the turntable during which shots of a lamp are taken ([capture] motion = continuous). A
 * pass is not stored, because it follows from the session file and the shots
 * (daemon/plan/passes.h). */
struct session_pass {
    /* Number of the pass; 0 if the turntable stands still. The shots of a pass follow each
     * other. */
    int number;
    /* from_deg: angle of the turntable at the beginning
     * by_deg: angle by which the turntable turns
     * speed_deg_s: speed of the turntable */
    double from_deg, by_deg, speed_deg_s;
};

struct session_shot {
    gint64 id; /* 1 … n, in planned order; also the tag that the cameras are given */
    enum session_shot_kind kind;
    int pose;                      /* number of the pose in planned order */
    double turntable_deg, arc_deg; /* commanded angles */
    /* index of the light for SHOT_LAMP, index of the laser position for SHOT_SWEEP, otherwise −1 */
    int source;
    int device;                /* index of the lamp or laser; −1 for dark */
    struct camera_set cameras; /* the cameras that take part */
    /* first and last angle of the laser; only for SHOT_SWEEP */
    double sweep_from_deg, sweep_to_deg;
    int sweep_steps;
    enum session_shot_state state;
    /* why the shot was skipped or changed, and which cameras were saturated; may be NULL */
    char *note;
    struct session_pass pass;
};

/* Returns whether a shot follows another shot of the same pass. */
static inline gboolean session_follows_in_pass(const struct session_shot *before,
                                               const struct session_shot *shot) {
    return before && shot->pass.number > 0 && before->pass.number == shot->pass.number;
}

/* Beginning of the note of a shot that was left out, because other shots are sufficient. It is a
 * sweep that is expected to add nothing, or a lamp shot whose pictures can be predicted. */
#define SESSION_LEFT_OUT "left out:"

struct session_frame {
    gint64 shot;
    int camera;
    char *path; /* relative to the session directory */
    char *sha256;
    gint64 bytes;
    int retakes;
    double captured_s; /* time of the exposure on the session's clock */
    /* Whether the turntable turned during the exposure. If it did, turntable_deg is stored in the
     * session's value "turned/SHOT/CAMERA". */
    gboolean turned;
    /* if turned, the angle of the turntable in the middle of the exposure; otherwise 0 */
    double turntable_deg;
};

/* Returns the angle of the turntable in the middle of the frame's exposure. If the turntable stood
 * still, this is the angle of the shot. */
static inline double session_frame_turntable_deg(const struct session_frame *frame,
                                                 const struct session_shot *shot) {
    return frame->turned ? frame->turntable_deg : shot->turntable_deg;
}

/* Message of the event that capture records each time the axes have been homed. “mesorig info
 * --history” reads this event. */
#define SESSION_EVENT_HOMED "homed"
struct session_event {
    double time_s;
    char *level;  /* "info", "warning", "error" */
    char *source; /* the device or stage that the event is about */
    char *message;
};

/* A plan for session_create(). Arrays are of the structs above, borrowed. */
struct session_plan {
    struct session_grid grid;
    const struct session_direction *views, *lights, *lasers;
    int n_views, n_lights, n_lasers;
    const struct session_shot *shots;
    int n_shots;
};

/* Creates the directory with the whole plan, and opens it as SESSION_CAPTURE. The directory has a
 * hidden name until it is complete. If the process is killed, it leaves at most a folder
 * ".NAME.session.XXXXXX" next to the session.
 *
 * The error is SESSION_ERROR_EXISTS if the path exists. It is SESSION_ERROR_FORMAT if the plan is
 * not valid, or if a text is missing or not UTF-8. */
Session *session_create(const char *path, const char *name, const struct session_texts *texts,
                        const struct session_plan *plan, GError **error);
/* Opens an existing session. The error is SESSION_ERROR_FORMAT if there is no session, or if it is
 * damaged or of another version. It is SESSION_ERROR_LOCKED if the mode is SESSION_CAPTURE and
 * another process captures into the session. */
Session *session_open(const char *path, enum session_mode mode, GError **error);
void session_close(Session *session); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Session, session_close)

const char *session_path(const Session *session);
const char *session_name(const Session *session);
char *session_file(const Session *session, const char *relative); /* g_free() */

/* Returns the text "rig.conf", "session.conf", "calibration.conf" or "products_calibration.conf"
 * (made_with.h) as stored; g_free(). Returns NULL on error. */
char *session_text(Session *session, const char *name, GError **error);

gboolean session_grid(Session *session, struct session_grid *ret, GError **error);

/* Gives the program that made the session ("mesorig 1.2.3") and the time at which the program made
 * it (ISO 8601, UTC); g_free() both. Fails if the database cannot be read or has no such row. */
gboolean session_origin(Session *session, char **ret_program, char **ret_created, GError **error);

/* Return arrays of the structs above, with free functions set, or NULL on error. Each row is
 * checked, and the error is SESSION_ERROR_FORMAT if one is not valid. Events are not checked. */
GPtrArray *session_views(Session *session, GError **error);
GPtrArray *session_lights(Session *session, GError **error);
GPtrArray *session_lasers(Session *session, GError **error);
GPtrArray *session_shots(Session *session, GError **error);  /* in planned order */
GPtrArray *session_frames(Session *session, GError **error); /* by shot, camera */
GPtrArray *session_events(Session *session, GError **error);

/* Returns the relative path of a frame's file: "frames/000123_cam1.exr", "laser/…". */
char *session_frame_path(const struct session_shot *shot, const char *camera);

/* Commits all frames of a shot and the state of the shot in one transaction. Call it after the
 * files were synced. The frames replace the frames of an earlier take. The session must be open as
 * SESSION_CAPTURE.
 *
 * The error is
 * - SESSION_ERROR_IO if a file is missing, cannot be read or has another size than recorded, or if
 *   another value of a frame is not valid
 * - SESSION_ERROR_FULL if the disk is full
 * - SESSION_ERROR_FORMAT if the plan has no such shot, or if state is SHOT_PLANNED and there are
 *   frames */
gboolean session_commit_shot(Session *session, gint64 shot, enum session_shot_state state,
                             const struct session_frame *frames, int n_frames, const char *note,
                             GError **error);
gboolean session_add_event(Session *session, double time_s, const char *level, const char *source,
                           const char *message, GError **error);

/* Values by name ("state", "clock_s", …) record the capture and the results of processing.
 * session_set_value() stores a value, in which bytes that are not UTF-8 are replaced. If `value` is
 * NULL, it deletes the stored value. session_read_value() gives a value in *ret; g_free(). *ret is
 * NULL if the value is not set, and on an error. */
gboolean session_set_value(Session *session, const char *key, const char *value, GError **error);
gboolean session_read_value(Session *session, const char *key, char **ret, GError **error);
/* Returns a value that is only shown to people; g_free(). Returns NULL if the value is not set or
 * cannot be read. */
char *session_value(Session *session, const char *key);

/* Suspicions are sentences about something that looks wrong in the input of a session. They are
 * stored in the value "suspicions", which check and process show. session_suspect() adds a sentence
 * if it is not stored yet. session_suspicions() adds all sentences to an array of char *. */
gboolean session_suspect(Session *session, const char *sentence, GError **error);
void session_suspicions(Session *session, GPtrArray *ret);

/* Returns all values whose names begin with prefix, as a table from name to value. The table owns
 * the names and the values. Returns NULL on error. */
GHashTable *session_values(Session *session, const char *prefix, GError **error);

/* Writes the row of a product, or replaces it. The row has made_by, and the present checksum and
 * size of the file. made_by is the hash of the inputs, or the arguments with which mesorig makes
 * the file again. The error is SESSION_ERROR_IO if the file cannot be read or lies outside of the
 * session, or if the session is open as SESSION_READ. */
gboolean session_add_product(Session *session, const char *relative, const char *made_by,
                             GError **error);
/* Does the same as session_add_product() for a file that is given by its path. If the file is not
 * among the products of a session, nothing is done, and the result is TRUE. made_by is "compress …"
 * or "export …". */
gboolean session_add_product_file(const char *path, const char *made_by, GError **error);
/* Returns the set of the paths of all products, relative to the session directory. Returns NULL on
 * error. */
GHashTable *session_products(Session *session, GError **error);

struct session_product {
    char *path; /* relative to the session directory */
    char *made_by, *sha256;
    gint64 bytes;
};
/* Returns all products in order of their paths, as an array of struct session_product with a free
 * function set. */
GPtrArray *session_list_products(Session *session, GError **error);

/* A committed file that is missing, cannot be read, or differs from its row in the database. */
struct session_damage {
    char *path; /* relative to the session directory */
    char *what; /* a clause such as "it is gone" or "its SHA-256 is …, but the session has …" */
    char *sha256;
    /* the command that makes the file again; NULL if there is none, so that the session must be
     * imported again */
    char *remedy;
    gboolean missing;
    /* the disk fails to read the file, so that it is not known whether the file is damaged */
    gboolean unreadable;
};
void session_damage_free(struct session_damage *damage); /* NULL is ignored */

enum session_files { SESSION_FRAMES, SESSION_PRODUCTS_MADE };

/* Hashes the frames (including sweeps) or the products whose paths begin with prefix, and compares
 * the checksums with the database. Uses one thread per processor. A file that this process has
 * already hashed is not hashed again while its size, times and inode are unchanged. Returns an
 * array of struct session_damage, or NULL on error. *ret_examined (may be NULL) receives the number
 * of files. work may be NULL. The progress stage is "verify". */
GPtrArray *session_find_damage(Session *session, enum session_files files, const char *prefix,
                               const struct work *work, int *ret_examined, GError **error);

/* Checks one file. Returns NULL if the file is as it was committed, otherwise its damage without
 * the member remedy. Any thread. */
struct session_damage *session_examine(const Session *session, const char *relative,
                                       const char *sha256);

/* Checks the products whose paths begin with prefix. Call it before products are read. If a product
 * is missing, cannot be read, or differs from its row, the error is SESSION_ERROR_DAMAGED, and its
 * message has the command that makes the file again. Files without a row pass.
 *
 * If another program is making products, a file may have been written just before its row. The
 * function then repeats the check for up to 10 s. work may be NULL; the function reports no
 * progress. */
gboolean session_check_products(Session *session, const char *prefix, const struct work *work,
                                GError **error);

/* Checks a file that is given by its path, as session_check_products() does. A file that is not
 * among the products of a session passes. */
gboolean session_check_product(const char *path, GError **error);

/* Returns the paths of the files of the BTF, in the order of session_views(); g_ptr_array_unref().
 * Views without a file are left out. The files are checked as by session_check_products(). If there
 * are no files, the error is DATA_ERROR_INCOMPLETE. */
GPtrArray *session_btf_files(Session *session, GError **error);

/* Relative path of the lock file (file_lock.h) that a process locks while it makes products/btf,
 * mdf.exr and eigenmaps.exr. */
#define SESSION_PROCESS_LOCK "products/process.lock"

/* Records a damaged frame for the next session_verify(). `frame` is the path of the frame's file,
 * relative to the session directory. `what` describes the damage; NULL means that the frame is
 * intact again. */
gboolean session_note_damage(Session *session, const char *frame, const char *what, GError **error);

/* Deletes unfinished files of frames. Call it only while nothing is captured into the session. */
void session_remove_unfinished(const Session *session);

/* Compares the committed frames with their files, and plans the shots of damaged frames again. For
 * capture only.
 *
 * The size of every frame is compared. The checksum is compared of dark frames, on which other
 * frames depend, and of frames recorded as damaged. If thorough is TRUE, the checksum of every
 * frame is compared. Frames that fail are removed from the database, and their shots are planned
 * again with all their frames. Each failed frame is reported as an event. ret_lost receives the
 * number of failed frames; it may be NULL.
 *
 * If the disk fails to read a frame, the function fails and nothing is planned again, because the
 * frame may be readable later. Unfinished files of killed captures are deleted. */
gboolean session_verify(Session *session, gboolean thorough, int *ret_lost, GError **error);
