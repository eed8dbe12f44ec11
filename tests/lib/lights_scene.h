/*
 * Simulated calibration of lamps, for tests and measurements. The world has a crooked arc, and a
 * target that was not placed exactly. Pictures have the form that a camera gives them. The poses
 * have the position errors of a real drive.
 */
#pragma once

#include "lamps/highlights.h"
#include "lamps/shadows.h"
#include "laser/laser.h"
#include "world/truth.h"
#include "world_fixture.h"

#ifndef SCENE_CAMERAS
#define SCENE_CAMERAS 3
#define SCENE_LAMPS   5
#define SCENE_LASERS  5
#endif
#define SCENE_RAD(deg) ((deg) * (G_PI / 180))

/* Polar angles at equal intervals. */
static inline double scene_camera_deg(int i) {
    return 15 + 55.0 * i / (SCENE_CAMERAS - 1);
}

static inline double scene_lamp_deg(int i) {
    return 15 + 60.0 * i / (SCENE_LAMPS - 1);
}

static inline double scene_laser_deg(int i) {
    return 15 + 60.0 * i / (SCENE_LASERS - 1);
}

struct scene_options {
    guint32 seed;
    int pixels;         /* of a camera, in each direction */
    double view_mm;     /* size of the field of view at the origin */
    const char *sample; /* section [sample] of the world file, with %s for the positions */
    const double (*marks)[3];
    int n_marks;
    double shift_mm, turn_deg; /* maximum deviation of the target from its nominal pose */
    double bend;      /* factor of the deviations from the nominal rig: 1 as usual, 0 for none */
    double blur_px;   /* of the lens */
    double camera_px; /* standard deviation of the errors of calibrated cameras */
};

struct scene {
    World *world;
    struct rig rig; /* true cameras; all other devices are nominal */
    GRand *rand;
    struct scene_options options;
};

static inline double scene_k1(int camera) {
    return -0.06 + 0.04 * camera;
}

static inline void scene_places(struct scene *scene, GString *text) {
    const struct scene_options *o = &scene->options;
    double dx = o->shift_mm * (2 * g_rand_double(scene->rand) - 1);
    double dy = o->shift_mm * (2 * g_rand_double(scene->rand) - 1);
    double turn = SCENE_RAD(o->turn_deg) * (2 * g_rand_double(scene->rand) - 1);
    for (int i = 0; i < o->n_marks; i++) {
        const double *m = o->marks[i];
        g_string_append_printf(text, "%s%.6f;%.6f;%.6f", i ? ";" : "",
                               cos(turn) * m[0] - sin(turn) * m[1] + dx,
                               sin(turn) * m[0] + cos(turn) * m[1] + dy, m[2]);
    }
}

static inline void scene_devices(struct scene *scene, GString *text) {
    const struct scene_options *o = &scene->options;
    double focal = o->pixels * 650 / o->view_mm;
    for (int i = 0; i < SCENE_CAMERAS; i++)
        g_string_append_printf(text,
                               "[camera c%d]\ntheta_deg=%g\nwidth=%d\nheight=%d\nfocal_px=%.9g\n"
                               "k1=%g\np1=0.001\nvignetting=0.1\nblur_px=%g\n",
                               i, scene_camera_deg(i), o->pixels, o->pixels, focal, scene_k1(i),
                               o->blur_px);
    for (int i = 0; i < SCENE_LAMPS; i++)
        g_string_append_printf(text, "[lamp l%d]\ntheta_deg=%g\n", i, scene_lamp_deg(i));
    for (int i = 0; i < SCENE_LASERS; i++)
        g_string_append_printf(text, "[laser s%d]\ntheta_deg=%g\n", i, scene_laser_deg(i));
}

static inline double scene_deviate(struct scene *scene) {
    double sum = -6;
    for (int i = 0; i < 12; i++)
        sum += g_rand_double(scene->rand);
    return sum;
}

