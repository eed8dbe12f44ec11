#include "lpca_scene.h"
#include "drawing/methods/lpca_grid.h"
#include "drawing/methods/lpca_view.h"
#include "ok.h"

struct lpca *lpca_scene_level(int level, int n_clusters, int n_components) {
    const int w = MAX(1, W >> level), h = MAX(1, H >> level);
    g_autoptr(GRand) random = g_rand_new_with_seed(5 + level);
    struct lpca *p = g_new0(struct lpca, 1);
    p->name = g_strdup("test");
    p->layout.width = w;
    p->layout.height = h;
    p->layout.texel_mm = 1;
    p->layout.views.n = p->layout.lights.n = RINGS * A_RING;
    p->n_clusters = n_clusters;
    p->n_components = n_components;
    rings_fill(0, &p->layout.views.theta_deg, &p->layout.views.phi_deg);
    rings_fill(5, &p->layout.lights.theta_deg, &p->layout.lights.phi_deg);
    p->clusters = g_new(int, w *h);
    p->weights = g_new(float, w *h *n_components);
    p->scales = g_new(float, n_clusters *(n_components + 1));
    const gsize n = (gsize)n_clusters * (n_components + 1) * btf_layout_values(&p->layout);
    p->brdfs = g_new(float, n);
    for (int k = 0; k < w * h; k++) /* one row belongs to one cluster, other rows are mixed */
        p->clusters[k] = k < 2 * w ? 0 : g_rand_int_range(random, 0, n_clusters);
    for (int k = 0; k < w * h * n_components; k++)
        p->weights[k] = (float)g_rand_double_range(random, -0.3, 0.3);
    for (int k = 0; k < n_clusters * (n_components + 1); k++)
        p->scales[k] = 1;
    for (gsize k = 0; k < n; k++)
        p->brdfs[k] = (float)g_rand_double_range(random, 0.2, 0.8);
    return p;
}

struct lpca *lpca_scene_lpca(int n_clusters, int n_components) {
    return lpca_scene_level(0, n_clusters, n_components);
}

/* Returns E_i for a view and a light. Either may be the pole, which is the mean of a ring. */
static double component(const struct scene *s, int cluster, int i, int v, int l, int c) {
    const struct lpca *p = s->lpca;
    int n;
    double sum = 0;
    if (v == (int)p->layout.views.n) {
        const int *members = directions_pole(s->views, &n);
        for (int k = 0; k < n; k++)
            sum += component(s, cluster, i, members[k], l, c) / n;
        return sum;
    }
    if (l == (int)p->layout.lights.n) {
        const int *members = directions_pole(s->lights, &n);
        for (int k = 0; k < n; k++)
            sum += component(s, cluster, i, v, members[k], c) / n;
        return sum;
    }
    const gsize row = ((gsize)cluster * (p->n_components + 1) + i) * p->layout.views.n + v;
    return p->brdfs[(row * p->layout.lights.n + l) * 3 + c];
}

static double sum_of(const struct scene *s, int texel, int v, int l, int c) {
    const struct lpca *p = s->lpca;
    double sum = component(s, p->clusters[texel], 0, v, l, c);
    for (int i = 0; i < p->n_components; i++)
        sum += p->weights[texel * p->n_components + i] *
               component(s, p->clusters[texel], i + 1, v, l, c);
    return sum;
}

/* With logarithms the components are ln(Y + ε), (R − Y)/(Y + ε), (B − Y)/(Y + ε); see lpca.h. */
static double pair(const struct scene *s, int texel, int v, int l, int c) {
    if (s->lpca->colours == LPCA_RGB)
        return sum_of(s, texel, v, l, c);
    const double size = exp(sum_of(s, texel, v, l, 0)), y = size - 0.01;
    const double r = y + size * sum_of(s, texel, v, l, 1), b = y + size * sum_of(s, texel, v, l, 2);
    return c == 0 ? r : c == 2 ? b : (y - 0.2126 * r - 0.0722 * b) / 0.7152;
}

static double texel_value(const struct scene *s, int i, int j, const struct direction_weights *g,
                          const struct direction_weights *h, double fade, int c) {
    const int w = s->lpca->layout.width, height = s->lpca->layout.height;
    const int texel = ((i % w) + w) % w + w * (((j % height) + height) % height);
    double sum = 0;
    for (int a = 0; a < 4; a++) {
        if (g->weight[a] <= 0)
            continue;
        for (int b = 0; b < 4; b++)
            if (h->weight[b] > 0)
                sum += g->weight[a] * h->weight[b] * fade *
                       pair(s, texel, g->index[a], h->index[b], c);
        for (gsize l = 0; s->ambient > 0 && l < s->lpca->layout.lights.n; l++)
            sum += g->weight[a] * s->ambient * s->sky[l] * pair(s, texel, g->index[a], l, c);
    }
    return sum;
}

