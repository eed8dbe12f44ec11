/* Shots in flight: their frames are being processed by the intake, in the order in which the shots
 * are to be committed. Owned by the Capture. A flight lives from the first frame that is given to
 * the intake until its shot is committed or dropped. Main loop's thread. */
#pragma once

#include "intake/intake.h"

struct flight { /* a shot */
    const struct session_shot *shot;
    guint32 back; /* bits of cameras whose results have returned */
    struct session_frame frames[RIG_MAX_CAMERAS];
    double signals_dn[RIG_MAX_CAMERAS];
    double signal_dn;                  /* maximum of all cameras */
    gint64 saturated[RIG_MAX_CAMERAS]; /* pixels; 0 if they are too few for a warning */
    GArray *marks; /* of struct fiducial_seen, of all cameras; NULL if there are none */
};

struct flights {
    GQueue queue; /* of struct flight */
};

/* Returns the flight of a shot. flights_find() returns NULL if there is none, flights_add() adds
 * one. */
struct flight *flights_find(const struct flights *flights, const struct session_shot *shot);
struct flight *flights_add(struct flights *flights, const struct session_shot *shot);

guint flights_n(const struct flights *flights);
/* Returns the flight with this index, or NULL. */
const struct flight *flights_at(const struct flights *flights, guint index);

/* Stores what a camera has returned without an error. */
void flight_take(struct flight *flight, const struct intake_result *result);

/* Return whether all cameras have returned for all shots in flight, and for the first n shots,
 * which must be in flight. */
gboolean flights_are_back(const struct flights *flights);
gboolean flights_first_are_back(const struct flights *flights, guint n);

void flights_drop_first(struct flights *flights);
void flights_clear(struct flights *flights);
