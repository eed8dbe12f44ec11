/* Finds the shape by the Levenberg–Marquardt method. For each shape, the factors of the columns are
 * solved for. Loops run over all pairs in planes of floats, so that compilers can vectorise
 * them. */
#include "maps_fit_private.h"

#include <math.h>
#include <string.h>

#include "base/direction.h"
#include "base/robust.h"

#define EXPONENT 0.6F
#define DARK     0.05F /* y0 of maps_fit.h, relative to the mean of Y */
/* residuals above this number of standard deviations count less than their squares (Huber 1981) */
#define HUBER      1.345
#define STEPS      6
#define ROUNDS     3
#define ENOUGH     1e-4  /* relative decrease of the cost below which a round ends */
#define STEP       1e-2F /* step of the finite differences by which a shape is differentiated */
#define MIN_WEIGHT 0.02F /* minimum of the specular weight w */
/* weight of the priors of the factors, as a number of pairs whose column is 1 */
#define WEAK          0.5
#define PRIOR         2e-4 /* weight of the shape's priors, relative to Σ u² Y² (maps_fit.h) */
#define COLOUR_ROUNDS 5
/* number of standard deviations up to which a difference counts with its square; chosen with the
 * test material low_weave */
#define COLOUR_HUBER 0.3
#define SHRINK       0.1 /* weight of a prior by which the specular colour is grey */

/* The standard deviations of a shape's values in their priors. */
static const float deviations[MAPS_SHAPE] = {0.5F, 0.5F, 1, 0.4F, 0.4F, 1};

struct maps_solver {
    const struct maps_pairs *pairs;
    int n;
    float *y, *weights;
    float dark; /* y0 of maps_fit.h */
    float *diffuse, *lobe, *residuals, *trial, *slopes[MAPS_SHAPE];
    double *sorted;
    /* energy: Σ u² Y² (maps_fit.h)
     * weak: weight of the priors of the factors */
    double energy, weak;
    double n_valid;
};

struct maps_solver *maps_solver_new(const struct maps_pairs *pairs) {
    struct maps_solver *ret = g_new0(struct maps_solver, 1);
    float **const planes[] = {&ret->y,         &ret->weights,   &ret->diffuse,   &ret->lobe,
                              &ret->residuals, &ret->trial,     &ret->slopes[0], &ret->slopes[1],
                              &ret->slopes[2], &ret->slopes[3], &ret->slopes[4], &ret->slopes[5]};
    ret->pairs = pairs;
    ret->n = pairs->n;
    for (gsize i = 0; i < G_N_ELEMENTS(planes); i++)
        *planes[i] = g_new0(float, pairs->n);
    ret->sorted = g_new(double, pairs->n);
    return ret;
}

void maps_solver_free(struct maps_solver *solver) {
    for (int k = 0; k < MAPS_SHAPE; k++)
        g_free(solver->slopes[k]);
    g_free(solver->y);
    g_free(solver->weights);
    g_free(solver->diffuse);
    g_free(solver->lobe);
    g_free(solver->residuals);
    g_free(solver->trial);
    g_free(solver->sorted);
    g_free(solver);
}

/* Returns the part of the light that Fresnel's factor of a dielectric leaves to the diffuse
 * lobe. */
static inline float maps_solver_below(float weight, float f5) {
    return 1 - weight * (MAPS_DIELECTRIC + (1 - MAPS_DIELECTRIC) * f5);
}

/* Minimises xᵀ A x − 2 bᵀ x within bounds, coordinate by coordinate. */
static void box(const double (*a)[MAPS_COLUMNS], const double *b, int n, const double *least,
                const double *most, double *x) {
    for (int round = 0; round < 60; round++) {
        double moved = 0;
        for (int j = 0; j < n; j++) {
            double rest = b[j];
            for (int k = 0; k < n; k++)
                rest -= k == j ? 0 : a[j][k] * x[k];
            const double next = a[j][j] > 0 ? CLAMP(rest / a[j][j], least[j], most[j]) : least[j];
            moved = MAX(moved, fabs(next - x[j]));
            x[j] = next;
        }
        if (moved < 1e-6)
            return;
    }
}

