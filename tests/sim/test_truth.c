/* The world's own truth against closed forms: planes, a sphere, a box, a ramp. */
#include "lib/test.h"
#include "world/truth.h"

#include "lib/world_fixture.h"

#include <png.h>
#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))
#define QUIET    "[world]\nnoise=no\ngather_rays=0\n"
#define CAMERAS                                                                                    \
    "[camera a]\ntheta_deg=30\n[camera b]\ntheta_deg=75\nphi_deg=40\n[lamp l]\ntheta_deg=45\n"     \
    "[laser s]\ntheta_deg=60\n[laser t]\ntheta_deg=0\n"

static const struct truth_grid grid = {32, 32, 40, 40, 5};
#define N (32 * 32)

static void texel(int i, double p[3]) {
    p[0] = 40 * ((i % 32 + 0.5) / 32 - 0.5);
    p[1] = 40 * (0.5 - (i / 32 + 0.5) / 32);
    p[2] = 5;
}

static void ray(const double eye[3], const double p[3], double ret[3]) {
    double d[3] = {p[0] - eye[0], p[1] - eye[1], p[2] - eye[2]};
    double length = sqrt(d[0] * d[0] + d[1] * d[1] + d[2] * d[2]);
    for (int k = 0; k < 3; k++)
        ret[k] = d[k] / length;
}

TEST(view_centre) {
    g_autoptr(World) world = world_fixture_new(QUIET CAMERAS "[sample]\nkind=flat\ngrid=2\n");
    double eye[3];
    truth_view_centre_mm(world, 1, 100, eye);
    double theta = RAD(75), phi = RAD(40 - 100);
    g_assert_cmpfloat_with_epsilon(eye[0], 650 * sin(theta) * cos(phi), 1e-9);
    g_assert_cmpfloat_with_epsilon(eye[1], 650 * sin(theta) * sin(phi), 1e-9);
    g_assert_cmpfloat_with_epsilon(eye[2], 650 * cos(theta), 1e-9);
}

TEST(plane) {
    g_autoptr(World) world =
        world_fixture_new(QUIET CAMERAS "[sample]\nkind=flat\ngrid=2\nbase_mm=1.5\nwidth_mm=100\n"
                                        "height_mm=100\n");
    for (int camera = 0; camera < 2; camera++) {
        float distance[N];
        guint8 edge[N];
        double eye[3], p[3], d[3];
        truth_view_centre_mm(world, camera, 33, eye);
        truth_mdf(world, camera, 33, &grid, distance, edge);
        for (int i = 0; i < N; i++) {
            texel(i, p);
            ray(eye, p, d);
            g_assert_cmpfloat_with_epsilon(distance[i], 3.5 / -d[2], 2e-5);
            g_assert_cmpint(edge[i], ==, 0);
        }
    }
}

static char *sphere(double z, double r) {
    GString *obj = g_string_new(NULL);
    int rings = 64, around = 128;
    for (int i = 0; i <= rings; i++)
        for (int k = 0; k < around; k++) {
            double t = G_PI * i / rings, u = 2 * G_PI * k / around;
            g_string_append_printf(obj, "v %.6f %.6f %.6f\n", r * sin(t) * cos(u),
                                   r * sin(t) * sin(u), z + r * cos(t));
        }
    for (int i = 0; i < rings; i++)
        for (int k = 0; k < around; k++) {
            int a = i * around + k + 1, b = i * around + (k + 1) % around + 1;
            g_string_append_printf(obj, "f %d//1 %d//1 %d//1\nf -%d %d %d\n", a, a + around,
                                   b + around, (rings + 1) * around - a + 1, b + around, b);
        }
    return g_string_free(obj, FALSE);
}

