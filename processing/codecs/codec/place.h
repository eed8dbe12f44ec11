/*
 * These functions make the query of a codec for any view and light: the measured directions around
 * the view and around the light, and their weights. Functions with a const argument may be called
 * from several threads at the same time.
 */
#pragma once

#include "codec.h"
#include "directions/directions.h"

/* The directions of a model. Set all members to 0 before codec_tables_init(). */
struct codec_tables {
    const struct btf_layout *layout; /* layout of the model */
    /* n if the views and the lights are the n × n samples of direction_grid.h, otherwise 0 */
    int n_grid;
    Directions *views, *lights; /* NULL if n_grid > 0 */
};

/* Prepares the directions of a model, which must outlive the tables. Fails if directions_new()
 * refuses the views or the lights; the error then begins with "views: " or "lights: ". Call
 * codec_tables_clear() even after an error. */
gboolean codec_tables_init(struct codec_tables *tables, const struct codec *codec,
                           gconstpointer model, GError **error);
void codec_tables_clear(struct codec_tables *tables);

/* A query, and the lists to which the query points. The caller allocates the lists, with
 * codec_place_views() and codec_place_lights() elements. */
struct codec_place {
    struct codec_query query;
    int *views, *lights;
    float *view_weights, *light_weights;
};

gsize codec_place_views(const struct codec_tables *tables);
gsize codec_place_lights(const struct codec_tables *tables);

/* Sets the query of a place. The vectors need not have unit length. Returns FALSE and leaves the
 * place unchanged if a direction is on or below the horizon, or has no length, or is not finite.
 * The material then reflects no light to the view. */
gboolean codec_place_set(const struct codec_tables *tables, const float view[3],
                         const float light[3], struct codec_place *place);