/* Computes factors and residuals of a shape. Returns the cost, including the factors' priors. */
static double maps_solver_try(struct maps_solver *solver, const float shape[MAPS_SHAPE],
                              float *residuals, float factors[MAPS_COLUMNS]) {
    static const double most[MAPS_COLUMNS] = {4, 1, 1};
    const gboolean core = solver->pairs->model == MAPS_MODEL_CORE;
    const double least[MAPS_COLUMNS] = {0, core ? (double)MAPS_DIELECTRIC : 0, 0};
    const struct maps_frame frame = maps_frame_of(shape);
    const float *f5 = solver->pairs->planes[MAPS_F5], *extra = solver->pairs->planes[MAPS_EXTRA];
    const float *y = solver->y, *weights = solver->weights;
    const float *diffuse = solver->diffuse, *lobe = solver->lobe;
    const float specular = shape[5];
    const double priors[MAPS_COLUMNS] = {0, (double)(MAPS_DIELECTRIC * specular), 0};
    float dd = 0, da = 0, de = 0, aa = 0, ae = 0, ee = 0, dy = 0, ay = 0, ey = 0, sum = 0;
    maps_frame_lobes(&frame, solver->pairs, solver->diffuse, solver->lobe);
    for (int i = 0; i < solver->n; i++) {
        const float u = weights[i], d = u * diffuse[i] * maps_solver_below(specular, f5[i]);
        const float a = u * lobe[i] * (1 - f5[i]), e = u * extra[i];
        const float left = u * (y[i] - specular * lobe[i] * f5[i]);
        dd += d * d;
        da += d * a;
        de += d * e;
        aa += a * a;
        ae += a * e;
        ee += e * e;
        dy += d * left;
        ay += a * left;
        ey += e * left;
    }
    double matrix[MAPS_COLUMNS][MAPS_COLUMNS] = {{dd, da, de}, {da, aa, ae}, {de, ae, ee}};
    double right[MAPS_COLUMNS] = {dy, ay, ey};
    double x[MAPS_COLUMNS] = {0.2, priors[1], 0};
    for (int j = 0; j < MAPS_COLUMNS; j++) {
        matrix[j][j] += solver->weak;
        right[j] += solver->weak * priors[j];
    }
    box((const double(*)[MAPS_COLUMNS])matrix, right,
        solver->pairs->extra ? MAPS_COLUMNS : MAPS_COLUMNS - 1, least, most, x);
    for (int j = 0; j < MAPS_COLUMNS; j++)
        factors[j] = (float)x[j];
    for (int i = 0; i < solver->n; i++) {
        const float model = factors[0] * diffuse[i] * maps_solver_below(specular, f5[i]) +
                            lobe[i] * (factors[1] + (specular - factors[1]) * f5[i]) +
                            factors[2] * extra[i];
        residuals[i] = weights[i] * (y[i] - model);
        sum += residuals[i] * residuals[i];
    }
    double cost = (double)sum;
    for (int j = 0; j < MAPS_COLUMNS; j++)
        cost += solver->weak * (x[j] - priors[j]) * (x[j] - priors[j]);
    return cost;
}

/* Computes the priors of a shape: the differences of its values from usual values, in units of
 * `deviations`. */
static void maps_solver_prior(const float shape[MAPS_SHAPE], double ret[MAPS_SHAPE]) {
    static const float usual[MAPS_SHAPE] = {0, 0, -1.2F, 0, 0, 1};

    for (int k = 0; k < MAPS_SHAPE; k++)
        ret[k] = (double)((shape[k] - usual[k]) / deviations[k]);
}

static double maps_solver_cost(struct maps_solver *solver, const float shape[MAPS_SHAPE],
                               float *residuals, float factors[MAPS_COLUMNS]) {
    double prior[MAPS_SHAPE], cost = maps_solver_try(solver, shape, residuals, factors);
    maps_solver_prior(shape, prior);
    for (int k = 0; k < MAPS_SHAPE; k++)
        cost += PRIOR * solver->energy * prior[k] * prior[k];
    return cost;
}

