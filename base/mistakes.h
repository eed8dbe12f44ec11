/*
 * Reports all mistakes of a file as one error. A reader adds each mistake and continues with the
 * next key, line or section. Only one thread at a time may use a Mistakes.
 */
#pragma once

#include <glib.h>

typedef struct Mistakes Mistakes;

#define MISTAKES_SHOWN                                                                             \
    20 /* the error lists at most this number of mistakes and counts the others */

Mistakes *mistakes_new(void);
void mistakes_free(Mistakes *mistakes); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Mistakes, mistakes_free)

/* Adds a mistake and takes ownership of it. NULL is ignored, and so is a mistake with the same text
 * as an earlier one. Always returns FALSE, so that a caller can return its value. */
gboolean mistakes_add(Mistakes *mistakes, GError *mistake);

guint mistakes_count(const Mistakes *mistakes);

/* Returns TRUE if there are no mistakes. Otherwise sets the error. A single mistake becomes the
 * error itself. Several become one error with the domain and code of the first one. The text of the
 * error is
 *     FILE: 3 mistakes:
 *     FILE:LINE: …
 * with one line for each mistake. The lines are ordered by error_details_line(); mistakes without a
 * line come last. */
gboolean mistakes_report(const Mistakes *mistakes, GError **error);
