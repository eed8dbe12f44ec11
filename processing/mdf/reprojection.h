/* Interpolation between views along the surface. If a material has relief, a texel x of the
 * reference plane shows another surface point in each view, and a mix of its values has ghosts. The
 * MDF of each view says which point the view shows. To predict a new view, the pictures of the
 * measured views are first moved along the surface, so that each shows the same point, and then
 * mixed.
 *
 * v is the unit vector from x towards a new camera. For each measured view i, v_i is the direction,
 * c_i the position of the camera, and D_i the MDF (pipeline.h): the distance of the surface behind
 * the plane, along the ray. Further symbols:
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
 * The weights w_i and u_i of the views are
 *
 *   u_i = b_i + h_i
 *   w_i = b_i' + ε h_i             b_i' = b_i (cos θ_i)^a / Σ_j b_j (cos θ_j)^a
 *
 * The b are barycentric weights of v in the triangulation of the measured directions
 * (directions.h). Outside of the triangulation, the b are the weights of the nearest point of its
 * border. The cosine reduces the weight of a slanted view, whose pixels are larger on the sample.
 *
 * The h are weights of the nearest views with the sum 1, which are continuous in v (Franke & Little
 * 1980). They are proportional to ((R − r_i) / (R r_i))², where r_i is the distance between v and
 * v_i, and R the distance to the nearest view without weight. The h decide the values where no view
 * of the triangle sees p.
 *
 * All weights are continuous in v, so that no seam appears where the triangle changes. At a
 * measured direction, only the view itself counts. Values still change abruptly where a view loses
 * sight of a surface that it sees at a grazing angle.
 *
 * D_i is bilinear among those of the four texels around x_i that lie on one surface with the
 * nearest texel, so that edges are not bridged. B(x_i, …) is bicubic (Keys 1981) if the 16 texels
 * around x_i lie on one surface, otherwise bilinear like D_i. If no view sees anything on the ray,
 * values are mixed at x as if the material were flat, and the hit says so.
 *
 * Directions differ from texel to texel, because cameras are near (near_field.h). v is the
 * direction from the sample's centre to the point x + R v, where R is the cameras' mean
 * distance. */
#pragma once

#include "base/vec.h"
#include "mdf_views.h"

#define REPROJECTION_MAX_VIEWS 12 /* maximum number of views that a ray uses */
/* maximum number of texels of a view from which a value is mixed */
#define REPROJECTION_VIEW_TAPS 16
#define REPROJECTION_MAX_TAPS  (REPROJECTION_VIEW_TAPS * REPROJECTION_MAX_VIEWS)

struct reprojection_view { /* a measured view */
    double centre_mm[3];   /* position of the camera, sample frame */
    const float *distance; /* n_texels, mm; −1 if not known */
    /* standard errors of the distances, n_texels; −1 if not known; NULL if none is known */
    const float *error_mm;
};

/* Any number of threads may call the functions on the same object at the same time. */
typedef struct Reprojection Reprojection;

/* Makes a reprojection. The planes of the views are copied. If tiled, the texels repeat beyond the
 * plane; if not, nothing is known there. Returns NULL with DATA_ERROR_INVALID if there are no
 * views, if a camera is not above the plane, or if no distance is known. */
Reprojection *reprojection_new(const struct mdf_plane *plane, const struct reprojection_view *views,
                               int n, gboolean tiled, GError **error);

/* Reads the MDF of a session (products/mdf.exr). Its views are put into the order of n directions,
 * which are those of a BTF. A direction that has no view in the MDF has no distances.
 *
 * Returns NULL with DATA_ERROR_INVALID for the causes of reprojection_new(), and if
 * - the file has no views,
 * - the first view lacks reference_mm or a texel_mm above 0,
 * - a view lacks its distances or the position of its camera, has values that are not finite, or
 *   differs from the first view in size. */
Reprojection *reprojection_read(const char *path, const float *theta_deg, const float *phi_deg,
                                int n, gboolean tiled, GError **error);
void reprojection_free(Reprojection *reprojection); /* NULL is ignored */
G_DEFINE_AUTOPTR_CLEANUP_FUNC(Reprojection, reprojection_free)

const struct mdf_plane *reprojection_plane(const Reprojection *reprojection);

/* The weights of the views for a ray. */
struct reprojection_weights {
    int n;
    int view[REPROJECTION_MAX_VIEWS];
    float flat[REPROJECTION_MAX_VIEWS];  /* b_i of the text above */
    float value[REPROJECTION_MAX_VIEWS]; /* w_i */
    float depth[REPROJECTION_MAX_VIEWS]; /* u_i */
};
/* Computes weights for the ray through the point at_mm (x, y) of the reference plane. v is the unit
 * vector from this point to the camera, above the horizon. */
void reprojection_weigh(const Reprojection *reprojection, const double at_mm[2], struct vec3 v,
                        struct reprojection_weights *ret);

/* The surface point that a ray meets. */
struct reprojection_hit {
    gboolean seen; /* FALSE if no view sees anything on the ray */
    double mm;     /* d(x, v); −1 if not seen */
    /* the point of the surface; if not seen, the texel's point x on the reference plane */
    struct vec3 p;
    double weight; /* Σ_i w_i s(q_i); if not seen, Σ_i b_i = 1 */
};
void reprojection_trace(const Reprojection *reprojection, const double at_mm[2], struct vec3 v,
                        const struct reprojection_weights *weights, struct reprojection_hit *ret);

/* A value is Σ weight · B(texel, view, l) over all taps. The weights of all taps sum to 1. A ray
 * has no taps if no view sees it and it meets the plane outside of the texels of a sample that is
 * not tiled. */
struct reprojection_tap {
    int view, texel;
    float weight;
};

/* Gives the taps of the view weights->view[k] at a hit, k < weights->n. Returns the number of
 * taps. */
int reprojection_look(const Reprojection *reprojection, const struct reprojection_hit *hit,
                      const struct reprojection_weights *weights, int k,
                      struct reprojection_tap ret[REPROJECTION_VIEW_TAPS]);

/* Computes the weights, the hit and the taps of all views for one ray. Returns the number of
 * taps. */
int reprojection_taps(const Reprojection *reprojection, const double at_mm[2], struct vec3 v,
                      struct reprojection_hit *ret_hit,
                      struct reprojection_tap ret[REPROJECTION_MAX_TAPS]);

/* Gives x and y of a texel's centre in the sample frame; row 0 is at +y. */
void reprojection_texel_mm(const Reprojection *reprojection, int texel, double ret_mm[2]);
