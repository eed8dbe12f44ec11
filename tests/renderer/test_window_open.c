/* Files that a user opens, saves and uses as light in the window, by dialog, by drag and drop, and
 * by key. The results are read from the window's title, its output, and the pictures that it saves.
 */
#include "lib/file_portal.h"
#include "lib/ok.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "lib/test.h"
#include "lib/view_fixture.h"
#include "lib/window_user.h"
#include "window/settings.h"

#define SIZE     "--size", "460x300"
#define PANEL    300 /* pixels */
#define TRIANGLE "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n"

static void write_file(const struct user *u, const char *name, const char *text, char **ret) {
    *ret = g_build_filename(u->folder, name, NULL);
    g_assert_true(g_file_set_contents(*ret, text, -1, NULL));
}

static void check(struct user *u, const char *name, const char *expected) {
    g_autoptr(GHashTable) texts = user_look(u);
    g_assert_cmpstr(user_said(texts, name), ==, expected);
}

/* Until so many pixels of the window are others than before. */
static void wait_for_change(struct user *u, const guint8 *before, int at_least) {
    int width, height, different = 0;
    for (int k = 0; k < 300 && different < at_least; k++) {
        g_usleep(100000);
        g_autofree guint8 *now = x_display_picture(u->x, &width, &height);
        different = 0;
        for (int i = 0; i < 3 * width * height; i += 3)
            different += memcmp(now + i, before + i, 3) != 0;
    }
    g_assert_cmpint(different, >=, at_least);
}

/* Ctrl+O or Ctrl+S, something typed into the list that the window draws itself, and Enter, which
 * closes it or brings a sentence. */
static void type_path(struct user *u, const char *key, const char *path) {
    int width, height;
    g_usleep(500000); /* nothing moves any more */
    g_autofree guint8 *before = x_display_picture(u->x, &width, &height);
    x_display_chord(u->x, NULL, "Control_L", key);
    wait_for_change(u, before, 5000);
    g_usleep(500000); /* the line has the keyboard a few frames later */
    x_display_type(u->x, path);
    g_usleep(300000);
    g_autofree guint8 *typed = x_display_picture(u->x, &width, &height);
    x_display_key(u->x, "Return");
    wait_for_change(u, typed, 1500);
}

/* The page at the start opens what was opened last; the dialog opens another; an error leaves all
 * as it is; and both are in the desktop's list. */
TEST(start) {
    struct user u;
    g_autofree char *folder = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *first = view_fixture_write_session(), *second = view_fixture_write_session();
    g_autofree char *list = g_build_filename(folder, "recently-used.xbel", NULL);
    g_autofree char *uri = g_filename_to_uri(first, NULL, NULL);
    g_autofree char *other = g_filename_to_uri(second, NULL, NULL);
    g_autofree char *base = g_path_get_basename(first), *second_base = g_path_get_basename(second);
    g_autofree char *title = g_strdup_printf("eigenmaps.exr on torus – %s – Mesorig", base);
    g_autofree char *then = g_strdup_printf("eigenmaps.exr on torus – %s – Mesorig", second_base);
    g_autoptr(GError) error = NULL;
    GBookmarkFile *bookmarks = g_bookmark_file_new();
    g_bookmark_file_set_mime_type(bookmarks, uri, "inode/directory");
    g_bookmark_file_add_application(bookmarks, uri, "mesorig-view", "mesorig-view %f");
    g_bookmark_file_set_mime_type(bookmarks, "file:///usr", "inode/directory");
    g_bookmark_file_add_application(bookmarks, "file:///usr", "another", "another %f");
    g_assert_true(g_bookmark_file_to_file(bookmarks, list, &error));
    g_bookmark_file_free(bookmarks);
    if (user_sit_down_on(&u, NULL, folder, "", (const char *[]){SIZE, NULL})) {
        user_wait_for_title(&u, "fabric-ashikhmin on torus – Mesorig");
        g_usleep(300000);
        x_display_key(u.x, "1");
        user_wait_for_title(&u, title);
        type_path(&u, "o", "/nonexistent");
        x_display_key(u.x, "Escape"); /* the list */
        x_display_key(u.x, "Escape"); /* the error */
        type_path(&u, "o", second);
        user_wait_for_title(&u, then);
        g_autofree char *err = user_leave(&u);
        g_assert_nonnull(strstr(err, "there is no file or folder /nonexistent"));
        bookmarks = g_bookmark_file_new();
        g_assert_true(g_bookmark_file_load_from_file(bookmarks, list, &error));
        g_assert_true(g_bookmark_file_has_application(bookmarks, other, "mesorig-view", NULL));
        g_assert_false(
            g_bookmark_file_has_application(bookmarks, "file:///usr", "mesorig-view", NULL));
        g_bookmark_file_free(bookmarks);
    }
    remove_tree(folder);
    remove_tree(first);
    remove_tree(second);
}

