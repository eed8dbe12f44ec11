#include "reprojection.h"

#include "base/data_error.h"
#include "directions/directions.h"
#include "exr/exr.h"

#include <math.h>
#include <string.h>

/* TOLERANCE, EPSILON, SHORTER, CUBIC and ONE_COLOUR were chosen with the weave and the brick of
 * tests/bench/fast_materials, see docs/lab/fast.md. */
#define TOLERANCE 0.5  /* T_i of reprojection.h is TOLERANCE texels … */
#define ERRORS    2.0  /* … plus ERRORS standard errors of the MDF */
#define EPSILON   0.05 /* ε of reprojection.h */
#define SHORTER   0.7  /* exponent a of reprojection.h */
#define NEAREST   8    /* maximum number of views that have a weight h */
#define STEP      0.25 /* step between the points of a ray that are examined, in texels */
/* Neighbouring texels are on different surfaces if their distances differ by more than this. In
 * texels, divided by the cosine of the view's polar angle. */
#define ONE_SURFACE 0.75
/* The limit for texels whose values are mixed, as ONE_SURFACE is the limit for their distances.
 * ONE_COLOUR is larger, because a value belongs to the whole area of a texel. Even at a small step,
 * a mix of two values is then nearer to the truth than one of them. */
#define ONE_COLOUR 1.6
#define CUBIC      (-0.6F) /* parameter of Keys' kernel */
#define HALVINGS   6       /* number of bisections of the step in which the ray meets the surface */

struct eye { /* a view */
    struct mdf_eye mdf;
    struct vec3 direction; /* from the plane's centre, unit vector */
    float step_mm;         /* see ONE_SURFACE */
    float colour_mm;       /* see ONE_COLOUR */
    float *distance, *error_mm;
};

struct Reprojection {
    struct mdf_plane plane;
    int n;
    struct eye *eyes;
    gboolean tiled;
    Directions *directions;
    double radius_mm;  /* mean distance of the cameras from the plane's centre */
    double deepest_mm; /* maximum depth below the reference plane */
};

static struct vec3 reprojection_centre(const double centre_mm[3]) {
    return vec3(centre_mm[0], centre_mm[1], centre_mm[2]);
}

static gboolean add_eye(Reprojection *s, int k, const struct reprojection_view *view,
                        GError **error) {
    const gsize n = (gsize)s->plane.width * (gsize)s->plane.height;
    struct eye *eye = &s->eyes[k];
    const struct vec3 centre =
        vec3_sub(reprojection_centre(view->centre_mm), vec3(0, 0, s->plane.reference_mm));
    if (!(centre.z > 0)) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the camera of view %d, counted from 0, is at z = %g mm, but must be above the "
                    "reference plane at z = %g mm; process the session again",
                    k, view->centre_mm[2], s->plane.reference_mm);
        return FALSE;
    }
    eye->distance = g_memdup2(view->distance, n * sizeof(float));
    eye->error_mm = view->error_mm ? g_memdup2(view->error_mm, n * sizeof(float)) : NULL;
    memcpy(eye->mdf.centre_mm, view->centre_mm, sizeof eye->mdf.centre_mm);
    eye->mdf.distance = eye->distance;
    eye->direction = vec3_unit(centre);
    eye->step_mm = (float)(ONE_SURFACE * s->plane.texel_mm / MAX(eye->direction.z, 0.1));
    eye->colour_mm = eye->step_mm * (float)(ONE_COLOUR / ONE_SURFACE);
    s->radius_mm += vec3_length(centre) / s->n;
    for (gsize i = 0; i < n; i++)
        if (eye->distance[i] >= 0)
            s->deepest_mm =
                MAX(s->deepest_mm,
                    s->plane.reference_mm -
                        mdf_views_point(&eye->mdf, &s->plane, (int)i, (double)eye->distance[i]).z);
    return TRUE;
}

