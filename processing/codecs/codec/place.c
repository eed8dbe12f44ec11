#include "place.h"

#include "btf/direction_grid.h"

#include <math.h>

gboolean codec_tables_init(struct codec_tables *tables, const struct codec *codec,
                           gconstpointer model, GError **error) {
    const struct btf_layout *layout = G_STRUCT_MEMBER_P(model, codec->layout);
    const struct direction_list *views = &layout->views, *lights = &layout->lights;
    tables->layout = layout;
    tables->n_grid = codec->grid ? codec->grid(model) : 0;
    if (tables->n_grid > 0)
        return TRUE;
    tables->views = directions_new(views->theta_deg, views->phi_deg, (int)views->n, error);
    if (tables->views)
        tables->lights = directions_new(lights->theta_deg, lights->phi_deg, (int)lights->n, error);
    if (!tables->lights)
        g_prefix_error(error, tables->views ? "lights: " : "views: ");
    return tables->lights != NULL;
}

void codec_tables_clear(struct codec_tables *tables) {
    g_clear_pointer(&tables->views, directions_free);
    g_clear_pointer(&tables->lights, directions_free);
}

/* Copies the directions of `at` that have a weight above 0 to a list, with their weights times
 * scale. The weight of the pole is divided equally among the measured directions at the pole.
 * Returns the length of the list. */
static int list(const Directions *directions, gsize n, const struct direction_weights *at,
                float scale, int *ret_index, float *ret_weight) {
    int count = 0, n_pole;
    const int *pole = directions_pole(directions, &n_pole);
    for (int k = 0; k < 4; k++) {
        const gboolean is_pole = at->index[k] >= (int)n;
        for (int i = 0; at->weight[k] > 0 && i < (is_pole ? n_pole : 1); i++) {
            ret_index[count] = is_pole ? pole[i] : at->index[k];
            ret_weight[count++] = scale * at->weight[k] / (float)(is_pole ? n_pole : 1);
        }
    }
    return count;
}

static int grid_list(int n_grid, const float direction[3], int *ret_index, float *ret_weight) {
    int count = 0, index[4];
    float weight[4];
    direction_grid_weights(n_grid, direction, index, weight);
    for (int k = 0; k < 4; k++)
        if (weight[k] > 0) {
            ret_index[count] = index[k];
            ret_weight[count++] = weight[k];
        }
    return count;
}

gboolean codec_place_set(const struct codec_tables *tables, const float view[3],
                         const float light[3], struct codec_place *place) {
    struct codec_query *query = &place->query;
    struct vec3 v = vec3(view[0], view[1], view[2]), l = vec3(light[0], light[1], light[2]);
    const double v_length = vec3_length(v), l_length = vec3_length(l);
    if (!isfinite(v_length) || !isfinite(l_length) || !(v.z > 0) || !(l.z > 0))
        return FALSE;
    v = vec3_scale(v, 1 / v_length);
    l = vec3_scale(l, 1 / l_length);
    *query = (struct codec_query){
        .view = {(float)v.x, (float)v.y, (float)v.z},
        .light = {(float)l.x, (float)l.y, (float)l.z},
        .views = place->views,
        .lights = place->lights,
        .view_weights = place->view_weights,
        .light_weights = place->light_weights,
    };
    if (tables->n_grid > 0) {
        query->n_views = grid_list(tables->n_grid, query->view, place->views, place->view_weights);
        query->n_lights =
            grid_list(tables->n_grid, query->light, place->lights, place->light_weights);
        return TRUE;
    }
    struct direction_weights at;
    directions_weights(tables->views, v, &at);
    query->n_views =
        list(tables->views, tables->layout->views.n, &at, 1, place->views, place->view_weights);
    const double fade = directions_fade_weights(tables->lights, l, &at);
    query->n_lights = list(tables->lights, tables->layout->lights.n, &at, (float)fade,
                           place->lights, place->light_weights);
    return TRUE;
}

/* Returns the maximum length of a list: four directions, and all measured directions at the
 * pole. */
static gsize most(const Directions *directions) {
    int n_pole = 0;
    if (directions)
        directions_pole(directions, &n_pole);
    return 4 + (gsize)n_pole;
}

gsize codec_place_views(const struct codec_tables *tables) {
    return most(tables->views);
}

gsize codec_place_lights(const struct codec_tables *tables) {
    return most(tables->lights);
}