/* Things let go over the window. */
TEST(drop) {
    struct user u;
    g_autofree char *session = view_fixture_write_session();
    g_autofree char *shape = NULL, *text = NULL, *sky = NULL;
    static const char *const channels[] = {"B", "G", "R", NULL};
    if (!user_sit_down(&u, "", (const char *[]){SIZE, NULL}))
        return;
    write_file(&u, "own.obj", TRIANGLE, &shape);
    write_file(&u, "notes.txt", "nothing to be seen", &text);
    sky = g_build_filename(u.folder, "sky.exr", NULL);
    struct exr_file *file = exr_file_new();
    struct exr_part *part = exr_part_new("sky", 4, 2, channels, EXR_FLOAT);
    for (int k = 0; k < 8; k++)
        part->planes[0][k] = part->planes[1][k] = part->planes[2][k] = 1.0F;
    exr_file_add(file, part);
    g_assert_true(exr_write(sky, file, EXR_NONE, FALSE, NULL));
    exr_file_free(file);
    user_wait_for_title(&u, "fabric-ashikhmin");
    x_display_drop(u.x, (const char *[]){text, NULL});
    x_display_drop(u.x, (const char *[]){session, shape, sky, NULL});
    user_wait_for_title(&u, "eigenmaps.exr on own.obj");
    for (int k = 0; k < 100; k++) { /* opened in the background */
        g_autoptr(GHashTable) texts = user_look(&u);
        if (g_str_equal(user_said(texts, "Environment"), "sky.exr"))
            break;
        g_assert_cmpint(k, <, 99);
    }
    g_autofree char *err = user_leave(&u);
    g_assert_nonnull(strstr(err, "notes.txt is a file of another kind"));
    remove_tree(session);
}

/* The desktop's dialogs, where there are any. */
TEST(portal) {
    struct user u;
    g_autofree char *session = view_fixture_write_session();
    FilePortal *portal = file_portal_new();
    if (user_sit_down_on(&u, file_portal_bus(portal), NULL, "", (const char *[]){SIZE, NULL})) {
        g_autofree char *saved = g_build_filename(u.folder, "saved.png", NULL);
        user_wait_for_title(&u, "fabric-ashikhmin");
        x_display_chord(u.x, NULL, "Control_L", "o"); /* cancelled */
        g_autofree char *first = file_portal_wait(portal, 1);
        g_assert_cmpstr(first, ==, "OpenFile");
        file_portal_answer(portal, session);
        x_display_chord(u.x, "Shift_L", "Control_L", "o");
        g_autofree char *second = file_portal_wait(portal, 2);
        g_assert_cmpstr(second, ==, "OpenFile directory");
        user_wait_for_title(&u, "eigenmaps.exr");
        file_portal_answer(portal, saved);
        x_display_chord(u.x, NULL, "Control_L", "s");
        g_autofree char *third = file_portal_wait(portal, 3);
        g_autofree char *name = g_path_get_basename(session);
        g_autofree char *expected = g_strdup_printf("SaveFile %s-001.png", name);
        g_assert_cmpstr(third, ==, expected);
        g_autofree char *printed = user_read_line(&u);
        g_assert_cmpstr(printed, ==, saved);
        g_free(user_leave(&u));
    }
    file_portal_free(portal);
    remove_tree(session);
}

