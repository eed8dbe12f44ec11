/* Options, errors, exit codes and JSON output, for all commands of the command line. */
#pragma once

#include "base/output_file.h"
#include "record.h"

enum { CLI_DONE = 0, CLI_FAILED = 1, CLI_USAGE = 2 };

/* One call of a command, after its options have been parsed. */
struct call {
    const struct command *command;
    char *const *arguments; /* the positional arguments, with NULL after the last */
    int n_arguments;
    Record *record; /* result of the command: the command fills it, and cli_run() prints it */
};

/* A row of the table of commands. Each command has its own file. */
struct command {
    const char *name, *arguments, *help;
    const char *examples;        /* text for --help; each line begins with two blanks */
    const GOptionEntry *options; /* the options of the command, or NULL */
    const GOptionEntry *(*list_options)(
        /* used instead of `options`: returns the table, which is made when it is needed */
        void);
    gboolean daemon; /* the command also has --address and --bus */
    /* with --json, also prints progress: one object per line, and the result last */
    gboolean streams;
    /* the command writes a file that the user names, and has the option --force */
    gboolean writes;
    int min, max; /* number of positional arguments */

    /* Fills call->record and returns an exit code. If the function sets error, cli_run() prints the
     * error, and the exit code is CLI_FAILED. */
    int (*run)(const struct call *call, GError **error);

    /* Used instead of `run` if the command parses its own arguments. argv[0] is the name of the
     * command. */
    int (*run_arguments)(const struct command *command, int argc, char **argv);
    const struct command *const
        *children; /* the commands of this command, named "PARENT CHILD"; ends with NULL */
};

/* Lists the tables of a command's options in ret, with NULL after the last. The tables are those of
 * its own options, of the daemon's address, of --force and of --json. */
#define CLI_TABLES 5
void cli_tables(const struct command *command, const GOptionEntry *ret[CLI_TABLES]);

/* Parses the options, runs the command, and prints its record or its error. With --json, the record
 * or the error is printed to stdout as JSON. Without --json, the error is printed to stderr. The
 * record is not printed if the exit code is CLI_USAGE. Returns an exit code. */
int cli_run(const struct command *command, int argc, char **argv);

/* For run_arguments of a command that has children. Runs the child that argv[1] names, or prints
 * the list of children. Returns an exit code. */
int cli_run_child(const struct command *parent, int argc, char **argv);

extern gboolean cli_json;    /* --json was given */
extern gboolean cli_streams; /* `streams` of the command that is running */
extern gboolean cli_force;   /* --force was given: an output may replace an existing file */

/* Calls output_file_new(), with --force if it was given. Call it before long work. */
OutputFile *cli_output(const char *path, const char *kind, GError **error);
/* Calls output_file_new_locked(), with --force if it was given. */
OutputFile *cli_output_locked(const char *path, const char *kind, GError **error);
/* The same as cli_output_locked(), for a product of a session, whose name Mesorig has chosen. If a
 * symbolic link has this name, the link itself is replaced. */
OutputFile *cli_output_product(const char *path, const char *kind, GError **error);
/* Tells the user if the output has replaced a file. The JSON always gets the value "replaced", TRUE
 * or FALSE. */
void cli_tell_output(Record *to, const OutputFile *file);

/* Checks whether a folder of several files may be written, as cli_output() does for one file.
 * Returns FALSE with DATA_ERROR_EXISTS if something of that name exists. There is one exception:
 * with --force, an existing folder is accepted. A symbolic link without a target also counts as
 * existing. */
gboolean cli_check_folder(const char *path, GError **error);

/* Values of --address and --bus, for commands that talk to a daemon. */
extern char *cli_address, *cli_bus;

/* Makes g_print() and g_printerr() suitable for any terminal. If the locale lacks letters such as
 * "×", as in a container or over a serial line, "x" is written instead of "?". Control characters
 * and bidirectional overrides are replaced, because files and databases of other people may contain
 * them. */
void cli_print_readably(void);

/* Makes the program report when its output could not be written, for instance to a full disk. The
 * program then exits with CLI_FAILED. */
void cli_check_output_at_exit(void);

/* Prints to stderr how the call is wrong. Returns CLI_USAGE. */
int cli_usage(const struct command *command, const char *format, ...) G_GNUC_PRINTF(2, 3);
