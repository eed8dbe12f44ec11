#include "lobes_private.h"

#include "lobes_lanes.h"

#include <math.h>

#define P         LOBES_MAX_PARAMETERS
#define MAX_STEPS 80
/* a problem is solved when a step lowers its cost by at most this share of the cost */
#define ENOUGH   1e-5F
#define MIN_VIEW 0.1F  /* minimum of the divisors n·v and max(n·l, n·v) of lobes.h */
#define SHALLOW  1e-4F /* hx² + hy² below which the series of log(hn) / (1 − hn²) is used */
#define LN2      0.69314718F
#define TINY     1e-20F

/* Sums over all samples (pairs of a view and a light) for one set of parameters. r = y − f is the
 * residual of the luminance y, and J has the derivatives of the model f. */
struct normal {
    lanes cost;
    lanes gradient[P];             /* Jᵀr */
    lanes matrix[P * (P + 1) / 2]; /* JᵀJ, lower half row by row */
};

/* The lobe s ⟨d · w⟩^n of lobes_private.h. d, s and n depend only on the parameters, and are
 * computed once for all samples. */
struct prepared_lobe {
    lanes d[3], s, n;
};
struct prepared_facet {
    lanes frame[3][3]; /* unit vectors t, b, n */
    /* [i]: derivatives of t, b, n with respect to parameter i (0: slope a, 1: slope b, 2: angle
     * ψ) */
    lanes turns[3][3][3];
    /* scale_u, scale_v: derivatives of log scale with respect to log U and log V */
    lanes u, v, diffuse, specular, scale, scale_u, scale_v;
};
struct prepared {
    struct prepared_lobe lobes[LOBES_MAX_LOBES];
    struct prepared_facet facet;
};

static int lobes_of(const struct lobes_fit *fit) {
    return fit->model == LOBES_FIELDS || fit->model == LOBES_LAFORTUNE ? fit->n_lobes : 0;
}

/* Returns the number of parameters. fields and Lafortune have k × (g = s d, log N), and Lafortune
 * also D. Microfacet models have both slopes of the normal, the tangent's angle, log U, log V,
 * diffuse and specular. */
int lobes_fit_parameters(const struct lobes_fit *fit) {
    switch (fit->model) {
    case LOBES_FIELDS:
        return 4 * fit->n_lobes;
    case LOBES_LAFORTUNE:
        return 4 * fit->n_lobes + 1;
    default:
        return 7;
    }
}

/* Computes d, s and n from the parameters p of a lobe: g = s d with ‖d‖ = 1, and log n. For every
 * n, s is the lobe's value at w = d. */
LANES_INLINE void prepare_lobe(const lanes *p, struct prepared_lobe *ret) {
    const lanes squares = p[0] * p[0] + p[1] * p[1] + p[2] * p[2];
    ret->s = lanes_sqrt(lanes_max(squares, lanes_all(TINY)));
    for (int i = 0; i < 3; i++)
        ret->d[i] = p[i] / ret->s;
    ret->n = lanes_exp2(p[3] / LN2);
}

/* Computes f = s c^n, c = ⟨d · w⟩, and its derivatives with respect to g = s d and log n. */
LANES_INLINE lanes lobe(const struct prepared_lobe *lobe, const lanes w[3], lanes *j) {
    const lanes c = lobe->d[0] * w[0] + lobe->d[1] * w[1] + lobe->d[2] * w[2];
    const lane_bits lit = c > 1e-4F;
    const lanes log_c = lanes_log2(lanes_max(c, lanes_all(1e-4F)));
    const lanes slope = lanes_if(lit, lanes_exp2((lobe->n - 1.0F) * log_c), lanes_all(0));
    const lanes power = slope * c, across = power * (1.0F - lobe->n), along = slope * lobe->n;
    for (int i = 0; i < 3; i++)
        j[i] = across * lobe->d[i] + along * w[i];
    const lanes f = lobe->s * power;
    j[3] = f * lobe->n * log_c * LN2;
    return f;
}

LANES_INLINE lanes dot(const lanes a[3], const lanes b[3]) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

