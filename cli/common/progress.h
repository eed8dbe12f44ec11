/* Shows progress on standard error, so that standard output contains only results. On a terminal,
 * progress is a bar. Elsewhere, progress is a line of text after one second and every ten seconds,
 * and after each call of progress_show() with `now` TRUE. With --json nothing is shown. */
#pragma once

#include <glib.h>

typedef struct Progress Progress;

Progress *progress_new(const char *what);
void progress_free(Progress *progress); /* leaves the bar on the screen; NULL is ignored */

/* Ends the line of the bar, so that other text may be printed. */
void progress_end(Progress *progress);

/* Shows a fraction of 0 … 1, and text to the right of the bar. The bar is drawn at most ten times
 * per second. A call with `now` TRUE always draws it. */
void progress_show(Progress *progress, double fraction, const char *text, gboolean now);

/* Sets the text above the bar. It appears when the bar is drawn the next time, and only on a
 * terminal. The text consists of whole lines, none longer than the width of the terminal. lines is
 * their number. */
void progress_set_above(Progress *progress, const char *text, int lines);

/* Prints a line to standard output, above the bar. Not printed with --json. */
void progress_line(Progress *progress, const char *format, ...) G_GNUC_PRINTF(2, 3);
