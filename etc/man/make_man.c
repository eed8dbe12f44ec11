/*
 * make_man TEMPLATE prints a manual page. It replaces each line of the template that begins with @:
 *   @rig CLASS, @session CLASS, @world CLASS, @hooks CLASS   the keys of that section
 *   @drivers CLASS                             a section .Ss for each driver of the class
 *   @schema                                    a section .Ss for each table of session.db
 * So the pages have the same keys, ranges and defaults as the programs.
 */
#include "hooks/hooks_conf.h"
#include "plan/plan.h"
#include "rig/devices.h"
#include "session/session_schema.h"
#include "world/world.h"

#include <stdio.h>
#include <string.h>

/* Prints a text for mdoc(7), each sentence on a separate line. Escapes characters that mdoc would
 * interpret: backslashes, and a dot or apostrophe at the beginning of a line. */
static void put_text(const char *text) {
    if (*text == '.' || *text == '\'')
        fputs("\\&", stdout);
    for (gunichar before = 0, c; *text; text = g_utf8_next_char(text), before = c) {
        c = g_utf8_get_char(text);
        if (c == '\\')
            fputs("\\e", stdout);
        else if (c == ' ' && before == '.' && g_ascii_isupper(text[1]))
            putchar('\n');
        else if (c < 0x80)
            putchar((int)c);
        else
            printf("\\[u%04X]", c);
    }
}

/* Prints a help text as a sentence: with a capital letter at its beginning and a full stop. */
static void put_sentence(const char *text) {
    g_autofree char *first = g_utf8_substring(text, 0, 1);
    g_autofree char *large = g_utf8_strup(first, -1);
    put_text(large);
    put_text(g_utf8_next_char(text));
    fputs(".\n", stdout);
}

static void put_value(const struct option *option) {
    static const char *const names[] = {
        [OPTION_BOOL] = "Cm yes | no", [OPTION_INT] = "Ar integer", [OPTION_DOUBLE] = "Ar number",
        [OPTION_STRING] = "Ar text",   [OPTION_PATH] = "Ar path",   [OPTION_DOUBLES] = "Ar numbers",
        [OPTION_STRINGS] = "Ar texts", [OPTION_SHARE] = "Ar share", [OPTION_BYTES] = "Ar size",
    };
    if (option->type != OPTION_CHOICE) {
        fputs(names[option->type], stdout);
        return;
    }
    g_autofree char *all = g_strjoinv(" | ", (char **)option->choices);
    printf("Cm %s", all);
}

static void put_options(const struct option *options) {
    puts(".Bl -tag -width Ds");
    for (const struct option *option = options; option->name; option++) {
        g_autofree char *range = options_range(option);
        const char *unit = option->unit ? option->unit : "";
        printf(".It Ic %s No = ", option->name);
        put_value(option);
        putchar('\n');
        put_sentence(option->help);
        if (option->type == OPTION_DOUBLES || option->type == OPTION_STRINGS)
            puts("Separated by semicolons.");
        if (range && strcmp(range, "any") != 0) {
            g_autofree char *text =
                g_strdup_printf("Range: %s%s%s.\n", range, *unit ? " " : "", unit);
            put_text(text);
        } else if (*unit) {
            g_autofree char *text = g_strdup_printf("Unit: %s.\n", unit);
            put_text(text);
        }
        if (!option->fallback) {
            puts("Must be given.");
        } else if (*option->fallback) {
            g_autofree char *text = g_strdup_printf("Default: %s.\n", option->fallback);
            put_text(text);
        }
    }
    puts(".El");
}

static gboolean put_drivers(const char *class_name) {
    const struct driver_info *info;
    gboolean any = FALSE;
    for (gsize i = 0; (info = devices_driver(i)); i++) {
        if (strcmp(info->class_name, class_name) != 0)
            continue;
        printf(".Ss %s NAME: driver = %s\n", class_name, info->name);
        put_sentence(info->help);
        put_options(info->options);
        any = TRUE;
    }
    return any;
}

/* Prints a column of a table. line is its line of SQL, "name TYPE … -- what it is", trimmed. */
static void put_column(char *line) {
    char *comment = strstr(line, "--");
    if (comment)
        *comment = '\0';
    g_strchomp(line);
    if (g_str_has_suffix(line, ","))
        line[strlen(line) - 1] = '\0';
    const gsize name = strcspn(line, " ");
    printf(".It Ic %.*s No %s\n", (int)name, line, line + name + strspn(line + name, " "));
    if (comment) {
        put_text(g_strstrip(comment + 2));
        putchar('\n');
    }
}

static void put_schema(void) {
    for (gsize i = 0; i < G_N_ELEMENTS(session_tables); i++) {
        g_auto(GStrv) lines = g_strsplit(session_tables[i].sql, "\n", -1);
        gboolean list = FALSE;
        printf(".Ss Table %s\n", session_tables[i].name);
        for (char **line = lines + 1; line[1]; line++) {
            char *text = g_strstrip(*line);
            if (g_str_has_prefix(text, "--")) {
                put_sentence(g_strstrip(text + 2));
            } else if (g_str_has_prefix(text, "PRIMARY KEY")) {
                puts(".El\n.Pp");
                printf("The primary key is %s.\n", text + strlen("PRIMARY KEY "));
                list = FALSE;
            } else {
                if (!list)
                    puts(".Bl -tag -width Ds");
                list = TRUE;
                put_column(text);
            }
        }
        if (list)
            puts(".El");
    }
}

/* Prints the text that replaces a line "@…". Returns FALSE if the line is not known. */
static gboolean put_directive(const char *line) {
    static const struct {
        const char *name;
        const struct option *(*options)(const char *class_name);
    } kinds[] = {{"rig", devices_section_options},
                 {"session", session_conf_options},
                 {"world", world_section_options},
                 {"hooks", hooks_conf_options}};
    g_auto(GStrv) words = g_strsplit(line + 1, " ", 2);
    if (strcmp(words[0], "schema") == 0) {
        put_schema();
        return TRUE;
    }
    if (strcmp(words[0], "drivers") == 0)
        return words[1] && put_drivers(words[1]);
    for (gsize i = 0; words[1] && i < G_N_ELEMENTS(kinds); i++) {
        const struct option *options =
            strcmp(words[0], kinds[i].name) == 0 ? kinds[i].options(words[1]) : NULL;
        if (options) {
            put_options(options);
            return TRUE;
        }
    }
    return FALSE;
}

int main(int argc, char **argv) {
    g_autofree char *text = NULL;
    g_autoptr(GError) error = NULL;
    if (argc != 2 || !g_file_get_contents(argv[1], &text, NULL, &error)) {
        g_printerr("make_man: %s\n", error ? error->message : "usage: make_man TEMPLATE");
        return 2;
    }
    g_auto(GStrv) lines = g_strsplit(g_strchomp(text), "\n", -1);
    for (char **line = lines; *line; line++)
        if (**line != '@')
            puts(*line);
        else if (!put_directive(*line)) {
            g_printerr("%s:%d: “%s” is not one of the directives that make_man.c lists\n", argv[1],
                       (int)(line - lines) + 1, *line);
            return 1;
        }
    return 0;
}
