#include "held_out.h"

#include "base/data_error.h"
#include "compare_private.h"
#include "place.h"

#include <stdlib.h>
#include <string.h>

#define COLOURS 3
#define SHARE   10 /* by default, one of SHARE directions is left out */

static int by_value(gconstpointer a, gconstpointer b) {
    return *(const int *)a - *(const int *)b;
}

static int *draw(GRand *random, int n, int count) {
    g_autofree int *order = g_new(int, n);
    int *ret = g_new(int, count);
    for (int i = 0; i < n; i++)
        order[i] = i;
    for (int i = 0; i < count; i++) {
        const int other = g_rand_int_range(random, i, n);
        ret[i] = order[other];
        order[other] = order[i];
    }
    if (count > 0)
        qsort(ret, (gsize)count, sizeof *ret, by_value);
    return ret;
}

int held_out_default(gsize n) {
    return n > HELD_OUT_MIN_KEPT ? (int)((n + SHARE - 1) / SHARE) : 0;
}

static gboolean enough(gsize n, int left_out, const char *what, GError **error) {
    if (left_out == 0 || (gsize)left_out + HELD_OUT_MIN_KEPT <= n)
        return TRUE;
    g_set_error(
        error, DATA_ERROR, DATA_ERROR_INVALID,
        "%d of %zu %s cannot be left out, because at least %d must be kept; leave out fewer %s",
        left_out, n, what, HELD_OUT_MIN_KEPT, what);
    return FALSE;
}

gboolean held_out_draw(const struct btf_layout *layout, int n_views, int n_lights, guint32 seed,
                       struct held_out *ret, GError **error) {
    *ret = (struct held_out){0};
    if (!enough(layout->views.n, n_views, "views", error) ||
        !enough(layout->lights.n, n_lights, "lights", error))
        return FALSE;
    GRand *random = g_rand_new_with_seed(seed);
    *ret = (struct held_out){n_views, n_lights, draw(random, (int)layout->views.n, n_views),
                             draw(random, (int)layout->lights.n, n_lights)};
    g_rand_free(random);
    return TRUE;
}

void held_out_clear(struct held_out *held) {
    g_free(held->views);
    g_free(held->lights);
    *held = (struct held_out){0};
}

/* Returns the n − n_held indices from 0 to n − 1 that are not in held, in ascending order. held is
 * ascending. g_free() */
static int *others(gsize n, const int *held, int n_held) {
    int *ret = g_new(int, n);
    for (int i = 0, k = 0; i < (int)n; i++)
        if (k < n_held && held[k] == i)
            k++;
        else
            ret[i - k] = i;
    return ret;
}

static struct direction_list pick(const struct direction_list *from, const int *indices, gsize n) {
    struct direction_list ret = direction_list_new(n);
    for (gsize i = 0; i < n; i++) {
        ret.theta_deg[i] = from->theta_deg[indices[i]];
        ret.phi_deg[i] = from->phi_deg[indices[i]];
    }
    return ret;
}

struct btf_matrix *held_out_rest(const struct btf_matrix *btf, const struct held_out *held) {
    const struct btf_layout *layout = &btf->layout;
    g_autofree int *views = others(layout->views.n, held->views, held->n_views);
    g_autofree int *lights = others(layout->lights.n, held->lights, held->n_lights);
    const gsize texels = btf_layout_texels(layout), row = layout->lights.n * COLOURS;
    struct btf_matrix *ret = g_new0(struct btf_matrix, 1);
    ret->name = g_strdup(btf->name);
    ret->layout = btf_layout_copy(layout);
    direction_list_clear(&ret->layout.views);
    direction_list_clear(&ret->layout.lights);
    ret->layout.views = pick(&layout->views, views, layout->views.n - (gsize)held->n_views);
    ret->layout.lights = pick(&layout->lights, lights, layout->lights.n - (gsize)held->n_lights);
    ret->values = g_new(float, texels *btf_layout_values(&ret->layout));
    float *to = ret->values;
    for (gsize texel = 0; texel < texels; texel++)
        for (gsize v = 0; v < ret->layout.views.n; v++) {
            const float *from = btf->values + (texel * layout->views.n + (gsize)views[v]) * row;
            for (gsize l = 0; l < ret->layout.lights.n; l++, to += COLOURS)
                memcpy(to, from + (gsize)lights[l] * COLOURS, sizeof *to * COLOURS);
        }
    return ret;
}

