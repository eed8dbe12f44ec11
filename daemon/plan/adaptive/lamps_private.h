/* Declarations that two files share: lamps.c, which chooses shots while a session is captured, and
 * expected.c, which predicts the result of a session before it begins. */
#pragma once

#include "lamps.h"
#include "selection/session_pairs.h"

struct Lamps {
    struct lamps_setup setup;
    int n_probes;
    int *texels;        /* n_probes: index of the texel of each probe in the grid, row by row */
    struct vec3 *at_mm; /* position of each probe in the sample frame */
    struct session_pairs *pairs;
    /* For each pair: n_probes × 3 reflectances R, G, B, with the lamp output of the calibration.
     * NAN is a hole. NULL if the pair is not measured. No two jobs of the readers set the same
     * pair. */
    float **values;
    double *output; /* for each shot: output of its lamp, relative to the calibration */
    gboolean *done; /* for each shot: whether it is a shot of a lamp and done */
    /* for each shot: its price (plan_lamp_prices_s()); NULL before the first choice */
    double *price_s;
    GCancellable *cancellable;
};

/* Makes a Lamps for a plan, without a session and readers. views and lights contain struct
 * session_direction. */
Lamps *lamps_make(const struct lamps_setup *setup, const GPtrArray *views, const GPtrArray *lights);

/* Returns the reflectances of all pairs, relative to the output of the lamp in each shot. The table
 * has n_probes × 3 rows with one value for each pair; g_free(). The values of pictures that are not
 * taken are NAN. *ret_taken is the number of pictures that are taken.
 *
 * The predictor can use at most PREDICTION_MAX_MEASURED pictures. If more are taken, only an evenly
 * spread part of them is given. The others then count as predicted in the expected error. */
float *lamps_table(const Lamps *lamps, int *ret_taken);

/* Maximum number of shots of a chain: CHAIN if the chain is in a pass of the turntable,
 * CHAIN_STANDING if the turntable stops at each shot. */
#define CHAIN          12
#define CHAIN_STANDING 4

/* The candidates of a choice. A candidate is one shot, or a chain of shots between which the axes
 * move little. A shot of a chain costs less than a single shot. */
struct lamps_candidates {
    GArray *numbers;               /* of int: indices of the remaining shots in setup.shots */
    int n;                         /* number of candidates */
    struct prediction_shot *shots; /* n */
    /* n: the shots of each candidate as indices into numbers; −1 fills the rest */
    int (*chains)[CHAIN];
    int *pairs; /* storage for the pairs of all candidates */
    int n_pairs;
};

/* Lists candidates among the shots that are not done. If there are many shots, only an evenly
 * spread part of them become single candidates and begin chains. To be called only by the thread
 * that chooses. */
struct lamps_candidates lamps_list_candidates(Lamps *lamps);
void lamps_clear_candidates(struct lamps_candidates *candidates);

/* Lists the shots of the chosen candidates, each once, until there are `most` of them, or the
 * expected error is at most `enough`. Returns the number of shots. ret_shots gets their indices in
 * setup.shots. ret_errors[i] is the expected error after the candidate of shot i. Errors are as
 * prediction_error() returns them, not in percent. ret_shots and ret_errors have room for `most`.
 */
int lamps_list_chosen(const struct lamps_candidates *left, const struct prediction_choice *choices,
                      int n_choices, int most, double enough, int *ret_shots, double *ret_errors);
