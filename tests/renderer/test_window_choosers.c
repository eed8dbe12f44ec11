/* Choosers and sliders of the window's panel, operated with the mouse. The test finds them in the
 * picture as a user does, and reads the results from screenshots. */
#include "lib/capturing_fixture.h"
#include "lib/fields_fixture.h"
#include "lib/remove_tree.h"
#include "lib/skip.h"
#include "lib/test.h"
#include "lib/wait.h"
#include "lib/window_user.h"

#include <fcntl.h>
#include <png.h>
#include <signal.h>
#include <unistd.h>

#define DEADLINE_S 60
#define WINDOW     "--with-panel" /* a screenshot is what is there, and costs no picture */

/* A picture of the window. */
struct seen {
    guint8 *rgb;
    int width, height;
};

static const guint8 *pixel(const struct seen *s, int x, int y) {
    return s->rgb + 3 * ((gsize)y * s->width + x);
}

/* Choosers lie below each other; all open by an arrow at their right, white on
 * blue. Beside it lies the blue only. */
#define ARROW_X 147
#define BLUE_X  140
/* Middle of a chooser to that of the first item of its list, and from item to
 * item. */
#define LIST_Y 28
#define ITEM_Y 19
/* Of choosers and sliders. */
#define LEFT  8
#define RIGHT 158

static struct seen see(struct user *u) {
    struct seen s;
    s.rgb = x_display_picture(u->x, &s.width, &s.height);
    return s;
}

/* Without the name of the last picture, which any key takes away, once nothing changes. */
static struct seen see_settled(struct user *u) {
    gboolean same = FALSE;
    x_display_key(u->x, "Shift_L");
    g_usleep(500000);
    struct seen last = see(u);
    UNTIL (same) {
        g_usleep(200000);
        struct seen now = see(u);
        same = memcmp(now.rgb, last.rgb, (gsize)3 * now.width * now.height) == 0;
        g_free(last.rgb);
        last = now;
    }
    return last;
}

static GArray *arrows(const struct seen *s) {
    GArray *rows = g_array_new(FALSE, FALSE, sizeof(int));
    for (int y = 0, from = -1, white = 0; y < s->height; y++) {
        const guint8 *beside = pixel(s, BLUE_X, y), *in = pixel(s, ARROW_X, y);
        const gboolean blue = beside[2] > beside[0] + 55;
        if (blue && from < 0) {
            from = y;
            white = 0;
        }
        white += from >= 0 && in[0] > 200 && in[1] > 200 && in[2] > 200;
        if (from >= 0 && !blue) {
            const int middle = (from + y) / 2;
            if (y - from >= 12 && white >= 4)
                g_array_append_val(rows, middle);
            from = -1;
        }
    }
    return rows;
}

/* How many pixels of a box have become others; what shines through the panel
 * from behind changes less. */
struct box {
    int x0, y0, x1, y1;
};

static int count_different(const struct seen *a, const struct seen *b, const struct box *box) {
    int different = 0;
    for (int y = MAX(box->y0, 0); y < MIN(box->y1, a->height); y++)
        for (int x = MAX(box->x0, 0); x < MIN(box->x1, a->width); x++) {
            const guint8 *of_a = pixel(a, x, y), *of_b = pixel(b, x, y);
            different += ABS(of_a[0] - of_b[0]) > 20 || ABS(of_a[1] - of_b[1]) > 20 ||
                         ABS(of_a[2] - of_b[2]) > 20;
        }
    return different;
}

/* Until a box looks otherwise than before. */
static gboolean wait_for_change(struct user *u, const struct seen *before, const struct box *box,
                                int at_least, double seconds) {
    const gint64 until = g_get_monotonic_time() + (gint64)(seconds * G_USEC_PER_SEC);
    int different = 0;
    do {
        struct seen now = see(u);
        different = count_different(before, &now, box);
        g_free(now.rgb);
        g_usleep(20000);
    } while (different < at_least && g_get_monotonic_time() < until);
    return different >= at_least;
}

/* Moves the mouse there from elsewhere, and waits until what lies there is lit:
 * where frames are slow, what comes within one frame is lost on the panel. */
