/*
 * The session file, which says what is to be captured. It is parsed strictly. An error lists all of
 * its mistakes. session.conf(5) describes every key. The struct is plain data, and any thread may
 * call the functions.
 */
#pragma once

#include "base/options.h"
#include "frames/laser_lines.h"
#include "selection/coverage_model.h"
#include "session/session.h"

/* A session file gives directions as rings, or names devices. The direction of a named device is
 * the one that it has with turntable and arc at 0. */
struct ring { /* directions of one polar angle: φ = offset + k·360/count */
    double theta_deg, offset_deg;
    int count;
};

#define PLAN_MAX_RINGS   256
#define PLAN_MAX_BRACKET 12

/* Keys of [capture] that may be "auto". The program that begins the session takes test shots,
 * chooses values, and writes them into the session's text (session_conf_choose()). Until then the
 * struct contains upper bounds, from which a plan can be made. */
enum auto_key { AUTO_EXPOSURES, AUTO_LASER, AUTO_SHORT, AUTO_KEYS };
extern const char *const auto_key_names[AUTO_KEYS]; /* "exposures_us", … */

#define AUTO_MAX_EXPOSURES 3 /* number of exposures of a bracket */
/* AUTO_FACTOR is the factor between two successive exposures that a plan assumes. AUTO_MAX_FACTOR
 * is the maximum factor between two successive exposures that are chosen. */
#define AUTO_FACTOR     4
#define AUTO_MAX_FACTOR 8

/* What the plan does with a pose at which the light arc stands in a camera's picture: turn the arc
 * a little, skip the shots of the pose, or fail. */
enum on_blocked { BLOCKED_SHIFT, BLOCKED_SKIP, BLOCKED_REFUSE };

/* ORDER_VIEWS takes one turntable angle after the other, so that the first views are complete long
 * before the end. */
enum session_order { ORDER_QUICKEST, ORDER_VIEWS };

/* With MOTION_CONTINUOUS, pictures under lamps are taken while the turntable turns (passes.h). */
enum session_motion { MOTION_STANDING, MOTION_CONTINUOUS };

/* With STOP_COVERED, sweeps are taken in rounds until further sweeps add little
 * (adaptive/adaptive.h). */
enum laser_stop { STOP_ALL, STOP_COVERED };

/* With SAMPLING_ADAPTIVE, only the most informative shots of lamps are taken, in rounds. The other
 * pictures are predicted (adaptive/adaptive.h). */
enum light_sampling { SAMPLING_ALL, SAMPLING_ADAPTIVE };

/* The values of a session file. session.conf(5) describes the keys. */
struct session_conf {
    char *name;
    char *prompt; /* what a user must do before the session begins; empty for nothing */
    struct session_grid grid;
    struct laser_reference reference; /* flat face around the sample; radius_mm is 0 for none */
    struct ring views[PLAN_MAX_RINGS], lights[PLAN_MAX_RINGS], lasers[PLAN_MAX_RINGS];
    int n_views, n_lights, n_lasers;           /* numbers of rings */
    char **views_of, **lights_of, **lasers_of; /* names of devices, or "all"; NULL for rings */
    /* Exposures of lamp shots, ascending. With keep_exposures some may be equal. */
    double exposures_us[PLAN_MAX_BRACKET];
    int n_exposures;
    double laser_exposure_us;
    double laser_short_us; /* exposure of a second frame at each step of a sweep; 0 for none */
    gboolean is_auto[AUTO_KEYS]; /* the key is "auto", and its value is not chosen yet */
    double auto_longest_us;      /* longest exposure that "auto" may choose */
    char *chosen; /* the chosen values, "exposures_us = 500; 2000, …"; NULL if nothing was auto */
    int sweep_steps;
    /* distance by which the laser sheet sweeps beyond the sample on both sides */
    double sweep_margin_mm;
    double gain_db;
    int dark_frames; /* number of frames that are averaged for each exposure */
    int retries;     /* number of repetitions of a picture before the session is paused */
    /* maximum share of saturated pixels in the shortest exposure, in % */
    double saturated_pct;
    double laser_threshold_dn; /* minimum height of the laser's peak above the background */
    enum on_blocked on_blocked;
    enum session_order order;
    enum session_motion motion;
    /* with MOTION_CONTINUOUS: maximum movement of a point of the sample during an exposure, in
     * texels */
    double blur_texels;
    enum laser_stop laser_stop;
    int laser_first; /* maximum number of sweeps of the first round at each turntable angle */
    /* minimum share of the texels of its views, in %, that a further sweep is expected to measure
     * for the first time */
    double laser_gain_pct;
    double laser_line_mm; /* full width at half maximum of the lines at the origin; 0 if unknown */
    enum light_sampling light_sampling;
    int light_first; /* mean number of shots of the first round at each turntable angle */
    /* expected error of the BTF in % (ADAPTIVE_ERROR_PCT in adaptive.h) below which no more shots
     * are taken */
    double light_error_pct;
    /* Maximum predicted time of the shots of lamps, including the moves between them and without
     * sweeps; 0 for no limit. */
    double light_budget_min;
    gboolean keep_laser_frames, keep_exposures;
    char *text; /* the file as it was read */
    char *path; /* path of the file, for messages */
};

/* Reads a session file, or a text of this form. path names the text in errors. On failure, *conf
 * contains nothing that needs to be freed. On success, free its members with session_conf_clear().
 */
gboolean session_conf_load(struct session_conf *conf, const char *path, GError **error);
gboolean session_conf_parse(struct session_conf *conf, const char *text, const char *path,
                            GError **error);
/* Replaces "auto" by values in conf and in its text. `chosen` has lines "KEY = VALUE". Lines of
 * keys that are not auto are ignored. Returns FALSE with an error if a value is wrong, and then
 * does not change conf. Also returns FALSE with an error if a key is still auto afterwards. */
gboolean session_conf_choose(struct session_conf *conf, const char *chosen, GError **error);
/* Returns FALSE with an error if a key is still auto. */
gboolean session_conf_check_chosen(const struct session_conf *conf, GError **error);
void session_conf_clear(struct session_conf *conf);

/* Returns the option table of the section [class_name] of a session file, or NULL if there is no
 * such section. */
const struct option *session_conf_options(const char *class_name);
typedef struct session_conf SessionConf;
G_DEFINE_AUTO_CLEANUP_CLEAR_FUNC(SessionConf, session_conf_clear)
