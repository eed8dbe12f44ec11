/* Edges are found along radial rays from the given centre. RANSAC proposes circles through three
 * edges. The circle that most rays agree with is fitted by Gauss-Newton. */
#include "ball_outline.h"

#include "geometry/fit.h"

#include <math.h>
#include <stdlib.h>

#define RAYS     180
#define NEAREST  0.75 /* range of the search, in radii of the given circle */
#define FARTHEST 1.3
#define STEP_PX  0.5
#define REACH    4 /* number of steps on each side of an edge whose light is compared */
/* number of steps on each side that give the exact place of an edge; a wider range would include
 * what the ball mirrors */
#define CLOSE  2
#define ABOVE  2.0   /* smallest edge above the ray's median change, in robust deviations */
#define LEAST  0.002 /* smallest edge, in the square root of light */
#define TRIALS 400
/* Smallest share of the rays that must have an edge on the circle: about half of the outline. A
 * circle through fewer edges may be the horizon, mirrored in the ball. */
#define SEEN  0.48
#define EDGES 3 /* candidate edges per ray, strongest first; the ball itself also has edges */
/* factor of the standard error, because neighbouring edges are correlated */
#define NEIGHBOURS 3.0
#define AGREE      0.01 /* share of the radius within which an edge agrees */
/* Radius of the smallest circle that is searched for. Smaller circles have too few edges. */
#define SMALLEST_PX 32
#define ROUNDS      5   /* rounds of fitting with outlier rejection */
#define FLOOR_PX    0.1 /* added in quadrature to the standard error */
#define MAX_STEPS   4096

struct edges {
    double x[RAYS * EDGES], y[RAYS * EDGES];
    int ray[RAYS * EDGES];
    int n;
};

struct BallEdges {
    struct ball_outline given;
    int n;        /* number of places on a ray */
    int pictures; /* number of pictures that were added */
    /* RAYS × n: change of the square root of light, and of light, summed over the pictures */
    double *changes, *squared;
};

BallEdges *ball_edges_new(const struct ball_outline *given) {
    const int n = MIN((int)((FARTHEST - NEAREST) * given->radius_px / STEP_PX), MAX_STEPS);
    if (given->radius_px < SMALLEST_PX || n <= 4 * REACH)
        return NULL;
    BallEdges *edges = g_new0(BallEdges, 1);
    edges->given = *given;
    edges->n = n;
    edges->changes = g_new0(double, RAYS *n);
    edges->squared = g_new0(double, RAYS *n);
    return edges;
}

void ball_edges_free(BallEdges *edges) {
    if (!edges)
        return;
    g_free(edges->changes);
    g_free(edges->squared);
    g_free(edges);
}

/* Returns the square root of light at a place (bilinear), or NaN outside the picture. The square
 * root keeps highlights from outshining outlines. */
static double root_at(const struct picture *picture, double x, double y) {
    const int column = (int)floor(x), row = (int)floor(y);
    if (column < 0 || row < 0 || column + 1 >= picture->width || row + 1 >= picture->height)
        return NAN;
    const float *v = picture->values + (gsize)row * (gsize)picture->width + column,
                *next = v + picture->width;
    const double s = x - column, t = y - row;
    return (1 - t) * ((1 - s) * sqrt(MAX((double)v[0], 0)) + s * sqrt(MAX((double)v[1], 0))) +
           t * ((1 - s) * sqrt(MAX((double)next[0], 0)) + s * sqrt(MAX((double)next[1], 0)));
}

/* Adds the absolute values of two smoothed derivatives along each ray: that of light, and that of
 * the square root of light. Light is relative to the brightest place on the ray, so that a
 * highlight in one picture does not outweigh the outline in the others. */