TEST(ball) {
    g_autofree char *obj = sphere(2.4, 2.3);
    g_autofree char *path = world_fixture_write("ball.obj", obj);
    g_autoptr(World) world =
        world_fixture_new(QUIET CAMERAS "[sample]\nkind=obj\npath=ball.obj\nsmooth=yes\n");
    const struct truth_grid near = {64, 64, 10, 10, 5};
    g_autofree float *distance = g_new(float, 64 * 64);
    g_autofree guint8 *edge = g_new(guint8, 64 * 64);
    double eye[3];
    truth_view_centre_mm(world, 0, 10, eye);
    truth_mdf(world, 0, 10, &near, distance, edge);
    int on = 0, edges = 0;
    for (int i = 0; i < 64 * 64; i++) {
        double p[3] = {10 * ((i % 64 + 0.5) / 64 - 0.5), 10 * (0.5 - (i / 64 + 0.5) / 64), 5};
        double d[3], miss;
        ray(eye, p, d);
        /* Distance of a ray from p along d to a sphere around (0, 0, z), or to the turntable. */
        double q[3] = {p[0], p[1], p[2] - 2.4}, b = q[0] * d[0] + q[1] * d[1] + q[2] * d[2];
        double c = q[0] * q[0] + q[1] * q[1] + q[2] * q[2], past = c - b * b;
        miss = sqrt(past) - 2.3;
        double expected = miss < 0 ? -b - sqrt(2.3 * 2.3 - past) : p[2] / -d[2];
        if (fabs(miss) > 0.02 && miss < -0.2)
            g_assert_cmpfloat_with_epsilon(distance[i], expected, 0.01);
        if (miss > 0.02)
            g_assert_cmpfloat_with_epsilon(distance[i], expected, 1e-4);
        if (fabs(miss) > 0.6 && miss > -1.2)
            g_assert_cmpint(edge[i], ==, 0);
        on += miss < 0;
        edges += edge[i];
    }
    g_assert_cmpint(on, >, 500);
    g_assert_cmpint(edges, >, 80);
}

/* A ramp from a picture of 16 bits: white at the right, z = 1 + 3 (x/40 + 1/2). */
TEST(ramp) {
    guint16 grey[256];
    for (int i = 0; i < 256; i++)
        grey[i] = (guint16)((i + 0.5) / 256 * 65535);
    png_image image = {.version = PNG_IMAGE_VERSION, .width = 256, .height = 1};
    image.format = PNG_FORMAT_LINEAR_Y;
    g_autofree char *path = g_build_filename(world_fixture_folder(), "ramp.png", NULL);
    g_assert_true(png_image_write_to_file(&image, path, 0, grey, 0, NULL));
    g_autoptr(World) world = world_fixture_new(
        QUIET CAMERAS "[sample]\nkind=picture\npath=ramp.png\ngrid=64\nwidth_mm=40\n"
                      "height_mm=40\nbase_mm=1\nrelief_mm=3\n");
    float distance[N];
    double eye[3], p[3], d[3];
    truth_view_centre_mm(world, 0, 0, eye);
    truth_mdf(world, 0, 0, &grid, distance, NULL);
    for (int i = 0; i < N; i++) {
        texel(i, p);
        ray(eye, p, d);
        double slope = 3.0 / 40; /* 5 + t d.z = 2.5 + slope (p.x + t d.x) */
        double expected = (5 - 2.5 - slope * p[0]) / (slope * d[0] - d[2]);
        if (fabs(p[0] + expected * d[0]) < 19.7 && fabs(p[1] + expected * d[1]) < 19.9)
            g_assert_cmpfloat_with_epsilon(distance[i], expected, 0.003);
    }
}

