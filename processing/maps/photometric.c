#include "photometric.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/direction.h"
#include "base/robust.h"

#define BLOCK     256  /* number of texels that a thread solves at a time */
#define SAMPLES   1536 /* number of texels from which σ is estimated */
#define BINS      8    /* number of ranges of |b|, with the same number of samples each */
#define TRIPLES   160  /* maximum number of triples that are tried */
#define TRUNCATED 3.0  /* in σ: maximum size with which a difference counts */
#define SHADOW    0.35 /* share of the expected value below which a light is in shadow */
/* factor of TRUNCATED² for a light that is dimmer than expected but not in shadow */
#define IMPLAUSIBLE 3.0
/* in σ: a light agrees if its value differs from b · l_i by at most this */
#define AGREES 3.5
#define ROUNDS 12
/* number of iterations of least squares over the lights that the surface faces */
#define TURNS 3
/* number of degrees of freedom with which σ counts in the scale of a texel's own residuals */
#define PRIOR    4.0
#define LIT      5.0  /* in σ: minimum value of a texel that is not dark */
#define FLATTEST 20.0 /* degrees: maximum error of a normal */
#define MIN_REAL 1e-4 /* relative to |b|: minimum σ, for pictures without noise */
#define VOLUME   0.02 /* minimum |det| of a triple of lights */
/* number of simulated texels of rehearse() */
#define REHEARSALS 256
/* σ is this quantile of the scales of the samples, because texels with highlights have larger
 * scales */
#define QUANTILE 0.25
#define WIDEST   32  /* maximum multiple of σ that is tried if too few lights agree */
#define SHARE    0.4 /* minimum share of the facing lights that must agree */
#define DEG      (180 / G_PI)

/* The known values of a texel, and their lights. */
struct lit {
    int n;
    double *values; /* luminance under each light */
    struct vec3 *lights;
    int *index; /* index of each light */
};

struct solver {
    const struct photometric_input *input;
    struct photometric_texel *ret;
    /* at: values of |b|, ascending
     * sigma: σ at each of these values */
    double at[BINS], sigma[BINS];
};

static struct lit lit_new(int n) {
    return (struct lit){0, g_new(double, n), g_new(struct vec3, n), g_new(int, n)};
}

static void lit_clear(struct lit *lit) {
    g_free(lit->values);
    g_free(lit->lights);
    g_free(lit->index);
}

static void lit_read(const struct photometric_input *input, int texel, float *rgb,
                     struct vec3 *lights, struct lit *ret) {
    input->read(texel, rgb, lights, input->data);
    ret->n = 0;
    for (int i = 0; i < input->n_lights; i++) {
        const float y = rgb_luminance(rgb + 3 * (gsize)i);
        if (!isfinite(y))
            continue;
        ret->values[ret->n] = (double)y;
        ret->lights[ret->n] = lights[i];
        ret->index[ret->n++] = i;
    }
}

/* Solves Σ w l lᵀ b = Σ w I l by Cramer's rule, with columns x, y, z. Returns FALSE if the matrix
 * is nearly singular. ret_inverse receives the rows of the inverse, or is NULL. */
static gboolean solve(struct vec3 x, struct vec3 y, struct vec3 z, struct vec3 sum,
                      struct vec3 *ret, struct vec3 ret_inverse[3]) {
    const struct vec3 yz = vec3_cross(y, z), zx = vec3_cross(z, x), xy = vec3_cross(x, y);
    const double volume = vec3_dot(x, yz), size = x.x + y.y + z.z;
    if (!(volume > 1e-9 * size * size * size))
        return FALSE;
    *ret = vec3_scale(vec3(vec3_dot(sum, yz), vec3_dot(sum, zx), vec3_dot(sum, xy)), 1 / volume);
    if (ret_inverse) {
        ret_inverse[0] = vec3_scale(yz, 1 / volume);
        ret_inverse[1] = vec3_scale(zx, 1 / volume);
        ret_inverse[2] = vec3_scale(xy, 1 / volume);
    }
    return TRUE;
}

/* Makes one step of weighted least squares over the lights that b faces. With sigma 0 all weights
 * are 1. With b = 0 all lights count. Returns FALSE if the lights do not determine the result. */
