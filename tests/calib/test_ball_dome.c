/* calibrate lights --images in a dome: forty lamps a few radii away from a ball that lies on a
 * plate. The pictures are drawn by a formula that shares no code with calib/. The ball mirrors the
 * lamp, the plate that the lamp lights and the lamp's reflection in the plate; the camera is far
 * away and looks straight down. Each direction is right within its error bar, or refused.
 *
 * MESORIG_DOME=NAME in the environment: this case only, whose pictures are kept. */
#include "lib/ball_scene.h"
#include "lib/deviate.h"
#include "lib/process.h"

#include <string.h>

#define MESORIG BUILD_DIR "/bin/mesorig"
#define LAMPS   40
#define FINE    4   /* samples a pixel, each way, where the picture changes quickly */
#define BARS    3.0 /* error bars, RMS, within which a direction is right */

struct dome_case {
    const char *name;
    double radius_px;
    double lamps_radii; /* distance of the lamps from the ball's middle */
    double lamp_radii;  /* radius of a lamp */
    double exposure;    /* light of a white plate under a lamp at the zenith; 1 is clipped */
    double albedo,
        gloss;           /* of the plate; gloss: its mirror image of a lamp, relative to the lamp */
    double gain;         /* light of a lamp in the ball; 1 is clipped */
    double haze;         /* share of light that the lens spreads over some pixels */
    double circle_px[3]; /* by which the circle is given wrongly */
    const char *within;  /* option, or NULL */
    int least;           /* directions that must be found */
};

/* Ten lamps on each of four rings; in radii of the ball, whose middle is the origin. */
static struct xyz lamp_at(const struct dome_case *c, int i) {
    static const double theta_deg[] = {18, 38, 56, 72};
    const double ring = theta_deg[i / 10], phi = 36 * (i % 10) + 13 * (int)(i / 10) + 3;
    const struct xyz d = polar(ring, phi);
    return (struct xyz){c->lamps_radii * d.x, c->lamps_radii * d.y, c->lamps_radii * d.z};
}

/* Whether the ball is between a point of the plate and the lamp. */
static gboolean shadowed(struct xyz p, struct xyz lamp) {
    const struct xyz d = unit(plus(lamp, p, -1));
    const double along = -dot(p, d);
    return along > 0 && dot(p, p) - along * along < 1;
}

/* Light of a point of the plate, z = −1, as seen along a direction. */
static double plate_light(const struct dome_case *c, struct xyz lamp, struct xyz p,
                          struct xyz along) {
    if (shadowed(p, lamp))
        return 0.02 * c->exposure * c->albedo;
    const struct xyz to = plus(lamp, p, -1);
    const double range2 = dot(to, to), far2 = pow(c->lamps_radii + 1, 2);
    const double matt = c->exposure * c->albedo * far2 * to.z / (range2 * sqrt(range2));
    const struct xyz mirrored = {along.x, along.y, -along.z};
    const double cosine = dot(mirrored, unit(to));
    if (!(c->gloss > 0) || cosine < 0.5)
        return matt;
    const double width = hypot(c->lamp_radii / sqrt(range2), 0.03);
    return matt + c->gain * c->gloss * exp(-0.5 * pow(acos(fmin(cosine, 1)) / width, 2));
}

/* Light of a point of the picture, x to the right and y up in radii. ret_off: how far the mirrored
 * ray is from the lamp, in radii of the lamp's disc; large outside of the ball. */
static double light_of(const struct dome_case *c, struct xyz lamp, double x, double y,
                       double *ret_off, struct xyz *ret_to) {
    const double rest = 1 - x * x - y * y;
    *ret_off = 1e9;
    if (!(rest > 0))
        return plate_light(c, lamp, (struct xyz){x, y, -1}, (struct xyz){0, 0, -1});
    const struct xyz n = {x, y, sqrt(rest)}, to = plus(lamp, n, -1);
    const struct xyz m = {2 * n.z * n.x, 2 * n.z * n.y, 2 * n.z * n.z - 1};
    const double range = sqrt(dot(to, to)), cosine = dot(m, to) / range;
    double light = 0.01 * c->exposure; /* the dome's inside */
    *ret_to = unit(to);
    *ret_off = acos(CLAMP(cosine, -1, 1)) / (c->lamp_radii / range);
    if (*ret_off < 1 && dot(n, to) > 0)
        light += c->gain;
    if (m.z < -1e-3)
        light += 0.6 * plate_light(c, lamp, plus(n, m, (-1 - n.z) / m.z), m);
    return light;
}