LANES_INLINE void cross(const lanes a[3], const lanes b[3], lanes ret[3]) {
    ret[0] = a[1] * b[2] - a[2] * b[1];
    ret[1] = a[2] * b[0] - a[0] * b[2];
    ret[2] = a[0] * b[1] - a[1] * b[0];
}

/* Computes the sine and cosine of an angle near 0 … 2π, with errors of about 1e-6. The angle is
 * halved eight times. */
LANES_INLINE void turn(lanes angle, lanes *ret_sin, lanes *ret_cos) {
    const lanes x = angle * (1.0F / 256), x2 = x * x;
    lanes s = x * (1.0F - x2 * (1.0F / 6) * (1.0F - x2 * (1.0F / 20)));
    /* 1 − cos of the angle; cos itself would lose digits of a small angle */
    lanes less = x2 * 0.5F * (1.0F - x2 * (1.0F / 12));
    for (int i = 0; i < 8; i++) {
        const lanes doubled = 2.0F * s * (1.0F - less);
        less = 2.0F * s * s;
        s = doubled;
    }
    *ret_sin = s;
    *ret_cos = 1.0F - less;
}

/* Computes (v − ⟨v, n⟩ n) / length, the derivative of a unit vector n = w / length if the
 * derivative of w is v. */
LANES_INLINE void unit_derivative(const lanes v[3], const lanes n[3], lanes length, lanes ret[3]) {
    const lanes along = dot(v, n);
    for (int i = 0; i < 3; i++)
        ret[i] = (v[i] - along * n[i]) / length;
}

/* Computes the frame and its derivatives. n is the unit vector along (−a, −b, 1). t is the unit
 * vector along (cos ψ, sin ψ, a cos ψ + b sin ψ). b = n × t. */
LANES_INLINE void prepare_frame(const lanes *p, struct prepared_facet *ret) {
    const lanes one = lanes_all(1), zero = lanes_all(0);
    lanes s, c, by[3][3], length = lanes_sqrt(p[0] * p[0] + p[1] * p[1] + 1.0F);
    lanes *t = ret->frame[0], *n = ret->frame[2];
    turn(p[2], &s, &c);
    const lanes rise = p[0] * c + p[1] * s, along = lanes_sqrt(1.0F + rise * rise);
    const lanes normals[2][3] = {{-one, zero, zero}, {zero, -one, zero}};
    const lanes tangents[3][3] = {{zero, zero, c}, {zero, zero, s}, {-s, c, p[1] * c - p[0] * s}};
    n[0] = -p[0] / length, n[1] = -p[1] / length, n[2] = one / length;
    t[0] = c / along, t[1] = s / along, t[2] = rise / along;
    cross(n, t, ret->frame[1]);
    for (int i = 0; i < 3; i++) {
        unit_derivative(tangents[i], t, along, ret->turns[i][0]);
        for (int k = 0; k < 3; k++)
            ret->turns[i][2][k] = zero;
        if (i < 2)
            unit_derivative(normals[i], n, length, ret->turns[i][2]);
        cross(ret->turns[i][2], t, by[0]);
        cross(n, ret->turns[i][0], by[1]);
        for (int k = 0; k < 3; k++)
            ret->turns[i][1][k] = by[0][k] + by[1][k];
    }
}

/* Prepares a microfacet model from its parameters p: the slopes a, b, the angle ψ, log U, log V,
 * diffuse and specular. scale is the factor of s that depends only on U and V. */
LANES_INLINE void prepare_facet(enum lobes_model model, const lanes *p,
                                struct prepared_facet *ret) {
    prepare_frame(p, ret);
    ret->u = lanes_exp2(p[3] / LN2);
    ret->v = lanes_exp2(p[4] / LN2);
    ret->diffuse = p[5];
    ret->specular = p[6];
    if (model == LOBES_WARD) {
        ret->scale = 0.25F / (ret->u * ret->v);
        ret->scale_u = ret->scale_v = lanes_all(-1);
    } else {
        ret->scale = lanes_sqrt((ret->u + 1.0F) * (ret->v + 1.0F)) * 0.125F;
        ret->scale_u = 0.5F * ret->u / (ret->u + 1.0F);
        ret->scale_v = 0.5F * ret->v / (ret->v + 1.0F);
    }
}