static gboolean step(const struct lit *lit, struct vec3 b, double sigma, struct vec3 *ret) {
    struct vec3 x = vec3(0, 0, 0), y = x, z = x, sum = x;
    const gboolean any = !(vec3_dot(b, b) > 0);
    for (int i = 0; i < lit->n; i++) {
        const struct vec3 l = lit->lights[i];
        const double expected = vec3_dot(b, l);
        if (!any && !(expected > 0))
            continue;
        const double w = sigma > 0 ? robust_biweight(lit->values[i] - expected, sigma) : 1;
        x = vec3_add(x, vec3_scale(l, w * l.x));
        y = vec3_add(y, vec3_scale(l, w * l.y));
        z = vec3_add(z, vec3_scale(l, w * l.z));
        sum = vec3_add(sum, vec3_scale(l, w * lit->values[i]));
    }
    return solve(x, y, z, sum, ret, NULL);
}

static double residual(const struct lit *lit, int i, struct vec3 b) {
    return lit->values[i] - MAX(vec3_dot(b, lit->lights[i]), 0);
}

/* Finds b by least squares over the lights that the surface faces, beginning with all lights.
 * Returns FALSE if there is no b. */
static gboolean plain(const struct lit *lit, struct vec3 *ret) {
    struct vec3 b = vec3(0, 0, 0), next;
    for (int turn = 0; turn < TURNS && step(lit, b, 0, &next); turn++)
        b = next;
    *ret = b;
    return vec3_dot(b, b) > 0;
}

/* Callback that returns how badly a solution b explains the lights. Smaller is better. */
typedef double (*Score)(const struct lit *lit, struct vec3 b, double sigma, double *buffer);

/* Returns Σ min((r/σ)², TRUNCATED²), with a larger limit for dimmed lights. Highlights add light,
 * and shadows remove almost all of it. A light that is only slightly dimmer than Lambert's law
 * predicts is therefore evidence against the solution. */
static double truncated(const struct lit *lit, struct vec3 b, double sigma, double *buffer) {
    double sum = 0;
    for (int i = 0; i < lit->n; i++) {
        const double r = residual(lit, i, b) / sigma;
        const gboolean dimmed = r < 0 && lit->values[i] > SHADOW * vec3_dot(b, lit->lights[i]);
        sum += MIN(r * r, TRUNCATED * TRUNCATED * (dimmed ? IMPLAUSIBLE : 1));
    }
    return sum;
}

static int by_size(const void *a, const void *b) {
    const double x = *(const double *)a, y = *(const double *)b;
    return (x > y) - (x < y);
}

/* Returns the median of |r| (least median of squares, Rousseeuw 1984), but at least the fourth
 * smallest |r|, because three lights determine b. */
static double median_of(const struct lit *lit, struct vec3 b, double sigma, double *buffer) {
    int n = 0;
    /* A light that b does not face and whose value is 0 is left out, because it would agree with
     * many wrong solutions. */
    for (int i = 0; i < lit->n; i++)
        if (vec3_dot(b, lit->lights[i]) > 0)
            buffer[n++] = fabs(residual(lit, i, b));
        else if (lit->values[i] > 0)
            buffer[n++] = lit->values[i];
    if (n < 4)
        return HUGE_VAL;
    qsort(buffer, (gsize)n, sizeof *buffer, by_size);
    return buffer[MAX(n / 2, 3)];
}

/* Finds the solution with the lowest score among those of triples of lights and of plain least
 * squares. Returns FALSE if there is none. The triples are all triples, or a fixed sequence of them
 * if there are many. */
