/*
 * The size of a board in pictures: chessboards, ChArUco boards, grids of markers and of circles of
 * many sizes, seen from many sides, some partly covered or partly outside of the picture. The views
 * are computed here: a pinhole above a plane, light that falls off, a blurred picture with noise,
 * and strips of dark, grey or white paper over the board's edge.
 *
 * BUILD/bin/test_board_size --print counts over more sizes and views: for docs/operate/mistakes.md;
 * a number of 0 … 6 after it: of this print only.
 */
#include "cameras/board_size.h"
#include "lib/ok.h"

#include <math.h>
#include <string.h>

#define WIDTH   480
#define HEIGHT  360
#define SAMPLES 2 /* a pixel, along each side */

enum cover { BARE, COVERED, CUT };

struct view {
    double turn_rad, tilt_rad, azimuth_rad;
    enum cover cover;
    double paper;    /* its reflectance */
    double paper_mm; /* how far it reaches over the board's edge; */
    int side;        /* at this side */
    double lean;     /* slope of its edge */
};

static struct board parse(const char *spec) {
    struct board board;
    g_assert_true(ok(board_parse(&board, spec, ERR)));
    return board;
}

static struct view random_view(GRand *rand, const struct board *board, enum cover cover) {
    return (struct view){
        .turn_rad = g_rand_double_range(rand, 0, 2 * G_PI),
        .tilt_rad = g_rand_double_range(rand, 0, 0.9),
        .azimuth_rad = g_rand_double_range(rand, 0, 2 * G_PI),
        .cover = cover,
        .paper = (const double[]){0.05, 0.4, 0.9}[g_rand_int_range(rand, 0, 3)],
        .paper_mm = g_rand_double_range(rand, 0.3, 2.5) * board->square_mm,
        .side = g_rand_int_range(rand, 0, 4),
        .lean = g_rand_double_range(rand, -0.05, 0.05),
    };
}

/* Reflectance at a point of the board's plane: the print, its margin, the table. */
static double reflectance(const struct board *board, const struct view *view, double x, double y,
                          double printed) {
    double size[2];
    board_size_mm(board, size);
    const double margin = 0.7 * board->square_mm;
    const double at[4] = {y, x, -y, -x}, along[4] = {x, y, x, y};
    const double edge = view->side % 2 ? size[0] / 2 : size[1] / 2;
    if (view->cover == COVERED &&
        at[view->side] > edge - view->paper_mm + view->lean * along[view->side])
        return view->paper;
    if (printed >= 0)
        return 0.05 + 0.85 * printed;
    return fabs(x) < size[0] / 2 + margin && fabs(y) < size[1] / 2 + margin ? 0.9 : 0.25;
}

static struct picture *see(const struct board *board, const struct view *view, GRand *rand) {
    struct picture *picture = picture_new("view", "view", WIDTH, HEIGHT);
    const int n = SAMPLES * SAMPLES * WIDTH;
    g_autofree double *at = g_new(double, 2 * n);
    g_autofree float *values = g_new(float, n);
    double size[2];
    board_size_mm(board, size);
    /* The board's diagonal fills the picture's height, or goes beyond it. */
    const double far = 3, focal = (view->cover == CUT ? 1.7 : 0.95) * HEIGHT * far;
    const double scale = hypot(size[0], size[1]) + 2 * board->square_mm;
    const double c = cos(view->turn_rad), s = sin(view->turn_rad);
    const double axis[2] = {cos(view->azimuth_rad), sin(view->azimuth_rad)};
    const double shift = view->cover == CUT ? 0.1 : 0;
    const double ct = cos(view->tilt_rad), st = -sin(view->tilt_rad);
    const double normal[3] = {axis[1] * st, -axis[0] * st, ct};
    for (int y = 0; y < HEIGHT; y++) {
        for (int i = 0; i < n; i++) {
            const double u =
                (i / (SAMPLES * SAMPLES) + (i % SAMPLES + 0.5) / SAMPLES - WIDTH / 2.0) / focal;
            const double v = (y + (i / SAMPLES % SAMPLES + 0.5) / SAMPLES - HEIGHT / 2.0) / focal;
            /* A ray (u, v, 1) meets a plane through (0, 0, far) that is tilted about the axis. */
            const double t = far * normal[2] / (u * normal[0] + v * normal[1] + normal[2]);
            const double p[3] = {t * u, t * v, t - far};
            /* Back by the tilt, about the axis (Rodrigues), then by the turn. */
            const double k = axis[0] * p[0] + axis[1] * p[1];
            const double q[2] = {p[0] * ct + axis[1] * p[2] * st + axis[0] * k * (1 - ct),
                                 p[1] * ct - axis[0] * p[2] * st + axis[1] * k * (1 - ct)};
            at[2 * i] = scale * (c * q[0] - s * q[1] + shift);
            at[2 * i + 1] = -scale * (s * q[0] + c * q[1]);
        }
        board_values(board, at, n, values);
        for (int x = 0; x < WIDTH; x++) {
            double sum = 0;
            for (int k = 0; k < SAMPLES * SAMPLES; k++) {
                const int i = x * SAMPLES * SAMPLES + k;
                sum += reflectance(board, view, at[2 * i], at[2 * i + 1], (double)values[i]);
            }
            const double light = 1 + 0.3 * (x - WIDTH / 2.0) / WIDTH;
            picture->values[y * WIDTH + x] = (float)(light * sum / (SAMPLES * SAMPLES) +
                                                     0.02 * g_rand_double_range(rand, -1, 1));
        }
    }
    return picture;
}

