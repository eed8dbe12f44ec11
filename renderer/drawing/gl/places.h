/* The places of the sample that a point of the surface shows (places.glsl). The sample is seen
 * through an index map, continued endlessly in hexagons, or repeated. At most one member of struct
 * places_source is set. If none is set, the sample is repeated. */
#pragma once

#include "index_texture.h"
#include "synthesis/endless.h"

struct places_source {
    const IndexTexture *index;     /* NULL if there is no index map */
    const struct endless *endless; /* NULL if there are no hexagons */
};

enum places_kind { PLACES_REPEATED, PLACES_INDEX, PLACES_ENDLESS, PLACES_KINDS };
enum places_kind places_kind_of(const struct places_source *source);

/* Returns the constants of places.glsl as lines “#define …”. If nearest is TRUE, texels are not
 * filtered. Free the result with g_free(). */
char *places_constants(const struct places_source *source, gboolean nearest);

/* Sets the texture and the uniforms of places.glsl in the current program. tiles is the number of
 * tiles of the shape in each direction. */
void places_bind(const struct places_source *source, const float tiles[2], guint program);
