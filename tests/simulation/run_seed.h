/*
 * One simulated run: the lives of a seed's schedule, the checks after each, and the life that must
 * finish. A process that has forked no thread calls it: every life is forked from it.
 */
#pragma once

#include "scene.h"

/* Kinds of lives, as bits: those of a capture, and the one on the bus. */
enum seed_lives { LIVES_CAPTURE = 1, LIVES_BUS = 2, LIVES_BOTH = 3 };

struct seed_result {
    guint32 seed;
    gboolean ok;
    char violation[512]; /* "invariant: how it is broken" */
    int life;            /* after which it was found, from 1; 0: the one on the bus */
    int lives, kills, cuts, failed_calls, rotten, misplaced;
    int served, bus_calls; /* lives on the bus, and what their clients called */
    guint64 digest;        /* of everything that happened, in order; 0: the order is not fixed */
};

/* The folder in which runs are made, and undisturbed ones of every session to compare with, if
 * lives of captures are to be run. */
typedef struct Reference Reference;
/* ret_broken: what is broken in an undisturbed run, or NULL; g_free() */
Reference *reference_new(const char *folder, enum seed_lives lives, char **ret_broken);
void reference_free(Reference *reference); /* NULL is ignored; the folder stays */

/* session: 0 … SCHEDULE_SESSIONS − 1, or −1: the seed decides. said: what is printed of it, or
 * NULL. */
void run_seed(const Reference *reference, guint32 seed, enum seed_lives lives, int session,
              GString *said, struct seed_result *ret);
