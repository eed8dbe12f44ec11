/* Boards: an independent detector finds in a drawing what the geometry of the board says. */
#include "cameras/board.h"
#include "cameras/corner.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "pictures/picture_read.h"
#include "pictures/vision.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>

static char *folder;

static struct board parse(const char *spec) {
    struct board board;

    g_assert_true(ok(board_parse(&board, spec, ERR)));
    return board;
}

static struct picture *draw(const struct board *board, const char *name) {
    g_autoptr(GError) error = NULL;
    g_autofree char *path = g_build_filename(folder, name, NULL);
    const struct board_drawing drawing = {5, 8};

    g_assert_true(board_draw(board, path, &drawing, &error));
    struct picture *picture = ok(picture_read(path, ERR));
    g_unlink(path);
    return picture;
}

static double board_value(const struct board *board, double x_mm, double y_mm) {
    float value;

    board_values(board, (const double[]){x_mm, y_mm}, 1, &value);
    return (double)value;
}

TEST(spec) {
    static const char *const bad[] = {"",
                                      "8",
                                      "8x",
                                      "2x8,square=9",
                                      "41x8,square=9",
                                      "8x8",
                                      "8x8,square=nan,marker=6",
                                      "8x8,square=9,marker=9",
                                      "8x8,square=-9,marker=6",
                                      "8x8,square=9,marker=6,dictionary=9x9",
                                      "12x12,square=9,marker=6,dictionary=4x4_50",
                                      "8x8,square=9,marker=6,colour=red"};

    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_autoptr(GError) error = NULL;
        struct board board;
        g_assert_false(board_parse(&board, bad[i], &error));
        g_assert_error(error, BOARD_ERROR, BOARD_ERROR_SPEC);
    }
    const struct board board = parse("8x6,square=9.25,marker=6.75,thickness=3");
    g_autofree char *spec = board_spec(&board);
    const struct board again = parse(spec);
    g_assert_cmpmem(&board, sizeof board, &again, sizeof again);
}

TEST(upright) {
    static const char *const good[] = {"8x7,square=9", "7x8,square=9", "8x8,square=9,marker=6.75"};
    static const char *const bad[] = {"8x8,square=9", "8x6,square=9", "9x7,square=9"};
    g_autoptr(GError) error = NULL;

    for (gsize i = 0; i < G_N_ELEMENTS(good); i++) {
        const struct board board = parse(good[i]);
        g_assert_true(ok(board_check_upright(&board, ERR)));
    }
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        const struct board board = parse(bad[i]);
        g_assert_false(board_check_upright(&board, &error));
        g_assert_error(error, BOARD_ERROR, BOARD_ERROR_SPEC);
        g_assert_nonnull(strstr(error->message, bad[i]));
        g_clear_error(&error);
    }
}

TEST(geometry) {
    static const int squares[][3] = {{0, 1, 0}, {2, 0, 1}, {9, 4, 3}}; /* marker, column, row */
    const struct board board = parse("5x4,square=10,marker=7");
    double first[2], last[2];
    int column, row;

    g_assert_cmpint(board_n_corners(&board), ==, 12);
    board_corner_mm(&board, 0, first);
    board_corner_mm(&board, 11, last);
    g_assert_true(first[0] == -15 && first[1] == 10);
    g_assert_true(last[0] == 15 && last[1] == -10);
    for (gsize i = 0; i < G_N_ELEMENTS(squares); i++) {
        g_assert_true(board_marker_square(&board, squares[i][0], &column, &row));
        g_assert_true(column == squares[i][1] && row == squares[i][2]);
    }
    g_assert_false(board_marker_square(&board, 10, &column, &row));
    g_assert_cmpfloat(board_value(&board, -24, 19), ==, 0);
    g_assert_cmpfloat(board_value(&board, -14, 19), ==, 1); /* around the first marker */
    g_assert_cmpfloat(board_value(&board, -13, 18), ==, 0); /* its border */
    g_assert_cmpfloat(board_value(&board, -26, 0), ==, -1);
}

/* Every pixel of the drawing, away from edges, is what board_value() says. */
TEST(drawing) {
    const struct board board = parse("5x4,square=10,marker=7");
    g_autoptr(Picture) picture = draw(&board, "board.png");
    int compared = 0;

    g_assert_cmpint(picture->width, ==, 480);
    for (int y = 0; y < picture->height; y += 3)
        for (int x = 0; x < picture->width; x += 3) {
            const double mm_x = (x + 0.5) / 8 - 5 - 25, mm_y = 20 - ((y + 0.5) / 8 - 5);
            const double here = board_value(&board, mm_x, mm_y), d = 0.15;
            if (here != board_value(&board, mm_x + d, mm_y + d) ||
                here != board_value(&board, mm_x - d, mm_y - d) ||
                here != board_value(&board, mm_x + d, mm_y - d) ||
                here != board_value(&board, mm_x - d, mm_y + d))
                continue;
            const double drawn = (double)picture->values[y * picture->width + x];
            g_assert_cmpfloat_with_epsilon(drawn, here < 0 ? 1 : here, 0.01);
            compared++;
        }
    g_assert_cmpint(compared, >, 10000);
}

