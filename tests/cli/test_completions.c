/* Completion of mesorig's command line: what mesorig --complete prints, and that each shell calls
 * it with the right arguments. For this a line with a tab is typed in a terminal of the shell. */
#include <glib/gstdio.h>
#include <poll.h>
#include <pty.h>
#include <signal.h>
#include <string.h>
#include <sys/wait.h>
#include <unistd.h>

#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"
#include "lib/test.h"

#define MESORIG     BUILD_DIR "/bin/mesorig"
#define COMPLETIONS SOURCE_DIR "/etc/completions/mesorig."
#define WAIT_S      20

static char *folder;

struct shell {
    const char *name;
    const char *const *argv;
    const char *setup; /* typed first: what mesorig is, and the completions */
};

/* mesorig is a function that says its arguments, each in brackets. The marks are put together so
 * that the terminal's echo of a line does not have them. */
static const struct shell shells[] = {
    {"bash", (const char *const[]){"bash", "--norc", "--noprofile", "-i", NULL},
     "bind 'set enable-bracketed-paste off'; bind 'set bell-style none'; "
     "mesorig() { printf '@''<'; printf '[%s]' \"$@\"; printf '>@''\\n'; }; "
     "source " COMPLETIONS "bash; echo rea''dy\n"},
    {"zsh", (const char *const[]){"zsh", "-f", "-i", NULL},
     "unset zle_bracketed_paste; unsetopt beep; autoload -U compinit; compinit -D -u; "
     "mesorig() { printf '@''<'; printf '[%s]' \"$@\"; printf '>@''\\n'; }; "
     "source " COMPLETIONS "zsh; echo rea''dy\n"},
    {"fish", (const char *const[]){"fish", "--no-config", "-i", NULL},
     "set fish_autosuggestion_enabled 0; "
     "function mesorig; printf '@''<'; printf '[%s]' $argv; printf '>@''\\n'; end; "
     "source " COMPLETIONS "fish; echo rea''dy\n"},
};

/* What is typed, words with blanks between them, and the words that may be in the place of the
 * last one. */
static const struct {
    const char *typed, *offered;
} offers[] = {
    {"plan ri", "rig.conf"},
    {"capt", "capture"},
    {"plan weave.conf ri", "rig.conf"}, /* not rig.calibration */
    {"process we", "weave.session/"},   /* not weave.exr */
    {"process weave.session --fol", "--follow"},
    {"import rel", "relight"},
    {"import poses t.csv --cfa rg", "rggb"},
    {"export btf --format df", "dfmf"},
    {"compress x -m eig", "eigenmaps"},
    {"compress x --method=eig", "--method=eigenmaps"},
    {"compress x --method = eig", "eigenmaps"}, /* as bash has it */
    {"compress x --mod", ""},
    {"calibrate rad", "radiometry"},
    {"calibrate lights x --tar", "--target"},
    {"calibrate show rig.cal", "rig.calibration"},
    {"resample x -d ow", "own"},
    {"status --bus se", "session"},
    {"report weave.session -o repo", "report.html"}, /* not report.txt */
    {"info weave.session/fr", "weave.session/frames/"},
    {"--ver", "--version"},
    {"nothing x", ""},
};

TEST(words) {
    for (gsize i = 0; i < G_N_ELEMENTS(offers); i++) {
        g_auto(GStrv) typed = g_strsplit(offers[i].typed, " ", -1);
        g_autoptr(GPtrArray) argv = g_ptr_array_new();
        g_ptr_array_add(argv, (gpointer)MESORIG);
        g_ptr_array_add(argv, (gpointer) "--complete");
        for (char **word = typed; *word; word++)
            g_ptr_array_add(argv, *word);
        g_ptr_array_add(argv, NULL);
        g_autofree char *text = process_text(0, (const char *const *)argv->pdata);
        g_auto(GStrv) lines = g_strsplit(text, "\n", -1);
        g_autoptr(GString) offered = g_string_new(NULL);
        for (char **line = lines; *line && **line; line++)
            g_string_append_printf(offered, "%s%.*s", offered->len ? " " : "",
                                   (int)strcspn(*line, "\t"), *line);
        if (strcmp(offered->str, offers[i].offered) != 0)
            g_error("“%s” can become %s, not %s", offers[i].typed, offered->str, offers[i].offered);
    }
    g_autofree char *text = process_text(0, (const char *[]){MESORIG, "--complete", "verif", NULL});
    g_assert_true(g_str_has_prefix(text, "verify\t"));
    g_assert_cmpuint(strlen(text), >, strlen("verify\t") + 10);
}