/* Without a display there is no window; where there is no terminal either, the desktop says why. */
TEST(notice) {
    FilePortal *portal = file_portal_new();
    g_auto(GStrv) environment = g_get_environ();
    g_autofree char *err = NULL;
    int status;
    environment = g_environ_unsetenv(environment, "DISPLAY");
    environment = g_environ_unsetenv(environment, "WAYLAND_DISPLAY");
    environment =
        g_environ_setenv(environment, "DBUS_SESSION_BUS_ADDRESS", file_portal_bus(portal), TRUE);
    const char *const argv[] = {VIEWER, NULL};
    if (view_fixture_have_program()) {
        g_assert_true(g_spawn_sync(NULL, (char **)argv, environment, 0, NULL, NULL, NULL, &err,
                                   &status, NULL));
        g_assert_false(g_spawn_check_wait_status(status, NULL));
        g_autofree char *notice = file_portal_wait(portal, 1);
        g_assert_true(g_str_has_prefix(notice, "Notify no window can be opened here"));
        g_assert_nonnull(strstr(err, "no window can be opened here"));
    }
    file_portal_free(portal);
}

/* What cannot be opened at the start is a sentence; the window stays, and opens something else. */
TEST(mistakes) {
    struct user u;
    g_autofree char *session = view_fixture_write_session();
    char *empty = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    if (!user_sit_down(
            &u, empty,
            (const char *[]){SIZE, "--shape", "no.obj", "--environment", "no.exr", NULL}))
        return;
    user_wait_for_title(&u, "fabric-ashikhmin on torus – Mesorig");
    x_display_key(u.x, "Escape");
    x_display_key(u.x, "Escape");
    x_display_key(u.x, "Escape"); /* none of them closes the window */
    x_display_drop(u.x, (const char *[]){session, NULL});
    user_wait_for_title(&u, "eigenmaps.exr on torus");
    g_autofree char *err = user_leave(&u);
    g_assert_nonnull(strstr(err, empty));
    g_assert_nonnull(strstr(err, "no.obj"));
    g_assert_nonnull(strstr(err, "no.exr"));
    remove_tree(session);
    g_free(empty);
}

/* A name is given once: what is there already is not written over. */
TEST(save) {
    struct user u;
    if (!user_sit_down(&u, NULL, (const char *[]){SIZE, NULL}))
        return;
    g_autofree char *path = g_build_filename(u.folder, "mine.png", NULL);
    g_autofree char *base = g_path_get_basename(u.session);
    g_autofree char *automatic = g_strdup_printf("%s/%s-001.png", u.folder, base);
    g_autofree char *next = g_strdup_printf("%s/%s-002.png", u.folder, base);
    user_wait_for_title(&u, "eigenmaps.exr");
    x_display_key(u.x, "s");
    g_autofree char *first = user_read_line(&u);
    g_assert_cmpstr(first, ==, automatic);
    x_display_key(u.x, "s");
    g_autofree char *second = user_read_line(&u);
    g_assert_cmpstr(second, ==, next);
    type_path(&u, "s", "mine");
    g_autofree char *third = user_read_line(&u);
    g_assert_cmpstr(third, ==, path);
    g_assert_true(g_file_set_contents(path, "kept", -1, NULL));
    type_path(&u, "s", "mine");
    x_display_key(u.x, "Escape");
    x_display_key(u.x, "Escape");
    check(&u, "Shape", "torus"); /* all before it is done */
    g_autofree char *text = NULL;
    g_assert_true(g_file_get_contents(path, &text, NULL, NULL));
    g_assert_cmpstr(text, ==, "kept");
    g_autofree char *err = user_leave(&u);
    g_assert_nonnull(strstr(err, "already exists"));
}

