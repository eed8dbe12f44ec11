#include "maps_model.h"

#include <math.h>

#define MIN_COSINE 1e-4

static double dot(const double a[3], const double b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

double maps_lobe(double alpha, double nl, double nv, double nh) {
    const double a2 = alpha * alpha, s = nh * nh * (a2 - 1) + 1;
    const double d = a2 / (G_PI * s * s);
    const double lv = nl * sqrt(nv * nv * (1 - a2) + a2), ll = nv * sqrt(nl * nl * (1 - a2) + a2);
    return d * 0.5 / MAX(lv + ll, MIN_COSINE * MIN_COSINE);
}

/* Returns L(x), from which sheen_lambda() makes Λ (Estevez & Kulla 2017, eq. 3), with the
 * coefficients of their table interpolated between the roughnesses 0 and 1. */
static double sheen_curve(double x, double alpha) {
    const double k = (1 - alpha) * (1 - alpha);
    const double a = 21.5473 + k * (25.3245 - 21.5473), b = 3.82987 + k * (3.32435 - 3.82987);
    const double c = 0.19823 + k * (0.16801 - 0.19823), d = -1.97760 + k * (-1.27393 + 1.97760);
    const double e = -4.32054 + k * (-4.85967 + 4.32054);
    return a / (1 + b * pow(x, c)) + d * x + e;
}

static double sheen_lambda(double cosine, double alpha) {
    return cosine < 0.5 ? exp(sheen_curve(cosine, alpha))
                        : exp(2 * sheen_curve(0.5, alpha) - sheen_curve(1 - cosine, alpha));
}

double maps_sheen(double roughness, double nl, double nv, double nh) {
    const double alpha = roughness * roughness;
    const double sine = sqrt(MAX(1 - nh * nh, 0));
    const double d = (2 + 1 / alpha) * pow(sine, 1 / alpha) / (2 * G_PI);
    const double g = 1 / (1 + sheen_lambda(nv, alpha) + sheen_lambda(nl, alpha));
    return d * CLAMP(g / (4 * MAX(nl * nv, MIN_COSINE)), 0, 1);
}

/* Returns ∫ D_s V_s n·l dl over the hemisphere of lights, by the midpoint rule in cos θ and φ.
 * cosine is n·v. */
static double sheen_integral(double roughness, double cosine) {
    enum { STEPS = 48 };
    const double nv = CLAMP(cosine, 0.02, 1), sv = sqrt(1 - nv * nv);
    double sum = 0;
    for (int i = 0; i < STEPS; i++) {
        const double nl = (i + 0.5) / STEPS, sl = sqrt(1 - nl * nl);
        for (int j = 0; j < STEPS; j++) {
            /* half of the azimuths are enough, because the integrand is symmetric about the plane
             * of v and n */
            const double phi = (j + 0.5) / STEPS * G_PI;
            const double x = sv + sl * cos(phi), y = sl * sin(phi), z = nv + nl;
            sum += nl * maps_sheen(roughness, nl, nv, z / sqrt(x * x + y * y + z * z));
        }
    }
    return MIN(sum * 2 * G_PI / STEPS / STEPS, 1);
}

struct maps_layers maps_layers_new(double sheen_roughness, double coat_roughness) {
    struct maps_layers ret = {(float)sheen_roughness, (float)coat_roughness, {0}};
    for (int i = 0; i <= MAPS_SHEEN_STEPS && sheen_roughness > 0; i++)
        ret.sheen_albedo[i] = (float)sheen_integral(sheen_roughness, (double)i / MAPS_SHEEN_STEPS);
    return ret;
}

double maps_sheen_albedo(const struct maps_layers *layers, double cosine) {
    const double at = CLAMP(cosine, 0, 1) * MAPS_SHEEN_STEPS;
    const int i = MIN((int)at, MAPS_SHEEN_STEPS - 1);
    return layers->sheen_albedo[i] +
           (at - i) * ((double)layers->sheen_albedo[i + 1] - layers->sheen_albedo[i]);
}

/* The cosines of the angles between a texel's normal, two directions and their half vector. */
struct angles {
    double nl, nv, nh, vh;
    double specular; /* D V of maps_model.h */
};

static gboolean angles(const struct maps_texel *texel, const double v[3], const double l[3],
                       const double h[3], struct angles *ret) {
    const double n[3] = {texel->normal[0], texel->normal[1], texel->normal[2]};
    const double dx = texel->direction[0], dy = texel->direction[1];
    const double along = dx * n[0] + dy * n[1]; /* t is (dx, dy, 0) without its part along n */
    double t[3] = {dx - along * n[0], dy - along * n[1], -along * n[2]};
    const double length = sqrt(MAX(dot(t, t), 1e-12));
    for (int i = 0; i < 3; i++)
        t[i] /= length;
    const double b[3] = {n[1] * t[2] - n[2] * t[1], n[2] * t[0] - n[0] * t[2],
                         n[0] * t[1] - n[1] * t[0]};
    const double alpha = (double)texel->roughness * texel->roughness;
    const double at = alpha + (1 - alpha) * texel->anisotropy * texel->anisotropy;
    *ret = (struct angles){dot(n, l), dot(n, v), dot(n, h), dot(v, h), 0};
    if (ret->nl <= MIN_COSINE || ret->nv <= MIN_COSINE)
        return FALSE;
    const double ht = dot(h, t) / at, hb = dot(h, b) / alpha;
    const double w = ht * ht + hb * hb + ret->nh * ret->nh;
    const double vt = at * dot(v, t), vb = alpha * dot(v, b);
    const double lt = at * dot(l, t), lb = alpha * dot(l, b);
    const double both = ret->nl * sqrt(vt * vt + vb * vb + ret->nv * ret->nv) +
                        ret->nv * sqrt(lt * lt + lb * lb + ret->nl * ret->nl);
    ret->specular = 0.5 / (G_PI * at * alpha * w * w * both);
    return TRUE;
}

/* Computes f_0 (maps_model.h) of each colour. */
static void maps_model_base(const struct maps_texel *texel, const struct angles *at,
                            double ret[3]) {
    const double m = texel->metallic, w = texel->specular, f5 = pow(MAX(1 - at->vh, 0), 5);
    double fd[3], most = 0;
    for (int c = 0; c < 3; c++) {
        const double f0 = MIN((double)MAPS_DIELECTRIC * texel->specular_colour[c], 1);
        fd[c] = f0 + (1 - f0) * f5;
        most = MAX(most, fd[c]);
    }
    for (int c = 0; c < 3; c++) {
        const double base = texel->base[c], fm = base + (1 - base) * f5;
        const double dielectric = (1 - w * most) * base / G_PI + w * fd[c] * at->specular;
        ret[c] = (1 - m) * dielectric + m * fm * at->specular;
    }
}

void maps_evaluate(const struct maps_layers *layers, const struct maps_texel *texel,
                   const float v[3], const float l[3], float ret[3]) {
    const double dv[3] = {v[0], v[1], v[2]}, dl[3] = {l[0], l[1], l[2]};
    double h[3] = {dv[0] + dl[0], dv[1] + dl[1], dv[2] + dl[2]}, f[3];
    const double length = sqrt(dot(h, h));
    struct angles at;
    for (int i = 0; i < 3; i++) {
        h[i] /= length;
        ret[i] = 0;
    }
    if (!angles(texel, dv, dl, h, &at))
        return;
    maps_model_base(texel, &at, f);
    for (int c = 0; c < 3; c++)
        f[c] *= at.nl;
    if (layers->coat_roughness > 0 && texel->coat > 0) {
        const double weight = texel->coat * (0.04 + 0.96 * pow(1 - dv[2], 5));
        const double alpha = (double)layers->coat_roughness * layers->coat_roughness;
        const double coat = weight * maps_lobe(alpha, dl[2], dv[2], h[2]) * dl[2];
        for (int c = 0; c < 3; c++)
            f[c] = (1 - weight) * f[c] + coat;
    }
    const double most = MAX(MAX(texel->sheen[0], texel->sheen[1]), texel->sheen[2]);
    if (layers->sheen_roughness > 0 && most > 0) {
        const double r = layers->sheen_roughness;
        const double sheen = maps_sheen(r, at.nl, at.nv, at.nh) * at.nl;
        const double left =
            1 - most * MAX(maps_sheen_albedo(layers, at.nv), maps_sheen_albedo(layers, at.nl));
        for (int c = 0; c < 3; c++)
            f[c] = left * f[c] + texel->sheen[c] * sheen;
    }
    for (int c = 0; c < 3; c++)
        ret[c] = (float)(G_PI * f[c]);
}