/* What is typed, with tabs, and what mesorig then gets. */
static const struct {
    const char *typed, *got;
} lines[] = {
    {"mesorig capt\t-o x\n", "[capture][-o][x]"},
    {"mesorig plan weave.conf ri\t\n", "[plan][weave.conf][rig.conf]"},
    {"mesorig process we\t\n", "[process][weave.session]"},
    {"mesorig process we\tfr\t\n", "[process][weave.session/frames]"},
    {"mesorig import poses t.csv --cfa rg\t\n", "[import][poses][t.csv][--cfa][rggb]"},
    {"mesorig compress x --method=eig\t\n", "[compress][x][--method][eigenmaps]"},
    {"mesorig calibrate lights x --tar\tt\n", "[calibrate][lights][x][--target][t]"},
};

/* Reads until these words have come; NULL: they did not in time. g_free() */
static char *read_until(int fd, const char *words) {
    const gint64 until = g_get_monotonic_time() + WAIT_S * G_USEC_PER_SEC;
    g_autoptr(GString) text = g_string_new(NULL);
    while (g_get_monotonic_time() < until) {
        struct pollfd poller = {fd, POLLIN, 0};
        char buffer[512];
        if (poll(&poller, 1, 100) <= 0)
            continue;
        const gssize n = read(fd, buffer, sizeof buffer);
        if (n <= 0)
            break;
        g_string_append_len(text, buffer, n);
        if (strstr(text->str, words))
            return g_strdup(text->str);
    }
    g_printerr("“%s” did not come in %d s, but:\n%s\n", words, WAIT_S, text->str);
    return NULL;
}

static void type_in(int fd, const char *text) {
    g_assert_cmpint(write(fd, text, strlen(text)), ==, (gssize)strlen(text));
}

/* A folder may or may not keep its slash, a value stand behind a blank or behind "=". */
static void test_shell(gconstpointer data) {
    const struct shell *shell = data;
    g_autofree char *program = g_find_program_in_path(shell->argv[0]);
    int fd = -1;
    if (!program) {
        test_skip_or_fail(shell->name);
        return;
    }
    const struct winsize size = {.ws_row = 50, .ws_col = 400};
    const pid_t pid = forkpty(&fd, NULL, NULL, &size);
    g_assert_cmpint(pid, >=, 0);
    if (pid == 0) {
        g_setenv("TERM", "dumb", TRUE);
        g_setenv("HOME", folder, TRUE);
        g_setenv("LC_ALL", "C.UTF-8", TRUE);
        g_setenv("PS1", "$ ", TRUE);
        g_autofree char *path = g_strconcat(BUILD_DIR "/bin:", g_getenv("PATH"), NULL);
        g_setenv("PATH", path, TRUE);
        if (g_chdir(folder) == 0)
            execv(program, (char *const *)shell->argv);
        _exit(1);
    }
    type_in(fd, shell->setup);
    g_autofree char *ready = read_until(fd, "ready");
    g_assert_nonnull(ready);
    for (gsize i = 0; i < G_N_ELEMENTS(lines); i++) {
        g_test_message("%s: %s", shell->name, lines[i].typed);
        /* The tab and what follows it are typed like by a hand, which waits for the completion. */
        g_auto(GStrv) parts = g_strsplit(lines[i].typed, "\t", -1);
        for (char **part = parts; *part; part++) {
            g_autofree char *with_tab = g_strconcat(*part, part[1] ? "\t" : "", NULL);
            type_in(fd, with_tab);
            g_usleep(200 * 1000);
        }
        g_autofree char *told = read_until(fd, ">@");
        g_assert_nonnull(told);
        const char *begin = strstr(told, "@<");
        g_assert_nonnull(begin);
        g_autoptr(GString) got = g_string_new_len(begin + 2, strstr(begin, ">@") - begin - 2);
        g_string_replace(got, "/]", "]", 0);
        g_string_replace(got, "=", "][", 0);
        if (strcmp(got->str, lines[i].got) != 0)
            g_error("%s: “%s” became %s, not %s", shell->name, lines[i].typed, got->str,
                    lines[i].got);
    }
    close(fd);
    kill(pid, SIGKILL);
    waitpid(pid, NULL, 0);
}

BEFORE_TESTS {
    static const char *const files[] = {"rig.conf",   "weave.conf",      "weave.exr",
                                        "report.txt", "rig.calibration", "report.html"};
    folder = g_dir_make_tmp("mesorig-completions-XXXXXX", NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(files); i++) {
        g_autofree char *path = g_build_filename(folder, files[i], NULL);
        g_assert_true(g_file_set_contents(path, "", 0, NULL));
    }
    g_autofree char *session = g_build_filename(folder, "weave.session", NULL);
    g_autofree char *frames = g_build_filename(session, "frames", NULL);
    g_assert_cmpint(g_mkdir_with_parents(frames, 0700), ==, 0);
    g_assert_cmpint(g_chdir(folder), ==, 0);
    for (gsize i = 0; i < G_N_ELEMENTS(shells); i++) {
        g_autofree char *path = g_strconcat("/completions/", shells[i].name, NULL);
        g_test_add_data_func(path, &shells[i], test_shell);
    }
}

AFTER_TESTS {
    remove_tree(folder);
}
