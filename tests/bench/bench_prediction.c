/*
 * Compares the prediction of pairs of directions that were not captured (prediction/prediction.h)
 * with the simulated world. Sessions with all pairs, captured by tests/bench/fast_materials --only
 * lamps, are reduced to a part of their shots, and the missing pairs are predicted in several ways:
 *
 *   start        the shots chosen when nothing is measured, predicted (1/16 and 1/4 only)
 *   chosen       a sixteenth of the shots as in start, then twice as many by prediction_choose(),
 *                from what is measured so far, and so on; predicted
 *   interpolated every so manieth light of each turntable angle; between them
 *   low_rank     the shots of start; completed by a matrix of low rank (prediction_published.c has
 *                both)
 *   slices       slices of the azimuths and radial functions between them (prediction_slices.c);
 *                from an eighth
 *
 * error: ‖values − truth‖ / ‖truth‖ over all texels, views, lights and colours, those captured
 * included; full: of the session with all pairs. left_out: of predicted values against those that
 * the session measured. within: share of predicted values that lie within 2 σ of those. The truth
 * is kept next to the session (truth_N.bin), since tracing it takes minutes: remove it when the
 * world changes.
 *
 * --beside OTHER: instead, the products of another session of the same folder and directions, as
 * they are (of an adaptive capture, one with motion = continuous and so on), and how long its
 * capture took by the rig's own clock.
 *
 * pictures: mean ΔE2000 of twelve pictures of the whole sample against those of the truth, drawn
 * from the full capture, from a quarter chosen, and from half of that (prediction_pictures.c).
 */
#include "bench.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/work.h"
#include "btf/btf_matrix.h"
#include "exr/exr.h"
#include "lib/direction.h"
#include "prediction_parts.h"
#include "session/session.h"
#include "world/truth.h"

enum { START, CHOSEN, INTERPOLATED, LOW_RANK, SLICES, WAYS };
static const char *const ways[WAYS] = {"start", "chosen", "interpolated", "low_rank", "slices"};

static char *only, *write_pictures, *parts_list;
static char **besides;
static int truth_samples = 3, every = 1;
static const GOptionEntry entries[] = {
    {"truth", 0, 0, G_OPTION_ARG_INT, &truth_samples,
     "Trace the truth with N × N rays a texel; default 3", "N"},
    {"every", 0, 0, G_OPTION_ARG_INT, &every,
     "Measure every so manieth texel (without a factor in common with the width); default 1", "N"},
    {"only", 0, 0, G_OPTION_ARG_STRING, &only, "Measure this way alone (see above)", "WAY"},
    {"write", 0, 0, G_OPTION_ARG_FILENAME, &write_pictures,
     "Write the pictures of a quarter there, as NAME.png: the truth, the full capture, the quarter",
     "FOLDER"},
    {"beside", 0, 0, G_OPTION_ARG_STRING_ARRAY, &besides,
     "Measure another session beside it, by its name without .session; may be given several times",
     "NAME"},
    {"parts", 0, 0, G_OPTION_ARG_STRING, &parts_list,
     "Take one of so many shots; the first is the start set of the chosen ones; default 16;8;4;2",
     "N;…"},
    {NULL},
};

struct result {
    double error, left_out, within, expected, seconds;
};

