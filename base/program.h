/* The programs of Mesorig, for those that start each other. Any thread. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* The path of a program: beside this executable, in ../libexec/mesorig from there, or in PATH;
 * g_free(). NULL: G_FILE_ERROR_NOENT, which says what is not installed. */
char *program_find(const char *name, GError **error);

/* The same for a shared object that this program loads; not in PATH. */
char *program_find_module(const char *name, GError **error);

/* Takes the user's character set and sort order. Numbers keep their decimal point in any locale: in
 * files, in JSON and on the command line. At the begin of main(), instead of setlocale(). */
void program_set_locale(void);

G_END_DECLS
