/* The table of commands: a short option has the same meaning in all commands and programs, every
 * command has an example that works, and every program prints its version. */
#include "cli/commands.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <glib/gstdio.h>
#include <string.h>
#include <unistd.h>

/* What a program prints, to stdout and then to stderr; it must end with this code. (tests/lib has
 * the same, under a name that the room cli uses otherwise.) */
static char *said_by(int code, const char *const *argv) {
    g_autofree char *out = NULL, *err = NULL;
    g_autoptr(GError) error = NULL;
    int status = 0;
    ok(g_spawn_sync(NULL, (char **)argv, NULL, G_SPAWN_SEARCH_PATH, NULL, NULL, &out, &err, &status,
                    ERR));
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
    /* mesorig-view --render writes its output as well. */
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

/* The programs that were built next to mesorig. */
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

TEST(letters) {
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

/* A call of each command that writes a file which the user names: OUT is that file, NONE an input
 * that does not exist. An output is refused before an input is looked at. */
static const struct writer {
    const char *name, *end, *arguments;
} writers[] = {
    {"board", ".svg", "OUT --board 8x8,square=9,marker=6.75"},
    {"calibrate cameras", "", "NONE --board 8x8,square=9,marker=6.75 -o OUT"},
    {"calibrate cameras", "", "NONE --board 8x8,square=9,marker=6.75 -o NEW --corners OUT"},
    {"calibrate colour", "", "NONE --chart NONE -o OUT"},
    {"calibrate laser", "", "NONE -o OUT"},
    {"calibrate laser", "", "--images NONE --board 8x8,square=9,marker=6.75 -c NONE -o OUT"},
    {"calibrate laser", "",
     "--images NONE --board 8x8,square=9,marker=6.75 -c NONE -o NEW --plane OUT"},
    {"calibrate lights", "", "NONE -o OUT --target " SOURCE_DIR "/etc/demo/poles.conf"},
    {"calibrate lights", ".lp", "--images NONE --ball 50,50,40 -o OUT"},
    {"calibrate radiometry", "", "NONE --reflectance 0.9 -o OUT"},
    {"calibrate report", ".html", "NONE -o OUT"},
    {"check", ".svg", "NONE --plot OUT"},
    {"compare", ".svg", "NONE NONE --plot OUT"},
    {"compare", ".svg", "NONE --curve OUT"},
    {"compress", ".exr", "NONE -o OUT"},
    {"compress", ".exr", "NONE -m mdf -o OUT"},
    {"export blender", "", "NONE -o OUT"},
    {"export bsdf", ".bsdf", "NONE -o OUT"},
    {"export btf", ".btf", "NONE -o OUT"},
    {"export gltf", ".glb", "NONE -o OUT"},
    {"export height", ".exr", "NONE -o OUT"},
    {"export maps", "", "NONE -o OUT"},
    {"export materialx", "", "NONE -o OUT"},
    {"export merl", ".binary", "NONE -o OUT"},
    {"export normals", ".exr", "NONE -o OUT"},
    {"export points", ".ply", "NONE -o OUT"},
    {"export mesh", ".ply", "NONE -o OUT"},
    {"export ptm", ".ptm", "NONE -o OUT"},
    {"export relight", "", "NONE -o OUT"},
    {"export usd", "", "NONE -o OUT"},
    {"export web", ".html", "NONE -o OUT"},
    {"import poses", ".conf", "NONE --template -o OUT"},
    {"info", ".svg", "FOLDER --history OUT"},
    {"new-rig", ".conf", "OUT --kind dome --lamps 8 --radius 400 --offline"},
    {"plan", ".svg", "NONE NONE --curve OUT --offline"},
    {"report", ".html", "NONE -o OUT"},
    {"snap", ".png", "cam -o OUT"},
    {"test", ".html", "--report OUT"},
    {"test", ".rec", "--record OUT"},
    {"synthesize", ".exr", "NONE -o OUT"},
    {"../mesorig-compress-mpi", ".exr", "NONE -o OUT"},
    {"../mesorig-rig", ".conf", "--virtual NONE -o OUT"},
    {"../mesorig-trace", ".png", "NONE -o OUT"},
    {"../mesorig-trace", ".exr", "NONE --exr OUT"},
    {"../mesorig-view", ".png", "--render OUT"},
    {"../mesorig-view", ".exr", "--render OUT"},
    {"../mesorig-view", ".png", "--screenshot OUT --close-after 1"},
};

/* The words of a call; the folder has the input and the output. */
static char **call_of(const struct writer *writer, const char *folder, const char *out) {
    g_autoptr(GPtrArray) words = g_ptr_array_new();
    const gboolean program = g_str_has_prefix(writer->name, "../");
    g_auto(GStrv) name = g_strsplit(program ? writer->name + 3 : writer->name, " ", -1);
    g_auto(GStrv) arguments = g_strsplit(writer->arguments, " ", -1);
    g_ptr_array_add(words, program ? g_strdup_printf(BUILD_DIR "/bin/%s", name[0])
                                   : g_strdup(BUILD_DIR "/bin/mesorig"));
    for (char **word = name + program; *word; word++)
        g_ptr_array_add(words, g_strdup(*word));
    for (char **word = arguments; *word; word++)
        g_ptr_array_add(words, g_str_equal(*word, "OUT")      ? g_strdup(out)
                               : g_str_equal(*word, "NONE")   ? g_strdup_printf("%s/none", folder)
                               : g_str_equal(*word, "NEW")    ? g_strdup_printf("%s/new", folder)
                               : g_str_equal(*word, "FOLDER") ? g_strdup(folder)
                                                              : g_strdup(*word));
    g_ptr_array_add(words, NULL);
    return (char **)g_ptr_array_free(g_steal_pointer(&words), FALSE);
}

/* What exists stays as it was, and is refused for that reason. */
static void check_refuses(const struct writer *writer) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-outputs-XXXXXX", NULL);
    g_autofree char *path = g_strdup_printf("%s/out%s", folder, writer->end);
    g_auto(GStrv) call = call_of(writer, folder, path);
    g_autofree char *expected = g_strdup_printf("%s exists already", path);
    g_assert_true(g_file_set_contents(path, "precious", -1, NULL));
    g_autofree char *refused = said_by(1, (const char *const *)call);
    assert_said(refused, expected);
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_assert_cmpstr(text, ==, "precious");
    /* A link that leads nowhere counts as well. */
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(symlink("/nowhere/at-all", path), ==, 0);
    g_autofree char *link = said_by(1, (const char *const *)call);
    if (!strstr(link, "is a symbolic link to a file that does not exist"))
        assert_said(link, expected);
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(g_rmdir(folder), ==, 0); /* nothing else was written */
}

/* With --force an input is missing, and still nothing is lost. */
static void check_forced(const struct writer *writer) {
    g_autofree char *folder = g_dir_make_tmp("mesorig-outputs-XXXXXX", NULL);
    g_autofree char *path = g_strdup_printf("%s/out%s", folder, writer->end);
    g_autofree char *arguments = g_strconcat(writer->arguments, " --force", NULL);
    const struct writer forced = {writer->name, writer->end, arguments};
    g_auto(GStrv) call = call_of(&forced, folder, path);
    g_assert_true(g_file_set_contents(path, "precious", -1, NULL));
    g_autofree char *missing = said_by(1, (const char *const *)call);
    g_assert_null(strstr(missing, "exists already: give"));
    assert_said(missing, folder);
    g_assert_null(strstr(missing, "XXXX.part"));
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_assert_cmpstr(text, ==, "precious");
    g_assert_cmpint(g_unlink(path), ==, 0);
    g_assert_cmpint(g_rmdir(folder), ==, 0);
}

static void note_writer(const struct command *command, gpointer data) {
    gboolean *covered = data, found = FALSE;
    for (gsize i = 0; i < G_N_ELEMENTS(writers); i++)
        if (g_str_equal(writers[i].name, command->name))
            found = covered[i] = TRUE;
    if (found != command->writes)
        g_error("%s %s --force, and is %s the list of writers", command->name,
                command->writes ? "has" : "lacks", found ? "in" : "not in");
}

TEST(outputs) {
    gboolean covered[G_N_ELEMENTS(writers)] = {FALSE};
    each_command(cli_commands(), note_writer, covered);
    for (gsize i = 0; i < G_N_ELEMENTS(writers); i++) {
        const struct writer *writer = &writers[i];
        g_assert_true(covered[i] || g_str_has_prefix(writer->name, "../"));
        check_refuses(writer);
        /* The others have no input that is missing: a board, a camera, a demonstration, or the
         * folder that FOLDER is. */
        if (strstr(writer->arguments, "NONE") && !g_str_has_prefix(writer->name, "export maps") &&
            !g_str_equal(writer->name, "export relight") &&
            !g_str_equal(writer->name, "export blender") &&
            !g_str_equal(writer->name, "export usd") &&
            !g_str_equal(writer->name, "export materialx"))
            check_forced(writer);
    }
}

TEST(examples) {
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

/* In any locale, and without a bus, a display or a rig. For a mistyped option, the error names the
 * option that was meant. */
TEST(programs) {
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
