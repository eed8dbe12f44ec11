/*
 * Prints what a shell completes of mesorig's command line, from the table of commands:
 * make_completions bash|zsh|fish. What a value or an argument may be is told by its name there:
 * "a|b|c" are words, DIR is a folder, FILE.exr a file of that suffix, FILE any file, RIG and
 * SESSION are configuration files or folders; of others nothing is known.
 */
#include "cli/commands.h"

#include <stdio.h>
#include <string.h>

#define LONGEST_HELP 76

/* What may stand in a place. */
struct value {
    GString *words;    /* with blanks between them */
    GString *suffixes; /* of files, with blanks between them */
    gboolean any_file, folder;
};

static struct value value_new(void) {
    return (struct value){g_string_new(NULL), g_string_new(NULL), FALSE, FALSE};
}

static void value_clear(struct value *value) {
    g_string_free(value->words, TRUE);
    g_string_free(value->suffixes, TRUE);
}

static void append_word(GString *to, const char *word) {
    g_string_append_printf(to, "%s%s", to->len ? " " : "", word);
}

static gboolean is_word(const char *text) {
    static const char letters[] = G_CSET_a_2_z G_CSET_DIGITS "-";
    return *text && strspn(text, letters) == strlen(text);
}

/* name: one of "a|b|FILE.exr"; filename: the option's type says that it is one. */
static void value_add(struct value *value, const char *name, gboolean filename) {
    g_auto(GStrv) parts = g_strsplit(name, "|", -1);
    for (char **part = parts; *part; part++) {
        const char *dot = strrchr(*part, '.');
        if (is_word(*part) && parts[1])
            append_word(value->words, *part);
        else if (g_str_has_prefix(*part, "DIR"))
            value->folder = TRUE;
        else if (g_str_equal(*part, "RIG") || g_str_has_prefix(*part, "SESSION")) {
            append_word(value->suffixes, "conf");
            value->folder = TRUE;
        } else if (dot && is_word(dot + 1))
            append_word(value->suffixes, dot + 1);
        else if (filename || g_str_equal(*part, "FILE") || g_str_equal(*part, "SOURCE") ||
                 g_str_equal(*part, "A") || g_str_equal(*part, "B"))
            value->any_file = TRUE;
    }
}

static struct value value_of_option(const GOptionEntry *entry) {
    struct value value = value_new();
    value_add(&value, entry->arg_description ? entry->arg_description : "",
              entry->arg == G_OPTION_ARG_FILENAME || entry->arg == G_OPTION_ARG_FILENAME_ARRAY);
    return value;
}

static gboolean takes_value(const GOptionEntry *entry) {
    return entry->arg != G_OPTION_ARG_NONE;
}

/* The arguments of a command, of struct value; the last stands for all further ones if
 * *ret_repeats.
 */
static GArray *values_of_arguments(const struct command *command, gboolean *ret_repeats) {
    GArray *values = g_array_new(FALSE, FALSE, sizeof(struct value));
    g_auto(GStrv) ways = g_strsplit(command->arguments, " | ", -1);
    const guint most = command->children ? 1 : (guint)command->max;
    *ret_repeats = FALSE;
    g_array_set_clear_func(values, (GDestroyNotify)value_clear);
    for (char **way = ways; *way; way++) {
        g_auto(GStrv) words = g_strsplit(*way, " ", -1);
        for (guint i = 0; i < most && words[i] && *words[i] && *words[i] != '-'; i++) {
            if (values->len == i) {
                struct value value = value_new();
                for (const struct command *const *child = command->children;
                     i == 0 && child && *child; child++)
                    append_word(value.words, strrchr((*child)->name, ' ') + 1);
                g_array_append_val(values, value);
            }
            *ret_repeats |= g_str_has_suffix(words[i], "…");
            g_autofree char *name = g_strdup(words[i]);
            g_strdelimit(name, "[]", ' ');
            if (g_str_has_suffix(name, "…"))
                name[strlen(name) - strlen("…")] = '\0';
            value_add(&g_array_index(values, struct value, i), g_strstrip(name), FALSE);
        }
    }
    return values;
}

