/*
 * Pairs of directions that were not captured, predicted (prediction/prediction.h), against the
 * simulated world: sessions with all pairs, captured by tests/bench/fast_materials --only lamps,
 * are masked to a part of their shots, and what is missing is made up in several ways:
 *
 *   start        the shots of prediction_start(), predicted (1/16 and 1/4 alone)
 *   chosen       a sixteenth of the shots as in start, then twice as many by prediction_choose(),
 *                from what is measured so far, and so on; predicted
 *   interpolated every so manieth light of each turntable angle; ρ / cos θ_l of a view interpolated
 *                between its lights by distance in the disc of directions (inverse squares of the
 *                four nearest)
 *   low rank     the shots of start; the matrix of (texel, colour, view) × light, of ρ / cos θ_l,
 * is completed by one of rank RANK (alternating least squares; the ridge grows with the number of
 * values: Zhou et al. 2008)
 *
 * error: ‖values − truth‖ / ‖truth‖ over all texels, views, lights and colours, those captured
 * included; full: of the session with all pairs. left_out: of predicted values against those that
 * the session measured. within: share of predicted values that lie within 2 σ of those. The truth
 * is kept beside the session (truth_N.bin), since tracing it takes minutes: remove it when the
 * world changes.
 */
#include "bench.h"

#include <math.h>
#include <string.h>

#include "base/work.h"
#include "btf/btf_matrix.h"
#include "exr/exr.h"
#include "prediction/prediction.h"
#include "session/session.h"
#include "world/truth.h"

#define PROBES  150 /* texels that the constants are fitted to */
#define RANK    6
#define ALS     12   /* rounds of the completion */
#define RIDGE   0.02 /* of the mean squares, a value */
#define NEAREST 4

enum { START, CHOSEN, INTERPOLATED, LOW_RANK, WAYS };
static const char *const ways[WAYS] = {"start", "chosen", "interpolated", "low_rank"};
static const int parts[] = {16, 8, 4, 2};

static gboolean json;
static char *only;
static int truth_samples = 3, every = 1;
static const GOptionEntry entries[] = {
    {"truth", 0, 0, G_OPTION_ARG_INT, &truth_samples,
     "Trace the truth with N × N rays a texel; default 3", "N"},
    {"every", 0, 0, G_OPTION_ARG_INT, &every, "Measure every so manieth texel; default 1", "N"},
    {"only", 0, 0, G_OPTION_ARG_STRING, &only, "Measure this way alone (see above)", "WAY"},
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print one JSON object", NULL},
    {NULL},
};

struct scene {
    struct btf_matrix *btf;
    GPtrArray *views, *all_shots;
    int n_views, n_lights, n_pairs, n_texels, n_shots;
    struct vec3 *view, *light, *view_mm, *light_mm, *at_mm; /* at_mm: of each texel */
    struct prediction_pairs pairs;
    struct prediction_shot *shots;
    int *groups, *source, *angle; /* of pairs: the shot; of shots: light, and number of the angle */
    int *shot_pairs;
    float *truth; /* as the values of btf */
    World *world;
};

struct result {
    double error, left_out, within, expected, seconds;
};

static struct vec3 prediction_bench_unit(double theta_deg, double phi_deg) {
    const double t = theta_deg * G_PI / 180, p = phi_deg * G_PI / 180;
    return vec3(sin(t) * cos(p), sin(t) * sin(p), cos(t));
}

static void prediction_bench_places(struct scene *scene, const char *session) {
    g_autoptr(GError) error = NULL;
    for (int v = 0; v < scene->n_views; v++) {
        g_autofree char *path = g_strdup_printf("%s/products/btf/view_%04d.exr", session, v);
        struct exr_file *file = exr_read_headers(path, &error);
        bench_check(error);
        for (int l = 0; l < scene->n_lights; l++) {
            const struct exr_part *part = g_ptr_array_index(file->parts, (guint)l);
            double at[3] = {0};
            exr_get_v3d(part, "view.centre_mm", at, &error);
            scene->view_mm[v] = vec3(at[0], at[1], at[2]);
            exr_get_v3d(part, "light.position_mm", at, &error);
            scene->light_mm[l] = vec3(at[0], at[1], at[2]);
            bench_check(error);
        }
        exr_file_free(file);
    }
}