static gboolean point(struct user *u, int x, int row, double seconds) {
    const struct box box = {LEFT, row - 7, RIGHT, row + 7};
    struct seen before = see(u);
    x_display_move(u->x, x, row);
    const gboolean lit = wait_for_change(u, &before, &box, 100, seconds);
    g_free(before.rgb);
    return lit;
}

/* Rows of the choosers, once there are as many and they stay where they are:
 * notes come and go above them. */
static GArray *find_choosers(struct user *u, guint n) {
    gboolean stays = FALSE;
    GArray *last = NULL;
    x_display_move(u->x, 390, 450); /* nothing is lit */
    UNTIL (stays) {
        g_usleep(200000);
        struct seen s = see(u);
        GArray *rows = arrows(&s);
        g_free(s.rgb);
        stays = last != NULL && rows->len == n && last->len == n &&
                memcmp(rows->data, last->data, n * sizeof(int)) == 0;
        g_clear_pointer(&last, g_array_unref);
        last = rows;
    }
    return last;
}

/* Opens a chooser (of n that there are, from the top), and takes an item of its
 * list. */
static void choose(struct user *u, guint n, guint chooser, int item) {
    int row, tries = 0;
    do { /* anew if it has moved away meanwhile */
        g_autoptr(GArray) rows = find_choosers(u, n);
        row = g_array_index(rows, int, chooser);
        if (++tries > DEADLINE_S / 5)
            g_error("chooser %u of %u is not lit", chooser, n);
    } while (!point(u, ARROW_X, row, 5.0));
    const int at = row + LIST_Y + item * ITEM_Y;
    const struct box list = {LEFT, row + LIST_Y - 9, RIGHT, row + LIST_Y + ITEM_Y};
    struct seen closed = see(u);
    x_display_click(u->x, 1, ARROW_X, row);
    g_assert_true(wait_for_change(u, &closed, &list, 100, DEADLINE_S));
    g_free(closed.rgb);
    g_assert_true(point(u, 100, at, DEADLINE_S));
    struct seen open = see(u);
    x_display_click(u->x, 1, 100, at);
    g_assert_true(wait_for_change(u, &open, &list, 100, DEADLINE_S));
    g_free(open.rgb);
}

static void check(struct user *u, const char *name, const char *expected) {
    g_autoptr(GHashTable) texts = user_look(u);
    g_assert_cmpstr(user_said(texts, name), ==, expected);
}

/* A product is opened, and views come, while the window goes on. */
static void wait_for(struct user *u, const char *name, const char *expected) {
    const gint64 until = g_get_monotonic_time() + DEADLINE_S * G_USEC_PER_SEC;
    g_autofree char *last = NULL;
    while (g_get_monotonic_time() < until) {
        g_autoptr(GHashTable) texts = user_look(u);
        g_free(last);
        last = g_strdup(user_said(texts, name));
        if (g_str_equal(last, expected))
            return;
    }
    g_error("%s: “%s” was not reached, but “%s”", name, expected, last);
}

static gboolean start(struct user *u, const char *const *options) {
    g_autofree char *session = view_fixture_write_session();
    g_autofree char *fields = g_build_filename(session, "products", "fields.exr", NULL);
    fields_fixture_write(fields, W, H);
    if (!user_sit_down(u, session, options))
        return FALSE;
    user_wait_for_title(u, "eigenmaps.exr");
    return TRUE;
}

