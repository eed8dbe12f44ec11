/* Finds the known name that is spelt most like a misspelt one. All functions are pure. */
#pragma once

#include <glib.h>

struct nearest {
    const char *key;  /* the misspelt name; borrowed */
    const char *name; /* the nearest name so far, or NULL if none is near enough; borrowed */
    /* Levenshtein distance of name from key. If name is NULL, the smallest distance at which a name
     * is not accepted. */
    int distance;
};

/* Begins a search. A name is accepted if its Levenshtein distance from key is at most 1 for a key
 * of n ≤ 3 bytes, and at most min(n / 3 + 1, 3) for a longer key. */
struct nearest nearest_new(const char *key);
/* Makes name the nearest name if it is accepted and nearer than the nearest name so far. Names and
 * keys longer than 63 bytes are not compared. */
void nearest_consider(struct nearest *nearest, const char *name);

/* Adds "; did you mean --NAME?" to error if it is the error of g_option_context_parse() for an
 * unknown option. NAME is the option of the tables that is spelt most like the unknown one. For an
 * unknown letter, the text names all options that begin with the letter and have no short form.
 * Does nothing if there is no such option. Each table ends with an entry whose long_name is NULL,
 * and tables ends with NULL. */
void nearest_add_option(GError *error, const GOptionEntry *const *tables);
