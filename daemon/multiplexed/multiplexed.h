/*
 * Several lamps at once ([lights] multiplex): which shots of a session are taken with patterns of
 * their lamps, of which order, and for which part of the exposures. multiplex/multiplex.h has the
 * formulas, session/session.h what a group of shots is.
 *
 * The noise of a camera is that of a grey diffuser in the middle of the sample, under the mean of
 * the session's lamps. Of all cameras the one that needs most time counts. Pure functions.
 */
#pragma once

#include "calibration/calibration.h"
#include "multiplex/multiplex.h"
#include "rig/devices.h"
#include "session/session.h"

/* [lights] multiplex: how many lamps are in a group, an order of a matrix; or: */
enum { MULTIPLEX_AUTO = -1, MULTIPLEX_NO = 0 };

/* Reads "no", "auto" or a number. FALSE: ret_why says what is wrong with it; g_free(). */
gboolean multiplexed_parse(const char *text, int *ret_wanted, char **ret_why);

struct multiplexed_setup {
    int wanted; /* of [lights] multiplex */
    const double *exposures_us;
    int n_exposures;
    double gain_db, reference_mm;
    const struct rig *rig;
    const struct rig_timing *timing;
    const struct calibration *calibration; /* what is known of light and noise; NULL: nothing */
    GArray *shots; /* of struct session_shot; pose: the same number in the same pose */
};

struct multiplexed_choice {
    int n;                       /* lamps of a group; 0: each alone */
    int groups;                  /* how many; set by multiplexed_apply() */
    double part;                 /* of the exposures */
    double noise_pct, alone_pct; /* expected of the grey in a pixel, of its value; 0: not known */
    gboolean bright;             /* a white sample may saturate the shortest exposure */
    char *why;                   /* wanted is MULTIPLEX_AUTO and n is 0; owned */
};

/* FALSE: the number that is wanted is not possible, ret_why says why; g_free(). */
gboolean multiplexed_choose(const struct multiplexed_setup *setup, struct multiplexed_choice *ret,
                            char **ret_why);

/* Fills in struct session_multiplex of the shots. */
void multiplexed_apply(const struct multiplexed_setup *setup, struct multiplexed_choice *choice);

/* Takes it back: each lamp alone, for a reason. */
void multiplexed_undo(GArray *shots, struct multiplexed_choice *choice, const char *why);

/* For the plan's notes: what was chosen, or why nothing was; times with it and without. g_free() */
char *multiplexed_note(const struct multiplexed_choice *choice, double multiplexed_s,
                       double alone_s);

/* Takes all shots of groups but the first of each out of an array of struct session_shot, so that
 * it can be put into an order, and puts them back behind their first ones, with the same pose. */
GArray *multiplexed_take_followers(GArray *shots);
void multiplexed_put_back(GArray *shots, GArray *followers);

/* How long the lamps of a shot take to warm up of which the shot before, if any, has left off. */
double multiplexed_warm_up_s(const struct session_shot *previous, const struct session_shot *shot,
                             const struct rig *rig, const struct rig_timing *timing);
/* The same for the frame that ends a group, after the pattern of its last shot, in which the
 * group's other lamps are lit; 0 for other shots. */
double multiplexed_check_s(const struct session_shot *shot, const struct rig_timing *timing);

/* Why shots (struct session_shot *) of an existing session cannot be taken with this rig any more;
 * g_free(). NULL: they can. */
char *multiplexed_refused(const GPtrArray *shots, const struct rig_timing *timing);