static inline void scene_rig(struct scene *scene) {
    struct rig *rig = &scene->rig;
    const struct scene_options *o = &scene->options;
    rig->n_cameras = SCENE_CAMERAS;
    rig->n_lamps = SCENE_LAMPS;
    rig->n_lasers = SCENE_LASERS;
    for (int i = 0; i < SCENE_CAMERAS; i++) {
        struct rig_camera *c = &rig->cameras[i];
        *c = (struct rig_camera){.width = o->pixels, .height = o->pixels, .response = 6000};
        c->fx_px = c->fy_px = o->pixels * 650 / o->view_mm;
        c->cx_px = (o->pixels - 1) / 2.0 + o->camera_px * scene_deviate(scene);
        c->cy_px = (o->pixels - 1) / 2.0 + o->camera_px * scene_deviate(scene);
        c->k1 = scene_k1(i);
        c->p1 = 0.001;
        g_snprintf(c->name, RIG_NAME, "c%d", i);
        rig_camera_look_at(c, vec3_scale(rig_direction(SCENE_RAD(scene_camera_deg(i)), 0), 650),
                           vec3(0, 0, 0));
    }
    const struct vec3 across = vec3(0, 1, 0);
    for (int i = 0; i < SCENE_LAMPS; i++) {
        struct vec3 out = rig_direction(SCENE_RAD(scene_lamp_deg(i)), 0);
        rig->lamps[i] = (struct rig_lamp){"", vec3_scale(out, 500), vec3_scale(out, -1), 2, 40};
        g_snprintf(rig->lamps[i].name, RIG_NAME, "l%d", i);
    }
    for (int i = 0; i < SCENE_LASERS; i++) {
        struct vec3 out = rig_direction(SCENE_RAD(scene_laser_deg(i)), 0);
        rig->lasers[i] = (struct rig_laser){"", vec3_scale(out, 480), across,
                                            vec3_unit(vec3_cross(across, vec3_scale(out, -1))), 0};
        g_snprintf(rig->lasers[i].name, RIG_NAME, "s%d", i);
    }
}

static inline struct scene *scene_new(const struct scene_options *options) {
    struct scene *scene = g_new0(struct scene, 1);
    g_autoptr(GString) text = g_string_new(NULL), places = g_string_new(NULL);
    scene->options = *options;
    scene->rand = g_rand_new_with_seed(options->seed);
    double b = options->bend;
    g_string_append_printf(text,
                           "[world]\nseed=%u\ngather_rays=0\nsupersample=2\ncache_mb=200\n"
                           "arc_zero_error_deg=%g\narc_tilt_error_deg=%g\narc_error_mm=%g\n"
                           "lamp_error_mm=%g\nlamp_error_deg=%g\nlamp_error_pct=%g\n"
                           "laser_error_mm=%g\nlaser_error_deg=%g\n",
                           options->seed, 0.5 * b, 0.1 * b, 0.3 * b, 2 * b, 0.5 * b, 2 * b, 0.5 * b,
                           0.2 * b);
    scene_devices(scene, text);
    scene_places(scene, places);
    g_string_append_printf(text, options->sample, places->str);
    scene->world = world_fixture_new(text->str);
    scene_rig(scene);
    return scene;
}

static inline void scene_free(struct scene *scene) {
    world_unref(scene->world);
    g_rand_free(scene->rand);
    g_free(scene);
}

/* Returns the position error of a drive, up to 0.01°. It is repeatable, because it is a function of
 * the position. */
static inline double scene_slip_deg(const struct scene *scene, double deg) {
    return 0.01 * sin(deg * 12.9898 + scene->options.seed * 78.233) * scene->options.bend;
}

/* Returns a picture as the daemon's intake makes it, in DN per millisecond above dark. The picture
 * is converted to grey. */
