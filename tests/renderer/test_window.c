/* The window as a user has it: keys and mouse on a display without a screen, and what its
 * screenshots say of themselves. */
#include "lib/capturing_fixture.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/view_fixture.h"
#include "lib/wait.h"
#include "lib/window_user.h"

#include "codecs/eigenmaps/eigenmaps.h"
#include "window/ui.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>
#include <unistd.h>

#define SMALL "--size", "400x300"

/* A number in a text: what follows its name. */
static double number(GHashTable *texts, const char *text, const char *name) {
    const char *at = strstr(user_said(texts, text), name);
    g_assert_nonnull(at);
    return g_ascii_strtod(at + strlen(name), NULL);
}

/* The change of a number is known. */
static void check_change(GHashTable *before, GHashTable *after, const char *text, const char *name,
                         double change) {
    g_assert_cmpfloat_with_epsilon(number(after, text, name), number(before, text, name) + change,
                                   1e-6);
}

TEST(mouse) {
    struct user u;
    if (!user_sit_down(&u, NULL, (const char *[]){SMALL, NULL}))
        return;
    user_wait_for_title(&u, "eigenmaps.exr");
    g_autoptr(GHashTable) before = user_look(&u);
    x_display_drag(u.x, 1, 360, 200, 50, 20);
    g_autoptr(GHashTable) turned = user_look(&u);
    check_change(before, turned, "Camera", "azimuth", -20.0);
    check_change(before, turned, "Camera", "elevation", 8.0);
    g_assert_cmpstr(user_said(turned, "Light"), ==, user_said(before, "Light"));
    x_display_drag(u.x, 3, 360, 200, -25, 10);
    g_autoptr(GHashTable) lit = user_look(&u);
    g_assert_cmpstr(user_said(lit, "Camera"), ==, user_said(turned, "Camera"));
    check_change(before, lit, "Light", "phi", -10.0);
    check_change(before, lit, "Light", "theta", 4.0);
    x_display_click(u.x, 4, 360, 200);
    g_autoptr(GHashTable) nearer = user_look(&u);
    g_assert_cmpfloat_with_epsilon(number(nearer, "Camera", "distance"),
                                   0.9 * number(before, "Camera", "distance"), 1e-6);
    /* On the panel the mouse is the panel's. */
    x_display_drag(u.x, 1, 30, 14, 0, 200);
    g_autoptr(GHashTable) same = user_look(&u);
    g_assert_cmpstr(user_said(same, "Camera"), ==, user_said(nearer, "Camera"));
    x_display_key(u.x, "r");
    g_autoptr(GHashTable) reset = user_look(&u);
    check_change(before, reset, "Camera", "elevation", 0.0);
    g_assert_cmpstr(user_said(reset, "Light"), ==, user_said(before, "Light"));
    g_free(user_leave(&u));
}

/* Finds the middle of the chosen light's dot: the mean position of the pixels of its colour
 * (COLOURS in ui.cpp). Returns FALSE if there are too few. */
static gboolean find_light(struct user *u, int ret[2]) {
    static const guint8 colour[3] = {255, 210, 80};
    int width, height, n = 0;
    double sum[2] = {0};
    g_autofree guint8 *rgb = x_display_picture(u->x, &width, &height);
    for (int i = 0; i < width * height; i++)
        if (memcmp(rgb + (gsize)3 * i, colour, 3) == 0) {
            sum[0] += i % width;
            sum[1] += (double)(i / width);
            n++;
        }
    ret[0] = (int)lrint(sum[0] / MAX(n, 1));
    ret[1] = (int)lrint(sum[1] / MAX(n, 1));
    return n > 50; /* its disc has a radius of 5 pixels */
}

