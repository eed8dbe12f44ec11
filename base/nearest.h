/* Finds the name that a misspelt one means. Pure functions. */
#pragma once

#include <glib.h>

struct nearest {
    const char *key;  /* as it was written; borrowed */
    const char *name; /* the nearest so far, or NULL: none is near enough; borrowed */
    int distance;     /* its Levenshtein distance from key, or the first that is too large */
};

/* A third of the letters may be wrong, at most three. */
struct nearest nearest_new(const char *key);
/* Replaces the nearest name if this one is nearer. Names and keys longer than 63 bytes are not
 * compared. */
void nearest_consider(struct nearest *nearest, const char *name);
