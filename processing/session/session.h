/*
 * The session directory: the only interface between capture, processing and preview.
 *
 *   NAME.session/
 *     session.db         SQLite (WAL): files as they were, plan, shots, frames, events, products
 *     frames/…exr        linear radiance, half float, one per shot and camera
 *     laser/…exr         the peaks of a laser sweep, one per shot and camera
 *     products/…         results of processing
 *
 * A frame's row is committed after its file is on disk, so a row says that the file is there. One
 * process writes plan, shots and frames (it holds an exclusive lock, see SESSION_CAPTURE); any
 * number may read or write products at the same time. A Session belongs to one thread at a time.
 */
#pragma once

#include "base/work.h"

#include <gio/gio.h>

#define SESSION_FORMAT 1

#define SESSION_ERROR session_error_quark()
GQuark session_error_quark(void);
enum session_error {
    SESSION_ERROR_IO,
    SESSION_ERROR_FORMAT, /* not a session, damaged, or of a newer version */
    SESSION_ERROR_LOCKED, /* another process captures into it */
    SESSION_ERROR_EXISTS,
    SESSION_ERROR_FULL,    /* the disk is full: nothing is lost; free some space and continue */
    SESSION_ERROR_DAMAGED, /* a file differs from its row in the database */
};

typedef struct Session Session;

enum session_mode { SESSION_READ, SESSION_PRODUCTS, SESSION_CAPTURE };

/* The texts that describe the session, which never change. */
struct session_texts {
    const char *rig_conf, *session_conf; /* as the user wrote them */
    const char *calibration;             /* rig_to_text() */
    const char *rig_path; /* absolute; stored as the value "rig_path"; NULL: unknown */
    const char *const (
        *values)[2]; /* further values: name and value each; a value NULL: left out */
    int n_values;
};

struct session_grid {  /* the texels of the reference plane, in the sample frame */
    int width, height; /* texels */
    double width_mm, height_mm;
    double reference_mm; /* height of the reference plane above the turntable */
    double depth_mm;     /* of the structure below it, at most */
};

/* The planned direction of a view, light or laser position, in the sample frame. */
struct session_direction {
    int index;                 /* 0 … n−1 */
    int device;                /* index of the camera, lamp or laser in the calibration */
    double theta_deg, phi_deg; /* as planned: a view with its turntable angle, and so on */
    double turntable_deg;      /* views only: the angle that shows this view */
    char *note;                /* what was changed in the plan, or NULL */
};

enum session_shot_kind { SHOT_DARK, SHOT_LAMP, SHOT_SWEEP };
enum session_shot_state { SHOT_PLANNED, SHOT_DONE, SHOT_SKIPPED };

/* A turn of the turntable during which shots of a lamp are taken ([capture] motion = continuous).
 * Not stored: it follows from the session file and the shots (daemon/passes/passes.h). */
struct session_pass {
    int number; /* the same for the shots of a pass, which follow each other; 0: the table stands */
    double from_deg, by_deg, speed_deg_s; /* of the table */
};

struct session_shot {
    gint64 id; /* 1 … n, in planned order; also the tag given to cameras */
    enum session_shot_kind kind;
    int pose;                      /* number of the pose in planned order */
    double turntable_deg, arc_deg; /* commanded */
    int source; /* SHOT_LAMP: index of the light; SHOT_SWEEP: of the laser position; else −1 */
    int device; /* lamp or laser of the calibration; −1 for dark */
    guint32 cameras;                     /* bit c: camera c takes part */
    double sweep_from_deg, sweep_to_deg; /* SHOT_SWEEP */
    int sweep_steps;
    enum session_shot_state state;
    char *note; /* why it was skipped or changed, or NULL */
    struct session_pass pass;
};

/* A shot of a pass that another one precedes. */
static inline gboolean session_follows_in_pass(const struct session_shot *before,
                                               const struct session_shot *shot) {
    return before && shot->pass.number > 0 && before->pass.number == shot->pass.number;
}