/* Returns the number of a shape's values that are fitted. The core model's lobe is isotropic, and
 * its w is 1. */
static int free_values(const struct maps_solver *solver) {
    return solver->pairs->model == MAPS_MODEL_CORE ? 3 : MAPS_SHAPE;
}

/* Computes Jᵀ J and −Jᵀ r including the priors. J are the derivatives of the residuals r with
 * respect to the shape, by finite differences. */
static void maps_solver_slopes(struct maps_solver *solver, const float shape[MAPS_SHAPE],
                               double normal[MAPS_SHAPE][MAPS_SHAPE], double right[MAPS_SHAPE]) {

    float factors[MAPS_COLUMNS];
    double prior[MAPS_SHAPE];
    maps_solver_prior(shape, prior);
    for (int k = 0; k < MAPS_SHAPE; k++) {
        float moved[MAPS_SHAPE];
        if (k >= free_values(solver)) {
            memset(solver->slopes[k], 0, sizeof(float) * (gsize)solver->n);
            continue;
        }
        memcpy(moved, shape, sizeof moved);
        moved[k] += STEP;
        maps_solver_try(solver, moved, solver->slopes[k], factors);
        for (int i = 0; i < solver->n; i++)
            solver->slopes[k][i] = (solver->slopes[k][i] - solver->residuals[i]) / STEP;
    }
    for (int j = 0; j < MAPS_SHAPE; j++) {
        const float *a = solver->slopes[j];
        float to = 0;
        for (int i = 0; i < solver->n; i++)
            to += a[i] * solver->residuals[i];
        for (int k = 0; k <= j; k++) {
            const float *b = solver->slopes[k];
            float sum = 0;
            for (int i = 0; i < solver->n; i++)
                sum += a[i] * b[i];
            normal[j][k] = normal[k][j] = (double)sum;
        }
        const double weight = PRIOR * solver->energy / (double)deviations[j];
        normal[j][j] += weight / (double)deviations[j];
        right[j] = -(double)to - weight * prior[j];
    }
}

static void limit(const struct maps_solver *solver, float shape[MAPS_SHAPE]) {
    const gboolean core = solver->pairs->model == MAPS_MODEL_CORE;
    const float length = hypotf(shape[0], shape[1]);
    if (length > MAPS_MAX_NORMAL)
        for (int k = 0; k < 2; k++)
            shape[k] *= MAPS_MAX_NORMAL / length;
    shape[2] = CLAMP(shape[2], MAPS_MIN_LOG_ALPHA, 0);
    for (int k = 3; k < 5; k++)
        shape[k] = core ? 0 : CLAMP(shape[k], -2, 2);
    shape[5] = core ? 1 : CLAMP(shape[5], MIN_WEIGHT, 1);
}

/* Improves at->shape and at->factors by Levenberg–Marquardt, at most STEPS steps. Before the call,
 * solver->residuals and cost are those of at->shape. Updates solver->residuals, and returns the new
 * cost. */
static double descend(struct maps_solver *solver, double cost, struct maps_solution *at) {
    double damping = 1e-2;
    for (int step = 0; step < STEPS; step++) {
        double normal[MAPS_SHAPE][MAPS_SHAPE], right[MAPS_SHAPE], next = cost;
        maps_solver_slopes(solver, at->shape, normal, right);
        for (int again = 0; again < 4; again++) {
            double a[MAPS_SHAPE][MAPS_SHAPE], x[MAPS_SHAPE];
            struct maps_solution moved = *at;
            memcpy(a, normal, sizeof a);
            memcpy(x, right, sizeof x);
            for (int k = 0; k < MAPS_SHAPE; k++)
                a[k][k] *= 1 + damping;
            if (!maps_cholesky(MAPS_SHAPE, MAPS_SHAPE, &a[0][0], x))
                return cost;
            for (int k = 0; k < MAPS_SHAPE; k++)
                moved.shape[k] += (float)x[k];
            limit(solver, moved.shape);
            next = maps_solver_cost(solver, moved.shape, solver->trial, moved.factors);
            if (next < cost) {
                *at = moved;
                memcpy(solver->residuals, solver->trial, sizeof(float) * (gsize)solver->n);
                damping *= 0.3;
                break;
            }
            damping *= 5;
        }
        const double decrease = cost - next;
        if (!(decrease > 0))
            return cost;
        cost = next;
        if (decrease < ENOUGH * cost)
            return cost;
    }
    return cost;
}