static void prediction_bench_shots(struct scene *scene) {
    scene->shots = g_new0(struct prediction_shot, scene->all_shots->len);
    scene->shot_pairs = g_new(int, scene->n_pairs);
    scene->groups = g_new(int, scene->n_pairs);
    scene->source = g_new(int, scene->all_shots->len);
    scene->angle = g_new(int, scene->all_shots->len);
    g_autoptr(GArray) angles = g_array_new(FALSE, FALSE, sizeof(double));
    int used = 0;
    for (guint i = 0; i < scene->all_shots->len; i++) {
        const struct session_shot *shot = scene->all_shots->pdata[i];
        guint a = 0;
        if (shot->kind != SHOT_LAMP)
            continue;
        while (a < angles->len &&
               fabs(g_array_index(angles, double, a) - shot->turntable_deg) > 1e-6)
            a++;
        if (a == angles->len)
            g_array_append_val(angles, shot->turntable_deg);
        struct prediction_shot *to = &scene->shots[scene->n_shots];
        *to = (struct prediction_shot){scene->shot_pairs + used, 0, 1};
        for (int v = 0; v < scene->n_views; v++) {
            const struct session_direction *view = scene->views->pdata[v];
            if ((shot->cameras >> view->device & 1) == 0 ||
                fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
                continue;
            if (used == scene->n_pairs)
                bench_fail(1, "the session takes a pair twice");
            scene->shot_pairs[used] = v * scene->n_lights + shot->source;
            scene->groups[scene->shot_pairs[used++]] = scene->n_shots;
            to->n_pairs++;
        }
        scene->source[scene->n_shots] = shot->source;
        scene->angle[scene->n_shots++] = (int)a;
    }
    if (used != scene->n_pairs)
        bench_fail(1, "the session has %d of %d pairs", used, scene->n_pairs);
}

static void prediction_bench_trace_view(int v, gpointer data) {
    struct scene *scene = data;
    const struct btf_layout *layout = &scene->btf->layout;
    const struct truth_grid grid = {
        (int)layout->width, (int)layout->height, (double)layout->width * layout->texel_mm,
        (double)layout->height * layout->texel_mm, layout->reference_mm};
    const struct session_direction *view = scene->views->pdata[v];
    const gsize n = (gsize)scene->n_texels;
    g_autofree float *rgb = g_new(float, 3 * n);
    for (guint i = 0; i < scene->all_shots->len; i++) {
        const struct session_shot *shot = scene->all_shots->pdata[i];
        if (shot->kind != SHOT_LAMP || !(shot->cameras >> view->device & 1) ||
            fabs(shot->turntable_deg - view->turntable_deg) > 1e-6)
            continue;
        truth_btf(scene->world, view->device, shot->device, shot->turntable_deg, shot->arc_deg,
                  &grid, truth_samples, rgb);
        for (gsize t = 0; t < n; t++)
            memcpy(scene->truth +
                       3 * ((t * (gsize)scene->n_views + (gsize)v) * (gsize)scene->n_lights +
                            (gsize)shot->source),
                   rgb + 3 * t, 3 * sizeof(float));
    }
}

static void prediction_bench_truth(struct scene *scene, const char *session) {
    g_autoptr(GError) error = NULL;
    g_autofree char *folder = g_path_get_dirname(session);
    g_autofree char *name = g_strdup_printf("truth_%d.bin", truth_samples);
    g_autofree char *kept = g_build_filename(folder, name, NULL);
    g_autofree char *conf = g_build_filename(folder, "world.conf", NULL);
    const gsize bytes = 3 * sizeof(float) * (gsize)scene->n_texels * (gsize)scene->n_pairs;
    char *read = NULL;
    gsize length = 0;
    if (g_file_get_contents(kept, &read, &length, NULL) && length == bytes) {
        scene->truth = (float *)(void *)read;
        return;
    }
    g_free(read);
    scene->truth = g_malloc0(bytes);
    scene->world = world_get(conf, &error);
    bench_check(error);
    work_for_each(0, scene->n_views, prediction_bench_trace_view, scene);
    world_unref(scene->world);
    g_file_set_contents(kept, (const char *)scene->truth, (gssize)bytes, &error);
    bench_check(error);
}

static void prediction_bench_open(struct scene *scene, const char *path) {
    g_autoptr(GError) error = NULL;
    scene->btf = btf_matrix_read(path, NULL, &error);
    bench_check(error);
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    bench_check(error);
    scene->all_shots = session_shots(session, &error);
    bench_check(error);
    scene->views = session_views(session, &error);
    bench_check(error);
    const struct btf_layout *layout = &scene->btf->layout;
    scene->n_views = (int)layout->views.n;
    scene->n_lights = (int)layout->lights.n;
    scene->n_pairs = scene->n_views * scene->n_lights;
    scene->n_texels = (int)btf_layout_texels(layout);
    scene->view = g_new(struct vec3, scene->n_views);
    scene->light = g_new(struct vec3, scene->n_lights);
    scene->view_mm = g_new(struct vec3, scene->n_views);
    scene->light_mm = g_new(struct vec3, scene->n_lights);
    scene->at_mm = g_new(struct vec3, scene->n_texels);
    for (int v = 0; v < scene->n_views; v++)
        scene->view[v] = prediction_bench_unit((double)layout->views.theta_deg[v],
                                               (double)layout->views.phi_deg[v]);
    for (int l = 0; l < scene->n_lights; l++)
        scene->light[l] = prediction_bench_unit((double)layout->lights.theta_deg[l],
                                                (double)layout->lights.phi_deg[l]);
    for (int t = 0; t < scene->n_texels; t++)
        scene->at_mm[t] = vec3(
            ((double)(t % (int)layout->width) + 0.5 - (double)layout->width / 2) * layout->texel_mm,
            ((double)layout->height / 2 - (double)(t / (int)layout->width) - 0.5) *
                layout->texel_mm,
            layout->reference_mm);
    prediction_bench_places(scene, path);
    prediction_bench_shots(scene);
    prediction_bench_truth(scene, path);
    scene->pairs =
        (struct prediction_pairs){scene->n_views, scene->n_lights, scene->view,  scene->light,
                                  scene->view_mm, scene->light_mm, scene->groups};
}

static void prediction_bench_close(struct scene *scene) {
    btf_matrix_free(scene->btf);
    g_ptr_array_unref(scene->views);
    g_ptr_array_unref(scene->all_shots);
    gpointer all[] = {scene->view,  scene->light, scene->view_mm,   scene->light_mm,
                      scene->at_mm, scene->shots, scene->groups,    scene->source,
                      scene->angle, scene->truth, scene->shot_pairs};
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        g_free(all[i]);
}

/* Values of a texel, colour by colour: 3 × n_pairs, those missing NaN. */
static void prediction_bench_texel(const struct scene *scene, int texel, const gboolean *taken,
                                   float *ret) {
    const float *from = scene->btf->values + 3 * (gsize)texel * (gsize)scene->n_pairs;
    for (int p = 0; p < scene->n_pairs; p++)
        for (int c = 0; c < 3; c++)
            ret[c * scene->n_pairs + p] = taken[scene->groups[p]] ? from[3 * p + c] : NAN;
}

static Prediction *prediction_bench_learn(const struct scene *scene, const gboolean *taken) {
    g_autoptr(GError) error = NULL;
    const int n = MIN(PROBES, scene->n_texels);
    g_autofree float *probes = g_new(float, 3 * (gsize)n * (gsize)scene->n_pairs);
    g_autofree struct vec3 *at_mm = g_new(struct vec3, n);
    for (int i = 0; i < n; i++) {
        const int texel = (int)((gint64)i * scene->n_texels / n);
        at_mm[i] = scene->at_mm[texel];
        prediction_bench_texel(scene, texel, taken, probes + 3 * (gsize)i * (gsize)scene->n_pairs);
    }
    Prediction *prediction = prediction_new(&scene->pairs, probes, at_mm, n, NULL, &error);
    bench_check(error);
    return prediction;
}

/* Marks the first n shots of the start set. */
static void prediction_bench_start(const struct scene *scene, int n, gboolean *taken) {
    g_autoptr(GError) error = NULL;
    g_autofree int *order = g_new(int, n);
    memset(taken, 0, sizeof(gboolean) * (gsize)scene->n_shots);
    prediction_start(&scene->pairs, scene->shots, scene->n_shots, n, order, NULL, &error);
    bench_check(error);
    for (int k = 0; k < n; k++)
        taken[order[k]] = TRUE;
}

/* Adds n shots. */
static void prediction_bench_choose(const struct scene *scene, int n, gboolean *taken) {
    g_autoptr(GError) error = NULL;
    g_autofree struct prediction_choice *choices = g_new(struct prediction_choice, n);
    g_autoptr(Prediction) prediction = prediction_bench_learn(scene, taken);
    const int got = prediction_choose(prediction, scene->shots, scene->n_shots, taken, n, choices,
                                      NULL, &error);
    bench_check(error);
    for (int k = 0; k < got; k++)
        taken[choices[k].shot] = TRUE;
}

/* Every part-th light of each angle, another first one at each. */
static void prediction_bench_regular(const struct scene *scene, int part, gboolean *taken) {
    for (int s = 0; s < scene->n_shots; s++)
        taken[s] = (scene->source[s] + 7 * scene->angle[s]) % part == 0;
}

static void prediction_bench_interpolate(const struct scene *scene, const gboolean *taken,
                                         float *values) {
    for (int v = 0; v < scene->n_views; v++)
        for (int l = 0; l < scene->n_lights; l++) {
            const int pair = v * scene->n_lights + l;
            double nearest[NEAREST], sum = 0, all[3] = {0};
            int of[NEAREST], n = 0;
            if (taken[scene->groups[pair]])
                continue;
            for (int k = 0; k < scene->n_lights; k++) {
                const double d = hypot(scene->light[k].x - scene->light[l].x,
                                       scene->light[k].y - scene->light[l].y);
                int at = n;
                if (!taken[scene->groups[v * scene->n_lights + k]])
                    continue;
                while (at > 0 && nearest[at - 1] > d)
                    at--;
                if (at == NEAREST)
                    continue;
                for (int i = MIN(n, NEAREST - 1); i > at; i--) {
                    nearest[i] = nearest[i - 1];
                    of[i] = of[i - 1];
                }
                nearest[at] = d;
                of[at] = k;
                n = MIN(n + 1, NEAREST);
            }
            for (int i = 0; i < n; i++) {
                const double w = 1 / (nearest[i] * nearest[i] + 1e-9);
                sum += w;
                for (int c = 0; c < 3; c++)
                    all[c] += w * (double)values[c * scene->n_pairs + v * scene->n_lights + of[i]] /
                              scene->light[of[i]].z;
            }
            for (int c = 0; c < 3; c++)
                values[c * scene->n_pairs + pair] =
                    (float)(n > 0 ? all[c] / sum * scene->light[l].z : 0);
        }
}

/* Solves the normal equations a x = b of RANK unknowns (Cholesky); a and b are overwritten. */
static void prediction_bench_solve(double a[RANK][RANK], double *b) {
    for (int i = 0; i < RANK; i++) {
        for (int j = 0; j <= i; j++) {
            for (int k = 0; k < j; k++)
                a[i][j] -= a[i][k] * a[j][k];
            a[i][j] = i == j ? sqrt(fmax(a[i][i], 1e-30)) : a[i][j] / a[j][j];
        }
        for (int k = 0; k < i; k++)
            b[i] -= a[i][k] * b[k];
        b[i] /= a[i][i];
    }
    for (int i = RANK - 1; i >= 0; i--) {
        for (int k = i + 1; k < RANK; k++)
            b[i] -= a[k][i] * b[k];
        b[i] /= a[i][i];
    }
}

/* Lights' factors (n_lights × RANK) of the matrix of all rows. */
struct completion {
    const struct scene *scene;
    const gboolean *taken;
    double *lights;
};

/* Factors of a row of ρ / cos θ_l less its mean, which is returned. */
static double prediction_bench_row(const struct completion *job, const float *row, int view,
                                   double *ret) {
    double a[RANK][RANK] = {{0}}, mean = 0;
    int known = 0;
    memset(ret, 0, sizeof(double) * RANK);
    for (int l = 0; l < job->scene->n_lights; l++)
        if (job->taken[job->scene->groups[view * job->scene->n_lights + l]]) {
            known++;
            mean += (double)row[l] / job->scene->light[l].z;
        }
    mean /= MAX(known, 1);
    for (int i = 0; i < RANK; i++)
        a[i][i] = RIDGE * MAX(known, 1);
    for (int l = 0; l < job->scene->n_lights; l++) {
        const double *f = job->lights + RANK * l;
        if (!job->taken[job->scene->groups[view * job->scene->n_lights + l]])
            continue;
        for (int i = 0; i < RANK; i++) {
            ret[i] += f[i] * ((double)row[l] / job->scene->light[l].z - mean);
            for (int j = 0; j <= i; j++)
                a[i][j] += f[i] * f[j];
        }
    }
    prediction_bench_solve(a, ret);
    return mean;
}

static void prediction_bench_als(struct completion *job) {
    const struct scene *scene = job->scene;
    const int n_lights = scene->n_lights, n = MIN(PROBES, scene->n_texels);
    g_autoptr(GRand) draw = g_rand_new_with_seed(1);
    g_autofree float *values = g_new(float, 3 * scene->n_pairs);
    g_autofree double *a = g_new(double, n_lights *RANK *RANK), *b = g_new(double, n_lights *RANK);
    g_autofree double *of_light = g_new(double, n_lights);
    job->lights = g_new(double, n_lights *RANK);
    for (int l = 0; l < n_lights; l++)
        for (int k = 0; k < RANK; k++)
            job->lights[l * RANK + k] = k == 0 ? 1 : 0.3 * (g_rand_double(draw) - 0.5);
    for (int round = 0; round < ALS; round++) {
        double squares = 0;
        gint64 count = 0;
        memset(of_light, 0, sizeof(double) * (gsize)n_lights);
        memset(a, 0, sizeof(double) * (gsize)(n_lights * RANK * RANK));
        memset(b, 0, sizeof(double) * (gsize)(n_lights * RANK));
        for (int i = 0; i < n; i++) {
            prediction_bench_texel(scene, (int)((gint64)i * scene->n_texels / n), job->taken,
                                   values);
            for (int row = 0; row < 3 * scene->n_views; row++) {
                double x[RANK];
                const float *at = values + (gsize)row * (gsize)n_lights;
                const int view = row % scene->n_views;
                const double mean = prediction_bench_row(job, at, view, x);
                for (int l = 0; l < n_lights; l++) {
                    if (!job->taken[scene->groups[view * n_lights + l]])
                        continue;
                    const double value = (double)at[l] / scene->light[l].z - mean;
                    squares += value * value;
                    count++;
                    of_light[l]++;
                    for (int p = 0; p < RANK; p++) {
                        b[l * RANK + p] += x[p] * value;
                        for (int q = 0; q < RANK; q++)
                            a[(l * RANK + p) * RANK + q] += x[p] * x[q];
                    }
                }
            }
        }
        const double square = squares / (double)MAX(count, 1);
        for (int l = 0; l < n_lights; l++) {
            double m[RANK][RANK];
            memcpy(m, a + l * RANK * RANK, sizeof m);
            for (int p = 0; p < RANK; p++)
                m[p][p] += RIDGE * square * of_light[l] + 1e-12;
            memcpy(job->lights + l * RANK, b + l * RANK, sizeof(double) * RANK);
            prediction_bench_solve(m, job->lights + l * RANK);
        }
    }
}

static void prediction_bench_complete(const struct completion *job, float *values) {
    const struct scene *scene = job->scene;
    for (int row = 0; row < 3 * scene->n_views; row++) {
        float *at = values + (gsize)row * (gsize)scene->n_lights;
        double x[RANK];
        const double mean = prediction_bench_row(job, at, row % scene->n_views, x);
        for (int l = 0; l < scene->n_lights; l++) {
            double sum = mean;
            if (job->taken[scene->groups[row % scene->n_views * scene->n_lights + l]])
                continue;
            for (int k = 0; k < RANK; k++)
                sum += x[k] * job->lights[l * RANK + k];
            at[l] = (float)fmax(sum * scene->light[l].z, 0);
        }
    }
}

struct sums {
    double squares, norm, off, measured;
    gint64 within, predicted;
};

struct measuring {
    const struct scene *scene;
    const gboolean *taken;
    int way;
    const Prediction *prediction;
    const struct completion *completion;
    struct sums *sums; /* of each texel */
};

static void prediction_bench_measure(int k, gpointer data) {
    const struct measuring *job = data;
    const struct scene *scene = job->scene;
    const int texel = k * every, n = scene->n_pairs;
    struct sums *sums = &job->sums[k];
    const gsize first = 3 * (gsize)texel * (gsize)n;
    const float *truth = scene->truth + first, *measured = scene->btf->values + first;
    g_autofree float *values = g_new(float, 3 * n), *sigma = g_new0(float, 3 * n);
    prediction_bench_texel(scene, texel, job->taken, values);
    if (job->prediction)
        prediction_fill(job->prediction, values, &scene->at_mm[texel], 1, sigma);
    else if (job->completion)
        prediction_bench_complete(job->completion, values);
    else
        prediction_bench_interpolate(scene, job->taken, values);
    for (int p = 0; p < n; p++)
        for (int c = 0; c < 3; c++) {
            const double value = (double)values[c * n + p], true_value = (double)truth[3 * p + c];
            const double known = (double)measured[3 * p + c];
            sums->squares += (value - true_value) * (value - true_value);
            sums->norm += true_value * true_value;
            if (job->taken[scene->groups[p]])
                continue;
            sums->off += (value - known) * (value - known);
            sums->measured += known * known;
            sums->within += fabs(value - known) <= 2 * (double)sigma[c * n + p];
            sums->predicted++;
        }
}

static struct result prediction_bench_error(const struct scene *scene, int way,
                                            const gboolean *taken) {
    const double begun = bench_cpu_s();
    const int n = (scene->n_texels + every - 1) / every;
    struct result result = {.expected = NAN};
    struct completion completion = {scene, taken, NULL};
    g_autoptr(Prediction) prediction = way <= CHOSEN ? prediction_bench_learn(scene, taken) : NULL;
    if (way == LOW_RANK)
        prediction_bench_als(&completion);
    g_autofree struct sums *sums = g_new0(struct sums, n);
    struct measuring job = {scene, taken, way, prediction, way == LOW_RANK ? &completion : NULL,
                            sums};
    struct sums all = {0};
    work_for_each(0, n, prediction_bench_measure, &job);
    for (int i = 0; i < n; i++) {
        all.squares += sums[i].squares;
        all.norm += sums[i].norm;
        all.off += sums[i].off;
        all.measured += sums[i].measured;
        all.within += sums[i].within;
        all.predicted += sums[i].predicted;
    }
    g_free(completion.lights);
    result.error = sqrt(all.squares / all.norm);
    result.left_out = sqrt(all.off / fmax(all.measured, 1e-30));
    result.within = prediction ? (double)all.within / (double)MAX(all.predicted, 1) : NAN;
    if (prediction)
        result.expected = prediction_error(prediction);
    result.seconds = bench_cpu_s() - begun;
    return result;
}

static void prediction_bench_tell(const char *name, int part, int way, const struct result *result,
                                  double full) {
    if (!json)
        g_print("%-10s 1/%-2d %-12s error %.4f (%.3f of full), left out %.4f, expected %.4f, "
                "within 2 σ %.3f; %.1f s CPU\n",
                name, part, ways[way], result->error, result->error / full, result->left_out,
                result->expected, result->within, result->seconds);
    else
        g_print(",\n    \"%s_%d\": {\"error\": %.4f, \"ratio\": %.3f, \"left_out\": %.4f",
                ways[way], part, result->error, result->error / full, result->left_out);
    if (json && way <= CHOSEN)
        g_print(", \"expected\": %.4f, \"within\": %.3f", result->expected, result->within);
    if (json)
        g_print("}");
}

static void prediction_bench_material(struct scene *scene, const char *name, gboolean first) {
    g_autofree gboolean *taken = g_new(gboolean, scene->n_shots);
    g_autofree gboolean *chosen = g_new(gboolean, scene->n_shots);
    for (int s = 0; s < scene->n_shots; s++)
        taken[s] = TRUE;
    const struct result full = prediction_bench_error(scene, INTERPOLATED, taken);
    if (json)
        g_print("%s\n  \"%s\": {\"full\": {\"error\": %.4f}", first ? "{" : ",", name, full.error);
    else
        g_print("%-10s full: error %.4f\n", name, full.error);
    prediction_bench_start(scene, scene->n_shots / parts[0], chosen);
    for (gsize k = 0; k < G_N_ELEMENTS(parts); k++) {
        const int n = scene->n_shots / parts[k];
        if (k > 0 && (!only || strcmp(only, ways[CHOSEN]) == 0))
            prediction_bench_choose(scene, n - scene->n_shots / parts[k - 1], chosen);
        for (int way = 0; way < WAYS; way++) {
            if ((way == START && (parts[k] == 8 || parts[k] == 2)) || (way == CHOSEN && k == 0) ||
                (only && strcmp(only, ways[way]) != 0))
                continue;
            if (way == INTERPOLATED)
                prediction_bench_regular(scene, parts[k], taken);
            else
                prediction_bench_start(scene, n, taken);
            const struct result result =
                prediction_bench_error(scene, way, way == CHOSEN ? chosen : taken);
            prediction_bench_tell(name, parts[k], way, &result, full.error);
        }
    }
    if (json)
        g_print("}");
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, entries, "DIR/NAME/lamps.session …");
    if (argc < 2 || every < 1 || truth_samples < 1)
        bench_fail(2, "give sessions that fast_materials --only lamps has captured");
    for (int i = 1; i < argc; i++) {
        struct scene scene = {0};
        g_autofree char *folder = g_path_get_dirname(argv[i]);
        g_autofree char *name = g_path_get_basename(folder);
        prediction_bench_open(&scene, argv[i]);
        prediction_bench_material(&scene, name, i == 1);
        prediction_bench_close(&scene);
    }
    if (json)
        g_print("\n}\n");
    return 0;
}