/* Computes the exponent E of Ward's distribution, and its derivatives with respect to hx, hy, hn,
 * log U and log V. */
LANES_INLINE lanes ward_exponent(const struct prepared_facet *f, lanes hx, lanes hy, lanes hn,
                                 lanes ret[5]) {
    const lanes wide = 1.0F + lanes_max(hn, lanes_all(0));
    const lanes x = hx / f->u, y = hy / f->v, e = -2.0F * (x * x + y * y) / wide;
    ret[0] = -4.0F * x / (f->u * wide);
    ret[1] = -4.0F * y / (f->v * wide);
    ret[2] = -e / wide;
    ret[3] = 4.0F * x * x / wide;
    ret[4] = 4.0F * y * y / wide;
    return e;
}

/* Computes the exponent E of Ashikhmin's distribution, and the derivatives as ward_exponent() does.
 * E = q (U hx² + V hy²), q = ln hn / (1 − hn²). Near the normal, q = −1/2 and dq/dhn = 1/2. */
LANES_INLINE lanes ashikhmin_exponent(const struct prepared_facet *f, lanes hx, lanes hy, lanes hn,
                                      lanes ret[5]) {
    const lanes high = lanes_max(hn, lanes_all(1e-3F)), rest = 1.0F - high * high;
    const lane_bits near = rest < SHALLOW;
    const lanes safe = lanes_if(near, lanes_all(1), rest), ln = lanes_log2(high) * LN2;
    const lanes q = lanes_if(near, lanes_all(-0.5F), ln / safe);
    const lanes dq =
        lanes_if(near, lanes_all(0.5F), (safe / high + 2.0F * high * ln) / (safe * safe));
    const lanes x = f->u * hx * hx, y = f->v * hy * hy;
    ret[0] = 2.0F * q * f->u * hx;
    ret[1] = 2.0F * q * f->v * hy;
    ret[2] = dq * (x + y);
    ret[3] = q * x;
    ret[4] = q * y;
    return q * (x + y);
}

/* Computes the factor by which scale and distribution are multiplied: √(n·l / n·v) for Ward, n·l /
 * (h·l · max(n·l, n·v)) for Ashikhmin, with n·v at least MIN_VIEW. Also computes the derivatives of
 * the logarithm of this factor with respect to n·l and n·v. */
LANES_INLINE lanes geometry(enum lobes_model model, lanes nl, lanes nv, lanes hl, lanes *ret_nl,
                            lanes *ret_nv) {
    const lanes least = lanes_all(MIN_VIEW), seen = lanes_max(nv, least);
    if (model == LOBES_WARD) {
        *ret_nl = 0.5F / nl;
        *ret_nv = lanes_if(nv > least, -0.5F / seen, lanes_all(0));
        return lanes_sqrt(nl / seen);
    }
    const lanes most = lanes_max(nl, seen);
    *ret_nl = lanes_if(nl >= most, lanes_all(0), 1.0F / nl);
    *ret_nv = lanes_if((nl < most) & (nv > least), -1.0F / seen, lanes_all(0));
    return nl / (hl * most);
}

/* Computes f = diffuse n·l + specular s (v, l), and j, the derivatives of f with respect to the
 * seven parameters. The derivatives with respect to the parameters of the frame (turns) follow from
 * ∂t, ∂b and ∂n. The derivatives with respect to log U and log V follow from the exponent and the
 * scale. */