/* The note of a shot begins so if the shot was skipped because others suffice: a sweep that is
 * expected to add nothing, or a lamp shot whose pictures can be predicted. */
#define SESSION_LEFT_OUT "left out:"

struct session_frame {
    gint64 shot;
    int camera;
    char *path; /* relative to the session directory */
    char *sha256;
    gint64 bytes;
    int retakes;
    double captured_s; /* on the session's clock */
    gboolean turned;   /* the turntable turned while it was exposed; stored as the session's value
                          "turned/SHOT/CAMERA", which is turntable_deg */
    double turntable_deg; /* where it was then in the middle of the exposure; else 0 */
};

/* Where the turntable was: in the middle of the exposure, or where it stood. */
static inline double session_frame_turntable_deg(const struct session_frame *frame,
                                                 const struct session_shot *shot) {
    return frame->turned ? frame->turntable_deg : shot->turntable_deg;
}

#define SESSION_EVENT_HOMED "homed" /* its message: what was captured follows from here on */
struct session_event {
    double time_s;
    char *level;  /* "info", "warning", "error" */
    char *source; /* the device or stage */
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

/* Creates the directory (it must not exist) with the whole plan, under a hidden name that is
 * renamed at the end; a killed process leaves at most ".NAME.session.XXXXXX" beside it. The plan
 * is checked first. Opened as SESSION_CAPTURE. */
Session *session_create(const char *path, const char *name, const struct session_texts *texts,
                        const struct session_plan *plan, GError **error);
Session *session_open(const char *path, enum session_mode mode, GError **error);
void session_close(Session *session); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Session, session_close)

const char *session_path(const Session *session);
const char *session_name(const Session *session);
char *session_file(const Session *session, const char *relative); /* g_free() */

/* "rig.conf", "session.conf", "calibration.conf" as stored; g_free(). */
char *session_text(Session *session, const char *name, GError **error);

gboolean session_grid(Session *session, struct session_grid *ret, GError **error);

/* Which program made the session ("mesorig 1.2.3"), and when (ISO 8601, UTC); g_free() both. */
gboolean session_origin(Session *session, char **ret_program, char **ret_created, GError **error);

/* Arrays with free functions set; elements are structs above. NULL on error. */
GPtrArray *session_views(Session *session, GError **error);
GPtrArray *session_lights(Session *session, GError **error);
GPtrArray *session_lasers(Session *session, GError **error);
GPtrArray *session_shots(Session *session, GError **error);  /* in planned order */
GPtrArray *session_frames(Session *session, GError **error); /* by shot, camera */
GPtrArray *session_events(Session *session, GError **error);

/* Relative path of a frame's file: "frames/000123_cam1.exr", "laser/…". */
char *session_frame_path(const struct session_shot *shot, const char *camera);

/* For capture. Commits all frames of a shot and its state in one transaction, after the files are
 * synced; they replace those of an earlier take. Each file must exist with its recorded size. */
gboolean session_commit_shot(Session *session, gint64 shot, enum session_shot_state state,
                             const struct session_frame *frames, int n_frames, const char *note,
                             GError **error);
gboolean session_add_event(Session *session, double time_s, const char *level, const char *source,
                           const char *message, GError **error);

/* Values by name ("state", "clock_s", …): bookkeeping of capture, and results of processing.
 * session_read_value(): *ret is NULL if the value is not set, and on an error; g_free() */
gboolean session_set_value(Session *session, const char *key, const char *value, GError **error);
gboolean session_read_value(Session *session, const char *key, char **ret, GError **error);
/* The same, for what is shown to people alone: NULL: not set, or it cannot be read; g_free() */
char *session_value(Session *session, const char *key);

/* What looks wrong about a session's input, a sentence each: the value "suspicions", which check
 * and process show. session_suspect() adds one that is not there yet; session_suspicions() adds all
 * to an array of char *. */
