/* The mean material g of prediction.h, fitted to the probes. */
#include <cminpack.h>
#include <stdlib.h>
#include <string.h>

#include "prediction_private.h"

#define LOBES     PREDICTION_LOBES
#define CELLS     3   /* the probes are divided into CELLS² parts of the sample */
#define FIT_PAIRS 400 /* maximum number of measured pairs that are used */
#define STARTS    3   /* number of initial widths of lobes */
#define MIN_COS   0.05
#define TOLERANCE 1e-6
#define FACTOR    100 /* bound of the first step, as in lmdif1() */

/* The parameters x of g: ln d_R, ln d_G, ln d_B, e_v, e_l, then for each lobe ln s, ln A₁₁, A₁₂, ln
 * A₂₂, ln (γ − 1), p, q, m_x, m_y. */
enum { DIFFUSE = 5, LOBE = 9 };

static double prediction_mean_lobe(const double *x, double hx, double hy, double cos_v,
                                   double cos_l) {
    const double gamma = 1 + exp(fmin(x[4], 20));
    const double dx = hx - x[7], dy = hy - x[8];
    const double a = exp(fmin(x[1], 10)) * dx + x[2] * dy, b = exp(fmin(x[3], 10)) * dy;
    return exp(x[0] - gamma * log1p((a * a + b * b) / gamma)) * pow(cos_v, -x[5]) *
           pow(cos_l, -x[6]);
}

void prediction_mean_diffuse(const double *x, double cos_v, double cos_l, double ret[3]) {
    cos_v = fmax(cos_v, MIN_COS);
    cos_l = fmax(cos_l, MIN_COS);
    const double shade = cos_l * exp(x[3] * (1 - cos_v) + x[4] * (1 - cos_l));
    for (int c = 0; c < 3; c++)
        ret[c] = exp(x[c]) * shade;
}

double prediction_mean_gloss(const double *x, struct vec3 v, struct vec3 l) {
    const double cos_v = fmax(v.z, MIN_COS), cos_l = fmax(l.z, MIN_COS);
    const struct vec3 h = vec3_add(v, l);
    const double hz = fmax(h.z, 2 * MIN_COS);
    double gloss = 0;
    for (int k = 0; k < LOBES; k++)
        gloss += prediction_mean_lobe(x + DIFFUSE + LOBE * k, h.x / hz, h.y / hz, cos_v, cos_l);
    return gloss;
}

void prediction_mean(const double *x, double max_gloss, struct vec3 v, struct vec3 l,
                     double ret[3]) {
    const double gloss = fmin(prediction_mean_gloss(x, v, l), max_gloss);
    prediction_mean_diffuse(x, v.z, l.z, ret);
    for (int c = 0; c < 3; c++)
        ret[c] = fmax(ret[c] + gloss, PREDICTION_MIN_MEAN);
}

struct prediction_mean_fit {
    int n;              /* number of combinations of a pair and a cell */
    struct vec3 *v, *l; /* n */
    double *logarithms; /* n × 3, logarithms of the root mean squares */
};

static int prediction_mean_residuals(void *data, int n, int n_parameters, const double *x,
                                     double *ret, int flag) {
    const struct prediction_mean_fit *fit = data;
    (void)n_parameters;
    for (int i = 0; 3 * i < n; i++) {
        double g[3];
        prediction_mean(x, INFINITY, fit->v[i], fit->l[i], g);
        for (int c = 0; c < 3; c++) {
            const double off = log(g[c]) - fit->logarithms[3 * i + c];
            ret[3 * i + c] = isfinite(off) ? CLAMP(off, -50, 50) : 50;
        }
    }
    return flag < 0 ? flag : 0;
}

/* Finds the cell of each probe: the box of all probes is divided into CELLS² equal parts. */
static void prediction_mean_cells(const struct vec3 *at_mm, int n, int *ret) {
    double low[2] = {INFINITY, INFINITY}, high[2] = {-INFINITY, -INFINITY};
    for (int i = 0; i < n; i++) {
        const double at[2] = {at_mm[i].x, at_mm[i].y};
        for (int k = 0; k < 2; k++) {
            low[k] = fmin(low[k], at[k]);
            high[k] = fmax(high[k], at[k]);
        }
    }
    for (int i = 0; i < n; i++) {
        const double at[2] = {at_mm[i].x, at_mm[i].y};
        int cell[2];
        for (int k = 0; k < 2; k++)
            cell[k] =
                CLAMP((int)(CELLS * (at[k] - low[k]) / fmax(high[k] - low[k], 1e-9)), 0, CELLS - 1);
        ret[i] = cell[1] * CELLS + cell[0];
    }
}

/* Computes the logarithm of the root mean square of ρ for each cell, pair and colour, for at most
 * FIT_PAIRS measured pairs. The directions are those at the mean position of the cell's probes. */
