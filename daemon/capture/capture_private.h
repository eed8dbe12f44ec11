/* Shared by capture.c (opening a session, its state and its commands) and capture_run.c (running
 * it). */
#pragma once

#include "calibration/calibration.h"
#include "capture.h"
#include "exposure_advice.h"
#include "intake/intake.h"
#include "plan/adaptive/adaptive.h"
#include "sequencer.h"

struct flight { /* a shot whose frames are being processed by the intake */
    const struct session_shot *shot;
    guint32 back; /* bits of cameras whose results have returned */
    struct session_frame frames[RIG_MAX_CAMERAS];
    double signals_dn[RIG_MAX_CAMERAS];
    double signal_dn;                  /* maximum of all cameras */
    gint64 saturated[RIG_MAX_CAMERAS]; /* pixels; 0 if they are too few for a warning */
    /* of struct fiducial_seen, of all cameras; NULL if there are none */
    GArray *marks;
};

struct event_limit { /* rate limit of one kind of event of one camera */
    gboolean reported;
    double reported_s;
    int suppressed;
};

struct latest_picture { /* of a camera */
    Frame *frame;
    double time_s;
    gboolean fresh; /* the thumbnail shows that frame */
    struct capture_thumbnail thumbnail;
};

/* What is left: time by the plan, which does not know how quick this rig is, and shots of each kind
 * (enum session_shot_kind). */
struct shots_left {
    double planned_s;
    int n[SHOT_SWEEP + 1];
};

struct Capture {
    struct devices *devices;
    struct capture_callbacks callbacks;
    struct session_conf conf;
    Session *session;
    struct calibration *calibration; /* owned by the session */
    Adaptive *adaptive;              /* chooses shots; NULL if all shots are taken */
    Intake *intake;
    Sequencer *sequencer;
    enum capture_state state;
    enum capture_fault fault; /* of the pause */
    char *reason, *doing;
    GPtrArray *shots;     /* all, owned */
    GPtrArray *remaining; /* of this run */
    guint committed;      /* number of shots of remaining that are committed */
    /* number of held shots at the beginning of remaining: see capture_lasers.h */
    guint n_held;
    GPtrArray *leg;              /* the remaining shots up to the next mounting of a laser */
    int mounted[RIG_MAX_LASERS]; /* the laser at whose place a unit is mounted; −1 if not known */
    /* the laser at whose place a unit must be mounted next; −1 if none */
    int wanted_mount;
    guint32 unchecked_lasers; /* bits of units: see capture_lasers.h */
    GQueue flights;
    gboolean all_taken;
    int n_shots, n_done;
    gint64 frames, retakes;
    struct exposure_retakes exposures;
    gint64 begun_us;                               /* real time, monotonic */
    double real_base_s, frames_base, retakes_base; /* totals of earlier runs of this session */
    double clock_base_s; /* the session's clock at since_us, or its value while it is stopped */
    gint64 since_us;     /* −1 while the clock is stopped */
    double clock_saved_s;
    double predicted_s, lower_bound_s;
    /* bytes of the stored frames by kind (enum session_shot_kind) and camera: as they are on disk
     * (sum), and as the plan expected them (planned) */
    struct {
        double sum, planned;
    } bytes[SHOT_SWEEP + 1][RIG_MAX_CAMERAS];
    struct plan_footprint *footprints; /* of each camera; NULL until they are needed */
    /* shots × cameras, as planned; 0 if a shot is not to be taken; NULL until they are needed */
    float *shot_bytes;
    double stored_bytes; /* on disk, including the rows of the frames */
    /* of the whole session: the present value, and the value in the last event */
    double expected_bytes, said_bytes;
    struct shots_left *plan_left; /* before each of remaining and after the last; or NULL */
    struct { /* of each kind of shots: how much longer they took than planned, and how many did */
        double late_s;
        int n;
    } learnt[SHOT_SWEEP + 1];
    guint left_n;             /* exposed shots of remaining when the time left was predicted */
    double left_s, left_at_s; /* predicted time left, and when it was predicted */
    double left_least_s;      /* lower bound of the time left until the next exposure */
    struct event_limit retake_limits[RIG_MAX_CAMERAS], saturated_limits[RIG_MAX_CAMERAS];
    struct latest_picture latest[RIG_MAX_CAMERAS];
    guint32 moved;     /* the movements for which the session was paused: bits of capture_marks.c */
    guint32 suspected; /* bits of the movements that the previous shot seemed to show */
    GQueue *marks;     /* of GArray of struct fiducial_seen: of the last shots */
    gboolean marks_reported; /* the first check of the fiducials has been reported */
    guint changed_source;
    gint64 changed_at_us;
    guint starter;
};

/* What is left before each of n shots and after the last: n + 1 elements; g_free(). */
struct shots_left *capture_plan_left(const Capture *capture,
                                     const struct session_shot *const *shots, guint n);
/* The time that it will take if shots are as late as those of their kind were so far. */
double capture_left_s(const Capture *capture, const struct shots_left *left);

/* Returns the seconds of the rig's clock during which this session ran, including earlier runs. */
double capture_now_s(const Capture *capture);

/* Adds an event to the session if the disk has room for it, and passes it to the listener. */
void capture_add_event(Capture *capture, const char *level, const char *source,
                       const char *message);
void capture_save_value(Session *session, const char *key, double value);

/* Counts the shots of the session that will be taken as far as is known. Skipped shots and shots
 * that are not chosen yet are not counted. */
void capture_count(Capture *capture);

extern const struct intake_hooks capture_intake_hooks;
extern const struct adaptive_hooks capture_adaptive_hooks;
extern const struct sequencer_hooks capture_sequencer_hooks;

/* Starts taking the remaining shots, from the main loop. */
void capture_begin_soon(Capture *capture);

/* Drops the frames in flight, and changes and stores the state. The rig must be safe, or must
 * already be going into the safe state. */
void capture_pause_for(Capture *capture, enum capture_fault fault, const char *source,
                       const char *reason);
void capture_come_to_rest(Capture *capture, enum capture_state state);
void capture_set_state(Capture *capture, enum capture_state state);
void capture_clear_flights(Capture *capture);
void capture_start_clock(Capture *capture);
void capture_flight_free(gpointer flight);