static gboolean is_same(const struct board *board, int columns, int rows) {
    return (columns == board->columns && rows == board->rows) ||
           ((board->print == BOARD_CHESSBOARD || board->print == BOARD_CIRCLES) &&
            columns == board->rows && rows == board->columns);
}

struct tally {
    int right, wrong, nothing;
};

static void count(const struct board *board, const struct view *view, GRand *rand,
                  struct tally *to) {
    int columns, rows;
    g_autoptr(Picture) picture = see(board, view, rand);
    if (!board_measure(picture, board, &columns, &rows))
        to->nothing++;
    else if (is_same(board, columns, rows))
        to->right++;
    else {
        to->wrong++;
        g_test_message("%d × %d for %d × %d, tilt %.2f, cover %d %.2f %.1f mm side %d", columns,
                       rows, board->columns, board->rows, view->tilt_rad, (int)view->cover,
                       view->paper, view->paper_mm, view->side);
    }
}

static const char *const keys[] = {"square=10",
                                   "square=10,marker=7,dictionary=5x5_1000",
                                   "square=10,marker=7.5,dictionary=6x6_1000,first=white",
                                   "marker=10,gap=3,dictionary=4x4_1000",
                                   "marker=10,gap=3,grid=kalibr",
                                   "spacing=10,circle=5",
                                   "spacing=10,circle=6,grid=staggered"};

static int print_table(int only) {
    static const int sizes[][2] = {{4, 4}, {5, 4}, {6, 5},  {7, 5},  {7, 7},
                                   {8, 6}, {9, 6}, {10, 7}, {12, 9}, {4, 11}};
    GRand *rand = g_rand_new_with_seed(7);
    for (gsize k = 0; k < G_N_ELEMENTS(keys); k++)
        for (int cover = BARE; cover <= CUT && (only < 0 || only == (int)k); cover++) {
            struct tally tally = {0};
            for (gsize i = 0; i < G_N_ELEMENTS(sizes); i++)
                for (int view = 0; view < 6; view++) {
                    g_autofree char *spec =
                        g_strdup_printf("%dx%d,%s", sizes[i][0], sizes[i][1], keys[k]);
                    const struct board board = parse(spec);
                    const struct view v = random_view(rand, &board, (enum cover)cover);
                    count(&board, &v, rand, &tally);
                }
            g_print("%-55s %-8s right %3d, wrong %3d, nothing %3d\n", keys[k],
                    (const char *const[]){"bare", "covered", "cut"}[cover], tally.right,
                    tally.wrong, tally.nothing);
        }
    g_rand_free(rand);
    return 0;
}

/* A view from not far off the board's normal. */
static struct view easy_view(GRand *rand, const struct board *board) {
    struct view view = random_view(rand, board, BARE);
    view.tilt_rad *= 0.4;
    return view;
}

/* One board for each print; the sizes that are given wrongly for it. */
static const struct mistake {
    const char *path, *real, *keys, *says;
    const char *given[4];
} mistakes[] = {{"/board size/chessboard",
                 "10x7",
                 "square=10",
                 "the pictures show 9 × 6 inner corners = 10 × 7 squares",
                 {"9x6", "10x8", "8x7", "11x8"}},
                {"/board size/charuco",
                 "8x6",
                 "square=10,marker=7,dictionary=5x5_1000",
                 "the pictures show 7 × 5 inner corners = 8 × 6 squares",
                 {"7x5", "6x8", "9x6", "6x6"}},
                {"/board size/markers",
                 "6x4",
                 "marker=10,gap=3,dictionary=4x4_1000",
                 "the pictures show 6 × 4 markers",
                 {"5x4", "4x6", "7x4", "6x3"}},
                {"/board size/circles",
                 "7x5",
                 "spacing=10,circle=5",
                 "the pictures show 7 × 5 circles",
                 {"6x5", "7x6", "8x5", "9x7"}},
                {"/board size/staggered",
                 "4x9",
                 "spacing=10,circle=6,grid=staggered",
                 "the pictures show 4 × 9 circles",
                 {"9x4", "4x11", "5x9", "4x8"}}};
#define N_VIEWS 6

/* What the census says of views of a board, as it is asked while they are searched. NULL: nothing.
 */
