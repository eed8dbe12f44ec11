/* calibrate lights --images on seeded cases: every lamp is right within MAX_OFF, or within MAX_BARS
 * of its stated error, or refused with a cause. The stated error is the root mean square of the
 * angle: of two independent normal errors 63 % lie within it, and 98.2 % within its double. A
 * mirror or glossy ball is drawn by a formula that shares no code with calib/: each ray of an
 * orthographic or perspective camera is reflected, and what it meets is a lamp, far or near, a
 * window, the ground, a room. What goes wrong in photographs is added: dust, clipping, a second
 * highlight, blur, noise, another tone curve, a wrong circle, another ball next to it.
 *
 * MESORIG_BALLS=N in the environment: N cases instead of CASES; --verbose shows each of them. */
#include "lib/ball_scene.h"
#include "lib/deviate.h"
#include "lib/process.h"
#include "lib/test.h"

#include <string.h>

#define MESORIG  BUILD_DIR "/bin/mesorig"
#define CASES    40
#define PHOTOS   3
#define WIDE     320
#define HIGH     300
#define FINE     3   /* samples a pixel, each way */
#define MAX_OFF  0.5 /* degrees */
#define MAX_BARS 2.0

enum trouble {
    DUST = 1 << 0,
    CLIPPED = 1 << 1,
    SECOND = 1 << 2, /* another lamp, of any brightness */
    WINDOW = 1 << 3,
    GROUND = 1 << 4, /* a table that throws the lamp's light back */
    CIRCLE = 1 << 5, /* given wrongly by up to 8 % */
    BESIDE = 1 << 6, /* another ball */
    GLOSSY = 1 << 7,
    BLUR = 1 << 8,
    TONES = 1 << 9, /* not sRGB, as 8 bits are taken for */
    NOISE = 1 << 10,
    NEAR = 1 << 11,
    DIM = 1 << 12, /* nothing is bright behind the ball: no outline */
};
static const char *const names[] = {
    "dust",   "clipped", "second lamp", "window", "ground",    "wrong circle", "ball beside",
    "glossy", "blur",    "tone curve",  "noise",  "near lamp", "no outline"};
#define TROUBLES (int)G_N_ELEMENTS(names)

/* In radii of the ball, x to the right, y up, z to the camera, which is at 0 looking along −z, or
 * infinitely far. */
struct ball_case {
    GRand *rand;
    int troubles;
    double focal_px; /* 0: orthographic */
    double x_px, y_px, radius_px;
    struct xyz centre;
    double beside_px[3];
    double lobe_rad, albedo; /* of a glossy ball, */
    double blur_px, noise, exponent;
    double backdrop, room;
    struct xyz window;
    double window_rad, window_light;
};

struct lamp {
    struct xyz at; /* far: a unit direction; near: a place relative to the ball */
    gboolean near;
    double radius_rad, gain; /* 1: just white */
    struct xyz sum;          /* of directions from which its light comes */
};

static double between(GRand *rand, double from, double to) {
    return g_rand_double_range(rand, from, to);
}

static double any_scale(GRand *rand, double from, double to) {
    return exp(between(rand, log(from), log(to)));
}

static gboolean has(const struct ball_case *c, int trouble) {
    return (c->troubles & trouble) != 0;
}

/* The ray of a point of the picture: where it begins, and a unit direction. */
static struct xyz ray_of(const struct ball_case *c, double x_px, double y_px,
                         struct xyz *ret_from) {
    if (c->focal_px > 0) {
        *ret_from = (struct xyz){0, 0, 0};
        return unit((struct xyz){(x_px - (WIDE - 1) / 2.0) / c->focal_px,
                                 ((HIGH - 1) / 2.0 - y_px) / c->focal_px, -1});
    }
    *ret_from = (struct xyz){x_px / c->radius_px, -y_px / c->radius_px, 1000};
    return (struct xyz){0, 0, -1};
}

