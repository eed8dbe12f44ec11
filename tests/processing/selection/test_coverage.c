/* The coverage of a view by laser sweeps: for a plane whose peaks are computed here, with gaps and
 * with reflections. Also the model of what another sweep adds. */
#include "selection/coverage_view.h"

#include <glib/gstdio.h>
#include <math.h>

#include "frames/rectify.h"
#include "lib/ok.h"
#include "lib/remove_tree.h"
#include "lib/test.h"

#define RAD(deg)  ((deg) * (G_PI / 180))
#define PIXELS    64
#define N_LASERS  3
#define STEPS     60
#define DEEP_MM   1.5 /* the plane, below the reference plane */
#define FALSE_DEG 1.0 /* what a reflection is off by */

static const struct session_grid grid = {24, 24, 40, 40, 5, 5};

static void scene_new(struct rig *rig) {
    static const double thetas_deg[N_LASERS] = {30, 45, 60};
    *rig = (struct rig){.n_cameras = 1, .n_lasers = N_LASERS};
    rig->cameras[0] = (struct rig_camera){.width = PIXELS,
                                          .height = PIXELS,
                                          .fx_px = 600,
                                          .fy_px = 600,
                                          .cx_px = (PIXELS - 1) / 2.0,
                                          .cy_px = (PIXELS - 1) / 2.0};
    rig_camera_look_at(&rig->cameras[0], vec3_scale(rig_direction(RAD(20), 0), 650), vec3(0, 0, 0));
    for (int i = 0; i < N_LASERS; i++) {
        const struct vec3 out = rig_direction(RAD(thetas_deg[i]), G_PI);
        rig->lasers[i] =
            (struct rig_laser){.position_mm = vec3_scale(out, 480),
                               .axis = vec3(0, 1, 0),
                               .normal = vec3_cross(vec3(0, 1, 0), vec3_scale(out, -1)),
                               .fixed = 1};
    }
}

static struct session_shot sweep_of(int laser) {
    return (struct session_shot){.id = laser + 1,
                                 .kind = SHOT_SWEEP,
                                 .source = laser,
                                 .device = laser,
                                 .cameras = {{1}},
                                 .sweep_from_deg = -6,
                                 .sweep_to_deg = 6,
                                 .sweep_steps = STEPS};
}

enum told { TOLD_TRUE, TOLD_NOTHING, TOLD_FALSE };

/* The peaks of a plane: pixel by pixel, its ray's point on the plane, and the sweep angle at which
 * the sheet goes through it. of: what each column of the picture is told. */
static char *write_sweep(const char *folder, const struct rig *rig, int laser,
                         enum told (*of)(int column)) {
    static const char *const channels[] = {"intensity",   "peak",  "second_intensity",
                                           "second_peak", "width", NULL};
    const struct session_shot shot = sweep_of(laser);
    struct exr_part *part = exr_part_new("sweep", PIXELS, PIXELS, channels, EXR_FLOAT);
    const struct vec3 eye = rig_camera_centre_mm(&rig->cameras[0]);
    for (int i = 0; i < PIXELS * PIXELS; i++) {
        const struct vec3 ray = rig_pixel_ray(&rig->cameras[0], i % PIXELS, i / PIXELS);
        const double range = (grid.reference_mm - DEEP_MM - eye.z) / ray.z;
        const struct vec3 p = vec3_add(eye, vec3_scale(ray, range));
        const double deg = rig_laser_sweep_rad(&rig->arc, &rig->lasers[laser], 0, p) * 180 / G_PI;
        const enum told told = of(i % PIXELS);
        const double at = deg + (told == TOLD_FALSE ? FALSE_DEG : 0);
        const double peak =
            (at - shot.sweep_from_deg) / (shot.sweep_to_deg - shot.sweep_from_deg) * (STEPS - 1);
        exr_part_plane(part, "peak")[i] = told == TOLD_NOTHING ? -1 : (float)peak;
        exr_part_plane(part, "second_peak")[i] = -1;
    }
    struct exr_file *file = exr_file_new();
    exr_file_add(file, part);
    char *path = g_strdup_printf("%s/%d.exr", folder, laser);
    g_assert_true(ok(exr_write(path, file, EXR_NONE, FALSE, ERR)));
    exr_file_free(file);
    return path;
}

static void add_sweep(CoverageView *view, const char *folder, const struct rig *rig, int laser,
                      enum told (*of)(int column)) {
    const struct session_shot shot = sweep_of(laser);
    struct input input = {.path = write_sweep(folder, rig, laser, of),
                          .shot = shot.id,
                          .width = PIXELS,
                          .height = PIXELS};
    g_assert_true(ok(coverage_view_add(view, laser, &shot, &input, ERR)));
    g_unlink(input.path);
    input_clear(&input);
}

static enum told everywhere(int column) {
    return TOLD_TRUE;
}
static enum told left_half(int column) {
    return column < PIXELS / 2 ? TOLD_TRUE : TOLD_NOTHING;
}
static enum told wrong_on_the_left(int column) {
    return column < PIXELS / 2 ? TOLD_FALSE : TOLD_TRUE;
}

static double known_part(CoverageView *view) {
    const struct coverage_sums sums = coverage_view_sum_up(view);
    g_assert_cmpint(sums.texels, ==, grid.width * grid.height);
    return (double)sums.known / sums.texels;
}