/* Computes the weights (m_i + y0)^−0.6. m_i are the values of the model, not the measured ones,
 * because otherwise values in shadow would count most. Computes Huber's factors too, with a
 * standard deviation that is estimated by the median of the residuals. */
static void robust(struct maps_solver *solver) {
    int n = 0;
    solver->energy = 0;
    for (int i = 0; i < solver->n; i++) {
        if (solver->weights[i] <= 0)
            continue;
        const float off = solver->residuals[i] / solver->weights[i], model = solver->y[i] - off;
        const float weight = powf(MAX(model, 0) + solver->dark, -EXPONENT);
        solver->weights[i] = weight;
        solver->residuals[i] = weight * off;
        solver->sorted[n++] = fabs((double)solver->residuals[i]);
        solver->energy += pow((double)weight * (double)solver->y[i], 2);
    }
    const double least = HUBER * 1.4826 * robust_median(solver->sorted, n);
    for (int i = 0; i < solver->n; i++) {
        const double r = fabs((double)solver->residuals[i]);
        if (r > least && least > 0)
            solver->weights[i] *= (float)sqrt(least / r);
    }
}

static gboolean take(struct maps_solver *solver, const float *rgb) {
    double sum = 0, weights = 0;
    int n = 0;
    for (int i = 0; i < solver->n; i++) {
        const float y = rgb_luminance(rgb + 3 * (gsize)i);
        solver->y[i] = isfinite(y) ? y : 0;
        solver->weights[i] = isfinite(y);
        sum += (double)MAX(solver->y[i], 0);
        n += isfinite(y);
    }
    if (!(sum > 0))
        return FALSE;
    const float mean = (float)(sum / n);
    solver->dark = DARK * mean;
    solver->energy = 0;
    for (int i = 0; i < solver->n; i++) {
        const float u = solver->weights[i] * powf(MAX(solver->y[i], 0) + mean, -EXPONENT);
        solver->weights[i] = u;
        weights += (double)u * (double)u;
        solver->energy += pow((double)u * (double)solver->y[i], 2);
    }
    solver->n_valid = n;
    solver->weak = WEAK * weights / n;
    return TRUE;
}

gboolean maps_solver_run(struct maps_solver *solver, const float *rgb,
                         float (*const starts)[MAPS_SHAPE], int n_starts,
                         struct maps_solution *ret) {
    double cost = 0;
    if (!take(solver, rgb))
        return FALSE;
    for (int k = 0; k < n_starts; k++) {
        float factors[MAPS_COLUMNS], start[MAPS_SHAPE];
        memcpy(start, starts[k], sizeof start);
        limit(solver, start);
        const double next = maps_solver_cost(solver, start, solver->trial, factors);
        if (k > 0 && next >= cost)
            continue;
        cost = next;
        memcpy(ret->shape, start, sizeof ret->shape);
    }
    for (int round = 0; round < ROUNDS; round++) {
        cost = maps_solver_cost(solver, ret->shape, solver->residuals, ret->factors);
        if (round > 0) {
            robust(solver);
            cost = maps_solver_cost(solver, ret->shape, solver->residuals, ret->factors);
        }
        descend(solver, cost, ret);
    }
    /* The reported cost contains no priors: it is Σ u² r² / Σ u² Y². */
    maps_solver_try(solver, ret->shape, solver->residuals, ret->factors);
    double squares = 0;
    for (int i = 0; i < solver->n; i++)
        squares += (double)solver->residuals[i] * (double)solver->residuals[i];
    ret->cost = squares / solver->energy;
    return TRUE;
}

/* Returns the metallic m for which m base + (1 − m) 0.04 is the reflectance S, with base = d / (1 −
 * m). Returns 0 if S is at most least. */