LANES_INLINE lanes facet(enum lobes_model model, const struct prepared_facet *f, const lanes v[3],
                         const lanes l[3], lanes *j) {
    const lanes *t = f->frame[0], *b = f->frame[1], *n = f->frame[2];
    lanes h[3] = {l[0] + v[0], l[1] + v[1], l[2] + v[2]}, by[5], by_nl, by_nv;
    const lanes length = lanes_sqrt(lanes_max(dot(h, h), lanes_all(1e-6F)));
    for (int i = 0; i < 3; i++)
        h[i] /= length;
    const lanes raw = dot(n, l), nv = dot(n, v), nl = lanes_max(raw, lanes_all(1e-4F));
    const lane_bits lit = raw > 1e-4F;
    const lanes hx = dot(h, t), hy = dot(h, b), hn = dot(h, n);
    const lanes e = model == LOBES_WARD ? ward_exponent(f, hx, hy, hn, by)
                                        : ashikhmin_exponent(f, hx, hy, hn, by);
    const lanes before =
        geometry(model, nl, nv, lanes_max(dot(h, l), lanes_all(1e-3F)), &by_nl, &by_nv);
    const lanes spread = lanes_if(lit, f->scale * before * lanes_exp2(e / LN2), lanes_all(0));
    const lanes shine = f->specular * spread;
    const lanes lambert = lanes_if(lit, nl, lanes_all(0));
    const lanes on_l = shine * by_nl + lanes_if(lit, f->diffuse, lanes_all(0));
    lanes pull[3];
    for (int i = 0; i < 3; i++)
        pull[i] = shine * by[2] * h[i] + on_l * l[i] + shine * by_nv * v[i];
    for (int i = 0; i < 3; i++)
        j[i] = shine * (by[0] * dot(h, f->turns[i][0]) + by[1] * dot(h, f->turns[i][1])) +
               dot(pull, f->turns[i][2]);
    j[3] = shine * (f->scale_u + by[3]);
    j[4] = shine * (f->scale_v + by[4]);
    j[5] = lambert;
    j[6] = spread;
    return f->diffuse * lambert + shine;
}

LANES_INLINE void prepare(enum lobes_model model, int k, const lanes *p, struct prepared *ret) {
    if (model == LOBES_WARD || model == LOBES_ASHIKHMIN)
        prepare_facet(model, p, &ret->facet);
    else
        for (int i = 0; i < k; i++)
            prepare_lobe(p + 4 * i, &ret->lobes[i]);
}

/* Computes f of one pair of directions for LANES texels together, and j, its derivatives with
 * respect to p. */
LANES_INLINE lanes model_at(enum lobes_model model, int k, const lanes *p,
                            const struct prepared *prepared, const float *view, const float *light,
                            lanes *j) {
    const lanes l[3] = {lanes_all(light[0]), lanes_all(light[1]), lanes_all(light[2])};
    lanes f = lanes_all(0);
    if (model == LOBES_FIELDS) {
        for (int i = 0; i < k; i++)
            f += lobe(&prepared->lobes[i], l, j + 4 * i);
        return f;
    }
    const lanes v[3] = {lanes_all(view[0]), lanes_all(view[1]), lanes_all(view[2])};
    if (model != LOBES_LAFORTUNE)
        return facet(model, &prepared->facet, v, l, j);
    const lanes w[3] = {v[0] * l[0], v[1] * l[1], v[2] * l[2]};
    for (int i = 0; i < k; i++)
        f += lobe(&prepared->lobes[i], w, j + 4 * i);
    for (int i = 0; i < 4 * k; i++)
        j[i] *= l[2];
    j[4 * k] = l[2];
    return (f + p[4 * k]) * l[2];
}

LANES_INLINE void clear(struct normal *normal, int n) {
    normal->cost = lanes_all(0);
    for (int i = 0; i < n; i++)
        normal->gradient[i] = lanes_all(0);
    for (int i = 0; i < n * (n + 1) / 2; i++)
        normal->matrix[i] = lanes_all(0);
}

/* Sums ‖r‖², Jᵀr and JᵀJ over all pairs of directions whose y is not NaN. Each view is summed
 * separately first, because a sum of thousands of floats loses digits. */
