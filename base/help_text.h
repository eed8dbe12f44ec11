/* The text of --help, laid out for a terminal of 80 columns. Main thread. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* Prints the help of a program and ends it with exit code 0 if its arguments ask for help (-h,
 * --help). Call it before g_option_context_parse(). */
void help_text_answer(GOptionContext *context, int argc, char **argv);

/* A line of a list: a name, and its description from column 24 on, broken into lines of at most 80
 * characters. A longer name has a line of its own. Ends with a newline; g_free(). */
char *help_text_row(const char *name, const char *description);

/* Breaks the lines of GLib's help in the same way; g_free(). */
char *help_text_lay_out(const char *help);

G_END_DECLS
