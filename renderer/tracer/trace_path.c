#include "trace_path.h"

#include "base/direction.h"

#define BLOCK    16 /* width and height of a block of pixels that a thread takes */
#define ROULETTE 4  /* number of reflections before a path may end at random */

const struct trace_options trace_options_default = {
    .width = 640, .height = 480, .samples = 64, .depth = 16, .seed = 1, .lamps_too = TRUE};

/* A path that is being followed. */
struct path {
    const TraceScene *scene;
    const struct trace_options *options;
    struct trace_random random;
    double share[3]; /* share of the light at the end of the path that reaches the camera */
    double light[3]; /* light found so far */
};

struct render {
    const TraceScene *scene;
    const struct trace_options *options;
    TracePicture *picture;
    int n_across; /* number of blocks in a row of blocks */
};

static struct vec3 path_world(const struct trace_hit *hit, struct vec3 d) {
    return vec3_add(vec3_add(vec3_scale(hit->x, d.x), vec3_scale(hit->y, d.y)),
                    vec3_scale(hit->z, d.z));
}

static struct vec3 path_local(const struct trace_hit *hit, struct vec3 d) {
    return vec3(vec3_dot(d, hit->x), vec3_dot(d, hit->y), vec3_dot(d, hit->z));
}

/* Returns the weight of a sample by the power heuristic with β = 2. There are two ways to draw the
 * sample. own is the density of the way in which it was drawn, and other that of the other way. */
static double path_weight(double own, double other) {
    return own * own / (own * own + other * other);
}

static void path_add(struct path *path, const double reflected[3], const double radiance[3],
                     double factor) {
    for (int c = 0; c < 3; c++)
        path->light[c] += path->share[c] * reflected[c] * radiance[c] * factor;
}

/* Sets ret_rgb to f cos θ_l for light from the direction `towards`. Returns FALSE if this is 0, or
 * if the direction is behind the triangle. The second case is tested with the triangle's normal,
 * because an interpolated normal may not show it. */
static gboolean path_reflects(const struct trace_hit *hit, struct vec3 view, struct vec3 towards,
                              double ret_rgb[3]) {
    if (vec3_dot(towards, hit->facet) <= 0.0)
        return FALSE;
    trace_surface_evaluate(hit->surface, hit->texel, view, path_local(hit, towards), ret_rgb);
    return ret_rgb[0] > 0.0 || ret_rgb[1] > 0.0 || ret_rgb[2] > 0.0;
}

static void path_look_for_sky(struct path *path, const struct trace_hit *hit, struct vec3 view) {
    const double random[2] = {trace_random_next(&path->random), trace_random_next(&path->random)};
    double radiance[3], reflected[3];
    struct vec3 towards;
    const double density = trace_sky_draw(path->scene->sky, random, &towards, radiance);
    if (!(density > 0.0) || !path_reflects(hit, view, towards, reflected) ||
        !trace_scene_is_free(path->scene, trace_scene_leave(path->scene, hit, towards), towards,
                             INFINITY))
        return;
    const double other = trace_surface_density(hit->surface, hit->texel, view,
                                               path_local(hit, towards), path->options->drawing);
    path_add(path, reflected, radiance, path_weight(density, other) / density);
}

/* Returns the density per solid angle with which path_look_for_area() draws the direction `towards`
 * to a point of area k. Returns 0 if this area faces away. */
static double area_density(const TraceScene *scene, gsize k, struct vec3 towards, double distance) {
    const struct trace_area *area = &g_array_index(scene->areas, struct trace_area, k);
    const double cos_area = -vec3_dot(area->normal, towards);
    if (cos_area <= 1e-9 || area->area <= 0.0)
        return 0.0;
    return trace_choice_share(&scene->lit, k) / area->area * distance * distance / cos_area;
}

static void path_look_for_area(struct path *path, const struct trace_hit *hit, struct vec3 view) {
    const TraceScene *scene = path->scene;
    const gsize k = trace_choice_draw(&scene->lit, trace_random_next(&path->random));
    const struct trace_area *area = &g_array_index(scene->areas, struct trace_area, k);
    /* Evenly distributed barycentric coordinates in a triangle are (1 − √a, b √a), with random a
     * and b. */
    const double root = sqrt(trace_random_next(&path->random));
    const double b = trace_random_next(&path->random) * root;
    const struct vec3 at = vec3_add(area->corner, vec3_add(vec3_scale(area->edges[0], 1.0 - root),
                                                           vec3_scale(area->edges[1], b)));
    const struct vec3 way = vec3_sub(at, hit->position);
    const double distance = vec3_length(way);
    double reflected[3];
    if (!(distance > 0.0))
        return;
    const struct vec3 towards = vec3_scale(way, 1.0 / distance);
    const double density = area_density(scene, k, towards, distance);
    if (!(density > 0.0) || !path_reflects(hit, view, towards, reflected) ||
        !trace_scene_is_free(scene, trace_scene_leave(scene, hit, towards), towards, distance))
        return;
    const double other = trace_surface_density(hit->surface, hit->texel, view,
                                               path_local(hit, towards), path->options->drawing);
    path_add(path, reflected, area->emission, path_weight(density, other) / density);
}

