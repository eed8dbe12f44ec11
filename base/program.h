/* What the programs of Mesorig share: their command line, and how they find each other. The
 * functions that find programs may be called from any thread, the others from the main thread. */
#pragma once

#include <glib.h>

G_BEGIN_DECLS

/* Returns the path of a program. The program is searched for next to this executable, in
 * ../libexec/mesorig relative to it, and in PATH. Free the path with g_free(). Returns NULL with
 * G_FILE_ERROR_NOENT if the program is not found. */
char *program_find(const char *name, GError **error);

/* The same as program_find() for a shared object that this program loads. PATH is not searched. */
char *program_find_module(const char *name, GError **error);

/* Sets the user's character set and sort order. Numbers keep their decimal point in any locale, in
 * files, in JSON and on the command line. Call it at the beginning of main(), instead of
 * setlocale(). */
void program_set_locale(void);

/* The command line of a program. Commands of “mesorig” are described in cli/common/cli.h. */
struct command_line {
    const char *name;      /* "mesorig-web" */
    const char *arguments; /* "SCENE.gltf"; NULL if the program takes only options */
    /* Text above the options in --help, or NULL. description is the text below the options, or
     * NULL. */
    const char *summary;
    const char *description;
    const GOptionEntry *options; /* --version is added */
    gpointer data;               /* for callbacks in options */
    int min, max;                /* minimum and maximum number of arguments */
};

/* Sets the locale and reads the options. The arguments are left in argv, from argv[1] on. For
 * --help and --version, prints the answer and ends the program. On bad usage, prints an error and
 * ends the program. */
void program_parse(const struct command_line *line, int *argc, char ***argv);

/* Prints an error about the command line to standard error. Returns the exit code 2. */
int program_usage(const struct command_line *line, const char *format, ...) G_GNUC_PRINTF(2, 3);

G_END_DECLS