/* Methods, shapes, two halves of the picture and their difference. */
TEST(choosers) {
    struct user u;
    if (!start(&u, (const char *[]){WINDOW, "--size", "400x500", NULL}))
        return;
    choose(&u, 5, 2, 2);
    check(&u, "Shape", "sphere");
    choose(&u, 5, 0, 5);
    user_wait_for_title(&u, "fields.exr");
    check(&u, "Compare", "one picture");
    choose(&u, 5, 1, 1); /* split; there is one chooser more now */
    wait_for(&u, "Source", "reflectance fields, and on the right reflectance fields");
    choose(&u, 6, 2, 0);
    wait_for(&u, "Source", "reflectance fields, and on the right eigen-maps");
    choose(&u, 6, 1, 2);
    wait_for(&u, "Source", "reflectance fields, and how much brighter is eigen-maps");
    check(&u, "Compare", "difference times 4");
    /* What is not there: said, and nothing else changes. */
    const struct box bottom = {305, 420, 400, 500};
    struct seen without = see(&u);
    choose(&u, 6, 0, 4);
    g_assert_true(wait_for_change(&u, &without, &bottom, 300, DEADLINE_S));
    g_free(without.rgb);
    check(&u, "Source", "reflectance fields, and how much brighter is eigen-maps");
    g_autofree char *err = user_leave(&u);
    g_assert_nonnull(strstr(err, "products/lpca.exr"));
}

/* A normal map and a shape, in the folder of a session. */
static void write_own(const char *session, char **ret_map, char **ret_shape) {
    guint8 flat[3 * 4];
    png_image image = {
        .version = PNG_IMAGE_VERSION, .width = 2, .height = 2, .format = PNG_FORMAT_RGB};
    for (int k = 0; k < 4; k++)
        memcpy(flat + 3 * k, (const guint8[]){128, 128, 255}, 3);
    *ret_map = g_build_filename(session, "flat.png", NULL);
    *ret_shape = g_build_filename(session, "own.obj", NULL);
    g_assert_true(png_image_write_to_file(&image, *ret_map, 0, flat, 0, NULL));
    g_assert_true(g_file_set_contents(*ret_shape,
                                      "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\n"
                                      "f 1/1 2/2 3/3\n",
                                      -1, NULL));
}

/* Whoever opens the file from now on has to wait for give_back(), for
 * lease-break-time (45 s) at most. -1: there are no leases here. */
static int take(const char *path) {
    signal(SIGIO, SIG_IGN); /* somebody waits */
    const int fd = open(path, O_RDWR | O_CLOEXEC);
    g_assert_cmpint(fd, >=, 0);
    if (fcntl(fd, F_SETLEASE, F_WRLCK) == 0)
        return fd;
    close(fd);
    return -1;
}

static gboolean is_waited_for(int fd) {
    return fcntl(fd, F_GETLEASE) == F_RDLCK;
}

static void give_back(int fd) {
    fcntl(fd, F_SETLEASE, F_UNLCK);
    close(fd);
}

#define METAL "brushed metal (Ashikhmin and Shirley)"

/* A method of another file, and shapes, while that file takes its time: what
 * was chosen comes. */
TEST(while_opening) {
    struct user u;
    g_autofree char *session = view_fixture_write_session(), *map = NULL, *shape = NULL;
    write_own(session, &map, &shape);
    if (!user_sit_down(&u, session,
                       (const char *[]){WINDOW, "--size", "400x520", "--split", "metal-ashikhmin",
                                        "--normal-map", map, "--shape", shape, NULL}))
        return;
    wait_for(&u, "Source", "eigen-maps, and on the right " METAL);
    const int fd = take(map);
    if (fd >= 0) {
        choose(&u, 7, 0, 13);
        UNTIL (is_waited_for(fd))
            g_usleep(20000);
        choose(&u, 7, 4, 2);
        g_hash_table_unref(user_look(&u));
        g_usleep(1100000); /* the window looks at its files once a second */
        g_hash_table_unref(user_look(&u));
        g_autoptr(GHashTable) meanwhile = user_look(&u);
        g_assert_cmpstr(user_said(meanwhile, "Shape"), ==, "sphere");
        if (is_waited_for(fd))
            g_assert_cmpstr(user_said(meanwhile, "Source"), ==,
                            "eigen-maps, and on the right " METAL);
        give_back(fd);
        user_wait_for_title(&u, "flat.png on sphere");
        check(&u, "Source", METAL ", and on the right " METAL);
        check(&u, "Normals", "flat.png");
        check(&u, "Shape", "sphere");
        choose(&u, 7, 4, 5); /* that which it was started with */
        check(&u, "Shape", "own.obj");
        user_wait_for_title(&u, "flat.png on own.obj");
    } else {
        test_skip_or_fail("the file system knows no leases");
    }
    g_free(user_leave(&u));
}