Reprojection *reprojection_new(const struct mdf_plane *plane, const struct reprojection_view *views,
                               int n, gboolean tiled, GError **error) {
    if (n < 1) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "the session has no view from which another view can be predicted; process the "
                    "session first");
        return NULL;
    }
    g_autoptr(Reprojection) s = g_new0(Reprojection, 1);
    g_autofree float *theta_deg = g_new(float, n), *phi_deg = g_new(float, n);
    s->plane = *plane;
    s->n = n;
    s->tiled = tiled;
    s->eyes = g_new0(struct eye, n);
    s->deepest_mm = -1;
    for (int k = 0; k < n; k++) {
        if (!add_eye(s, k, &views[k], error))
            return NULL;
        const struct vec3 v = s->eyes[k].direction;
        theta_deg[k] = (float)(acos(CLAMP(v.z, 0, 1)) * 180 / G_PI);
        phi_deg[k] = (float)(atan2(v.y, v.x) * 180 / G_PI);
    }
    if (s->deepest_mm < 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INVALID,
                    "no view of the MDF has a distance; capture the laser sweeps, then process the "
                    "session again");
        return NULL;
    }
    s->directions = directions_new_triangulated(theta_deg, phi_deg, n, error);
    return s->directions ? g_steal_pointer(&s) : NULL;
}

void reprojection_free(Reprojection *s) {
    if (!s)
        return;
    for (int k = 0; k < s->n; k++) {
        g_free(s->eyes[k].distance);
        g_free(s->eyes[k].error_mm);
    }
    g_free(s->eyes);
    directions_free(s->directions);
    g_free(s);
}

const struct mdf_plane *reprojection_plane(const Reprojection *s) {
    return &s->plane;
}

void reprojection_texel_mm(const Reprojection *s, int texel, double ret_mm[2]) {
    const int column = texel % s->plane.width, row = texel / s->plane.width;
    ret_mm[0] = (column + 0.5 - 0.5 * s->plane.width) * s->plane.texel_mm;
    ret_mm[1] = (0.5 * s->plane.height - row - 0.5) * s->plane.texel_mm;
}

/* Returns the index of the view among the weights. The view is added if it is missing. Returns −1
 * if the weights are full. */
static int weight_of(struct reprojection_weights *weights, int view) {
    for (int k = 0; k < weights->n; k++)
        if (weights->view[k] == view)
            return k;
    if (weights->n == REPROJECTION_MAX_VIEWS)
        return -1;
    weights->view[weights->n] = view;
    weights->flat[weights->n] = weights->value[weights->n] = weights->depth[weights->n] = 0;
    return weights->n++;
}

/* Computes h of reprojection.h: Franke and Little's weights of the NEAREST views. ret_view is
 * sorted by the angle between the view and v. Returns the number of these views, which is less than
 * NEAREST if there are fewer views. */
static int reprojection_nearest(const Reprojection *s, struct vec3 v, int ret_view[NEAREST],
                                double ret_weight[NEAREST]) {
    double r[NEAREST + 1] = {0}, sum = 0;
    int view[NEAREST + 1], n = 0;
    for (int k = 0; k < s->n; k++) {
        const double distance = vec3_length(vec3_sub(s->eyes[k].direction, v));
        int at = MIN(n, NEAREST);
        if (n == NEAREST + 1 && distance >= r[NEAREST])
            continue;
        for (; at > 0 && r[at - 1] > distance; at--) {
            r[at] = r[at - 1];
            view[at] = view[at - 1];
        }
        r[at] = distance;
        view[at] = k;
        n = MIN(n + 1, NEAREST + 1);
    }
    const double end = n > NEAREST ? r[NEAREST] : 1.5 * r[MAX(n, 1) - 1] + 1e-6;
    n = MIN(n, NEAREST);
    for (int k = 0; k < n; k++) {
        const double at = MAX(r[k], 1e-6), h = MAX(end - at, 0) / (end * at);
        ret_view[k] = view[k];
        ret_weight[k] = h * h;
        sum += h * h;
    }
    for (int k = 0; k < n; k++)
        ret_weight[k] = sum > 0 ? ret_weight[k] / sum : 1.0 / n;
    return n;
}

