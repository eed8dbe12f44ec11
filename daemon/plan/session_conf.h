/*
 * The session file: what is to be captured. It is parsed strictly, and all of its mistakes are told
 * immediately; session.conf(5) has every key. Plain data; any thread.
 */
#pragma once

#include "base/options.h"
#include "frames/laser_lines.h"
#include "selection/coverage_model.h"
#include "session/session.h"

/* Directions are rings, or those of the devices that are named, as they stand with turntable and
 * arc at 0. */
struct ring { /* directions of one elevation: φ = offset + k·360/count */
    double theta_deg, offset_deg;
    int count;
};

#define PLAN_MAX_RINGS   32
#define PLAN_MAX_BRACKET 12

/* Keys of [capture] that may be "auto": whoever begins the session takes pictures on trial,
 * chooses, and writes the values into the session's text (session_conf_choose()). Until then the
 * struct holds upper bounds, which a plan is made of. */
enum auto_key { AUTO_EXPOSURES, AUTO_LASER, AUTO_SHORT, AUTO_KEYS };
extern const char *const auto_key_names[AUTO_KEYS]; /* "exposures_us", … */

#define AUTO_MAX_EXPOSURES 3 /* of a bracket */
#define AUTO_FACTOR        4 /* from one exposure to the next, at least */
#define AUTO_MAX_FACTOR    8 /* at most */

enum on_blocked { BLOCKED_SHIFT, BLOCKED_SKIP, BLOCKED_REFUSE };

/* ORDER_VIEWS: one turntable angle after the other, so that views are there long before the end. */
enum session_order { ORDER_QUICKEST, ORDER_VIEWS };

/* MOTION_CONTINUOUS: under lamps, pictures are taken while the turntable turns (passes/passes.h).
 */
enum session_motion { MOTION_STANDING, MOTION_CONTINUOUS };

/* STOP_COVERED: sweeps are taken in rounds until what is left adds little (adaptive/adaptive.h). */
enum laser_stop { STOP_ALL, STOP_COVERED };

/* SAMPLING_ADAPTIVE: of the shots of lamps those are taken, in rounds, that tell most of what is
 * not known yet; the other pictures are predicted (adaptive/adaptive.h). */
enum light_sampling { SAMPLING_ALL, SAMPLING_ADAPTIVE };

/* A session file, parsed strictly; see etc/demo/session.conf for every key. */
struct session_conf {
    char *name;
    char *prompt; /* what somebody has to do before it begins; empty: nothing */
    struct session_grid grid;
    struct laser_reference reference; /* around the sample; radius_mm 0: none */
    struct ring views[PLAN_MAX_RINGS], lights[PLAN_MAX_RINGS], lasers[PLAN_MAX_RINGS];
    int n_views, n_lights, n_lasers;           /* rings */
    char **views_of, **lights_of, **lasers_of; /* names of devices, or "all" of them; NULL: rings */
    double exposures_us[PLAN_MAX_BRACKET];     /* of lamp shots, ascending; with
                                                  keep_exposures some may be equal */
    int n_exposures;
    double laser_exposure_us;
    double laser_short_us;       /* of a second frame at each step of a sweep; 0: none */
    gboolean is_auto[AUTO_KEYS]; /* not chosen yet */
    double auto_longest_us;      /* what "auto" may choose at most */
    char *chosen; /* in its place, "exposures_us = 500; 2000, …"; NULL: nothing was auto */
    int sweep_steps;
    double sweep_margin_mm; /* the sheet sweeps the sample and this much on both sides */
    double gain_db;
    int dark_frames;           /* averaged for each exposure */
    int retries;               /* of one shot, before the session is paused */
    double saturated_pct;      /* pixels that may be saturated in the shortest exposure */
    double laser_threshold_dn; /* above background, for a peak to count */
    enum on_blocked on_blocked;
    enum session_order order;
    enum session_motion motion;
    double blur_texels; /* MOTION_CONTINUOUS: by which a point of the sample may move in an
                           exposure, at most */
    enum laser_stop laser_stop;
    int laser_first;       /* sweeps of the first round at each turntable angle, at most */
    double laser_gain_pct; /* what a further sweep must be expected to add to its views' texels */
    double laser_line_mm;  /* full width at half maximum of the lines at the origin; 0: unknown */
    enum light_sampling light_sampling;
    int light_first;         /* shots of the first round for each turntable angle, on average */
    double light_error_pct;  /* expected error of all values of the BTF that is enough */
    double light_budget_min; /* what the shots of lamps may take at most, by the plan's times, moves
                                between them counted and sweeps not; 0: any time */
    gboolean keep_laser_frames, keep_exposures;
    char *text; /* as it was read */
    char *path; /* for messages */
};

gboolean session_conf_load(struct session_conf *conf, const char *path, GError **error);
gboolean session_conf_parse(struct session_conf *conf, const char *text, const char *path,
                            GError **error);
/* Puts values in the place of "auto", in conf and in its text. chosen: lines "KEY = VALUE"; those
 * of keys that are not auto are ignored. FALSE: a value is wrong, or something is still auto. */
gboolean session_conf_choose(struct session_conf *conf, const char *chosen, GError **error);
/* FALSE: something is still auto. */
gboolean session_conf_check_chosen(const struct session_conf *conf, GError **error);
void session_conf_clear(struct session_conf *conf);

/* The keys of a section of a session file; NULL: there is no such section. */
const struct option *session_conf_options(const char *class_name);
typedef struct session_conf SessionConf;
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(SessionConf, session_conf_clear)
