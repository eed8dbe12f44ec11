/* Options, errors, exit codes and JSON output, for all commands of the command line. */
#pragma once

#include "base/output_file.h"
#include "record.h"

enum { CLI_DONE = 0, CLI_FAILED = 1, CLI_USAGE = 2 };

/* One call of a command, after its options were parsed. */
struct call {
    const struct command *command;
    char *const *arguments; /* the positional ones; NULL behind the last */
    int n_arguments;
    Record *record; /* is printed when the command has run */
};

/* A row of the table of commands; each command has a file of its own. */
struct command {
    const char *name, *arguments, *help;
    const char *examples;        /* for people, a line each with two blanks before it */
    const GOptionEntry *options; /* its own, or NULL */
    const GOptionEntry *(*list_options)(
        void);        /* in place of options: made when they are asked for */
    gboolean daemon;  /* --address and --bus, too */
    gboolean streams; /* --json prints progress, too: an object a line, the result last */
    gboolean writes;  /* it writes a file that the user names, and has --force */
    int min, max;     /* number of positional arguments */

    /* Returns an exit code and fills call->record. With an error set, cli_run() prints it, and the
     * exit code is CLI_FAILED. */
    int (*run)(const struct call *call, GError **error);

    /* In place of run: parses its own arguments. argv[0] is the name of the command. */
    int (*run_arguments)(const struct command *command, int argc, char **argv);
    const struct command *const
        *children; /* its commands, named "PARENT CHILD", ending with NULL */
};

/* The tables of a command's options: its own, those of the daemon's address, --force, --json; ends
 * with NULL. */
#define CLI_TABLES 5
void cli_tables(const struct command *command, const GOptionEntry *ret[CLI_TABLES]);

/* Parses the options, runs the command, and prints its record or its error. Returns an exit
 * code. */
int cli_run(const struct command *command, int argc, char **argv);

/* For run_arguments of a command that has children: runs the one that argv[1] names, or prints
 * their list. An exit code. */
int cli_run_child(const struct command *parent, int argc, char **argv);

extern gboolean cli_json;    /* --json was given */
extern gboolean cli_streams; /* of the command that runs */
extern gboolean cli_force;   /* --force was given: an output may replace what is there */

/* output_file_new() with --force: call it before long work. */
OutputFile *cli_output(const char *path, const char *kind, GError **error);
/* The same with a lock: output_file_new_locked(). */
OutputFile *cli_output_locked(const char *path, const char *kind, GError **error);
/* A product of a session, which Mesorig names: a link of that name is replaced, not followed. */
OutputFile *cli_output_product(const char *path, const char *kind, GError **error);
/* Says whether the output has replaced a file. */
void cli_tell_output(Record *to, const OutputFile *file);

/* The same decision for a folder of several files: FALSE, with DATA_ERROR_EXISTS, if something has
 * its name, even if only a link that leads nowhere, unless it is a folder and --force was given. */
gboolean cli_check_folder(const char *path, GError **error);

/* --address and --bus, for commands that talk to a daemon. */
extern char *cli_address, *cli_bus;

/* Makes g_print() and g_printerr() write "×" as "x", not as "?", where the locale has no such
 * letters, as in a container or over a bare serial line. Also keeps control characters and
 * bidirectional overrides, which files and databases of others may hold, from the terminal. */
void cli_print_readably(void);

/* Makes a program whose output could not be written, for instance to a full disk, report that as it
 * ends and exit with CLI_FAILED. */
void cli_check_output_at_exit(void);

/* Prints to stderr what is wrong with the call; returns CLI_USAGE. */
int cli_usage(const struct command *command, const char *format, ...) G_GNUC_PRINTF(2, 3);
