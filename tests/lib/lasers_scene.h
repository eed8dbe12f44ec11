/* Simulated sweeps of line lasers over a plane, for tests and measurements. */
#pragma once

#include "frames/sweep.h"
#include "lights_scene.h"

struct sweep_poses {
    int arcs;        /* number of arc angles at which each laser is swept */
    int steps;       /* number of steps of a sweep */
    double span_deg; /* half the range of a sweep, which is symmetric about 0 */
    gsize most;      /* maximum number of points taken from each sweep */
    int cameras;     /* number of cameras that are used: the last ones of the scene */
};

/* Returns a scene with a flat plate of this height. The rig is the same for each height. */
static inline struct scene *sweep_scene(guint32 seed, int pixels, double camera_px,
                                        double height_mm) {
    static char sample[256];
    g_snprintf(sample, sizeof sample,
               "[sample]\nkind=flat\ngrid=2\nwidth_mm=90\nheight_mm=90\nbase_mm=%g\ntop_mm=60\n"
               "places_mm=%%s\n",
               height_mm);
    static const double none[1][3] = {{0, 0, 1}};
    struct scene_options options = {.seed = seed,
                                    .pixels = pixels,
                                    .view_mm = 80,
                                    .sample = sample,
                                    .marks = none,
                                    .n_marks = 1,
                                    .bend = 1,
                                    .camera_px = camera_px};
    return scene_new(&options);
}

static inline double sweep_arc_deg(const struct sweep_poses *poses, int arc) {
    return 20 + 360.0 * arc / poses->arcs;
}

#define SWEEP_STRETCH 0.004

static inline double sweep_true_deg(double told_deg) {
    return told_deg * (1 + SWEEP_STRETCH);
}

static inline void sweep_add_points(struct scene *scene, const struct sweep_poses *poses,
                                    double height_mm, int camera, int laser, int arc,
                                    GArray *points) {
    int n = scene->options.pixels * scene->options.pixels;
    double step = 2 * poses->span_deg / (poses->steps - 1);
    g_autofree guint16 *pixels = g_new(guint16, n);
    g_autofree float *peak = g_new(float, n), *width = g_new(float, n),
                     *intensity = g_new(float, n);
    g_autoptr(Sweep) sweep =
        sweep_new(scene->options.pixels, scene->options.pixels, poses->steps, 4013);
    double turn = 30.0 * arc, at = sweep_arc_deg(poses, arc);
    struct world_state state = {.turntable_deg = turn + scene_slip_deg(scene, turn),
                                .arc_deg = at + scene_slip_deg(scene, at + 1000)};
    state.laser_on[laser] = TRUE;
    for (int k = 0; k < poses->steps; k++) {
        state.sweep_deg[laser] = sweep_true_deg(-poses->span_deg + k * step);
        world_expose(scene->world, camera, &state, 4000, 0, g_rand_int(scene->rand), pixels);
        sweep_add(sweep, pixels);
    }
    sweep_finish(sweep, 40, &(struct sweep_pulses){peak, width, intensity}, NULL);
    const struct laser_plate_sweep from = {.sweep = 0,
                                           .laser = laser,
                                           .camera = camera,
                                           .arc_rad = SCENE_RAD(at),
                                           .from_rad = SCENE_RAD(-poses->span_deg),
                                           .step_rad = SCENE_RAD(step),
                                           .plane_mm = height_mm,
                                           .radius_mm = 38,
                                           .peak = peak,
                                           .width = width,
                                           .most = poses->most};
    laser_points(&scene->rig, &from, points);
}

static const double sweep_heights[2] = {1, 21};

static inline gboolean sweep_measure(guint32 seed, int pixels, double camera_px,
                                     const struct sweep_poses *poses, int n_heights,
                                     struct laser_result *ret, struct scene **scene,
                                     GError **error) {
    g_autoptr(GArray) points = g_array_new(FALSE, FALSE, sizeof(struct laser_point));
    static const char *const names[] = {"sweep"};
    *scene = NULL;
    for (int h = 0; h < n_heights; h++) {
        if (*scene)
            scene_free(*scene);
        *scene = sweep_scene(seed, pixels, camera_px, sweep_heights[h]);
        for (int camera = SCENE_CAMERAS - poses->cameras; camera < SCENE_CAMERAS; camera++)
            for (int laser = 0; laser < SCENE_LASERS; laser++)
                for (int arc = 0; arc < poses->arcs; arc++)
                    sweep_add_points(*scene, poses, sweep_heights[h], camera, laser, arc, points);
    }
    static const struct laser_arc unknown = {0.01, 1};
    return laser_fit(&(*scene)->rig, (const struct laser_point *)(gpointer)points->data,
                     (int)points->len, &unknown, names, ret, error);
}

struct sweep_errors {
    /* maximum over all steps; offset_mm is the maximum over the sample */
    double angle_deg, offset_mm;
    double source_mm; /* largest error of a laser's position, perpendicular to its axis */
    double stretch;
};

/* Compares every laser at every step and every arc angle. */
static inline void sweep_compare(const struct scene *scene, const struct sweep_poses *poses,
                                 const struct laser_result *found, struct sweep_errors *ret) {
    *ret = (struct sweep_errors){0};
    for (int laser = 0; laser < SCENE_LASERS; laser++) {
        ret->stretch = MAX(ret->stretch, fabs(found->rig.lasers[laser].stretch - SWEEP_STRETCH));
        for (int arc = 0; arc < poses->arcs; arc++)
            for (int k = 0; k < poses->steps; k++) {
                double told = -poses->span_deg + k * 2 * poses->span_deg / (poses->steps - 1);
                double at = sweep_arc_deg(poses, arc);
                struct truth_sheet truth;
                truth_laser_sheet(scene->world, laser, at, sweep_true_deg(told), &truth);
                struct rig_plane sheet = rig_laser_sheet(&found->rig.arc, &found->rig.lasers[laser],
                                                         SCENE_RAD(at), SCENE_RAD(told));
                struct vec3 n = vec3(truth.normal[0], truth.normal[1], truth.normal[2]);
                double turned = asin(vec3_length(vec3_cross(n, sheet.normal))) * 180 / G_PI;
                ret->angle_deg = MAX(ret->angle_deg, turned);
                /* Points of the true sheet in the sample: a grid projected onto the sheet. */
                for (int i = 0; i < 27; i++) {
                    struct vec3 p =
                        vec3(25.0 * (i % 3 - 1), 25.0 * (i / 3 % 3 - 1), 10.0 * (i / 9));
                    double off = vec3_dot(n, p) - truth.offset_mm;
                    if (fabs(off) > 25)
                        continue;
                    struct vec3 q = vec3_sub(p, vec3_scale(n, off));
                    ret->offset_mm =
                        MAX(ret->offset_mm, fabs(vec3_dot(sheet.normal, q) - sheet.offset_mm));
                }
                struct vec3 source = rig_laser_position_mm(
                    &found->rig.arc, &found->rig.lasers[laser], SCENE_RAD(at));
                struct vec3 axis = vec3(truth.axis[0], truth.axis[1], truth.axis[2]);
                struct vec3 d = vec3_sub(
                    source, vec3(truth.source_mm[0], truth.source_mm[1], truth.source_mm[2]));
                ret->source_mm = MAX(ret->source_mm,
                                     vec3_length(vec3_sub(d, vec3_scale(axis, vec3_dot(d, axis)))));
            }
    }
}
