/*
 * All mistakes of a file, reported as one error: a reader adds each and goes on with the next key,
 * line or section. Used by one thread at a time.
 */
#pragma once

#include <glib.h>

typedef struct Mistakes Mistakes;

#define MISTAKES_SHOWN 20 /* the error lists this many and only counts the others */

Mistakes *mistakes_new(void);
void mistakes_free(Mistakes *mistakes); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Mistakes, mistakes_free)

/* Adds a mistake and takes ownership of it; NULL is ignored, and so is a text that was added
 * before. Returns FALSE always, for a caller that fails with it. */
gboolean mistakes_add(Mistakes *mistakes, GError *mistake);

guint mistakes_count(const Mistakes *mistakes);

/* TRUE: there are no mistakes. Otherwise sets the error: a single mistake as it is; several as one
 * error with the domain and code of the first, whose text is
 *     FILE: 3 mistakes:
 *     FILE:LINE: …
 * with a line for each, ordered by error_details_line(); those without a line come last. */
gboolean mistakes_report(const Mistakes *mistakes, GError **error);