static inline struct picture *scene_picture(struct scene *scene, int camera, int lamp,
                                            double turntable_deg, double arc_deg,
                                            gint64 exposure_us) {
    struct world_state state = {.turntable_deg =
                                    turntable_deg + scene_slip_deg(scene, turntable_deg),
                                .arc_deg = arc_deg + scene_slip_deg(scene, arc_deg + 1000)};
    int n = scene->options.pixels * scene->options.pixels;
    g_autofree guint16 *pixels = g_new(guint16, n);
    g_autofree char *name =
        g_strdup_printf("c%d, l%d, %g°, %g°", camera, lamp, turntable_deg, arc_deg);
    state.lamp_output[lamp] = 1;
    world_expose(scene->world, camera, &state, exposure_us, 0, g_rand_int(scene->rand), pixels);
    struct picture *picture = picture_new(name, "", scene->options.pixels, scene->options.pixels);
    for (int i = 0; i < n; i++)
        picture->values[i] = (float)(pixels[i] - 64) / (float)exposure_us * 1000;
    g_assert_true(picture_balance(picture, "rggb"));
    return picture;
}

struct scene_errors {
    double direction_deg, distance, zero_deg, axis_deg, centre_mm; /* largest, absolute */
    /* squared Mahalanobis distance of the errors of the lamps' positions at arc angle 0, per degree
     * of freedom */
    double chi2;
};

/* Returns the zero of the arc by its definition: the angle for which the nominal lamps are nearest
 * to the true ones. */
static inline double scene_zero_deg(const struct scene *scene) {
    struct truth_arc arc;
    truth_arc(scene->world, &arc);
    double cross = 0, dot = 0, z = arc.axis[2], s = hypot(arc.axis[0], arc.axis[1]);
    double lean = atan2(s, z);
    struct rig_arc true_arc = {
        SCENE_RAD(arc.zero_deg),
        {s > 0 ? -lean * arc.axis[1] / s : 0, s > 0 ? lean * arc.axis[0] / s : 0},
        {arc.centre_mm[0], arc.centre_mm[1]}};
    for (int i = 0; i < SCENE_LAMPS; i++) {
        double p[3];
        truth_lamp(scene->world, i, 0, p, NULL);
        struct vec3 to = rig_arc_point_back(&true_arc, 0, vec3(p[0], p[1], p[2]));
        struct vec3 from = scene->rig.lamps[i].position_mm;
        cross += from.x * to.y - from.y * to.x;
        dot += from.x * to.x + from.y * to.y;
    }
    return arc.zero_deg + atan2(cross, dot) * 180 / G_PI;
}

static inline double scene_chi2(struct vec3 d, const double c[3][3]) {
    /* dᵀ C⁻¹ d by Cramer's rule. */
    double v[3] = {d.x, d.y, d.z}, inverse[3][3], det = 0, sum = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            inverse[j][i] = c[(i + 1) % 3][(j + 1) % 3] * c[(i + 2) % 3][(j + 2) % 3] -
                            c[(i + 1) % 3][(j + 2) % 3] * c[(i + 2) % 3][(j + 1) % 3];
    for (int j = 0; j < 3; j++)
        det += c[0][j] * inverse[j][0];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            sum += v[i] * inverse[i][j] / det * v[j];
    return sum;
}

