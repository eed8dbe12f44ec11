/* Prediction along reliefs that formulas describe, painted with a smooth texture: the true distance
 * and colour of every texel of every view are known. */
#include "base/data_error.h"
#include "lib/ok.h"
#include "lib/test.h"
#include "mdf/reprojection.h"

#include "exr/exr.h"
#include "lib/remove_tree.h"
#include "pipeline/along_surface.h"
#include "session/session.h"

#include <glib/gstdio.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define SIDE     48
#define N_TEXELS (SIDE * SIDE)
#define DEGREE   (G_PI / 180)

static const struct mdf_plane plane = {SIDE, SIDE, 0.5, 5};

/* Height of the relief over x, y; below the reference plane. */
typedef double (*Relief)(double x, double y);

/* A plane that rises by 0.3 mm a millimetre, wholly below the reference plane. */
static double slope(double x, double y) {
    return 1 + 0.2 * x + 0.05 * y;
}

/* A cap of a sphere of radius 8 mm, 2.5 mm high, on a ground at 2. */
static double bump(double x, double y) {
    const double rest = 64 - x * x - y * y;
    return MAX(2, rest > 0 ? sqrt(rest) - 3.5 : 2);
}

/* A hill 1.5 mm high that hides nothing from views up to 50°. */
static double hill(double x, double y) {
    return 2 + 1.5 * exp(-(x * x + y * y) / 8);
}

/* A wall 2.2 mm high at |x| < 1.5, with vertical sides. */
static double wall(double x, double y) {
    return fabs(x) < 1.5 ? 4.6 : 2.4;
}

/* The texture's waves are 7 mm long: bilinear interpolation between texels of 0.5 mm is off by at
 * most (2π/7)² 0.5²/8 of its amplitude of 0.3 in each direction, 0.015 together. */
static double painted(double x, double y, double z) {
    return 0.5 + 0.15 * sin(2 * G_PI / 7 * x + 0.9 * z) + 0.15 * cos(2 * G_PI / 7 * y);
}

/* The distance along the ray from the reference plane, by small steps and halving; −1: none. */
static double reprojection_test_march(Relief relief, const double at_mm[2], struct vec3 v) {
    const double step = 0.01;
    double low = 0, high = -1;
    for (double t = step; t < 40 && high < 0; t += step) {
        const double z = plane.reference_mm - t * v.z;
        if (z <= relief(at_mm[0] - t * v.x, at_mm[1] - t * v.y))
            high = t;
        else
            low = t;
    }
    for (int k = 0; k < 30 && high > 0; k++) {
        const double t = 0.5 * (low + high), z = plane.reference_mm - t * v.z;
        if (z <= relief(at_mm[0] - t * v.x, at_mm[1] - t * v.y))
            high = t;
        else
            low = t;
    }
    return high;
}

static double colour_at(const double at_mm[2], struct vec3 v, double mm) {
    return painted(at_mm[0] - v.x * mm, at_mm[1] - v.y * mm, plane.reference_mm - v.z * mm);
}

#define MOST 16
struct scene {
    int n;
    struct reprojection_view views[MOST];
    float distance[MOST][N_TEXELS], colour[MOST][N_TEXELS];
    Reprojection *reprojection;
};

static struct vec3 reprojection_test_direction(double theta_deg, double phi_deg) {
    return vec3(sin(theta_deg * DEGREE) * cos(phi_deg * DEGREE),
                sin(theta_deg * DEGREE) * sin(phi_deg * DEGREE), cos(theta_deg * DEGREE));
}

static struct scene *reprojection_test_scene(Relief relief, const double (*deg)[2], int n) {
    struct scene *scene = g_new0(struct scene, 1);
    scene->n = n;
    for (int k = 0; k < n; k++) {
        const struct vec3 v = reprojection_test_direction(deg[k][0], deg[k][1]);
        struct reprojection_view *view = &scene->views[k];
        *view = (struct reprojection_view){
            {600 * v.x, 600 * v.y, plane.reference_mm + 600 * v.z}, scene->distance[k], NULL};
        for (int i = 0; i < N_TEXELS; i++) {
            const int column = i % SIDE, row = i / SIDE;
            const double at_mm[2] = {(column + 0.5 - SIDE / 2.0) * plane.texel_mm,
                                     (SIDE / 2.0 - row - 0.5) * plane.texel_mm};
            const struct vec3 to =
                vec3_unit(vec3(view->centre_mm[0] - at_mm[0], view->centre_mm[1] - at_mm[1],
                               view->centre_mm[2] - plane.reference_mm));
            const double mm = reprojection_test_march(relief, at_mm, to);
            scene->distance[k][i] = (float)mm;
            scene->colour[k][i] = (float)colour_at(at_mm, to, mm);
        }
    }
    scene->reprojection = ok(reprojection_new(&plane, scene->views, n, FALSE, ERR));
    return scene;
}

