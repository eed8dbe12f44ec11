#include "truth.h"

#include "world_private.h"

#include <string.h>

/* Number of samples per texel, in x and in y, with which depth edges are found. */
#define FINE 4

static void give(struct v3 v, double ret[3]) {
    ret[0] = v.x;
    ret[1] = v.y;
    ret[2] = v.z;
}

void truth_view_centre_mm(World *world, int camera, double turntable_deg, double ret[3]) {
    const struct optics_camera at = world_camera_at(world, camera, world->arm_deg);
    give(world_eye_mm(world, &at, turntable_deg), ret);
}

void truth_to_rig(World *world, double turntable_deg, const double sample_mm[3],
                  double ret_rig_mm[3]) {
    give(world_to_rig(world, turntable_deg, v3(sample_mm[0], sample_mm[1], sample_mm[2])),
         ret_rig_mm);
}

void truth_camera(World *world, int camera, struct truth_camera *ret) {
    const struct optics_camera at = world_camera_at(world, camera, world->arm_deg), *from = &at;
    *ret = (struct truth_camera){.focal_px = from->focal_px,
                                 .centre_px = {from->centre_x_px, from->centre_y_px},
                                 .k1 = from->k1,
                                 .k2 = from->k2,
                                 .p1 = from->p1,
                                 .p2 = from->p2};
    give(from->centre_mm, ret->centre_mm);
    give(from->right, ret->right);
    give(from->down, ret->down);
    give(from->forward, ret->forward);
}

/* Finds the point of the picture whose viewing ray goes through point_mm, by Newton's method. The
 * rendered pictures are made with the same viewing rays. */
void truth_project(World *world, int camera, const double point_mm[3], double ret_xy_px[2]) {
    const struct optics_camera at = world_camera_at(world, camera, world->arm_deg), *from = &at;
    const struct v3 to =
        v3_norm(v3_minus(v3(point_mm[0], point_mm[1], point_mm[2]), from->centre_mm));
    double *xy = ret_xy_px;
    xy[0] =
        from->centre_x_px + from->focal_px * v3_dot(to, from->right) / v3_dot(to, from->forward);
    xy[1] = from->centre_y_px + from->focal_px * v3_dot(to, from->down) / v3_dot(to, from->forward);
    for (int i = 0; i < 20; i++) {
        const struct v3 ray = optics_ray(from, xy[0], xy[1]), off = v3_minus(to, ray);
        const struct v3 x =
            v3_minus(optics_ray(from, xy[0] + 0.5, xy[1]), optics_ray(from, xy[0] - 0.5, xy[1]));
        const struct v3 y =
            v3_minus(optics_ray(from, xy[0], xy[1] + 0.5), optics_ray(from, xy[0], xy[1] - 0.5));
        const double xx = v3_dot(x, x), xo = v3_dot(x, y), yy = v3_dot(y, y);
        const double bx = v3_dot(x, off), by = v3_dot(y, off), det = xx * yy - xo * xo;
        xy[0] += (yy * bx - xo * by) / det;
        xy[1] += (xx * by - xo * bx) / det;
    }
}

void truth_arc(World *world, struct truth_arc *ret) {
    ret->zero_deg = world->arc.zero * 180 / G_PI;
    give(world->arc.z, ret->axis);
    give(world->arc.centre_mm, ret->centre_mm);
}

static void give_swing(const struct optics_swing *from, struct truth_swing *ret) {
    ret->zero_deg = from->zero * 180 / G_PI;
    give(from->axis, ret->axis);
    give(from->centre_mm, ret->centre_mm);
}

void truth_arm(World *world, struct truth_swing *ret) {
    give_swing(&world->arm, ret);
}

void truth_probe(World *world, struct truth_swing *ret) {
    give_swing(&world->probe, ret);
}

/* Returns a lamp in the rig frame. */
static struct optics_lamp lamp_at(World *world, int lamp, double arc_deg) {
    struct light_pose pose = world_lamp_pose(world, lamp, arc_deg, world->probe_deg, 0);
    pose.upright = TRUE;
    return world_lamp_at(world, lamp, pose);
}