/* A lamp is dragged on its hemisphere while another hemisphere shows which views exist. */
TEST(drag_lamp) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *session = capturing_session_new(folder),
                    *made = view_fixture_write_btf(GREY, N_RINGS, N_PHI);
    struct user u;
    int from[2];
    capturing_move_view(made, session, 0);
    if (user_sit_down(&u, session, (const char *[]){"--size", "800x740", NULL})) {
        user_wait_for_title(&u, "eigenmaps.exr");
        UNTIL (find_light(&u, from))
            g_usleep(50000);
        g_autoptr(GHashTable) before = user_look(&u);
        /* The window draws between the parts of a drag, as with a person's hand. On a busy computer
         * it may not, and then the drag is repeated more slowly. */
        g_autoptr(GHashTable) after = g_hash_table_ref(before);
        gulong pause_us = 100000;
        UNTIL (strcmp(user_said(after, "Light"), user_said(before, "Light")) != 0) {
            for (int k = 0; k <= 2; k++) {
                x_display_move(u.x, from[0] + 10 * k, from[1] - 5 * k);
                g_usleep(pause_us);
                if (k == 0)
                    x_display_press(u.x, 1, TRUE);
                g_usleep(pause_us);
            }
            x_display_press(u.x, 1, FALSE);
            g_hash_table_unref(after);
            after = user_look(&u);
            pause_us = MIN(2 * pause_us, G_USEC_PER_SEC);
        }
        g_assert_cmpstr(user_said(after, "Camera"), ==, user_said(before, "Camera"));
        g_free(user_leave(&u));
    }
    remove_tree(made);
}

TEST(keys) {
    struct user u;
    if (!user_sit_down(&u, NULL, (const char *[]){SMALL, "--shape", "cylinder", NULL}))
        return;
    static const char *const shapes[][2] = {
        {"1", "plane"},    {"2", "torus"},      {"3", "sphere"},
        {"4", "cylinder"}, {"5", "torus-knot"}, {"0", "cylinder"},
    };
    user_wait_for_title(&u, "eigenmaps.exr");
    for (gsize k = 0; k < G_N_ELEMENTS(shapes); k++) {
        x_display_key(u.x, shapes[k][0]);
        g_autoptr(GHashTable) texts = user_look(&u);
        g_assert_cmpstr(user_said(texts, "Shape"), ==, shapes[k][1]);
    }
    g_autoptr(GHashTable) before = user_look(&u);
    g_assert_cmpstr(user_said(before, "Exposure"), ==, "0.7 EV, ambient 0.05");
    g_assert_cmpstr(user_said(before, "Tiles"), ==, "5 x 2");
    g_assert_cmpstr(user_said(before, "Relief"), ==, "none");
    x_display_key(u.x, "plus");
    x_display_key(u.x, "bracketright");
    x_display_key(u.x, "h");
    g_autoptr(GHashTable) after = user_look(&u);
    g_assert_cmpstr(user_said(after, "Exposure"), ==, "0.95 EV, ambient 0.05");
    g_assert_cmpstr(user_said(after, "Tiles"), ==, "6.25 x 2.5");
    g_assert_cmpstr(user_said(after, "Relief"), ==, "shadows");
    /* There is no MDF: said, and nothing else changes. */
    x_display_key(u.x, "o");
    x_display_key(u.x, "minus");
    g_autoptr(GHashTable) last = user_look(&u);
    g_assert_cmpstr(user_said(last, "Relief"), ==, "shadows");
    g_assert_cmpstr(user_said(last, "Exposure"), ==, "0.7 EV, ambient 0.05");
    g_usleep(500000);
    x_display_chord(u.x, NULL, "Control_L", "w");
    g_autofree char *err = user_stand_up(&u, 0);
    g_assert_nonnull(strstr(err, "products/mdf.exr"));
}

static int count_different(const guint8 *a, const guint8 *b, int n) {
    int different = 0;
    for (int k = 0; k < n; k++)
        different += memcmp(a + (gsize)3 * k, b + (gsize)3 * k, 3) != 0;
    return different;
}

/* A picture of the window once it no longer changes and, unless before is NULL, differs from that
 * in as many pixels. */
static guint8 *settled(struct user *u, const guint8 *before, int at_least, int *ret_n) {
    int width, height;
    guint8 *now = x_display_picture(u->x, &width, &height);
    for (int k = 0; k < 100; k++) {
        g_usleep(200000);
        guint8 *next = x_display_picture(u->x, &width, &height);
        const int changing = count_different(now, next, width * height);
        g_free(now);
        now = next;
        if (changing == 0 &&
            (before == NULL || count_different(before, now, width * height) >= at_least))
            break;
    }
    *ret_n = width * height;
    return now;
}