/* One line, not too long, that can stand within single quotes, and in zsh within brackets. */
static char *short_help(const char *help) {
    g_autoptr(GString) line = g_string_new(help);
    g_string_replace(line, "'", "’", 0);
    g_string_replace(line, "\\", "/", 0);
    g_string_replace(line, "[", "(", 0);
    g_string_replace(line, "]", ")", 0);
    g_strdelimit(line->str, "\n", ' ');
    if (g_utf8_strlen(line->str, -1) > LONGEST_HELP) {
        *g_utf8_offset_to_pointer(line->str, LONGEST_HELP) = '\0';
        char *blank = strrchr(line->str, ' ');
        if (blank)
            *blank = '\0';
        return g_strconcat(line->str, " …", NULL);
    }
    return g_strdup(line->str);
}

static char *function_name(const struct command *command) {
    return g_strdelimit(g_strconcat("_mesorig_", command->name, NULL), " ", '_');
}

typedef void (*CommandFunc)(const struct command *command);

static void for_each(const struct command *const *commands, CommandFunc func) {
    for (; *commands; commands++)
        if ((*commands)->children)
            for_each((*commands)->children, func);
        else
            func(*commands);
}

/* bash: _mesorig_NAME sets options, and of a value or an argument words, suffixes, folder, any. */

static void bash_value(const struct value *value) {
    g_print("words='%s' suffixes='%s' folder=%s any=%s", value->words->str, value->suffixes->str,
            value->folder ? "yes" : "", value->any_file ? "yes" : "");
}

static void bash_command(const struct command *command) {
    g_autofree char *function = function_name(command);
    g_autoptr(GString) options = g_string_new(NULL);
    const GOptionEntry *tables[CLI_TABLES];
    gboolean repeats;
    g_autoptr(GArray) values = values_of_arguments(command, &repeats);
    cli_tables(command, tables);
    g_print("\n%s() {\n    case $1 in\n", function);
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++) {
            g_string_append_printf(options, "--%s ", entry->long_name);
            if (!takes_value(entry))
                continue;
            struct value value = value_of_option(entry);
            g_print("    --%s", entry->long_name);
            if (entry->short_name)
                g_print(" | -%c", entry->short_name);
            g_print(") ");
            bash_value(&value);
            g_print(" ;;\n");
            value_clear(&value);
        }
    for (guint i = 0; i < values->len; i++) {
        g_print(i + 1 == values->len && repeats ? "    [%u-9]*) " : "    %u) ", i + 1);
        bash_value(&g_array_index(values, struct value, i));
        g_print(" ;;\n");
    }
    g_print("    options) words='%s--help' ;;\n    *) return 1 ;;\n    esac\n}\n", options->str);
}

static const char bash_end[] =
    "\n_mesorig() {\n"
    "    local current=${COMP_WORDS[COMP_CWORD]} before=${COMP_WORDS[COMP_CWORD-1]}\n"
    "    local words= suffixes= folder= any= name= i first=2 number=1 suffix\n"
    "    COMPREPLY=()\n"
    "    if [[ $current == '=' ]]; then # bash takes it for a word of its own\n"
    "        current=\n"
    "    elif [[ $before == '=' ]]; then\n"
    "        before=${COMP_WORDS[COMP_CWORD-2]}\n"
    "    fi\n"
    "    if ((COMP_CWORD == 1)); then\n"
    "        COMPREPLY=($(compgen -W \"$_mesorig_commands --help --version\" -- \"$current\"))\n"
    "        return\n"
    "    fi\n"
    "    name=${COMP_WORDS[1]}\n"
    "    local children=_mesorig_children_$name\n"
    "    if [[ $name =~ ^[a-z]+$ && -n ${!children} ]]; then\n"
    "        if ((COMP_CWORD == 2)); then\n"
    "            COMPREPLY=($(compgen -W \"${!children} --help\" -- \"$current\"))\n"
    "            return\n"
    "        fi\n"
    "        name+=_${COMP_WORDS[2]} first=3\n"
    "    fi\n"
    "    declare -F \"_mesorig_$name\" >/dev/null || return\n"
    "    if [[ $before == -* && ${COMP_WORDS[COMP_CWORD]} != -* ]] &&\n"
    "        \"_mesorig_$name\" \"$before\"; then\n"
    "        :\n"
    "    elif [[ $current == -* ]]; then\n"
    "        \"_mesorig_$name\" options\n"
    "    else\n"
    "        for ((i = first; i < COMP_CWORD; i++)); do\n"
    "            if [[ ${COMP_WORDS[i]} == '=' ]]; then\n"
    "                ((i++))\n"
    "            elif [[ ${COMP_WORDS[i]} != -* ]]; then\n"
    "                ((number++))\n"
    "            elif [[ ${COMP_WORDS[i+1]} != '=' ]] && \"_mesorig_$name\" \"${COMP_WORDS[i]}\"; "
    "then\n"
    "                ((i++))\n"
    "            fi\n"
    "        done\n"
    "        words= suffixes= folder= any=\n"
    "        \"_mesorig_$name\" \"$number\"\n"
    "    fi\n"
    "    local IFS=$'\\n'\n"
    "    [[ -z $words ]] || COMPREPLY+=($(compgen -W \"${words// /$'\\n'}\" -- \"$current\"))\n"
    "    if [[ -n $any ]]; then\n"
    "        COMPREPLY+=($(compgen -f -- \"$current\"))\n"
    "        compopt -o filenames\n"
    "    elif [[ -n $suffixes$folder ]]; then\n"
    "        COMPREPLY+=($(compgen -d -- \"$current\"))\n"
    "        for suffix in ${suffixes// /$'\\n'}; do\n"
    "            COMPREPLY+=($(compgen -f -X \"!*.$suffix\" -- \"$current\"))\n"
    "        done\n"
    "        compopt -o filenames\n"
    "    fi\n"
    "}\n"
    "complete -F _mesorig mesorig\n";

