/*
 * Interpolation between views along the surface. Where there is relief, a texel x of the reference
 * plane shows another surface point in each view, so that a mix of its values has ghosts. The MDF
 * of each view says which point that is. To predict a new view, the measured views' pictures are
 * first moved along the surface, each where it sees that surface, and then mixed.
 *
 * Symbols. v: the unit vector from x towards a new camera; v_i, c_i: direction and camera of the
 * measured view i; D_i its MDF (pipeline.h: the distance of the surface behind x_i, along the ray).
 *
 *   p(t) = x − v t                 the new view's ray, behind the reference plane for t > 0
 *   x_i, m_i                       where the ray from p to c_i crosses the reference plane, and how
 *                                  far behind it p lies
 *   q_i(p) = (m_i − D_i(x_i)) / T_i
 *     T_i = ½ texel + 2 S_i        tolerance, S_i the MDF's standard error there
 *     q < −1: view i sees through p; |q| ≤ 1: it sees p; q > 2: something hides p from it
 *   F(t) = Σ_i u_i f(q_i)          f(q) = −1 below −1, q to 1, 2 − q to 2, 0 beyond
 *   d(x, v)                        the MDF of the new view: the least t at which F rises through 0,
 *                                  the first point that the views see, and do not see through
 *   s(q) = 1 for |q| ≤ 1, 2 − |q| to 2, 0 beyond
 *   B(x, v, l) = Σ_i w_i s(q_i) B(x_i, v_i, l) / Σ_i w_i s(q_i)     at p = p(d)
 *
 * w_i = b_i' + ε h_i with b_i' = b_i (cos θ_i)^a / Σ_j b_j (cos θ_j)^a, and u_i = b_i + h_i. b are
 * barycentric weights of v in the triangulation of the measured directions (directions.h); outside
 * of the triangulation, the weights of the nearest point of its border. h are weights of the
 * nearest views, continuous in v (Franke & Little 1980: ((R − r_i) / (R r_i))² with r_i the
 * distance of the directions, R that of the first view without weight; their sum is 1). h decide
 * the values where no view of the triangle sees p. The cosine lets a slanted view, whose pixels are
 * larger on the sample, count less. All weights are continuous in v, so that no seam appears where
 * the triangle changes, and at a measured direction the view itself alone counts. Values still
 * change at once where a view loses sight of a surface that it grazes.
 *
 * D_i is bilinear among those of the four texels around x_i that lie on one surface with the
 * nearest: edges are not bridged. B(x_i, …) is bicubic (Keys 1981) where the 16 texels around x_i
 * lie on one surface, else bilinear like D_i. Where no view sees anything on the ray, values are
 * mixed at x as if the material were flat, and the hit says so.
 *
 * Directions differ from texel to texel, since cameras are near (near_field.h): v counts as the
 * direction from the sample's centre to the point x + R v, R being the cameras' mean distance.
 */
#pragma once

#include "base/vec.h"
#include "mdf/mdf_views.h"

#define REPROJECTION_MOST_VIEWS 12 /* that a ray asks */
#define REPROJECTION_VIEW_TAPS  16 /* texels of a view that a value is mixed of */
#define REPROJECTION_MOST_TAPS  (REPROJECTION_VIEW_TAPS * REPROJECTION_MOST_VIEWS)

struct reprojection_view { /* a measured view */
    double centre_mm[3];   /* its camera, sample frame */
    const float *distance; /* n_texels, mm; −1: not known */
    const float *error_mm; /* the same shape, standard errors, −1: not known; NULL: none is */
};

typedef struct Reprojection Reprojection; /* any number of threads may ask one at once */

/* The views' planes are copied. tiled: texels repeat beyond the plane; else nothing is known there.
 * DATA_ERROR_INVALID: no views, a camera that is not above the plane, or no distance is known. */
Reprojection *reprojection_new(const struct mdf_plane *plane, const struct reprojection_view *views,
                               int n, gboolean tiled, GError **error);

/* Reads the MDF of a session (products/mdf.exr). Its views are ordered as n directions, those of a
 * BTF; a direction without an MDF has no distances. */
Reprojection *reprojection_read(const char *path, const float *theta_deg, const float *phi_deg,
                                int n, gboolean tiled, GError **error);
void reprojection_free(Reprojection *reprojection); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Reprojection, reprojection_free)

const struct mdf_plane *reprojection_plane(const Reprojection *reprojection);

/* Weights of the views for a ray. */
struct reprojection_weights {
    int n;
    int view[REPROJECTION_MOST_VIEWS];
    float flat[REPROJECTION_MOST_VIEWS];  /* b */
    float value[REPROJECTION_MOST_VIEWS]; /* w */
    float depth[REPROJECTION_MOST_VIEWS]; /* u */
};
/* at_mm: x, y of a point of the reference plane; v: unit vector, upwards. */
void reprojection_weigh(const Reprojection *reprojection, const double at_mm[2], struct vec3 v,
                        struct reprojection_weights *ret);

/* What a ray meets. */
struct reprojection_hit {
    gboolean seen; /* FALSE: no view sees anything on it */
    double mm;     /* d(x, v); not seen: −1 */
    struct vec3 p; /* not seen: x */
    double weight; /* Σ_i w_i s(q_i); not seen: Σ_i b_i = 1 */
};
void reprojection_trace(const Reprojection *reprojection, const double at_mm[2], struct vec3 v,
                        const struct reprojection_weights *weights, struct reprojection_hit *ret);

/* A value is Σ weight · B(texel, view, l); the weights of all taps sum to 1. */
struct reprojection_tap {
    int view, texel;
    float weight;
};

/* The taps of one view in a hit, k < weights->n. Returns their number. */
int reprojection_look(const Reprojection *reprojection, const struct reprojection_hit *hit,
                      const struct reprojection_weights *weights, int k,
                      struct reprojection_tap ret[REPROJECTION_VIEW_TAPS]);

/* All of the above for one ray: returns the number of taps. */
int reprojection_taps(const Reprojection *reprojection, const double at_mm[2], struct vec3 v,
                      struct reprojection_hit *ret_hit,
                      struct reprojection_tap ret[REPROJECTION_MOST_TAPS]);

/* A new view: a camera, or a direction that is the same for all texels. */
struct reprojection_target {
    gboolean near;
    struct vec3 at; /* near: the camera's centre, mm, sample frame; else a unit vector */
};
/* The unit vector from a point of the reference plane towards a target. */
struct vec3 reprojection_towards(const Reprojection *reprojection,
                                 const struct reprojection_target *target, const double at_mm[2]);

/* The centre of a texel, row 0 at +y. */
void reprojection_texel_mm(const Reprojection *reprojection, int texel, double ret_mm[2]);