static gboolean best_triple(const struct lit *lit, Score score, double sigma, double *buffer,
                            struct vec3 *ret) {
    double least = HUGE_VAL;
    struct vec3 b;
    if (plain(lit, &b)) {
        least = score(lit, b, sigma, buffer);
        *ret = b;
    }
    const int n = lit->n;
    const gboolean all = n * (n - 1) * (n - 2) / 6 <= TRIPLES && n < 32;
    guint32 seed = 1;
    int i = 0, j = 1, k = 2;
    for (int trial = 0; n >= 3 && trial < TRIPLES && i < n - 2; trial++) {
        if (!all) {
            int *const to[] = {&i, &j, &k};
            for (int t = 0; t < 3; t++) {
                seed = seed * 1664525U + 1013904223U;
                *to[t] = (int)((guint64)seed * (guint64)n >> 32);
            }
        }
        const struct vec3 p = lit->lights[i], q = lit->lights[j], r = lit->lights[k];
        const double det = vec3_dot(p, vec3_cross(q, r));
        if (fabs(det) > VOLUME) {
            b = vec3_scale(vec3_add(vec3_add(vec3_scale(vec3_cross(q, r), lit->values[i]),
                                             vec3_scale(vec3_cross(r, p), lit->values[j])),
                                    vec3_scale(vec3_cross(p, q), lit->values[k])),
                           1 / det);
            const double is = score(lit, b, sigma, buffer);
            if (is < least) {
                least = is;
                *ret = b;
            }
        }
        if (all && ++k == n) {
            if (++j == n - 1)
                j = ++i + 1;
            k = j + 1;
        }
        if (!all)
            i = 0;
    }
    return least < HUGE_VAL;
}

/* Returns σ at |b| = length by linear interpolation, multiplied by times. */
static double sigma_at(const struct solver *solver, double length, double times) {
    int k = 1;
    while (k < BINS - 1 && solver->at[k] < length)
        k++;
    const double from = solver->at[k - 1], to = solver->at[k];
    const double t = to > from ? CLAMP((length - from) / (to - from), 0, 1) : 0;
    return times * MAX((1 - t) * solver->sigma[k - 1] + t * solver->sigma[k], MIN_REAL * length);
}

/* Repeats weighted least squares from a start. σ is taken at the length of b and multiplied by
 * times. *ret_ok is FALSE if not even the first step has a solution. */
static struct vec3 refine(const struct solver *solver, const struct lit *lit, struct vec3 b,
                          double times, gboolean *ret_ok) {
    *ret_ok = FALSE;
    for (int round = 0; round < ROUNDS; round++) {
        struct vec3 next;
        if (!step(lit, b, sigma_at(solver, vec3_length(b), times), &next))
            return b;
        const double moved = vec3_length(vec3_sub(next, b));
        b = next;
        *ret_ok = TRUE;
        if (moved < 1e-5 * vec3_length(b))
            break;
    }
    return b;
}

/* Finds the albedo of each colour by least squares of I_c = a_c n·l over the lights that agree. */
static void find_albedo(const struct lit *lit, const float *rgb, struct vec3 b, double sigma,
                        struct photometric_texel *ret) {
    double sums[3] = {0}, squares = 0;
    for (int i = 0; i < lit->n; i++) {
        const double cosine = vec3_dot(ret->normal, lit->lights[i]);
        if (!(cosine > 0) || fabs(residual(lit, i, b)) > AGREES * sigma)
            continue;
        squares += cosine * cosine;
        for (int c = 0; c < 3; c++)
            sums[c] += cosine * (double)rgb[3 * lit->index[i] + c];
    }
    for (int c = 0; c < 3; c++)
        ret->albedo[c] = squares > 0 ? (float)(sums[c] / squares) : 0;
}

/* Decides whether b is a valid solution, and sets used and sigma_deg. Returns PHOTOMETRIC_FOUND, or
 * the cause for which there is no normal.
 *
 * A light whose value is only noise does not count, because it would confirm wrong solutions: for
 * any two lights there is a solution whose surface the third light just grazes. */