/* Returns the share of a spot lamp's intensity in a direction, as glTF defines it. cos_off is the
 * cosine of the angle between the direction and the axis of the lamp. The share is 1 within the
 * inner cone, and 0 outside the outer cone. Between the cones, it is the square of a linear
 * function of cos_off. */
static double lamp_cone(const struct gltf_lamp *lamp, double cos_off) {
    const double range = fmax(lamp->inner_cos - lamp->outer_cos, 1e-3);
    const double inside = CLAMP((cos_off - lamp->outer_cos) / range, 0.0, 1.0);
    return inside * inside;
}

static void path_look_for_lamp(struct path *path, const struct trace_hit *hit, struct vec3 view,
                               const struct gltf_lamp *lamp) {
    const struct vec3 shines = vec3(lamp->towards[0], lamp->towards[1], lamp->towards[2]);
    struct vec3 towards = vec3_scale(shines, -1.0);
    double distance = INFINITY, factor = 1.0, reflected[3];
    if (lamp->kind != GLTF_LAMP_DIRECTIONAL) {
        const struct vec3 at = vec3(lamp->position[0], lamp->position[1], lamp->position[2]);
        const struct vec3 way = vec3_sub(at, hit->position);
        distance = vec3_length(way);
        if (!(distance > 0.0))
            return;
        towards = vec3_scale(way, 1.0 / distance);
        factor = 1.0 / (distance * distance);
        if (lamp->kind == GLTF_LAMP_SPOT)
            factor *= lamp_cone(lamp, -vec3_dot(towards, shines));
    }
    if (factor > 0.0 && path_reflects(hit, view, towards, reflected) &&
        trace_scene_is_free(path->scene, trace_scene_leave(path->scene, hit, towards), towards,
                            distance))
        path_add(path, reflected, lamp->rgb, factor);
}

static void path_look_for_lights(struct path *path, const struct trace_hit *hit, struct vec3 view) {
    const TraceScene *scene = path->scene;
    if (scene->sky != NULL)
        path_look_for_sky(path, hit, view);
    if (scene->lit.n > 0)
        path_look_for_area(path, hit, view);
    for (guint k = 0; k < scene->lamps->len; k++)
        path_look_for_lamp(path, hit, view, &g_array_index(scene->lamps, struct gltf_lamp, k));
}

/* Adds the light that a path meets. drawn is the density with which the direction of the path was
 * drawn from the surface. other is the density with which the light could have been sampled
 * directly. drawn is 0 for a ray from the camera, because the light that this ray meets can be
 * found in no other way. */
static void path_take(struct path *path, const double radiance[3], double drawn, double other) {
    const double all[3] = {1.0, 1.0, 1.0};
    path_add(path, all, radiance,
             drawn > 0.0 && path->options->lamps_too ? path_weight(drawn, other) : 1.0);
}

/* Ends a path of little light at random (Russian roulette). Returns FALSE if the path ends. A path
 * without any light left always ends. If the path survives the draw, path->share is increased to
 * compensate. */
static gboolean path_survives(struct path *path, int depth) {
    const double most = fmax(path->share[0], fmax(path->share[1], path->share[2]));
    if (!(most > 0.0))
        return FALSE;
    if (depth < ROULETTE || most >= 1.0)
        return TRUE;
    if (trace_random_next(&path->random) >= most)
        return FALSE;
    for (int c = 0; c < 3; c++)
        path->share[c] /= most;
    return TRUE;
}

static void path_follow(struct path *path, struct vec3 from, struct vec3 direction) {
    const TraceScene *scene = path->scene;
    double drawn = 0.0;
    for (int depth = 0;; depth++) {
        struct trace_hit hit;
        double radiance[3], reflected[3];
        struct vec3 light;
        if (!trace_scene_hit(scene, from, direction, &hit)) {
            if (scene->sky == NULL)
                return;
            trace_sky_radiance(scene->sky, direction, radiance);
            path_take(path, radiance, drawn, trace_sky_density(scene->sky, direction));
            return;
        }
        if (hit.area >= 0)
            path_take(path, hit.surface->emission, drawn,
                      area_density(scene, (gsize)hit.area, direction, hit.distance));
        if (depth >= path->options->depth)
            return;
        const struct vec3 view = path_local(&hit, vec3_scale(direction, -1.0));
        if (path->options->lamps_too)
            path_look_for_lights(path, &hit, view);
        drawn = trace_surface_draw(hit.surface, hit.texel, view, path->options->drawing,
                                   &path->random, &light, reflected);
        if (!(drawn > 0.0))
            return;
        direction = vec3_unit(path_world(&hit, light));
        if (vec3_dot(direction, hit.facet) <= 0.0)
            return;
        for (int c = 0; c < 3; c++)
            path->share[c] *= reflected[c] / drawn;
        if (!path_survives(path, depth))
            return;
        from = trace_scene_leave(scene, &hit, direction);
    }
}