LANES_INLINE void sum_up(enum lobes_model model, int k, int n, const struct lobes_fit *fit,
                         const lanes *p, const lanes *values, struct normal *ret) {
    struct prepared prepared;
    struct normal part;
    lanes j[P];
    prepare(model, k, p, &prepared);
    clear(ret, n);
    for (int view = 0; view < fit->n_views; view++) {
        clear(&part, n);
        for (int light = 0; light < fit->n_lights; light++, values++) {
            const lanes f =
                model_at(model, k, p, &prepared, fit->views + 3 * view, fit->lights + 3 * light, j);
            const lane_bits there = (*values < 0) | (*values >= 0); /* not NaN */
            const lanes r = lanes_if(there, *values - f, lanes_all(0));
            part.cost += r * r;
            for (int a = 0; a < n; a++) {
                const lanes slope = lanes_if(there, j[a], lanes_all(0));
                part.gradient[a] += slope * r;
                for (int b = 0; b <= a; b++)
                    part.matrix[a * (a + 1) / 2 + b] += slope * j[b];
            }
        }
        ret->cost += part.cost;
        for (int i = 0; i < n; i++)
            ret->gradient[i] += part.gradient[i];
        for (int i = 0; i < n * (n + 1) / 2; i++)
            ret->matrix[i] += part.matrix[i];
    }
}

/* Solves A x = b by Cholesky's method; b is overwritten by x. A pivot below 1e-6 of its element of
 * `diagonal` consists of rounding errors, and is increased. */
LANES_INLINE void solve(int n, lanes *a, const lanes *diagonal, lanes *b) {
    for (int i = 0; i < n; i++) {
        lanes *row = a + i * (i + 1) / 2;
        for (int j = 0; j < i; j++) {
            const lanes *other = a + j * (j + 1) / 2;
            for (int k = 0; k < j; k++)
                row[j] -= row[k] * other[k];
            row[j] *= other[j]; /* the diagonal holds reciprocals */
        }
        for (int k = 0; k < i; k++)
            row[i] -= row[k] * row[k];
        row[i] = 1.0F / lanes_sqrt(lanes_max(row[i], 1e-6F * diagonal[i] + TINY));
        for (int k = 0; k < i; k++)
            b[i] -= row[k] * b[k];
        b[i] *= row[i];
    }
    for (int i = n - 1; i >= 0; i--) {
        for (int k = i + 1; k < n; k++)
            b[i] -= a[k * (k + 1) / 2 + i] * b[k];
        b[i] *= a[i * (i + 1) / 2 + i];
    }
}

/* Gives the bounds of parameter i. Returns FALSE if the parameter has no bounds of its own. The
 * amplitudes of lobes are bounded together, in keep_inside(). */
LANES_INLINE gboolean bounds_of(enum lobes_model model, int k, int i, float *ret_low,
                                float *ret_high) {
    *ret_low = *ret_high = 0;
    if (model == LOBES_FIELDS || (model == LOBES_LAFORTUNE && i < 4 * k)) {
        /* the bounds are ln LOBES_MIN_EXPONENT and ln LOBES_MAX_EXPONENT */
        *ret_low = -0.69314718F;
        *ret_high = 4.15888308F;
        return i % 4 == 3;
    }
    if (model == LOBES_LAFORTUNE || i >= 5) {
        *ret_high = LOBES_MAX_PEAK;
        return TRUE;
    }
    if (i == 2)
        return FALSE;
    if (i < 2) {
        *ret_low = -4, *ret_high = 4;
    } else if (model == LOBES_WARD) {
        *ret_low = -3.5F, *ret_high = 0.7F; /* U and V are 0.03 … 2 */
    } else {
        *ret_low = -1.5F, *ret_high = 6.9F; /* U and V are 0.22 … 1000 */
    }
    return TRUE;
}

LANES_INLINE void keep_inside(enum lobes_model model, int k, int n, lanes peak, lanes *p) {
    for (int i = 0; i < n; i++) {
        float low, high;
        if (bounds_of(model, k, i, &low, &high))
            p[i] = lanes_max(lanes_min(p[i], lanes_all(high)), lanes_all(low));
    }
    for (int i = 0; i < k; i++) {
        lanes *g = p + 4 * i;
        const lanes squares = g[0] * g[0] + g[1] * g[1] + g[2] * g[2];
        const lanes shrink =
            lanes_if(squares > peak * peak, peak / lanes_sqrt(lanes_max(squares, lanes_all(TINY))),
                     lanes_all(1));
        for (int j = 0; j < 3; j++)
            g[j] *= shrink;
    }
}

/* Computes the next parameters to try. A parameter at a bound that would cross this bound does not
 * change. */
