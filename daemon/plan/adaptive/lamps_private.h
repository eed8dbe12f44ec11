/* Shared by lamps.c, which chooses while a session is captured, and expected.c, which tells before
 * what a session is expected to bring. */
#pragma once

#include "lamps.h"
#include "selection/prediction.h"

struct Lamps {
    struct lamps_setup setup;
    int n_views, n_lights, n_probes;
    int *texels;                       /* n_probes, of the grid */
    struct vec3 *views, *lights;       /* directions in the sample's frame */
    struct vec3 *views_mm, *lights_mm; /* where the camera and the lamp stand there */
    struct vec3 *at_mm;                /* of each probe */
    int *groups;  /* of each pair of a view and a light: the shot that shows it; or none's number */
    int *pair_of; /* of each shot and camera; −1: it shows none */
    float *
        *values; /* of each pair, n_probes × 3: R, G, B, where the lamp gives what the calibration
                    says; NAN: a hole. NULL: not taken. Readers set them, each another one */
    double *output;  /* of each shot: what the lamp gave in it, relative to the calibration */
    gboolean *done;  /* of each shot */
    double *price_s; /* of each shot, since the first choice; NULL before */
    GCancellable *cancellable;
};

/* Without a session and readers: for a plan. views, lights: of struct session_direction. */
Lamps *lamps_make(const struct lamps_setup *setup, const GPtrArray *views, const GPtrArray *lights);

/* n_probes × 3 × pairs, NAN: not taken. Of more pictures than the predictor can work with as many
 * as it can are given, evenly spread; the others count as predicted in the expected error. */
float *lamps_table(const Lamps *lamps, int *ret_taken);

/* All pairs, as the predictor takes them; they stay the Lamps'. */
struct prediction_pairs lamps_pairs(const Lamps *lamps);

#define CHAIN          12 /* shots of a chain, at most, of a pass of the turntable */
#define CHAIN_STANDING 4  /* if it stands for each shot: others follow as quickly */

/* A choice takes one of these: a shot by itself, or a chain of shots that follow each other
 * quickly, since a shot alone costs more than one of several between which the axes move little. */
struct lamps_candidates {
    GArray *numbers;               /* of int: the shots that are left, from 0 */
    int n;                         /* candidates */
    struct prediction_shot *shots; /* as many */
    int (*chains)[CHAIN];          /* as many: indices of numbers; those behind the end: −1 */
    int *pairs;                    /* that the shots point to */
    int n_pairs;
};

/* Lists candidates among the shots that are not done; of many shots it looks at an evenly spread
 * part. In the choosing thread. */
struct lamps_candidates lamps_list_candidates(Lamps *lamps);
void lamps_clear_candidates(struct lamps_candidates *candidates);

/* The shots of the chosen candidates, each once, until they are most or the error is low enough.
 * ret_shots, ret_errors: room for most. */
int lamps_list_chosen(const struct lamps_candidates *left, const struct prediction_choice *choices,
                      int n_choices, int most, double enough, int *ret_shots, double *ret_errors);
