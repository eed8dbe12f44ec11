#include "btf_missing.h"

#include <math.h>

/* The fit uses the lights within REACH times the distance of the NEAREST-th nearest light, or of
 * the farthest light if there are fewer. */
#define NEAREST 4
#define REACH   1.5
/* added to the normal matrix, so that collinear lights give a finite slope */
#define FLATNESS 1e-4
#define MIN_COS  0.02

/* A captured light relative to the missing one. x and y are the differences of their positions (sin
 * θ cos φ, sin θ sin φ) in the unit disc. d is the distance between these positions. */
struct disc_point {
    guint light;
    double x, y, d;
};

static double radians(double deg) {
    return deg * (G_PI / 180);
}

/* Returns cos θ_l, by which the light's values are divided before the fit, but at least MIN_COS. */
static double cosine(const struct btf_light *light) {
    return fmax(cos(radians(light->theta_deg)), MIN_COS);
}

static int by_distance(gconstpointer a, gconstpointer b) {
    const struct disc_point *p = a, *q = b;
    return p->d < q->d ? -1 : p->d > q->d ? 1 : (p->light > q->light) - (p->light < q->light);
}

/* Returns the captured lights (struct disc_point), sorted by their distance from light i. */
static GArray *around(const struct btf_view *view, struct exr_part *const *taken, guint i) {
    const struct btf_light *centre = &g_array_index(view->lights, struct btf_light, i);
    const double b = sin(radians(centre->theta_deg));
    const double phi_b = radians(centre->phi_deg);
    GArray *points = g_array_new(FALSE, FALSE, sizeof(struct disc_point));
    for (guint k = 0; k < view->lights->len; k++) {
        const struct btf_light *light = &g_array_index(view->lights, struct btf_light, k);
        const double a = sin(radians(light->theta_deg));
        const double phi_a = radians(light->phi_deg);
        struct disc_point point = {.light = k};
        point.x = a * cos(phi_a) - b * cos(phi_b);
        point.y = a * sin(phi_a) - b * sin(phi_b);
        point.d = hypot(point.x, point.y);
        if (taken[k])
            g_array_append_val(points, point);
    }
    g_array_sort(points, by_distance);
    return points;
}

/* Fits the plane p + q x + r y through the values f_k / cos θ_k at (x_k, y_k) by least squares with
 * the weights w_k = (1 − d_k / reach)². d_k is the distance of light k from the missing light,
 * which is at the origin. The value of the plane at the origin is
 *   p = Σ_k w_k (m₀ + m₁ x_k + m₂ y_k) f_k / cos θ_k,
 * where m is the first row of the inverse of the normal matrix
 *   Σ_k w_k (1, x_k, y_k)ᵀ (1, x_k, y_k) = [s0 s1 s2; s1 d e; s2 e f],
 * with FLATNESS · s0 · reach² added to d and f. */
double *btf_missing_weights(const struct btf_view *view, struct exr_part *const *taken, guint i) {
    g_autoptr(GArray) points = around(view, taken, i);
    if (points->len == 0)
        return NULL;
    const struct disc_point *p = (const struct disc_point *)(void *)points->data;
    const double reach = fmax(REACH * p[MIN(points->len, NEAREST) - 1].d, 1e-6);
    double s[6] = {0};
    for (guint k = 0; k < points->len && p[k].d < reach; k++) {
        const double w = (1 - p[k].d / reach) * (1 - p[k].d / reach);
        s[0] += w;
        s[1] += w * p[k].x;
        s[2] += w * p[k].y;
        s[3] += w * p[k].x * p[k].x;
        s[4] += w * p[k].x * p[k].y;
        s[5] += w * p[k].y * p[k].y;
    }
    const double level = FLATNESS * s[0] * reach * reach;
    const double d = s[3] + level, e = s[4], f = s[5] + level;
    const double m[3] = {d * f - e * e, s[2] * e - s[1] * f, s[1] * e - s[2] * d};
    const double determinant = s[0] * m[0] + s[1] * m[1] + s[2] * m[2];
    const double row[3] = {m[0] / determinant, m[1] / determinant, m[2] / determinant};
    double *weights = g_new0(double, view->lights->len);
    const double own = cosine(&g_array_index(view->lights, struct btf_light, i));
    for (guint k = 0; k < points->len && p[k].d < reach; k++) {
        const double w = (1 - p[k].d / reach) * (1 - p[k].d / reach);
        weights[p[k].light] = w * (row[0] + row[1] * p[k].x + row[2] * p[k].y) * own /
                              cosine(&g_array_index(view->lights, struct btf_light, p[k].light));
    }
    return weights;
}

void btf_missing_flags(const double *weights, struct exr_part *const *taken, guint n_lights,
                       gsize n, guint8 *ret_flags) {
    for (gsize i = 0; i < n; i++)
        ret_flags[i] = BTF_FLAG_PREDICTED;
    for (guint k = 0; k < n_lights; k++) {
        const float *flag = taken[k] && weights[k] != 0 ? exr_part_plane(taken[k], "mark") : NULL;
        for (gsize i = 0; flag && i < n; i++)
            if (((int)flag[i] & BTF_FLAG_HOLE) != 0)
                ret_flags[i] = BTF_FLAG_HOLE;
    }
}

void btf_missing_fill(const double *weights, struct exr_part *const *taken, guint n_lights,
                      const guint8 *flags, struct exr_part *part) {
    static const char *const names[] = {"B", "G", "R"};
    const gsize n = (gsize)part->width * (gsize)part->height;
    for (gsize c = 0; c < G_N_ELEMENTS(names); c++) {
        float *to = exr_part_plane(part, names[c]);
        for (guint k = 0; k < n_lights; k++) {
            const float *from =
                taken[k] && weights[k] != 0 ? exr_part_plane(taken[k], names[c]) : NULL;
            for (gsize i = 0; from && i < n; i++)
                to[i] += (float)weights[k] * from[i];
        }
        for (gsize i = 0; i < n; i++)
            to[i] = flags[i] & BTF_FLAG_HOLE ? 0 : fmaxf(to[i], 0);
    }
}
