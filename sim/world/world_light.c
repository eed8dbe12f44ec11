#include "spread.h"
#include "world_private.h"

#define RAD(deg)    ((deg) * (G_PI / 180))
#define MAX_SAMPLES 64 /* largest number of samples of a pixel */

enum cached {
    CACHED_VIEW = 1,
    CACHED_BOUNCE,
    CACHED_PICTURE,
};

static double whole_turn(double deg) { /* returns deg modulo 360, rounded to 1e-9 */
    double rest = fmod(deg, 360);
    double steps = rint((rest < 0 ? rest + 360 : rest) * 1e9);
    return steps >= 360e9 ? 0 : steps * 1e-9;
}

double world_relative_rad(double arc_deg, double turntable_deg) {
    return RAD(whole_turn(arc_deg - turntable_deg));
}

struct light_pose world_light_pose(const World *world, gboolean fixed, double arc_deg,
                                   double turntable_deg) {
    if (fixed)
        return (struct light_pose){world_relative_rad(0, turntable_deg), 0, TRUE};
    return (struct light_pose){
        world_relative_rad(arc_deg, turntable_deg),
        world->arc.crooked || world->wobble > 0 ? RAD(whole_turn(turntable_deg)) : 0, FALSE};
}

struct light_pose world_lamp_pose(const World *world, int lamp, double arc_deg, double probe_deg,
                                  double turntable_deg) {
    struct light_pose pose =
        world_light_pose(world, world->lamp_fixed[lamp], arc_deg, turntable_deg);
    pose.probe_deg = world->lamp_on_probe[lamp] ? probe_deg : 0;
    return pose;
}

guint64 world_carried_bits(gboolean carried, double deg) {
    return carried ? sample_hash(world_bits(rint(deg * 1e9) * 1e-9 + 0.0)) : 0;
}

/* Tilts a vector as the bearing tilts the turntable's axis: by the angle `wobble`, towards the
 * azimuth wobble_per_turn·turntable_rad. If sign is 1, returns the tilted vector. If sign is −1,
 * tilts the vector back. If sign is 0, returns it unchanged. */
static struct v3 lean(const World *world, double turntable_rad, double sign, struct v3 v) {
    if (!(world->wobble > 0))
        return v;
    const double towards = world->wobble_per_turn * turntable_rad;
    return optics_spin(v, v3(-sin(towards), cos(towards), 0), sign * world->wobble);
}

struct v3 world_to_rig(const World *world, double turntable_deg, struct v3 p) {
    const double angle = RAD(whole_turn(turntable_deg));
    return lean(world, angle, 1, v3_turn_z(p, cos(angle), sin(angle)));
}

/* Converts a vector or point to the frame of the pose. v is in the frame of the arc, or for a fixed
 * light in the rig frame.
 *
 * If the axes of arc and turntable have no errors, v is only turned by the angle between arc and
 * turntable. The result is then bit-identical to that for an ideal arc. */
static struct v3 place(const World *world, struct light_pose pose, struct v3 v, gboolean point) {
    const double sign = pose.upright ? 0 : -1;
    if (pose.fixed) {
        v = lean(world, -pose.relative_rad, sign, v);
        return v3_turn_z(v, cos(pose.relative_rad), sin(pose.relative_rad));
    }
    double relative = pose.relative_rad + world->arc.zero, turn = pose.turntable_rad;
    if (!world->arc.crooked && !(world->wobble > 0))
        return v3_turn_z(v, cos(relative), sin(relative));
    struct v3 rig =
        (point ? optics_arc_point : optics_arc_direction)(&world->arc, pose.relative_rad + turn, v);
    return v3_turn_z(lean(world, turn, sign, rig), cos(-turn), sin(-turn));
}

struct optics_lamp world_lamp_at(const World *world, int lamp, struct light_pose pose) {
    struct optics_lamp at = world->lamps[lamp];
    if (world->lamp_on_probe[lamp]) {
        const double angle = RAD(pose.probe_deg);
        at.position_mm = optics_swing_point(&world->probe, angle, at.position_mm);
        at.aim = optics_swing_direction(&world->probe, angle, at.aim);
    }
    at.position_mm = place(world, pose, at.position_mm, TRUE);
    at.aim = place(world, pose, at.aim, FALSE);
    return at;
}

struct optics_laser world_laser_at(const World *world, int laser, struct light_pose pose) {
    struct optics_laser at = world->lasers[laser];
    at.position_mm = place(world, pose, at.position_mm, TRUE);
    at.axis = place(world, pose, at.axis, FALSE);
    at.forward = place(world, pose, at.forward, FALSE);
    return at;
}

