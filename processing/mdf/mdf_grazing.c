/* Adds views at grazing angles. No camera of a rig has such views, but renderers need such views
 * for silhouettes. The points of the steep views form a height field (relief), which is traced
 * along flat rays. */
#include "mdf_table.h"

#include <math.h>
#include <string.h>

#define DEG     (G_PI / 180.0)
#define N_PHI   36  /* number of views in an added ring */
#define GAP_DEG 2.5 /* degrees of θ between rings */
/* degrees; views at most this far from the steepest view form the relief */
#define STEEP_DEG  20.0
#define MAX_RAISED 2.0 /* maximum of raised (make_relief()), in standard deviations */
/* degrees; no slope of raised is computed from rings with a smaller θ, because they tell nothing
 * about flat rays */
#define MIN_NEXT_DEG 20.0
#define HALVINGS     8   /* number of bisections in the search for raised */
#define STEP         0.5 /* step along a ray, in texels */

static const double rings_deg[] = {80.0, 84.0, 87.0};

/* Depth below the reference plane, periodic in both dimensions. The arrays are h × w. For the
 * points of a texel, weight is the sum of their weights, and square the sum of their weighted
 * squared depths. */
struct relief {
    int w, h;
    float *depth_mm, *square, *weight;
    double texel_mm;
};

static int wrap(int i, int n) {
    const int rest = i % n;
    return rest < 0 ? rest + n : rest;
}

/* Gives the four texels around (x, y), in texels from the centre of the first one, and their
 * bilinear weights. */
static void around(const struct relief *r, double x, double y, gsize ret_at[4],
                   double ret_weight[4]) {
    const double fx = floor(x), fy = floor(y), u = x - fx, v = y - fy;
    const int left = wrap((int)fx, r->w), right = left + 1 < r->w ? left + 1 : 0;
    const int above = wrap((int)fy, r->h), below = above + 1 < r->h ? above + 1 : 0;
    const gsize upper = (gsize)above * (gsize)r->w, lower = (gsize)below * (gsize)r->w;
    ret_at[0] = upper + (gsize)left;
    ret_at[1] = upper + (gsize)right;
    ret_at[2] = lower + (gsize)left;
    ret_at[3] = lower + (gsize)right;
    ret_weight[0] = (1.0 - u) * (1.0 - v);
    ret_weight[1] = u * (1.0 - v);
    ret_weight[2] = (1.0 - u) * v;
    ret_weight[3] = u * v;
}

/* Gives by how many columns and rows a ray from the viewer advances per mm of depth: −tan θ (cos φ,
 * −sin φ) / texel_mm. */
static void direction(const struct mdf_table *t, double theta_deg, double phi_deg, double ret[2]) {
    double slant = tan(theta_deg * DEG) / t->texel_mm;
    ret[0] = -slant * cos(phi_deg * DEG);
    ret[1] = slant * sin(phi_deg * DEG);
}

/* Makes the relief from the points of the steep views. A texel with depth z has its point at
 * (column, row) + z·step. The point is added to the texels around this place. The depth of the
 * relief is mean − raised · standard deviation of the points in a texel. Holes are filled. */
static void make_relief(const struct mdf_table *t, double raised, struct relief *r) {
    gsize n = (gsize)t->width * t->height, at[4];
    double steepest = 90.0, step[2], share[4];
    *r = (struct relief){t->width,         t->height,        g_new0(float, n),
                         g_new0(float, n), g_new0(float, n), t->texel_mm};
    for (int k = 0; k < t->n_views; k++)
        steepest = MIN(steepest, (double)t->theta_deg[k]);
    for (int view = 0; view < t->n_views; view++) {
        direction(t, t->theta_deg[view], t->phi_deg[view], step);
        for (gsize k = 0; k < n && t->theta_deg[view] <= steepest + STEEP_DEG; k++) {
            double depth = t->depth_mm[view * n + k];
            gsize row = k / t->width, column = k % t->width;
            around(r, (double)column + depth * step[0], (double)row + depth * step[1], at, share);
            for (int c = 0; c < 4; c++) {
                r->depth_mm[at[c]] += share[c] * depth;
                r->square[at[c]] += share[c] * depth * depth;
                r->weight[at[c]] += share[c];
            }
        }
    }
    for (gsize k = 0; k < n; k++) {
        double weight = r->weight[k], mean = weight > 1e-3 ? r->depth_mm[k] / weight : -1.0;
        double spread = weight > 1e-3 ? sqrt(MAX(r->square[k] / weight - mean * mean, 0.0)) : 0.0;
        r->depth_mm[k] = mean < 0.0 ? -1.0 : MAX(mean - raised * spread, 0.0);
    }
    mdf_table_fill(r->depth_mm, t->width, t->height);
}

/* Finds the depths at which the rays from the texels of the reference plane first meet the relief.
 * Searches in steps of STEP texels, then interpolates linearly between the last two points. Rays
 * that do not meet the relief get the depth deepest_mm. */
static void trace_view(struct mdf_table *t, int view, const struct relief *r) {
    gsize n = (gsize)t->width * t->height, at[4];
    double step[2], weight[4];
    direction(t, t->theta_deg[view], t->phi_deg[view], step);
    const double by = STEP / hypot(step[0], step[1]);
    for (gsize k = 0; k < n; k++) {
        const gsize j = k / t->width;
        const double row = (double)j, column = (double)(k % t->width);
        double before = 0.0, above = 0.0, met = t->deepest_mm;
        for (double depth = 0.0; depth < t->deepest_mm; depth += by) {
            double over = 0.0;
            around(r, column + depth * step[0], row + depth * step[1], at, weight);
            for (int c = 0; c < 4; c++)
                over += weight[c] * r->depth_mm[at[c]];
            over -= depth;
            if (over <= 0.0) {
                met = depth > 0.0 ? before + by * above / (above - over) : 0.0;
                break;
            }
            before = depth;
            above = over;
        }
        t->depth_mm[view * n + k] = met;
    }
}