static void print_bash(const struct command *const *commands) {
    g_autoptr(GString) names = g_string_new(NULL);
    for (const struct command *const *command = commands; *command; command++) {
        append_word(names, (*command)->name);
        if (!(*command)->children)
            continue;
        gboolean repeats;
        g_autoptr(GArray) values = values_of_arguments(*command, &repeats);
        g_print("_mesorig_children_%s='%s'\n", (*command)->name,
                g_array_index(values, struct value, 0).words->str);
    }
    g_print("_mesorig_commands='%s'\n", names->str);
    for_each(commands, bash_command);
    g_print("%s", bash_end);
}

/* zsh: a function a command, which hands its options to _arguments. */

static void zsh_action(const struct value *value) {
    g_autoptr(GString) files = g_string_new(NULL);
    g_auto(GStrv) suffixes = g_strsplit(value->suffixes->str, " ", -1);
    if (value->any_file)
        g_string_append(files, "_files");
    else if (*suffixes) {
        g_autofree char *all = g_strjoinv("|", suffixes);
        g_string_append_printf(
            files, suffixes[1] ? "_files -g \"*.(%s)(-.)\"" : "_files -g \"*.%s(-.)\"", all);
    } else if (value->folder)
        g_string_append(files, "_files -/");
    if (value->words->len && files->len)
        g_print(" _mesorig_either \"%s\" %s", value->words->str, files->str);
    else if (value->words->len)
        g_print("(%s)", value->words->str);
    else
        g_print("%s", files->len ? files->str : " ");
}

static void zsh_command(const struct command *command) {
    g_autofree char *function = function_name(command);
    const GOptionEntry *tables[CLI_TABLES];
    gboolean repeats;
    g_autoptr(GArray) values = values_of_arguments(command, &repeats);
    cli_tables(command, tables);
    g_print("\n%s() {\n    _arguments -s -S", function);
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++) {
            g_autofree char *help = short_help(entry->description);
            const char *equals = takes_value(entry) ? "=" : "", *plus = *equals ? "+" : "";
            const gboolean again = entry->arg == G_OPTION_ARG_STRING_ARRAY ||
                                   entry->arg == G_OPTION_ARG_FILENAME_ARRAY;
            g_print(" \\\n        ");
            if (again)
                g_print("'*'");
            else if (entry->short_name)
                g_print("'(-%c --%s)'", entry->short_name, entry->long_name);
            if (entry->short_name)
                g_print("{-%c%s,--%s%s}", entry->short_name, plus, entry->long_name, equals);
            else
                g_print("--%s%s", entry->long_name, equals);
            g_print("'[%s]", help);
            if (takes_value(entry)) {
                struct value value = value_of_option(entry);
                g_autofree char *name =
                    short_help(entry->arg_description ? entry->arg_description : "value");
                g_print(":%s:", g_strdelimit(name, ":", ' '));
                zsh_action(&value);
                value_clear(&value);
            }
            g_print("'");
        }
    g_print(" \\\n        '(- *)'{-h,--help}'[What it does and takes]'");
    for (guint i = 0; i < values->len; i++) {
        if (i + 1 == values->len && repeats)
            g_print(" \\\n        '*:argument:");
        else
            g_print(" \\\n        '%u:argument:", i + 1);
        zsh_action(&g_array_index(values, struct value, i));
        g_print("'");
    }
    g_print("\n}\n");
}