/* Computes the position of a direction on the grid: the square, scaled to 0 … n − 1. */
static void place_of(struct vec3 d, int n, double ret[2]) {
    const double sum = fabs(d.x) + fabs(d.y) + d.z;
    ret[0] = (1 + (d.x + d.y) / sum) / 2 * (n - 1);
    ret[1] = (1 + (d.x - d.y) / sum) / 2 * (n - 1);
}

static double grid_corner(const struct scene *s, int texel_i, int texel_j, const int at[4],
                          gboolean sky, int c) {
    struct direction_weights g, h;
    const double step = 2.0 / (s->n_grid - 1);
    const struct vec3 v = directions_from_square(-1 + step * at[0], -1 + step * at[1]);
    const struct vec3 l = directions_from_square(-1 + step * at[2], -1 + step * at[3]);
    struct scene without = *s;
    without.ambient = sky ? 1 : 0;
    directions_weights(s->views, v, &g);
    directions_weights(s->lights, l, &h);
    return texel_value(&without, texel_i, texel_j, &g, &h, sky ? 0 : directions_fade(s->lights, l),
                       c);
}

/* Interpolates linearly in the simplex. From a corner of the cell, it steps along the coordinates
 * in descending order of their fractions. For the sky, there are only the two coordinates of the
 * view. */
static double grid_value(const struct scene *s, int i, int j, struct vec3 v, struct vec3 l,
                         gboolean sky, int c) {
    const int n = sky ? 2 : 4;
    double at[4], left[4], before = 1, sum = 0;
    int corner[4] = {0};
    gboolean stepped[4] = {FALSE};
    place_of(v, s->n_grid, at);
    place_of(l, s->n_grid, at + 2);
    for (int k = 0; k < 4; k++) {
        corner[k] = MIN((int)floor(at[k]), s->n_grid - 2);
        left[k] = at[k] - corner[k];
    }
    for (int k = 0; k <= n; k++) {
        int most = -1;
        for (int m = 0; m < n; m++)
            if (!stepped[m] && (most < 0 || left[m] > left[most]))
                most = m;
        const double next = most < 0 ? 0 : left[most];
        sum += (before - next) * grid_corner(s, i, j, corner, sky, c);
        before = next;
        if (most >= 0) {
            corner[most]++;
            stepped[most] = TRUE;
        }
    }
    return sum;
}

static struct vec3 vec_of(const float *p) {
    return (struct vec3){p[0], p[1], p[2]};
}

/* Moves a direction to the centre of its cell on a cube whose faces have cells × cells cells.
 * Returns FALSE if rounding may select another cell. */
static gboolean snap(const float *d, double cells, float ret[3]) {
    const float most = fmaxf(fmaxf(fabsf(d[0]), fabsf(d[1])), fabsf(d[2]));
    float length = 0;
    for (int k = 0; k < 3; k++) {
        const double cell = (d[k] / most + 1) * cells / 2;
        if (fabs(cell - round(cell)) < 1e-3 && fabsf(d[k]) < most)
            return FALSE;
        ret[k] = fabsf(d[k]) < most ? (float)((floor(cell) + 0.5) * 2 / cells - 1) : d[k] / most;
        length += ret[k] * ret[k];
    }
    for (int k = 0; k < 3; k++)
        ret[k] /= sqrtf(length);
    return TRUE;
}

/* Returns FALSE if rounding may select other texels or directions. */
static gboolean direction_shares(const struct scene *s, const float *v, const float *l,
                                 struct direction_weights *g, struct direction_weights *h,
                                 double *ret_fade) {
    float view[3], light[3];
    *ret_fade = 1;
    if (s->n_grid > 0)
        return TRUE;
    if (!snap(v, 256, view) || !snap(l, s->revised ? 512 : 256, light))
        return FALSE;
    if (s->revised) {
        direction_grid_weights(s->lpca->n_grid, v, g->index, g->weight);
        direction_grid_weights(s->lpca->n_grid, light, h->index, h->weight);
        return TRUE;
    }
    directions_weights(s->views, vec_of(view), g);
    directions_weights(s->lights, vec_of(light), h);
    *ret_fade = directions_fade(s->lights, vec_of(light));
    return TRUE;
}

/* Returns FALSE if rounding may select other texels or directions. */
static gboolean lpca_scene_expected(const struct scene *s, const float *at, const float *v,
                                    const float *l, double ret[3]) {
    struct direction_weights g, h;
    const double x = at[0] * (double)s->lpca->layout.width - 0.5,
                 y = at[1] * (double)s->lpca->layout.height - 0.5;
    const double fx = x - floor(x), fy = y - floor(y);
    if (v[2] < 0.1 || l[2] < 0.1 ||
        (s->nearest && (fabs(fx - 0.5) < 0.03 || fabs(fy - 0.5) < 0.03)))
        return FALSE;
    double fade;
    if (!direction_shares(s, v, l, &g, &h, &fade))
        return FALSE;
    const int i = (int)floor(x), j = (int)floor(y);
    for (int c = 0; c < 3; c++) {
        double corners[2][2];
        for (int b = 0; b < 2; b++)
            for (int a = 0; a < 2; a++)
                corners[b][a] = s->n_grid == 0
                                    ? texel_value(s, i + a, j + b, &g, &h, fade, c)
                                    : grid_value(s, i + a, j + b, vec_of(v), vec_of(l), FALSE, c);
        for (int k = 0; s->n_grid > 0 && s->ambient > 0 && k < 4; k++)
            corners[k / 2][k % 2] +=
                s->ambient * grid_value(s, i + k % 2, j + k / 2, vec_of(v), vec_of(l), TRUE, c);
        if (s->nearest)
            ret[c] = corners[fy > 0.5][fx > 0.5];
        else
            ret[c] = (1 - fy) * ((1 - fx) * corners[0][0] + fx * corners[0][1]) +
                     fy * ((1 - fx) * corners[1][0] + fx * corners[1][1]);
        ret[c] = fmax(ret[c], 0);
    }
    return TRUE;
}