static void camera_ray(const struct trace_camera *camera, double x, double y, double aspect,
                       struct vec3 *ret_direction) {
    const double half = tan(0.5 * camera->fov_y_rad);
    *ret_direction = vec3_unit(vec3_sub(
        vec3_add(vec3_scale(camera->right, x * half * aspect), vec3_scale(camera->up, y * half)),
        camera->back));
}

static void pixel(const struct render *render, int x, int y) {
    const struct trace_options *o = render->options;
    const gsize at = (gsize)y * (gsize)o->width + (gsize)x;
    double sum[3] = {0.0}, mean = 0.0, squares = 0.0;
    for (int k = 0; k < o->samples; k++) {
        struct path path = {
            render->scene, o, trace_random_new(o->seed, at, (guint64)k), {1.0, 1.0, 1.0}, {0.0}};
        const double px = (x + trace_random_next(&path.random)) / o->width * 2.0 - 1.0;
        const double py = 1.0 - (y + trace_random_next(&path.random)) / o->height * 2.0;
        struct vec3 direction;
        camera_ray(&render->scene->camera, px, py, (double)o->width / o->height, &direction);
        path_follow(&path, render->scene->camera.eye, direction);
        const double luminance =
            0.2126 * path.light[0] + 0.7152 * path.light[1] + 0.0722 * path.light[2];
        const double off = luminance - mean;
        mean += off / (k + 1);
        squares += off * (luminance - mean);
        for (int c = 0; c < 3; c++)
            sum[c] += path.light[c];
    }
    for (int c = 0; c < 3; c++)
        render->picture->rgb[3 * at + (gsize)c] = (float)(sum[c] / o->samples);
    render->picture->variance[at] = o->samples > 1 ? (float)(squares / (o->samples - 1)) : 0.0F;
}

static void trace_block(int block, gpointer data) {
    const struct render *render = data;
    const int x0 = block % render->n_across * BLOCK, y0 = block / render->n_across * BLOCK;
    for (int y = y0; y < MIN(y0 + BLOCK, render->options->height); y++)
        for (int x = x0; x < MIN(x0 + BLOCK, render->options->width); x++)
            pixel(render, x, y);
}

static gboolean option_fail(const char *name, gint64 value, gint64 least, gint64 most,
                            GError **error) {
    if (value >= least && value <= most)
        return TRUE;
    g_set_error(error, TRACE_ERROR, TRACE_ERROR_SETTING,
                "%s: %" G_GINT64_FORMAT " is out of range: %" G_GINT64_FORMAT
                " to %" G_GINT64_FORMAT,
                name, value, least, most);
    return FALSE;
}

gboolean trace_options_check(const struct trace_options *o, GError **error) {
    return option_fail("--size, width", o->width, 1, TRACE_MAX_SIDE, error) &&
           option_fail("--size, height", o->height, 1, TRACE_MAX_SIDE, error) &&
           option_fail("--size, number of pixels", (gint64)o->width * o->height, 1,
                       TRACE_MAX_PIXELS, error) &&
           option_fail("--samples", o->samples, 1, TRACE_MAX_SAMPLES, error) &&
           option_fail("--depth", o->depth, 0, TRACE_MAX_DEPTH, error);
}

void trace_picture_free(TracePicture *picture) {
    if (picture == NULL)
        return;
    g_free(picture->rgb);
    g_free(picture->variance);
    g_free(picture);
}

TracePicture *trace_render(const TraceScene *scene, const struct trace_options *options,
                           const struct work *work, GError **error) {
    if (!trace_options_check(options, error))
        return NULL;
    const gsize n = (gsize)options->width * (gsize)options->height;
    g_autoptr(TracePicture) picture = g_new0(TracePicture, 1);
    picture->width = options->width;
    picture->height = options->height;
    picture->rgb = g_new0(float, 3 * n);
    picture->variance = g_new0(float, n);
    struct render render = {scene, options, picture, (options->width + BLOCK - 1) / BLOCK};
    const int n_down = (options->height + BLOCK - 1) / BLOCK;
    if (!work_parallel(work, "trace", render.n_across * n_down, trace_block, &render, error))
        return NULL;
    return g_steal_pointer(&picture);
}