void reprojection_weigh(const Reprojection *s, const double at_mm[2], struct vec3 v,
                        struct reprojection_weights *ret) {
    const struct vec3 nominal =
        vec3_unit(vec3(at_mm[0] + s->radius_mm * v.x, at_mm[1] + s->radius_mm * v.y,
                       s->radius_mm * MAX(v.z, 1e-3)));
    struct direction_weights flat;
    int view[NEAREST];
    double weight[NEAREST];
    float sum = 0;
    ret->n = 0;
    directions_weights(s->directions, nominal, &flat);
    for (int i = 0; i < 4; i++) {
        if (!(flat.weight[i] > 0))
            continue;
        const int k = weight_of(ret, flat.index[i]);
        const double cosine = s->eyes[flat.index[i]].direction.z;
        ret->flat[k] += flat.weight[i];
        ret->depth[k] += flat.weight[i];
        ret->value[k] += flat.weight[i] * (float)pow(cosine, SHORTER);
    }
    for (int k = 0; k < ret->n; k++)
        sum += ret->value[k];
    for (int k = 0; k < ret->n; k++)
        ret->value[k] /= sum;
    const int n = reprojection_nearest(s, nominal, view, weight);
    for (int i = 0; i < n; i++) {
        const int k = weight_of(ret, view[i]);
        ret->value[k] += (float)(EPSILON * weight[i]);
        ret->depth[k] += (float)weight[i];
    }
}

/* Returns the index of a texel at a column and a row, which may lie beyond the plane's edges. If
 * the sample is tiled, columns and rows repeat there. If not, the nearest texel at the border is
 * returned. */
static int reprojection_texel(const Reprojection *s, int x, int y) {
    const int width = s->plane.width, height = s->plane.height;
    if (s->tiled) {
        x = ((x % width) + width) % width;
        y = ((y % height) + height) % height;
    }
    return CLAMP(y, 0, height - 1) * width + CLAMP(x, 0, width - 1);
}

/* A position among texels: the column and row of the texel before it, and the remainders, 0 … 1. */
struct place {
    int i, j;
    float u, v;
};

/* Splits a position into a texel and remainders. Returns FALSE if the position is outside of the
 * texels and the sample is not tiled, or if it is beyond ±1e6 texels. */
static gboolean reprojection_place(const Reprojection *s, double column, double row,
                                   struct place *ret) {
    if (!(fabs(column) < 1e6 && fabs(row) < 1e6))
        return FALSE;
    ret->i = (int)floor(column);
    ret->j = (int)floor(row);
    ret->u = (float)(column - ret->i);
    ret->v = (float)(row - ret->j);
    return s->tiled || (column >= -0.5 && row >= -0.5 && column <= s->plane.width - 0.5 &&
                        row <= s->plane.height - 0.5);
}

/* Gives the four texels around a place, and their bilinear weights. */
static void four(const Reprojection *s, const struct place *at, int ret_texel[4],
                 float ret_weight[4]) {
    for (int k = 0; k < 4; k++) {
        ret_texel[k] = reprojection_texel(s, at->i + (k & 1), at->j + (k >> 1));
        ret_weight[k] = (k & 1 ? at->u : 1 - at->u) * (k >> 1 ? at->v : 1 - at->v);
    }
}

/* Gives the weights with which samples at −1, 0, 1 and 2 are interpolated at u, 0 … 1 (Keys
 * 1981). */
static void cubic(float u, float ret[4]) {
    const float a = CUBIC;
    for (int k = 0; k < 4; k++) {
        const float x = fabsf(u - (float)(k - 1));
        ret[k] = x <= 1 ? ((a + 2) * x - (a + 3)) * x * x + 1
                        : ((a * x - 5 * a) * x + 8 * a) * x - 4 * a;
    }
}

/* What a view shows along the ray from its camera to a point p (examine()). */
struct look {
    double q; /* q_i of reprojection.h; INFINITY if the view shows nothing there */
    struct place at;
    float distance; /* of the nearest texel */
    int texel[4];
    /* weights of the texels, with the sum 1; 0 for a texel that is on another surface */
    float weight[4];
};