LANES_INLINE void step(enum lobes_model model, int k, int n, const struct normal *at,
                       const lanes *p, lanes damping, lanes peak, lanes *ret) {
    lanes a[P * (P + 1) / 2], b[P], diagonal[P];
    lane_bits fixed[P];
    for (int i = 0; i < n; i++) {
        float low, high;
        fixed[i] = (lane_bits){0};
        if (bounds_of(model, k, i, &low, &high))
            fixed[i] =
                ((p[i] <= low) & (at->gradient[i] < 0)) | ((p[i] >= high) & (at->gradient[i] > 0));
        b[i] = lanes_if(fixed[i], lanes_all(0), at->gradient[i]);
        for (int j = 0; j <= i; j++)
            a[i * (i + 1) / 2 + j] =
                lanes_if(fixed[i] | fixed[j], lanes_all(0), at->matrix[i * (i + 1) / 2 + j]);
        lanes *own = &a[i * (i + 1) / 2 + i];
        diagonal[i] = *own = lanes_if(fixed[i], lanes_all(1), *own * (1.0F + damping) + 1e-9F);
    }
    solve(n, a, diagonal, b);
    for (int i = 0; i < n; i++)
        ret[i] = p[i] + b[i];
    keep_inside(model, k, n, peak, ret);
}

/* The state of the eight problems that are being solved, one in each lane. */
struct state {
    const struct lobes_fit *fit;
    /* n        number of parameters
     * samples  n_views × n_lights
     * next     index of the problem that the next free lane gets */
    int n, samples, next, n_problems;
    const float *rows;
    float *parameters, *costs;
    lanes *values; /* samples × LANES values y, NaN if missing */
    /* p        best parameters so far, with the sums `at`
     * trial    parameters that are tried, with the sums `tried`
     * peak     maximum amplitude of a lobe */
    lanes p[P], trial[P], damping, peak;
    struct normal at, tried;
    /* problem: index of the problem in each lane; −1 if no problem is left for it */
    int problem[LANES], steps[LANES];
    gint64 all_steps;
};

/* Gives a lane the next problem. The first point of a problem is always accepted. */
static void load(struct state *state, int lane) {
    const int problem = state->next < state->n_problems ? state->next++ : -1;
    const float *row = state->rows + (gsize)MAX(problem, 0) * (gsize)state->samples;
    float *values = (float *)state->values + lane, brightest = 0;
    state->problem[lane] = problem;
    state->steps[lane] = 0;
    for (int i = 0; i < state->samples; i++) {
        const float value = problem < 0 ? NAN : row[i];
        values[(gsize)i * LANES] = value;
        brightest = value > brightest ? value : brightest;
    }
    state->peak[lane] = MIN(4 * brightest, LOBES_MAX_PEAK);
    state->damping[lane] = 1e-2F;
    state->at.cost[lane] = G_MAXFLOAT;
    for (int i = 0; i < state->n; i++)
        state->p[i][lane] = state->trial[i][lane] =
            problem < 0 ? 0 : state->parameters[(gsize)problem * (gsize)state->n + (gsize)i];
}

static void store(struct state *state, int lane) {
    const int problem = state->problem[lane];
    if (problem < 0)
        return;
    for (int i = 0; i < state->n; i++)
        state->parameters[(gsize)problem * (gsize)state->n + (gsize)i] = state->p[i][lane];
    if (state->costs)
        state->costs[problem] = state->at.cost[lane];
    state->all_steps += state->steps[lane];
}

/* Accepts the tried points that are better. Returns the lanes whose problems have ended. */
LANES_INLINE lane_bits accept(struct state *state) {
    const int n = state->n;
    const lane_bits better = state->tried.cost < state->at.cost;
    const lanes gain = state->at.cost - state->tried.cost;
    const lane_bits small = better & (gain <= ENOUGH * state->at.cost);
    state->at.cost = lanes_if(better, state->tried.cost, state->at.cost);
    for (int i = 0; i < n; i++) {
        state->p[i] = lanes_if(better, state->trial[i], state->p[i]);
        state->at.gradient[i] = lanes_if(better, state->tried.gradient[i], state->at.gradient[i]);
    }
    for (int i = 0; i < n * (n + 1) / 2; i++)
        state->at.matrix[i] = lanes_if(better, state->tried.matrix[i], state->at.matrix[i]);
    state->damping = lanes_if(better, lanes_max(state->damping * 0.15F, lanes_all(1e-6F)),
                              state->damping * 5.0F);
    return small | (state->damping > 1e5F) | (state->at.cost <= TINY);
}

