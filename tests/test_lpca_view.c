/* Pictures of local PCAs against a plain evaluation of the formula, pixel by pixel. */
#include "formula_fixture.h"
#include "processing/lpca.h"
#include "processing/resample.h"
#include "renderer/directions.h"
#include "renderer/lpca_grid.h"
#include "renderer/lpca_revised.h"
#include "renderer/lpca_view.h"
#include "rings.h"

#include <math.h>
#include <string.h>

/* Level 0 has W × H texels. */
static struct lpca *make_level(int level, int n_clusters, int n_components) {
    const int w = MAX(1, W >> level), h = MAX(1, H >> level);
    g_autoptr(GRand) random = g_rand_new_with_seed(5 + level);
    struct lpca *p = g_new0(struct lpca, 1);
    p->name = g_strdup("test");
    p->width = w;
    p->height = h;
    p->texel_mm = 1;
    p->n_views = p->n_lights = RINGS * A_RING;
    p->n_clusters = n_clusters;
    p->n_components = n_components;
    fill_directions(0, &p->view_theta_deg, &p->view_phi_deg);
    fill_directions(5, &p->light_theta_deg, &p->light_phi_deg);
    p->clusters = g_new(int, w *h);
    p->weights = g_new(float, w *h *n_components);
    p->scales = g_new(float, n_clusters *(n_components + 1));
    const gsize n = (gsize)n_clusters * (n_components + 1) * p->n_views * p->n_lights * 3;
    p->brdfs = g_new(float, n);
    for (int k = 0; k < w * h; k++) /* a whole row of one cluster, others mixed */
        p->clusters[k] = k < 2 * w ? 0 : g_rand_int_range(random, 0, n_clusters);
    for (int k = 0; k < w * h * n_components; k++)
        p->weights[k] = (float)g_rand_double_range(random, -0.3, 0.3);
    for (int k = 0; k < n_clusters * (n_components + 1); k++)
        p->scales[k] = 1;
    for (gsize k = 0; k < n; k++)
        p->brdfs[k] = (float)g_rand_double_range(random, 0.2, 0.8);
    return p;
}

static struct lpca *make_lpca(int n_clusters, int n_components) {
    return make_level(0, n_clusters, n_components);
}

struct scene { /* one picture, and what is needed to say what it should be */
    const struct lpca *lpca;
    Directions *views, *lights;
    float *sky;
    double ambient;
    gboolean nearest;
    int n_grid;       /* 0: by pairs of measured directions */
    gboolean revised; /* lpca is on a grid of resample.h */
};

/* E_i of a view and a light, either of which may be the pole: the mean of a ring. */
static double component(const struct scene *s, int cluster, int i, int v, int l, int c) {
    const struct lpca *p = s->lpca;
    int n;
    double sum = 0;
    if (v == p->n_views) {
        const int *members = directions_pole(s->views, &n);
        for (int k = 0; k < n; k++)
            sum += component(s, cluster, i, members[k], l, c) / n;
        return sum;
    }
    if (l == p->n_lights) {
        const int *members = directions_pole(s->lights, &n);
        for (int k = 0; k < n; k++)
            sum += component(s, cluster, i, v, members[k], c) / n;
        return sum;
    }
    const gsize row = ((gsize)cluster * (p->n_components + 1) + i) * p->n_views + v;
    return p->brdfs[(row * p->n_lights + l) * 3 + c];
}

static double pair(const struct scene *s, int texel, int v, int l, int c) {
    const struct lpca *p = s->lpca;
    double sum = component(s, p->clusters[texel], 0, v, l, c);
    for (int i = 0; i < p->n_components; i++)
        sum += p->weights[texel * p->n_components + i] *
               component(s, p->clusters[texel], i + 1, v, l, c);
    return sum;
}

static double texel_value(const struct scene *s, int i, int j, const struct direction_weights *g,
                          const struct direction_weights *h, double fade, int c) {
    const int w = s->lpca->width, height = s->lpca->height;
    const int texel = ((i % w) + w) % w + w * (((j % height) + height) % height);
    double sum = 0;
    for (int a = 0; a < 4; a++) {
        if (g->weight[a] <= 0)
            continue;
        for (int b = 0; b < 4; b++)
            if (h->weight[b] > 0)
                sum += g->weight[a] * h->weight[b] * fade *
                       pair(s, texel, g->index[a], h->index[b], c);
        for (int l = 0; s->ambient > 0 && l < s->lpca->n_lights; l++)
            sum += g->weight[a] * s->ambient * s->sky[l] * pair(s, texel, g->index[a], l, c);
    }
    return sum;
}