struct optics_camera world_camera_at(const World *world, int camera, double arm_deg) {
    struct optics_camera at = world->cameras[camera];
    const double angle = RAD(arm_deg);
    if (!world->camera_on_arm[camera])
        return at;
    at.centre_mm = optics_swing_point(&world->arm, angle, at.centre_mm);
    at.right = optics_swing_direction(&world->arm, angle, at.right);
    at.down = optics_swing_direction(&world->arm, angle, at.down);
    at.forward = optics_swing_direction(&world->arm, angle, at.forward);
    return at;
}

/* Converts a vector, or a point, from the rig frame to the sample frame. */
static struct v3 to_sample(const World *world, double turntable_deg, struct v3 v) {
    double angle = -RAD(whole_turn(turntable_deg));
    return v3_turn_z(lean(world, -angle, -1, v), cos(angle), sin(angle));
}

struct v3 world_eye_mm(const World *world, const struct optics_camera *camera,
                       double turntable_deg) {
    return to_sample(world, turntable_deg, camera->centre_mm);
}

struct view_job {
    const World *world;
    int camera;
    struct optics_camera at; /* the camera in its present pose */
    double arm_deg, turntable_deg;
    /* of the light; 0: each pixel has the magnification of its filter's colour */
    double magnification;
    const struct spread *spread;
    /* rays, surfaces and hit are for one row of the picture. */
    struct v3 *rays;
    struct surface *surfaces;
    gboolean *hit;
};

/* Returns the viewing ray through a point of the picture, for light of a colour, in the sample
 * frame. */
static struct v3 view_ray(const struct view_job *job, enum cfa_colour colour, double x_px,
                          double y_px) {
    const struct optics_camera *at = &job->at;
    const double pure[3] = {colour == CFA_RED, colour == CFA_GREEN, colour == CFA_BLUE};
    const double m = job->magnification > 0 ? job->magnification : optics_magnification(at, pure);
    if (m != 1) {
        x_px = at->centre_x_px + (x_px - at->centre_x_px) / m;
        y_px = at->centre_y_px + (y_px - at->centre_y_px) / m;
    }
    return to_sample(job->world, job->turntable_deg, optics_ray(at, x_px, y_px));
}

static void add_point(GArray *points, const struct surface *surface, enum cfa_colour colour,
                      guint32 pixel) {
    struct point point;
    world_pack(surface, colour, pixel, &point);
    g_array_append_val(points, point);
}

/* Adds the points of a pixel to points. Sets *ret_weight to the weight of each point (struct view).
 * One point is enough for a pixel that shows only the turntable, because the turntable has no
 * detail. */
static void add_pixel(const struct view_job *job, int x, int y, GArray *points, float *ret_weight) {
    const struct optics_camera *camera = &job->world->cameras[job->camera];
    int n = job->world->supersample * job->world->supersample, sample = 0;
    const struct surface *surfaces = job->surfaces + x * n;
    const gboolean *hit = job->hit + x * n;
    for (int i = 0; i < n; i++)
        sample += hit[i] && surfaces[i].triangle != NO_TRIANGLE;
    enum cfa_colour colour = cfa_colour_at(camera->cfa, x, y);
    *ret_weight = (float)optics_response(camera, x, y, colour);
    guint32 pixel = (guint32)(y * camera->width + x);
    if (sample > 0) {
        *ret_weight /= (float)n;
        for (int i = 0; i < n; i++)
            if (hit[i])
                add_point(points, &surfaces[i], colour, pixel);
        return;
    }
    struct v3 eye = world_eye_mm(job->world, &job->at, job->turntable_deg);
    struct v3 ray = view_ray(job, colour, x, y);
    struct surface table;
    gboolean seen;
    scene_trace(&job->world->scene, eye, NULL, &ray, 1, &table, &seen);
    if (seen)
        add_point(points, &table, colour, pixel);
}

