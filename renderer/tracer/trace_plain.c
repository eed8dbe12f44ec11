#include "trace_plain.h"

#include <glib.h>

#define MIN_ALPHA  1e-3 /* minimum of α; smoother surfaces get this α */
#define DIELECTRIC 0.04 /* F0 for a refractive index of 1.5 */

static double plain_alpha(const struct trace_plain *p) {
    return fmax(p->roughness * p->roughness, MIN_ALPHA);
}

static double plain_fresnel(double f0, double f90, double cos_half) {
    const double left = 1.0 - CLAMP(cos_half, 0.0, 1.0);
    return f0 + (f90 - f0) * left * left * left * left * left;
}

/* Returns Smith's Λ of the direction d for GGX. */
static double plain_lambda(double alpha, struct vec3 d) {
    const double z2 = d.z * d.z;
    return 0.5 * (sqrt(1.0 + alpha * alpha * (1.0 - z2) / z2) - 1.0);
}

static double plain_facets(double alpha, struct vec3 half) {
    const double a2 = alpha * alpha, s = half.z * half.z * (a2 - 1.0) + 1.0;
    return a2 / (G_PI * s * s);
}

/* Returns the probability with which a direction is drawn for the highlight, and not for the
 * diffuse part. */
static double plain_share(const struct trace_plain *p, struct vec3 view) {
    const double m = p->metallic, brightest = fmax(p->base[0], fmax(p->base[1], p->base[2]));
    const double highlight = plain_fresnel(DIELECTRIC * p->specular * (1.0 - m) + brightest * m,
                                           p->specular * (1.0 - m) + m, view.z);
    const double rest = (1.0 - m) * brightest;
    if (highlight <= 0.0)
        return 0.0;
    return rest > 0.0 ? CLAMP(highlight / (highlight + rest), 0.1, 0.9) : 1.0;
}

void trace_plain_evaluate(const struct trace_plain *p, struct vec3 view, struct vec3 light,
                          double ret_rgb[3]) {
    ret_rgb[0] = ret_rgb[1] = ret_rgb[2] = 0.0;
    if (view.z <= 0.0 || light.z <= 0.0)
        return;
    const struct vec3 half = vec3_unit(vec3_add(view, light));
    const double cos_half = vec3_dot(view, half), alpha = plain_alpha(p), m = p->metallic;
    const double facets = plain_facets(alpha, half) /
                          (1.0 + plain_lambda(alpha, view) + plain_lambda(alpha, light)) /
                          (4.0 * view.z);
    const double f0 = DIELECTRIC * p->specular;
    const double rest = (1.0 - m) * (1.0 - plain_fresnel(f0, p->specular, view.z)) *
                        (1.0 - plain_fresnel(f0, p->specular, light.z));
    for (int c = 0; c < 3; c++)
        ret_rgb[c] = rest * p->base[c] / G_PI * light.z +
                     facets * plain_fresnel(f0 * (1.0 - m) + p->base[c] * m,
                                            p->specular * (1.0 - m) + m, cos_half);
}

double trace_plain_density(const struct trace_plain *p, struct vec3 view, struct vec3 light) {
    if (view.z <= 0.0 || light.z <= 0.0)
        return 0.0;
    const struct vec3 half = vec3_unit(vec3_add(view, light));
    const double alpha = plain_alpha(p), share = plain_share(p, view);
    /* The density of visible normals is G1 D v·h / v·n. For directions, it is multiplied by dh / dl
     * = 1 / (4 v·h). */
    const double visible =
        plain_facets(alpha, half) / (1.0 + plain_lambda(alpha, view)) / (4.0 * view.z);
    return share * visible + (1.0 - share) * light.z / G_PI;
}

static struct vec3 plain_cosine(double a, double b) {
    const double r = sqrt(a);
    return vec3(r * cos(2.0 * G_PI * b), r * sin(2.0 * G_PI * b), sqrt(fmax(1.0 - a, 0.0)));
}

/* Draws a visible normal (Heitz 2018): stretches the view by alpha, draws a point of the hemisphere
 * around the stretched view, and also stretches that point by alpha. */
static struct vec3 plain_visible_normal(double alpha, struct vec3 view, double a, double b) {
    const struct vec3 v = vec3_unit(vec3(alpha * view.x, alpha * view.y, view.z));
    const double flat = hypot(v.x, v.y);
    const struct vec3 across = flat > 1e-9 ? vec3(-v.y / flat, v.x / flat, 0.0) : vec3(1, 0, 0);
    const struct vec3 along = vec3_cross(v, across);
    const double r = sqrt(a), turn = 2.0 * G_PI * b, s = 0.5 * (1.0 + v.z);
    const double x = r * cos(turn);
    const double y = (1.0 - s) * sqrt(fmax(1.0 - x * x, 0.0)) + s * r * sin(turn);
    const double z = sqrt(fmax(1.0 - x * x - y * y, 0.0));
    const struct vec3 n =
        vec3_add(vec3_add(vec3_scale(across, x), vec3_scale(along, y)), vec3_scale(v, z));
    return vec3_unit(vec3(alpha * n.x, alpha * n.y, fmax(n.z, 1e-9)));
}

double trace_plain_draw(const struct trace_plain *p, struct vec3 view, const double random[3],
                        struct vec3 *ret_light) {
    if (view.z <= 0.0)
        return 0.0;
    if (random[0] < plain_share(p, view)) {
        const struct vec3 half = plain_visible_normal(plain_alpha(p), view, random[1], random[2]);
        *ret_light = vec3_sub(vec3_scale(half, 2.0 * vec3_dot(view, half)), view);
    } else {
        *ret_light = plain_cosine(random[1], random[2]);
    }
    return trace_plain_density(p, view, *ret_light);
}