static double lit_by(const struct ball_case *c, struct lamp *lamp, struct xyz mirrored,
                     struct xyz normal, struct xyz hit) {
    const struct xyz to = lamp->near ? unit(plus(plus(lamp->at, c->centre, 1), hit, -1)) : lamp->at;
    const double cosine = dot(mirrored, to);
    const double matt = has(c, GLOSSY) ? c->albedo * lamp->gain * fmax(dot(normal, to), 0) : 0;
    if (cosine < 0.8)
        return matt;
    const double off = acos(fmin(cosine, 1)), disc = off / lamp->radius_rad;
    const double light = lamp->gain * (has(c, GLOSSY) ? exp(-0.5 * pow(off / c->lobe_rad, 2))
                                       : disc < 1     ? 1
                                                      : 0.02 * exp(-disc));
    if (off < 2 * (has(c, GLOSSY) ? c->lobe_rad : lamp->radius_rad))
        lamp->sum = plus(lamp->sum, to, light);
    return light + matt;
}

/* What comes along a ray. */
static double light_of(const struct ball_case *c, struct lamp *lamps, int n, double x_px,
                       double y_px) {
    struct xyz from;
    const struct xyz ray = ray_of(c, x_px, y_px, &from), to = plus(from, c->centre, -1);
    const double along = -dot(ray, to), rest = 1 - dot(to, to) + along * along;
    if (!(rest > 0)) {
        const double off = hypot(x_px - c->beside_px[0], y_px - c->beside_px[1]);
        return has(c, BESIDE) && off < c->beside_px[2] ? 0.3 * c->backdrop : c->backdrop;
    }
    const struct xyz hit = plus(from, ray, along - sqrt(rest)), normal = plus(hit, c->centre, -1);
    const struct xyz mirrored = plus(ray, normal, -2 * dot(ray, normal));
    double light = c->room * (1 + 0.3 * mirrored.y);
    for (int i = 0; i < n; i++)
        light += lit_by(c, &lamps[i], mirrored, normal, hit);
    if (has(c, WINDOW) && fabs(asin(mirrored.y) - asin(c->window.y)) < c->window_rad &&
        fabs(atan2(mirrored.x, mirrored.z) - atan2(c->window.x, c->window.z)) < c->window_rad)
        light += c->window_light;
    if (has(c, GROUND) && mirrored.y < -0.2) {
        /* A table below, half matt, half a mirror of the lamp. */
        const struct xyz up = {mirrored.x, -mirrored.y, mirrored.z};
        const double off = apart_rad(up, lamps[0].at);
        light += lamps[0].gain * (0.01 + 0.05 * exp(-0.5 * pow(off / 0.2, 2)));
    }
    return light;
}

static double *draw(const struct ball_case *c, struct lamp *lamps, int n) {
    double *light = g_new0(double, WIDE *HIGH);
    for (int j = 0; j < HIGH; j++)
        for (int i = 0; i < WIDE; i++)
            for (int k = 0; k < FINE * FINE; k++)
                light[j * WIDE + i] += light_of(c, lamps, n, i + (k % FINE + 0.5) / FINE - 0.5,
                                                j + ((int)(k / FINE) + 0.5) / FINE - 0.5) /
                                       (FINE * FINE);
    return light;
}

/* A separable Gaussian. */
static void blur(double *light, double sigma_px) {
    const int reach = (int)ceil(4 * sigma_px);
    g_autofree double *other = g_new(double, WIDE *HIGH);
    for (int pass = 0; pass < 2; pass++) {
        for (int p = 0; p < WIDE * HIGH; p++) {
            double sum = 0, weights = 0;
            for (int k = -reach; k <= reach; k++) {
                const int x = CLAMP(p % WIDE + (pass == 0 ? k : 0), 0, WIDE - 1);
                const int y = CLAMP((int)(p / WIDE) + (pass == 1 ? k : 0), 0, HIGH - 1);
                const double weight = exp(-0.5 * pow(k / sigma_px, 2));
                sum += weight * light[y * WIDE + x];
                weights += weight;
            }
            other[p] = sum / weights;
        }
        memcpy(light, other, sizeof(double) * WIDE * HIGH);
    }
}

