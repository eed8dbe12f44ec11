/* Finds candidates for the next word of a command line, for shells, from the table of commands. The
 * placeholder of an option's value or of an argument defines the candidates:
 * - “a|b|c” are the words a, b and c,
 * - DIR is a folder,
 * - FILE.exr is a file with this suffix,
 * - FILE, SOURCE, A and B are any file,
 * - RIG and SESSION are configuration files or folders.
 *
 * Other placeholders have no candidates. There is one exception: if the type of an option is a file
 * name, any file is a candidate. */
#include <gio/gio.h>
#include <stdio.h>
#include <string.h>

#include "commands.h"

#define LONGEST_HELP 76

/* The candidates for a word. */
struct value {
    GPtrArray *words, *suffixes; /* of char *; the suffixes are those of files */
    gboolean any_file, folder;
};

static struct value value_new(void) {
    return (struct value){g_ptr_array_new_with_free_func(g_free),
                          g_ptr_array_new_with_free_func(g_free), FALSE, FALSE};
}

static void value_clear(struct value *value) {
    g_ptr_array_unref(value->words);
    g_ptr_array_unref(value->suffixes);
}

static gboolean is_word(const char *text) {
    static const char letters[] = G_CSET_a_2_z G_CSET_DIGITS "-";
    return *text && strspn(text, letters) == strlen(text);
}

/* Adds the candidates for a placeholder, such as "FILE", "DIR" or "a|b|FILE.exr". filename is TRUE
 * if the type of the option is a file name. */
static void value_add(struct value *value, const char *name, gboolean filename) {
    g_auto(GStrv) parts = g_strsplit(name, "|", -1);
    for (char **part = parts; *part; part++) {
        const char *dot = strrchr(*part, '.');
        if (is_word(*part) && parts[1])
            g_ptr_array_add(value->words, g_strdup(*part));
        else if (g_str_has_prefix(*part, "DIR"))
            value->folder = TRUE;
        else if (g_str_equal(*part, "RIG") || g_str_has_prefix(*part, "SESSION")) {
            g_ptr_array_add(value->suffixes, g_strdup(".conf"));
            value->folder = TRUE;
        } else if (dot && is_word(dot + 1))
            g_ptr_array_add(value->suffixes, g_strdup(dot));
        else if (filename || g_str_equal(*part, "FILE") || g_str_equal(*part, "SOURCE") ||
                 g_str_equal(*part, "A") || g_str_equal(*part, "B"))
            value->any_file = TRUE;
    }
}

/* Adds the candidates for the n-th argument of a command, counted from 0. The last argument may be
 * repeated ("DIR…"). */
static void value_add_argument(struct value *value, const struct command *command, int n) {
    g_auto(GStrv) ways = g_strsplit(command->arguments, " | ", -1);
    for (char **way = ways; n < command->max && *way; way++) {
        g_auto(GStrv) words = g_strsplit(*way, " ", -1);
        char *word = NULL;
        for (int i = 0; words[i] && *words[i] && *words[i] != '-'; i++)
            if (i == n || (i < n && g_str_has_suffix(words[i], "…")))
                word = words[i];
        if (!word)
            continue;
        g_strdelimit(word, "[]", ' ');
        if (g_str_has_suffix(word, "…"))
            word[strlen(word) - strlen("…")] = '\0';
        value_add(value, g_strstrip(word), FALSE);
    }
}

static gboolean takes_value(const GOptionEntry *entry) {
    return entry->arg != G_OPTION_ARG_NONE;
}

/* Returns the option that a word names: a word such as "-o", "--output" or "--output=…". Returns
 * NULL if the word names no option. */
static const GOptionEntry *find_option(const struct command *command, const char *word) {
    const GOptionEntry *tables[CLI_TABLES];
    const gsize n = strcspn(word, "=");
    cli_tables(command, tables);
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++)
            if ((g_str_has_prefix(word, "--") && strlen(entry->long_name) == n - 2 &&
                 strncmp(word + 2, entry->long_name, n - 2) == 0) ||
                (word[0] == '-' && word[1] == entry->short_name && word[1] && !word[2]))
                return entry;
    return NULL;
}

/* Prints a candidate if it begins with the typed text: a line with the word, a tab and its
 * description. `before` is the part of the argument before the word, such as "--output=". */
static void offer(const char *before, const char *word, const char *typed, const char *help) {
    if (!g_str_has_prefix(word, typed))
        return;
    g_autofree char *line = g_strdup(help);
    g_strdelimit(line, "\n\t", ' ');
    if (g_utf8_strlen(line, -1) > LONGEST_HELP) {
        *g_utf8_offset_to_pointer(line, LONGEST_HELP) = '\0';
        char *blank = strrchr(line, ' ');
        if (blank)
            *blank = '\0';
        printf("%s%s\t%s …\n", before, word, line);
    } else
        printf("%s%s\t%s\n", before, word, line);
}

