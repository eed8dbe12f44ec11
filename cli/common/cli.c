#include "cli.h"

#include "base/data_error.h"
#include "base/help_text.h"
#include "base/nearest.h"
#include "bus/bus_client.h"

#include <errno.h>
#include <glib/gstdio.h>
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <sys/stat.h>
#include <unistd.h>

gboolean cli_json, cli_streams, cli_force;
char *cli_address, *cli_bus;

static const GOptionEntry json_entries[] = {
    {"json", 0, 0, G_OPTION_ARG_NONE, &cli_json, "Print JSON", NULL},
    {NULL},
};

static const GOptionEntry force_entries[] = {
    {"force", 0, 0, G_OPTION_ARG_NONE, &cli_force,
     "Replace an existing output; other files in a folder are kept", NULL},
    {NULL},
};

static const GOptionEntry link_entries[] = {
    {"address", 0, 0, G_OPTION_ARG_STRING, &cli_address,
     "Use the daemon at this address (MESORIG_ADDRESS)", "unix:path=…"},
    {"bus", 0, 0, G_OPTION_ARG_STRING, &cli_bus, "Use the daemon on this bus", "system|session"},
    {NULL},
};

int cli_usage(const struct command *command, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *message = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_printerr("mesorig %s: %s\nUsage: mesorig %s %s\n", command->name, message, command->name,
               command->arguments);
    return CLI_USAGE;
}

void cli_tables(const struct command *command, const GOptionEntry *ret[CLI_TABLES]) {
    const GOptionEntry *own = command->list_options ? command->list_options() : command->options;
    int n = 0;
    if (own)
        ret[n++] = own;
    if (command->daemon)
        ret[n++] = link_entries;
    if (command->writes)
        ret[n++] = force_entries;
    ret[n++] = json_entries;
    ret[n] = NULL;
}

/* Parses the command's own options, --json and, if the command uses a daemon, the daemon's options.
 * What remains in argv are arguments. Returns FALSE on bad usage, which has then been reported. */
static gboolean parse(const struct command *command, int *argc, char ***argv) {
    g_autoptr(GOptionContext) context = g_option_context_new(command->arguments);
    g_autoptr(GError) error = NULL;
    g_autofree char *program = g_strconcat("mesorig ", command->name, NULL);
    const GOptionEntry *tables[CLI_TABLES];
    cli_tables(command, tables);
    g_set_prgname(program);
    g_option_context_set_summary(context, command->help);
    for (const GOptionEntry *const *table = tables; *table; table++)
        g_option_context_add_main_entries(context, *table, NULL);
    if (command->examples) {
        g_autofree char *text = g_strconcat("Examples:\n", command->examples, NULL);
        g_option_context_set_description(context, text);
    }
    help_text_answer(context, *argc, *argv);
    if (!g_option_context_parse(context, argc, argv, &error)) {
        nearest_add_option(error, tables);
        const char *number = strstr(error->message, " -");
        if (number && g_ascii_isdigit(number[2]))
            g_prefix_error(&error, "before a negative number write --, as in “mesorig %s -- …%s”: ",
                           command->name, number);
        cli_usage(command, "%s", error->message);
        return FALSE;
    }
    if (*argc > 1 && strcmp((*argv)[1], "--") == 0) {
        memmove(*argv + 1, *argv + 2, sizeof(char *) * (gsize)(*argc - 1));
        (*argc)--;
    }
    if (*argc - 1 < command->min)
        cli_usage(command, "an argument is missing");
    else if (*argc - 1 > command->max)
        cli_usage(command, "too many arguments");
    else if (cli_bus && !bus_client_is_bus(cli_bus))
        cli_usage(command, BUS_CLIENT_NO_BUS, cli_bus);
    else if (cli_bus && cli_address)
        cli_usage(command, "give --bus or --address, not both");
    else
        return TRUE;
    return FALSE;
}

int cli_run(const struct command *command, int argc, char **argv) {
    g_autoptr(Record) record = record_new();
    g_autoptr(GError) error = NULL;
    if (command->run_arguments)
        return command->run_arguments(command, argc, argv);
    if (!parse(command, &argc, &argv))
        return CLI_USAGE;
    const struct call call = {command, argv + 1, argc - 1, record};
    cli_streams = command->streams;
    const int code = command->run(&call, &error);
    if (!error && code != CLI_USAGE)
        record_print(record, cli_json);
    if (!error)
        return code;
    g_autoptr(Record) failure = record_new();
    g_dbus_error_strip_remote_error(error);
    record_string(failure, "error", error->message);
    if (cli_json)
        record_print(failure, TRUE);
    else
        g_printerr("mesorig: %s\n", error->message);
    return CLI_FAILED;
}