static gboolean is_held(const int *held, int n, int index) {
    for (int i = 0; i < n; i++)
        if (held[i] == index)
            return TRUE;
    return FALSE;
}

/* Copies n positions (x, y, z), without those whose indices are in held. */
static float *keep(const float *from, int n, const int *held, int n_held) {
    float *ret = from ? g_new(float, 3 * (n - n_held)) : NULL;
    for (int i = 0, k = 0; from && i < n; i++)
        if (!is_held(held, n_held, i))
            memcpy(ret + (gsize)(3 * k++), from + (gsize)(3 * i), sizeof *ret * 3);
    return ret;
}

struct codec_geometry *held_out_rest_geometry(const struct codec_geometry *geometry,
                                              const struct held_out *held) {
    struct codec_geometry *ret = g_new0(struct codec_geometry, 1);
    ret->n_views = geometry->n_views - held->n_views;
    ret->n_lights = geometry->n_lights - held->n_lights;
    ret->camera_mm = keep(geometry->camera_mm, geometry->n_views, held->views, held->n_views);
    ret->lamp_mm = keep(geometry->lamp_mm, geometry->n_lights, held->lights, held->n_lights);
    ret->points = g_new(struct codec_surface_point, geometry->n_points);
    for (gsize i = 0; i < geometry->n_points; i++) {
        const struct codec_surface_point *point = &geometry->points[i];
        int before = 0;
        if (is_held(held->views, held->n_views, point->view))
            continue;
        for (int k = 0; k < held->n_views; k++)
            before += held->views[k] < point->view;
        ret->points[ret->n_points] = *point;
        ret->points[ret->n_points++].view -= before;
    }
    return ret;
}

/* The views and lights at which a model is compared, and the query for each pair of a view and a
 * light. */
struct held_out_pairs {
    const struct btf_matrix *btf;
    const Material *model;
    int n_views, n_lights;
    int *views, *lights;        /* indices in btf of the directions */
    struct codec_tables tables; /* directions of the model (place.h) */
    int *indices;               /* memory of the lists `views` and `lights` of all places */
    float *weights;             /* memory of the weights of all places */
    /* n_views × n_lights; n_views in the query is 0 if the view or the light is on or below the
     * horizon */
    struct codec_place *places;
    const struct codec_geometry *geometry; /* NULL if the codec does not use it */
};

static void measured(gconstpointer data, int texel, float *ret) {
    const struct held_out_pairs *pairs = data;
    const struct btf_layout *layout = &pairs->btf->layout;
    const float *from = pairs->btf->values + (gsize)texel * btf_layout_values(layout);
    for (int v = 0; v < pairs->n_views; v++)
        for (int l = 0; l < pairs->n_lights; l++, ret += COLOURS)
            memcpy(ret,
                   from + ((gsize)pairs->views[v] * layout->lights.n + (gsize)pairs->lights[l]) *
                              COLOURS,
                   sizeof *ret * COLOURS);
}

static void modelled(gconstpointer data, int texel, float *ret) {
    const struct held_out_pairs *pairs = data;
    const struct codec *codec = material_codec(pairs->model);
    gconstpointer model = material_model(pairs->model);
    const float one = 1;
    const struct codec_texels texels = {1, &texel, &one};
    const struct btf_layout *layout = &pairs->btf->layout;
    const struct codec_geometry *geometry = pairs->geometry;
    memset(ret, 0, sizeof *ret * COLOURS * (gsize)pairs->n_views * (gsize)pairs->n_lights);
    for (int i = 0; i < pairs->n_views * pairs->n_lights; i++) {
        struct codec_query query = pairs->places[i].query;
        if (query.n_views == 0)
            continue;
        if (geometry) {
            codec_geometry_towards(layout, geometry->camera_mm, &layout->views,
                                   pairs->views[i / pairs->n_lights], texel, query.view);
            codec_geometry_towards(layout, geometry->lamp_mm, &layout->lights,
                                   pairs->lights[i % pairs->n_lights], texel, query.light);
        }
        codec->evaluate(model, &query, &texels, ret + (gsize)i * COLOURS);
    }
}

