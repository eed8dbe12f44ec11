/* The shots that this run of a session takes, in their order. The struct is owned by the Capture.
 * All functions belong to the main loop's thread. */
#pragma once

#include "session/session.h"

struct run_shots {
    /* All shots of the run, as struct session_shot. The session owns them. NULL before the first
     * run. */
    GPtrArray *list;
    guint n_committed; /* number of shots that are stored; they are the first ones of `list` */
    /* Number of shots at the beginning of `list` that are held until the lasers are checked, and
     * then stored together (capture_lasers.h). */
    guint n_held;
    GPtrArray *leg; /* the first shots of `list`, up to the next mounting of a laser */
};

/* Begins a run with an empty list. The leg is not changed. */
void run_shots_begin(struct run_shots *run);
void run_shots_clear(struct run_shots *run);

/* Sets the leg to the first n shots of the list. */
void run_shots_set_leg(struct run_shots *run, guint n);

/* Returns the shots that are not stored yet. *ret_n is their number. The array is valid until
 * `list` changes. */
const struct session_shot *const *run_shots_left(const struct run_shots *run, guint *ret_n);

/* Returns how many shots are stored together with the next one, including that one. This is 1, or
 * the number of all shots that are held until the lasers are checked. */
guint run_shots_n_together(const struct run_shots *run);