/* F1 shows the keys, Tab hides the panel, and both put back what was there. The mouse is moved
 * aside, for what it lies on may be lit. */
TEST(help) {
    struct user u;
    int n;
    const int help_pixels = 100 * 200, panel_pixels = 200 * 300;
    if (!user_sit_down(&u, NULL, (const char *[]){"--size", "700x480", NULL}))
        return;
    user_wait_for_title(&u, "eigenmaps.exr");
    x_display_move(u.x, 690, 470);
    g_autofree guint8 *before = settled(&u, NULL, 0, &n);
    x_display_key(u.x, "F1");
    g_autofree guint8 *help = settled(&u, before, help_pixels, &n);
    g_assert_cmpint(count_different(before, help, n), >=, help_pixels);
    x_display_key(u.x, "F1");
    g_autofree guint8 *without = settled(&u, help, help_pixels, &n);
    x_display_key(u.x, "Tab");
    g_autofree guint8 *bare = settled(&u, without, panel_pixels, &n);
    g_assert_cmpint(count_different(before, bare, n), >=, panel_pixels);
    x_display_key(u.x, "Tab");
    g_autofree guint8 *again = settled(&u, bare, panel_pixels, &n);
    /* The time that a picture took is written in the panel. */
    g_assert_cmpint(count_different(before, again, n), <, 300 * 60);
    g_free(user_leave(&u));
}

/* Processor time of a program so far: fields 14 and 15 of /proc/PID/stat, in clock ticks. */
static double spent_s(const char *pid) {
    g_autofree char *path = g_strdup_printf("/proc/%s/stat", pid);
    g_autofree char *text = NULL;
    ok(g_file_get_contents(path, &text, NULL, ERR));
    g_auto(GStrv) fields = g_strsplit(strrchr(text, ')') + 2, " ", -1); /* from the third on */
    return (g_ascii_strtod(fields[11], NULL) + g_ascii_strtod(fields[12], NULL)) /
           (double)sysconf(_SC_CLK_TCK);
}

/* An idle window takes less than 2 % of a core, and then answers immediately. */
TEST(idle) {
    struct user u;
    const double watched_s = 5;
    int n;
    if (!user_sit_down(&u, NULL, (const char *[]){"--size", "700x480", NULL}))
        return;
    user_wait_for_title(&u, "eigenmaps.exr");
    g_free(settled(&u, NULL, 0, &n));
    const char *pid = g_subprocess_get_identifier(u.program);
    const double before_s = spent_s(pid);
    g_usleep((gulong)(watched_s * G_USEC_PER_SEC));
    const double share = (spent_s(pid) - before_s) / watched_s;
    g_test_message("%.2f %% of a core", 100 * share);
    g_assert_cmpfloat(share, <, 0.02);
    x_display_key(u.x, "3");
    g_autoptr(GHashTable) texts = user_look(&u);
    g_assert_cmpstr(user_said(texts, "Shape"), ==, "sphere");
    g_free(user_leave(&u));
}

/* Adds the letters next to ASCII of a C file, without its comments, to a set. */
static void add_letters(GHashTable *to, const char *path) {
    g_autofree char *text = NULL;
    ok(g_file_get_contents(path, &text, NULL, ERR));
    g_autoptr(GRegex) comments = g_regex_new("/\\*.*?\\*/", G_REGEX_DOTALL, 0, NULL);
    g_autofree char *code = g_regex_replace_literal(comments, text, -1, 0, "", 0, NULL);
    for (const char *at = code; *at != 0; at = g_utf8_next_char(at)) {
        char letter[8] = {0};
        g_unichar_to_utf8(g_utf8_get_char(at), letter);
        if ((guchar)letter[0] >= 0x80)
            g_hash_table_add(to, g_strdup(letter));
    }
}