static void examine(const Reprojection *s, const struct eye *eye, struct vec3 p, struct look *ret) {
    double column, row, mm;
    ret->q = INFINITY;
    mdf_views_look_up(&eye->mdf, &s->plane, p, &column, &row, &mm);
    if (!reprojection_place(s, column, row, &ret->at))
        return;
    four(s, &ret->at, ret->texel, ret->weight);
    int nearest = -1;
    for (int k = 0; k < 4; k++)
        if (eye->distance[ret->texel[k]] >= 0 &&
            (nearest < 0 || ret->weight[k] > ret->weight[nearest]))
            nearest = k;
    if (nearest < 0)
        return;
    ret->distance = eye->distance[ret->texel[nearest]];
    float sum = 0, distance = 0, error_mm = 0;
    for (int k = 0; k < 4; k++) {
        const float d = eye->distance[ret->texel[k]];
        if (!(d >= 0) || fabsf(d - ret->distance) > eye->step_mm)
            ret->weight[k] = 0;
        sum += ret->weight[k];
        distance += ret->weight[k] * d;
        if (eye->error_mm)
            error_mm += ret->weight[k] * MAX(eye->error_mm[ret->texel[k]], 0);
    }
    if (!(sum > 1e-6F))
        return;
    for (int k = 0; k < 4; k++)
        ret->weight[k] /= sum;
    const double tolerance = TOLERANCE * s->plane.texel_mm + ERRORS * (double)(error_mm / sum);
    ret->q = (mm - (double)(distance / sum)) / tolerance;
}

/* Gives the taps of a value, and returns their number. If all 4 × 4 texels around the position are
 * on one surface, they are the taps. If not, the taps are those of the 2 × 2 texels around the
 * position that are on the surface of the nearest texel. */
static int spread(const Reprojection *s, int view, const struct look *look, double weight,
                  struct reprojection_tap *ret) {
    const struct eye *eye = &s->eyes[view];
    float across[4], down[4];
    int n = 0;
    gboolean one = TRUE;
    cubic(look->at.u, across);
    cubic(look->at.v, down);
    for (int k = 0; k < 16 && one; k++) {
        const int texel = reprojection_texel(s, look->at.i - 1 + k % 4, look->at.j - 1 + k / 4);
        const float d = eye->distance[texel];
        ret[k] =
            (struct reprojection_tap){view, texel, (float)weight * across[k % 4] * down[k / 4]};
        /* The 4 × 4 texels reach two texels from the position, whereas the 2 × 2 texels reach one.
         * Therefore twice the difference in distance is allowed. */
        one = d >= 0 && fabsf(d - look->distance) <= 2 * eye->colour_mm;
    }
    if (one)
        return 16;
    float share[4], sum = 0;
    int texel[4];
    four(s, &look->at, texel, share);
    for (int k = 0; k < 4; k++) {
        const float d = eye->distance[texel[k]];
        if (!(d >= 0) || fabsf(d - look->distance) > eye->colour_mm)
            share[k] = 0;
        sum += share[k];
    }
    for (int k = 0; k < 4; k++)
        if (share[k] > 0)
            ret[n++] = (struct reprojection_tap){view, texel[k], (float)weight * share[k] / sum};
    return n;
}

/* Returns s(q) of reprojection.h. */
static double visible(double q) {
    return CLAMP(2 - fabs(q), 0, 1);
}

/* Returns F of reprojection.h at a point. */
static double reprojection_vote(const Reprojection *s, struct vec3 p,
                                const struct reprojection_weights *weights) {
    double sum = 0;
    for (int k = 0; k < weights->n; k++) {
        struct look look;
        examine(s, &s->eyes[weights->view[k]], p, &look);
        const double q = look.q, f = q < -1 ? -1 : q <= 1 ? q : q < 2 ? 2 - q : 0;
        sum += (double)weights->depth[k] * f;
    }
    return sum;
}

