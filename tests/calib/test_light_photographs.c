/* mesorig calibrate lights --images on pictures of mirror balls as a camera far away gives them: by
 * formula, sRGB of 8 bits, clipped, with dust, second lamps, and circles that were given wrongly.
 */
#include "lib/ball_scene.h"
#include "lib/process.h"
#include "lib/test.h"

#include <string.h>

#define MESORIG BUILD_DIR "/bin/mesorig"
#define SIZE    400
#define FINE    4   /* samples a pixel, each way */
#define MAX_OFF 0.5 /* degrees */

struct ball {
    double x, y, r; /* px, y down */
};

struct lamp {
    struct xyz at; /* a direction, unit; near: a place in px, y up */
    gboolean near;
    double radius_deg; /* as seen from the ball */
    double gain;       /* 1: just white */
};

static const struct ball one = {203.4, 188.7, 90.3};
static const struct ball three[] = {{90.3, 95.6, 60.2}, {305.7, 110.2, 60.2}, {190.1, 310.4, 60.2}};

struct scene {
    double light[SIZE * SIZE];
};

static struct scene *scene_new(double room) {
    struct scene *scene = g_new(struct scene, 1);
    for (int i = 0; i < SIZE * SIZE; i++)
        scene->light[i] = room;
    return scene;
}

/* Each pixel's mean; room: how bright what the ball mirrors otherwise is, darker below. */
static void paint(struct scene *scene, const struct ball *ball, const struct lamp *lamps, int n,
                  double room) {
    for (int i = 0; i < SIZE * SIZE; i++) {
        double sum = 0;
        for (int k = 0; k < FINE * FINE; k++) {
            const double u = (i % SIZE + (k % FINE + 0.5) / FINE - 0.5 - ball->x) / ball->r;
            const double v =
                -((int)(i / SIZE) + ((int)(k / FINE) + 0.5) / FINE - 0.5 - ball->y) / ball->r;
            if (u * u + v * v >= 1) {
                sum += scene->light[i];
                continue;
            }
            sum += room * (1 + 0.3 * v);
            for (int j = 0; j < n; j++) {
                /* What the mirror shows at a point of the ball, (u, v) radii from its middle: the
                 * lamp, with a glow around it as optics make, and a dim room. */
                const double w = sqrt(1 - u * u - v * v);
                const struct xyz mirrored = {2 * w * u, 2 * w * v, 2 * w * w - 1};
                struct xyz to = lamps[j].at;
                if (lamps[j].near)
                    to = (struct xyz){to.x - (ball->x + u * ball->r),
                                      to.y - (-ball->y + v * ball->r), to.z - w * ball->r};
                const double off = DEG * apart_rad(mirrored, to) / lamps[j].radius_deg;
                sum += lamps[j].gain * (off < 1 ? 1 : 0.02 * exp(-off));
            }
        }
        scene->light[i] = sum / (FINE * FINE);
    }
}

static void dust(struct scene *scene, int x, int y, int width, int height, double light) {
    for (int j = y; j < y + height; j++)
        for (int i = x; i < x + width; i++)
            scene->light[j * SIZE + i] = light;
}

/* With some noise; the scene is freed. */
static void save(struct scene *scene, const char *name) {
    g_autofree guint8 *pixels = g_new(guint8, SIZE * SIZE);
    GRand *rand = g_rand_new_with_seed(7);
    for (int i = 0; i < SIZE * SIZE; i++) {
        const double noise = 0.002 * (g_rand_double(rand) - 0.5);
        const double light = MAX(scene->light[i] + noise, 0);
        pixels[i] = (guint8)lround(255 * fmin(ball_scene_srgb(light), 1));
    }
    g_rand_free(rand);
    g_free(scene);
    ball_scene_write(name, pixels, SIZE, SIZE);
}

/* Of one ball under some lamps. */
static void photograph(const char *name, const struct lamp *lamps, int n) {
    struct scene *scene = scene_new(0.05);
    paint(scene, &one, lamps, n, 0.01);
    save(scene, name);
}

