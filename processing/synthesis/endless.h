/* Lays out a sample without end and without repetition while it is drawn. The plane is divided into
 * hexagons, and each hexagon shows another part of the sample (tiling and blending, Heitz and
 * Neyret 2018). The method is for materials without order. Nothing is synthesised beforehand, and
 * there is no file.
 *
 * The centres of the hexagons are the vertices of a lattice of triangles. A point has three
 * barycentric coordinates w_k in its triangle, which grow towards the three centres. The shares of
 * the hexagons in a point are
 *   s_k = max (w_k − max w + ENDLESS_BLEND, 0), scaled to Σ s_k = 1.
 * Most points therefore lie in one hexagon, and points along an edge in two or three. The values
 * b_k of the hexagons are mixed about their mean m over the sample, which keeps mean and variance
 * (Heitz and Neyret 2018 eq. 4):
 *   m + Σ s_k (b_k − m) / ‖s‖ = Σ (s_k / ‖s‖) b_k + (1 − 1 / ‖s‖) m
 * Depths are not mixed, but are those of the nearest hexagon.
 *
 * No hexagon extends beyond the edges of the sample, so that the edges are never visible. If the
 * blend along a hexagon's border extends beyond an edge, the value at the edge is used.
 *
 * The centre of a hexagon in the sample is one of ENDLESS_CENTRES. A hash of the lattice's vertex
 * chooses it (Jarzynski and Olano 2020). Each centre is the best of several random candidates: the
 * mean and the variance of the visible texels should be near to those of the sample, and the
 * centres should cover the sample evenly. The lattice repeats after a whole number of columns and
 * rows where the texture coordinates of the shape do.
 *
 * renderer/shaders/places.glsl does the same as endless_find(). Plain data; any thread. */
#pragma once

#include <glib.h>

#define ENDLESS_CENTRES  64 /* a power of two */
#define ENDLESS_PICTURES 32
#define ENDLESS_SIDE     64
#define ENDLESS_PLACES   3 /* maximum number of places of a point */
/* width of the blend along an edge, relative to the distance of centres */
#define ENDLESS_BLEND 0.1
/* maximum distance of centres, relative to the sample's shorter side */
#define ENDLESS_COLUMN 0.42

struct endless {
    int width, height; /* texels of the sample */
    /* half a texel, in tiles; the values of the sample are read at this distance from its edges or
     * farther */
    float edge[2];
    float centres[ENDLESS_CENTRES][2]; /* centres of hexagons in the sample, in tiles */
};
typedef struct endless Endless;

/* Pictures of a sample, for example under some views and lights: height × width × n values, n = 1 …
 * ENDLESS_PICTURES. The time to choose centres is proportional to the number of pixels.
 * ENDLESS_SIDE pixels in each dimension are sufficient, even if the sample has more texels. */
struct endless_pictures {
    int width, height, n;
    const float *values;
};

/* Chooses centres for a sample of width × height texels that looks like these pictures. */
struct endless *endless_new(int width, int height, const struct endless_pictures *pictures);
void endless_free(struct endless *endless); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Endless, endless_free)

/* The lattice for a shape with the given number of tiles in each dimension. */
struct endless_lattice {
    float cells[2]; /* columns and rows per tile */
    /* columns and rows after which the lattice repeats; the number of rows is even */
    int period[2];
};
void endless_lattice_init(struct endless_lattice *lattice, const struct endless *endless,
                          double tiles_u, double tiles_v);

/* The places in the sample from which the values of a point are read. */
struct endless_places {
    int n;
    float x[ENDLESS_PLACES][2];   /* in tiles; the place of the nearest hexagon is the first */
    float weight[ENDLESS_PLACES]; /* s_k / ‖s‖ */
    float mean;                   /* 1 − 1 / ‖s‖, the weight of the sample's mean */
};
/* Finds the places of a point x, in tiles of the shape. */
void endless_find(const struct endless *endless, const struct endless_lattice *lattice,
                  const float x[2], struct endless_places *ret);
