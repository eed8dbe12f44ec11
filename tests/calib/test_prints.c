/*
 * Boards of every print, found in pictures that are drawn here by formulas of their own: a camera
 * with a straight lens, and a wide one that bends the board far off any plane's image, by the
 * division model: a point at radius r of the picture (in focal lengths) is seen at r / (1 + BEND
 * r²) (Fitzgibbon 2001). Each corner is compared with where the formula says that it is.
 */
#include "cameras/board_find.h"
#include "geometry/rig.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "pictures/vision.h"

#include <math.h>
#include <string.h>

#define WIDTH    480
#define HEIGHT   360
#define SAMPLES  128 /* of a pixel with an edge in it */
#define BEND     -0.5
#define FOCAL_PX 520
#define WIDE_PX  230
#define MAX_BITS 7
#define BLUR     1.5 /* px, the square that a pixel is the mean of */

/* 0 black, 1 white, of a point in units of the grid from the top left of the board, y downwards. */
typedef double (*Print)(double x, double y);

static guint8 bits[64][MAX_BITS * MAX_BITS]; /* of the print's dictionary */
static int n_bits;

/* A marker from its own top left, u and v from 0 to 1. */
static double marker(int id, int border, double u, double v) {
    const int all = n_bits + 2 * border;
    const int i = (int)floor(v * all) - border, j = (int)floor(u * all) - border;
    return i >= 0 && j >= 0 && i < n_bits && j < n_bits && bits[id][i * n_bits + j];
}

static double squares(double x, double y) {
    return ((int)floor(x) + (int)floor(y)) % 2 != 0;
}

/* A marker in the middle of a white square, 0.7 of it. */
static double in_square(int id, double x, double y) {
    const double u = (x - floor(x) - 0.15) / 0.7, v = (y - floor(y) - 0.15) / 0.7;
    return u < 0 || v < 0 || u >= 1 || v >= 1 ? 1 : marker(id, 1, u, v);
}

/* 7 × 5 squares: 17 markers, row by row 3 and 4 of them. */
static double charuco(double x, double y) {
    const int column = (int)floor(x), row = (int)floor(y);
    return squares(x, y) > 0 ? in_square(7 * (row / 2) + 3 * (row % 2) + column / 2, x, y) : 0;
}

/* 7 × 6 squares, the first white: 21 markers, row by row 4 and 3 of them. */
static double charuco_of_old(double x, double y) {
    const int column = (int)floor(x), row = (int)floor(y);
    return squares(x, y) > 0 ? 0 : in_square(7 * (row / 2) + 4 * (row % 2) + column / 2, x, y);
}

/* 6 × 4 markers of 0.75 of the grid with white between them. */
static double markers(double x, double y) {
    const int column = (int)floor(x), row = (int)floor(y);
    const double u = (x - column - 0.125) / 0.75, v = (y - row - 0.125) / 0.75;
    return u < 0 || v < 0 || u >= 1 || v >= 1 ? 1 : marker(6 * row + column, 1, u, v);
}

/* The same as Kalibr prints it. Its black squares reach beyond the grid, where this is asked for
 * as well. */
static double kalibr(double x, double y) {
    const int column = CLAMP((int)floor(x), 0, 5), row = CLAMP((int)floor(y), 0, 3);
    const double u = (x - column - 0.125) / 0.75, v = (y - row - 0.125) / 0.75;
    const gboolean beside = u < 0 || u >= 1, above = v < 0 || v >= 1;
    if (beside || above)
        return !(beside && above && u > -1.0 / 3 && u < 4.0 / 3 && v > -1.0 / 3 && v < 4.0 / 3);
    return marker(6 * (3 - row) + column, 2, 1 - u, 1 - v);
}

static double circles(double x, double y) {
    return hypot(x - floor(x) - 0.5, y - floor(y) - 0.5) > 0.3;
}

static double bright_circles(double x, double y) {
    return !circles(x, y);
}

/* Rows one apart, circles two, every second row one to the right. */
static double staggered(double x, double y) {
    const int row = (int)floor(y);
    const double column = floor((x - row % 2) / 2);
    return hypot(x - row % 2 - 2 * column - 0.5, y - row - 0.5) > 0.3 || column < 0 || column > 3;
}

