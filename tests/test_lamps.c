/* Lamps and the light arc from shadows of posts and highlights on balls, in simulated pictures. */
#include "lights_scene.h"

#include <string.h>

static void say(const char *what, const struct scene_errors *errors,
                const struct lamps_result *found) {
    g_test_message("%s: direction %.4f°, distance %.3f %%, zero %.4f°, axis %.4f°, χ² %.2f, %d "
                   "sights",
                   what, errors->direction_deg, 100 * errors->distance, errors->zero_deg,
                   errors->axis_deg, errors->chi2, found->n_used);
}

static void check(const struct scene *scene, const char *what, struct lamps_result *found) {
    struct scene_errors errors;
    scene_compare(scene, found, &errors);
    say(what, &errors, found);
    g_assert_cmpfloat(errors.direction_deg, <, 0.1);
    g_assert_cmpfloat(errors.distance, <, 0.015); /* bench_calibration has more pictures */
    g_assert_cmpfloat(errors.zero_deg, <, 0.02);
    g_assert_true(found->arc_known);
    g_assert_cmpfloat(errors.axis_deg, <, 0.1);
    for (int i = 0; i < SCENE_LAMPS; i++)
        g_assert_cmpint(found->sights[i], >=, 6);
    lamps_result_clear(found);
}

static void poles(void) {
    struct scene *scene = scene_of(LAMP_POLES, 1, 224, 0);
    const struct scene_poses poses = {4, 1};
    g_autoptr(GPtrArray) rejected = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct lamps_result found;
    g_assert_true(scene_measure_poles(scene, &poses, &found, rejected, &error));
    g_assert_no_error(error);
    /* From a camera over the arc's azimuth posts stand before their shadows. */
    g_assert_cmpuint(rejected->len, >, 0);
    g_assert_nonnull(strstr(rejected->pdata[0], "°: post "));
    check(scene, "poles", &found);
    scene_free(scene);
}

static void balls(void) {
    struct scene *scene = scene_of(LAMP_BALLS, 2, 256, 0);
    const struct scene_poses poses = {6, 2};
    g_autoptr(GPtrArray) rejected = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct lamps_result found;
    g_assert_true(scene_measure_balls(scene, &poses, 150, &found, rejected, &error));
    g_assert_no_error(error);
    check(scene, "balls", &found);
    scene_free(scene);
}

/* Exposed as for the plate: the highlights are cut off, and nothing may come of it. */
static void saturated_balls(void) {
    struct scene *scene = scene_of(LAMP_BALLS, 3, 256, 0);
    const struct scene_poses poses = {1, 1};
    g_autoptr(GPtrArray) rejected = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct lamps_result found;
    g_assert_false(scene_measure_balls(scene, &poses, 16000, &found, rejected, &error));
    g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES);
    g_assert_cmpuint(rejected->len, >, 20);
    for (guint i = 0; i < rejected->len; i++)
        g_assert_true(strstr(rejected->pdata[i], "is saturated where it shows the lamp") ||
                      strstr(rejected->pdata[i], "is not wholly in the picture"));
    g_assert_true(g_str_has_prefix(rejected->pdata[0], "c0, l0, 0°, 37°: ball 1 "));
    scene_free(scene);
}

/* One camera, one pose: each lamp is seen five times, along one line each. */
static void too_few(void) {
    struct scene *scene = scene_of(LAMP_BALLS, 3, 256, 0);
    struct lamp_target target;
    g_autoptr(GArray) sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    g_autoptr(GPtrArray) rejected = g_ptr_array_new_with_free_func(g_free);
    g_autoptr(GError) error = NULL;
    struct lamps_result found;
    scene_target(scene, LAMP_BALLS, &target);
    g_autoptr(Picture) picture = scene_picture(scene, 0, 2, 0, 37, 150);
    struct highlight_picture from = {picture, 0, 2, 0, 0, SCENE_RAD(37)};
    g_assert_true(highlights_measure(&scene->rig, &target, &from, 4, sights, rejected, &error));
    g_assert_cmpuint(sights->len, ==, 5);
    g_assert_false(lamps_fit(&scene->rig, &target, (struct lamp_sight *)(gpointer)sights->data, 5,
                             &found, &error));
    g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_DEGENERATE);
    g_assert_nonnull(strstr(error->message, "lamp l2: seen 5 time(s)"));
    g_clear_error(&error);
    from.camera = 1;
    scene->rig.cameras[1].width = 100;
    g_assert_false(highlights_measure(&scene->rig, &target, &from, 4, sights, rejected, &error));
    g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES);
    g_assert_nonnull(strstr(error->message, "256 × 256 pixels, and camera c1 100 × 256"));
    scene_free(scene);
}