void truth_lamp(World *world, int lamp, double arc_deg, double ret_position_mm[3],
                double ret_aim[3]) {
    struct optics_lamp at = lamp_at(world, lamp, arc_deg);
    give(at.position_mm, ret_position_mm);
    if (ret_aim)
        give(at.aim, ret_aim);
}

double truth_white(World *world, int camera, int lamp, double arc_deg, const double point_mm[3],
                   int colour) {
    struct optics_lamp at = lamp_at(world, lamp, arc_deg);
    struct v3 p = v3(point_mm[0], point_mm[1], point_mm[2]);
    double level = v3_norm(v3_minus(at.position_mm, p)).z, xy[2];
    truth_project(world, camera, point_mm, xy);
    const struct optics_camera *c = &world->cameras[camera];
    const double half = 2 * lround(xy[0]) < c->width ? 1 : 1 + c->half_gain_step;
    return optics_response(c, xy[0], xy[1], (enum cfa_colour)colour) * half *
           optics_lamp_irradiance(&at, p) * MAX(level, 0) / G_PI;
}

/* Returns a laser in the rig frame. */
static struct optics_laser laser_at(World *world, int laser, double arc_deg) {
    struct light_pose pose = world_light_pose(world, world->laser_fixed[laser], arc_deg, 0);
    pose.upright = TRUE;
    return world_laser_at(world, laser, pose);
}

double truth_laser_sweep_deg(World *world, int laser, double arc_deg, const double point_mm[3]) {
    struct optics_laser at = laser_at(world, laser, arc_deg);
    return optics_laser_angle(&at, v3(point_mm[0], point_mm[1], point_mm[2])) * 180 / G_PI;
}

void truth_laser_sheet(World *world, int laser, double arc_deg, double sweep_deg,
                       struct truth_sheet *ret) {
    struct optics_laser at = laser_at(world, laser, arc_deg);
    double s = sweep_deg * G_PI / 180 - at.start;
    struct v3 aside = v3_cross(at.axis, at.forward);
    struct v3 normal = v3_mad(aside, cos(s), v3_mad(at.forward, -sin(s), v3(0, 0, 0)));
    give(normal, ret->normal);
    ret->offset_mm = v3_dot(normal, at.position_mm);
    give(at.position_mm, ret->source_mm);
    give(at.axis, ret->axis);
}

/* A raster of points of the reference plane, fine × fine points per texel. The arrays are for one
 * row of the raster: its points, the viewing rays through them, and the surfaces that these rays
 * meet. */
struct raster {
    World *world;
    const struct truth_grid *grid;
    struct v3 eye;
    int fine, n; /* `n`: number of points of a row */
    struct v3 *points, *rays;
    struct surface *surfaces;
    gboolean *hit;
};

static void raster_init(struct raster *raster, World *world, int camera, double turntable_deg,
                        const struct truth_grid *grid, int fine) {
    *raster = (struct raster){.world = world, .grid = grid, .fine = fine};
    const struct optics_camera at = world_camera_at(world, camera, world->arm_deg);
    raster->eye = world_eye_mm(world, &at, turntable_deg);
    raster->n = grid->width * fine;
    raster->points = g_new(struct v3, raster->n);
    raster->rays = g_new(struct v3, raster->n);
    raster->surfaces = g_new0(struct surface, raster->n);
    raster->hit = g_new0(gboolean, raster->n);
}

static void raster_clear(struct raster *raster) {
    g_free(raster->points);
    g_free(raster->rays);
    g_free(raster->surfaces);
    g_free(raster->hit);
}

