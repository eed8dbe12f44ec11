/* The shots that this run of a session takes, in their order. Owned by the Capture. Main loop's
 * thread. */
#pragma once

#include "session/session.h"

struct run_shots {
    GPtrArray *list;   /* of struct session_shot; the session owns them; NULL before the run */
    guint n_committed; /* number of committed shots, which are the first ones of the list */
    guint n_held;      /* number of shots at the beginning of the list that are committed
                          together (capture_lasers.h) */
    GPtrArray *leg;    /* the shots of the list up to the next mounting of a laser */
};

/* Begins a run with an empty list. The leg is not changed. */
void run_shots_begin(struct run_shots *run);
void run_shots_clear(struct run_shots *run);

/* Sets the leg to the first n shots of the list. */
void run_shots_set_leg(struct run_shots *run, guint n);

/* Returns the array of the *ret_n shots that are not committed. It is valid until the list
 * changes. */
const struct session_shot *const *run_shots_left(const struct run_shots *run, guint *ret_n);

/* Returns the number of shots that are committed together with the next one: 1, or the number of
 * all shots that are held until the lasers are checked. */
guint run_shots_n_together(const struct run_shots *run);