static double metallic(double d, double s, double least) {
    double low = 0, high = 1;
    if (s <= least)
        return 0;
    for (int i = 0; i < 40; i++) {
        const double m = (low + high) / 2, base = MIN(d / MAX(1 - m, 1e-9), 1);
        if (m * base + (1 - m) * (double)MAPS_DIELECTRIC < s)
            low = m;
        else
            high = m;
    }
    return low;
}

/* The known values of a texel when its colours are computed: metallic m, specular w, the
 * dielectric's reflectance f0, and the amount of sheen or clear coat (layer). */
struct maps_colours {
    double m, w, f0, layer;
    const struct maps_layers *layers;
};

/* Gives the factors by which base, specular colour and sheen are multiplied in the value of pair i.
 * Returns the part of the value that depends on neither base nor specular colour nor sheen. */
static double colour_columns(const struct maps_solver *solver, const struct maps_colours *of, int i,
                             double ret[MAPS_COLUMNS]) {
    const float *const *p = (const float *const *)solver->pairs->planes;
    const gboolean sheen = of->layers->sheen_roughness > 0;
    const double f5 = (double)p[MAPS_F5][i], lobe = (double)solver->lobe[i];
    const double extra = (double)p[MAPS_EXTRA][i], m = of->m, w = of->w;
    double left = 1, top = 0;
    if (of->layers->coat_roughness > 0) {
        left = 1 - of->layer * (0.04 + 0.96 * pow(1 - (double)p[MAPS_VZ][i], 5));
        top = of->layer * extra;
    }
    if (sheen)
        left = 1 - of->layer * MAX(maps_sheen_albedo(of->layers, (double)p[MAPS_VZ][i]),
                                   maps_sheen_albedo(of->layers, (double)p[MAPS_LZ][i]));
    const double below = (1 - m) * (1 - w * (of->f0 + (1 - of->f0) * f5));
    ret[0] = left * ((double)solver->diffuse[i] * below + m * lobe * (1 - f5));
    ret[1] = left * (1 - m) * w * (double)MAPS_DIELECTRIC * lobe * (1 - f5);
    ret[2] = sheen ? extra : 0;
    return left * ((1 - m) * w + m) * lobe * f5 + top;
}

/* Fits each colour by least squares with the weights of solver->trial. */
static void colours_fit(const struct maps_solver *solver, const float *rgb,
                        const struct maps_colours *of, const double start[MAPS_COLUMNS],
                        double ret[3][MAPS_COLUMNS]) {
    const gboolean core = solver->pairs->model == MAPS_MODEL_CORE;
    /* In the core model, the reflectance of a dielectric is constant, not fitted. */
    const double least[MAPS_COLUMNS] = {0, core ? 1 : 0, 0};
    const double most[MAPS_COLUMNS] = {1, core ? 1 : (double)MAPS_MAX_SPECULAR, 1};
    double a[3][MAPS_COLUMNS][MAPS_COLUMNS] = {0}, b[3][MAPS_COLUMNS] = {0};
    for (int i = 0; i < solver->n; i++) {
        const double weight = (double)solver->trial[i];
        double columns[MAPS_COLUMNS];
        if (solver->weights[i] <= 0)
            continue;
        const double known = colour_columns(solver, of, i, columns);
        for (int c = 0; c < 3; c++)
            for (int j = 0; j < MAPS_COLUMNS; j++) {
                b[c][j] += weight * columns[j] * ((double)rgb[3 * (gsize)i + (gsize)c] - known);
                for (int k = 0; k < MAPS_COLUMNS; k++)
                    a[c][j][k] += weight * columns[j] * columns[k];
            }
    }
    for (int c = 0; c < 3; c++) {
        const double prior = SHRINK * a[c][1][1] + 1e-9 * solver->n_valid;
        memcpy(ret[c], start, sizeof ret[c]);
        a[c][1][1] += prior;
        b[c][1] += prior * start[1];
        a[c][0][0] += 1e-9;
        a[c][2][2] += 1e-9;
        box((const double(*)[MAPS_COLUMNS])a[c], b[c], of->layers->sheen_roughness > 0 ? 3 : 2,
            least, most, ret[c]);
    }
}