/* Prepares a query for each pair. If the view or the light is on or below the horizon, the query
 * stays empty, because nothing is reflected. */
static void set_places(struct held_out_pairs *pairs) {
    const struct btf_layout *layout = &pairs->btf->layout;
    const gsize n_views = codec_place_views(&pairs->tables),
                n_lights = codec_place_lights(&pairs->tables), n = n_views + n_lights;
    const gsize count = (gsize)pairs->n_views * (gsize)pairs->n_lights;
    g_autofree float *views = direction_list_vectors(&layout->views);
    g_autofree float *lights = direction_list_vectors(&layout->lights);
    pairs->indices = g_new(int, count *n);
    pairs->weights = g_new(float, count *n);
    pairs->places = g_new0(struct codec_place, count);
    for (gsize i = 0; i < count; i++) {
        struct codec_place *place = &pairs->places[i];
        place->views = pairs->indices + i * n;
        place->lights = place->views + n_views;
        place->view_weights = pairs->weights + i * n;
        place->light_weights = place->view_weights + n_views;
        const int view = pairs->views[i / (gsize)pairs->n_lights];
        const int light = pairs->lights[i % (gsize)pairs->n_lights];
        codec_place_set(&pairs->tables, views + 3 * (gsize)view, lights + 3 * (gsize)light, place);
    }
}

static struct comparison *compare(const struct btf_matrix *btf, const struct held_out *held,
                                  const Material *model, int max_pictures, const struct work *work,
                                  GError **error) {
    const struct btf_layout *layout = &btf->layout;
    struct held_out_pairs pairs = {
        .btf = btf,
        .model = model,
        .n_views = held->n_views ? held->n_views : (int)layout->views.n,
        .n_lights = held->n_lights ? held->n_lights : (int)layout->lights.n,
        .views = held->n_views ? held->views : others(layout->views.n, NULL, 0),
        .lights = held->n_lights ? held->lights : others(layout->lights.n, NULL, 0),
        .geometry = material_codec(model)->geometric ? held->geometry : NULL,
    };
    struct comparison *ret = NULL;
    if (codec_tables_init(&pairs.tables, material_codec(model), material_model(model), error)) {
        const struct compare_size size = {(int)layout->width, (int)layout->height, pairs.n_views,
                                          pairs.n_lights, max_pictures};
        set_places(&pairs);
        ret =
            compare_sources(&(struct compare_source){btf->name, &pairs, measured},
                            &(struct compare_source){material_info(model)->label, &pairs, modelled},
                            &size, work, error);
    }
    codec_tables_clear(&pairs.tables);
    g_free(pairs.indices);
    g_free(pairs.weights);
    g_free(pairs.places);
    if (!held->n_views)
        g_free(pairs.views);
    if (!held->n_lights)
        g_free(pairs.lights);
    return ret;
}

struct comparison *held_out_compare(const struct btf_matrix *btf, const struct held_out *held,
                                    const Material *model, const struct work *work,
                                    GError **error) {
    return compare(btf, held, model, COMPARE_PICTURES, work, error);
}

gboolean held_out_error(const struct btf_matrix *btf, const struct held_out *held,
                        const struct codec *codec, gconstpointer model, const struct work *work,
                        double *ret_error, GError **error) {
    g_autoptr(Material) material = material_borrow(codec->title, codec, model);
    struct comparison *comparison = compare(btf, held, material, 0, work, error);
    if (comparison)
        *ret_error = comparison->all.error;
    const gboolean ok = comparison != NULL;
    comparison_free(comparison);
    return ok;
}