static void zsh_list(const struct command *const *commands) {
    for (; *commands; commands++) {
        const char *blank = strrchr((*commands)->name, ' ');
        g_autofree char *said = short_help((*commands)->help);
        g_auto(GStrv) parts = g_strsplit(said, ":", -1);
        g_autofree char *help = g_strjoinv("\\:", parts);
        g_print(" \\\n            '%s:%s'", blank ? blank + 1 : (*commands)->name, help);
    }
}

static void print_zsh(const struct command *const *commands) {
    g_print("#compdef mesorig\n\n"
            "_mesorig_either() { # words, then a command for files\n"
            "    local -a choices=(${=1})\n"
            "    shift\n"
            "    _alternative \"words:word:($choices)\" \"files:file:$*\"\n"
            "}\n");
    for_each(commands, zsh_command);
    for (const struct command *const *command = commands; *command; command++) {
        if (!(*command)->children)
            continue;
        g_print("\n_mesorig_%s() {\n"
                "    if ((CURRENT == 2)); then\n"
                "        local -a children=(",
                (*command)->name);
        zsh_list((*command)->children);
        g_print(")\n"
                "        _describe what children\n"
                "        return\n"
                "    fi\n"
                "    local child=$words[2]\n"
                "    shift words\n"
                "    ((CURRENT--))\n"
                "    (($+functions[_mesorig_%s_$child])) && _mesorig_%s_$child\n"
                "}\n",
                (*command)->name, (*command)->name);
    }
    g_print("\n_mesorig() {\n"
            "    if ((CURRENT == 2)); then\n"
            "        local -a commands=(");
    zsh_list(commands);
    g_print(")\n"
            "        _describe command commands\n"
            "        return\n"
            "    fi\n"
            "    local command=$words[2]\n"
            "    shift words\n"
            "    ((CURRENT--))\n"
            "    (($+functions[_mesorig_$command])) && _mesorig_$command\n"
            "}\n\n"
            "if [[ $zsh_eval_context[-1] == loadautofunc ]]; then\n"
            "    _mesorig \"$@\"\n"
            "else\n"
            "    compdef _mesorig mesorig\n"
            "fi\n");
}

/* fish: a line an option, for the command that __mesorig_is finds in the line. */

static void fish_value(const struct value *value) {
    g_auto(GStrv) suffixes = g_strsplit(value->suffixes->str, " ", -1);
    g_autoptr(GString) list = g_string_new(value->words->str);
    for (char **suffix = suffixes; *suffix && **suffix; suffix++) {
        g_autofree char *call = g_strdup_printf("(__mesorig_files .%s)", *suffix);
        append_word(list, call);
    }
    if (value->folder && !value->any_file)
        append_word(list, "(__fish_complete_directories (commandline -ct) folder)");
    g_print(value->any_file ? " -F" : " -f");
    if (list->len)
        g_print(" -a '%s'", list->str);
}

static void fish_command(const struct command *command) {
    const GOptionEntry *tables[CLI_TABLES];
    gboolean repeats;
    g_autoptr(GArray) values = values_of_arguments(command, &repeats);
    cli_tables(command, tables);
    g_print("\n");
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++) {
            g_autofree char *help = short_help(entry->description);
            g_print("complete -c mesorig -n '__mesorig_is %s' -l %s", command->name,
                    entry->long_name);
            if (entry->short_name)
                g_print(" -s %c", entry->short_name);
            g_print(" -d '%s'", help);
            if (takes_value(entry)) {
                struct value value = value_of_option(entry);
                g_print(" -r");
                fish_value(&value);
                value_clear(&value);
            }
            g_print("\n");
        }
    for (guint i = 0; i < values->len; i++) {
        g_print("complete -c mesorig -n '__mesorig_is %s; and __mesorig_at %u %s'", command->name,
                i + 1, i + 1 == values->len && repeats ? "or-more" : "");
        fish_value(&g_array_index(values, struct value, i));
        g_print("\n");
    }
}