/* Stores in solver->trial the weights with which the next fit reduces the sum of absolute
 * differences. If a texel shows another colour in some views, because an edge runs through it, the
 * result is then one of the two colours and not their mixture. Each view has the weight v·z, in
 * proportion to the visible area. Grazing views, which differ most because they show other points,
 * then count less. */
static void colours_robust(struct maps_solver *solver, const float *rgb,
                           const struct maps_colours *of, const double x[3][MAPS_COLUMNS]) {
    int n = 0;
    for (int i = 0; i < solver->n; i++) {
        double columns[MAPS_COLUMNS], squares = 0;
        float model[3];
        if (solver->weights[i] <= 0)
            continue;
        const double known = colour_columns(solver, of, i, columns);
        for (int c = 0; c < 3; c++) {
            double value = known;
            for (int k = 0; k < MAPS_COLUMNS; k++)
                value += columns[k] * x[c][k];
            model[c] = (float)MAX(value, 0);
            const double u = pow((double)(model[c] + solver->dark), -(double)EXPONENT);
            squares += pow(u * ((double)rgb[3 * (gsize)i + (gsize)c] - value), 2);
        }
        solver->sorted[n++] = sqrt(squares);
        solver->residuals[i] = (float)sqrt(squares);
        solver->trial[i] = solver->pairs->planes[MAPS_VZ][i] *
                           powf(rgb_luminance(model) + solver->dark, -2 * EXPONENT);
    }
    const float near = (float)(COLOUR_HUBER * 1.4826 * robust_median(solver->sorted, n));
    for (int i = 0; i < solver->n; i++)
        if (solver->weights[i] > 0 && solver->residuals[i] > near && near > 0)
            solver->trial[i] *= near / solver->residuals[i];
}

void maps_solver_colours(struct maps_solver *solver, const float *rgb,
                         const struct maps_layers *layers, const struct maps_solution *solution,
                         struct maps_texel *ret) {
    const struct maps_frame frame = maps_frame_of(solution->shape);
    const double d = (double)solution->factors[0], s = (double)solution->factors[1];
    const gboolean core = solver->pairs->model == MAPS_MODEL_CORE;
    /* A reflectance of up to twice that of a dielectric does not make a metal, if a specular colour
     * can represent this reflectance. */
    const double m = metallic(d, s, (core ? 1.001 : 2) * (double)MAPS_DIELECTRIC);
    const double w = core ? 1 : MAX((double)solution->shape[5], MIN(2 * s, 1));
    const double base = MIN(d / MAX(1 - m, 1e-9), 1);
    const double grey = m < 0.999 && !core
                            ? CLAMP((s - m * base) / ((double)MAPS_DIELECTRIC * w * (1 - m)), 0,
                                    (double)MAPS_MAX_SPECULAR)
                            : 1;
    const struct maps_colours of = {m, w, (double)MAPS_DIELECTRIC * grey, solution->factors[2],
                                    layers};
    const double start[MAPS_COLUMNS] = {base, grey, of.layer};
    double x[3][MAPS_COLUMNS];
    memset(ret, 0, sizeof *ret);
    for (int i = 0; i < solver->n; i++)
        solver->trial[i] = solver->weights[i] * solver->weights[i];
    for (int round = 0; round <= COLOUR_ROUNDS; round++) {
        if (round > 0)
            colours_robust(solver, rgb, &of, x);
        colours_fit(solver, rgb, &of, start, x);
    }
    for (int c = 0; c < 3; c++) {
        ret->base[c] = (float)x[c][0];
        ret->specular_colour[c] = (float)x[c][1];
        ret->sheen[c] = layers->sheen_roughness > 0 ? (float)x[c][2] : 0;
    }
    ret->metallic = (float)m;
    ret->specular = (float)w;
    ret->coat = layers->coat_roughness > 0 ? solution->factors[2] : 0;
    ret->roughness = sqrtf(frame.ab);
    ret->anisotropy = frame.ab < 0.999F ? sqrtf((frame.at - frame.ab) / (1 - frame.ab)) : 0;
    memcpy(ret->direction, frame.direction, sizeof ret->direction);
    memcpy(ret->normal, frame.n, sizeof ret->normal);
}
