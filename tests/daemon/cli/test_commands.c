/* The table of commands: a letter means the same in all of them and in all programs, every command
 * has an example that is right, and every program says its version. */
#include "cli/commands.h"

#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

/* What a program prints, to stdout and then to stderr; it must end with this code. (tests/lib has
 * the same, under a name that the room cli uses otherwise.) */
static char *said_by(int code, const char *const *argv) {
    g_autofree char *out = NULL, *err = NULL;
    g_autoptr(GError) error = NULL;
    int status = 0;
    g_spawn_sync(NULL, (char **)argv, NULL, G_SPAWN_SEARCH_PATH, NULL, NULL, &out, &err, &status,
                 &error);
    g_assert_no_error(error);
    if (!g_spawn_check_wait_status(status, &error) != (code != 0) ||
        (code != 0 && error->code != code))
        g_error("%s %s: %s\n%s%s", argv[0], argv[1], error ? error->message : "done", out, err);
    return g_strconcat(out, err, NULL);
}

static void assert_said(const char *text, const char *words) {
    if (!strstr(text, words))
        g_error("“%s” is not in:\n%s", words, text);
}

typedef void (*CommandFunc)(const struct command *command, gpointer data);

/* Also for those that have commands of their own, such as calibrate. */
static void each_command(const struct command *const *commands, CommandFunc func, gpointer data) {
    for (; *commands; commands++) {
        func(*commands, data);
        if ((*commands)->children)
            each_command((*commands)->children, func, data);
    }
}

/* letters: from a letter to "--NAME of WHO", of the first that has it. */
static void note_letter(GHashTable *letters, char letter, const char *name, const char *who) {
    /* mesorig-view --render writes its output, too. */
    const char *meaning = strcmp(name, "render") == 0 ? "output" : name;
    const char *said = g_hash_table_lookup(letters, GINT_TO_POINTER(letter));
    if (!said) {
        g_hash_table_insert(letters, GINT_TO_POINTER(letter),
                            g_strdup_printf("--%s of %s", meaning, who));
        return;
    }
    g_autofree char *begin = g_strdup_printf("--%s of ", meaning);
    if (!g_str_has_prefix(said, begin))
        g_error(
            "-%c is --%s of %s, but %s: let it mean one thing, and give one of the two no letter",
            letter, name, who, said);
}

static void note_letters(const struct command *command, gpointer letters) {
    const GOptionEntry *tables[CLI_TABLES];
    cli_tables(command, tables);
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++)
            if (entry->short_name)
                note_letter(letters, entry->short_name, entry->long_name, command->name);
}

/* The programs that were built beside mesorig. */
static GPtrArray *programs(void) {
    GPtrArray *paths = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GDir) dir = g_dir_open(BUILD_DIR "/bin", 0, NULL);
    g_assert_nonnull(dir);
    for (const char *name; (name = g_dir_read_name(dir));)
        if (g_str_has_prefix(name, "mesorig"))
            g_ptr_array_add(paths, g_build_filename(BUILD_DIR "/bin", name, NULL));
    g_assert_cmpuint(paths->len, >=, 5);
    return paths;
}

static void test_letters(void) {
    g_autoptr(GHashTable) letters = g_hash_table_new_full(NULL, NULL, NULL, g_free);
    g_autoptr(GPtrArray) paths = programs();
    g_autoptr(GRegex) option = g_regex_new("^  -(\\w), --([\\w-]+)", G_REGEX_MULTILINE, 0, NULL);
    note_letter(letters, 'h', "help", "mesorig");
    each_command(cli_commands(), note_letters, letters);
    g_assert_cmpuint(g_hash_table_size(letters), >=, 10);
    for (guint i = 0; i < paths->len; i++) {
        const char *const argv[] = {paths->pdata[i], "--help", NULL};
        g_autofree char *help = said_by(0, argv);
        g_autoptr(GMatchInfo) match = NULL;
        g_regex_match(option, help, 0, &match);
        for (; g_match_info_matches(match); g_match_info_next(match, NULL)) {
            g_autofree char *letter = g_match_info_fetch(match, 1);
            g_autofree char *name = g_match_info_fetch(match, 2);
            note_letter(letters, *letter, name, paths->pdata[i]);
        }
    }
}

static gboolean has_option(const struct command *command, const char *word) {
    const GOptionEntry *tables[CLI_TABLES];
    cli_tables(command, tables);
    for (const GOptionEntry *const *table = tables; *table; table++)
        for (const GOptionEntry *entry = *table; entry->long_name; entry++)
            if (g_str_has_prefix(word, "--") ? strcmp(word + 2, entry->long_name) == 0
                                             : word[1] == entry->short_name && !word[2])
                return TRUE;
    return FALSE;
}

/* Each line is "  mesorig COMMAND …" with options that there are; behind a | or && stands something
 * else. */