static void trace_row(const struct view_job *job, int y) {
    const struct optics_camera *camera = &job->world->cameras[job->camera];
    int aa = job->world->supersample, k = 0;
    const float *low = job->world->scene.low, *high = job->world->scene.high;
    guint64 sample = sample_hash(world_bits((double)low[0] + (double)high[1])) ^
                     sample_hash(world_bits((double)low[1] - (double)high[0] + (double)high[2]));
    struct sample_random random = {
        sample_hash(world_bits(whole_turn(job->turntable_deg)) + sample +
                    world_carried_bits(job->world->camera_on_arm[job->camera], job->arm_deg) +
                    (guint64)job->camera * 8191 + (guint64)y * 0x9e3779b97f4a7c15u)};
    double at[2 * MAX_SAMPLES];
    for (int i = 0; i < aa * aa; i++) {
        const int row_of = i / aa;
        at[2 * i] = (i % aa + 0.5) / aa - 0.5;
        at[2 * i + 1] = (row_of + 0.5) / aa - 0.5;
    }
    for (int x = 0; x < camera->width; x++) {
        if (camera->blur_px > 0)
            spread_pixel(job->spread, &random, aa, at);
        const enum cfa_colour colour = cfa_colour_at(camera->cfa, x, y);
        for (int i = 0; i < aa * aa; i++)
            job->rays[k++] = view_ray(job, colour, x + at[2 * i], y + at[2 * i + 1]);
    }
    struct v3 eye = world_eye_mm(job->world, &job->at, job->turntable_deg);
    scene_trace(&job->world->scene, eye, NULL, job->rays, k, job->surfaces, job->hit);
}

static gpointer make_view(const struct cache_key *key, gconstpointer data, gsize *ret_bytes) {
    struct view_job own = *(const struct view_job *)data, *job = &own;
    const struct optics_camera *camera = &job->world->cameras[job->camera];
    struct spread spread;
    if (camera->blur_px > 0)
        spread_init(&spread, camera->blur_px);
    job->spread = &spread;
    gsize n = (gsize)camera->width * (gsize)(job->world->supersample * job->world->supersample);
    g_autofree struct v3 *rays = g_new(struct v3, n);
    g_autofree struct surface *surfaces = g_new(struct surface, n);
    g_autofree gboolean *hit = g_new(gboolean, n);
    job->rays = rays;
    job->surfaces = surfaces;
    job->hit = hit;
    gsize n_pixels = (gsize)camera->width * (gsize)camera->height;
    g_autofree float *weights = g_new(float, n_pixels);
    g_autoptr(GArray) points =
        g_array_sized_new(FALSE, FALSE, sizeof(struct point), (guint)n_pixels);
    for (int y = 0; y < camera->height; y++) {
        trace_row(job, y);
        for (int x = 0; x < camera->width; x++)
            add_pixel(job, x, y, points, &weights[y * camera->width + x]);
    }
    gsize before = sizeof(struct view) + points->len * sizeof(struct point);
    *ret_bytes = before + n_pixels * sizeof(float);
    struct view *view = g_malloc(*ret_bytes);
    view->eye_mm = world_eye_mm(job->world, &job->at, job->turntable_deg);
    view->n = points->len;
    view->weights = memcpy((char *)view + before, weights, n_pixels * sizeof(float));
    if (points->len)
        memcpy(view->points, points->data, points->len * sizeof(struct point));
    return view;
}

struct cache_entry *world_view(World *world, int camera, double arm_deg, double turntable_deg,
                               double magnification) {
    struct view_job job = {.world = world,
                           .camera = camera,
                           .at = world_camera_at(world, camera, arm_deg),
                           .arm_deg = arm_deg,
                           .turntable_deg = turntable_deg,
                           .magnification = magnification};
    const guint64 light = magnification > 0 ? sample_hash(world_bits(magnification)) : 0;
    struct cache_key key = {{CACHED_VIEW, (guint64)camera ^ light,
                             world_bits(whole_turn(turntable_deg)),
                             world_carried_bits(world->camera_on_arm[camera], arm_deg)}};
    return cache_get(world->cache, &key, make_view, &job);
}

struct bounce_job {
    const World *world;
    int lamp;
    struct light_pose pose;
};

static gpointer make_bounce(const struct cache_key *key, gconstpointer data, gsize *ret_bytes) {
    const struct bounce_job *job = data;
    const struct scene *scene = &job->world->scene;
    *ret_bytes = (gsize)scene->n_vertices * 3 * sizeof(float);
    float *bounce = g_malloc0(*ret_bytes);
    if (scene->n_gather == 0)
        return bounce;
    struct optics_lamp lamp = world_lamp_at(job->world, job->lamp, job->pose);
    g_autofree float *direct = g_new0(float, scene->n_vertices); /* irradiance */
    struct surface surfaces[SCENE_BATCH];
    guint8 blocked[SCENE_BATCH];
    for (guint first = 0; first < scene->n_vertices; first += SCENE_BATCH) {
        int n = scene_light_vertices(scene, first, lamp.position_mm, surfaces, blocked);
        for (int i = 0; i < n; i++) {
            const struct surface *s = &surfaces[i];
            if (!blocked[i])
                direct[first + (guint)i] =
                    (float)optics_lamp_irradiance(&lamp, v3(s->p[0], s->p[1], s->p[2])) *
                    scene_reflect(s, lamp.position_mm, lamp.position_mm, CFA_GREEN);
        }
    }
    float share = 1.0f / (float)scene->n_gather;
    const guint32 *gather = scene->gather;
    for (guint i = 0; i < scene->n_vertices; i++, gather += scene->n_gather) {
        for (int k = 0; k < scene->n_gather; k++) {
            if (gather[k] == NO_TRIANGLE)
                continue;
            float e = direct[gather[k]] * share;
            const float *albedo = scene->vertices[gather[k]].albedo;
            for (int c = 0; c < 3; c++)
                bounce[3 * i + (guint)c] += e * albedo[c];
        }
    }
    return bounce;
}