void ball_edges_add(BallEdges *edges, const struct picture *picture) {
    const struct ball_outline *given = &edges->given;
    g_autofree double *values = g_new0(double, edges->n);
    edges->pictures++;
    for (int ray = 0; ray < RAYS; ray++) {
        const double angle = 2 * G_PI * ray / RAYS;
        double most = 0;
        for (int i = 0; i < edges->n; i++) {
            const double radius = NEAREST * given->radius_px + i * STEP_PX;
            values[i] = root_at(picture, given->x_px + radius * cos(angle),
                                given->y_px + radius * sin(angle));
            most = fmax(most, values[i]);
        }
        for (int i = REACH; i < edges->n - REACH; i++) {
            double sum = 0, sum2 = 0;
            for (int k = 1; k <= REACH; k++) {
                const double a = values[i - k], b = values[i + k];
                sum += (b - a) / REACH;
                if (k <= CLOSE)
                    sum2 += (b * b - a * a) / CLOSE;
            }
            edges->changes[ray * edges->n + i] += isnan(sum) ? 0 : fabs(sum);
            edges->squared[ray * edges->n + i] +=
                isnan(sum) || !(most > 0) ? 0 : fabs(sum2) / (most * most);
        }
    }
}

/* Returns the place of a ray's strongest edge, in px along the searched part of the ray, and clears
 * its surroundings. Returns 0 if no edge is left.
 *
 * The edge is chosen by the derivative of the square root of light. The place is then found in the
 * derivative of light itself, because blur moves the edge of the square root towards the dark side.
 * A parabola gives the place to a fraction of a step. */
static double take_edge(double *changes, const double *squared, int n, double least) {
    int best = 1;
    for (int i = 2; i < n - 1; i++)
        if (changes[i] > changes[best])
            best = i;
    if (!(changes[best] > least))
        return 0;
    const int root = best;
    for (int from = -1; from != best;) { /* climbs to the largest change of light nearby */
        from = best;
        for (int i = MAX(from - REACH, 1); i <= MIN(from + REACH, n - 2); i++)
            if (squared[i] > squared[best])
                best = i;
    }
    const double before = squared[best - 1], after = squared[best + 1], at = squared[best];
    const double bend = before - 2 * at + after;
    for (int i = MAX(root - 2 * REACH, 0); i <= MIN(root + 2 * REACH, n - 1); i++)
        changes[i] = 0;
    return STEP_PX * (best + (bend < 0 ? 0.5 * (before - after) / bend : 0));
}

/* Computes the circle through three edges. Returns FALSE if they are nearly collinear. */
static gboolean through_three(const struct edges *e, const int k[3], struct ball_outline *ret) {
    const double ax = e->x[k[1]] - e->x[k[0]], ay = e->y[k[1]] - e->y[k[0]];
    const double bx = e->x[k[2]] - e->x[k[0]], by = e->y[k[2]] - e->y[k[0]];
    const double cross = 2 * (ax * by - ay * bx), a2 = ax * ax + ay * ay, b2 = bx * bx + by * by;
    if (fabs(cross) < 1)
        return FALSE;
    const double x = (by * a2 - ay * b2) / cross, y = (ax * b2 - bx * a2) / cross;
    *ret = (struct ball_outline){e->x[k[0]] + x, e->y[k[0]] + y, hypot(x, y)};
    return TRUE;
}

static double off_px(const struct edges *e, int i, const struct ball_outline *circle) {
    return hypot(e->x[i] - circle->x_px, e->y[i] - circle->y_px) - circle->radius_px;
}

/* Returns the number of rays with an edge that agrees with a circle. */
static int agreeing(const struct edges *e, const struct ball_outline *circle, double within_px) {
    int count = 0, last = -1;
    for (int i = 0; i < e->n; i++)
        if (e->ray[i] != last && fabs(off_px(e, i, circle)) < within_px) {
            last = e->ray[i];
            count++;
        }
    return count;
}

static gboolean is_near(const struct ball_outline *a, const struct ball_outline *given,
                        double reach_px) {
    return hypot(a->x_px - given->x_px, a->y_px - given->y_px) <= reach_px &&
           fabs(a->radius_px - given->radius_px) <= reach_px;
}

/* Finds the circle near the given one with which most rays agree (RANSAC with a fixed seed).
 * Returns the number of these rays, or 0 if no circle is found. */
static int most_agreed(const struct edges *e, const struct ball_outline *given, double reach_px,
                       double within_px, struct ball_outline *ret) {
    GRand *rand = g_rand_new_with_seed(1);
    int most = 0;
    for (int trial = 0; trial < TRIALS && e->n >= 3; trial++) {
        const int k[3] = {g_rand_int_range(rand, 0, e->n), g_rand_int_range(rand, 0, e->n),
                          g_rand_int_range(rand, 0, e->n)};
        struct ball_outline circle;
        if (!through_three(e, k, &circle) || !is_near(&circle, given, reach_px))
            continue;
        const int count = agreeing(e, &circle, within_px);
        if (count > most) {
            most = count;
            *ret = circle;
        }
    }
    g_rand_free(rand);
    return most;
}

