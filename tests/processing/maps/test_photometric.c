/* Photometric stereo of balls whose normals are known, under lights all around and from one side,
 * with cast shadows, highlights and noise: at most 1.1 times the error of robust least squares by
 * tests/normals_peer.py, which shares no code with it. */
#include "lib/ok.h"
#include "lib/test.h"
#include "maps/photometric.h"

#include <glib/gstdio.h>
#include <math.h>
#include <png.h>
#include <string.h>

#include "base/robust.h"
#include "exr/exr.h"
#include "lib/assert_error.h"
#include "lib/process.h"
#include "lib/session_fixture.h"

#define SIDE   26 /* pixels, which the ball's picture is wide */
#define MOST   (SIDE * SIDE)
#define LIGHTS 40
#define DEG    (180 / G_PI)
#define RATIO  1.1

enum trouble {
    CAST = 1 << 0,   /* a wall shadows part of the ball from some lights */
    SHINE = 1 << 1,  /* a highlight */
    NOISE = 1 << 2,  /* 1 % of white; else 0.2 % */
    DARKER = 1 << 3, /* albedo from 0.05 to 0.9 instead of 0.5 */
};

struct ball {
    const char *name;
    int n_lights, troubles;
    double spread_deg;   /* of azimuths */
    double theta_deg[2]; /* of lights */
    struct vec3 lights[LIGHTS];
    struct vec3 normals[MOST];
    double values[MOST * LIGHTS], albedo[MOST];
    int n;
};

static double normal_error(GRand *rand) {
    double sum = -6;
    for (int k = 0; k < 12; k++)
        sum += g_rand_double(rand);
    return sum;
}

static void make_ball(struct ball *ball) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(5);
    const double noise = ball->troubles & NOISE ? 0.01 : 0.002;
    for (int i = 0; i < ball->n_lights; i++) {
        const double t = (i * 0.618 - floor(i * 0.618));
        const double theta =
            (ball->theta_deg[0] + (ball->theta_deg[1] - ball->theta_deg[0]) * t) / DEG;
        const double phi = (ball->spread_deg * (i + 0.5) / ball->n_lights) / DEG;
        ball->lights[i] = vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
    }
    ball->n = 0;
    for (int p = 0; p < MOST; p++) {
        const double x = (p % SIDE + 0.5) / (SIDE / 2.0) - 1;
        const double y = 1 - ((int)(p / SIDE) + 0.5) / (SIDE / 2.0), rest = 1 - x * x - y * y;
        if (!(rest > 0.03))
            continue;
        const struct vec3 n = vec3(x, y, sqrt(rest));
        const double albedo = ball->troubles & DARKER ? 0.05 * pow(18, g_rand_double(rand)) : 0.5;
        ball->albedo[ball->n] = albedo;
        for (int i = 0; i < ball->n_lights; i++) {
            const struct vec3 l = ball->lights[i];
            double value = albedo * MAX(vec3_dot(n, l), 0);
            const struct vec3 half = vec3_unit(vec3_add(l, vec3(0, 0, 1)));
            if (ball->troubles & SHINE)
                value += 0.8 * pow(MAX(vec3_dot(n, half), 0), 60) * (vec3_dot(n, l) > 0);
            if (ball->troubles & CAST && x < -0.1 && l.x > 0.45)
                value *= 0.02;
            ball->values[ball->n * ball->n_lights + i] = value + noise * normal_error(rand);
        }
        ball->normals[ball->n++] = n;
    }
}

static void read_texel(int texel, float *ret_rgb, struct vec3 *ret_lights, gpointer data) {
    const struct ball *ball = data;
    for (int i = 0; i < ball->n_lights; i++) {
        ret_lights[i] = ball->lights[i];
        for (int c = 0; c < 3; c++)
            ret_rgb[3 * i + c] = (float)ball->values[texel * ball->n_lights + i];
    }
}