/* The place of a direction on the grid: the square scaled to 0 … n − 1. */
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

/* Linear in the simplex: from a corner of the cell, step by step along the coordinate that has most
 * left; with only two coordinates, that of the views, for the sky. */
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

static struct vec3 direction_at(const float *theta_deg, const float *phi_deg, int k) {
    const double theta = theta_deg[k] * G_PI / 180, phi = phi_deg[k] * G_PI / 180;
    return vec3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

static struct vec3 vec_of(const float *p) {
    return (struct vec3){p[0], p[1], p[2]};
}

/* To the centre of a cell of a face of a cube of so many cells; FALSE if that is not sure. */
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

/* FALSE where rounding may pick other texels or directions. */
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
        resample_weights(s->lpca->n_grid, v, g->index, g->weight);
        resample_weights(s->lpca->n_grid, light, h->index, h->weight);
        return TRUE;
    }
    directions_weights(s->views, vec_of(view), g);
    directions_weights(s->lights, vec_of(light), h);
    *ret_fade = directions_fade(s->lights, vec_of(light));
    return TRUE;
}

/* FALSE as above. */
static gboolean expected(const struct scene *s, const float *at, const float *v, const float *l,
                         double ret[3]) {
    struct direction_weights g, h;
    const double x = at[0] * (double)s->lpca->width - 0.5,
                 y = at[1] * (double)s->lpca->height - 0.5;
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

/* A pixel of a whole scene, of level 0. */
static gboolean of_scene(gconstpointer data, const float *at, const float *v, const float *l,
                         double ret[3]) {
    return expected(data, at, v, l, ret);
}

static void check_case(int n_clusters, int n_components, gboolean nearest, double ambient,
                       int n_grid) {
    g_autoptr(GError) error = NULL;
    struct lpca *lpca = make_lpca(n_clusters, n_components);
    struct mesh *mesh = scene_torus(1, 0.4, 128, 64);
    g_autoptr(View) view = view_new(NULL, &error);
    g_assert_no_error(error);
    struct view_settings settings;
    start_view(view, &settings, mesh);
    if (n_grid == 0)
        view_set_method(view, &method_lpca, lpca_view_new(&lpca, 1, &error), &error);
    else
        view_set_method(view, &method_lpca_grid, lpca_grid_new(&lpca, 1, n_grid, &error), &error);
    g_assert_no_error(error);
    settings.style.nearest = nearest;
    settings.ambient = ambient;
    Directions *(*const new)(const float *, const float *, int, GError **) =
        n_grid == 0 ? directions_new_triangulated : directions_new;
    g_autoptr(Directions) views =
        new (lpca->view_theta_deg, lpca->view_phi_deg, lpca->n_views, &error);
    g_autoptr(Directions) lights =
        new (lpca->light_theta_deg, lpca->light_phi_deg, lpca->n_lights, &error);
    g_autofree float *sky = g_new0(float, lpca->n_lights);
    directions_sky(lights, sky);
    const struct scene scene = {lpca, views, lights, sky, ambient, nearest, n_grid};
    compare_picture(of_scene, &scene, view, &settings);
    mesh_free(mesh);
    lpca_free(lpca);
}

static void test_formula(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    check_case(5, 6, TRUE, 0, 0);
    check_case(5, 6, FALSE, 0, 0);
    check_case(5, 3, FALSE, 0.5, 0);
    check_case(1, 1, FALSE, 0, 0);
}

/* Of an even sky by the trapezoidal rule; the square's area is the hemisphere's 2π. */
static float *sky_of_grid(int n) {
    float *sky = g_new(float, n *n);
    for (int k = 0; k < n * n; k++) {
        const gboolean edge[2] = {k % n == 0 || k % n == n - 1, k / n == 0 || k / n == n - 1};
        sky[k] =
            2.0f / ((float)(n - 1) * (float)(n - 1)) * (edge[0] ? 0.5f : 1) * (edge[1] ? 0.5f : 1);
    }
    return sky;
}

static void check_revised(int n_clusters, int n_components, gboolean nearest, double ambient, int n,
                          gboolean from_grid) {
    g_autoptr(GError) error = NULL;
    struct lpca *lpca = make_lpca(n_clusters, n_components);
    struct lpca *grid = resample_lpca(lpca, n, &error);
    struct mesh *mesh = scene_torus(1, 0.4, 128, 64);
    struct view_settings settings;
    g_autoptr(View) view = view_new(NULL, &error);
    g_assert_no_error(error);
    start_view(view, &settings, mesh);
    lpca_quantise(grid, LPCA_8BIT);
    view_set_method(view, &method_lpca_revised,
                    lpca_revised_new(from_grid ? &grid : &lpca, 1, n, &error), &error);
    g_assert_no_error(error);
    settings.style.nearest = nearest;
    settings.ambient = ambient;
    g_autofree float *sky = sky_of_grid(n);
    const struct scene scene = {
        .lpca = grid, .sky = sky, .ambient = ambient, .nearest = nearest, .revised = TRUE};
    compare_picture(of_scene, &scene, view, &settings);
    mesh_free(mesh);
    lpca_free(lpca);
    lpca_free(grid);
}

static void test_revised(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    check_revised(5, 6, TRUE, 0, 8, FALSE);
    check_revised(5, 6, FALSE, 0, 6, TRUE);
    check_revised(260, 2, FALSE, 0.5, 8, FALSE); /* more than fit side by side */
}

/* Between two mip levels of a plane seen from straight above, where all pixels are as large. */
struct between {
    struct scene scenes[3];
    double level;
};

static gboolean of_levels(gconstpointer data, const float *at, const float *v, const float *l,
                          double ret[3]) {
    const struct between *b = data;
    const int level = MIN((int)b->level, 1);
    const double part = b->level - level;
    double coarse[3];
    if (!expected(&b->scenes[level], at, v, l, ret) ||
        !expected(&b->scenes[level + 1], at, v, l, coarse))
        return FALSE;
    for (int c = 0; c < 3; c++)
        ret[c] = (1 - part) * ret[c] + part * coarse[c];
    return TRUE;
}

static void check_levels(View *view, struct lpca *const *levels, double tiles) {
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_plane();
    struct view_settings settings;
    struct between b;
    g_autoptr(Directions) views = directions_new_triangulated(
        levels[0]->view_theta_deg, levels[0]->view_phi_deg, levels[0]->n_views, &error);
    g_autoptr(Directions) lights = directions_new_triangulated(
        levels[0]->light_theta_deg, levels[0]->light_phi_deg, levels[0]->n_lights, &error);
    start_view(view, &settings, mesh);
    settings.ambient = 0;
    settings.camera_elevation_deg = 90;
    settings.tiles_u = settings.tiles_v = tiles;
    for (int k = 0; k < 3; k++)
        b.scenes[k] = (struct scene){.lpca = levels[k], .views = views, .lights = lights};
    g_autofree float *texels =
        view_render_geometry(view, &settings, VIEW_GEOMETRY_TEXEL, SIZE, SIZE, &error);
    const float *middle = texels + 4 * (SIZE / 2 * SIZE + SIZE / 2), *next = middle + 4;
    const float *below = middle + 4 * SIZE;
    const double across =
        hypot((double)(next[0] - middle[0]) * W, (double)(next[1] - middle[1]) * H);
    const double down =
        hypot((double)(below[0] - middle[0]) * W, (double)(below[1] - middle[1]) * H);
    b.level = CLAMP(log2(fmax(across, down)), 0, 2);
    g_test_message("%g tiles: level %.3f", tiles, b.level);
    compare_picture(of_levels, &b, view, &settings);
    mesh_free(mesh);
}

static void test_levels(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    g_autoptr(GError) error = NULL;
    struct lpca *levels[3];
    g_autoptr(View) view = view_new(NULL, &error);
    for (int k = 0; k < 3; k++)
        levels[k] = make_level(k, 4 - k, k == 1 ? 2 : 3);
    view_set_method(view, &method_lpca, lpca_view_new(levels, 3, &error), &error);
    g_assert_no_error(error);
    check_levels(view, levels, 6);
    check_levels(view, levels, 18);
    check_levels(view, levels, 33);
    check_levels(view, levels, 90);
    levels[1]->view_phi_deg[3] += 1;
    g_assert_null(lpca_view_new(levels, 3, &error));
    g_assert_nonnull(strstr(error->message, "mip level 1"));
    for (int k = 0; k < 3; k++)
        lpca_free(levels[k]);
}

static void test_grid(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    check_case(5, 2, TRUE, 0, 5);
    check_case(3, 5, TRUE, 0.5, 4);
    check_case(2, 1, FALSE, 0, 3);
    check_case(7, 9, FALSE, 0.2, 6);
}

/* Lambertian bumps with a soft gloss, a normal a texel. */
static struct btf_matrix *make_btf(void) {
    struct btf_matrix *btf = g_new0(struct btf_matrix, 1);
    const int n = RINGS * A_RING;
    *btf = (struct btf_matrix){
        .name = g_strdup("bumps"), .width = W, .height = H, .texel_mm = 1, .n_views = n};
    btf->n_lights = n;
    fill_directions(0, &btf->view_theta_deg, &btf->view_phi_deg);
    fill_directions(5, &btf->light_theta_deg, &btf->light_phi_deg);
    btf->values = g_new(float, 3 * (gsize)W * H * n * n);
    for (int k = 0; k < W * H * n * n; k++) {
        const struct vec3 v = direction_at(btf->view_theta_deg, btf->view_phi_deg, k / n % n);
        const struct vec3 l = direction_at(btf->light_theta_deg, btf->light_phi_deg, k % n);
        const int texel = k / n / n;
        const struct vec3 normal = vec3_unit(vec3(0.4 * sin(texel), 0.4 * cos(2.0 * texel), 1));
        const double gloss = pow(fmax(vec3_dot(vec3_unit(vec3_add(v, l)), normal), 0), 8);
        for (int c = 0; c < 3; c++)
            btf->values[3 * k + c] =
                (float)(fmax(vec3_dot(normal, l), 0) * (0.6 - 0.1 * c) + 0.3 * gloss * l.z);
    }
    return btf;
}

/* How far two methods' pictures are apart, relative to those of the first, over all measured pairs
 * of directions and all texels. */
static double apart(View *a, View *b, const struct btf_matrix *btf) {
    struct view_settings s = view_settings_default;
    g_autoptr(GError) error = NULL;
    double off = 0, all = 0;
    for (int k = 0; k < btf->n_views * btf->n_lights; k++) {
        const struct vec3 v =
            direction_at(btf->view_theta_deg, btf->view_phi_deg, k / btf->n_lights);
        const struct vec3 l =
            direction_at(btf->light_theta_deg, btf->light_phi_deg, k % btf->n_lights);
        const float to_view[3] = {(float)v.x, (float)v.y, (float)v.z};
        const float to_light[3] = {(float)l.x, (float)l.y, (float)l.z};
        g_autofree float *one = view_render_flat(a, &s, to_view, to_light, W, H, &error);
        g_autofree float *other = view_render_flat(b, &s, to_view, to_light, W, H, &error);
        g_assert_no_error(error);
        for (int i = 0; i < 4 * W * H; i++) {
            off += i % 4 < 3 ? pow((double)other[i] - one[i], 2) : 0;
            all += i % 4 < 3 ? pow(one[i], 2) : 0;
        }
    }
    return sqrt(off / all);
}

/* At measured directions lpca shows what was compressed: revised is as far from it as resampling
 * said, and a finer grid is nearer. What remains is that cube maps tell directions a third of a
 * degree apart. */
static void test_agree(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    static const int grids[] = {5, 8, 12};
    g_autoptr(GError) error = NULL;
    struct btf_matrix *btf = make_btf();
    const struct lpca_options options = {.n_clusters = 2, .n_components = 3};
    struct lpca *lpca = lpca_compute(btf, &options, &error);
    g_assert_no_error(error);
    g_autoptr(View) original = view_new(NULL, &error), revised = view_new(NULL, &error);
    double before = 1;
    view_set_method(original, &method_lpca, lpca_view_new(&lpca, 1, &error), &error);
    g_assert_no_error(error);
    for (gsize k = 0; k < G_N_ELEMENTS(grids); k++) {
        struct lpca *grid = resample_lpca(lpca, grids[k], &error);
        lpca_quantise(grid, LPCA_8BIT);
        const double reported = resample_error(grid, btf, 0);
        view_set_method(revised, &method_lpca_revised, lpca_revised_new(&grid, 1, 0, &error),
                        &error);
        g_assert_no_error(error);
        const double found = apart(original, revised, btf);
        g_test_message("grid of %d: compression %.4f, with resampling %.4f; pictures %.4f apart",
                       grids[k], lpca->error, reported, found);
        g_assert_cmpfloat(found, <, sqrt(reported * reported - lpca->error * lpca->error) + 0.01);
        g_assert_cmpfloat(found, <, before);
        before = found;
        lpca_free(grid);
    }
    lpca_free(lpca);
    btf_matrix_free(btf);
}

/* Cube maps: six faces of 256² of 8 bytes; texels: clusters 8 bytes, weights 16 a page. */
static void test_bytes(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    g_autoptr(GError) error = NULL;
    struct lpca *levels[2] = {make_level(0, 3, 5), make_level(1, 2, 5)};
    g_autoptr(View) view = view_new(NULL, &error);
    g_assert_no_error(error);
    const gint64 texels = (gint64)(W * H + W / 2 * (H / 2)) * (8 + 2 * 16),
                 cubes = 4 * 6 * 65536 * 8;
    const gint64 n = RINGS * A_RING;
    view_set_method(view, &method_lpca, lpca_view_new(levels, 2, &error), &error);
    g_assert_no_error(error);
    g_assert_cmpint(view_memory(view).material, ==, texels + cubes + 5 * n * (n + 1) * 6 * 8);
    view_set_method(view, &method_lpca_grid, lpca_grid_new(levels, 2, 6, &error), &error);
    g_assert_no_error(error);
    g_assert_cmpint(view_memory(view).material, ==, texels + 5 * 36 * 37 * 2 * 16);
    g_assert_cmpint(view_memory(view).mdf, ==, 0);
    lpca_free(levels[0]);
    lpca_free(levels[1]);
}

static void refuse_lpca(struct lpca *lpca, const char *said) {
    g_autoptr(GError) error = NULL;
    g_autoptr(GError) of_grid = NULL;
    g_assert_null(lpca_view_new(&lpca, 1, &error));
    g_assert_nonnull(error);
    g_assert_nonnull(strstr(error->message, said));
    g_assert_null(lpca_grid_new(&lpca, 1, 4, &of_grid));
    g_assert_cmpstr(of_grid->message, ==, error->message);
    lpca_free(lpca);
}

static void test_bad(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct lpca *lpca = make_lpca(3, 2);
    lpca->weights[11] = NAN;
    refuse_lpca(lpca, "weight number 11");
    lpca = make_lpca(3, 2);
    lpca->brdfs[77] = INFINITY;
    refuse_lpca(lpca, "eigen-BRDF value number 77");
    lpca = make_lpca(3, 2);
    lpca->clusters[4] = 3;
    refuse_lpca(lpca, "texel 4 is in cluster 3");
    lpca = make_lpca(3, 2);
    lpca->clusters[0] = -1;
    refuse_lpca(lpca, "cluster -1");
    lpca = make_lpca(3, 2);
    lpca->view_theta_deg[1] = NAN;
    refuse_lpca(lpca, "views: ");
    lpca = make_lpca(3, 2);
    lpca->n_lights = 0;
    refuse_lpca(lpca, "no texels or directions");
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add("/lpca-view/formula", struct fixture, NULL, set_up, test_formula, tear_down);
    g_test_add("/lpca-view/revised", struct fixture, NULL, set_up, test_revised, tear_down);
    g_test_add("/lpca-view/levels", struct fixture, NULL, set_up, test_levels, tear_down);
    g_test_add("/lpca-view/grid", struct fixture, NULL, set_up, test_grid, tear_down);
    g_test_add("/lpca-view/agree", struct fixture, NULL, set_up, test_agree, tear_down);
    g_test_add("/lpca-view/bytes", struct fixture, NULL, set_up, test_bytes, tear_down);
    g_test_add("/lpca-view/bad", struct fixture, NULL, set_up, test_bad, tear_down);
    return g_test_run();
}