static enum photometric_cause judge(const struct lit *lit, struct vec3 b, double sigma,
                                    struct photometric_texel *ret) {
    int facing = 0;
    double squares = 0, weights = 0;
    struct vec3 x = vec3(0, 0, 0), y = x, z = x, ignored, inverse[3];
    for (int i = 0; i < lit->n; i++) {
        const struct vec3 l = lit->lights[i];
        const double r = residual(lit, i, b), w = robust_biweight(r, sigma);
        if (!(vec3_dot(b, l) > 0) || (w > 0 && !(lit->values[i] > AGREES * sigma)))
            continue;
        facing++;
        ret->used += fabs(r) <= AGREES * sigma;
        squares += w * r * r;
        weights += w;
        x = vec3_add(x, vec3_scale(l, w * l.x));
        y = vec3_add(y, vec3_scale(l, w * l.y));
        z = vec3_add(z, vec3_scale(l, w * l.z));
    }
    if (ret->used < PHOTOMETRIC_MIN_LIGHTS)
        return facing < PHOTOMETRIC_MIN_LIGHTS ? PHOTOMETRIC_FEW : PHOTOMETRIC_CONTRADICT;
    /* Three lights always agree with some solution. */
    if ((ret->used == PHOTOMETRIC_MIN_LIGHTS && facing > PHOTOMETRIC_MIN_LIGHTS) ||
        ret->used < SHARE * facing)
        return PHOTOMETRIC_CONTRADICT;
    if (!solve(x, y, z, b, &ignored, inverse))
        return PHOTOMETRIC_FLAT;
    const double free = MAX(weights - 3, 0);
    const double scale2 = (squares + PRIOR * sigma * sigma) / (free + PRIOR);
    const struct vec3 n = vec3_unit(b);
    const double trace = inverse[0].x + inverse[1].y + inverse[2].z;
    const struct vec3 along =
        vec3(vec3_dot(inverse[0], n), vec3_dot(inverse[1], n), vec3_dot(inverse[2], n));
    const double across = MAX(trace - vec3_dot(along, n), 0);
    ret->sigma_deg =
        (float)(atan(sqrt(MAX(scale2, sigma * sigma) * across) / vec3_length(b)) * DEG);
    if (!(ret->sigma_deg < FLATTEST))
        return PHOTOMETRIC_FLAT;
    if (!(n.z > 0))
        return PHOTOMETRIC_AWAY;
    ret->normal = n;
    return PHOTOMETRIC_FOUND;
}

static void solve_texel(const struct solver *solver, const struct lit *lit, const float *rgb,
                        double *buffer, struct photometric_texel *ret) {
    struct vec3 b;
    gboolean ok = FALSE;
    double most = 0, sigma = 0;
    *ret = (struct photometric_texel){.cause = PHOTOMETRIC_FEW};
    for (int i = 0; i < lit->n; i++)
        most = MAX(most, lit->values[i]);
    if (lit->n < PHOTOMETRIC_MIN_LIGHTS)
        return;
    if (!(most > LIT * solver->sigma[0])) {
        ret->cause = PHOTOMETRIC_DARK;
        return;
    }
    ret->cause = PHOTOMETRIC_CONTRADICT;
    for (double times = 1; times <= WIDEST && ret->cause == PHOTOMETRIC_CONTRADICT; times *= 2) {
        *ret = (struct photometric_texel){.cause = PHOTOMETRIC_FLAT};
        if (!best_triple(lit, truncated, sigma_at(solver, most, times), buffer, &b))
            break;
        b = refine(solver, lit, b, times, &ok);
        sigma = sigma_at(solver, vec3_length(b), times);
        if (ok)
            ret->cause = judge(lit, b, sigma, ret);
    }
    if (ret->cause == PHOTOMETRIC_FOUND)
        find_albedo(lit, rgb, b, sigma, ret);
    else
        *ret = (struct photometric_texel){.cause = ret->cause};
}

static void solve_block(int block, gpointer data) {
    const struct solver *solver = data;
    const struct photometric_input *input = solver->input;
    const int end = MIN((block + 1) * BLOCK, input->n_texels);
    g_autofree float *rgb = g_new(float, 3 * (gsize)input->n_lights);
    g_autofree double *buffer = g_new(double, input->n_lights);
    g_autofree struct vec3 *lights = g_new(struct vec3, input->n_lights);
    struct lit lit = lit_new(input->n_lights);
    for (int texel = block * BLOCK; texel < end; texel++) {
        lit_read(input, texel, rgb, lights, &lit);
        solve_texel(solver, &lit, rgb, buffer, &solver->ret[texel]);
    }
    lit_clear(&lit);
}

struct sample {
    double length, scale;
};

static int by_length(const void *a, const void *b) {
    return by_size(&((const struct sample *)a)->length, &((const struct sample *)b)->length);
}

static double quantile(double *values, int n) {
    qsort(values, (gsize)n, sizeof *values, by_size);
    return values[(int)(QUANTILE * (n - 1))];
}

/* Simulates texels under the lights of one texel, with normals in many directions and normally
 * distributed errors. The scale of a simulated texel is median_of() of the best triple. Returns the
 * quantile QUANTILE of the ratios of scale to true σ. */