gboolean session_suspect(Session *session, const char *sentence, GError **error);
void session_suspicions(Session *session, GPtrArray *ret);

/* All values whose names begin with prefix: name → value, both owned by the table. */
GHashTable *session_values(Session *session, const char *prefix, GError **error);

/* Records the inputs from which a product was computed; checksum and size are taken from the file.
 */
gboolean session_add_product(Session *session, const char *relative, const char *made_by,
                             GError **error);
/* The same as session_add_product() for a file by its path; files outside of a session's products
 * are ignored. made_by: "compress …" or "export …", the arguments with which mesorig makes the file
 * again. */
gboolean session_add_product_file(const char *path, const char *made_by, GError **error);
GHashTable *session_products(Session *session, GError **error); /* a set of their paths */

struct session_product {
    char *path; /* relative */
    char *made_by, *sha256;
    gint64 bytes;
};
/* All products in order of their paths: an array of struct session_product, with a free function
 * set. */
GPtrArray *session_list_products(Session *session, GError **error);

/* A committed file that differs from its row in the database. */
struct session_damage {
    char *path; /* relative */
    char *what; /* "it is gone", "its SHA-256 is …, the session has …" */
    char *sha256;
    char *remedy; /* the command that makes it again; NULL: none, import again */
    gboolean missing;
    gboolean unreadable; /* the disk fails to read it: whether it is damaged is not known */
};
void session_damage_free(struct session_damage *damage); /* NULL is ignored */

enum session_files { SESSION_FRAMES, SESSION_PRODUCTS_MADE };

/* Hashes all frames (including sweeps), or the products whose names begin with prefix, and
 * compares with the database, one thread per processor. A file hashed by this process before is
 * not hashed again while its size, times and inode are unchanged. Returns an array of struct
 * session_damage. Progress stage "verify"; work may be NULL. */
GPtrArray *session_find_damage(Session *session, enum session_files files, const char *prefix,
                               const struct work *work, int *ret_examined, GError **error);

/* Checks one file; NULL: it is as committed. remedy is not set. Any thread. */
struct session_damage *session_examine(const Session *session, const char *relative,
                                       const char *sha256);

/* Call before reading products: SESSION_ERROR_DAMAGED, with the command that makes the file
 * again, if a product whose name begins with prefix differs from its row. Files without a row
 * pass. If another program is making products, it waits for the row of a file that was just
 * written. work: may be NULL; nothing is reported. */
gboolean session_check_products(Session *session, const char *prefix, const struct work *work,
                                GError **error);

/* The same for a file by its path; files outside of sessions pass. */
gboolean session_check_product(const char *path, GError **error);

/* Paths of its BTF, a file for each view that has one, in the order of session_views(); checked as
 * by session_check_products(). DATA_ERROR_INCOMPLETE: there are none. g_ptr_array_unref() */
GPtrArray *session_btf_files(Session *session, GError **error);

/* Lock file of the process that makes products/btf, mdf.exr and eigenmaps.exr (file_lock.h);
 * relative. */
#define SESSION_PROCESS_LOCK "products/process.lock"

/* Notes a damaged frame for the next session_verify(); what: NULL if it is intact again. */
gboolean session_note_damage(Session *session, const char *frame, const char *what, GError **error);

/* Deletes unfinished files of frames; while nothing is captured into the session. */
void session_remove_unfinished(const Session *session);

/* Compares every committed frame's size with its file. Compares the checksum, too, for dark frames,
 * which other frames depend on, for noted frames, and for all frames if thorough. Frames that fail
 * are removed from the database and their shots planned again, with all their frames; each is an
 * event. A frame that the disk fails to read is an error, and nothing is planned again: a disk that
 * fails for a moment has lost nothing. Unfinished files of killed captures are deleted. For capture
 * only. ret_lost: number of failed frames; may be NULL. */
gboolean session_verify(Session *session, gboolean thorough, int *ret_lost, GError **error);