/* Specks of one to nine pixels, and a hair, on and around the ball: the same in each photograph of
 * a case, but for how bright they are lit. */
static void add_dust(const struct ball_case *c, guint seed, double *light) {
    g_autoptr(GRand) rand = g_rand_new_with_seed(seed);
    for (int n = g_rand_int_range(rand, 1, 8); n > 0; n--) {
        const double r = c->radius_px * sqrt(between(rand, 0, 1.2));
        const double phi = between(rand, 0, 2 * G_PI);
        const double bright = any_scale(rand, 0.1, 3) * between(c->rand, 0.5, 1);
        const gboolean hair = n == 1;
        const int wide = hair ? 12 : g_rand_int_range(rand, 1, 4);
        const int high = hair ? 1 : g_rand_int_range(rand, 1, 4);
        for (int k = 0; k < wide * high; k++) {
            const int x = (int)(c->x_px + r * cos(phi)) + k % wide;
            const int y = (int)(c->y_px + r * sin(phi)) + k / wide;
            if (x >= 0 && y >= 0 && x < WIDE && y < HIGH)
                light[y * WIDE + x] = fmax(light[y * WIDE + x], bright);
        }
    }
}

static void save(const struct ball_case *c, const double *light, const char *name) {
    g_autofree guint8 *pixels = g_new(guint8, WIDE * HIGH);
    for (int i = 0; i < WIDE * HIGH; i++) {
        const double normal = deviate_sum(c->rand);
        const double v = fmax(light[i] + c->noise * normal, 0);
        const double code = has(c, TONES) ? pow(v, c->exponent) : ball_scene_srgb(v);
        pixels[i] = (guint8)lround(255 * fmin(code, 1));
    }
    ball_scene_write(name, pixels, WIDE, HIGH);
}

/* The circle around the ball's outline, as one reads it off a picture: of a perspective camera it
 * is that around the ellipse in which the rays touch the ball. */
static void circle_of(const struct ball_case *c, double ret[3]) {
    ret[0] = c->x_px, ret[1] = c->y_px, ret[2] = c->radius_px;
    if (c->focal_px == 0)
        return;
    const double sine = 1 / sqrt(dot(c->centre, c->centre)), cosine = sqrt(1 - sine * sine);
    const struct xyz axis = unit(c->centre);
    const struct xyz a = unit((struct xyz){-axis.z, 0, axis.x});
    const struct xyz b = {axis.y * a.z - axis.z * a.y, axis.z * a.x - axis.x * a.z,
                          axis.x * a.y - axis.y * a.x};
    double least[2] = {1e9, 1e9}, most[2] = {-1e9, -1e9};
    for (int k = 0; k < 360; k++) {
        const struct xyz ray =
            plus(plus((struct xyz){cosine * axis.x, cosine * axis.y, cosine * axis.z}, a,
                      sine * cos(k / DEG)),
                 b, sine * sin(k / DEG));
        const double at[2] = {(WIDE - 1) / 2.0 - c->focal_px * ray.x / ray.z,
                              (HIGH - 1) / 2.0 + c->focal_px * ray.y / ray.z};
        for (int i = 0; i < 2; i++) {
            least[i] = fmin(least[i], at[i]);
            most[i] = fmax(most[i], at[i]);
        }
    }
    ret[0] = (least[0] + most[0]) / 2;
    ret[1] = (least[1] + most[1]) / 2;
    ret[2] = (most[0] - least[0] + most[1] - least[1]) / 4;
}

