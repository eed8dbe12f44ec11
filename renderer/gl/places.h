/* Which places of the sample stand at a point of the surface (places.glsl): the sample repeated,
 * through an index map, or in hexagons without end. One of them, or none, is set. */
#pragma once

#include "index_texture.h"
#include "synthesis/endless.h"

struct places_source {
    const IndexTexture *index;     /* NULL: none */
    const struct endless *endless; /* NULL: none */
};

enum places_kind { PLACES_REPEATED, PLACES_INDEX, PLACES_ENDLESS, PLACES_KINDS };
enum places_kind places_kind_of(const struct places_source *source);

/* Returns the constants of places.glsl as “#define …” lines. g_free() */
char *places_constants(const struct places_source *source, gboolean nearest);

/* Sets the texture and uniforms of the current program. tiles: number of tiles of the shape each
 * way. */
void places_bind(const struct places_source *source, const float tiles[2], guint program);
