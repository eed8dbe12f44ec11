#include "lobes_scene.h"
#include "lib/microfacet_formula.h"
#include "lib/ok.h"

#include <string.h>

/* Computes what lobes_evaluate() computes, but with the formula of microfacet_formula.h and the
 * rotation of the scene. The frame is that of the surface, with x at the azimuth of the tangent. */
static void rotated_value(const struct scene *s, int texel, const float *v, const float *l,
                          float ret[3]) {
    const struct lobes *p = s->lobes;
    const float *x = p->values + (gsize)texel * p->n_values;
    const double size = hypot(x[9], x[10]), c = x[9] / size, t = x[10] / size;
    const struct microfacet facets = {p->model == LOBES_WARD ? MICROFACET_WARD
                                                             : MICROFACET_ASHIKHMIN,
                                      {x[0], x[1], x[2]},
                                      {x[3], x[4], x[5]},
                                      {x[12], x[13]}};
    const float *const all[3] = {x + 6, v, l};
    struct vec3 turned[3];
    double rgb[3];
    for (int k = 0; k < 3; k++)
        turned[k] = vec3(c * all[k][0] + t * all[k][1], c * all[k][1] - t * all[k][0], all[k][2]);
    microfacet_evaluate(&facets, turned[0], turned[1], turned[2], s->rotation, rgb);
    for (int k = 0; k < 3; k++)
        ret[k] = (float)rgb[k];
}

/* Computes a texel of a slice under the light and the sky. */
static void slice_value(const struct scene *s, int slice, int texel, const float *v, const float *l,
                        double share, double ret[3]) {
    float rgb[3];
    if (s->rotation == METHOD_ROTATION_EXACT)
        lobes_evaluate(s->lobes, slice, texel, v, l, rgb);
    else
        rotated_value(s, texel, v, l, rgb);
    for (int c = 0; c < 3; c++)
        ret[c] += share * fmax(rgb[c], 0);
}

/* Computes the reflectance of a measured view under the sky, which is 16 lights. */
static void sky_value(const struct scene *s, int view, int texel, double share, double ret[3]) {
    const struct lobes *p = s->lobes;
    const double theta = p->layout.views.theta_deg[view] * G_PI / 180;
    const double phi = p->layout.views.phi_deg[view] * G_PI / 180;
    const float v[3] = {(float)(sin(theta) * cos(phi)), (float)(sin(theta) * sin(phi)),
                        (float)cos(theta)};
    for (int k = 0; k < 16; k++) {
        const int row = k / 4;
        float l[3];
        direction_grid_direction((0.5 + k % 4) / 4, (0.5 + row) / 4, l);
        slice_value(s, p->n_slices > 1 ? view : 0, texel, v, l, share * s->ambient / 8, ret);
    }
}

/* Adds a texel of a measured view, or of the pole. */
static void add_view(const struct scene *s, int view, int texel, const float *v, const float *l,
                     double share, double ret[3]) {
    int n = 1;
    const int *members = &view;
    if (view == (int)s->layout->views.n)
        members = directions_pole(s->views, &n);
    for (int k = 0; k < n; k++) {
        if (s->add)
            s->add(s, members[k], texel, l, share / n, ret);
        if (s->lobes && s->lobes->n_slices > 1)
            slice_value(s, members[k], texel, v, l, share / n, ret);
        if (s->lobes && s->ambient > 0)
            sky_value(s, members[k], texel, share / n, ret);
    }
}

gboolean lobes_scene_expected(gconstpointer data, const float *at, const float *v, const float *l,
                              double ret[3]) {
    const struct scene *s = data;
    struct direction_weights g;
    const double x = at[0] * (double)W - 0.5, y = at[1] * (double)H - 0.5;
    const double part[2] = {x - floor(x), y - floor(y)};
    if (v[2] < 0.1 || l[2] < 0.1 ||
        (s->nearest && (fabs(part[0] - 0.5) < 0.03 || fabs(part[1] - 0.5) < 0.03)))
        return FALSE;
    directions_weights(s->views, (struct vec3){v[0], v[1], v[2]}, &g);
    ret[0] = ret[1] = ret[2] = 0;
    for (int k = 0; k < 4; k++) {
        const int i = (int)floor(x) + k % 2, j = (int)floor(y) + k / 2;
        const int texel = (i % W + W) % W + W * ((j % H + H) % H);
        const double near_x = s->nearest ? part[0] > 0.5 : part[0];
        const double near_y = s->nearest ? part[1] > 0.5 : part[1];
        const double share = (k % 2 ? near_x : 1 - near_x) * (k / 2 ? near_y : 1 - near_y);
        if (share <= 0)
            continue;
        if (s->lobes && s->lobes->n_slices == 1)
            slice_value(s, 0, texel, v, l, share, ret);
        for (int a = 0; a < 4; a++)
            if (g.weight[a] > 0)
                add_view(s, g.index[a], texel, v, l, share * g.weight[a], ret);
    }
    return TRUE;
}

void lobes_scene_compare(struct scene *scene, const struct method *method, const char *path,
                         const struct method *refuses, const char *model) {
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_torus(1, 0.4, 128, 64);
    struct viewer_settings settings;
    g_autoptr(Viewer) view = viewer_new(NULL, &error);
    g_assert_no_error(error);
    formula_start_view(view, &settings, mesh);
    settings.style.nearest = scene->nearest;
    settings.style.rotation = scene->rotation;
    settings.ambient = scene->ambient;
    g_assert_true(ok(viewer_open(view, method, path, ERR)));
    if (refuses) {
        g_assert_false(viewer_open(view, refuses, path, &error));
        g_assert_nonnull(strstr(error->message, model));
        g_clear_error(&error);
    }
    const struct direction_list *views = &scene->layout->views;
    g_autoptr(Directions) directions =
        directions_new(views->theta_deg, views->phi_deg, (int)views->n, &error);
    g_assert_no_error(error);
    scene->views = directions;
    formula_compare(lobes_scene_expected, scene, view, &settings);
    mesh_free(mesh);
}