/* Stores the results of lanes that have ended, or that have made MAX_STEPS steps, and loads their
 * next problems. Returns whether a lane is still busy. ended is passed by address, because
 * processors differ in how they pass vectors by value. */
static gboolean refill(struct state *state, const gint32 *ended) {
    gboolean busy = FALSE;
    for (int lane = 0; lane < LANES; lane++) {
        if (state->problem[lane] >= 0 && (ended[lane] || ++state->steps[lane] >= MAX_STEPS)) {
            store(state, lane);
            load(state, lane);
        }
        busy |= state->problem[lane] >= 0;
    }
    return busy;
}

LANES_INLINE void run(enum lobes_model model, int k, int n, struct state *state) {
    state->n = n;
    for (int lane = 0; lane < LANES; lane++)
        load(state, lane);
    gboolean busy = TRUE;
    gint32 ended_lanes[LANES];
    while (busy) {
        keep_inside(model, k, n, state->peak, state->trial);
        sum_up(model, k, n, state->fit, state->trial, state->values, &state->tried);
        const lane_bits ended = accept(state);
        step(model, k, n, &state->at, state->p, state->damping, state->peak, state->trial);
        memcpy(ended_lanes, &ended, sizeof ended_lanes);
        busy = refill(state, ended_lanes);
    }
}

/* Solves all problems of the state. Each model is compiled separately for each number of lobes, so
 * that the loops over its parameters are unrolled. */
LANES_INLINE void run_kind(struct state *state) {
    switch (state->fit->model) {
    case LOBES_FIELDS:
        if (state->fit->n_lobes == 1)
            run(LOBES_FIELDS, 1, 4, state);
        else if (state->fit->n_lobes == 2)
            run(LOBES_FIELDS, 2, 8, state);
        else
            run(LOBES_FIELDS, 3, 12, state);
        break;
    case LOBES_LAFORTUNE:
        if (state->fit->n_lobes == 1)
            run(LOBES_LAFORTUNE, 1, 5, state);
        else if (state->fit->n_lobes == 2)
            run(LOBES_LAFORTUNE, 2, 9, state);
        else
            run(LOBES_LAFORTUNE, 3, 13, state);
        break;
    case LOBES_WARD:
        run(LOBES_WARD, 0, 7, state);
        break;
    default:
        run(LOBES_ASHIKHMIN, 0, 7, state);
        break;
    }
}

/* run_any() chooses the function for the processor. The compiler's target_clones cannot, because
 * their resolvers run before the sanitizers are initialised. */
#if defined(__x86_64__)
__attribute__((target("avx2,fma"))) static void run_avx2(struct state *state) {
    run_kind(state);
}
#endif

static void run_any(struct state *state) {
#if defined(__x86_64__)
    if (__builtin_cpu_supports("avx2") && __builtin_cpu_supports("fma")) {
        run_avx2(state);
        return;
    }
#endif
    run_kind(state);
}

gint64 lobes_fit_rows(const struct lobes_fit *fit, const float *rows, int n, float *parameters,
                      float *ret_costs) {
    struct state *state = g_aligned_alloc0(1, sizeof *state, 64);
    g_return_val_if_fail(lobes_of(fit) <= LOBES_MAX_LOBES, 0);
    state->fit = fit;
    state->samples = fit->n_views * fit->n_lights;
    state->values = g_aligned_alloc((gsize)state->samples, sizeof *state->values, 64);
    state->n_problems = n;
    state->rows = rows;
    state->parameters = parameters;
    state->costs = ret_costs;
    run_any(state);
    const gint64 steps = state->all_steps;
    g_aligned_free(state->values);
    g_aligned_free(state);
    return steps;
}