static void prediction_bench_places(struct prediction_scene *scene, const char *session) {
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

static void prediction_bench_shots(struct prediction_scene *scene) {
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
            if (!camera_set_has(shot->cameras, view->device) ||
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
    struct prediction_scene *scene = data;
    const struct btf_layout *layout = &scene->btf->layout;
    const struct truth_grid grid = {
        (int)layout->width, (int)layout->height, (double)layout->width * layout->texel_mm,
        (double)layout->height * layout->texel_mm, layout->reference_mm};
    const struct session_direction *view = scene->views->pdata[v];
    const gsize n = (gsize)scene->n_texels;
    g_autofree float *rgb = g_new(float, 3 * n);
    for (guint i = 0; i < scene->all_shots->len; i++) {
        const struct session_shot *shot = scene->all_shots->pdata[i];
        if (shot->kind != SHOT_LAMP || !camera_set_has(shot->cameras, view->device) ||
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

static void prediction_bench_truth(struct prediction_scene *scene, const char *session) {
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

static void prediction_bench_open(struct prediction_scene *scene, const char *path) {
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
        scene->view[v] =
            direction_of_deg((double)layout->views.theta_deg[v], (double)layout->views.phi_deg[v]);
    for (int l = 0; l < scene->n_lights; l++)
        scene->light[l] = direction_of_deg((double)layout->lights.theta_deg[l],
                                           (double)layout->lights.phi_deg[l]);
    for (int t = 0; t < scene->n_texels; t++) {
        const int column = t % (int)layout->width, row = t / (int)layout->width;
        scene->at_mm[t] =
            vec3((column + 0.5 - (double)layout->width / 2) * layout->texel_mm,
                 ((double)layout->height / 2 - row - 0.5) * layout->texel_mm, layout->reference_mm);
    }
    prediction_bench_places(scene, path);
    prediction_bench_shots(scene);
    prediction_bench_truth(scene, path);
    scene->pairs =
        (struct prediction_pairs){scene->n_views, scene->n_lights, scene->view,  scene->light,
                                  scene->view_mm, scene->light_mm, scene->groups};
}

static void prediction_bench_close(struct prediction_scene *scene) {
    btf_matrix_free(scene->btf);
    g_ptr_array_unref(scene->views);
    g_ptr_array_unref(scene->all_shots);
    gpointer all[] = {scene->view,  scene->light, scene->view_mm,   scene->light_mm,
                      scene->at_mm, scene->shots, scene->groups,    scene->source,
                      scene->angle, scene->truth, scene->shot_pairs};
    for (gsize i = 0; i < G_N_ELEMENTS(all); i++)
        g_free(all[i]);
}

int prediction_bench_probe(const struct prediction_scene *scene, int i) {
    return (int)((gint64)i * scene->n_texels / MIN(PREDICTION_PROBES, scene->n_texels));
}

void prediction_bench_texel(const struct prediction_scene *scene, int texel, const gboolean *taken,
                            float *ret) {
    const float *from = scene->btf->values + 3 * (gsize)texel * (gsize)scene->n_pairs;
    for (int p = 0; p < scene->n_pairs; p++)
        for (int c = 0; c < 3; c++)
            ret[c * scene->n_pairs + p] = taken[scene->groups[p]] ? from[3 * p + c] : NAN;
}

static Prediction *prediction_bench_learn(const struct prediction_scene *scene,
                                          const gboolean *taken) {
    g_autoptr(GError) error = NULL;
    const int n = MIN(PREDICTION_PROBES, scene->n_texels);
    g_autofree float *probes = g_new(float, 3 * (gsize)n * (gsize)scene->n_pairs);
    g_autofree struct vec3 *at_mm = g_new(struct vec3, n);
    for (int i = 0; i < n; i++) {
        const int texel = prediction_bench_probe(scene, i);
        at_mm[i] = scene->at_mm[texel];
        prediction_bench_texel(scene, texel, taken, probes + 3 * (gsize)i * (gsize)scene->n_pairs);
    }
    Prediction *prediction = prediction_new(&scene->pairs, probes, at_mm, n, NULL, &error);
    bench_check(error);
    return prediction;
}

/* Marks the first n shots of the start set. */
static void prediction_bench_start(const struct prediction_scene *scene, int n, gboolean *taken) {
    g_autoptr(GError) error = NULL;
    g_autofree struct prediction_choice *choices = g_new(struct prediction_choice, n);
    memset(taken, 0, sizeof(gboolean) * (gsize)scene->n_shots);
    g_autoptr(Prediction) nothing = prediction_new(&scene->pairs, NULL, NULL, 0, NULL, &error);
    bench_check(error);
    const int got =
        prediction_choose(nothing, scene->shots, scene->n_shots, NULL, n, choices, NULL, &error);
    bench_check(error);
    for (int k = 0; k < got; k++)
        taken[choices[k].shot] = TRUE;
}

/* Adds n shots. */
static void prediction_bench_choose(const struct prediction_scene *scene, int n, gboolean *taken) {
    g_autoptr(GError) error = NULL;
    g_autofree struct prediction_choice *choices = g_new(struct prediction_choice, n);
    g_autoptr(Prediction) prediction = prediction_bench_learn(scene, taken);
    const int got = prediction_choose(prediction, scene->shots, scene->n_shots, taken, n, choices,
                                      NULL, &error);
    bench_check(error);
    for (int k = 0; k < got; k++)
        taken[choices[k].shot] = TRUE;
}

struct sums {
    double squares, norm, off, measured;
    gint64 within, predicted;
};

/* What a way makes of the shots taken. */
struct maker {
    const struct prediction_scene *scene;
    const gboolean *taken;
    Prediction *prediction;                   /* NULL: one of the next, or interpolated */
    struct prediction_completion *completion; /* or NULL */
    struct prediction_radial *radial;         /* or NULL */
    const struct btf_matrix *other;           /* another session's BTF; or NULL */
};

struct measuring {
    const struct maker *maker;
    struct sums *sums; /* of each texel */
};

static void prediction_bench_make(const struct maker *maker, int texel, float *values,
                                  float *sigma) {
    const struct prediction_scene *scene = maker->scene;
    const float *other =
        maker->other ? maker->other->values + 3 * (gsize)texel * (gsize)scene->n_pairs : NULL;
    prediction_bench_texel(scene, texel, maker->taken, values);
    for (int i = 0; other && i < 3 * scene->n_pairs; i++)
        values[i % 3 * scene->n_pairs + i / 3] = other[i];
    if (other)
        return;
    if (maker->prediction)
        prediction_fill(maker->prediction, values, &scene->at_mm[texel], 1, sigma);
    else if (maker->completion)
        prediction_complete(maker->completion, values);
    else if (maker->radial)
        prediction_radial_fill(maker->radial, values);
    else
        prediction_interpolate(scene, maker->taken, values);
}

static void prediction_bench_make_values(int texel, float *ret_values, gpointer data) {
    prediction_bench_make(data, texel, ret_values, NULL);
}

static void prediction_bench_measure(int k, gpointer data) {
    const struct measuring *job = data;
    const struct prediction_scene *scene = job->maker->scene;
    const int texel = k * every, n = scene->n_pairs;
    struct sums *sums = &job->sums[k];
    const gsize first = 3 * (gsize)texel * (gsize)n;
    const float *truth = scene->truth + first, *measured = scene->btf->values + first;
    g_autofree float *values = g_new(float, 3 * n), *sigma = g_new0(float, 3 * n);
    prediction_bench_make(job->maker, texel, values, sigma);
    for (int p = 0; p < n; p++)
        for (int c = 0; c < 3; c++) {
            const double value = (double)values[c * n + p], true_value = (double)truth[3 * p + c];
            const double known = (double)measured[3 * p + c];
            sums->squares += (value - true_value) * (value - true_value);
            sums->norm += true_value * true_value;
            if (job->maker->taken[scene->groups[p]])
                continue;
            sums->off += (value - known) * (value - known);
            sums->measured += known * known;
            sums->within += fabs(value - known) <= 2 * (double)sigma[c * n + p];
            sums->predicted++;
        }
}

static struct maker prediction_bench_maker(const struct prediction_scene *scene, int way,
                                           const gboolean *taken) {
    struct maker maker = {scene, taken, NULL, NULL, NULL};
    if (way <= CHOSEN)
        maker.prediction = prediction_bench_learn(scene, taken);
    if (way == LOW_RANK) {
        maker.completion = g_new0(struct prediction_completion, 1);
        *maker.completion = (struct prediction_completion){scene, taken, NULL};
        prediction_complete_fit(maker.completion);
    }
    if (way == SLICES)
        maker.radial = prediction_radial_new(scene, taken);
    return maker;
}

static void prediction_bench_maker_clear(struct maker *maker) {
    if (maker->completion)
        g_free(maker->completion->lights);
    g_free(maker->completion);
    prediction_radial_free(maker->radial);
    prediction_free(maker->prediction);
}

static struct sums prediction_bench_sum(const struct maker *maker) {
    const int n = (maker->scene->n_texels + every - 1) / every;
    g_autofree struct sums *sums = g_new0(struct sums, n);
    struct measuring job = {maker, sums};
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
    return all;
}

static struct result prediction_bench_error(const struct prediction_scene *scene, int way,
                                            const gboolean *taken) {
    const double begun = bench_cpu_s();
    struct result result = {.expected = NAN};
    struct maker maker = prediction_bench_maker(scene, way, taken);
    const struct sums all = prediction_bench_sum(&maker);
    result.error = sqrt(all.squares / all.norm);
    result.left_out = sqrt(all.off / fmax(all.measured, 1e-30));
    result.within = maker.prediction ? (double)all.within / (double)MAX(all.predicted, 1) : NAN;
    if (maker.prediction)
        result.expected = prediction_error(maker.prediction);
    prediction_bench_maker_clear(&maker);
    result.seconds = bench_cpu_s() - begun;
    return result;
}

static void prediction_bench_pictures(const struct prediction_scene *scene, const char *name,
                                      int part, const gboolean *taken) {
    struct maker maker = prediction_bench_maker(scene, CHOSEN, taken);
    g_autofree char *file = g_strdup_printf("%s.png", name);
    g_autofree char *path =
        write_pictures && part == 4 ? g_build_filename(write_pictures, file, NULL) : NULL;
    const struct prediction_pictures found =
        prediction_pictures_compare(scene, prediction_bench_make_values, &maker, path);
    prediction_bench_maker_clear(&maker);
    g_autofree char *key = g_strdup_printf("pictures_%d", part);
    bench_row(key, "%.3f{full} %.3f{made} %.3f{ratio}", found.full, found.made,
              found.made / found.full);
}

static void prediction_bench_tell(int part, int way, const struct result *result, double full) {
    g_autofree char *key = g_strdup_printf("%s_%d", ways[way], part);
    bench_begin(key);
    bench_put("%.4f{error} %.3f{ratio} %.4f{left_out}", result->error, result->error / full,
              result->left_out);
    if (way <= CHOSEN)
        bench_put("%.4f{expected} %.3f{within}", result->expected, result->within);
    bench_put("%.1f{cpu_s}", result->seconds);
    bench_end();
}

static double prediction_bench_clock_s(const char *session) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) opened = session_open(session, SESSION_READ, &error);
    bench_check(error);
    g_autofree char *clock = session_value(opened, "clock_s");
    return clock ? g_ascii_strtod(clock, NULL) : NAN;
}

/* Another session's BTF against the same truth. */
static void prediction_bench_beside(const struct prediction_scene *scene, const char *session,
                                    const gboolean *all, double full) {
    g_autoptr(GError) error = NULL;
    g_autofree char *folder = g_path_get_dirname(session);
    for (char **name = besides; *name; name++) {
        g_autofree char *file = g_strconcat(*name, ".session", NULL);
        g_autofree char *path = g_build_filename(folder, file, NULL);
        struct btf_matrix *other = btf_matrix_read(path, NULL, &error);
        bench_check(error);
        if (other->layout.views.n != (gsize)scene->n_views ||
            other->layout.lights.n != (gsize)scene->n_lights ||
            btf_layout_texels(&other->layout) != (gsize)scene->n_texels)
            bench_fail(1, "%s has other texels or directions", path);
        struct maker maker = {.scene = scene, .taken = all, .other = other};
        const struct sums sums = prediction_bench_sum(&maker);
        const double found = sqrt(sums.squares / sums.norm);
        const struct prediction_pictures seen =
            prediction_pictures_compare(scene, prediction_bench_make_values, &maker, NULL);
        const double took_s = prediction_bench_clock_s(path),
                     full_s = prediction_bench_clock_s(session);
        btf_matrix_free(other);
        bench_row(*name,
                  "%.1f{seconds} %.1f{full_seconds} %.4f{error} %.3f{ratio} %.3f{full_delta_e} "
                  "%.3f{delta_e}",
                  took_s, full_s, found, found / full, seen.full, seen.made);
    }
}

/* Whether a way is measured at a part. */
static gboolean prediction_bench_has(int way, int part) {
    if (only && strcmp(only, ways[way]) != 0)
        return FALSE;
    switch (way) {
    case START:
        return part == 16 || part == 4;
    case CHOSEN:
    case SLICES:
        return part != 16;
    default:
        return TRUE;
    }
}

static int prediction_bench_part(const char *text) {
    const int part = text ? atoi(text) : 0;
    if (part < 1)
        bench_fail(2, "--parts: “%s” is not a number from 1", text ? text : "");
    return part;
}

static void prediction_bench_material(struct prediction_scene *scene, const char *session,
                                      const char *name, char *const *parts) {
    g_autofree gboolean *taken = g_new(gboolean, scene->n_shots);
    g_autofree gboolean *chosen = g_new(gboolean, scene->n_shots);
    g_autofree gboolean *sliced = g_new0(gboolean, scene->n_shots);
    int part = prediction_bench_part(parts[0]), before;
    for (int s = 0; s < scene->n_shots; s++)
        taken[s] = TRUE;
    const struct result full = prediction_bench_error(scene, INTERPOLATED, taken);
    bench_begin(name);
    bench_row("full", "%.4f{error}", full.error);
    if (besides)
        prediction_bench_beside(scene, session, taken, full.error);
    else
        prediction_bench_start(scene, scene->n_shots / part, chosen);
    for (int k = 0; parts[k] && !besides; k++) {
        before = part;
        part = prediction_bench_part(parts[k]);
        const int n = scene->n_shots / part;
        if (part < before && prediction_bench_has(CHOSEN, part))
            prediction_bench_choose(scene, n - scene->n_shots / before, chosen);
        for (int way = 0; way < WAYS; way++) {
            if (!prediction_bench_has(way, part))
                continue;
            if (way == INTERPOLATED)
                prediction_regular(scene, part, taken);
            else if (way == SLICES)
                prediction_slices_choose(scene, n, sliced);
            else
                prediction_bench_start(scene, n, taken);
            const struct result result = prediction_bench_error(scene, way,
                                                                way == CHOSEN   ? chosen
                                                                : way == SLICES ? sliced
                                                                                : taken);
            prediction_bench_tell(part, way, &result, full.error);
        }
        if (prediction_bench_has(CHOSEN, part) && part > 2)
            prediction_bench_pictures(scene, name, part, chosen);
    }
    bench_end();
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, entries, "DIR/NAME/lamps.session …");
    if (argc < 2 || every < 1 || truth_samples < 1)
        bench_fail(2, "give sessions that fast_materials --only lamps has captured");
    g_auto(GStrv) parts = g_strsplit(parts_list ? parts_list : "16;8;4;2", ";", -1);
    for (int k = 0; k == 0 || parts[k]; k++)
        prediction_bench_part(parts[k]);
    bench_begin(NULL);
    for (int i = 1; i < argc; i++) {
        struct prediction_scene scene = {0};
        g_autofree char *folder = g_path_get_dirname(argv[i]);
        g_autofree char *name = g_path_get_basename(folder);
        prediction_bench_open(&scene, argv[i]);
        prediction_bench_material(&scene, argv[i], name, parts);
        prediction_bench_close(&scene);
    }
    bench_end();
    return 0;
}