/* A view is too narrow to say how far away anything is: it must be said, not guessed. */
static void degenerate(void) {
    struct scene *scene = scene_of(LAMP_BALLS, 3, 64, 0);
    struct lamp_target target;
    struct lamps_result found;
    g_autoptr(GError) error = NULL;
    struct lamp_sight sights[12];
    scene_target(scene, LAMP_BALLS, &target);
    struct vec3 lamp = rig_lamp_position_mm(NULL, &scene->rig.lamps[1], 0);
    for (int i = 0; i < 12; i++) { /* one ball, one pose, again and again */
        sights[i] = (struct lamp_sight){.picture = i, .lamp = 1, .mark = 4, .sigma = 0.1};
        lamp_highlight_px(&scene->rig.cameras[0], lamp_mark_mm(&target, 4, 0), 9, lamp,
                          &sights[i].x, &sights[i].y);
        sights[i].x += 0.1 * sin(i * 5);
        sights[i].y += 0.1 * cos(i * 7);
    }
    g_assert_false(lamps_fit(&scene->rig, &target, sights, 12, &found, &error));
    g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_DEGENERATE);
    g_assert_nonnull(strstr(error->message, "lamp l1: the pictures leave it open where it is"));
    g_clear_error(&error);
    g_assert_false(lamps_fit(&scene->rig, &target, sights, 0, &found, &error));
    g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES);
    scene_free(scene);
}

/* A plate without posts, and one that is not there. */
static void no_poles(void) {
    static const double far[1][3] = {{40, 40, 1}};
    const struct scene_options options = {.seed = 4,
                                          .pixels = 128,
                                          .view_mm = 80,
                                          .sample = SCENE_POLES_SAMPLE,
                                          .marks = far,
                                          .n_marks = 1,
                                          .bend = 1};
    struct scene *scene = scene_new(&options);
    struct lamp_target target;
    g_autoptr(GError) error = NULL;
    scene_target(scene, LAMP_POLES, &target);
    target.n = G_N_ELEMENTS(scene_poles);
    for (int i = 0; i < target.n; i++)
        target.marks[i] =
            (struct lamp_mark){scene_poles[i][0], scene_poles[i][1], scene_poles[i][2]};
    struct plate_map *map = plate_map_new(&scene->rig.cameras[0], &target);
    g_autoptr(ShadowView) view = shadow_view_new(&scene->rig, 0, 0, &target, map);
    for (int lamp = 0; lamp < SCENE_LAMPS; lamp++) {
        g_autoptr(Picture) picture = scene_picture(scene, 0, lamp, 0, 37, 8000);
        g_assert_true(shadow_view_add(view, picture, lamp, lamp, SCENE_RAD(37), &error));
    }
    g_assert_false(shadows_locate(&view, 1, &target, 2, SCENE_RAD(1), &error));
    g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES);
    g_assert_nonnull(strstr(error->message, "c0, l0, 0°, 37° and 4 other picture(s)"));
    g_clear_error(&error);
    g_autoptr(Picture) dark = picture_new("dark.exr", "", 128, 128);
    memset(dark->values, 0, sizeof(float) * 128 * 128);
    g_assert_false(shadow_view_add(view, dark, 9, 0, 0, &error));
    g_assert_nonnull(strstr(error->message, "dark.exr: the plate is dark"));
    plate_map_free(map);
    scene_free(scene);
}

static void target_file(void) {
    static const char good[] = "[target]\nkind=poles\nplane_mm=2\nplate_mm=80;70\nradius_mm=1\n"
                               "places_mm=1;2;10;-4.5;3;20\n";
    const struct {
        const char *from, *to, *says;
    } bad[] = {
        {"poles", "cats", "[target] kind: must be poles or balls"},
        {"20\n", "20;4\n", "places_mm: must be x;y;height"},
        {"20\n", "0\n", "places_mm: a height or radius is not above"},
        {"20\n", "nan\n", "places_mm: a number is out of range"},
        {"-4.5;3", "1;2", "places_mm: two stand in one place"},
        {"radius_mm=1", "radius_mm=0", "radius_mm: a number is out of range"},
        {"plate_mm=80;70\n", "", "[target] plate_mm: "},
        {"kind", "sort=x\nkind", "[target] sort: is not known"},
        {"[target]", "[other]", "[target] kind: must be"},
        {"[target]\n", "", "not a target's description"},
    };
    struct lamp_target target;
    g_autoptr(GError) error = NULL;
    g_autofree char *path = fixture_write("target.conf", good);
    g_assert_true(lamp_target_load(&target, path, &error));
    g_assert_no_error(error);
    g_assert_cmpint(target.n, ==, 2);
    g_assert_cmpfloat(target.marks[1].x_mm, ==, -4.5);
    g_assert_cmpfloat(target.plate_mm[1], ==, 70);
    for (gsize i = 0; i < G_N_ELEMENTS(bad); i++) {
        g_auto(GStrv) parts = g_strsplit(good, bad[i].from, 2);
        g_autofree char *text = g_strjoin(bad[i].to, parts[0], parts[1], NULL);
        g_autofree char *wrong = fixture_write("target.conf", text);
        g_assert_false(lamp_target_load(&target, wrong, &error));
        g_assert_error(error, LAMPS_ERROR, LAMPS_ERROR_TARGET);
        g_assert_nonnull(strstr(error->message, bad[i].says));
        g_clear_error(&error);
    }
    g_assert_false(lamp_target_load(&target, "/nowhere/target.conf", &error));
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/lamps/poles", poles);
    g_test_add_func("/lamps/balls", balls);
    g_test_add_func("/lamps/saturated-balls", saturated_balls);
    g_test_add_func("/lamps/too-few", too_few);
    g_test_add_func("/lamps/degenerate", degenerate);
    g_test_add_func("/lamps/no-poles", no_poles);
    g_test_add_func("/lamps/target-file", target_file);
    int result = g_test_run();
    fixture_clean();
    return result;
}