/* Returns the last word of a child's name. */
static const char *child_word(const struct command *parent, const struct command *child) {
    return child->name + strlen(parent->name) + 1;
}

int cli_run_child(const struct command *parent, int argc, char **argv) {
    if (argc < 2 || strcmp(argv[1], "--help") == 0 || strcmp(argv[1], "-h") == 0) {
        g_print("Usage: mesorig %s %s\n\n", parent->name, parent->arguments);
        for (gsize i = 0; parent->children[i]; i++) {
            g_autofree char *row =
                help_text_row(child_word(parent, parent->children[i]), parent->children[i]->help);
            g_print("%s", row);
        }
        g_print("\nExamples:\n%s\n“mesorig %s WHAT --help” describes one.\n", parent->examples,
                parent->name);
        return argc < 2 ? CLI_USAGE : CLI_DONE;
    }
    struct nearest nearest = nearest_new(argv[1]);
    for (gsize i = 0; parent->children[i]; i++) {
        const char *word = child_word(parent, parent->children[i]);
        if (strcmp(word, argv[1]) == 0)
            return cli_run(parent->children[i], argc - 1, argv + 1);
        nearest_consider(&nearest, word);
    }
    return nearest.name
               ? cli_usage(parent, "there is no “%s %s”; did you mean “%s”?", parent->name, argv[1],
                           nearest.name)
               : cli_usage(parent, "there is no “%s %s”; “mesorig %s --help” lists the choices",
                           parent->name, argv[1], parent->name);
}

static void put(FILE *to, const char *text) {
    g_autofree char *valid = g_utf8_make_valid(text, -1);
    g_autoptr(GString) clean = g_string_new(NULL);
    for (const char *at = valid; *at; at = g_utf8_next_char(at)) {
        const gunichar c = g_utf8_get_char(at);
        /* These are control characters and bidirectional overrides. A terminal would interpret them
         * instead of showing them. */
        const gboolean control = (g_unichar_iscntrl(c) && c != '\n' && c != '\t') ||
                                 (c >= 0x202a && c <= 0x202e) || (c >= 0x2066 && c <= 0x2069);
        g_string_append_unichar(clean, control ? 0xfffd : c);
    }
    g_autofree char *ascii = g_get_charset(NULL) ? NULL : g_str_to_ascii(clean->str, "C");
    fputs(ascii ? ascii : clean->str, to);
    fflush(to);
}

static void put_out(const char *text) {
    put(stdout, text);
}

static void put_err(const char *text) {
    put(stderr, text);
}

OutputFile *cli_output(const char *path, const char *kind, GError **error) {
    return output_file_new(path, kind, cli_force, error);
}

OutputFile *cli_output_locked(const char *path, const char *kind, GError **error) {
    return output_file_new_locked(path, kind, cli_force, error);
}

OutputFile *cli_output_product(const char *path, const char *kind, GError **error) {
    if (g_file_test(path, G_FILE_TEST_IS_SYMLINK))
        g_unlink(path);
    return cli_output_locked(path, kind, error);
}

void cli_tell_output(Record *to, const OutputFile *file) {
    record_boolean(to, "replaced", output_file_note(file) != NULL);
    if (output_file_note(file))
        record_say(to, "%s\n", output_file_note(file));
}

gboolean cli_check_folder(const char *path, GError **error) {
    struct stat status;
    if (g_lstat(path, &status) != 0 || (cli_force && S_ISDIR(status.st_mode)))
        return TRUE;
    if (S_ISDIR(status.st_mode))
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS,
                    "%s exists already: give another name, or --force to replace it", path);
    else
        g_set_error(error, DATA_ERROR, DATA_ERROR_EXISTS,
                    "%s exists already and is not a folder: give another name", path);
    return FALSE;
}

void cli_print_readably(void) {
    g_set_print_handler(put_out);
    g_set_printerr_handler(put_err);
}

/* Writes what is left in the buffer of stdout. If this or an earlier write has failed, reports the
 * failure and ends the process with CLI_FAILED. For an earlier write no reason is reported, because
 * stdout does not record it. */
static void check_output(void) {
    errno = 0;
    if (fflush(stdout) == 0 && !ferror(stdout))
        return;
    g_printerr(
        "mesorig: standard output could not be written%s%s: the end of the output is missing\n",
        errno ? ": " : "", errno ? g_strerror(errno) : "");
    _exit(CLI_FAILED);
}

void cli_check_output_at_exit(void) {
    atexit(check_output);
}
