/* Shared by lamps.c, which chooses shots while a session is captured, and expected.c, which
 * predicts the result of a session before it begins. */
#pragma once

#include "lamps.h"
#include "selection/prediction.h"

struct Lamps {
    struct lamps_setup setup;
    int n_views, n_lights, n_probes;
    int *texels;                       /* n_probes: numbers of texels of the grid */
    struct vec3 *views, *lights;       /* directions in the sample frame */
    struct vec3 *views_mm, *lights_mm; /* positions of the camera and of the lamp */
    struct vec3 *at_mm;                /* position of each probe */
    /* For each pair of a view and a light: the id of the shot that shows the pair, or −1 − pair if
     * none does. Pairs with the same number are taken together. */
    int *groups;
    int *pair_of; /* for each shot and camera: the pair that it shows, or −1 */
    /* For each pair: n_probes × 3 reflectances R, G, B, with the lamp output of the calibration.
     * NAN is a hole. NULL if the picture is not taken. Each job of the readers sets other pairs. */
    float **values;
    double *output;  /* for each shot: output of its lamp, relative to the calibration */
    gboolean *done;  /* for each shot */
    double *price_s; /* for each shot; NULL before the first choice */
    GCancellable *cancellable;
};

/* Makes a Lamps for a plan, without a session and readers. views and lights contain struct
 * session_direction. */
Lamps *lamps_make(const struct lamps_setup *setup, const GPtrArray *views, const GPtrArray *lights);

/* Returns the values of all pairs, n_probes × 3 × pairs. The values of pictures that are not taken
 * are NAN. If there are more pictures than the predictor can use, an evenly spread part of them is
 * given. The other pictures then count as predicted in the expected error. */
float *lamps_table(const Lamps *lamps, int *ret_taken);

/* Returns all pairs for the predictor. The Lamps owns the arrays. */
struct prediction_pairs lamps_pairs(const Lamps *lamps);

/* Maximum number of shots of a chain in a pass of the turntable, and of a chain for which the
 * turntable stops at each shot. */
#define CHAIN          12
#define CHAIN_STANDING 4

/* The candidates of a choice. A candidate is one shot, or a chain of shots between which the axes
 * move little. A shot of a chain costs less than a single shot. */
struct lamps_candidates {
    GArray *numbers;               /* of int: the remaining shots, from 0 */
    int n;                         /* number of candidates */
    struct prediction_shot *shots; /* n */
    int (*chains)[CHAIN];          /* n: indices into numbers, then −1 */
    int *pairs;                    /* the pairs to which the shots point */
    int n_pairs;
};

/* Lists candidates among the shots that are not done. If there are many, it uses an evenly spread
 * part of them. Belongs to the thread that chooses. */
struct lamps_candidates lamps_list_candidates(Lamps *lamps);
void lamps_clear_candidates(struct lamps_candidates *candidates);

/* Lists the shots of the chosen candidates, each once, until there are most of them or the error is
 * at most enough. ret_shots and ret_errors have room for most. Returns the number of shots. */
int lamps_list_chosen(const struct lamps_candidates *left, const struct prediction_choice *choices,
                      int n_choices, int most, double enough, int *ret_shots, double *ret_errors);