static void raster_trace(struct raster *raster, int row) {
    const struct truth_grid *grid = raster->grid;
    double y = grid->height_mm * (0.5 - (row + 0.5) / (grid->height * raster->fine));
    for (int i = 0; i < raster->n; i++) {
        double x = grid->width_mm * ((i + 0.5) / raster->n - 0.5);
        raster->points[i] = v3(x, y, grid->reference_mm);
        raster->rays[i] = v3_norm(v3_minus(raster->points[i], raster->eye));
    }
    scene_trace(&raster->world->scene, raster->eye, raster->points, raster->rays, raster->n,
                raster->surfaces, raster->hit);
}

/* Computes the distance along each ray of the raster from the reference plane to the surface, in
 * mm. The distance is −1 if the ray meets nothing. */
static void distances(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
                      int fine, float *ret) {
    struct raster raster;
    raster_init(&raster, world, camera, turntable_deg, grid, fine);
    for (int row = 0; row < grid->height * fine; row++) {
        raster_trace(&raster, row);
        for (int i = 0; i < raster.n; i++)
            if (raster.hit[i]) {
                const float *p = raster.surfaces[i].p;
                struct v3 way = v3_minus(v3(p[0], p[1], p[2]), raster.points[i]);
                *ret++ = (float)v3_dot(way, raster.rays[i]);
            } else {
                *ret++ = -1;
            }
    }
    raster_clear(&raster);
}

/* Called if the distance has a step at the fine sample (i, j). Marks the texels whose centre is
 * within one texel of this sample. */
static void flag_edge(const struct truth_grid *grid, int i, int j, guint8 *edge) {
    double x = (i + 0.5) / FINE, y = (j + 0.5) / FINE;
    int from_x = MAX(0, (int)ceil(x - 1.5)), to_x = MIN(grid->width - 1, (int)floor(x + 0.5));
    int from_y = MAX(0, (int)ceil(y - 1.5)), to_y = MIN(grid->height - 1, (int)floor(y + 0.5));
    for (int v = from_y; v <= to_y; v++)
        for (int u = from_x; u <= to_x; u++)
            edge[v * grid->width + u] = 1;
}

void truth_mdf(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
               float *ret_distance_mm, guint8 *ret_edge) {
    distances(world, camera, turntable_deg, grid, 1, ret_distance_mm);
    if (!ret_edge)
        return;
    int w = grid->width * FINE, h = grid->height * FINE;
    float step = (float)(grid->width_mm / grid->width / 2);
    g_autofree float *fine = g_new0(float, (gsize)w *(gsize)h);
    distances(world, camera, turntable_deg, grid, FINE, fine);
    memset(ret_edge, 0, (gsize)grid->width * (gsize)grid->height);
    for (int j = 0; j < h; j++) {
        for (int i = 0; i < w; i++) {
            float d = fine[j * w + i];
            if ((i + 1 < w && fabsf(fine[j * w + i + 1] - d) > step) ||
                (j + 1 < h && fabsf(fine[(j + 1) * w + i] - d) > step))
                flag_edge(grid, i, j, ret_edge);
        }
    }
}

void truth_laser_seen(World *world, int camera, double turntable_deg, const struct truth_grid *grid,
                      const double *arc_deg, const int *laser, int n, guint8 *ret_seen) {
    struct raster raster;
    raster_init(&raster, world, camera, turntable_deg, grid, 1);
    memset(ret_seen, 0, (gsize)grid->width * (gsize)grid->height);
    for (int row = 0; row < grid->height; row++) {
        raster_trace(&raster, row);
        for (int k = 0; k < n; k++) {
            struct light_pose pose =
                world_light_pose(world, world->laser_fixed[laser[k]], arc_deg[k], turntable_deg);
            struct optics_laser turned = world_laser_at(world, laser[k], pose);
            /* If the laser can light a point of the row at some sweep angle, the count of this
             * point increases by one. */
            guint8 *seen = ret_seen + row * grid->width;
            for (int first = 0; first < raster.n; first += SCENE_BATCH) {
                int n_points = MIN(SCENE_BATCH, raster.n - first);
                const struct surface *points = &raster.surfaces[first];
                guint8 blocked[SCENE_BATCH];
                scene_shadow(&raster.world->scene, turned.position_mm, points, n_points, blocked);
                for (int i = 0; i < n_points; i++) {
                    struct v3 p = v3(points[i].p[0], points[i].p[1], points[i].p[2]);
                    seen[first + i] +=
                        raster.hit[first + i] && !blocked[i] && optics_laser_peak(&turned, p) > 0;
                }
            }
        }
    }
    raster_clear(&raster);
}