static struct ball_case *case_new(guint seed) {
    struct ball_case *c = g_new0(struct ball_case, 1);
    GRand *rand = c->rand = g_rand_new_with_seed(seed);
    const int n = (int)(seed % 4); /* every fourth has none */
    for (int k = 0; k < n; k++)
        c->troubles |= 1 << g_rand_int_range(rand, 0, TROUBLES);
    c->radius_px = between(rand, 45, 105);
    c->x_px = between(rand, 1.25 * c->radius_px, WIDE - 1.25 * c->radius_px);
    c->y_px = between(rand, 1.25 * c->radius_px, HIGH - 1.25 * c->radius_px);
    c->focal_px = g_rand_boolean(rand) ? any_scale(rand, 400, 3000) : 0;
    c->centre = (struct xyz){c->x_px / c->radius_px, -c->y_px / c->radius_px, 0};
    if (c->focal_px > 0)
        c->centre =
            (struct xyz){(c->x_px - (WIDE - 1) / 2.0) / c->radius_px,
                         ((HIGH - 1) / 2.0 - c->y_px) / c->radius_px, -c->focal_px / c->radius_px};
    const double aside = between(rand, 0, 2 * G_PI), small = between(rand, 0.5, 1.2) * c->radius_px;
    const double apart = c->radius_px * between(rand, 1.0, 1.1) + small;
    c->beside_px[0] = c->x_px + apart * cos(aside);
    c->beside_px[1] = c->y_px + apart * sin(aside);
    c->beside_px[2] = small;
    c->lobe_rad = between(rand, 2, 8) / DEG;
    c->albedo = between(rand, 0, 0.05);
    c->blur_px = has(c, BLUR) ? between(rand, 0.5, 4) : 0.5;
    c->noise = has(c, NOISE) ? any_scale(rand, 0.002, 0.02) : 0.001;
    c->exponent = 1 / between(rand, 1, 3);
    c->room = 0.01;
    c->backdrop = has(c, DIM) ? 0.01 : between(rand, 0.04, 0.2);
    c->window = polar(between(rand, 20, 120), between(rand, 0, 360));
    c->window_rad = between(rand, 3, 15) / DEG;
    c->window_light = any_scale(rand, 0.02, 1);
    return c;
}

static int count_of[2 + TROUBLES], right_of[2 + TROUBLES];
static double squares;
static int n_directions, n_within[3]; /* one, two and three error bars */