static const struct print {
    const char *name, *spec;
    Print print;
    double width, height;        /* of the grid, as the formula takes it */
    double ground;               /* around it */
    gboolean alike;              /* upside down */
    double straight_px, wide_px; /* most RMS of corners from where they are */
} prints[] = {
    {"chessboard", "9x6,square=10", squares, 9, 6, 1, FALSE, 0.012, 0.05},
    {"charuco", "7x5,square=14,marker=9.8,dictionary=5x5_50", charuco, 7, 5, 1, FALSE, 0.012, 0.05},
    {"charuco with AprilTags", "7x5,square=14,marker=9.8,dictionary=apriltag_36h11", charuco, 7, 5,
     1, FALSE, 0.012, 0.05},
    {"charuco of old", "7x6,square=12,marker=8.4,first=white", charuco_of_old, 7, 6, 1, FALSE,
     0.012, 0.05},
    {"charuco of old, unsaid", "7x6,square=12,marker=8.4", charuco_of_old, 7, 6, 1, FALSE, 0.012,
     0.05},
    {"markers", "6x4,marker=12,gap=4,dictionary=6x6_50", markers, 6, 4, 1, FALSE, 0.05, 0.07},
    {"Kalibr's", "6x4,marker=12,gap=4,grid=kalibr", kalibr, 6, 4, 1, FALSE, 0.02, 0.05},
    {"circles", "8x5,spacing=11,circle=6.6", circles, 8, 5, 1, TRUE, 0.012, 0.08},
    {"bright circles", "8x5,spacing=11,circle=6.6", bright_circles, 8, 5, 0, TRUE, 0.012, 0.08},
    {"staggered", "4x7,spacing=10,circle=6,grid=staggered", staggered, 8, 7, 1, FALSE, 0.012, 0.08},
};

struct view {
    struct rig_camera camera;
    struct vec3 from;
    double focal_px, bend;
};

static void look(struct view *to, gboolean wide, double theta_rad, double phi_rad,
                 double width_mm) {
    *to = (struct view){.camera = {.width = WIDTH, .height = HEIGHT},
                        .focal_px = wide ? WIDE_PX : FOCAL_PX,
                        .bend = wide ? BEND : 0};
    to->camera.cx_px = (WIDTH - 1) / 2.0;
    to->camera.cy_px = (HEIGHT - 1) / 2.0;
    rig_camera_look_at(&to->camera,
                       vec3_scale(rig_direction(theta_rad, phi_rad), (wide ? 1 : 1.9) * width_mm),
                       vec3(0, 0, 0));
    to->from = rig_camera_centre_mm(&to->camera);
}

/* What the grid's middle is at the origin of the board frame. */
static double sample(const struct print *print, const struct view *view, double grid_mm, double x,
                     double y) {
    const double u = (x - view->camera.cx_px) / view->focal_px;
    const double v = (y - view->camera.cy_px) / view->focal_px;
    const double scale = 1 / (1 + view->bend * (u * u + v * v));
    if (scale < 0)
        return print->ground;
    const struct vec3 ray =
        mat3_mul_transposed(&view->camera.rotation, vec3(scale * u, scale * v, 1));
    const struct vec3 from = view->from;
    const double t = -from.z / ray.z;
    const double gx = (from.x + t * ray.x) / grid_mm + print->width / 2;
    const double gy = print->height / 2 - (from.y + t * ray.y) / grid_mm;
    const double beyond = print->print == kalibr ? 0.125 : 0;
    if (!(t > 0) || gx < -beyond || gy < -beyond || gx >= print->width + beyond ||
        gy >= print->height + beyond)
        return print->ground;
    return print->print(gx, gy);
}

/* A mean over BLUR × BLUR pixels: of nine points if they agree, else of many that no straight edge
 * meets two of at the same time (Roberts's R2 sequence). */
static double prints_mean(const struct print *print, const struct view *view, double grid_mm,
                          double x, double y) {
    double sum = 0;
    for (int k = 0; k < 9; k++)
        sum += sample(print, view, grid_mm, x + BLUR / 2 * (k % 3 - 1), y + BLUR / 2 * (k / 3 - 1));
    if (sum == 0 || sum == 9)
        return sum / 9;
    sum = 0;
    for (int k = 0; k < SAMPLES; k++) { /* each with its opposite, so that their middle is x, y */
        const int i = k / 2, sign = k % 2 ? 1 : -1;
        const double dx = fmod(0.5 + i * 0.7548776662466927, 1) - 0.5;
        const double dy = fmod(0.5 + i * 0.5698402909980532, 1) - 0.5;
        sum += sample(print, view, grid_mm, x + sign * BLUR * dx, y + sign * BLUR * dy);
    }
    return sum / SAMPLES;
}