static double *peer(const struct ball *ball) {
    static const char *const names[] = {"lights", "values", "normals"};
    g_autofree char *script = g_build_filename(SOURCE_DIR, "tests", "normals_peer.py", NULL);
    g_autofree char *count = g_strdup_printf("%d", ball->n_lights);
    g_autofree char *out = NULL, *errors = NULL;
    char *paths[3], *bytes = NULL;
    gsize length = 0;
    for (int i = 0; i < 3; i++)
        paths[i] = g_build_filename(session_fixture_folder, names[i], NULL);
    ok(g_file_set_contents(paths[0], (const char *)ball->lights,
                           (gssize)(sizeof *ball->lights * (gsize)ball->n_lights), ERR));
    ok(g_file_set_contents(paths[1], (const char *)ball->values,
                           (gssize)(sizeof(double) * (gsize)(ball->n * ball->n_lights)), ERR));
    const char *const argv[] = {"python3", script, count, paths[0], paths[1], paths[2], NULL};
    const int code = process_run_in(session_fixture_folder, argv, &out, &errors);
    if (code != 0)
        g_error("%s%s", out, errors);
    ok(g_file_get_contents(paths[2], &bytes, &length, ERR));
    g_assert_cmpuint(length, ==, 3 * sizeof(double) * (gsize)ball->n);
    for (int i = 0; i < 3; i++) {
        g_unlink(paths[i]);
        g_free(paths[i]);
    }
    return (double *)(gpointer)bytes;
}

static double angle_deg(struct vec3 a, struct vec3 b) {
    return atan2(vec3_length(vec3_cross(a, b)), vec3_dot(a, b)) * DEG;
}

static struct vec3 ball_normal(int p) {
    const double x = (p % 60 + 0.5) / 30 - 1, y = 1 - ((int)(p / 60) + 0.5) / 30;
    const double rest = 1 - x * x - y * y;
    return rest > 0 ? vec3(x, y, sqrt(rest)) : vec3(0, 0, 0);
}

static struct ball balls[] = {
    {"five lights", 5, 0, 360, {30, 50}},
    {"five lights, noise", 5, NOISE, 360, {30, 50}},
    {"six lights, highlights", 6, SHINE, 360, {35, 60}},
    {"twelve lights, one side", 12, 0, 150, {20, 60}},
    {"twelve lights, one side, noise", 12, NOISE, 150, {20, 60}},
    {"twelve lights, one side, highlights", 12, SHINE, 150, {20, 60}},
    {"twelve lights, one side, shadows", 12, CAST, 170, {20, 60}},
    {"twelve lights, all", 12, CAST | SHINE | DARKER, 360, {20, 60}},
    {"eight lights, quarter, noise", 8, NOISE | DARKER, 90, {10, 70}},
    {"forty lights, all troubles", 40, CAST | SHINE | NOISE, 360, {15, 75}},
};

static void test_ball(gconstpointer data) {
    struct ball *ball = g_memdup2(data, sizeof *ball);
    make_ball(ball);
    const struct photometric_input input = {ball->n_lights, ball->n, read_texel, ball};
    g_autofree struct photometric_texel *found = g_new0(struct photometric_texel, ball->n);
    g_autoptr(GError) error = NULL;
    g_autofree double *peers = peer(ball);
    double off[2][MOST], chi2 = 0, squares[2] = {0}, albedo = 0;
    int n = 0, causes[PHOTOMETRIC_CAUSES] = {0};
    g_assert_true(photometric_solve(&input, NULL, found, &error));
    for (int t = 0; t < ball->n; t++) {
        causes[found[t].cause]++;
        if (found[t].cause != PHOTOMETRIC_FOUND)
            continue;
        const struct vec3 other = vec3(peers[3 * t], peers[3 * t + 1], peers[3 * t + 2]);
        off[0][n] = angle_deg(found[t].normal, ball->normals[t]);
        off[1][n] = angle_deg(other, ball->normals[t]);
        chi2 += MIN(pow(off[0][n] / (double)found[t].sigma_deg, 2), 100);
        albedo += fabs((double)found[t].albedo[1] / ball->albedo[t] - 1);
        for (int k = 0; k < 2; k++)
            squares[k] += off[k][n] * off[k][n];
        n++;
    }
    for (int k = 0; k < 2; k++)
        qsort(off[k], (gsize)n, sizeof(double), robust_by_value);
    g_test_message("%s: %d of %d; median %.3f° and %.3f°, 90 %% %.3f° and %.3f°, RMS %.3f° and "
                   "%.3f°; (off / bar)² %.2f; albedo %.2f %%; dark %d, few %d, contradict %d, flat "
                   "%d, away %d",
                   ball->name, n, ball->n, off[0][n / 2], off[1][n / 2], off[0][n * 9 / 10],
                   off[1][n * 9 / 10], sqrt(squares[0] / n), sqrt(squares[1] / n), chi2 / n,
                   100 * albedo / n, causes[PHOTOMETRIC_DARK], causes[PHOTOMETRIC_FEW],
                   causes[PHOTOMETRIC_CONTRADICT], causes[PHOTOMETRIC_FLAT],
                   causes[PHOTOMETRIC_AWAY]);
    g_assert_cmpfloat(off[0][n / 2], <=, RATIO * off[1][n / 2]);
    g_assert_cmpfloat(off[0][n * 9 / 10], <=, RATIO * off[1][n * 9 / 10]);
    g_assert_cmpfloat(chi2 / n, <, 2); /* where an error of ten bars or more counts as ten */
    g_assert_cmpfloat(chi2 / n, >, 0.3);
    g_assert_cmpint(n, >, ball->n / 2);
    g_free(ball);
}