static void gather(const Prediction *prediction, const float *probes, const struct vec3 *at_mm,
                   int n_probes, struct prediction_mean_fit *ret) {
    const int n_pairs = MIN(prediction->n_measured, FIT_PAIRS);
    const gsize all = (gsize)prediction->n_pairs;
    g_autofree int *cells = g_new(int, n_probes);
    ret->v = g_new(struct vec3, CELLS * CELLS * n_pairs);
    ret->l = g_new(struct vec3, CELLS * CELLS * n_pairs);
    ret->logarithms = g_new(double, 3 * CELLS * CELLS * n_pairs);
    prediction_mean_cells(at_mm, n_probes, cells);
    for (int cell = 0; cell < CELLS * CELLS; cell++) {
        struct vec3 centre = {0};
        int members = 0;
        for (int i = 0; i < n_probes; i++)
            if (cells[i] == cell) {
                centre = vec3_add(centre, at_mm[i]);
                members++;
            }
        centre = vec3_scale(centre, 1.0 / MAX(members, 1));
        for (int k = 0; k < n_pairs && members > 0; k++) {
            const int pair = prediction->measured[(gint64)k * prediction->n_measured / n_pairs];
            double squares[3] = {0};
            int known[3] = {0};
            for (int i = 0; i < n_probes; i++)
                for (int c = 0; cells[i] == cell && c < 3; c++) {
                    const double value =
                        (double)probes[(3 * (gsize)i + (gsize)c) * all + (gsize)pair];
                    known[c] += isfinite(value) != 0;
                    squares[c] += isfinite(value) ? value * value : 0;
                }
            if (known[0] < 1 || known[1] < 1 || known[2] < 1)
                continue;
            prediction_directions(prediction, centre, pair, &ret->v[ret->n], &ret->l[ret->n]);
            for (int c = 0; c < 3; c++)
                ret->logarithms[3 * ret->n + c] =
                    log(fmax(sqrt(squares[c] / known[c]), PREDICTION_MIN_MEAN));
            ret->n++;
        }
    }
}

/* Sets the initial parameters. The diffuser has the median of the values. One lobe is narrower in x
 * and the other narrower in y, with slopes of about 1 / width. */
static void begin(const struct prediction_mean_fit *fit, double width, double *x) {
    g_autofree double *values = g_new(double, fit->n);
    memset(x, 0, sizeof(double) * PREDICTION_MEAN);
    double top = -INFINITY;
    for (int c = 0; c < 3; c++) {
        for (int i = 0; i < fit->n; i++) {
            values[i] = fit->logarithms[3 * i + c] - log(fmax(fit->l[i].z, MIN_COS));
            top = fmax(top, fit->logarithms[3 * i + c]);
        }
        x[c] = robust_median(values, fit->n);
    }
    for (int k = 0; k < LOBES; k++) {
        double *lobe = x + DIFFUSE + LOBE * k;
        lobe[0] = top + log(0.5);
        lobe[1] = log(width * (k == 0 ? 1.3 : 0.6));
        lobe[3] = log(width * (k == 0 ? 0.7 : 1.3));
        lobe[4] = 2;
        lobe[5] = 0.5;
    }
}

/* If there are too few values for a fit, g stays the diffuser cos θ_l without lobes. */
void prediction_mean_fit(Prediction *prediction, const float *probes, const struct vec3 *at_mm,
                         int n_probes, const double *like, int most) {
    static const double widths[STARTS] = {2, 6, 15};
    const gboolean follows = like && isfinite(like[DIFFUSE]);
    const int starts = follows ? 1 : STARTS;
    struct prediction_mean_fit fit = {0};
    double x[PREDICTION_MEAN], least = INFINITY;
    for (int k = 0; k < LOBES; k++)
        prediction->mean[DIFFUSE + LOBE * k] = -INFINITY;
    gather(prediction, probes, at_mm, n_probes, &fit);
    const int n = 3 * fit.n;
    g_autofree double *residuals = g_new(double, MAX(n, 1)), *last = g_new(double, MAX(n, 1));
    g_autofree double *jacobian = g_new(double, (gsize)MAX(n, 1) * PREDICTION_MEAN);
    double diagonal[PREDICTION_MEAN], qtf[PREDICTION_MEAN], room[3][PREDICTION_MEAN];
    int indices[PREDICTION_MEAN], evaluations;
    for (int start = 0; start < starts && n > 2 * PREDICTION_MEAN; start++) {
        if (follows)
            memcpy(x, like, sizeof x);
        else
            begin(&fit, widths[start], x);
        lmdif(prediction_mean_residuals, &fit, n, PREDICTION_MEAN, x, residuals, TOLERANCE,
              TOLERANCE, 0, most, 0, diagonal, 1, FACTOR, 0, &evaluations, jacobian, n, indices,
              qtf, room[0], room[1], room[2], last);
        prediction_mean_residuals(&fit, n, PREDICTION_MEAN, x, residuals, 0);
        double sum = 0;
        for (int i = 0; i < n; i++)
            sum += residuals[i] * residuals[i];
        if (sum < least) {
            least = sum;
            memcpy(prediction->mean, x, sizeof x);
        }
    }
    prediction->max_gloss = 0;
    for (int i = 0; i < fit.n; i++) {
        double with[3], without[3];
        prediction_mean(prediction->mean, INFINITY, fit.v[i], fit.l[i], with);
        prediction_mean(prediction->mean, 0, fit.v[i], fit.l[i], without);
        prediction->max_gloss = fmax(prediction->max_gloss, with[0] - without[0]);
    }
    g_free(fit.v);
    g_free(fit.l);
    g_free(fit.logarithms);
}