TEST(laser_seen) {
    g_autoptr(GString) obj = g_string_new(NULL);
    world_fixture_box(obj, 0, -5, 5, -25, 25, 4);
    g_autofree char *path = world_fixture_write("box.obj", obj->str);
    g_autoptr(World) world =
        world_fixture_new(QUIET "[camera a]\ntheta_deg=0\n[laser s]\ntheta_deg=60\n"
                                "[laser t]\ntheta_deg=0\n[sample]\nkind=obj\npath=box.obj\n");
    const double arcs[] = {0, 180, 0};
    const int lasers[] = {0, 0, 1};
    guint8 seen[N];
    truth_laser_seen(world, 0, 0, &grid, arcs, lasers, 3, seen);
    double shadow = 4 * tan(RAD(60));
    for (int i = 0; i < N; i++) {
        double p[3];
        texel(i, p);
        double x = fabs(p[0]) * 650 / 645;
        if (x < 4.8 || x > 5 + shadow + 0.7)
            g_assert_cmpint(seen[i], ==, 3);
        if (x > 5.2 && x < 5 + shadow - 0.7)
            g_assert_cmpint(seen[i], ==, 2);
    }
}

TEST(reflectance) {
    g_autoptr(World) world = world_fixture_new(
        QUIET CAMERAS "[sample]\nkind=flat\ngrid=2\nbase_mm=1\nalbedo=0.6;0.4;0.2\n"
                      "width_mm=100\nheight_mm=100\n");
    g_autofree float *rgb = g_new(float, 3 * N);
    truth_btf(world, 0, 0, 20, 90, &grid, 3, rgb);
    double phi = RAD(90 - 20), eye[3], p[3], d[3];
    const double lamp[3] = {500 * sin(RAD(45)) * cos(phi), 500 * sin(RAD(45)) * sin(phi),
                            500 * cos(RAD(45))};
    truth_view_centre_mm(world, 0, 20, eye);
    for (int i = 0; i < N; i++) {
        texel(i, p);
        ray(eye, p, d);
        double value[2], cosine = 0; /* I cos²/r² at the surface and at the texel */
        for (int k = 0; k < 2; k++) {
            double t = k ? 0 : 4 / -d[2], r2 = 0, aim = 0;
            for (int c = 0; c < 3; c++) {
                double way = lamp[c] - p[c] - t * d[c];
                r2 += way * way;
                aim += way * lamp[c] / 500;
            }
            value[k] = aim * aim / (r2 * r2);
            cosine = k ? cosine : (lamp[2] - 1) / sqrt(r2);
        }
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(rgb[3 * i + c],
                                           0.2 * (3 - c) * cosine * value[0] / value[1], 2e-4);
    }
}

/* Every kind of sample stays below the reference plane, and reflects no more than it gets. */
TEST(all_kinds) {
    const char *kinds[] = {"weave", "brushed", "brick",    "peanuts", "ridges",
                           "flat",  "grass",   "bluepipe", "block",   "mail"};
    for (gsize k = 0; k < G_N_ELEMENTS(kinds); k++) {
        g_autofree char *text =
            g_strdup_printf("[world]\nnoise=no\ngather_rays=4\n" CAMERAS
                            "[sample]\nkind=%s\nrelief_mm=3.2\nbase_mm=0.8\nwidth_mm=25\n"
                            "height_mm=25\ngrid=60\nperiod_mm=6.25\n",
                            kinds[k]);
        g_autoptr(World) world = world_fixture_new(text);
        const struct truth_grid small = {24, 24, 24, 24, 5};
        float distance[24 * 24], rgb[3 * 24 * 24];
        truth_mdf(world, 0, 0, &small, distance, NULL);
        truth_btf(world, 0, 0, 0, 180, &small, 1, rgb);
        double sum = 0, deepest = 0;
        for (int i = 0; i < 24 * 24; i++) {
            g_assert_true(distance[i] > 0 && distance[i] < 6);
            deepest = MAX(deepest, (double)distance[i]);
            for (int c = 0; c < 3; c++) {
                g_assert_true(isfinite(rgb[3 * i + c]) && rgb[3 * i + c] >= 0);
                sum += rgb[3 * i + c] / (3 * 24 * 24);
            }
        }
        g_assert_cmpfloat(deepest, >, 1);
        g_assert_cmpfloat(sum, >, 0.02);
        g_assert_cmpfloat(sum, <, 1.5);
    }
}

/* The surfaces that an upright line through (x, y) meets. */
struct upright {
    double top_mm;
    gboolean top_faces_up;
    int n_down; /* faces that look down */
};