static double split_at(struct user *u) {
    g_autoptr(GHashTable) texts = user_look(u);
    double at = NAN;
    g_assert_cmpint(sscanf(user_said(texts, "Compare"), "split at %lf", &at), ==, 1);
    return at;
}

static void wait_for_split(struct user *u, double expected, double tolerance) {
    const gint64 until = g_get_monotonic_time() + DEADLINE_S * G_USEC_PER_SEC;
    double at = NAN;
    while (g_get_monotonic_time() < until)
        if (fabs((at = split_at(u)) - expected) <= tolerance)
            return;
    g_error("split at %g, not at %g", at, expected);
}

/* Where the picture is split: pressed, dragged, and dragged beyond its ends;
 * right of a third of the picture there is then the one material or the other. */
TEST(split) {
    struct user u;
    static const struct box beside = {335, 0, 400, 460};
    if (!start(&u, (const char *[]){WINDOW, "--size", "400x460", "--split", "fields", "--shape",
                                    "plane", NULL}))
        return;
    wait_for(&u, "Source", "eigen-maps, and on the right reflectance fields");
    g_assert_cmpfloat(split_at(&u), ==, 0.5);
    g_autoptr(GArray) rows = find_choosers(&u, 6);
    const int *row = (const int *)(const void *)rows->data;
    const int y = 2 * row[2] - row[1]; /* below the last */
    const int quarter = LEFT + (RIGHT - LEFT) / 4;
    g_assert_true(point(&u, quarter, y, DEADLINE_S));
    x_display_press(u.x, 1, TRUE);
    wait_for_split(&u, 0.25, 0.05);
    struct seen second = see_settled(&u);
    x_display_move(u.x, 399, y);
    wait_for_split(&u, 1.0, 0.0);
    g_assert_true(wait_for_change(&u, &second, &beside, 1000, DEADLINE_S));
    struct seen first = see(&u);
    x_display_move(u.x, 1, y);
    wait_for_split(&u, 0.0, 0.0);
    g_assert_true(wait_for_change(&u, &first, &beside, 1000, DEADLINE_S));
    x_display_press(u.x, 1, FALSE);
    g_hash_table_unref(user_look(&u));
    x_display_move(u.x, quarter, y);
    g_hash_table_unref(user_look(&u));
    g_assert_cmpfloat(split_at(&u), ==, 0.0); /* let go */
    struct seen again = see_settled(&u);
    g_assert_cmpint(count_different(&second, &again, &beside), ==, 0);
    g_free(second.rgb);
    g_free(first.rgb);
    g_free(again.rgb);
    g_free(user_leave(&u));
}

/* What is chosen while views come stays; eigen-maps of those that are there can be had back. */
TEST(while_capturing) {
    TEMPORARY_FOLDER(folder);
    g_autofree char *session = capturing_session_new(folder),
                    *made = view_fixture_write_btf(GREY, N_RINGS, N_PHI);
    g_autofree char *fields = g_build_filename(session, "products", "fields.exr", NULL);
    struct user u;
    fields_fixture_write(fields, W, H);
    capturing_move_view(made, session, 0);
    if (user_sit_down(&u, session, (const char *[]){WINDOW, "--size", "400x600", NULL})) {
        user_wait_for_title(&u, "eigenmaps.exr");
        choose(&u, 5, 0, 5);
        wait_for(&u, "Source", "reflectance fields");
        for (int view = 1; view < 5; view++) {
            capturing_move_view(made, session, view);
            g_autofree char *views = g_strdup_printf(
                "%d of %d; where the nearest to the line of sight is missing, striped", view + 1,
                N);
            wait_for(&u, "Views", views); /* looked for once a second, as new eigen-maps are */
        }
        check(&u, "Source", "reflectance fields");
        choose(&u, 5, 0, 0);
        wait_for(&u, "Source", "eigen-maps");
        g_free(user_leave(&u));
    }
    remove_tree(made);
}
