#include "btf_missing.h"

#include <math.h>

#define NEAREST   4    /* lights that the reach of the fit is taken from */
#define REACH     1.5  /* of the distance of the last of them */
#define FLATNESS  1e-4 /* keeps the plane level across a row of lights, where nothing tilts it */
#define LEAST_COS 0.02

struct place { /* of a light in the unit disc, relative to the missing one */
    guint light;
    double x, y, d;
};

static double btf_missing_radians(double deg) {
    return deg * (G_PI / 180);
}

/* Of light: what its values hold beside the reflectance. */
static double btf_missing_cosine(const struct btf_light *light) {
    return fmax(cos(btf_missing_radians(light->theta_deg)), LEAST_COS);
}

static struct place btf_missing_place_of(const struct btf_view *view, guint i,
                                         const struct btf_light *centre) {
    const struct btf_light *light = &g_array_index(view->lights, struct btf_light, i);
    const double a = sin(btf_missing_radians(light->theta_deg)),
                 b = sin(btf_missing_radians(centre->theta_deg));
    struct place ret = {.light = i};
    ret.x = a * cos(btf_missing_radians(light->phi_deg)) -
            b * cos(btf_missing_radians(centre->phi_deg));
    ret.y = a * sin(btf_missing_radians(light->phi_deg)) -
            b * sin(btf_missing_radians(centre->phi_deg));
    ret.d = hypot(ret.x, ret.y);
    return ret;
}

static int btf_missing_by_distance(gconstpointer a, gconstpointer b) {
    const struct place *p = a, *q = b;
    return p->d < q->d ? -1 : p->d > q->d ? 1 : (p->light > q->light) - (p->light < q->light);
}

static GArray *places_around(const struct btf_view *view, struct exr_part *const *taken, guint i) {
    const struct btf_light *centre = &g_array_index(view->lights, struct btf_light, i);
    GArray *places = g_array_new(FALSE, FALSE, sizeof(struct place));
    for (guint k = 0; k < view->lights->len; k++) {
        const struct place place = btf_missing_place_of(view, k, centre);
        if (taken[k])
            g_array_append_val(places, place);
    }
    g_array_sort(places, btf_missing_by_distance);
    return places;
}

/* The first row of the inverse of [a b c; b d e; c e f]. */
static void first_row(double a, double b, double c, double d, double e, double f, double row[3]) {
    const double p = d * f - e * e, q = c * e - b * f, r = b * e - c * d;
    const double determinant = a * p + b * q + c * r;
    row[0] = p / determinant;
    row[1] = q / determinant;
    row[2] = r / determinant;
}

double *btf_missing_weights(const struct btf_view *view, struct exr_part *const *taken, guint i) {
    g_autoptr(GArray) places = places_around(view, taken, i);
    if (places->len == 0)
        return NULL;
    const struct place *p = (const struct place *)(void *)places->data;
    const double reach = fmax(REACH * p[MIN(places->len, NEAREST) - 1].d, 1e-6);
    double s[6] = {0}, row[3];
    for (guint k = 0; k < places->len && p[k].d < reach; k++) {
        const double w = (1 - p[k].d / reach) * (1 - p[k].d / reach);
        s[0] += w;
        s[1] += w * p[k].x;
        s[2] += w * p[k].y;
        s[3] += w * p[k].x * p[k].x;
        s[4] += w * p[k].x * p[k].y;
        s[5] += w * p[k].y * p[k].y;
    }
    const double level = FLATNESS * s[0] * reach * reach;
    first_row(s[0], s[1], s[2], s[3] + level, s[4], s[5] + level, row);
    double *weights = g_new0(double, view->lights->len);
    const double own = btf_missing_cosine(&g_array_index(view->lights, struct btf_light, i));
    for (guint k = 0; k < places->len && p[k].d < reach; k++) {
        const double w = (1 - p[k].d / reach) * (1 - p[k].d / reach);
        weights[p[k].light] =
            w * (row[0] + row[1] * p[k].x + row[2] * p[k].y) * own /
            btf_missing_cosine(&g_array_index(view->lights, struct btf_light, p[k].light));
    }
    return weights;
}

void btf_missing_marks(const double *weights, struct exr_part *const *taken, guint n_lights,
                       gsize n, guint8 *ret_marks) {
    for (gsize i = 0; i < n; i++)
        ret_marks[i] = BTF_MARK_PREDICTED;
    for (guint k = 0; k < n_lights; k++) {
        const float *mark = taken[k] && weights[k] != 0 ? exr_part_plane(taken[k], "mark") : NULL;
        for (gsize i = 0; mark && i < n; i++)
            if (((int)mark[i] & BTF_MARK_HOLE) != 0)
                ret_marks[i] = BTF_MARK_HOLE;
    }
}

void btf_missing_fill(const double *weights, struct exr_part *const *taken, guint n_lights,
                      const guint8 *marks, struct exr_part *part) {
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
            to[i] = marks[i] & BTF_MARK_HOLE ? 0 : fmaxf(to[i], 0);
    }
}
