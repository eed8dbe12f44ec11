#include "directions.h"

#include "triangulation.h"

#include <string.h>

#define RING_GAP_DEG 2.5   /* minimum difference between the polar angles of neighbouring rings */
#define POLE_DEG     3.0   /* a single direction within this angle of the normal is the pole */
#define MIN_PHI_DEG  0.1   /* minimum gap between neighbouring azimuths of a ring */
#define MAX_PHI_DEG  179.0 /* maximum gap between neighbouring azimuths of a ring */
#define MAX_FLATNESS 4.0   /* maximum ratio of a step in azimuth to the step between rings */
#define SKY_CELLS    256   /* size of the square in each dimension over which the sky is summed */
#define DEG          (G_PI / 180.0)

G_DEFINE_QUARK(directions_error, directions_error)

struct entry {
    int index;
    double theta, phi; /* degrees, phi in [0, 360) */
};

struct ring {
    struct entry *entries; /* sorted by azimuth; a part of Directions.entries */
    int n;
    double gap; /* degrees to the nearer neighbouring ring */
};

struct Directions {
    int n;
    struct entry *entries;
    struct ring *rings; /* from the pole down; NULL if there are no rings */
    int n_rings;
    int *pole; /* members of the topmost ring if the pole is their mean */
    int n_pole;
    Triangulation *triangulation;
};

static int compare_theta(const void *a, const void *b) {
    const struct entry *x = a, *y = b;
    return x->theta != y->theta ? (x->theta < y->theta ? -1 : 1) : x->index - y->index;
}

static int compare_phi(const void *a, const void *b) {
    const struct entry *x = a, *y = b;
    return x->phi != y->phi ? (x->phi < y->phi ? -1 : 1) : x->index - y->index;
}

static double phi_gap(const struct ring *ring, int k) {
    double next = k + 1 < ring->n ? ring->entries[k + 1].phi : ring->entries[0].phi + 360.0;
    return next - ring->entries[k].phi;
}

/* Returns whether bilinear interpolation works on a ring. A ring needs azimuths all around, with
 * gaps that are not much larger than the gap to the next ring. The first ring may also be a single
 * direction, the pole. */
static gboolean ring_is_sound(const struct ring *ring, gboolean first) {
    if (ring->n == 1)
        return first && ring->entries[0].theta <= POLE_DEG;
    if (360.0 / ring->n * sin(ring->entries[0].theta * DEG) > MAX_FLATNESS * ring->gap)
        return FALSE;
    for (int k = 0; k < ring->n; k++) {
        double gap = phi_gap(ring, k);
        if (gap < MIN_PHI_DEG || gap > MAX_PHI_DEG)
            return FALSE;
    }
    return TRUE;
}

/* Splits the directions, sorted by theta, into rings at gaps of at least RING_GAP_DEG. Returns
 * FALSE if the directions do not form rings. The range of theta within a ring must be less than the
 * ring's distance from other rings, so that rings cannot cross. */
static gboolean find_rings(Directions *d) {
    g_autoptr(GArray) rings = g_array_new(FALSE, FALSE, sizeof(struct ring));
    double gap_before = G_MAXDOUBLE;
    for (int begin = 0, end; begin < d->n; begin = end) {
        for (end = begin + 1; end < d->n; end++)
            if (d->entries[end].theta - d->entries[end - 1].theta >= RING_GAP_DEG)
                break;
        double spread = d->entries[end - 1].theta - d->entries[begin].theta;
        double gap_after =
            end < d->n ? d->entries[end].theta - d->entries[end - 1].theta : G_MAXDOUBLE;
        struct ring ring = {d->entries + begin, end - begin, MIN(gap_before, gap_after)};
        g_array_append_val(rings, ring);
        if (spread >= MIN(ring.gap, 2.0 * RING_GAP_DEG))
            return FALSE;
        gap_before = gap_after;
    }
    for (guint k = 0; k < rings->len; k++) {
        struct ring *ring = &g_array_index(rings, struct ring, k);
        qsort(ring->entries, ring->n, sizeof(struct entry), compare_phi);
    }
    for (guint k = 0; k < rings->len; k++)
        if (!ring_is_sound(&g_array_index(rings, struct ring, k), k == 0))
            return FALSE;
    d->n_rings = rings->len;
    d->rings = (struct ring *)g_array_steal(rings, NULL);
    return TRUE;
}

static void to_plane(double theta_deg, double phi_deg, double ret[2]) {
    double r = tan(theta_deg * DEG / 2.0);
    ret[0] = r * cos(phi_deg * DEG);
    ret[1] = r * sin(phi_deg * DEG);
}

