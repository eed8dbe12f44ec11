#include "program.h"

#include "help_text.h"
#include "nearest.h"

#include <gio/gio.h>
#include <locale.h>
#include <stdlib.h>

void program_set_locale(void) {
    setlocale(LC_CTYPE, "");
    setlocale(LC_COLLATE, "");
}

/* Searches for a file that passes the test, next to this executable and in ../libexec/mesorig
 * relative to it. Returns NULL if neither folder has such a file. */
static char *find_beside(const char *name, GFileTest test) {
    static const char *const places[] = {"", "../libexec/mesorig"};
    g_autofree char *self = g_file_read_link("/proc/self/exe", NULL);
    g_autofree char *folder = self ? g_path_get_dirname(self) : NULL;
    for (gsize i = 0; folder && i < G_N_ELEMENTS(places); i++) {
        char *path = g_build_filename(folder, places[i], name, NULL);
        if (g_file_test(path, test))
            return path;
        g_free(path);
    }
    return NULL;
}

char *program_find(const char *name, GError **error) {
    char *found = find_beside(name, G_FILE_TEST_IS_EXECUTABLE);
    if (!found)
        found = g_find_program_in_path(name);
    if (!found)
        g_set_error(
            error, G_FILE_ERROR, G_FILE_ERROR_NOENT,
            "%s is neither in the folder of this program, nor in ../libexec/mesorig relative "
            "to it, nor in PATH: install Mesorig again",
            name);
    return found;
}

char *program_find_module(const char *name, GError **error) {
    char *found = find_beside(name, G_FILE_TEST_IS_REGULAR);
    if (!found)
        g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT,
                    "%s is neither in the folder of this program nor in ../libexec/mesorig "
                    "relative to it: install Mesorig again",
                    name);
    return found;
}

int program_usage(const struct command_line *line, const char *format, ...) {
    va_list arguments;
    va_start(arguments, format);
    g_autofree char *message = g_strdup_vprintf(format, arguments);
    va_end(arguments);
    g_printerr("%s: %s\nUsage: %s [OPTION…]%s%s\n“%s --help” lists the options.\n", line->name,
               message, line->name, line->arguments ? " " : "",
               line->arguments ? line->arguments : "", line->name);
    return 2;
}

void program_parse(const struct command_line *line, int *argc, char ***argv) {
    gboolean version = FALSE;
    const GOptionEntry version_entry[] = {
        {"version", 0, 0, G_OPTION_ARG_NONE, &version, "Print the version", NULL}, {NULL}};
    const GOptionEntry *const tables[] = {line->options, version_entry, NULL};
    g_autoptr(GOptionContext) context = g_option_context_new(line->arguments);
    g_autoptr(GError) error = NULL;
    GOptionGroup *group = g_option_group_new("", "", "", line->data, NULL);
    program_set_locale();
    g_set_prgname(line->name);
    for (gsize i = 0; tables[i]; i++)
        g_option_group_add_entries(group, tables[i]);
    g_option_context_set_main_group(context, group);
    g_option_context_set_summary(context, line->summary);
    g_option_context_set_description(context, line->description);
    help_text_answer(context, *argc, *argv);
    const gboolean parsed = g_option_context_parse(context, argc, argv, &error);
    if (parsed && version) {
        g_print("%s %s\n", line->name, MESORIG_VERSION);
        exit(0);
    }
    if (!parsed) {
        nearest_add_option(error, tables);
        exit(program_usage(line, "%s", error->message));
    }
    if (*argc - 1 < line->min)
        exit(program_usage(line, "an argument is missing"));
    if (*argc - 1 > line->max)
        exit(program_usage(line, "there are too many arguments"));
}