static void clear_relief(struct relief *r) {
    g_free(r->depth_mm);
    g_free(r->weight);
    g_free(r->square);
}

/* Returns the mean of traced minus measured depth over the texels that a laser saw, or 0 if there
 * are none. The mean is over the views with polar angles from theta_deg − GAP_DEG to theta_deg. */
static double ring_error_mm(const struct mdf_table *t, double theta_deg, double raised) {
    gsize n = (gsize)t->width * t->height, count = 0;
    double sum = 0.0;
    struct mdf_table *one = mdf_table_new(t->width, t->height, 1, t->texel_mm, NULL, NULL);
    struct relief relief;
    one->deepest_mm = t->deepest_mm;
    make_relief(t, raised, &relief);
    for (int view = 0; view < t->n_views; view++) {
        if (t->theta_deg[view] > theta_deg || t->theta_deg[view] < theta_deg - GAP_DEG)
            continue;
        one->theta_deg[0] = t->theta_deg[view];
        one->phi_deg[0] = t->phi_deg[view];
        trace_view(one, 0, &relief);
        for (gsize k = 0; k < n; k++)
            if (t->seen == NULL || t->seen[view * n + k]) {
                sum += one->depth_mm[k] - t->depth_mm[view * n + k];
                count++;
            }
    }
    clear_relief(&relief);
    mdf_table_free(one);
    return count > 0 ? sum / (double)count : 0.0;
}

/* Returns the value of raised, 0 … MAX_RAISED, at which ring_error_mm() is 0, by bisection. Returns
 * 0 if the error is not above 0 there, and about MAX_RAISED if the error is above 0 everywhere.
 * Traced depths decrease when the relief rises. */
static double ring_raised(const struct mdf_table *t, double theta_deg) {
    double low = 0.0, high = MAX_RAISED;
    if (ring_error_mm(t, theta_deg, low) <= 0.0)
        return low;
    for (int k = 0; k < HALVINGS; k++) {
        double middle = 0.5 * (low + high);
        if (ring_error_mm(t, theta_deg, middle) > 0.0)
            low = middle;
        else
            high = middle;
    }
    return 0.5 * (low + high);
}

/* Returns the largest θ of a view that is at most theta_deg, or 0 if there is no such view. */
static double flattest_deg(const struct mdf_table *t, double theta_deg) {
    double flattest = 0.0;
    for (int k = 0; k < t->n_views; k++)
        if (t->theta_deg[k] <= theta_deg)
            flattest = MAX(flattest, (double)t->theta_deg[k]);
    return flattest;
}

double mdf_table_raised(const struct mdf_table *t) {
    return ring_raised(t, flattest_deg(t, 90.0));
}

/* Adds the views of those rings of rings_deg that are at least GAP_DEG flatter than the flattest
 * measured views. For a ring at θ, the relief is raised by raised + per_tan · (tan θ − tan θ_m),
 * limited to 0 … MAX_RAISED. θ_m is the angle of the flattest measured views. */
static void add_rings(struct mdf_table *t, double raised, double per_tan) {
    const double flattest = flattest_deg(t, 90.0);
    gsize n = (gsize)t->width * t->height;
    int first = t->n_views, most = first + N_PHI * (int)G_N_ELEMENTS(rings_deg);
    struct relief relief[G_N_ELEMENTS(rings_deg)];
    for (gsize ring = 0; ring < G_N_ELEMENTS(rings_deg); ring++) {
        double farther = tan(rings_deg[ring] * DEG) - tan(flattest * DEG);
        make_relief(t, CLAMP(raised + per_tan * farther, 0.0, MAX_RAISED), &relief[ring]);
    }
    t->theta_deg = g_renew(float, t->theta_deg, most);
    t->phi_deg = g_renew(float, t->phi_deg, most);
    t->depth_mm = g_renew(float, t->depth_mm, n *most);
    for (gsize ring = 0; ring < G_N_ELEMENTS(rings_deg); ring++) {
        for (int k = 0; k < N_PHI && rings_deg[ring] >= flattest + GAP_DEG; k++) {
            t->theta_deg[t->n_views] = rings_deg[ring];
            t->phi_deg[t->n_views] = 360.0 / N_PHI * k;
            trace_view(t, t->n_views++, &relief[ring]);
        }
        clear_relief(&relief[ring]);
    }
    if (t->seen) {
        t->seen = g_renew(guint8, t->seen, n * t->n_views);
        memset(t->seen + n * first, TRUE, n * (t->n_views - first));
    }
}

/* The path of a ray through the structure is proportional to tan θ. The ray meets the highest of
 * the points along this path, and the number of these points is also proportional to tan θ.
 * Therefore raised is extrapolated over tan θ through the two flattest rings. */
void mdf_table_add_grazing(struct mdf_table *t) {
    const double flattest = flattest_deg(t, 90.0), next = flattest_deg(t, flattest - 2 * GAP_DEG);
    const double raised = ring_raised(t, flattest);
    double per_tan = 0.0;
    if (next > MIN_NEXT_DEG && flattest < 90.0 - GAP_DEG)
        per_tan = (raised - ring_raised(t, next)) / (tan(flattest * DEG) - tan(next * DEG));
    add_rings(t, raised, MAX(per_tan, 0.0));
}

void mdf_table_trace(struct mdf_table *t) {
    struct relief relief;
    make_relief(t, 0.0, &relief);
    for (int view = 0; view < t->n_views; view++)
        trace_view(t, view, &relief);
    clear_relief(&relief);
}
