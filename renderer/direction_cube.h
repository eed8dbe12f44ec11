/*
 * The three measured directions nearest to any other and their weights, as two cube maps (seed 000
 * §5): the corners of a triangle of the measured ones, and its barycentric coordinates. Not
 * filtered, for beside an edge of a triangle the next texel is of other directions: they are told
 * apart by a third of a degree. Directions below the horizon count as in it.
 */
#pragma once

#include "directions.h"

struct direction_cube {
    guint indices, weights; /* textures; indices as 1/65535 */
};

/* directions: triangulated. fade: as direction_table_new(). */
struct direction_cube direction_cube_new(Directions *directions, gboolean fade);
void direction_cube_clear(struct direction_cube *cube);

gint64 direction_cube_bytes(const struct direction_cube *cube);

/* To texture units unit and unit + 1 of a program in use, as NAME_indices and NAME_weights. */
void direction_cube_bind(const struct direction_cube *cube, guint program, const char *name,
                         int unit);