TEST(markers) {
    static const char *const specs[] = {"8x8,square=9,marker=6.75",
                                        "7x5,square=10,marker=8,dictionary=6x6_250",
                                        "5x6,square=12,marker=9,dictionary=7x7_50"};

    for (gsize i = 0; i < G_N_ELEMENTS(specs); i++) {
        g_autoptr(GError) error = NULL;
        const struct board board = parse(specs[i]);
        g_autoptr(Picture) picture = draw(&board, "board.png");
        g_autoptr(GArray) found = vision_find_markers(picture, board.dictionary, 1, FALSE, &error);
        g_assert_no_error(error);
        g_assert_cmpint(found->len, ==, board.columns * board.rows / 2);
        for (guint k = 0; k < found->len; k++) {
            const struct vision_marker *m = &g_array_index(found, struct vision_marker, k);
            int column, row;
            g_assert_true(board_marker_square(&board, m->id, &column, &row));
            const double inset = (board.square_mm - board.marker_mm) / 2;
            const double x = (5 + column * board.square_mm + inset) * 8 - 0.5;
            const double y = (5 + row * board.square_mm + inset) * 8 - 0.5;
            g_assert_cmpfloat_with_epsilon(m->corners_px[0][0], x, 4);
            g_assert_cmpfloat_with_epsilon(m->corners_px[0][1], y, 4);
        }
        g_autoptr(GArray) mirrored =
            vision_find_markers(picture, board.dictionary, 1, TRUE, &error);
        g_assert_cmpint(mirrored->len, <, found->len / 4);
    }
}

TEST(chessboard) {
    const struct board board = parse("8x5,square=10");
    g_autoptr(Picture) picture = draw(&board, "board.png");
    double xy[2 * 7 * 4];

    g_assert_true(ok(vision_find_chessboard(picture, 8, 5, xy, ERR)));
    const gboolean turned = xy[0] > xy[2 * 27];
    for (int id = 0; id < 28; id++) {
        double mm[2];
        board_corner_mm(&board, turned ? 27 - id : id, mm);
        g_assert_cmpfloat_with_epsilon(xy[2 * id], (mm[0] + 40 + 5) * 8 - 0.5, 0.1);
        g_assert_cmpfloat_with_epsilon(xy[2 * id + 1], (25 - mm[1] + 5) * 8 - 0.5, 0.1);
    }
}

/* Millimetres on paper: a PDF's page is measured in points of 1/72 inch. */
TEST(paper) {
    g_autoptr(GError) error = NULL;
    const struct board board = parse("8x5,square=10");
    const struct board_drawing drawing = {10, 0};
    g_autofree char *svg = g_build_filename(folder, "board.svg", NULL);
    g_autofree char *pdf = g_build_filename(folder, "board.pdf", NULL);
    g_autofree char *other = g_build_filename(folder, "board.gif", NULL);
    g_autofree char *text = NULL, *bytes = NULL;
    gsize length;

    g_assert_true(board_draw(&board, svg, &drawing, &error));
    g_assert_true(board_draw(&board, pdf, &drawing, &error));
    g_assert_true(g_file_get_contents(svg, &text, NULL, NULL));
    g_assert_nonnull(strstr(text, "width=\"100mm\" height=\"70mm\""));
    g_assert_true(g_file_get_contents(pdf, &bytes, &length, NULL));
    g_assert_nonnull(memmem(bytes, length, "/MediaBox [ 0 0 283.46", 22)); /* 100 mm */
    g_assert_false(board_draw(&board, other, &drawing, &error));
    g_assert_error(error, BOARD_ERROR, BOARD_ERROR_SPEC);
    g_clear_error(&error);
    g_assert_false(board_draw(&board, "/nowhere/board.svg", &drawing, &error));
    g_assert_error(error, BOARD_ERROR, BOARD_ERROR_IO);
    g_unlink(svg);
    g_unlink(pdf);
}

#define FINE 24 /* samples in x and y of a pixel and its lens's blur */

/* A board as a camera sees it: the middle of 8 × 8 squares, corner 24, at (x, y), px a mm by m, and
 * bent by so much a pixel². Light grows towards the right. The lens spreads a point over a pixel,
 * and a pixel is a mean over its area. */
struct seen {
    double x, y, m[2][2], bend;
};

