/*
 * Checks whether a session directory agrees with its database, with SQLite and GLib only and
 * without the code of sessions. Reads a copy of the database, so that the session stays as a killed
 * daemon has left it.
 */
#pragma once

#include <glib.h>

#include "scene.h"

/* What a session holds. */
struct store {
    GHashTable *frames;   /* path → SHA-256 by the rows */
    GHashTable *products; /* path → SHA-256 of the files */
    int done, planned;    /* shots */
    char *state, *reason; /* values; NULL: not set */
    char *rounds;         /* of sweeps, with their shots, and the shots that were left out */
};

struct store *store_new(void);
void store_free(struct store *store); /* NULL is ignored */

/* Fills ret, and reports what is broken to the scene. reference: of an undisturbed run, or NULL.
 * damaged: a set of paths whose files the simulation has damaged; those that are whole again are
 * removed. scratch: a folder for the copy. FALSE: the session is not there. */
gboolean store_check(struct scene *scene, const struct store *reference, GHashTable *damaged,
                     const char *scratch, struct store *ret);

/* Every product, and no other, is as in the reference; and no temporary file is left. */
void store_check_products(struct scene *scene, const struct store *reference);

/* The SHA-256 of every file of products/ whose name ends in .exr, by its path. */
void store_read_products(const struct scene *scene, struct store *store);

/* That the world's cameras saw what the plan asks for: pose, lamp and laser of every shot. */
void store_check_exposures(struct scene *scene, const char *scratch);