static void reprojection_test_free(struct scene *scene) {
    reprojection_free(scene->reprojection);
    g_free(scene);
}

static double predict(const struct scene *scene, const double at_mm[2], struct vec3 v,
                      struct reprojection_hit *ret) {
    struct reprojection_tap taps[REPROJECTION_MAX_TAPS];
    const int n = reprojection_taps(scene->reprojection, at_mm, v, ret, taps);
    double sum = 0, weight = 0;
    for (int k = 0; k < n; k++) {
        sum += (double)(taps[k].weight * scene->colour[taps[k].view][taps[k].texel]);
        weight += (double)taps[k].weight;
    }
    g_assert_cmpfloat_with_epsilon(weight, 1, 1e-4);
    return sum;
}

struct errors {
    double mm, colour, mixed; /* RMS */
    int n, unseen;
};

/* Texels of the inner area, which all views see entirely. */
static struct errors reprojection_test_errors(const struct scene *scene, Relief relief,
                                              double theta_deg, double phi_deg) {
    const struct vec3 v = reprojection_test_direction(theta_deg, phi_deg);
    struct errors errors = {0};
    for (int i = 0; i < N_TEXELS; i++) {
        double at_mm[2];
        reprojection_texel_mm(scene->reprojection, i, at_mm);
        if (fabs(at_mm[0]) > 5 || fabs(at_mm[1]) > 5)
            continue;
        struct reprojection_hit hit;
        struct reprojection_weights weights;
        const double true_mm = reprojection_test_march(relief, at_mm, v);
        const double truth = colour_at(at_mm, v, true_mm);
        const double made = predict(scene, at_mm, v, &hit);
        double mixed = 0;
        reprojection_weigh(scene->reprojection, at_mm, v, &weights);
        for (int k = 0; k < weights.n; k++)
            mixed += (double)(weights.flat[k] * scene->colour[weights.view[k]][i]);
        errors.n++;
        errors.unseen += !hit.seen;
        errors.mm += (hit.mm - true_mm) * (hit.mm - true_mm);
        errors.colour += (made - truth) * (made - truth);
        errors.mixed += (mixed - truth) * (mixed - truth);
    }
    errors.mm = sqrt(errors.mm / errors.n);
    errors.colour = sqrt(errors.colour / errors.n);
    errors.mixed = sqrt(errors.mixed / errors.n);
    return errors;
}

static const struct work quiet = {.n_threads = 2};

#define N_THREE 3
static const double three[N_THREE][2] = {{40, 0}, {40, 120}, {40, 240}};
static const double ten[][2] = {{0, 0},   {30, 0},   {30, 120}, {30, 240}, {60, 0},
                                {60, 60}, {60, 120}, {60, 180}, {60, 240}, {60, 300}};

static const double low[][2] = {{0, 0},   {30, 0},   {30, 120}, {30, 240}, {50, 0},
                                {50, 60}, {50, 120}, {50, 180}, {50, 240}, {50, 300}};

