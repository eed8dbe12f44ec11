#include "trace_surface.h"

/* A query to the material library. v of the library increases along the texture's rows, downwards.
 */
struct query {
    float uv[2], view[3], light[3];
};

static void query_direction(struct vec3 d, float ret[3]) {
    ret[0] = (float)d.x;
    ret[1] = (float)d.y;
    ret[2] = (float)d.z;
}

static struct query query_of(const struct trace_surface *s, struct trace_texel at, struct vec3 view,
                             struct vec3 light) {
    const double u = at.u * s->tiles, v = -at.v * s->tiles;
    /* Coordinates are reduced to one tile, so that they keep their precision as floats. */
    struct query q = {.uv = {(float)(u - floor(u)), (float)(v - floor(v))}};
    query_direction(view, q.view);
    query_direction(light, q.light);
    return q;
}

static void surface_measured(const struct trace_surface *s, const struct query *q,
                             double ret_rgb[3]) {
    float rgb[3] = {0.0F, 0.0F, 0.0F};
    mesorig_material_evaluate(s->material, 1, q->uv, q->view, q->light, NULL, rgb);
    for (int c = 0; c < 3; c++) /* f cos θ_l = value / π; a codec may produce negative values */
        ret_rgb[c] = rgb[c] > 0.0F ? (double)rgb[c] / G_PI : 0.0;
}

/* Returns the properties of a surface without a captured material at a point. */
static struct trace_plain surface_plain(const struct trace_surface *s, struct trace_texel at) {
    struct trace_plain ret = s->plain;
    double rgb[3];
    if (s->texture == NULL)
        return ret;
    trace_texture_colour(s->texture, at.u, at.v, rgb);
    for (int c = 0; c < 3; c++)
        ret.base[c] *= rgb[c];
    return ret;
}

void trace_surface_evaluate(const struct trace_surface *s, struct trace_texel at, struct vec3 view,
                            struct vec3 light, double ret_rgb[3]) {
    ret_rgb[0] = ret_rgb[1] = ret_rgb[2] = 0.0;
    if (view.z <= 0.0 || light.z <= 0.0)
        return;
    if (s->material == NULL) {
        const struct trace_plain plain = surface_plain(s, at);
        trace_plain_evaluate(&plain, view, light, ret_rgb);
        return;
    }
    const struct query q = query_of(s, at, view, light);
    surface_measured(s, &q, ret_rgb);
}

double trace_surface_draw(const struct trace_surface *s, struct trace_texel at, struct vec3 view,
                          enum trace_drawing drawing, struct trace_random *random,
                          struct vec3 *ret_light, double ret_rgb[3]) {
    const double a = trace_random_next(random), b = trace_random_next(random);
    const double c = trace_random_next(random);
    double density;
    ret_rgb[0] = ret_rgb[1] = ret_rgb[2] = 0.0;
    if (view.z <= 0.0)
        return 0.0;
    if (drawing == TRACE_DRAW_EVENLY) {
        const double flat = sqrt(fmax(1.0 - a * a, 0.0)), turn = 2.0 * G_PI * b;
        *ret_light = vec3(flat * cos(turn), flat * sin(turn), a);
        density = 1.0 / (2.0 * G_PI);
    } else if (s->material == NULL) {
        const struct trace_plain plain = surface_plain(s, at);
        density = trace_plain_draw(&plain, view, (const double[3]){a, b, c}, ret_light);
    } else {
        const struct query q = query_of(s, at, view, vec3(0, 0, 1));
        const float numbers[2] = {(float)a, (float)b};
        float light[3] = {0.0F, 0.0F, 0.0F}, found = 0.0F;
        mesorig_material_sample(s->material, 1, q.uv, q.view, NULL, numbers, light, &found);
        *ret_light = vec3((double)light[0], (double)light[1], (double)light[2]);
        density = (double)found;
    }
    if (!(density > 0.0) || ret_light->z <= 0.0)
        return 0.0;
    trace_surface_evaluate(s, at, view, *ret_light, ret_rgb);
    return density;
}

double trace_surface_density(const struct trace_surface *s, struct trace_texel at, struct vec3 view,
                             struct vec3 light, enum trace_drawing drawing) {
    float density = 0.0F;
    if (view.z <= 0.0 || light.z <= 0.0)
        return 0.0;
    if (drawing == TRACE_DRAW_EVENLY)
        return 1.0 / (2.0 * G_PI);
    if (s->material == NULL) {
        const struct trace_plain plain = surface_plain(s, at);
        return trace_plain_density(&plain, view, light);
    }
    const struct query q = query_of(s, at, view, light);
    mesorig_material_pdf(s->material, 1, q.uv, q.view, q.light, NULL, &density);
    return (double)density;
}