struct scene {
    int side;
    double middle;
    double *light;
};

/* ret: the mean direction from the ball's surface to the lamp over the lamp's image. */
static void draw(const struct dome_case *c, struct xyz lamp, struct scene *to, struct xyz *ret) {
    struct xyz sum = {0, 0, 0};
    for (int p = 0; p < to->side * to->side; p++) {
        const double i = p % to->side, j = (int)(p / to->side);
        const double x = (i - to->middle) / c->radius_px, y = (to->middle - j) / c->radius_px;
        const double r = hypot(x, y);
        double off;
        struct xyz d;
        to->light[p] = light_of(c, lamp, x, y, &off, &d);
        const gboolean edge = fabs(r - 1) * c->radius_px < 1.5 ||
                              fabs(r - sqrt(0.5)) * c->radius_px < 1.5 ||
                              (r < 1 && off < 6 + 12 / (c->radius_px * c->lamp_radii));
        if (!edge)
            continue;
        double mean = 0;
        for (int k = 0; k < FINE * FINE; k++) {
            const double u = x + ((k % FINE + 0.5) / FINE - 0.5) / c->radius_px;
            const double v = y - ((int)(k / FINE) + 0.5 - 0.5 * FINE) / FINE / c->radius_px;
            mean += light_of(c, lamp, u, v, &off, &d) / (FINE * FINE);
            if (off < 1)
                sum = plus(sum, d, 1);
        }
        to->light[p] = mean;
    }
    *ret = unit(sum);
}

static void blur(const struct scene *scene, double sigma_px, double *ret) {
    const int n = scene->side, reach = MAX(1, (int)ceil(3.5 * sigma_px));
    g_autofree double *rows = g_new0(double, n *n), *kernel = g_new0(double, 2 * reach + 1);
    double sum = 0;
    for (int k = -reach; k <= reach; k++)
        sum += kernel[k + reach] = exp(-0.5 * pow(k / sigma_px, 2));
    for (int k = 0; k <= 2 * reach; k++)
        kernel[k] /= sum;
    for (int pass = 0; pass < 2; pass++) {
        const double *from = pass == 0 ? scene->light : rows;
        double *to = pass == 0 ? rows : ret;
        for (int p = 0; p < n * n; p++) {
            const int at = pass == 0 ? p % n : p / n, step = pass == 0 ? 1 : n;
            double value = 0;
            for (int k = -reach; k <= reach; k++)
                value += kernel[k + reach] * from[p + (CLAMP(at + k, 0, n - 1) - at) * step];
            to[p] = value;
        }
    }
}

static void save(const struct dome_case *c, const struct scene *scene, GRand *rand,
                 const char *name) {
    const int pixels = scene->side * scene->side;
    g_autofree guint8 *codes = g_new(guint8, pixels);
    g_autofree double *sharp = g_new(double, pixels), *haze = g_new(double, pixels);
    blur(scene, 0.6, sharp);
    blur(scene, 4, haze);
    for (int p = 0; p < pixels; p++) {
        const double noise = deviate_sum(rand);
        const double light = fmax((1 - c->haze) * sharp[p] + c->haze * haze[p] + 0.002 * noise, 0);
        codes[p] = (guint8)lround(255 * fmin(ball_scene_srgb(light), 1));
    }
    ball_scene_write(name, codes, scene->side, scene->side);
}

/* A picture of another size among them. */
static void save_thumbnail(void) {
    static const guint8 grey[20 * 30];
    ball_scene_write("thumb.png", grey, 30, 20);
}