/* Returns what was said; more: further options, up to NULL. */
static char *calibrate(int code, const struct ball *balls, int n, gboolean json) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GStrvBuilder) builder = g_strv_builder_new();
    g_autofree char *errors = NULL, *out = NULL;
    static const char *const start[] = {MESORIG,  "calibrate",  "lights",    "--images",
                                        "photos", "-o",         "lights.lp", "--radius",
                                        "30",     "--within=1", "--force",   NULL};
    g_strv_builder_addv(builder, (const char **)(gpointer)start);
    for (int i = 0; i < n; i++) {
        g_autofree char *ball =
            g_strdup_printf("--ball=%.2f,%.2f,%.2f", balls[i].x, balls[i].y, balls[i].r);
        g_strv_builder_add(builder, ball);
    }
    if (json)
        g_strv_builder_add(builder, "--json");
    g_auto(GStrv) argv = g_strv_builder_end(builder);
    const int is = process_run_in(world_fixture_folder(), (const char *const *)argv, &out, &errors);
    char *all = g_strconcat(out, errors, NULL);
    g_test_message("%s", all);
    g_assert_cmpint(is, ==, code);
    return all;
}

struct told {
    struct xyz direction;
    double sigma_deg;
};

static struct told told(const char *out, const char *name) {
    const char *at = strstr(out, name);
    struct told ret;
    g_assert_nonnull(at);
    g_assert_cmpint(sscanf(at + strlen(name), "%lf %lf %lf ± %lf°", &ret.direction.x,
                           &ret.direction.y, &ret.direction.z, &ret.sigma_deg),
                    ==, 4);
    return ret;
}

static void assert_right(const char *out, const char *name, struct xyz truth) {
    const struct told found = told(out, name);
    const double off = DEG * apart_rad(found.direction, truth);
    g_test_message("%s: %.3f° off, ± %.3f°", name, off, found.sigma_deg);
    g_assert_cmpfloat(off, <, MAX_OFF);
    g_assert_cmpfloat(off, <, 3 * found.sigma_deg);
    g_assert_cmpfloat(found.sigma_deg, <, 1);
}

static void assert_said(const char *out, const char *what) {
    if (!strstr(out, what))
        g_test_message("It does not say “%s”.", what);
    g_assert_nonnull(strstr(out, what));
}

/* From just below white to a thousand times as much, all around the ball. */
TEST(clipped) {
    static const double gains[] = {0.8, 4, 30, 1000};
    struct xyz truth[12];
    ball_scene_clear();
    for (int i = 0; i < 12; i++) {
        g_autofree char *name = g_strdup_printf("light-%02d.png", i);
        truth[i] = polar(10 + 9 * i, 77 * i);
        photograph(name, &(struct lamp){truth[i], FALSE, 2.5, gains[i % 4]}, 1);
    }
    g_autofree char *out = calibrate(0, &one, 1, FALSE);
    assert_said(out, "12 of 12 photographs");
    for (int i = 0; i < 12; i++) {
        g_autofree char *name = g_strdup_printf("light-%02d.png", i);
        assert_right(out, name, truth[i]);
    }
    g_autofree char *json = calibrate(0, &one, 1, TRUE);
    assert_said(json, "\"sigma_deg\"");
}

/* Specks and a hair that are brighter than the lamp, above, left and below of it. */
TEST(dusty) {
    const struct xyz truth = polar(40, 30);
    for (int gain = 0; gain < 2; gain++) {
        struct scene *scene = scene_new(0.05);
        ball_scene_clear();
        paint(scene, &one, &(struct lamp){truth, FALSE, 3, gain ? 20 : 0.4}, 1, 0.01);
        dust(scene, 180, 130, 1, 1, 2);
        dust(scene, 150, 200, 2, 1, 2);
        dust(scene, 230, 240, 1, 3, 2);
        dust(scene, 160, 150, 9, 1, 2);
        dust(scene, 220, 210, 2, 2, 0.3);
        save(scene, "dusty.png");
        g_autofree char *out = calibrate(0, &one, 1, FALSE);
        assert_right(out, "dusty.png", truth);
    }
    struct scene *scene = scene_new(0.05);
    ball_scene_clear();
    paint(scene, &one, NULL, 0, 0.01);
    dust(scene, 180, 130, 1, 1, 2);
    dust(scene, 160, 150, 9, 1, 2);
    save(scene, "only.png");
    g_autofree char *out = calibrate(1, &one, 1, FALSE);
    assert_said(out, "only.png: ball 1 shows no lamp: its bright spots are specks or streaks");
}