/* From −1 to 1 px about a pixel. */
static double offset(int i) {
    return 2 * (i + 0.5) / FINE - 1;
}

static struct picture *see(const struct board *board, const struct seen *seen) {
    struct picture *picture = picture_new("seen", "", 40, 40);
    g_autofree double *at = g_new(double, 2 * FINE * FINE);
    g_autofree float *values = g_new(float, FINE *FINE);
    for (int y = 0; y < 40; y++)
        for (int x = 0; x < 40; x++) {
            double sum = 0, all = 0;
            for (int k = 0; k < FINE * FINE; k++) {
                const double px = x + offset(k % FINE) - seen->x;
                const double py = y + offset(k / FINE) - seen->y;
                const double u = px + seen->bend * px * px, v = py + seen->bend * px * py;
                const double det = seen->m[0][0] * seen->m[1][1] - seen->m[0][1] * seen->m[1][0];
                at[2 * k] = (seen->m[1][1] * u - seen->m[0][1] * v) / det;
                at[2 * k + 1] = (seen->m[0][0] * v - seen->m[1][0] * u) / det;
            }
            board_values(board, at, FINE * FINE, values);
            for (int k = 0; k < FINE * FINE; k++) {
                const double weight = (1 - fabs(offset(k % FINE))) * (1 - fabs(offset(k / FINE)));
                sum += weight * (double)MAX(values[k], 0);
                all += weight;
            }
            picture->values[y * 40 + x] = (float)((10 + 80 * sum / all) * (1 + 0.003 * x));
        }
    return picture;
}

TEST(corner) {
    const struct board board = parse("8x8,square=9,marker=6.75");
    GRand *rand = g_rand_new_with_seed(4);
    for (int i = 0; i < 30; i++) {
        const double turn = g_rand_double_range(rand, 0, 2 * G_PI), scale = 2.5;
        const double flat = i % 3 == 0 ? 0.26 : 1; /* cos 75° */
        const struct seen seen = {20 + g_rand_double_range(rand, -1, 1),
                                  20 + g_rand_double_range(rand, -1, 1),
                                  {{scale * cos(turn), -scale * sin(turn)},
                                   {-flat * scale * sin(turn), -flat * scale * cos(turn)}},
                                  i % 2 ? 4e-4 : 0};
        g_autoptr(Picture) picture = see(&board, &seen);
        struct corner_guess guess = {seen.x + g_rand_double_range(rand, -0.7, 0.7),
                                     seen.y + g_rand_double_range(rand, -0.3, 0.3)};
        struct corner corner;
        memcpy(guess.px_a_mm, seen.m, sizeof guess.px_a_mm);
        guess.straighten[0][0] = guess.straighten[1][1] = seen.bend;
        g_assert_true(corner_fit(picture, &board, 24, &guess, &corner));
        g_test_message("%d: off by %.4f %.4f", i, corner.x_px - seen.x, corner.y_px - seen.y);
        g_assert_cmpfloat_with_epsilon(corner.x_px, seen.x, flat < 1 ? 0.06 : 0.02);
        g_assert_cmpfloat_with_epsilon(corner.y_px, seen.y, flat < 1 ? 0.06 : 0.02);
        /* The squares of the next corner have the other colours. */
        g_assert_false(corner_fit(picture, &board, 25, &guess, &corner));
    }
    g_rand_free(rand);
    g_autoptr(Picture) empty = picture_new("empty", "", 40, 40);
    const struct corner_guess guess = {20, 20, {{2.5, 0}, {0, -2.5}}};
    const struct corner_guess outside = {0, 20, {{2.5, 0}, {0, -2.5}}};
    struct corner corner;
    g_assert_false(corner_fit(empty, &board, 24, &guess, &corner));
    g_assert_false(corner_fit(empty, &board, 24, &outside, &corner));
}

TEST(bad_pictures) {
    g_autofree char *path = g_build_filename(folder, "bad.png", NULL);
    static const char *const contents[] = {"", "no picture", "\x89PNG\r\n\x1a\n\0\0\0\rIHDR"};

    for (gsize i = 0; i < G_N_ELEMENTS(contents); i++) {
        g_autoptr(GError) error = NULL;
        g_assert_true(g_file_set_contents(path, contents[i], i == 2 ? 16 : -1, NULL));
        g_assert_null(picture_read(path, &error));
        g_assert_error(error, PICTURE_FILE_ERROR, PICTURE_FILE_ERROR_IO);
        g_assert_nonnull(strstr(error->message, "bad.png"));
    }
    g_unlink(path);
}

BEFORE_TESTS {
    folder = g_dir_make_tmp("mesorig-board-XXXXXX", NULL);
}

AFTER_TESTS {
    g_rmdir(folder);
    g_free(folder);
}
