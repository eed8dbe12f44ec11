/* Shows progress on standard error, so that standard output has results alone: a progress bar on a
 * terminal; elsewhere a line after a second, then one every ten seconds; nothing with --json. */
#pragma once

#include <glib.h>

typedef struct Progress Progress;

Progress *progress_new(const char *what);
void progress_free(Progress *progress); /* leaves the bar as it is; NULL is ignored */

/* Ends the line, so that others may print. */
void progress_end(Progress *progress);

/* fraction 0 … 1. Drawn at most ten times per second, unless now is set. text is printed beside the
 * bar. */
void progress_show(Progress *progress, double fraction, const char *text, gboolean now);

/* Sets the text that is drawn above the bar from the next drawing on, on a terminal alone: whole
 * lines, each no longer than the terminal is wide. */
void progress_set_above(Progress *progress, const char *text, int lines);

/* A line of its own on standard output, above the bar. Not printed with --json. */
void progress_line(Progress *progress, const char *format, ...) G_GNUC_PRINTF(2, 3);