static void directions_triangulate(Directions *d) {
    g_autofree double *points = g_new(double, 2 * (gsize)d->n);
    for (int k = 0; k < d->n; k++)
        to_plane(d->entries[k].theta, d->entries[k].phi, points + 2 * d->entries[k].index);
    d->triangulation = triangulation_new(points, d->n);
}

static Directions *sorted(const float *theta_deg, const float *phi_deg, int n, GError **error) {
    if (n < 1 || n > DIRECTIONS_MAX) {
        g_set_error(error, DIRECTIONS_ERROR, DIRECTIONS_ERROR_RANGE,
                    "there are %d directions, but only 1 to %d can be interpolated; process or "
                    "import the material again",
                    n, DIRECTIONS_MAX);
        return NULL;
    }
    g_autoptr(Directions) d = g_new0(Directions, 1);
    d->n = n;
    d->entries = g_new(struct entry, n);
    for (int k = 0; k < n; k++) {
        if (!isfinite(theta_deg[k]) || !isfinite(phi_deg[k]) || theta_deg[k] < -1e-3f ||
            theta_deg[k] > 90.001f) {
            g_set_error(error, DIRECTIONS_ERROR, DIRECTIONS_ERROR_RANGE,
                        "direction %d, counted from 0, has theta %g° and phi %g°, but theta must "
                        "be 0 to 90°, and phi finite; process or import the material again",
                        k, (double)theta_deg[k], (double)phi_deg[k]);
            return NULL;
        }
        double phi = fmod(phi_deg[k], 360.0);
        phi = phi < 0.0 ? phi + 360.0 : phi;
        d->entries[k] =
            (struct entry){k, CLAMP((double)theta_deg[k], 0.0, 90.0), phi >= 360.0 ? 0.0 : phi};
    }
    qsort(d->entries, n, sizeof(struct entry), compare_theta);
    return g_steal_pointer(&d);
}

Directions *directions_new(const float *theta_deg, const float *phi_deg, int n, GError **error) {
    Directions *d = sorted(theta_deg, phi_deg, n, error);
    if (d == NULL)
        return NULL;
    if (!find_rings(d)) {
        directions_triangulate(d);
    } else if (d->rings[0].n > 1) {
        d->n_pole = d->rings[0].n;
        d->pole = g_new(int, d->n_pole);
        for (int k = 0; k < d->n_pole; k++)
            d->pole[k] = d->rings[0].entries[k].index;
    }
    return d;
}

Directions *directions_new_triangulated(const float *theta_deg, const float *phi_deg, int n,
                                        GError **error) {
    Directions *d = sorted(theta_deg, phi_deg, n, error);
    if (d != NULL)
        directions_triangulate(d);
    return d;
}

const int *directions_triangles(const Directions *d, int *ret_n) {
    *ret_n = 0;
    return d->triangulation ? triangulation_corners(d->triangulation, ret_n) : NULL;
}

int directions_n_rings(const Directions *d) {
    return d->n_rings;
}

int directions_ring(const Directions *d, int ring, int *ret) {
    for (int k = 0; k < d->rings[ring].n; k++)
        ret[k] = d->rings[ring].entries[k].index;
    return d->rings[ring].n;
}

void directions_free(Directions *d) {
    if (d == NULL)
        return;
    triangulation_free(d->triangulation);
    g_free(d->pole);
    g_free(d->rings);
    g_free(d->entries);
    g_free(d);
}

const int *directions_pole(const Directions *d, int *ret_n) {
    *ret_n = d->n_pole;
    return d->pole;
}

/* Gives the two directions of a ring between which the azimuth phi lies, and the share of the
 * second one. Returns the ring's polar angle at phi in degrees, interpolated between the two. */
static double ring_at(const struct ring *ring, double phi, int ret_index[2], double *ret_share) {
    int k = ring->n - 1;
    if (phi >= ring->entries[0].phi)
        for (k = 0; k + 1 < ring->n && ring->entries[k + 1].phi <= phi;)
            k++;
    const struct entry *a = &ring->entries[k], *b = &ring->entries[(k + 1) % ring->n];
    double from = phi >= a->phi ? phi - a->phi : phi - a->phi + 360.0;
    *ret_share = from / phi_gap(ring, k);
    ret_index[0] = a->index;
    ret_index[1] = b->index;
    return a->theta + *ret_share * (b->theta - a->theta);
}

static void set_pair(struct direction_weights *ret, int at, const int index[2], double share,
                     double weight) {
    ret->index[at] = index[0];
    ret->index[at + 1] = index[1];
    ret->weight[at] = weight * (1.0 - share);
    ret->weight[at + 1] = weight * share;
}

