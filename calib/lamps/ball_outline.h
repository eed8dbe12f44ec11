/*
 * This module finds the outline of a ball in pictures: the circle near a given circle on which most
 * edges lie.
 *
 * Edges are gathered picture by picture. The edges of the outline are at the same place in all
 * pictures, but the edges of shadows and highlights are not. A mean picture would not do, because
 * it has no outline where the shadows of many lamps hide the outline.
 *
 * The functions are pure, and any thread may call them.
 */
#pragma once

#include "ball_light.h"
#include "pictures/picture.h"

/* Changes of brightness along rays from the centre of a given circle, summed over pictures. */
typedef struct BallEdges BallEdges;

/* Returns NULL if the circle is too small for an outline to be found. */
BallEdges *ball_edges_new(const struct ball_outline *given);
void ball_edges_free(BallEdges *edges); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(BallEdges, ball_edges_free)

/* Adds a picture with linear values. */
void ball_edges_add(BallEdges *edges, const struct picture *picture);

/* Finds a circle whose centre and radius differ by at most reach_px from the given circle. reach_px
 * is at most a quarter of the radius. *ret_sigma_px is the standard deviation of the centre, per
 * axis, and of the radius. Returns FALSE if too little of such an outline is visible. */
gboolean ball_outline_find(const BallEdges *edges, double reach_px, struct ball_outline *ret,
                           double *ret_sigma_px);