TEST(two_highlights) {
    const struct lamp lamps[] = {{polar(35, 20), FALSE, 3, 8}, {polar(50, 200), FALSE, 2.5, 8}};
    const struct lamp fainter[] = {lamps[0], {polar(50, 200), FALSE, 3, 0.1}};
    ball_scene_clear();
    photograph("two.png", lamps, 2);
    g_autofree char *refused = calibrate(1, &one, 1, FALSE);
    assert_said(refused, "two.png: ball 1 shows two highlights, at ");
    photograph("two.png", fainter, 2);
    g_autofree char *out = calibrate(0, &one, 1, FALSE);
    assert_right(out, "two.png", lamps[0].at);
}

/* A circle that is wrong by up to 3 % is corrected, and a worse one is refused. If no outline is
 * visible, a highlight outside of the circle shows the mistake. */
TEST(wrong_circle) {
    const struct xyz truth = polar(50, 120);
    const struct lamp lamp = {truth, FALSE, 3, 20};
    ball_scene_clear();
    photograph("circle.png", &lamp, 1);
    for (int i = 0; i < 4; i++) {
        const struct ball given = {one.x + (i & 1 ? 2.2 : -1.5), one.y + (i & 2 ? 1.5 : -2.2),
                                   one.r + (i & 1 ? -2 : 2)};
        g_autofree char *out = calibrate(0, &given, 1, FALSE);
        assert_right(out, "circle.png", truth);
    }
    static const struct ball wrong[] = {
        {203.4, 188.7, 78}, {203.4, 188.7, 104}, {215, 188.7, 90.3}, {190, 200, 90.3}};
    for (gsize i = 0; i < G_N_ELEMENTS(wrong); i++) {
        g_autofree char *out = calibrate(1, &wrong[i], 1, FALSE);
        assert_said(out, "ball 1 is said to be at ");
        assert_said(out, "but the pictures show an outline at 203.");
    }
    struct scene *scene = scene_new(0);
    paint(scene, &one, &lamp, 1, 0);
    dust(scene, 260, 240, 2, 2, 0.8);
    save(scene, "circle.png");
    const struct ball beside = {one.x + 70, one.y + 20, one.r};
    g_autofree char *out = calibrate(1, &beside, 1, FALSE);
    assert_said(out, "circle.png: ball 1 has a brighter highlight next to it, at 18");
}

/* As of a ball on a dark table: only the upper half of its outline is before something bright. */
TEST(half_an_outline) {
    const struct xyz truth = polar(45, 300);
    const struct ball given = {one.x + 1.6, one.y - 2.3, one.r + 1.9};
    struct scene *scene = scene_new(0.01);
    ball_scene_clear();
    for (int i = 0; i < SIZE * (int)one.y; i++)
        scene->light[i] = 0.05;
    paint(scene, &one, &(struct lamp){truth, FALSE, 3, 20}, 1, 0.01);
    save(scene, "half.png");
    g_autofree char *out = calibrate(0, &given, 1, FALSE);
    assert_said(out, "ball 1: its outline is seen at 203.");
    assert_right(out, "half.png", truth);
}

static void paint_three(const char *name, const struct lamp *others, const struct lamp *last) {
    struct scene *scene = scene_new(0.05);
    for (int i = 0; i < 3; i++)
        paint(scene, &three[i], i < 2 ? others : last, 1, 0.01);
    save(scene, name);
}

/* One of three is outvoted; of two, none. */
TEST(contradictions) {
    const struct xyz truth = polar(30, 70);
    const struct lamp lamp = {truth, FALSE, 4, 20}, other = {polar(50, 70), FALSE, 4, 20};
    ball_scene_clear();
    paint_three("three.png", &lamp, &other);
    g_autofree char *outvoted = calibrate(0, three, 3, FALSE);
    assert_right(outvoted, "three.png", truth);
    const char *at = strstr(outvoted, "three.png: ball 3 shows the lamp ");
    g_assert_nonnull(at);
    g_assert_cmpfloat_with_epsilon(
        g_ascii_strtod(at + strlen("three.png: ball 3 shows the lamp "), NULL), 20, 1);
    g_autofree char *out = calibrate(1, three + 1, 2, FALSE);
    assert_said(out, "three.png: balls 1 and 2 contradict each other: they show the lamp ");
    g_assert_cmpfloat_with_epsilon(
        g_ascii_strtod(strstr(out, "show the lamp ") + strlen("show the lamp "), NULL), 20, 1);
    struct scene *scene = scene_new(0.05);
    paint(scene, &three[0], &lamp, 1, 0.01);
    paint(scene, &three[1], &(struct lamp){polar(60, 250), FALSE, 4, 20}, 1, 0.01);
    paint(scene, &three[2], &(struct lamp){polar(80, 140), FALSE, 4, 20}, 1, 0.01);
    save(scene, "three.png");
    g_autofree char *none = calibrate(1, three, 3, FALSE);
    assert_said(
        none, "three.png: the balls contradict each other: the direction in which ball 2 shows the "
              "lamp is 90.");
    assert_said(none, "no majority of them agrees");
}