/* Gives the weights of a direction on the rings. Returns the polar angle at phi of the next ring
 * below the direction, or of the last ring if the direction is below all rings. */
static double ring_weights(const Directions *d, double theta, double phi,
                           struct direction_weights *ret) {
    int index[2] = {d->n, d->n}, next_index[2];
    double share = 0.0, above = 0.0, next_share, below;
    int k = 0;
    if (d->n_pole == 0)
        above = ring_at(&d->rings[k++], phi, index, &share);
    for (; k < d->n_rings; k++) {
        below = ring_at(&d->rings[k], phi, next_index, &next_share);
        if (theta < below) {
            double t = theta <= above ? 0.0 : (theta - above) / (below - above);
            set_pair(ret, 0, index, share, 1.0 - t);
            set_pair(ret, 2, next_index, next_share, t);
            return below;
        }
        above = below;
        share = next_share;
        index[0] = next_index[0];
        index[1] = next_index[1];
    }
    set_pair(ret, 0, index, share, 1.0);
    set_pair(ret, 2, index, share, 0.0);
    return above;
}

/* Gives the weights of a direction, and its polar angle in degrees as *ret_theta. Returns the polar
 * angle, in degrees, down to which measured directions extend here. If the direction lies outside
 * of the range of the measured directions, the result is the polar angle of the nearest point of
 * the range. Within the range, the result is at least *ret_theta. */
static double directions_weigh(const Directions *d, struct vec3 v, struct direction_weights *ret,
                               double *ret_theta) {
    double theta = atan2(hypot(v.x, v.y), MAX(v.z, 0.0)) / DEG;
    double phi = atan2(v.y, v.x) / DEG;
    phi = phi < 0.0 ? phi + 360.0 : phi;
    *ret_theta = theta;
    if (d->rings != NULL)
        return ring_weights(d, theta, phi >= 360.0 ? 0.0 : phi, ret);
    double at[2], weight[3], nearest[2];
    to_plane(theta, phi, at);
    triangulation_weights(d->triangulation, at, ret->index, weight, nearest);
    ret->index[3] = ret->index[0];
    for (int k = 0; k < 3; k++)
        ret->weight[k] = weight[k];
    ret->weight[3] = 0.0f;
    double moved = hypot(at[0] - nearest[0], at[1] - nearest[1]);
    return moved == 0.0 ? theta : 2.0 * atan(hypot(nearest[0], nearest[1])) / DEG;
}

void directions_weights(const Directions *d, struct vec3 v, struct direction_weights *ret) {
    double theta;
    directions_weigh(d, v, ret, &theta);
}

double directions_fade(const Directions *d, struct vec3 v) {
    struct direction_weights weights;
    return directions_fade_weights(d, v, &weights);
}

double directions_fade_weights(const Directions *d, struct vec3 v, struct direction_weights *ret) {
    double theta, end = directions_weigh(d, v, ret, &theta);
    if (v.z <= 0.0)
        return 0.0;
    if (theta <= end)
        return 1.0;
    return MIN(cos(theta * DEG) / MAX(cos(end * DEG), 1e-6), 1.0);
}

struct vec3 directions_from_square(double a, double b) {
    double x = 0.5 * (a + b), y = 0.5 * (a - b);
    return vec3_unit(vec3(x, y, MAX(1.0 - fabs(x) - fabs(y), 0.0)));
}

double directions_square_density(double a, double b) {
    double x = 0.5 * (a + b), y = 0.5 * (a - b);
    double length = vec3_length(vec3(x, y, 1.0 - fabs(x) - fabs(y)));
    return 0.5 / (length * length * length);
}

void directions_sky(const Directions *d, float *ret_share) {
    const double step = 2.0 / SKY_CELLS;
    memset(ret_share, 0, d->n * sizeof(float));
    for (int j = 0; j < SKY_CELLS; j++)
        for (int i = 0; i < SKY_CELLS; i++) {
            double a = -1.0 + (i + 0.5) * step, b = -1.0 + (j + 0.5) * step;
            struct vec3 from = directions_from_square(a, b);
            struct direction_weights weights;
            directions_weights(d, from, &weights);
            double share = directions_square_density(a, b) * step * step / G_PI;
            share *= directions_fade(d, from);
            for (int k = 0; k < 4; k++)
                if (weights.index[k] < d->n)
                    ret_share[weights.index[k]] += share * weights.weight[k];
                else
                    for (int m = 0; m < d->n_pole; m++)
                        ret_share[d->pole[m]] += share * weights.weight[k] / d->n_pole;
        }
}