static struct upright upright_at(const struct truth_surface *s, double x, double y) {
    struct upright ret = {-1, FALSE, 0};
    for (guint k = 0; k < s->n_triangles; k++) {
        const float *p[3];
        double weight[3], sum = 0, z = 0;
        for (int c = 0; c < 3; c++)
            p[c] = s->vertices + (gsize)s->stride * s->triangles[3 * (gsize)k + c];
        for (int c = 0; c < 3; c++) {
            const float *a = p[(c + 1) % 3], *b = p[(c + 2) % 3];
            weight[c] = (a[0] - x) * (b[1] - y) - (a[1] - y) * (b[0] - x);
            sum += weight[c];
        }
        if (!((weight[0] > 0 && weight[1] > 0 && weight[2] > 0) ||
              (weight[0] < 0 && weight[1] < 0 && weight[2] < 0)))
            continue;
        for (int c = 0; c < 3; c++)
            z += weight[c] / sum * p[c][2];
        ret.n_down += sum < 0;
        if (z > ret.top_mm) {
            ret.top_mm = z;
            ret.top_faces_up = sum > 0;
        }
    }
    return ret;
}

#define LINES 300

/* From above only outer faces are seen. Blades and pipes overhang, blocks and reliefs do not;
 * pieces that repeat are alike, across the seams between them as well. */
TEST(overhangs) {
    static const struct {
        const char *kind;
        double least, most; /* lines that meet a face from below, of all */
    } kinds[] = {
        {"brick", 0, 0},
        {"ridges", 0, 0},
        {"block", 0, 0},
        {"grass", 0.5, 0.98},
        /* 1 − (1 − 2 r / period)²: 0.84 for the radius r of a pipe, 0.92 for that of its sleeves */
        {"bluepipe", 0.82, 0.92},
        {"mail", 0.45, 0.65}};
    for (gsize k = 0; k < G_N_ELEMENTS(kinds); k++) {
        g_autofree char *text =
            g_strdup_printf("[world]\nnoise=no\ngather_rays=0\n" CAMERAS
                            "[sample]\nkind=%s\nrelief_mm=6\nbase_mm=0.8\nwidth_mm=40\n"
                            "height_mm=40\ntop_mm=7\ngrid=64\nperiod_mm=4\nrepeats=2\n",
                            kinds[k].kind);
        g_autoptr(World) world = world_fixture_new(text);
        struct truth_surface surface;
        truth_surface(world, &surface);
        int down = 0, unlike = 0;
        for (int i = 0; i < LINES; i++) {
            /* Points of a lattice that no grid of the samples has; some cross the seams. */
            double x = -18 + 14 * fmod((i + 1) * 0.754877666, 1),
                   y = -18 + 14 * fmod((i + 1) * 0.569840296, 1);
            struct upright at = upright_at(&surface, x, y);
            struct upright next = upright_at(&surface, x + 20, y + 20);
            if (!(at.top_mm > 0.7 && at.top_mm < 7 && at.top_faces_up))
                g_error("%s at %.2f, %.2f: top %.3f mm, %s", kinds[k].kind, x, y, at.top_mm,
                        at.top_faces_up ? "upwards" : "downwards");
            down += at.n_down > 0;
            unlike += fabs(at.top_mm - next.top_mm) > 2e-3;
        }
        double share = (double)down / LINES;
        g_test_message("%s: %.3f overhang, %d unlike", kinds[k].kind, share, unlike);
        g_assert_cmpfloat(share, >=, kinds[k].least);
        g_assert_cmpfloat(share, <=, kinds[k].most);
        g_assert_cmpint(unlike, <=, LINES / 100); /* lines that just pass an edge */
    }
}