/* Between three views, near one of them, and outside of them. */
TEST(smooth) {
    static const struct {
        Relief relief;
        double theta_deg, phi_deg;
    } cases[] = {{slope, 0, 0}, {slope, 25, 70}, {slope, 55, 20},
                 {bump, 0, 0},  {bump, 20, 180}, {bump, 39, 1}};
    for (guint k = 0; k < G_N_ELEMENTS(cases); k++) {
        struct scene *scene = reprojection_test_scene(cases[k].relief, three, 3);
        const struct errors errors =
            reprojection_test_errors(scene, cases[k].relief, cases[k].theta_deg, cases[k].phi_deg);
        g_test_message("case %u: %.4f mm, colour %.4f, mixed %.4f, unseen %d of %d", k, errors.mm,
                       errors.colour, errors.mixed, errors.unseen, errors.n);
        g_assert_cmpint(errors.unseen, ==, 0);
        g_assert_cmpfloat(errors.mm, <, (k < 3 ? 0.01 : 0.15) * plane.texel_mm);
        g_assert_cmpfloat(errors.colour, <, 0.015);
        if (k != 5) /* which is almost a measured view */
            g_assert_cmpfloat(errors.mixed, >, 4 * errors.colour);
        reprojection_test_free(scene);
    }
}

/* A wall hides ground from some views: the others count there, and nothing is bridged. */
TEST(hidden) {
    struct scene *scene = reprojection_test_scene(wall, ten, 10);
    const struct errors errors = reprojection_test_errors(scene, wall, 42, 25);
    g_test_message("%.4f mm, colour %.4f, mixed %.4f, unseen %d of %d", errors.mm, errors.colour,
                   errors.mixed, errors.unseen, errors.n);
    g_assert_cmpint(errors.unseen, <, errors.n / 20);
    g_assert_cmpfloat(errors.colour, <, 0.5 * errors.mixed);
    reprojection_test_free(scene);
}

/* In a measured direction, a view's own picture. */
TEST(measured) {
    struct scene *scene = reprojection_test_scene(bump, ten, 10);
    for (int view = 0; view < scene->n; view += 3)
        for (int i = 0; i < N_TEXELS; i += 7) {
            const double *c = scene->views[view].centre_mm;
            struct reprojection_hit hit;
            double at_mm[2];
            reprojection_texel_mm(scene->reprojection, i, at_mm);
            const struct vec3 towards =
                vec3_unit(vec3(c[0] - at_mm[0], c[1] - at_mm[1], c[2] - plane.reference_mm));
            const double made = predict(scene, at_mm, towards, &hit);
            g_assert_true(hit.seen);
            g_assert_cmpfloat(fabs(made - (double)scene->colour[view][i]), <, 0.01);
            g_assert_cmpfloat(fabs(hit.mm - (double)scene->distance[view][i]), <, 0.05);
        }
    reprojection_test_free(scene);
}

/* A small turn changes little: no seam where the triangle of views changes. Half a degree of
 * azimuth moves the surface point by 3 mm · tan 40° · 0.0087 at most, and its colour by 0.3 · 2π /
 * 7 mm of that: 0.007; the bound is twice as much. */
TEST(continuous) {
    struct scene *scene = reprojection_test_scene(hill, low, 10);
    for (int i = 0; i < 40; i++) {
        const double at_mm[2] = {-4 + 0.2 * i, 1.3};
        struct reprojection_hit hit;
        double before = 0;
        for (int k = 0; k <= 720; k++) {
            const double made =
                predict(scene, at_mm, reprojection_test_direction(40, 0.5 * k), &hit);
            if (k > 0)
                g_assert_cmpfloat(fabs(made - before), <, 0.014);
            before = made;
        }
    }
    reprojection_test_free(scene);
}

/* Values of unknown texels are not used; where nothing is known, texels are mixed and the hit says
 * so. */
TEST(unknown) {
    struct scene *scene = reprojection_test_scene(slope, three, 3);
    struct reprojection_hit hit;
    g_autoptr(GError) error = NULL;
    for (int k = 0; k < 3; k++)
        for (int i = 0; i < N_TEXELS; i++)
            if (i % SIDE < SIDE / 2) {
                scene->distance[k][i] = -1;
                scene->colour[k][i] = k < 2 ? 9 : 3;
            }
    g_autoptr(Reprojection) half = reprojection_new(&plane, scene->views, 3, FALSE, &error);
    g_assert_no_error(error);
    reprojection_free(scene->reprojection);
    scene->reprojection = g_steal_pointer(&half);
    const double known[2] = {7, 0}, unknown[2] = {-10, 0};
    const struct vec3 up = vec3(0, 0, 1);
    g_assert_cmpfloat(predict(scene, known, up, &hit), <, 1);
    g_assert_true(hit.seen);
    g_assert_cmpfloat_with_epsilon(predict(scene, unknown, up, &hit), 7, 0.1);
    g_assert_false(hit.seen);
    g_assert_cmpfloat(hit.mm, ==, -1);
    reprojection_test_free(scene);
}

