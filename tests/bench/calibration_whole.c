#include "calibration_parts.h"

#include "bench.h"
#define SCENE_CAMERAS 8
#define SCENE_LAMPS   8
#define SCENE_LASERS  2
#include "lib/lasers_scene.h"

#define ARCS   13 /* with two lasers: 26 positions */
#define PIXELS 256

struct watch { /* pictures are rendered between what is timed */
    double cpu_s, since;
};

static void go_on(struct watch *watch) {
    watch->since = bench_cpu_s();
}

static void halt(struct watch *watch) {
    watch->cpu_s += bench_cpu_s() - watch->since;
}

struct poles {
    struct scene *scene;
    struct lamp_target target;
    struct plate_map *maps[SCENE_CAMERAS];
    GPtrArray *views, *rejected;
    GArray *sights;
    struct watch watch;
    int pictures;
};

static void fit_lamps(struct poles *p) {
    ShadowView *const *views = (ShadowView *const *)p->views->pdata;
    g_autoptr(GError) error = NULL;
    struct lamps_result found = {0};
    struct rig rig = p->scene->rig;
    gboolean ok = shadows_locate(views, 6, &p->target, 4, SCENE_RAD(4), &error);
    for (int round = 0; round < 2 && ok; round++) {
        g_array_set_size(p->sights, 0);
        g_ptr_array_set_size(p->rejected, 0);
        for (guint i = 0; i < p->views->len; i++)
            shadow_view_measure(views[i], &rig, &p->target, round > 0, p->sights, p->rejected);
        lamps_result_clear(&found);
        ok = lamps_fit(&p->scene->rig, &p->target,
                       (const struct lamp_sight *)(gpointer)p->sights->data, (int)p->sights->len,
                       &found, &error);
        if (!ok)
            break;
        rig = found.rig;
        p->target = found.target;
    }
    if (!ok)
        g_error("%s", error->message);
    lamps_result_clear(&found);
}

/* Seconds; all cameras at as many angles of the turntable as bench_lights has. */
static double time_lamps(int *ret_pictures) {
    const struct scene_poses poses = {6, 1};
    struct poles p = {.scene = scene_of(LAMP_POLES, 1, PIXELS, 0.01)};
    p.views = g_ptr_array_new_with_free_func((GDestroyNotify)shadow_view_free);
    p.rejected = g_ptr_array_new_with_free_func(g_free);
    p.sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    scene_target(p.scene, LAMP_POLES, &p.target);
    for (int c = 0; c < SCENE_CAMERAS; c++) {
        go_on(&p.watch);
        p.maps[c] = plate_map_new(&p.scene->rig.cameras[c], &p.target);
        halt(&p.watch);
        for (int turn = 0; turn < poses.turns; turn++) {
            double turn_deg = scene_turn_deg(&poses, turn);
            double arc_deg = scene_arc_deg(&poses, turn, 0);
            g_autoptr(GError) error = NULL;
            go_on(&p.watch);
            ShadowView *view =
                shadow_view_new(&p.scene->rig, c, SCENE_RAD(turn_deg), &p.target, p.maps[c]);
            halt(&p.watch);
            g_ptr_array_add(p.views, view);
            for (int lamp = 0; lamp < SCENE_LAMPS; lamp++) {
                g_autoptr(Picture) picture =
                    scene_picture(p.scene, c, lamp, turn_deg, arc_deg, 8000);
                go_on(&p.watch);
                if (!shadow_view_add(view, picture, p.pictures++, lamp, SCENE_RAD(arc_deg), &error))
                    g_error("%s", error->message);
                halt(&p.watch);
            }
        }
    }
    go_on(&p.watch);
    fit_lamps(&p);
    halt(&p.watch);
    for (int c = 0; c < SCENE_CAMERAS; c++)
        plate_map_free(p.maps[c]);
    g_ptr_array_unref(p.views);
    g_ptr_array_unref(p.rejected);
    g_array_unref(p.sights);
    scene_free(p.scene);
    *ret_pictures = p.pictures;
    return p.watch.cpu_s;
}

/* What a sweep leaves of each pixel, as a session has it. */
static double time_laser(int *ret_sweeps) {
    const struct sweep_poses poses = {
        .arcs = ARCS, .steps = 24, .span_deg = 3.2, .most = 150, .cameras = SCENE_CAMERAS};
    static const struct laser_arc unknown = {0.01, 1};
    static const char *const names[] = {"sweep"};
    g_autoptr(GArray) points = g_array_new(FALSE, FALSE, sizeof(struct laser_point));
    g_autoptr(GError) error = NULL;
    struct laser_result found;
    struct scene *scene = NULL;
    struct watch watch = {0};
    *ret_sweeps = 0;
    for (int h = 0; h < 2; h++) {
        if (scene)
            scene_free(scene);
        scene = sweep_scene(1, PIXELS / 2, 0.01, sweep_heights[h]);
        for (int camera = 0; camera < SCENE_CAMERAS; camera++)
            for (int i = 0; i < SCENE_LASERS * ARCS; i++, ++*ret_sweeps)
                sweep_add_points(scene, &poses, sweep_heights[h], camera, i % SCENE_LASERS,
                                 i / SCENE_LASERS, points);
    }
    go_on(&watch);
    if (!laser_fit(&scene->rig, (const struct laser_point *)(gpointer)points->data,
                   (int)points->len, &unknown, names, &found, &error))
        g_error("%s", error->message);
    halt(&watch);
    laser_result_clear(&found);
    scene_free(scene);
    return watch.cpu_s;
}

void bench_whole(double cameras_s, int cameras_pictures) {
    int pictures, sweeps;
    const double lamps_s = time_lamps(&pictures), laser_s = time_laser(&sweeps);
    world_fixture_clean();
    bench_put(
        "%d{cameras} %d{lamps} %d{laser_positions} %.2f{processor_s} %.2f{cameras_s} "
        "%d{cameras_pictures} %.2f{lamps_s} %d{lamps_pictures} %.2f{laser_s} %d{laser_sweeps}",
        SCENE_CAMERAS, SCENE_LAMPS, SCENE_LASERS * ARCS, cameras_s + lamps_s + laser_s, cameras_s,
        cameras_pictures, lamps_s, pictures, laser_s, sweeps);
}