/* A lamp 1 m away from balls of 30 mm radius: where it is, within its errors. */
TEST(near_lamp) {
    const double mm = 30 / three[0].r;
    const struct xyz place = {700, 500, 1850};
    const struct lamp lamp = {place, TRUE, 2, 10};
    double p[3], error[3];
    ball_scene_clear();
    paint_three("near.png", &lamp, &lamp);
    g_autofree char *out = calibrate(0, three, 3, FALSE);
    const char *at = strstr(out, "   at ");
    g_assert_nonnull(at);
    g_assert_cmpint(sscanf(at, "   at %lf %lf %lf mm, ± %lf %lf %lf", &p[0], &p[1], &p[2],
                           &error[0], &error[1], &error[2]),
                    ==, 6);
    const double truth[3] = {mm * (place.x - three[0].x), mm * (place.y + three[0].y),
                             mm * place.z};
    for (int k = 0; k < 3; k++) {
        g_assert_cmpfloat(fabs(p[k] - truth[k]), <, 3 * error[k]);
        g_assert_cmpfloat(error[k], >, 0);
        g_assert_cmpfloat(error[k], <, 100);
    }
    g_autofree char *json = calibrate(0, three, 3, TRUE);
    assert_said(json, "\"error_mm\"");
    assert_said(json, "\"place_mm\"");
}

/* The same lamp on a dome of known radius around a point of the plate below the balls. One ball is
 * enough; one of three that contradicts the others is left out. */
TEST(dome) {
    const double mm = 30 / three[0].r;
    const struct xyz place = {700, 500, 1850}, other = {-900, 500, 1500};
    const struct xyz truth = {mm * (place.x - 200), mm * (place.y + 190), mm * place.z + 30};
    const struct lamp lamp = {place, TRUE, 2, 10}, wrong = {other, TRUE, 2, 10};
    g_autofree char *dome = g_strdup_printf("--dome-radius=%.3f", sqrt(dot(truth, truth)));
    ball_scene_clear();
    for (int n = 1; n <= 3; n += 2) {
        const struct ball *b = three;
        paint_three("near.png", &lamp, &wrong);
        g_autofree char *first = g_strdup_printf("--ball=%g,%g,%g", b[0].x, b[0].y, b[0].r);
        g_autofree char *second = g_strdup_printf("--ball=%g,%g,%g", b[1].x, b[1].y, b[1].r);
        g_autofree char *third = g_strdup_printf("--ball=%g,%g,%g", b[2].x, b[2].y, b[2].r);
        const char *const argv[] = {MESORIG,       "calibrate",
                                    "lights",      "--images",
                                    "photos",      "-o",
                                    "dome.lp",     "--force",
                                    "--radius=30", "--within=2",
                                    dome,          "--dome-middle=200,190",
                                    first,         n > 1 ? second : NULL,
                                    third,         NULL};
        g_autofree char *out = NULL, *errors = NULL;
        struct xyz at;
        double error;
        const int code = process_run_in(world_fixture_folder(), argv, &out, &errors);
        g_test_message("%s%s", out, errors);
        g_assert_cmpint(code, ==, 0);
        const char *said = strstr(out, "on the dome at ");
        g_assert_nonnull(said);
        g_assert_cmpint(
            sscanf(said, "on the dome at %lf %lf %lf mm, ± %lf", &at.x, &at.y, &at.z, &error), ==,
            4);
        const struct xyz off = plus(at, truth, -1);
        g_assert_cmpfloat(sqrt(dot(off, off)), <, 3 * error);
        g_assert_cmpfloat(error, <, 25);
        g_assert_cmpfloat(fabs(sqrt(dot(at, at) / dot(truth, truth)) - 1), <, 1e-3);
    }
}

AFTER_TESTS {
    world_fixture_clean();
}