static struct picture *prints_draw(const struct print *print, const struct view *view,
                                   double grid_mm) {
    struct picture *picture = picture_new("drawn", "", WIDTH, HEIGHT);
    GRand *rand = g_rand_new_with_seed(1);
    for (int y = 0; y < HEIGHT; y++)
        for (int x = 0; x < WIDTH; x++)
            picture->values[y * WIDTH + x] =
                (float)(0.1 + 0.7 * prints_mean(print, view, grid_mm, x, y) +
                        g_rand_double_range(rand, -0.005, 0.005));
    g_rand_free(rand);
    return picture;
}

static void prints_project(const struct view *view, const double mm[2], double ret[2]) {
    const struct vec3 p = vec3_add(mat3_mul_vec(&view->camera.rotation, vec3(mm[0], mm[1], 0)),
                                   view->camera.translation_mm);
    const double r = hypot(p.x, p.y) / p.z, b = view->bend;
    const double seen = b == 0 || r < 1e-9 ? r : (1 - sqrt(1 - 4 * b * r * r)) / (2 * b * r);
    const double scale = r < 1e-9 ? 1 : seen / r;
    ret[0] = view->camera.cx_px + view->focal_px * scale * p.x / p.z;
    ret[1] = view->camera.cy_px + view->focal_px * scale * p.y / p.z;
}

static void test_print(gconstpointer data) {
    const struct print *print = data;
    struct board board;
    g_autoptr(GError) error = NULL;
    g_assert_true(ok(board_parse(&board, print->spec, ERR)));
    n_bits = board.marker_mm > 0 ? vision_dictionary(board.dictionary, NULL) : 0;
    for (int i = 0; n_bits > 0 && i < 24; i++)
        g_assert_true(vision_marker_bits(board.dictionary, i, bits[i]));
    const int n = board_n_corners(&board);
    for (int k = 0; k < 6; k++) {
        struct view view;
        look(&view, k >= 3, 0.15 + 0.1 * (k % 3), 0.4 + 2.1 * k, print->width * board.square_mm);
        g_autoptr(Picture) picture = prints_draw(print, &view, board.square_mm);
        g_autoptr(GArray) corners = board_find(picture, &board, TRUE, &error);
        g_assert_no_error(error);
        double sum[2] = {0, 0}; /* of squares, as it is and upside down */
        for (guint i = 0; i < corners->len; i++) {
            const struct corner *corner = &g_array_index(corners, struct corner, i);
            for (int turned = 0; turned < 2; turned++) {
                double mm[2], px[2];
                board_corner_mm(&board, turned ? n - 1 - corner->id : corner->id, mm);
                prints_project(&view, mm, px);
                sum[turned] += pow(px[0] - corner->x_px, 2) + pow(px[1] - corner->y_px, 2);
            }
        }
        const double squares_px2 = print->alike ? MIN(sum[0], sum[1]) : sum[0];
        const double rms_px = sqrt(squares_px2 / corners->len);
        g_test_message("%s: %u of %d corners, %.4f px RMS from where they are",
                       k >= 3 ? "wide" : "straight", corners->len, n, rms_px);
        g_assert_cmpint((int)corners->len, >=, n * 9 / 10);
        g_assert_cmpfloat(rms_px, <, k >= 3 ? print->wide_px : print->straight_px);
    }
}

/* A rig's board must be told as it is. */
TEST(first_square) {
    static const struct print *const old = &prints[4];
    struct board board;
    struct view view;
    g_autoptr(GError) error = NULL;
    g_assert_true(board_parse(&board, old->spec, NULL));
    n_bits = vision_dictionary(board.dictionary, NULL);
    for (int i = 0; i < 24; i++)
        g_assert_true(vision_marker_bits(board.dictionary, i, bits[i]));
    look(&view, FALSE, 0.2, 1, old->width * board.square_mm);
    g_autoptr(Picture) picture = prints_draw(old, &view, board.square_mm);
    g_assert_null(board_find(picture, &board, FALSE, &error));
    g_assert_error(error, BOARD_ERROR, BOARD_ERROR_SPEC);
    g_assert_nonnull(strstr(error->message, "square is white: add first=white to --board"));
    board.white_first = TRUE;
    g_autoptr(GArray) corners = board_find(picture, &board, FALSE, NULL);
    g_assert_nonnull(corners);
}

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(prints); i++) {
        g_autofree char *path = g_strdup_printf("/prints/%s", prints[i].name);
        g_test_add_data_func(path, &prints[i], test_print);
    }
}
