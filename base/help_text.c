#include "help_text.h"

#include <stdlib.h>
#include <string.h>

#define WIDTH  80
#define COLUMN 24 /* column of the descriptions */

/* Appends the words of a text, in lines of at most WIDTH characters. column is the column where the
 * text begins. Further lines begin at the column indentation. at_break is appended to each line
 * before a break. A word that is longer than a line is not broken. */
static void append_wrapped(GString *to, const char *text, int column, int indentation,
                           const char *at_break) {
    g_auto(GStrv) words = g_strsplit(text, " ", -1);
    const int width = WIDTH - (int)strlen(at_break);
    gboolean first = TRUE;
    for (char **word = words; *word; word++) {
        if (!**word)
            continue;
        const int length = (int)g_utf8_strlen(*word, -1);
        if (!first && column + 1 + length > (word[1] ? width : WIDTH)) {
            g_string_append_printf(to, "%s\n%*s", at_break, indentation, "");
            column = indentation;
        } else if (!first) {
            g_string_append_c(to, ' ');
            column++;
        }
        g_string_append(to, *word);
        column += length;
        first = FALSE;
    }
    g_string_append_c(to, '\n');
}

/* Appends a name, and breaks it at "|" if it is longer than a line. Returns the number of
 * characters of the last line. */
static int append_name(GString *to, const char *name) {
    g_auto(GStrv) parts = g_strsplit(name, "|", -1);
    int column = 2;
    g_string_append(to, "  ");
    for (char **part = parts; *part; part++) {
        const int length = (int)g_utf8_strlen(*part, -1) + (part[1] != NULL);
        if (column + length > WIDTH) {
            g_string_append(to, "\n      ");
            column = 6;
        }
        g_string_append_printf(to, "%s%s", *part, part[1] ? "|" : "");
        column += length;
    }
    return column;
}

char *help_text_row(const char *name, const char *description) {
    GString *row = g_string_new(NULL);
    const int length = append_name(row, name);
    g_auto(GStrv) paragraphs = g_strsplit(description, "\v", -1);
    if (length + 2 > COLUMN)
        g_string_append_printf(row, "\n%*s", COLUMN, "");
    else
        g_string_append_printf(row, "%*s", COLUMN - length, "");
    for (char **paragraph = paragraphs; *paragraph; paragraph++) {
        g_string_append_printf(row, "%*s", paragraph == paragraphs ? 0 : COLUMN, "");
        append_wrapped(row, *paragraph, COLUMN, COLUMN, "");
    }
    return g_string_free(row, FALSE);
}

char *help_text_lay_out(const char *help) {
    GString *text = g_string_new(NULL);
    g_auto(GStrv) lines = g_strsplit(help, "\n", -1);
    gboolean examples = FALSE;
    for (char **line = lines; *line; line++) {
        const char *gap = **line == ' ' ? strstr(*line + strspn(*line, " "), "  ") : NULL;
        examples |= g_str_has_prefix(*line, "Examples:");
        if (!line[1] && !**line) {
            break; /* after the last newline */
        } else if (examples && g_utf8_strlen(*line, -1) <= WIDTH) {
            g_string_append_printf(text, "%s\n", *line);
        } else if (examples) {
            const int indentation = (int)strspn(*line, " ");
            g_string_append_printf(text, "%*s", indentation, "");
            append_wrapped(text, *line, indentation, 6, " \\");
        } else if (g_str_has_prefix(*line, "  ") && gap) {
            g_autofree char *name = g_strndup(*line + 2, (gsize)(gap - *line - 2));
            g_autofree char *row = help_text_row(g_strstrip(name), gap + strspn(gap, " "));
            g_string_append(text, row);
        } else {
            const int indentation = (int)strspn(*line, " ");
            g_string_append_printf(text, "%*s", indentation, "");
            append_wrapped(text, *line, indentation, indentation, "");
        }
    }
    return g_string_free(text, FALSE);
}

static void print_help(GOptionContext *context) {
    g_autofree char *help = g_option_context_get_help(context, TRUE, NULL);
    g_autofree char *text = help_text_lay_out(help);
    g_print("%s", text);
}

void help_text_answer(GOptionContext *context, int argc, char **argv) {
    for (int i = 1; i < argc && strcmp(argv[i], "--") != 0; i++)
        if (strcmp(argv[i], "--help") == 0 || strcmp(argv[i], "-h") == 0) {
            print_help(context);
            exit(0); /* not _exit(): main() may have registered a function that checks stdout */
        }
}
