/*
 * A sample laid out without end and without repetition, while it is drawn: hexagons, each of which
 * shows another part of the sample, after the tiling and blending of Heitz and Neyret 2018. It is
 * for materials without order; nothing is synthesised beforehand, and there is no file.
 *
 * Centres of hexagons are the vertices of a lattice of triangles. In the triangle that a point is
 * in, its barycentric coordinates w_k are how near it is to each of three centres. Shares are
 *   s_k = max (w_k − max w + ENDLESS_BLEND, 0), scaled to Σ s_k = 1
 * so that most points lie in one hexagon, and those along an edge in two or three. Values b_k are
 * mixed about their mean m over the sample, which keeps mean and variance (Heitz and Neyret 2018
 * eq. 4):
 *   m + Σ s_k (b_k − m) / ‖s‖ = Σ (s_k / ‖s‖) b_k + (1 − 1 / ‖s‖) m
 * Depths are those of the nearest hexagon.
 *
 * No hexagon reaches over the sample's edges, so that the edges are nowhere seen. Where the blend
 * along a hexagon's border reaches over an edge, it takes the value at the edge. A hexagon's centre
 * in the sample is one of ENDLESS_CENTRES: a hash of the lattice's vertex says which (Jarzynski and
 * Olano 2020). For each centre several candidates are drawn at random; the one is kept with which
 * mean and variance of what is seen are nearest to the sample's and the centres cover the sample
 * evenly. The lattice closes after a whole number of columns and rows where the shape's texture
 * coordinates do.
 *
 * renderer/shaders/places.glsl does the same as endless_find(). Plain data; any thread.
 */
#pragma once

#include <glib.h>

#define ENDLESS_CENTRES  64 /* a power of two */
#define ENDLESS_PICTURES 32
#define ENDLESS_SIDE     64
#define ENDLESS_PLACES   3    /* of a point, at most */
#define ENDLESS_BLEND    0.1  /* of the distance of centres: the width of the blend along an edge */
#define ENDLESS_COLUMN   0.42 /* of the sample's shorter side: the distance of centres, at most */

struct endless {
    int width, height;                 /* texels of the sample */
    float edge[2];                     /* half a texel, in tiles: the least that is looked up */
    float centres[ENDLESS_CENTRES][2]; /* in tiles */
};
typedef struct endless Endless;

/* Pictures of a sample, for example under some views and lights: height × width × n values, n = 1 …
 * ENDLESS_PICTURES. They may have fewer pixels than the sample has texels: ENDLESS_SIDE pixels
 * each way are enough, and the time to choose centres is proportional to the number of pixels. */
struct endless_pictures {
    int width, height, n;
    const float *values;
};

/* For a sample of width × height texels that looks like these pictures. */
struct endless *endless_new(int width, int height, const struct endless_pictures *pictures);
void endless_free(struct endless *endless); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Endless, endless_free)

/* The lattice for a shape with so many tiles each way. */
struct endless_lattice {
    float cells[2]; /* columns and rows per tile */
    int period[2];  /* columns and rows after which it repeats; rows are even */
};
void endless_lattice_init(struct endless_lattice *lattice, const struct endless *endless,
                          double tiles_u, double tiles_v);

/* Where the values of a point are looked up in the sample. */
struct endless_places {
    int n;
    float x[ENDLESS_PLACES][2];   /* in tiles; the nearest hexagon's first */
    float weight[ENDLESS_PLACES]; /* s_k / ‖s‖ */
    float mean;                   /* 1 − 1 / ‖s‖, of the sample's mean */
};
/* x: in tiles, as the shape has it. */
void endless_find(const struct endless *endless, const struct endless_lattice *lattice,
                  const float x[2], struct endless_places *ret);
