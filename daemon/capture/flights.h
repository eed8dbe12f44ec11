/* Shots in flight: their frames are being processed by the intake, or they wait to be stored. A
 * shot is in flight from the first frame that is given to the intake until the shot is stored
 * (committed) or dropped. The shots are in the order in which they will be stored. The struct is
 * owned by the Capture. All functions belong to the main loop's thread. */
#pragma once

#include "intake/intake.h"

struct flight { /* a shot in flight */
    const struct session_shot *shot;
    struct camera_set back; /* cameras whose results have returned */
    struct session_frame frames[RIG_MAX_CAMERAS];
    double signals_dn[RIG_MAX_CAMERAS]; /* signal_dn of the result of each camera (intake.h) */
    /* maximum of signals_dn over the cameras that have returned */
    double signal_dn;
    /* Number of saturated pixels of each camera. It is 0 if there are too few for a warning. */
    gint64 saturated[RIG_MAX_CAMERAS];
    GArray *marks; /* of struct fiducial_seen, of all cameras; NULL if there are none */
};

struct flights {
    GQueue queue; /* of struct flight */
};

/* flights_find() returns the flight of a shot, or NULL if there is none. flights_add() returns it
 * too, and adds one at the end if there is none. */
struct flight *flights_find(const struct flights *flights, const struct session_shot *shot);
struct flight *flights_add(struct flights *flights, const struct session_shot *shot);

guint flights_n(const struct flights *flights);
/* Returns the flight with this index, or NULL. */
const struct flight *flights_at(const struct flights *flights, guint index);

/* Stores the result of a camera for the flight's shot. The result must have no error. */
void flight_take(struct flight *flight, const struct intake_result *result);

/* Return whether the results of all cameras have returned: flights_are_back() for all shots in
 * flight, and flights_first_are_back() for the first n shots. If fewer than n shots are in flight,
 * flights_first_are_back() returns FALSE. */
gboolean flights_are_back(const struct flights *flights);
gboolean flights_first_are_back(const struct flights *flights, guint n);

void flights_drop_first(struct flights *flights);
void flights_clear(struct flights *flights);
