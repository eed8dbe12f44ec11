/* Finds the name that a misspelt one means. Pure functions. */
#pragma once

#include <glib.h>

struct nearest {
    const char *key;  /* as it was written; borrowed */
    const char *name; /* the nearest so far, or NULL: none is near enough; borrowed */
    int distance;     /* its Levenshtein distance from key, or the first that is too large */
};

/* Accepts names in which at most a third of the letters and one, at most three, are wrong; of a key
 * of three letters one. */
struct nearest nearest_new(const char *key);
/* Replaces the nearest name if this one is nearer. Names and keys longer than 63 bytes are not
 * compared. */
void nearest_consider(struct nearest *nearest, const char *name);

/* If error is that of g_option_context_parse() for an unknown option, adds "; did you mean --NAME?"
 * with the option of the tables that is spelt most like it. For an unknown letter it names all
 * options that begin with the letter and have no letter of their own. Each table ends with a NULL
 * name, and tables with NULL. */
void nearest_add_option(GError *error, const GOptionEntry *const *tables);