/* Columns of the window that show the material, which is coloured; the rest is grey. */
static void find_shape(struct user *u, int from, int *ret_first, int *ret_last) {
    int width, height;
    g_autofree guint8 *rgb = x_display_picture(u->x, &width, &height);
    *ret_first = width;
    *ret_last = -1;
    for (int x = from; x < width; x++)
        for (int y = 0; y < height; y++) {
            const guint8 *p = rgb + 3 * ((gsize)y * width + x);
            if (MAX(MAX(p[0], p[1]), p[2]) - MIN(MIN(p[0], p[1]), p[2]) > 40) {
                *ret_first = MIN(*ret_first, x);
                *ret_last = x;
            }
        }
}

static void wait_centred(struct user *u, int from, int to) {
    int first = 0, last = 0;
    for (int k = 0; k < 300; k++) {
        find_shape(u, from, &first, &last);
        /* Within a twentieth: its dark side counts as grey. */
        if (first > from && last < to && abs(first + last - from - to) <= (to - from) / 10)
            return;
        g_usleep(100000);
    }
    g_error("the shape is at %d … %d, not in the middle of %d … %d", first, last, from, to);
}

/* The shape is in the middle of what the panel leaves, and of all when it is folded; full screen
 * and back; Esc never quits. */
TEST(panel) {
    struct user u;
    int width, height;
    if (!user_sit_down(&u, NULL, (const char *[]){"--size", "700x300", NULL}))
        return;
    user_wait_for_title(&u, "eigenmaps.exr");
    wait_centred(&u, PANEL, 700);
    x_display_key(u.x, "Tab");
    wait_centred(&u, 30, 700 - 30); /* a button lies in the corner */
    x_display_key(u.x, "Tab");
    wait_centred(&u, PANEL, 700);
    x_display_key(u.x, "F11");
    wait_centred(&u, PANEL, 1024);
    x_display_size(u.x, &width, &height);
    g_assert_cmpint(width, ==, 1024);
    g_assert_cmpint(height, ==, 768);
    x_display_key(u.x, "Escape");
    wait_centred(&u, PANEL, 700);
    x_display_size(u.x, &width, &height);
    g_assert_cmpint(width, ==, 700);
    x_display_key(u.x, "Escape");
    x_display_key(u.x, "question");
    x_display_key(u.x, "Escape");
    check(&u, "Shape", "torus"); /* it is there */
    g_free(user_leave(&u));
}

/* Lamps come, move and go; so does an environment, which lights and turns. */
TEST(lamps) {
    struct user u;
    if (!user_sit_down(&u, NULL, (const char *[]){SIZE, "--environment-lamps", "2", NULL}))
        return;
    user_wait_for_title(&u, "eigenmaps.exr");
    x_display_key(u.x, "l");
    check(&u, "Lamps", "first 1, and 1 more: 45,320,0.5,0.5,0.5");
    x_display_drag(u.x, 3, 380, 150, 25, -10); /* it is the chosen one */
    g_autoptr(GHashTable) moved = user_look(&u);
    g_assert_cmpstr(user_said(moved, "Lamps"), ==, "first 1, and 1 more: 41,330,0.5,0.5,0.5");
    g_assert_cmpstr(user_said(moved, "Light"), ==, "theta 50 deg, phi 200 deg");
    x_display_key(u.x, "Delete");
    check(&u, "Lamps", "first 1, and 0 more");
    x_display_key(u.x, "e");
    for (int k = 0; k < 100; k++) {
        g_autoptr(GHashTable) lit = user_look(&u);
        if (g_str_equal(user_said(lit, "Environment"), "studio")) {
            g_assert_true(g_str_has_prefix(user_said(lit, "Lamps"), "first 0, and 2 more: "));
            g_assert_cmpstr(user_said(lit, "Exposure"), ==, "0.7 EV, ambient 0");
            break;
        }
        g_assert_cmpint(k, <, 99);
    }
    x_display_key(u.x, "b");
    check(&u, "Environment", "studio, seen behind the shape");
    x_display_key(u.x, "Delete"); /* the first lamp is off already */
    g_free(user_leave(&u));
}