struct cache_entry *world_bounce(World *world, int lamp, struct light_pose pose) {
    struct bounce_job job = {world, lamp, pose};
    const guint64 probe = world_carried_bits(world->lamp_on_probe[lamp], pose.probe_deg);
    struct cache_key key = {{CACHED_BOUNCE, (guint64)lamp ^ probe, world_bits(pose.relative_rad),
                             world_bits(pose.turntable_rad)}};
    return cache_get(world->cache, &key, make_bounce, &job);
}

float world_bounce_at(const World *world, const float *bounce, const struct surface *s,
                      enum cfa_colour colour) {
    if (s->triangle == NO_TRIANGLE)
        return 0;
    const guint32 *corners = world->scene.triangles[s->triangle];
    return bounce[3 * corners[0] + colour] * (1 - s->u - s->v) +
           bounce[3 * corners[1] + colour] * s->u + bounce[3 * corners[2] + colour] * s->v;
}

struct picture_job {
    World *world;
    int camera, lamp;
    double arm_deg, turntable_deg;
    struct light_pose pose;
};

/* Makes the picture of world_lamp_picture(). A pixel is the sum over its points of the direct light
 * and of the light after one bounce. */
static gpointer make_picture(const struct cache_key *key, gconstpointer data, gsize *ret_bytes) {
    const struct picture_job *job = data;
    World *world = job->world;
    const struct optics_camera *camera = &world->cameras[job->camera];
    struct light_pose pose = job->pose;
    struct optics_lamp lamp = world_lamp_at(world, job->lamp, pose);
    struct cache_entry *bounce = world_bounce(world, job->lamp, pose);
    struct cache_entry *entry = world_view(world, job->camera, job->arm_deg, job->turntable_deg, 0);
    const struct view *view = entry->value;
    struct surface surfaces[SCENE_BATCH];
    guint8 blocked[SCENE_BATCH];
    *ret_bytes = (gsize)camera->width * (gsize)camera->height * sizeof(float);
    float *picture = g_malloc0(*ret_bytes);
    for (guint first = 0; first < view->n; first += SCENE_BATCH) {
        int n = world_light_points(world, view, first, lamp.position_mm, surfaces, blocked);
        for (int i = 0; i < n; i++) {
            const struct surface *s = &surfaces[i];
            guint32 pixel = view->points[first + (guint)i].pixel;
            enum cfa_colour colour = world_pixel_colour(camera, pixel);
            float radiance = 0;
            if (!blocked[i]) {
                float e = (float)optics_lamp_irradiance(&lamp, v3(s->p[0], s->p[1], s->p[2]));
                radiance = e * scene_reflect(s, lamp.position_mm, view->eye_mm, colour);
            }
            radiance += s->albedo[colour] * (float)M_1_PI *
                        world_bounce_at(world, bounce->value, s, colour);
            picture[pixel] += view->weights[pixel] * radiance;
        }
    }
    cache_release(world->cache, entry);
    cache_release(world->cache, bounce);
    return picture;
}

struct cache_entry *world_lamp_picture(World *world, int camera, int lamp,
                                       const struct world_state *state) {
    struct picture_job job = {
        world,
        camera,
        lamp,
        state->arm_deg,
        state->turntable_deg,
        world_lamp_pose(world, lamp, state->arc_deg, state->probe_deg, state->turntable_deg)};
    const guint64 arm = world_carried_bits(world->camera_on_arm[camera], state->arm_deg);
    const guint64 probe = world_carried_bits(world->lamp_on_probe[lamp], state->probe_deg);
    struct cache_key key = {{CACHED_PICTURE | (guint64)camera << 8 | (guint64)lamp << 16,
                             world_bits(whole_turn(state->turntable_deg)),
                             world_bits(job.pose.relative_rad), arm ^ (probe << 1 | probe >> 63)}};
    return cache_get(world->cache, &key, make_picture, &job);
}