gboolean lpca_scene_pixel(gconstpointer data, const float *at, const float *v, const float *l,
                          double ret[3]) {
    return lpca_scene_expected(data, at, v, l, ret);
}

static gboolean of_levels(gconstpointer data, const float *at, const float *v, const float *l,
                          double ret[3]) {
    const struct between *b = data;
    const int level = MIN((int)b->level, 1);
    const double part = b->level - level;
    double coarse[3];
    if (!lpca_scene_expected(&b->scenes[level], at, v, l, ret) ||
        !lpca_scene_expected(&b->scenes[level + 1], at, v, l, coarse))
        return FALSE;
    for (int c = 0; c < 3; c++)
        ret[c] = (1 - part) * ret[c] + part * coarse[c];
    return TRUE;
}

void lpca_scene_check_levels(Viewer *view, struct lpca *const *levels, double tiles) {
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_plane();
    struct viewer_settings settings;
    struct between b;
    g_autoptr(Directions) views = directions_new_triangulated(levels[0]->layout.views.theta_deg,
                                                              levels[0]->layout.views.phi_deg,
                                                              levels[0]->layout.views.n, &error);
    g_autoptr(Directions) lights = directions_new_triangulated(levels[0]->layout.lights.theta_deg,
                                                               levels[0]->layout.lights.phi_deg,
                                                               levels[0]->layout.lights.n, &error);
    formula_start_view(view, &settings, mesh);
    settings.ambient = 0;
    settings.camera_elevation_deg = 90;
    settings.tiles_u = settings.tiles_v = tiles;
    for (int k = 0; k < 3; k++)
        b.scenes[k] = (struct scene){.lpca = levels[k], .views = views, .lights = lights};
    g_autofree float *texels =
        viewer_render_geometry(view, &settings, VIEWER_GEOMETRY_TEXEL, SIZE, SIZE, &error);
    const float *middle = texels + 4 * (SIZE / 2 * SIZE + SIZE / 2), *next = middle + 4;
    const float *below = middle + 4 * SIZE;
    const double across =
        hypot((double)(next[0] - middle[0]) * W, (double)(next[1] - middle[1]) * H);
    const double down =
        hypot((double)(below[0] - middle[0]) * W, (double)(below[1] - middle[1]) * H);
    b.level = CLAMP(log2(fmax(across, down)), 0, 2);
    g_test_message("%g tiles: level %.3f", tiles, b.level);
    formula_compare(of_levels, &b, view, &settings);
    mesh_free(mesh);
}

void lpca_scene_compare(const struct scene *scene, const struct method *method, gpointer material) {
    struct mesh *mesh = scene_torus(1, 0.4, 128, 64);
    g_autoptr(Viewer) view = ok(viewer_new(NULL, ERR));
    struct viewer_settings settings;
    formula_start_view(view, &settings, mesh);
    g_assert_nonnull(material);
    ok(viewer_set_method(view, method, material, ERR));
    settings.style.nearest = scene->nearest;
    settings.ambient = scene->ambient;
    formula_compare(lpca_scene_pixel, scene, view, &settings);
    mesh_free(mesh);
}

void lpca_scene_check(struct lpca *lpca, gboolean nearest, double ambient, int n_grid) {
    const struct direction_list *v = &lpca->layout.views, *l = &lpca->layout.lights;
    Directions *(*const new)(const float *, const float *, int, GError **) =
        n_grid == 0 ? directions_new_triangulated : directions_new;
    g_autoptr(Directions) views = ok(new (v->theta_deg, v->phi_deg, (int)v->n, ERR));
    g_autoptr(Directions) lights = ok(new (l->theta_deg, l->phi_deg, (int)l->n, ERR));
    g_autofree float *sky = g_new0(float, l->n);
    directions_sky(lights, sky);
    const struct scene scene = {lpca, views, lights, sky, ambient, nearest, n_grid};
    if (n_grid == 0)
        lpca_scene_compare(&scene, &method_lpca, ok(lpca_view_new(&lpca, 1, ERR)));
    else
        lpca_scene_compare(&scene, &method_lpca_grid, ok(lpca_grid_new(&lpca, 1, n_grid, ERR)));
}