/* As processing writes it, the views in another order than that of their numbers. */
static void reprojection_test_write_mdf(const struct scene *scene, const char *path) {
    static const char *const channels[] = {"D", "S", NULL};
    g_autoptr(ExrFile) file = exr_file_new();
    for (int k = N_THREE - 1; k >= 0; k--) {
        g_autofree char *name = g_strdup_printf("view_%04d", k);
        struct exr_part *part = exr_part_new(name, SIDE, SIDE, channels, EXR_FLOAT);
        const double *c = scene->views[k].centre_mm;
        memcpy(part->planes[0], scene->distance[k], sizeof scene->distance[k]);
        exr_set_double(part, "view.theta_deg", three[k][0]);
        exr_set_double(part, "view.phi_deg", three[k][1]);
        exr_set_v3d(part, "view.centre_mm", c[0], c[1], c[2]);
        exr_set_double(part, "texel_mm", plane.texel_mm);
        exr_set_double(part, "reference_mm", plane.reference_mm);
        exr_file_add(file, part);
    }
    ok(exr_write(path, file, EXR_PIZ, FALSE, ERR));
}

TEST(read) {
    struct scene *scene = reprojection_test_scene(slope, three, 3);
    TEMPORARY_FOLDER(folder);
    g_autofree char *path = g_build_filename(folder, "mdf.exr", NULL);
    g_autoptr(GError) error = NULL;
    reprojection_test_write_mdf(scene, path);
    const float theta_deg[] = {40, 40, 40}, phi_deg[] = {0, 120, 240};
    g_autoptr(Reprojection) read = reprojection_read(path, theta_deg, phi_deg, 3, FALSE, &error);
    g_assert_no_error(error);
    for (int i = 0; i < N_TEXELS; i += 11) {
        struct reprojection_hit hit, again;
        struct reprojection_tap taps[REPROJECTION_MAX_TAPS];
        double at_mm[2];
        reprojection_texel_mm(read, i, at_mm);
        reprojection_taps(scene->reprojection, at_mm, vec3(0, 0, 1), &hit, taps);
        reprojection_taps(read, at_mm, vec3(0, 0, 1), &again, taps);
        g_assert_cmpfloat_with_epsilon(hit.mm, again.mm, 1e-6);
    }
    /* A direction without an MDF has no say, and without any there is nothing to move along. */
    const float other_deg[] = {10};
    g_assert_null(reprojection_read(path, other_deg, phi_deg, 1, FALSE, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_clear_error(&error);
    g_assert_true(g_file_set_contents(path, "no EXR", -1, NULL));
    g_assert_null(reprojection_read(path, theta_deg, phi_deg, 3, FALSE, &error));
    g_assert_nonnull(error);
    g_remove(path);
    reprojection_test_free(scene);
}

/* A session of the scene under two lights, the second at half the output of the first. */
static char *reprojection_test_session(const struct scene *scene, const char *folder) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    static const struct session_direction lights[] = {
        {.index = 0, .theta_deg = 30}, {.index = 1, .theta_deg = 30, .phi_deg = 180}};
    const struct session_texts texts = {"", "", "", NULL};
    struct session_direction views[N_THREE] = {0};
    for (int k = 0; k < N_THREE; k++)
        views[k] = (struct session_direction){
            .index = k, .theta_deg = three[k][0], .phi_deg = three[k][1]};
    const double side_mm = SIDE * plane.texel_mm, level_mm = plane.reference_mm;
    const struct session_plan plan = {.grid = {SIDE, SIDE, side_mm, side_mm, level_mm, level_mm},
                                      .views = views,
                                      .n_views = N_THREE,
                                      .lights = lights,
                                      .n_lights = 2};
    char *path = g_build_filename(folder, "a.session", NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_create(path, "a", &texts, &plan, &error);
    g_assert_no_error(error);
    for (int k = 0; k < N_THREE; k++) {
        g_autoptr(ExrFile) file = exr_file_new();
        g_autofree char *relative = g_strdup_printf("products/btf/view_%04d.exr", k);
        g_autofree char *to = session_file(session, relative);
        for (int light = 0; light < 2; light++) {
            g_autofree char *name = g_strdup_printf("light_%04d", light);
            struct exr_part *part = exr_part_new(name, SIDE, SIDE, channels, EXR_FLOAT);
            for (int i = 0; i < 3 * N_TEXELS; i++)
                part->planes[i / N_TEXELS][i % N_TEXELS] =
                    scene->colour[k][i % N_TEXELS] / (float)(1 + light);
            exr_set_double(part, "view.theta_deg", three[k][0]);
            exr_set_double(part, "view.phi_deg", three[k][1]);
            exr_set_double(part, "light.theta_deg", 30);
            exr_set_double(part, "light.phi_deg", 180.0 * light);
            exr_file_add(file, part);
        }
        ok(exr_write(to, file, EXR_NONE, FALSE, ERR));
    }
    return path;
}

/* The BTF and the MDF in two new directions, from files to files. */
TEST(session) {
    static float theta_deg[] = {0, 25}, phi_deg[] = {0, 70}, light_theta = 30, light_phi = 0;
    static char name[] = "two";
    const struct btf_directions to = {name, {2, theta_deg, phi_deg}, {1, &light_theta, &light_phi}};
    struct scene *scene = reprojection_test_scene(slope, three, 3);
    TEMPORARY_FOLDER(folder);
    g_autofree char *from = reprojection_test_session(scene, folder);
    g_autofree char *mdf = g_build_filename(from, "products", "mdf.exr", NULL);
    g_autofree char *path = g_build_filename(folder, "b.session", NULL);
    g_autofree char *made_mdf = g_build_filename(path, "products", "mdf.exr", NULL);
    g_autoptr(GError) error = NULL;
    struct along_surface_result result;
    g_assert_false(along_surface_predict(from, path, &to, 0, &quiet, &result, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE); /* no MDF yet */
    g_clear_error(&error);
    reprojection_test_write_mdf(scene, mdf);
    ok(along_surface_predict(from, path, &to, 0, &quiet, &result, ERR));
    g_assert_cmpint(result.made.n_views, ==, 2);
    g_assert_cmpint(result.texels, ==, 2 * N_TEXELS);
    for (int view = 0; view < 2; view++) {
        g_autofree char *btf = g_strdup_printf("%s/products/btf/view_%04d.exr", path, view);
        g_autofree char *part_name = g_strdup_printf("view_%04d", view);
        g_autoptr(ExrPart) part = exr_read_part(btf, "light_0000", &error);
        g_assert_no_error(error);
        g_autoptr(ExrPart) depth = exr_read_part(made_mdf, part_name, &error);
        g_assert_no_error(error);
        const struct vec3 v =
            reprojection_test_direction((double)theta_deg[view], (double)phi_deg[view]);
        for (int i = 0; i < N_TEXELS; i++) {
            double at_mm[2];
            reprojection_texel_mm(scene->reprojection, i, at_mm);
            if (fabs(at_mm[0]) > 5 || fabs(at_mm[1]) > 5)
                continue;
            const double mm = reprojection_test_march(slope, at_mm, v);
            g_assert_cmpfloat(fabs((double)exr_part_plane(depth, "D")[i] - mm), <, 0.005);
            g_assert_cmpfloat(fabs((double)exr_part_plane(part, "G")[i] - colour_at(at_mm, v, mm)),
                              <, 0.006);
        }
    }
    /* It has what prediction needs, itself. */
    g_autofree char *again = g_build_filename(folder, "c.session", NULL);
    ok(along_surface_predict(path, again, NULL, 0, &quiet, &result, ERR));
    g_assert_false(along_surface_predict(from, again, &to, 0, &quiet, &result, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_EXISTS);
    reprojection_test_free(scene);
}

TEST(invalid) {
    float distance[N_TEXELS] = {0};
    const struct reprojection_view below = {{0, 0, 4}, distance, NULL};
    g_autoptr(GError) error = NULL;
    g_assert_null(reprojection_new(&plane, &below, 1, FALSE, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
    g_clear_error(&error);
    g_assert_null(reprojection_new(&plane, &below, 0, FALSE, &error));
    g_assert_error(error, DATA_ERROR, DATA_ERROR_INVALID);
}
