/* The text of --help, laid out for a terminal of 80 columns. Only the main thread may call the
 * functions. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* If the arguments ask for help (-h, --help), prints the help of the program and ends the program
 * with exit code 0. Call it before g_option_context_parse(). */
void help_text_answer(GOptionContext *context, int argc, char **argv);

/* Returns an entry of a list: the name, and from column 24 on the description, in lines of at most
 * 80 characters. "\v" in the description begins a new line. If the name reaches column 23, the
 * description begins on the next line. A name that is longer than a line is broken at "|". The text
 * ends with a newline. Free it with g_free(). */
char *help_text_row(const char *name, const char *description);

/* Lays out GLib's help for 80 columns: entries of lists as help_text_row() does, and other lines
 * broken between words. A line of an example that is too long is broken with "\", as a shell
 * allows. Free the result with g_free(). */
char *help_text_lay_out(const char *help);

G_END_DECLS