static void check_examples(const struct command *command, gpointer data) {
    int *n = data;
    if (!command->examples)
        g_error("%s has no example", command->name);
    g_auto(GStrv) lines = g_strsplit(command->examples, "\n", -1);
    g_autofree char *begin = g_strdup_printf("  mesorig %s", command->name);
    g_assert_true(g_str_has_suffix(command->examples, "\n"));
    for (char **line = lines; line[1]; line++) {
        gsize end = strcspn(*line, "|&");
        g_autofree char *own = g_strndup(*line, end);
        g_auto(GStrv) words = g_strsplit(own, " ", -1);
        if (!g_str_has_prefix(*line, begin))
            g_error("an example of %s is “%s”", command->name, *line);
        for (char **word = words; *word; word++) {
            gboolean number = strspn(*word, "-0123456789.") == strlen(*word);
            if (**word == '-' && strcmp(*word, "--") != 0 && !number && !command->children &&
                !has_option(command, *word))
                g_error("“%s”: %s has no %s", *line, command->name, *word);
        }
        (*n)++;
    }
}

/* The name of an output as the usage of the command has it: "FILE.glb" of "DIR -o FILE.glb". */
static char *output_of(const struct command *command) {
    const char *at = strstr(command->arguments, "-o ");
    if (!at)
        g_error("%s has no -o in its usage", command->name);
    return g_strndup(at + strlen("-o "), strcspn(at + strlen("-o "), " |"));
}

static void assert_kept(const char *path) {
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_assert_cmpstr(text, ==, "precious");
}

/* Every export refuses an output that exists before it looks at the session, and --force says that
 * it may be replaced: then it is the session that is missing. */
static void check_refuses(const struct command *command, gpointer data) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-exports-XXXXXX", NULL);
    g_autofree char *name = output_of(command);
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autofree char *none = g_build_filename(folder, "none.session", NULL);
    const char *kind = command->name + strlen("export ");
    g_assert_true(command->exports);
    g_assert_true(g_file_set_contents(path, "precious", -1, NULL));
    const char *const argv[] = {BUILD_DIR "/bin/mesorig", "export", kind, none, "-o", path, NULL};
    g_autofree char *refused = said_by(1, argv);
    g_autofree char *expected = g_strdup_printf(
        "%s exists already: give another name with -o, or --force to replace it", path);
    assert_said(refused, expected);
    const char *const forced[] = {
        BUILD_DIR "/bin/mesorig", "export", kind, none, "-o", path, "--force", NULL};
    g_autofree char *missing = said_by(1, forced);
    assert_said(missing, "none.session");
    g_assert_null(strstr(missing, "exists already"));
    assert_kept(path);
    /* A link that leads nowhere counts as well. */
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(symlink("/nowhere/at-all", path), ==, 0);
    g_autofree char *link = said_by(1, argv);
    assert_said(link, expected);
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(g_rmdir(folder), ==, 0);
    ++*(int *)data;
}

static void test_exports(void) {
    int n = 0;
    for (const struct command *const *at = cli_commands(); *at; at++)
        if (strcmp((*at)->name, "export") == 0)
            each_command((*at)->children, check_refuses, &n);
    g_assert_cmpint(n, >=, 13);
}

static void test_examples(void) {
    int n = 0;
    each_command(cli_commands(), check_examples, &n);
    g_assert_cmpint(n, >=, 30);
    /* One table, and two ways to print its help. */
    const char *const plain[] = {BUILD_DIR "/bin/mesorig", "verify", "--help", NULL};
    const char *const parent[] = {BUILD_DIR "/bin/mesorig", "calibrate", "--help", NULL};
    g_autofree char *verify = said_by(0, plain), *calibrate = said_by(0, parent);
    assert_said(verify, "Examples:\n  mesorig verify weave.session\n");
    assert_said(calibrate, "Examples:\n  mesorig calibrate show rig.calibration\n");
}

/* In any locale, and without a bus, a display or a rig. A mistyped option is told which was meant.
 */
static void test_programs(void) {
    g_autoptr(GPtrArray) paths = programs();
    for (guint i = 0; i < paths->len; i++) {
        g_autofree char *name = g_path_get_basename(paths->pdata[i]);
        g_autofree char *expected = g_strdup_printf("%s " MESORIG_VERSION "\n", name);
        const char *const version[] = {"env", "-i", "LC_ALL=C", paths->pdata[i], "--version", NULL};
        const char *const help[] = {"env", "-i", "LC_ALL=C", paths->pdata[i], "--help", NULL};
        const char *const wrong[] = {paths->pdata[i], "--verion", NULL};
        g_autofree char *said = said_by(0, version), *usage = said_by(0, help);
        g_assert_cmpstr(said, ==, expected);
        assert_said(usage, "Usage:");
        if (strcmp(name, "mesorig") == 0)
            continue; /* there it would be a command */
        g_autofree char *meant = said_by(2, wrong);
        assert_said(meant, "did you mean --version?");
    }
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/commands/letters", test_letters);
    g_test_add_func("/commands/examples", test_examples);
    g_test_add_func("/commands/exports", test_exports);
    g_test_add_func("/commands/programs", test_programs);
    return g_test_run();
}