/* Makes one Gauss-Newton step that minimises Σ (|e − c| − r)² over the agreeing edges e. Returns
 * FALSE if the edges do not determine a circle. *ret_sigma_px is the largest standard error of
 * centre and radius, estimated from the residuals. */
static gboolean improve(const struct edges *e, double within_px, struct ball_outline *circle,
                        double *ret_sigma_px) {
    const struct vec3 unit[3] = {vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1)};
    struct mat3 a = {0};
    struct vec3 b = vec3(0, 0, 0), step, row[3];
    double squares = 0;
    int count = 0;
    for (int i = 0; i < e->n; i++) {
        const double off = off_px(e, i, circle);
        if (fabs(off) >= within_px)
            continue;
        const double r = off + circle->radius_px;
        const double j[3] = {(e->x[i] - circle->x_px) / r, (e->y[i] - circle->y_px) / r, 1};
        for (int k = 0; k < 9; k++)
            a.m[k / 3][k % 3] += j[k / 3] * j[k % 3];
        b = vec3_add(b, vec3_scale(vec3(j[0], j[1], j[2]), off));
        squares += off * off;
        count++;
    }
    if (!ball_light_solve(&a, b, &step) || !ball_light_solve(&a, unit[0], &row[0]) ||
        !ball_light_solve(&a, unit[1], &row[1]) || !ball_light_solve(&a, unit[2], &row[2]))
        return FALSE;
    circle->x_px += step.x;
    circle->y_px += step.y;
    circle->radius_px += step.z;
    *ret_sigma_px = sqrt(squares / count * MAX(row[0].x, MAX(row[1].y, row[2].z)));
    return TRUE;
}

/* Gathers the strongest edges of a ray. */
static void edges_of_ray(const BallEdges *from, int ray, struct edges *to) {
    const int n = from->n;
    const double angle = 2 * G_PI * ray / RAYS;
    g_autofree double *changes = g_new0(double, n), *squared = g_new0(double, n);
    g_autofree double *sorted = g_new0(double, n);
    for (int i = 0; i < n; i++) {
        sorted[i] = changes[i] = from->changes[ray * n + i] / MAX(from->pictures, 1);
        squared[i] = from->squared[ray * n + i];
    }
    qsort(sorted, (gsize)n, sizeof *sorted, fit_compare);
    const double median = sorted[n / 2];
    for (int i = 0; i < n; i++)
        sorted[i] = fabs(changes[i] - median);
    qsort(sorted, (gsize)n, sizeof *sorted, fit_compare);
    const double least = MAX(LEAST, median + ABOVE * 1.4826 * sorted[n / 2]);
    double at;
    for (int k = 0; k < EDGES && (at = take_edge(changes, squared, n, least)) > 0; k++) {
        const double radius = NEAREST * from->given.radius_px + at;
        to->x[to->n] = from->given.x_px + radius * cos(angle);
        to->y[to->n] = from->given.y_px + radius * sin(angle);
        to->ray[to->n++] = ray;
    }
}

gboolean ball_outline_find(const BallEdges *from, double reach_px, struct ball_outline *ret,
                           double *ret_sigma_px) {
    const struct ball_outline *given = &from->given;
    const double within_px = MAX(0.5, AGREE * given->radius_px);
    g_autofree struct edges *edges = g_new(struct edges, 1);
    struct ball_outline circle;
    double sigma_px = 0;
    edges->n = 0;
    for (int ray = 0; ray < RAYS; ray++)
        edges_of_ray(from, ray, edges);
    if (most_agreed(edges, given, reach_px, within_px, &circle) == 0)
        return FALSE;
    for (int round = 0; round < ROUNDS; round++)
        if (!improve(edges, within_px, &circle, &sigma_px))
            return FALSE;
    if (agreeing(edges, &circle, within_px) < SEEN * RAYS || !is_near(&circle, given, reach_px))
        return FALSE;
    *ret = circle;
    *ret_sigma_px = hypot(FLOOR_PX, NEIGHBOURS * sigma_px);
    return TRUE;
}