/* The window's font has every letter that the sources of what it shows have. */
TEST(glyphs) {
    const char *const folders[] = {"window", "drawing/methods"};
    g_autoptr(GHashTable) letters = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    for (gsize k = 0; k < G_N_ELEMENTS(folders); k++) {
        g_autofree char *folder = g_build_filename(SOURCE_DIR "/renderer", folders[k], NULL);
        g_autoptr(GDir) dir = g_dir_open(folder, 0, NULL);
        g_assert_nonnull(dir);
        for (const char *name; (name = g_dir_read_name(dir)) != NULL;) {
            g_autofree char *path = g_build_filename(folder, name, NULL);
            if ((g_str_has_suffix(name, ".c") || g_str_has_suffix(name, ".cpp")))
                add_letters(letters, path);
        }
    }
    g_assert_true(g_hash_table_contains(letters, "φ"));
    g_assert_false(ui_has_glyphs("日")); /* it can say no */
    GHashTableIter iter;
    gpointer letter;
    g_hash_table_iter_init(&iter, letters);
    while (g_hash_table_iter_next(&iter, &letter, NULL))
        if (!ui_has_glyphs(letter))
            g_error("the window's font has no “%s”", (char *)letter);
}

enum closing { BY_KEY, BY_DESKTOP, BY_DISPLAY, N_CLOSINGS };

static void close_window(struct user *u, enum closing how) {
    if (how == BY_KEY)
        x_display_chord(u->x, NULL, "Control_L", "q");
    else if (how == BY_DESKTOP)
        x_display_ask_to_close(u->x);
    else
        x_display_kill(u->x);
    g_free(user_stand_up(u, how == BY_DISPLAY ? 1 : 0));
}

/* Asked by the desktop, and the display gone: an end without a crash. */
TEST(closed) {
    for (int how = BY_DESKTOP; how < N_CLOSINGS; how++) {
        struct user u;
        if (!user_sit_down(&u, NULL, (const char *[]){SMALL, NULL}))
            return;
        user_wait_for_title(&u, "eigenmaps.exr");
        close_window(&u, how);
    }
}

/* Eigen-maps that take seconds to open. */
static char *write_large_session(void) {
    char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "products", "eigenmaps.exr", NULL);
    g_autofree char *products = g_path_get_dirname(path);
    g_mkdir(products, 0755);
    struct eigenmaps *m = view_fixture_material(LIGHT, 5, 12);
    m->layout.width = m->layout.height = 160;
    g_free(m->maps);
    m->maps =
        g_new0(float, (gsize)m->n_terms * m->layout.lights.n * btf_layout_texels(&m->layout) * 3);
    GRand *rand = g_rand_new_with_seed(1);
    for (gsize k = 0;
         k < (gsize)m->n_terms * m->layout.lights.n * btf_layout_texels(&m->layout) * 3; k++)
        m->maps[k] = (float)(g_rand_int(rand) & 1023) / 4096.0f;
    g_rand_free(rand);
    ok(eigenmaps_write(path, m, ERR));
    eigenmaps_free(m);
    return dir;
}

/* The same file under another name, for a session is removed once its window is closed. */
static char *link_session(const char *session) {
    char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *from = g_build_filename(session, "products", "eigenmaps.exr", NULL);
    g_autofree char *to = g_build_filename(dir, "products", "eigenmaps.exr", NULL);
    g_autofree char *products = g_path_get_dirname(to);
    g_mkdir(products, 0755);
    g_assert_cmpint(link(from, to), ==, 0);
    return dir;
}

/* While a large file is opened, keys are answered with what there is, and the window closes: by
 * key, asked by the desktop, and with the display gone. */
TEST(opening) {
    struct user u;
    g_autofree char *session = write_large_session(), *first = link_session(session);
    if (!user_sit_down(&u, first, (const char *[]){SMALL, NULL}))
        return;
    x_display_key(u.x, "3");
    g_autoptr(GHashTable) early = user_look(&u);
    g_assert_cmpstr(user_said(early, "Shape"), ==, "sphere");
    g_assert_cmpstr(user_said(early, "Material"), ==, "fabric-ashikhmin");
    user_wait_for_title(&u, "eigenmaps.exr");
    g_autoptr(GHashTable) late = user_look(&u);
    g_assert_cmpstr(user_said(late, "Shape"), ==, "sphere");
    g_free(user_leave(&u));
    for (int how = 0; how < N_CLOSINGS; how++) {
        g_autofree char *again = link_session(session);
        if (!user_sit_down(&u, again, (const char *[]){SMALL, NULL}))
            return;
        close_window(&u, how);
    }
    remove_tree(session);
}
