/* Finds the known name that is spelt most like a misspelt one. All functions are pure. */
#pragma once

#include <glib.h>

struct nearest {
    const char *key;  /* the misspelt name; borrowed */
    const char *name; /* the nearest name so far, or NULL if none is near enough; borrowed */
    /* Levenshtein distance of name from key. If name is NULL, the smallest distance that is too
     * large. */
    int distance;
};

/* Begins a search. A name is accepted if the number of wrong letters is at most min(n / 3 + 1, 3)
 * for a key of n bytes, and at most 1 if n <= 3. */
struct nearest nearest_new(const char *key);
/* Replaces the nearest name if this one is nearer. Names and keys longer than 63 bytes are not
 * compared. */
void nearest_consider(struct nearest *nearest, const char *name);

/* Adds "; did you mean --NAME?" to error if it is the error of g_option_context_parse() for an
 * unknown option. NAME is the option of the tables that is spelt most like it. For an unknown
 * letter, the text names all options that begin with the letter and have no short form. Each table
 * ends with a NULL name, and tables ends with NULL. */
void nearest_add_option(GError *error, const GOptionEntry *const *tables);