static void fish_options_with_value(const struct command *command) {
    g_autofree char *function = function_name(command);
    const GOptionEntry *tables[CLI_TABLES];
    cli_tables(command, tables);
    g_print("set -g __mesorig_value%s", function);
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++) {
            if (takes_value(entry))
                g_print(" --%s", entry->long_name);
            if (takes_value(entry) && entry->short_name)
                g_print(" -%c", entry->short_name);
        }
    g_print("\n");
}

static void print_fish(const struct command *const *commands) {
    g_print("function __mesorig_words # what stands before the cursor, without options\n"
            "    set -l skip\n"
            "    set -l name mesorig\n"
            "    for word in (commandline -opc)[2..-1]\n"
            "        set -l with_value __mesorig_value_$name\n"
            "        if test -n \"$skip\"\n"
            "            set skip\n"
            "        else if string match -q -- '-*' $word\n"
            "            contains -- $word $$with_value; and set skip yes\n"
            "        else\n"
            "            set -q $with_value; or set name {$name}_(string replace -a -r '[^a-z]' '' "
            "$word)\n"
            "            echo $word\n"
            "        end\n"
            "    end\n"
            "end\n"
            "function __mesorig_is # COMMAND [CHILD]\n"
            "    set -l words (__mesorig_words)\n"
            "    test \"$words[1..\"(count $argv)\"]\" = \"$argv\"\n"
            "    and set -g __mesorig_depth (count $argv)\n"
            "end\n"
            "function __mesorig_at # N [or-more]: the Nth argument of the command comes next\n"
            "    set -l n (math (count (__mesorig_words)) - $__mesorig_depth + 1)\n"
            "    test $n -eq $argv[1]; or test $n -gt $argv[1] -a \"$argv[2]\" = or-more\n"
            "end\n"
            "function __mesorig_files # SUFFIX: such files, and folders on the way to them\n"
            "    set -l token (commandline -ct | string replace -r -- '^--[a-z-]*=' '')\n"
            "    for path in $token*$argv[1] $token*/\n"
            "        echo $path\n"
            "    end\n"
            "end\n"
            "set -g __mesorig_depth 1\n");
    for_each(commands, fish_options_with_value);
    g_print("\ncomplete -c mesorig -f\n"
            "complete -c mesorig -n 'test (count (__mesorig_words)) -eq 0' -l version"
            " -d 'Print the version'\n"
            "complete -c mesorig -s h -l help -d 'What it does and takes'\n");
    for (const struct command *const *command = commands; *command; command++) {
        g_autofree char *help = short_help((*command)->help);
        g_print("complete -c mesorig -n 'test (count (__mesorig_words)) -eq 0' -a %s -d '%s'\n",
                (*command)->name, help);
        for (const struct command *const *child = (*command)->children; child && *child; child++) {
            g_autofree char *says = short_help((*child)->help);
            g_print("complete -c mesorig -n '__mesorig_is %s; and __mesorig_at 1' -a %s -d '%s'\n",
                    (*command)->name, strrchr((*child)->name, ' ') + 1, says);
        }
    }
    for_each(commands, fish_command);
}

/* In UTF-8, whatever the locale of who builds this. */
static void print_unchanged(const char *text) {
    fputs(text, stdout);
}

int main(int argc, char **argv) {
    g_set_print_handler(print_unchanged);
    static const struct {
        const char *name;
        void (*print)(const struct command *const *commands);
    } shells[] = {{"bash", print_bash}, {"zsh", print_zsh}, {"fish", print_fish}};
    for (gsize i = 0; i < G_N_ELEMENTS(shells); i++)
        if (argc == 2 && strcmp(argv[1], shells[i].name) == 0) {
            if (strcmp(argv[1], "zsh") != 0)
                g_print("# What %s completes of mesorig; made from its table of commands.\n",
                        argv[1]);
            shells[i].print(cli_commands());
            return 0;
        }
    g_printerr("usage: make_completions bash|zsh|fish\n");
    return 2;
}