static void test_case(gconstpointer data) {
    const struct dome_case *c = data;
    g_autofree char *out = NULL, *errors = NULL;
    g_autoptr(GRand) rand = g_rand_new_with_seed(11);
    struct scene scene = {.side = (int)(2.7 * c->radius_px)};
    struct xyz truth[LAMPS];
    int found = 0, wrong = 0;
    double worst = 0, squares = 0;
    scene.middle = 0.5 * scene.side + 0.3;
    scene.light = g_new0(double, scene.side *scene.side);
    ball_scene_clear();
    for (int i = 0; i < LAMPS; i++) {
        g_autofree char *name = g_strdup_printf("%02d.png", i);
        draw(c, lamp_at(c, i), &scene, &truth[i]);
        save(c, &scene, rand, name);
    }
    save_thumbnail();
    g_free(scene.light);
    g_autofree char *ball =
        g_strdup_printf("--ball=%.2f,%.2f,%.2f", scene.middle + c->circle_px[0],
                        scene.middle + c->circle_px[1], c->radius_px + c->circle_px[2]);
    const char *const argv[] = {MESORIG,     "calibrate", "lights", "--images", "photos", "-o",
                                "lights.lp", "--force",   ball,     c->within,  NULL};
    const int code = process_run_in(world_fixture_folder(), argv, &out, &errors);
    g_test_message("%s%s", out, errors);
    for (int i = 0; i < LAMPS && code == 0; i++) {
        g_autofree char *line = g_strdup_printf("\n  %02d.png ", i);
        const char *at = strstr(out, line);
        struct xyz d;
        double sigma;
        if (!at)
            continue;
        g_assert_cmpint(sscanf(at + strlen(line), "%lf %lf %lf ± %lf°", &d.x, &d.y, &d.z, &sigma),
                        ==, 4);
        const double off = acos(CLAMP(dot(unit(d), truth[i]), -1, 1)) * DEG;
        const gboolean bad = !(off < BARS * sigma);
        found++;
        wrong += bad;
        worst = fmax(worst, off);
        squares += pow(off / sigma, 2);
        g_test_message("%02d: %.3f° off ± %.2f°%s", i, off, sigma, bad ? "   <-- FAILS" : "");
    }
    g_test_message("%s: %d of %d, worst %.2f°, (off / error bar)² %.2f, %d wrong", c->name, found,
                   LAMPS, worst, found ? squares / found : 0, wrong);
    if (g_getenv("MESORIG_DOME"))
        return;
    g_assert_nonnull(strstr(out, "thumb.png: has 30 × 20 pixels, and most pictures have"));
    g_assert_cmpint(wrong, ==, 0);
    g_assert_cmpint(found, >=, c->least);
}

static const struct dome_case cases[] = {
    {"black plate", 120, 6.2, 0.3, 0.3, 0.04, 0, 30, 0.02, {1, -1, 1}, NULL, 38},
    {"grey plate", 120, 6.2, 0.3, 0.3, 0.4, 0, 30, 0.02, {1, -1, 1}, NULL, 38},
    {"white plate", 120, 6.2, 0.3, 0.3, 0.9, 0, 30, 0.02, {1, -1, 1}, NULL, 38},
    {"glossy plate", 120, 6.2, 0.3, 0.3, 0.2, 0.02, 30, 0.02, {1, -1, 1}, NULL, 38},
    {"very glossy plate", 120, 6.2, 0.3, 0.3, 0.2, 0.3, 30, 0.02, {1, -1, 1}, NULL, 38},
    {"not clipped", 120, 6.2, 0.3, 0.1, 0.4, 0.02, 0.9, 0.02, {1, -1, 1}, NULL, 38},
    {"small, black", 36, 6.2, 0.3, 0.3, 0.04, 0, 30, 0.02, {0.3, -0.2, 0.2}, "--within=3", 38},
    {"small, grey", 36, 6.2, 0.3, 0.3, 0.4, 0, 30, 0.02, {1, 1, 2.5}, "--within=3", 38},
    {"small, glossy", 36, 6.2, 0.2, 0.3, 0.2, 0.1, 30, 0.02, {-1, 0, 2.5}, "--within=3", 38},
    {"small, not clipped", 36, 6.2, 0.2, 0.05, 0.3, 0.02, 0.9, 0.01, {1, 1, 2.5}, "--within=3", 38},
    {"tiny highlights", 36, 20, 0.25, 0.02, 0.3, 0, 5, 0, {0.3, 0.3, 0.3}, "--within=3", 38},
    {"small, far lamps", 36, 30, 0.5, 0.3, 0.2, 0.02, 30, 0.005, {1, -2, 2}, "--within=3", 30},
};

int main(int argc, char **argv) {
    const char *only = g_getenv("MESORIG_DOME");
    g_test_init(&argc, &argv, NULL);
    for (gsize i = 0; i < G_N_ELEMENTS(cases); i++) {
        g_autofree char *path = g_strdup_printf("/ball_dome/%s", cases[i].name);
        if (!only || g_str_equal(only, cases[i].name))
            g_test_add_data_func(path, &cases[i], test_case);
    }
    int result = g_test_run();
    if (only)
        return result;
    world_fixture_clean();
    return result;
}