struct case_of {
    enum told (*of[N_LASERS])(int column); /* NULL: not taken */
    double known;
};

TEST(plane) {
    static const struct case_of cases[] = {
        {{everywhere}, 0}, /* one alone is not believed */
        {{everywhere, everywhere}, 1},
        {{everywhere, left_half}, 0.5},                   /* two agree on the left alone */
        {{everywhere, wrong_on_the_left}, 0.5},           /* on the left they contradict */
        {{everywhere, wrong_on_the_left, everywhere}, 1}, /* two of three agree */
        {{everywhere, left_half, left_half}, 0.5},
    };
    TEMPORARY_FOLDER(folder);
    struct rig rig;
    scene_new(&rig);
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++) {
        g_autoptr(CoverageView) view = coverage_view_new(&rig, 0, 0, &grid);
        for (int i = 0; i < N_LASERS; i++)
            if (cases[k].of[i])
                add_sweep(view, folder, &rig, i, cases[k].of[i]);
        g_assert_cmpfloat_with_epsilon(known_part(view), cases[k].known, 0.06);
    }
}

/* A file that is not there, or not of the camera's size, is an error. */
TEST(files) {
    g_autoptr(GError) error = NULL;
    TEMPORARY_FOLDER(folder);
    struct rig rig;
    scene_new(&rig);
    g_autoptr(CoverageView) view = coverage_view_new(&rig, 0, 0, &grid);
    const struct session_shot shot = sweep_of(0);
    struct input input = {.path = write_sweep(folder, &rig, 0, everywhere),
                          .shot = 1,
                          .width = PIXELS / 2,
                          .height = PIXELS};
    g_assert_false(coverage_view_add(view, 0, &shot, &input, &error));
    g_assert_nonnull(error);
    g_clear_error(&error);
    g_unlink(input.path);
    input.width = PIXELS;
    g_assert_false(coverage_view_add(view, 0, &shot, &input, &error));
    g_assert_nonnull(error);
    /* Nothing of them counts: one good sweep is not believed. */
    add_sweep(view, folder, &rig, 1, everywhere);
    g_assert_cmpfloat(known_part(view), ==, 0);
    input_clear(&input);
}

/* A light where the camera stands reaches whatever the camera sees. What a sweep adds shrinks with
 * those taken before it; one that has seen nothing makes another one from the same side unlikely to
 * see something, and from the other side likely. */
TEST(model) {
    const struct vec3 camera = rig_direction(RAD(45), 0);
    const struct vec3 lasers[] = {camera, rig_direction(RAD(60), G_PI),
                                  rig_direction(RAD(55), G_PI), rig_direction(RAD(30), 0)};
    const double quality[] = {0, 1, 1, 0.5};
    g_autoptr(CoverageModel) model = coverage_model_new(camera, lasers, quality, 4);
    g_assert_cmpfloat(coverage_model_lights(model, 0, 0, 0), ==, 1);
    double before = 1;
    const guint64 sets[] = {0, 1 << 3, 1 << 3 | 1 << 2, 1 << 3 | 1 << 2 | 1};
    for (gsize i = 0; i < G_N_ELEMENTS(sets); i++) {
        const double adds = coverage_model_adds(model, sets[i], 1);
        g_assert_cmpfloat(adds, >, 0);
        g_assert_cmpfloat(adds, <, before);
        before = adds;
    }
    const double first = coverage_model_lights(model, 0, 0, 2);
    const double after_dark = coverage_model_lights(model, 1 << 1, 0, 2);
    const double after_light = coverage_model_lights(model, 1 << 1, 1 << 1, 2);
    g_assert_cmpfloat(after_dark, <, 0.5 * first);
    g_assert_cmpfloat(after_light, >, first);
    g_assert_cmpfloat(coverage_model_lights(model, 1 << 1, 0, 3), >, 2 * after_dark);
}

/* What is expected of a sweep: nothing where all is known; of half a picture that one sweep has
 * seen and another one not, no more than that half. */
TEST(expectation) {
    TEMPORARY_FOLDER(folder);
    struct rig rig;
    scene_new(&rig);
    struct vec3 lasers[N_LASERS];
    const double quality[N_LASERS] = {1, 1, 1};
    for (int i = 0; i < N_LASERS; i++)
        lasers[i] = vec3_unit(rig.lasers[i].position_mm);
    g_autoptr(CoverageModel) model =
        coverage_model_new(rig_direction(RAD(20), 0), lasers, quality, N_LASERS);
    g_autoptr(CoverageView) known = coverage_view_new(&rig, 0, 0, &grid);
    add_sweep(known, folder, &rig, 0, everywhere);
    add_sweep(known, folder, &rig, 1, everywhere);
    g_assert_cmpfloat(known_part(known), ==, 1);
    g_assert_cmpfloat(coverage_view_expects(known, model, 2), ==, 0);
    g_autoptr(CoverageView) half = coverage_view_new(&rig, 0, 0, &grid);
    add_sweep(half, folder, &rig, 0, everywhere);
    add_sweep(half, folder, &rig, 1, left_half);
    const double open = 1 - known_part(half), expects = coverage_view_expects(half, model, 2);
    g_assert_cmpfloat(expects, >, 0.1 * open);
    g_assert_cmpfloat(expects, <=, open);
}