static inline void scene_compare(const struct scene *scene, const struct lamps_result *found,
                                 struct scene_errors *ret) {
    struct truth_arc arc;
    truth_arc(scene->world, &arc);
    *ret = (struct scene_errors){0};
    for (int i = 0; i < SCENE_LAMPS; i++)
        for (int deg = 0; deg < 360; deg += 30) {
            double p[3];
            truth_lamp(scene->world, i, deg, p, NULL);
            struct vec3 truth = vec3(p[0], p[1], p[2]);
            struct vec3 at =
                rig_lamp_position_mm(&found->rig.arc, &found->rig.lamps[i], SCENE_RAD(deg));
            struct vec3 across = vec3_cross(vec3_unit(at), vec3_unit(truth));
            ret->direction_deg = MAX(ret->direction_deg, asin(vec3_length(across)) * 180 / G_PI);
            ret->distance = MAX(ret->distance, fabs(vec3_length(at) / vec3_length(truth) - 1));
            if (deg == 0)
                ret->chi2 +=
                    scene_chi2(vec3_sub(at, truth), found->covariance_mm2[i]) / 3 / SCENE_LAMPS;
        }
    ret->zero_deg = fabs(found->rig.arc.zero_rad * 180 / G_PI - scene_zero_deg(scene));
    struct vec3 axis = rig_arc_direction(&found->rig.arc, 0, vec3(0, 0, 1));
    ret->axis_deg =
        asin(vec3_length(vec3_cross(axis, vec3(arc.axis[0], arc.axis[1], arc.axis[2])))) * 180 /
        G_PI;
    ret->centre_mm = hypot(found->rig.arc.centre_mm[0] - arc.centre_mm[0],
                           found->rig.arc.centre_mm[1] - arc.centre_mm[1]);
}

/* Posts: high ones for steep lamps, low ones for low lamps. */
#define SCENE_PLATE_MM 84
static const double scene_poles[][3] = {{-22, -20, 24}, {20, -24, 12}, {24, 18, 24}, {-18, 24, 12},
                                        {0, 8, 20},     {-6, -14, 5},  {12, 2, 5},   {-16, 4, 5}};
static const double scene_balls[][3] = {
    {-22, -18, 9}, {20, -22, 9}, {22, 20, 9}, {-18, 22, 9}, {0, 0, 9}};

static inline void scene_target(const struct scene *scene, enum lamp_target_kind kind,
                                struct lamp_target *ret) {
    *ret = (struct lamp_target){.kind = kind,
                                .plane_mm = 2,
                                .radius_mm = 1,
                                .plate_mm = {SCENE_PLATE_MM, SCENE_PLATE_MM},
                                .n = scene->options.n_marks};
    for (int i = 0; i < ret->n; i++) {
        const double *m = scene->options.marks[i];
        ret->marks[i] = (struct lamp_mark){m[0], m[1], m[2]};
    }
}

#define SCENE_POLES_SAMPLE                                                                         \
    "[sample]\nkind=poles\nwidth_mm=84\nheight_mm=84\nbase_mm=2\ntop_mm=40\nradius_mm=1\nplaces_"  \
    "mm=%s\n"
#define SCENE_BALLS_SAMPLE                                                                         \
    "[sample]\nkind=balls\nwidth_mm=84\nheight_mm=84\nbase_mm=2\ntop_mm=40\nplaces_mm=%s\n"

static inline struct scene *scene_of(enum lamp_target_kind kind, guint32 seed, int pixels,
                                     double camera_px) {
    const struct scene_options poles = {.seed = seed,
                                        .pixels = pixels,
                                        .view_mm = 80,
                                        .sample = SCENE_POLES_SAMPLE,
                                        .marks = scene_poles,
                                        .n_marks = G_N_ELEMENTS(scene_poles),
                                        .shift_mm = 2,
                                        .turn_deg = 2,
                                        .bend = 1,
                                        .blur_px = 0.4,
                                        .camera_px = camera_px};
    struct scene_options balls = poles;
    /* a few samples per pixel, spread at random, would turn highlights into noise */
    balls.blur_px = 0;
    balls.sample = SCENE_BALLS_SAMPLE;
    balls.marks = scene_balls;
    balls.n_marks = G_N_ELEMENTS(scene_balls);
    return scene_new(kind == LAMP_POLES ? &poles : &balls);
}

struct scene_poses {
    int turns, arcs; /* number of turntable angles, and of arc angles at each of them */
};

static inline double scene_turn_deg(const struct scene_poses *poses, int turn) {
    return 360.0 * turn / poses->turns;
}

/* Returns arc angle number `arc` for turntable angle number `turn`. Over all turntable angles, the
 * lamps come from all sides of the sample, and the arc takes angles all around its axis. */