static char *ask(const struct board *given, struct picture *const *views, int n) {
    g_autoptr(BoardCensus) census = board_census_new(given);
    for (int i = 0; i < n; i++) {
        g_autoptr(GError) error = NULL;
        g_autoptr(GArray) corners = board_find(views[i], given, TRUE, NULL);
        if (!board_census_after(census, views[i], corners, &error)) {
            g_assert_error(error, BOARD_ERROR, BOARD_ERROR_SPEC);
            return g_strdup(error->message);
        }
    }
    return NULL;
}

static void test_mistake(gconstpointer data) {
    const struct mistake *mistake = data;
    g_autofree char *spec = g_strdup_printf("%s,%s", mistake->real, mistake->keys);
    const struct board board = parse(spec);
    GRand *rand = g_rand_new_with_seed(3);
    struct picture *views[N_VIEWS];
    struct tally tally = {0};
    for (int i = 0; i < N_VIEWS; i++) {
        const struct view view = easy_view(rand, &board);
        int columns, rows;
        views[i] = see(&board, &view, rand);
        const gboolean measured = board_measure(views[i], &board, &columns, &rows);
        tally.right += measured && is_same(&board, columns, rows);
        tally.wrong += measured && !is_same(&board, columns, rows);
    }
    g_test_message("%s: right %d, wrong %d of %d", spec, tally.right, tally.wrong, N_VIEWS);
    g_assert_cmpint(tally.wrong, ==, 0);
    g_assert_cmpint(tally.right, >=, 3);
    g_autofree char *none = ask(&board, views, N_VIEWS);
    g_assert_null(none);
    for (int k = 0; k < 4; k++) {
        g_autofree char *given = g_strdup_printf("%s,%s", mistake->given[k], mistake->keys);
        g_autofree char *give = g_strdup_printf("give --board %s,", mistake->real);
        const struct board wrong = parse(given);
        g_autofree char *said = ask(&wrong, views, N_VIEWS);
        g_test_message("%s: %s", given, said ? said : "nothing");
        g_assert_nonnull(said);
        g_assert_nonnull(strstr(said, mistake->says));
        g_assert_nonnull(strstr(said, give));
    }
    for (int i = 0; i < N_VIEWS; i++)
        picture_free(views[i]);
    g_rand_free(rand);
}

/* A board that is partly covered is not taken for a smaller one, nor is one that reaches beyond the
 * picture. */
static void test_partial(void) {
    static const char *const specs[] = {
        "10x7,square=10", "8x6,square=10,marker=7,dictionary=5x5_1000", "7x5,spacing=10,circle=5"};
    GRand *rand = g_rand_new_with_seed(5);
    struct tally tally = {0};
    for (gsize i = 0; i < G_N_ELEMENTS(specs); i++)
        for (int k = 0; k < 8; k++) {
            const struct board board = parse(specs[i]);
            struct view view = easy_view(rand, &board);
            view.cover = k % 2 ? COVERED : CUT;
            count(&board, &view, rand, &tally);
        }
    g_test_message("right %d, wrong %d, nothing %d", tally.right, tally.wrong, tally.nothing);
    g_assert_cmpint(tally.wrong, ==, 0);
    g_rand_free(rand);
}

/* Large pictures are examined before the search. */
static void test_before(void) {
    const struct board board = parse("10x7,square=10"), given = parse("9x6,square=10");
    GRand *rand = g_rand_new_with_seed(3);
    g_autoptr(BoardCensus) census = board_census_new(&given), right = board_census_new(&board);
    g_autoptr(GError) error = NULL;
    gboolean ok = TRUE, more = TRUE;
    for (int i = 0; i < N_VIEWS && ok && more; i++) {
        const struct view view = easy_view(rand, &board);
        g_autoptr(Picture) small = see(&board, &view, rand);
        g_autoptr(Picture) large = picture_new("large", "large", 4 * WIDTH, 4 * HEIGHT);
        for (int k = 0; k < 16 * WIDTH * HEIGHT; k++)
            large->values[k] = small->values[k / (16 * WIDTH) * WIDTH + k % (4 * WIDTH) / 4];
        ok = board_census_before(census, large, &more, &error);
        gboolean further;
        g_assert_true(board_census_before(right, large, &further, NULL));
    }
    g_rand_free(rand);
    g_assert_false(ok);
    g_assert_nonnull(strstr(error->message, "10 × 7 squares (large and large); give --board 10x7"));
}

int main(int argc, char **argv) {
    if (argc >= 2 && strcmp(argv[1], "--print") == 0)
        return print_table(argc > 2 ? atoi(argv[2]) : -1);
    g_test_init(&argc, &argv, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(mistakes); i++)
        g_test_add_data_func(mistakes[i].path, &mistakes[i], test_mistake);
    g_test_add_func("/board size/partial", test_partial);
    g_test_add_func("/board size/before", test_before);
    return g_test_run();
}