/* The command that the window gives draws the window's picture, after changes of every kind. */
TEST(command) {
    struct user u;
    if (!user_sit_down(&u, NULL,
                       (const char *[]){SIZE, "--environment", "overcast", "--environment-lamps",
                                        "3", "--nearest", "--camera-fov-deg", "40", "--split",
                                        "metal-ward", "--split-at", "0.3", NULL}))
        return;
    user_wait_for_title(&u, "eigenmaps.exr");
    for (int k = 0; k < 100; k++) { /* until both files are open */
        g_autoptr(GHashTable) texts = user_look(&u);
        if (g_str_equal(user_said(texts, "Environment"), "overcast") &&
            g_str_equal(user_said(texts, "Compare"), "split at 0.3"))
            break;
        g_assert_cmpint(k, <, 99);
    }
    x_display_key(u.x, "4");
    x_display_key(u.x, "plus");
    x_display_key(u.x, "bracketright");
    x_display_key(u.x, "h");
    x_display_key(u.x, "l");
    x_display_drag(u.x, 3, 380, 150, 25, -10);
    x_display_drag(u.x, 1, 380, 150, 30, 20);
    x_display_drag(u.x, 2, 380, 150, 8, -6);
    x_display_click(u.x, 4, 380, 150);
    x_display_key(u.x, "b");
    x_display_key(u.x, "s");
    g_autofree char *picture = user_read_line(&u);
    x_display_chord(u.x, NULL, "Control_L", "c");
    g_autofree char *command = user_read_line(&u);
    g_test_message("%s", command);
    g_autofree char *drawn = g_build_filename(u.folder, "picture.png", NULL);
    g_autoptr(GError) error = NULL;
    g_auto(GStrv) argv = NULL;
    g_autofree char *err = NULL;
    int status;
    g_assert_true(g_shell_parse_argv(command, NULL, &argv, &error));
    g_assert_cmpstr(argv[0], ==, "mesorig-view");
    g_free(argv[0]);
    argv[0] = g_strdup(VIEWER);
    ok(g_spawn_sync(u.folder, argv, NULL, 0, NULL, NULL, NULL, &err, &status, ERR));
    if (!g_spawn_check_wait_status(status, NULL))
        g_error("%s\n%s", command, err);
    int width, height, drawn_width, drawn_height, different = 0;
    g_autofree guint8 *seen = view_fixture_read_png(picture, &width, &height);
    g_autofree guint8 *again = view_fixture_read_png(drawn, &drawn_width, &drawn_height);
    g_assert_cmpint(drawn_width, ==, width);
    g_assert_cmpint(drawn_height, ==, height);
    for (int k = 0; k < 3 * width * height; k++)
        different += ABS(seen[k] - again[k]) > 2;
    g_assert_cmpint(different, <=, 3 * width * height / 1000);
    g_free(user_leave(&u));
}

/* Every control of the panel is an option of the command line, and every option of the table is in
 * the manual page. */
TEST(table) {
    struct viewer_options options;
    g_autofree char *manual = NULL;
    viewer_options_init(&options);
    g_autofree GOptionEntry *entries = viewer_options_entries(&options);
    g_assert_true(g_file_get_contents(SOURCE_DIR "/etc/man/mesorig-view.1", &manual, NULL, NULL));
    int n_labels = 0;
    for (int k = 0; k < SETTINGS; k++) {
        const struct setting *setting = &settings_table[k];
        g_autofree char *pattern = g_strdup_printf("^\\.It .*Fl -%s\\b", setting->option);
        int n = 0;
        for (const GOptionEntry *entry = entries; entry->long_name != NULL; entry++)
            n += g_str_equal(entry->long_name, setting->option);
        if (n != 1)
            g_error("--%s is an option %d times", setting->option, n);
        if (!g_regex_match_simple(pattern, manual, G_REGEX_MULTILINE, 0))
            g_error("the manual page lacks --%s", setting->option);
        n_labels += setting->label != NULL;
    }
    g_assert_cmpint(n_labels, >, 20);
}