#define WIDE 60

/* A matt ball of 60 px on black under twelve lights of one side, linear, 16 bits; saturated where a
 * light is brightest. */
static void write_pictures(void) {
    g_autoptr(GString) list = g_string_new("12\n");
    g_autofree guint16 *pixels = g_new0(guint16, WIDE * WIDE);
    for (int i = 0; i < 12; i++) {
        const double theta = (25 + 3 * i) / DEG, phi = (12 * i + 5) / DEG;
        const struct vec3 l = vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
        g_autofree char *name = g_strdup_printf("light_%02d.png", i);
        g_autofree char *path = g_build_filename(session_fixture_folder, name, NULL);
        png_image image = {.version = PNG_IMAGE_VERSION,
                           .width = WIDE,
                           .height = WIDE,
                           .format = PNG_FORMAT_LINEAR_Y};
        g_string_append_printf(list, "%s %.6f %.6f %.6f\n", name, l.x, l.y, l.z);
        for (int p = 0; p < WIDE * WIDE; p++) {
            const struct vec3 n = ball_normal(p);
            pixels[p] = (guint16)lround(65535 * 0.6 * MAX(vec3_dot(n, l), 0));
        }
        g_assert_true(png_image_write_to_file(&image, path, 0, pixels, 0, NULL));
    }
    g_autofree char *path = g_build_filename(session_fixture_folder, "ball.lp", NULL);
    g_assert_true(g_file_set_contents(path, list->str, -1, NULL));
}

/* Of the texels that a normals file has; how many. */
static int errors_of(const char *path, double *ret_median_deg, double *ret_most_deg) {
    g_autoptr(GError) error = NULL;
    g_autoptr(ExrPart) part = exr_read_part(path, "normals", &error);
    g_assert_no_error(error);
    double off[WIDE * WIDE];
    int n = 0;
    for (int p = 0; p < WIDE * WIDE; p++) {
        const struct vec3 truth = ball_normal(p), is = vec3((double)exr_part_plane(part, "X")[p],
                                                            (double)exr_part_plane(part, "Y")[p],
                                                            (double)exr_part_plane(part, "Z")[p]);
        if (truth.z > 0.2 && vec3_length(is) > 0.5)
            off[n++] = angle_deg(is, truth);
    }
    qsort(off, (gsize)n, sizeof(double), robust_by_value);
    *ret_median_deg = off[n / 2];
    *ret_most_deg = off[n - 1];
    return n;
}