static inline double scene_arc_deg(const struct scene_poses *poses, int turn, int arc) {
    return 37 + 360.0 * arc / poses->arcs + 100.0 * turn;
}

static inline gboolean scene_measure_poles(struct scene *scene, const struct scene_poses *poses,
                                           struct lamps_result *ret, GPtrArray *rejected,
                                           GError **error) {
    struct plate_map *maps[SCENE_CAMERAS];
    g_autoptr(GPtrArray) views = g_ptr_array_new_with_free_func((GDestroyNotify)shadow_view_free);
    g_autoptr(GArray) sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    struct lamp_target target;
    gboolean ok = TRUE;
    scene_target(scene, LAMP_POLES, &target);
    for (int c = 0; c < SCENE_CAMERAS; c++)
        maps[c] = plate_map_new(&scene->rig.cameras[c], &target);
    int index = 0;
    for (int c = 0; c < SCENE_CAMERAS; c++)
        for (int t = 0; t < poses->turns && ok; t++) {
            double turn = scene_turn_deg(poses, t);
            ShadowView *view = shadow_view_new(&scene->rig, c, SCENE_RAD(turn), &target, maps[c]);
            g_ptr_array_add(views, view);
            for (int a = 0; a < poses->arcs && ok; a++)
                for (int l = 0; l < SCENE_LAMPS && ok; l++) {
                    double arc = scene_arc_deg(poses, t, a);
                    g_autoptr(Picture) picture = scene_picture(scene, c, l, turn, arc, 8000);
                    ok = shadow_view_add(view, picture, index++, l, SCENE_RAD(arc), error);
                }
        }
    ShadowView *const *all = (ShadowView *const *)views->pdata;
    ok = ok && shadows_locate(all, MIN((int)views->len, 6), &target, 4, SCENE_RAD(4), error);
    struct rig rig = scene->rig;
    for (int round = 0; round < 2 && ok; round++) {
        g_array_set_size(sights, 0);
        g_ptr_array_set_size(rejected, 0);
        for (guint i = 0; i < views->len; i++)
            shadow_view_measure(all[i], &rig, &target, round > 0, sights, rejected);
        if (round > 0)
            lamps_result_clear(ret);
        ok = lamps_fit(&scene->rig, &target, (struct lamp_sight *)(gpointer)sights->data,
                       (int)sights->len, ret, error);
        if (!ok)
            break;
        rig = ret->rig;
        target = ret->target;
    }
    for (int c = 0; c < SCENE_CAMERAS; c++)
        plate_map_free(maps[c]);
    return ok;
}

static inline gboolean scene_measure_balls(struct scene *scene, const struct scene_poses *poses,
                                           gint64 exposure_us, struct lamps_result *ret,
                                           GPtrArray *rejected, GError **error) {
    g_autoptr(GArray) sights = g_array_new(FALSE, FALSE, sizeof(struct lamp_sight));
    struct lamp_target target;
    scene_target(scene, LAMP_BALLS, &target);
    int index = 0;
    for (int c = 0; c < SCENE_CAMERAS; c++)
        for (int t = 0; t < poses->turns; t++)
            for (int a = 0; a < poses->arcs; a++)
                for (int l = 0; l < SCENE_LAMPS; l++) {
                    double turn = scene_turn_deg(poses, t), arc = scene_arc_deg(poses, t, a);
                    g_autoptr(Picture) picture = scene_picture(scene, c, l, turn, arc, exposure_us);
                    struct highlight_picture from = {picture, index++,         l,
                                                     c,       SCENE_RAD(turn), SCENE_RAD(arc)};
                    if (!highlights_measure(&scene->rig, &target, &from, 4, sights, rejected,
                                            error))
                        return FALSE;
                }
    return lamps_fit(&scene->rig, &target, (struct lamp_sight *)(gpointer)sights->data,
                     (int)sights->len, ret, error);
}