static double rehearse(const struct lit *of, double *buffer) {
    struct lit lit = lit_new(of->n);
    g_autofree double *ratios = g_new(double, REHEARSALS);
    g_autoptr(GRand) rand = g_rand_new_with_seed(1);
    const double sigma = 1e-3;
    int found = 0;
    memcpy(lit.lights, of->lights, sizeof *lit.lights * (gsize)of->n);
    lit.n = of->n;
    for (int t = 0; t < REHEARSALS; t++) {
        const double z = 1 - 0.8 * (t + 0.5) / REHEARSALS, r = sqrt(1 - z * z), phi = 2.4 * t;
        const struct vec3 n = vec3(r * cos(phi), r * sin(phi), z);
        struct vec3 b;
        for (int i = 0; i < lit.n; i++) {
            double normal = -6;
            for (int k = 0; k < 12; k++)
                normal += g_rand_double(rand);
            lit.values[i] = MAX(vec3_dot(n, lit.lights[i]), 0) + sigma * normal;
        }
        if (!best_triple(&lit, median_of, 0, buffer, &b))
            continue;
        const double scale = median_of(&lit, b, 0, buffer);
        if (isfinite(scale))
            ratios[found++] = scale / sigma;
    }
    lit_clear(&lit);
    return found > REHEARSALS / 8 ? quantile(ratios, found) : 1;
}

/* Finds σ as a function of |b| from about SAMPLES texels that are spread over the whole picture. */
static void find_sigma(struct solver *solver) {
    const struct photometric_input *input = solver->input;
    const int stride = MAX(1, input->n_texels / SAMPLES);
    g_autofree float *rgb = g_new(float, 3 * (gsize)input->n_lights);
    g_autofree double *buffer = g_new(double, input->n_lights);
    g_autofree struct vec3 *lights = g_new(struct vec3, input->n_lights);
    g_autoptr(GArray) samples = g_array_new(FALSE, FALSE, sizeof(struct sample));
    struct lit lit = lit_new(input->n_lights);
    double ratio = 0;
    for (int texel = stride / 2; texel < input->n_texels; texel += stride) {
        struct vec3 b;
        lit_read(input, texel, rgb, lights, &lit);
        if (lit.n < 4 || !best_triple(&lit, median_of, 0, buffer, &b))
            continue;
        const struct sample sample = {vec3_length(b), median_of(&lit, b, 0, buffer)};
        if (!isfinite(sample.scale) || !(sample.length > 0))
            continue;
        if (!(ratio > 0))
            ratio = rehearse(&lit, buffer);
        g_array_append_val(samples, sample);
    }
    lit_clear(&lit);
    g_array_sort(samples, by_length);
    for (int k = 0; k < BINS; k++) {
        const guint from = samples->len * (guint)k / BINS,
                    to = samples->len * (guint)(k + 1) / BINS;
        g_autofree double *of = g_new(double, to - from + 1);
        for (guint i = from; i < to; i++)
            of[i - from] = g_array_index(samples, struct sample, i).scale / ratio;
        solver->sigma[k] = to > from ? quantile(of, (int)(to - from)) : 0;
        solver->at[k] =
            to > from ? g_array_index(samples, struct sample, (from + to) / 2).length : 0;
    }
}

gboolean photometric_solve(const struct photometric_input *input, const struct work *work,
                           struct photometric_texel *ret, GError **error) {
    struct solver solver = {.input = input, .ret = ret};
    find_sigma(&solver);
    return work_parallel(work, "normals", (input->n_texels + BLOCK - 1) / BLOCK, solve_block,
                         &solver, error);
}

const char *photometric_cause_text(enum photometric_cause cause) {
    static const char *const texts[PHOTOMETRIC_CAUSES] = {
        [PHOTOMETRIC_FOUND] = "have a normal",
        [PHOTOMETRIC_DARK] = "are dark under all lights",
        [PHOTOMETRIC_FEW] = "are lit by fewer than three lights",
        [PHOTOMETRIC_CONTRADICT] = "contradict Lambert's law under most lights",
        [PHOTOMETRIC_FLAT] = "are lit from nearly one plane",
        [PHOTOMETRIC_AWAY] = "face away from the camera",
    };
    return texts[cause];
}