/* Photographs of one ball under some lamps, each of which is right or refused. */
static int check_case(guint seed) {
    struct ball_case *c = case_new(seed);
    struct lamp lamps[PHOTOS][2] = {0};
    double circle[3];
    int wrong = 0;
    g_autofree char *out = NULL, *errors = NULL, *focal = NULL;
    g_autoptr(GString) told = g_string_new(NULL);
    ball_scene_clear();
    for (int i = 0; i < PHOTOS; i++) {
        const gboolean near = has(c, NEAR);
        struct xyz at = polar(between(c->rand, 5, 95), between(c->rand, 0, 360));
        const double range = near ? between(c->rand, 10, 60) : 1;
        at = (struct xyz){range * at.x, range * at.y, range * at.z};
        lamps[i][0] = (struct lamp){at,
                                    near,
                                    between(c->rand, 1.5, 4) / DEG,
                                    has(c, CLIPPED) ? any_scale(c->rand, 1, 1000)
                                                    : between(c->rand, 0.3, 0.95),
                                    {0, 0, 0}};
        lamps[i][1] = (struct lamp){polar(between(c->rand, 5, 110), between(c->rand, 0, 360)),
                                    FALSE,
                                    between(c->rand, 1.5, 4) / DEG,
                                    lamps[i][0].gain * any_scale(c->rand, 0.02, 1),
                                    {0, 0, 0}};
        g_autofree char *name = g_strdup_printf("%d.png", i);
        g_autofree double *light = draw(c, lamps[i], has(c, SECOND) ? 2 : 1);
        blur(light, c->blur_px);
        if (has(c, DUST))
            add_dust(c, seed, light);
        save(c, light, name);
    }
    circle_of(c, circle);
    const double off = has(c, CIRCLE) ? 0.08 * c->radius_px : 0.5;
    for (int k = 0; k < 3; k++)
        circle[k] += between(c->rand, -off, off);
    g_autofree char *ball =
        g_strdup_printf("--ball=%.2f,%.2f,%.2f", circle[0], circle[1], circle[2]);
    focal = g_strdup_printf("--focal=%.1f", c->focal_px);
    const char *const argv[] = {
        MESORIG, "calibrate", "lights",  "--images", "photos",
        "-o",    "lights.lp", "--force", ball,       c->focal_px > 0 ? focal : NULL,
        NULL};
    const int code = process_run_in(world_fixture_folder(), argv, &out, &errors);
    for (int k = 0; k < TROUBLES; k++)
        if (c->troubles & 1 << k)
            g_string_append_printf(told, " %s,", names[k]);
    g_string_append_printf(told, " f %.0f, circle %.1f %.1f %.1f", c->focal_px, c->x_px, c->y_px,
                           c->radius_px);
    if (code == 0)
        g_string_append_printf(told, "; %.*s", (int)strcspn(strstr(out, "ball 1: "), "\n"),
                               strstr(out, "ball 1: "));
    for (int i = 0; i < PHOTOS; i++) {
        g_autofree char *line = g_strdup_printf("\n  %d.png ", i);
        g_autofree char *cause = g_strdup_printf("%d.png: ", i);
        const char *found = strstr(out, line);
        struct xyz d;
        double sigma;
        const int of = c->troubles == 0 ? 0 : 1;
        count_of[of]++;
        for (int k = 0; k < TROUBLES; k++)
            count_of[2 + k] += (c->troubles >> k) & 1;
        if (code == 0 && found) {
            g_assert_cmpint(
                sscanf(found + strlen(line), "%lf %lf %lf ± %lf°", &d.x, &d.y, &d.z, &sigma), ==,
                4);
            const struct xyz truth = lamps[i][0].near ? unit(lamps[i][0].sum) : lamps[i][0].at;
            const double off_deg = apart_rad(d, truth) * DEG;
            const gboolean bad = !(off_deg < fmax(MAX_OFF, MAX_BARS * sigma));
            wrong += bad;
            right_of[of] += !bad;
            for (int k = 0; k < TROUBLES; k++)
                right_of[2 + k] += !bad && (c->troubles >> k) & 1;
            squares += pow(off_deg / sigma, 2);
            n_directions++;
            for (int k = 0; k < 3; k++)
                n_within[k] += off_deg < (k + 1) * sigma;
            g_string_append_printf(told, "\n    %d: %s %.3f° ± %.2f°", i, bad ? "WRONG" : "right",
                                   off_deg, sigma);
            continue;
        }
        const char *why = strstr(out, cause)                ? strstr(out, cause)
                          : strstr(errors, cause)           ? strstr(errors, cause)
                          : strstr(errors, "the first of ") ? strstr(errors, "the first of ")
                                                            : strstr(errors, "ball 1 is said");
        wrong += !why;
        g_string_append_printf(told, "\n    %d: %s %.*s", i, why ? "refused:" : "NO CAUSE",
                               why ? (int)strcspn(why, "\n") : 0, why);
    }
    g_test_message("%u:%s%s", seed, told->str, wrong ? "   <-- FAILS" : "");
    g_rand_free(c->rand);
    g_free(c);
    return wrong;
}

TEST(right_or_refused) {
    const char *wanted = g_getenv("MESORIG_BALLS");
    const guint n = wanted ? (guint)atoi(wanted) : CASES;
    int wrong = 0;
    for (guint seed = 1; seed <= n; seed++)
        wrong += check_case(seed);
    g_test_message("no trouble: %d of %d right; some: %d of %d; (off / error bar)²: %.2f",
                   right_of[0], count_of[0], right_of[1], count_of[1], squares / n_directions);
    g_test_message("of %d directions within one error bar %d, within two %d, within three %d",
                   n_directions, n_within[0], n_within[1], n_within[2]);
    for (int k = 0; k < TROUBLES; k++)
        g_test_message("%s: %d of %d right", names[k], right_of[2 + k], count_of[2 + k]);
    g_assert_cmpint(wrong, ==, 0);
    g_assert_cmpint(right_of[0], >=, 3 * count_of[0] / 4); /* small balls are refused */
    g_assert_cmpint(right_of[1], >=, 2 * count_of[1] / 5);
}

AFTER_TESTS {
    world_fixture_clean();
}
