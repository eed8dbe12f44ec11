#include "compression_parts.h"

#include "base/direction.h"
#include "bench.h"
#include "codecs/lobes/lobes_private.h"

#include <cminpack.h>
#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <time.h>

#define LOBES      2
#define PARAMETERS (4 * LOBES)
#define TOLERANCE  1e-5 /* of the sum of squares, as in lobes_fit.c */
#define MAX_CALLS  80

/* Problems of one session: rows of luminance by light, and where all solvers begin. */
struct problems {
    struct btf_matrix *btf;
    struct lobes_fit fit;
    float *lights, *rows, *starts;
    int n;
};

struct solver {
    double seconds, cost; /* of all problems, on one core */
};

static double cpu_s(void) {
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return (double)now.tv_sec + 1e-9 * (double)now.tv_nsec;
}

static void take_problems(struct problems *p, struct btf_matrix *btf, int n) {
    const int samples = btf->layout.lights.n,
              all = btf_layout_texels(&btf->layout) * btf->layout.views.n;
    p->btf = btf;
    p->n = MIN(n, all);
    p->lights = g_new(float, 3 * samples);
    p->rows = g_new(float, p->n *samples);
    p->starts = g_new(float, p->n *PARAMETERS);
    for (int i = 0; i < samples; i++)
        direction_from_deg(btf->layout.lights.theta_deg[i], btf->layout.lights.phi_deg[i],
                           p->lights + 3 * i);
    for (int i = 0; i < p->n; i++) {
        const gsize from = (gsize)((double)all * i / p->n); /* all over the sample and the views */
        for (int light = 0; light < samples; light++)
            p->rows[i * samples + light] =
                rgb_luminance(btf->values + (from * (gsize)samples + (gsize)light) * 3);
    }
    p->fit = (struct lobes_fit){LOBES_FIELDS, LOBES, 1, samples, p->lights, p->lights};
    struct lobes_start *start = lobes_start_new(&p->fit);
    lobes_start_rows(start, 0, p->rows, p->n, p->starts);
    lobes_start_free(start);
}

static struct solver solve_batch(const struct problems *p) {
    g_autofree float *x = g_memdup2(p->starts, sizeof(float) * (gsize)p->n * PARAMETERS);
    g_autofree float *costs = g_new(float, p->n);
    struct solver ret = {-cpu_s()};
    lobes_fit_rows(&p->fit, p->rows, p->n, x, costs);
    ret.seconds += cpu_s();
    for (int i = 0; i < p->n; i++)
        ret.cost += costs[i];
    return ret;
}

/* The same model and parameters for MINPACK, in double precision. */
struct one {
    const struct problems *p;
    const float *row;
};

static double lobe(const double *x, const float *light, double *j, int stride) {
    const double s = sqrt(x[0] * x[0] + x[1] * x[1] + x[2] * x[2]) + 1e-20;
    const double log_n = CLAMP(x[3], log(LOBES_MIN_EXPONENT), log(LOBES_MAX_EXPONENT));
    const double n = exp(log_n), c = (x[0] * light[0] + x[1] * light[1] + x[2] * light[2]) / s;
    if (c <= 1e-4) {
        for (int i = 0; j && i < 4; i++)
            j[i * stride] = 0;
        return 0;
    }
    const double slope = pow(c, n - 1), power = slope * c;
    for (int i = 0; j && i < 3; i++)
        j[i * stride] = power * (1 - n) * x[i] / s + n * slope * light[i];
    if (j)
        j[3 * stride] = x[3] == log_n ? s * power * n * log(c) : 0;
    return s * power;
}

static int residuals(void *data, int m, int n, const double *x, double *f, double *j, int stride,
                     int wanted) {
    const struct one *one = data;
    for (int i = 0; i < m; i++) {
        double value = 0;
        for (int k = 0; k < LOBES; k++)
            value += lobe(x + 4 * k, one->p->lights + 3 * i,
                          wanted == 2 ? j + i + (gsize)(4 * k) * (gsize)stride : NULL, stride);
        if (wanted == 1)
            f[i] = value - one->row[i];
    }
    return 0;
}

static struct solver solve_minpack(const struct problems *p) {
    const int m = p->fit.n_lights;
    g_autofree double *f = g_new(double, m), *j = g_new(double, m *PARAMETERS);
    double x[PARAMETERS], qtf[PARAMETERS], diag[PARAMETERS], w[3][PARAMETERS];
    g_autofree double *w4 = g_new(double, m);
    int pivots[PARAMETERS], calls, jacobians;
    struct solver ret = {-cpu_s()};
    for (int i = 0; i < p->n; i++) {
        struct one one = {p, p->rows + (gsize)i * (gsize)m};
        for (int k = 0; k < PARAMETERS; k++)
            x[k] = p->starts[(gsize)i * PARAMETERS + (gsize)k];
        if (m >= PARAMETERS)
            lmder(residuals, &one, m, PARAMETERS, x, f, j, m, TOLERANCE, 1e-7, 0, MAX_CALLS, diag,
                  1, 100, 0, &calls, &jacobians, pivots, qtf, w[0], w[1], w[2], w4);
        for (int k = 0; k < m; k++)
            ret.cost += f[k] * f[k];
    }
    ret.seconds += cpu_s();
    return ret;
}

static gboolean write_problems(const struct problems *p, const char *path) {
    const gint32 head[2] = {p->n, p->fit.n_lights};
    const gsize m = (gsize)p->fit.n_lights, n = (gsize)p->n;
    FILE *file = fopen(path, "wb");
    const gboolean ok = file && fwrite(head, sizeof head, 1, file) == 1 &&
                        fwrite(p->lights, sizeof(float) * 3, m, file) == m &&
                        fwrite(p->rows, sizeof(float) * m, n, file) == n &&
                        fwrite(p->starts, sizeof(float) * PARAMETERS, n, file) == n;
    return file && fclose(file) == 0 && ok;
}