/* Through the programs, from pictures to normals without compressing anything. */
TEST(session) {
    g_autofree char *list = g_build_filename(session_fixture_folder, "ball.lp", NULL);
    g_autofree char *session = g_build_filename(session_fixture_folder, "ball.session", NULL);
    g_autofree char *file = g_build_filename(session_fixture_folder, "ball.exr", NULL);
    g_autofree char *height = g_build_filename(session_fixture_folder, "height.exr", NULL);
    g_autofree char *hsh = g_build_filename(session, "products", "hsh.exr", NULL);
    g_autofree char *harmonics = g_build_filename(session_fixture_folder, "hsh_normals.exr", NULL);
    g_autoptr(GError) error = NULL;
    double median, most, before, before_most;
    write_pictures();
    g_free(process_mesorig(0, "import rti %s -o %s", list, session));
    g_autofree char *said = process_mesorig(0, "export normals %s -o %s", session, file);
    g_test_message("%s", said);
    assert_has(said, "texels are dark under all lights");
    const int n = errors_of(file, &median, &most);
    g_autoptr(ExrPart) albedo = exr_read_part(file, "albedo", &error);
    g_autoptr(ExrPart) sigma = exr_read_part(file, "sigma", &error);
    g_autoptr(ExrPart) used = exr_read_part(file, "used", &error);
    g_assert_no_error(error);
    const int middle = WIDE / 2 * WIDE + WIDE / 2;
    g_assert_cmpfloat_with_epsilon((double)exr_part_plane(albedo, "G")[middle], 0.6, 0.01);
    g_assert_cmpfloat((double)exr_part_plane(sigma, "Y")[middle], <, 0.5);
    g_assert_cmpfloat((double)exr_part_plane(used, "N")[middle], ==, 12);
    g_assert_cmpfloat((double)exr_part_plane(used, "N")[0], ==, -PHOTOMETRIC_DARK);
    g_free(process_mesorig(0, "export height %s -o %s", session, height));
    g_autoptr(ExrPart) heights = exr_read_part(height, "height", &error);
    g_assert_no_error(error);
    g_free(process_mesorig(0, "compress %s --method hsh", session));
    g_free(process_mesorig(0, "export normals %s -o %s", hsh, harmonics));
    errors_of(harmonics, &before, &before_most);
    g_test_message("%d texels: %.3f° median, %.2f° at most; by harmonics %.2f° and %.2f°", n,
                   median, most, before, before_most);
    g_assert_cmpfloat(median, <, 0.1);
    g_assert_cmpfloat(most, <, 2);
    g_assert_cmpint(n, >, WIDE * WIDE / 2);
}

/* Multiplies all values of a session's only view. */
static void scale_values(const char *session, float factor) {
    static const char *const channels[] = {"R", "G", "B"};
    g_autofree char *path = g_build_filename(session, "products", "btf", "view_0000.exr", NULL);
    g_autoptr(ExrFile) file = ok(exr_read(path, ERR));
    for (guint i = 0; i < file->parts->len; i++)
        for (int c = 0; c < 3; c++) {
            float *plane = (float *)exr_part_plane(file->parts->pdata[i], channels[c]);
            for (int p = 0; p < WIDE * WIDE; p++)
                plane[p] *= factor;
        }
    ok(exr_write(path, file, EXR_NONE, TRUE, ERR));
    ok(session_add_product_file(path, "test", ERR));
}

/* Values beyond the range of the file are no measurements. */
TEST(cut) {
    g_autofree char *list = g_build_filename(session_fixture_folder, "ball.lp", NULL);
    g_autofree char *session = g_build_filename(session_fixture_folder, "cut.session", NULL);
    g_autofree char *file = g_build_filename(session_fixture_folder, "cut.exr", NULL);
    double median, most;
    write_pictures();
    g_free(process_mesorig(0, "import rti %s -o %s", list, session));
    scale_values(session, 130000); /* 0.6 becomes 78,000 */
    g_free(process_mesorig(0, "export normals %s -o %s", session, file));
    const int n = errors_of(file, &median, &most);
    g_assert_cmpfloat(median, <, 0.1);
    g_assert_cmpfloat(most, <, 2);
    g_assert_cmpint(n, >, WIDE * WIDE / 2);
    scale_values(session, 1e6F);
    g_autofree char *said = process_mesorig(1, "export normals %s -o %s --force", session, file);
    assert_has(said, "values are cut at 65504");
    assert_has(said, "response in the rig file");
}

TESTS_RUN_BY(session_fixture_run);

BEFORE_TESTS {
    for (gsize i = 0; i < G_N_ELEMENTS(balls); i++) {
        g_autofree char *path = g_strdup_printf("/photometric/%s", balls[i].name);
        g_test_add_data_func(path, &balls[i], test_ball);
    }
}
