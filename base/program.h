/* Finds the programs of Mesorig, for programs that start each other. Any thread may call these
 * functions. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* Returns the path of a program. It is searched next to this executable, in ../libexec/mesorig
 * relative to it, and in PATH. Free it with g_free(). Returns NULL with G_FILE_ERROR_NOENT, which
 * says what is not installed. */
char *program_find(const char *name, GError **error);

/* The same for a shared object that this program loads. PATH is not searched. */
char *program_find_module(const char *name, GError **error);

/* Sets the user's character set and sort order. Numbers keep their decimal point in any locale, in
 * files, in JSON and on the command line. Call it at the beginning of main(), instead of
 * setlocale(). */
void program_set_locale(void);

G_END_DECLS