struct lamp_light {
    struct optics_lamp lamp;
    const float *bounce;
};

/* Adds the reflectance π L / E_⊥ along each ray of a row to the mean of its texel. L is the
 * radiance. E_⊥ is the irradiance at the texel's centre on a surface that faces the lamp
 * (facing). */
static void add_reflectance(const struct raster *raster, const struct lamp_light *light,
                            const double *facing, float *rgb) {
    const float share = 1.0f / (float)(raster->fine * raster->fine);
    guint8 blocked[SCENE_BATCH];
    for (int i = 0; i < raster->n; i++) {
        const struct surface *s = &raster->surfaces[i];
        if (i % SCENE_BATCH == 0)
            scene_shadow(&raster->world->scene, light->lamp.position_mm, s,
                         MIN(SCENE_BATCH, raster->n - i), blocked);
        if (!raster->hit[i])
            continue;
        double direct = blocked[i % SCENE_BATCH]
                            ? 0
                            : optics_lamp_irradiance(&light->lamp, v3(s->p[0], s->p[1], s->p[2]));
        for (int c = 0; c < 3; c++) {
            enum cfa_colour colour = (enum cfa_colour)c;
            double radiance =
                direct * scene_reflect(s, light->lamp.position_mm, raster->eye, colour) +
                s->albedo[c] * M_1_PI * world_bounce_at(raster->world, light->bounce, s, colour);
            rgb[3 * (i / raster->fine) + c] +=
                (float)(radiance * G_PI / facing[i / raster->fine]) * share;
        }
    }
}

void truth_btf(World *world, int camera, int lamp, double turntable_deg, double arc_deg,
               const struct truth_grid *grid, int samples, float *ret_rgb) {
    struct light_pose pose = world_lamp_pose(world, lamp, arc_deg, world->probe_deg, turntable_deg);
    struct cache_entry *bounce = world_bounce(world, lamp, pose);
    struct lamp_light light = {world_lamp_at(world, lamp, pose), bounce->value};
    struct raster raster;
    raster_init(&raster, world, camera, turntable_deg, grid, samples);
    g_autofree double *facing = g_new0(double, grid->width);
    memset(ret_rgb, 0, sizeof(float) * 3 * (gsize)grid->width * (gsize)grid->height);
    for (int row = 0; row < grid->height * samples; row++) {
        const int j = row / samples;
        double y = grid->height_mm * (0.5 - (j + 0.5) / grid->height);
        for (int i = 0; i < grid->width; i++) {
            double x = grid->width_mm * ((i + 0.5) / grid->width - 0.5);
            facing[i] = optics_lamp_irradiance(&light.lamp, v3(x, y, grid->reference_mm));
        }
        raster_trace(&raster, row);
        add_reflectance(&raster, &light, facing, ret_rgb + 3 * grid->width * j);
    }
    raster_clear(&raster);
    cache_release(world->cache, bounce);
}

void truth_surface(World *world, struct truth_surface *ret) {
    G_STATIC_ASSERT(sizeof(struct vertex) % sizeof(float) == 0);
    *ret = (struct truth_surface){
        .vertices = (const float *)world->scene.vertices,
        .n_vertices = world->scene.n_vertices,
        .stride = sizeof(struct vertex) / sizeof(float),
        .albedo = G_STRUCT_OFFSET(struct vertex, albedo) / sizeof(float),
        .triangles = (const guint32 *)world->scene.triangles,
        .n_triangles = world->scene.n_triangles,
    };
}