/* A lamp on a crooked arc goes round the arc's own axis, from where its zero is. */
TEST(crooked_arc) {
    g_autoptr(World) world = world_fixture_new(
        "[world]\nnoise=no\ngather_rays=0\nseed=5\narc_zero_error_deg=0.5\n"
        "arc_tilt_error_deg=1\narc_error_mm=2\n" CAMERAS "[sample]\nkind=flat\ngrid=2\n");
    struct truth_arc arc;
    truth_arc(world, &arc);
    g_assert_cmpfloat(fabs(arc.zero_deg), >, 1e-3);
    g_assert_cmpfloat(arc.axis[2], <, 1 - 1e-6);
    double first[3], p[3], up0 = 0, turned = 0;
    truth_lamp(world, 0, 0, first, NULL);
    for (int k = 0; k < 3; k++)
        up0 += (first[k] - arc.centre_mm[k]) * arc.axis[k];
    g_assert_cmpfloat_with_epsilon(up0, 500 * cos(RAD(45)), 1e-9);
    for (int deg = 0; deg < 360; deg += 30) {
        double up = 0, radius2 = 0;
        truth_lamp(world, 0, deg, p, NULL);
        for (int k = 0; k < 3; k++)
            up += (p[k] - arc.centre_mm[k]) * arc.axis[k];
        for (int k = 0; k < 3; k++)
            radius2 += pow(p[k] - arc.centre_mm[k] - up * arc.axis[k], 2);
        g_assert_cmpfloat_with_epsilon(up, up0, 1e-9);
        g_assert_cmpfloat_with_epsilon(sqrt(radius2), 500 * sin(RAD(45)), 1e-9);
        double azimuth = atan2(p[1] - arc.centre_mm[1], p[0] - arc.centre_mm[0]);
        turned += remainder(azimuth - RAD(deg) - RAD(arc.zero_deg), 2 * G_PI);
    }
    /* A lean shows in azimuth twice a turn, to second order: its mean is the zero. */
    g_assert_cmpfloat(fabs(turned / 12), <, 3e-3);
}

/* The shadow of a post's top ends where the ray from the lamp over it comes down, also where the
 * arc is crooked; a picture shows it there. */
TEST(shadow_of_a_post) {
    g_autoptr(World) world = world_fixture_new(
        "[world]\nnoise=no\ngather_rays=0\nseed=5\narc_tilt_error_deg=1\narc_error_mm=2\n"
        "[camera a]\ntheta_deg=0\nwidth=401\nheight=401\nfocal_px=3250\ncfa=mono\n"
        "[lamp l]\ntheta_deg=45\n"
        "[sample]\nkind=poles\nwidth_mm=70\nheight_mm=70\ntop_mm=30\nbase_mm=1\n"
        "places_mm=5;3;15\nradius_mm=1\n");
    for (int turn = 0; turn < 360; turn += 90) {
        double l[3], top[3] = {0, 0, 16}, c = cos(RAD(turn)), s = sin(RAD(turn));
        top[0] = 5 * c - 3 * s;
        top[1] = 5 * s + 3 * c;
        truth_lamp(world, 0, 40, l, NULL);
        double t = 15 / (l[2] - 16), x = top[0] + t * (top[0] - l[0]),
               y = top[1] + t * (top[1] - l[1]);
        struct world_state state = {.turntable_deg = turn, .arc_deg = 40, .lamp_output = {1}};
        g_autofree guint16 *pixels = g_new(guint16, 401 * 401);
        world_expose(world, 0, &state, 2000, 0, 1, pixels);
        double away = hypot(x - top[0], y - top[1]), scale = 3250.0 / 649;
        for (int side = -1; side <= 1; side += 2) { /* its round end has 1 mm of radius, and some */
            double d = side * 0.2 + 1 + 15.0 / (l[2] - 16);
            double u = x + d * (x - top[0]) / away, v = y + d * (y - top[1]) / away;
            /* From above right is +y: what a camera at azimuth 0 tends to. */
            int column = (int)lround(200 + scale * v), row = (int)lround(200 + scale * u);
            int lit = pixels[row * 401 + column];
            g_assert_cmpint(lit > 200, ==, side > 0);
        }
    }
}

AFTER_TESTS {
    world_fixture_clean();
}