/* Prints files and folders whose path begins with the typed text. */
static void offer_files(const char *before, const struct value *value, const char *typed) {
    const char *slash = strrchr(typed, '/');
    g_autofree char *place = g_strndup(typed, slash ? (gsize)(slash + 1 - typed) : 0);
    g_autofree char *folder = g_str_has_prefix(place, "~/")
                                  ? g_build_filename(g_get_home_dir(), place + 2, NULL)
                                  : g_strdup(*place ? place : ".");
    g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
    const char *typed_name = typed + strlen(place), *name;
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *path = g_build_filename(folder, name, NULL);
        const gboolean is_folder = g_file_test(path, G_FILE_TEST_IS_DIR);
        gboolean fits = is_folder || value->any_file;
        for (guint i = 0; i < value->suffixes->len; i++)
            fits |= g_str_has_suffix(name, value->suffixes->pdata[i]);
        if (!fits || (*name == '.' && *typed_name != '.') || strpbrk(name, "\n\t"))
            continue;
        g_autofree char *word = g_strconcat(place, name, is_folder ? "/" : "", NULL);
        offer(before, word, typed, "");
    }
}

static void offer_value(const char *before, const struct value *value, const char *typed) {
    for (guint i = 0; i < value->words->len; i++)
        offer(before, value->words->pdata[i], typed, "");
    if (value->any_file || value->folder || value->suffixes->len > 0)
        offer_files(before, value, typed);
}

static void offer_option_value(const char *before, const GOptionEntry *entry, const char *typed) {
    struct value value = value_new();
    value_add(&value, entry->arg_description ? entry->arg_description : "",
              entry->arg == G_OPTION_ARG_FILENAME || entry->arg == G_OPTION_ARG_FILENAME_ARRAY);
    offer_value(before, &value, typed);
    value_clear(&value);
}

static void offer_options(const struct command *command, const char *typed) {
    const GOptionEntry *tables[CLI_TABLES];
    if (typed[1] && typed[1] != '-')
        return; /* an option of one letter is complete */
    const char *name = typed[1] ? typed + 2 : "";
    cli_tables(command, tables);
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++)
            offer("--", entry->long_name, name, entry->description);
    offer("--", "help", name, "Print the help");
}

/* Prints the candidates for the last of the n words that follow a command. Bash passes "=" as a
 * separate word. */
static void arguments(const struct command *command, char *const *words, int n) {
    const char *typed = words[n - 1];
    const GOptionEntry *open = NULL; /* an option whose value is the next word */
    int number = 0;
    for (int i = 0; i < n - 1; i++) {
        if (strcmp(words[i], "=") == 0)
            continue;
        const GOptionEntry *entry = *words[i] == '-' ? find_option(command, words[i]) : NULL;
        number += !open && *words[i] != '-';
        open = !open && entry && takes_value(entry) && !strchr(words[i], '=') ? entry : NULL;
    }
    const char *equals = strchr(typed, '=');
    const GOptionEntry *entry = find_option(command, typed);
    if (open)
        offer_option_value("", open, strcmp(typed, "=") == 0 ? "" : typed);
    else if (g_str_has_prefix(typed, "--") && equals && entry && takes_value(entry)) {
        g_autofree char *before = g_strndup(typed, (gsize)(equals + 1 - typed));
        offer_option_value(before, entry, equals + 1);
    } else if (*typed == '-')
        offer_options(command, typed);
    else {
        struct value value = value_new();
        value_add_argument(&value, command, number);
        offer_value("", &value, typed);
        value_clear(&value);
    }
}

void complete_words(const struct command *const *commands, char *const *words, int n) {
    if (n < 1)
        return;
    for (const struct command *const *at = commands; *at; at++) {
        const char *blank = strrchr((*at)->name, ' ');
        const char *name = blank ? blank + 1 : (*at)->name;
        if (n == 1)
            offer("", name, words[0], (*at)->help);
        else if (strcmp(name, words[0]) == 0 && (*at)->children)
            complete_words((*at)->children, words + 1, n - 1);
        else if (strcmp(name, words[0]) == 0)
            arguments(*at, words + 1, n - 1);
    }
    if (n == 1 && *words[0] == '-')
        offer("", "--help", words[0], "Print the help");
    if (n == 1 && *words[0] == '-' && commands == cli_commands())
        offer("", "--version", words[0], "Print the version");
}