static struct vec3 point(const Reprojection *s, const double at_mm[2], struct vec3 v, double mm) {
    return vec3_sub(vec3(at_mm[0], at_mm[1], s->plane.reference_mm), vec3_scale(v, mm));
}

/* Marches along the ray until F rises through 0, and halves the last step HALVINGS times. Returns
 * d(x, v) in mm, or −1 if F does not rise through 0. */
static double march(const Reprojection *s, const double at_mm[2], struct vec3 v,
                    const struct reprojection_weights *weights) {
    const double step = STEP * s->plane.texel_mm, end = (s->deepest_mm + step) / MAX(v.z, 0.05);
    double before = -2 * step, vote = reprojection_vote(s, point(s, at_mm, v, before), weights);
    for (double at = -step; at < end + 2 * step; at += step) {
        const double next = reprojection_vote(s, point(s, at_mm, v, at), weights);
        if (vote < 0 && next > 0) {
            double low = before, high = at;
            for (int k = 0; k < HALVINGS; k++) {
                const double middle = 0.5 * (low + high);
                if (reprojection_vote(s, point(s, at_mm, v, middle), weights) > 0)
                    high = middle;
                else
                    low = middle;
            }
            return MAX(0.5 * (low + high), 0);
        }
        before = at;
        vote = next;
    }
    return -1;
}

void reprojection_trace(const Reprojection *s, const double at_mm[2], struct vec3 v,
                        const struct reprojection_weights *weights, struct reprojection_hit *ret) {
    *ret = (struct reprojection_hit){.mm = march(s, at_mm, v, weights)};
    ret->p = point(s, at_mm, v, MAX(ret->mm, 0));
    for (int k = 0; ret->mm >= 0 && k < weights->n; k++) {
        struct look look;
        examine(s, &s->eyes[weights->view[k]], ret->p, &look);
        ret->weight += (double)weights->value[k] * visible(look.q);
    }
    ret->seen = ret->weight > 1e-6;
    if (ret->seen)
        return;
    *ret = (struct reprojection_hit){.mm = -1, .p = point(s, at_mm, v, 0)};
    for (int k = 0; k < weights->n; k++)
        ret->weight += (double)weights->flat[k];
}

int reprojection_look(const Reprojection *s, const struct reprojection_hit *hit,
                      const struct reprojection_weights *weights, int k,
                      struct reprojection_tap ret[REPROJECTION_VIEW_TAPS]) {
    const int view = weights->view[k];
    struct look look = {0};
    if (hit->seen) {
        examine(s, &s->eyes[view], hit->p, &look);
        const double weight = (double)weights->value[k] * visible(look.q);
        return weight > 0 ? spread(s, view, &look, weight / hit->weight, ret) : 0;
    }
    const double column = hit->p.x / s->plane.texel_mm + 0.5 * s->plane.width - 0.5;
    const double row = 0.5 * s->plane.height - hit->p.y / s->plane.texel_mm - 0.5;
    if (!reprojection_place(s, column, row, &look.at))
        return 0;
    four(s, &look.at, look.texel, look.weight);
    int n = 0;
    for (int i = 0; i < 4; i++)
        if (look.weight[i] > 0 && weights->flat[k] > 0)
            ret[n++] = (struct reprojection_tap){view, look.texel[i],
                                                 (float)((double)weights->flat[k] / hit->weight) *
                                                     look.weight[i]};
    return n;
}

int reprojection_taps(const Reprojection *s, const double at_mm[2], struct vec3 v,
                      struct reprojection_hit *ret_hit,
                      struct reprojection_tap ret[REPROJECTION_MAX_TAPS]) {
    struct reprojection_weights weights;
    int n = 0;
    reprojection_weigh(s, at_mm, v, &weights);
    reprojection_trace(s, at_mm, v, &weights, ret_hit);
    for (int k = 0; k < weights.n; k++)
        n += reprojection_look(s, ret_hit, &weights, k, ret + n);
    return n;
}