/* The peer is given a few of the problems: it takes milliseconds for each. 0 where there is none.
 */
static struct solver solve_scipy(const struct problems *p) {
    g_autofree char *path = g_build_filename(g_get_tmp_dir(), "bench-fields-XXXXXX", NULL);
    g_autofree char *out = NULL;
    const char *const command[] = {"/usr/bin/python3",
                                   SOURCE_DIR "/tests/bench/peers/fields_scipy.py", path, NULL};
    struct solver ret = {0};
    const int handle = g_mkstemp(path);
    if (handle < 0 || !g_close(handle, NULL) || !write_problems(p, path))
        return ret;
    g_spawn_sync(NULL, (char **)(gconstpointer)command, NULL, G_SPAWN_DEFAULT, NULL, NULL, &out,
                 NULL, NULL, NULL);
    if (!out || sscanf(out, "{\"peer\": \"scipy\", \"seconds\": %lf, \"cost\": %lf}", &ret.seconds,
                       &ret.cost) != 2)
        ret = (struct solver){0};
    remove(path);
    return ret;
}

/* Lobes that are not finite somewhere on a card that computes in halves: every step is rounded. */
static float to_half(float value) {
    if (fabsf(value) > 65519)
        return INFINITY;
    const float step = ldexpf(1, MAX(ilogbf(value), -14) - 10);
    return value == 0 ? 0 : rintf(value / step) * step;
}

static gint64 count_overflows(const struct lobes *lobes) {
    gint64 count = 0;
    const gint64 n = (gint64)lobes->n_slices * btf_layout_texels(&lobes->layout);
    for (gint64 i = 0; i < n * lobes->n_lobes; i++) {
        const float *p =
            lobes->values + i / lobes->n_lobes * lobes->n_values + 3 + i % lobes->n_lobes * 4;
        const float size = sqrtf(p[0] * p[0] + p[1] * p[1] + p[2] * p[2]);
        const float log = to_half(log2f(MAX(to_half(size), 6e-8F)));
        count += !(to_half(exp2f(to_half(p[3] * log))) < 65504) || !(to_half(size) < 65504);
    }
    return count;
}

static struct lobes *fit_model(const struct btf_matrix *btf, enum lobes_model model,
                               double *ret_seconds) {
    const struct lobes_options options = {.model = model};
    const double start = bench_now_s();
    struct lobes *lobes = lobes_compute(btf, &options, NULL);
    *ret_seconds = bench_now_s() - start;
    return lobes;
}

static void print_models(const struct btf_matrix *btf) {
    const enum lobes_model models[] = {LOBES_FIELDS, LOBES_PTM, LOBES_LAFORTUNE, LOBES_WARD,
                                       LOBES_ASHIKHMIN};
    double errors[5], seconds;
    gint64 overflows = 0;
    for (gsize i = 0; i < 5; i++) {
        struct lobes *lobes = fit_model(btf, models[i], &seconds);
        errors[i] = lobes->luminance_error;
        overflows += lobes->model == LOBES_FIELDS ? count_overflows(lobes) : 0;
        bench_row(lobes_model_name(models[i]),
                  "%.5f{luminance_error} %.5f{error} %" G_GINT64_FORMAT "{bytes} %.2f{seconds}",
                  lobes->luminance_error, lobes->error, lobes_bytes(lobes), seconds);
        lobes_free(lobes);
    }
    bench_put("%.3f{ratio_fields} %.3f{ratio_ptm} %" G_GINT64_FORMAT "{half_overflows}",
              errors[0] / errors[2], errors[1] / errors[2], overflows);
}

static void print_solvers(const struct problems *p) {
    struct problems few = *p;
    few.n = MIN(p->n, 400);
    const struct solver batch = solve_batch(p), minpack = solve_minpack(p);
    const struct solver batch_few = solve_batch(&few), scipy = solve_scipy(&few);
    bench_put("%d{fits} %.2f{batch_us} %.6g{batch_cost} %.2f{cminpack_us} %.6g{cminpack_cost} "
              "%.1f{faster_than_cminpack}",
              p->n, 1e6 * batch.seconds / p->n, batch.cost, 1e6 * minpack.seconds / p->n,
              minpack.cost, minpack.seconds / batch.seconds);
    bench_put("%d{few_fits} %.6g{few_cost} %.2f{scipy_us} %.6g{scipy_cost} %.0f{faster_than_scipy}",
              few.n, batch_few.cost, 1e6 * scipy.seconds / few.n, scipy.cost,
              scipy.seconds / batch_few.seconds);
}

int bench_fields(char *const *sessions, int fits) {
    bench_begin(NULL);
    bench_begin_list("materials");
    for (int i = 0; sessions[i]; i++) {
        g_autoptr(GError) error = NULL;
        struct problems problems = {0};
        struct btf_matrix *btf = btf_matrix_read(sessions[i], NULL, &error);
        bench_check(error);
        take_problems(&problems, btf, fits);
        bench_begin(NULL);
        bench_put("%s{name} %zu{texels} %zu{views} %zu{lights}", btf->name,
                  btf_layout_texels(&btf->layout), btf->layout.views.n, btf->layout.lights.n);
        print_solvers(&problems);
        print_models(btf);
        bench_end();
        btf_matrix_free(problems.btf);
        g_free(problems.lights);
        g_free(problems.rows);
        g_free(problems.starts);
    }
    bench_end();
    bench_end();
    return 0;
}
