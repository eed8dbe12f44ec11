/*
 * Measures how many points per second libmesorig-material evaluates on one core with each codec:
 * random points and directions, one by one and in one call. For the local PCA, NumPy computes the
 * same points from the eigen-BRDFs, with a loop over the points and with one expression for all
 * points. NumPy gets the texels, directions and weights. Both must give the values of the library.
 */
#include "bench.h"
#include "codecs/lpca/lpca.h"
#include "directions/directions.h"
#include "lib/material_fixture.h"
#include "lib/process.h"
#include "lib/remove_tree.h"

#include <math.h>
#include <mesorig/material.h>
#include <stdio.h>
#include <string.h>

#define REPEATS 5

struct points {
    int n;
    float *uv, *view, *light, *rgb;
};

struct rates {
    double single, batch; /* a second */
};

static void direction(GRand *random, float *ret) {
    const double z = g_rand_double_range(random, 0.1, 1), phi = g_rand_double(random) * 2 * G_PI;
    ret[0] = (float)(sqrt(1 - z * z) * cos(phi));
    ret[1] = (float)(sqrt(1 - z * z) * sin(phi));
    ret[2] = (float)z;
}

static struct points make_points(int n) {
    struct points p = {n, g_new(float, 2 * (gsize)n), g_new(float, 3 * (gsize)n),
                       g_new(float, 3 * (gsize)n), g_new(float, 3 * (gsize)n)};
    g_autoptr(GRand) random = g_rand_new_with_seed(1);
    for (int k = 0; k < n; k++) {
        p.uv[2 * k] = (float)g_rand_double(random);
        p.uv[2 * k + 1] = (float)g_rand_double(random);
        direction(random, p.view + 3 * (gsize)k);
        direction(random, p.light + 3 * (gsize)k);
    }
    return p;
}

/* Medians; CPU time of this thread is wall time on an idle machine, and counts on a busy one. */
static struct rates measure(const mesorig_material *m, const struct points *p) {
    double single[REPEATS], batch[REPEATS];
    for (int i = 0; i < REPEATS; i++) {
        const double begun = bench_cpu_s();
        for (gsize k = 0; k < (gsize)p->n; k++)
            mesorig_material_evaluate(m, 1, p->uv + 2 * k, p->view + 3 * k, p->light + 3 * k, NULL,
                                      p->rgb + 3 * k);
        const double half = bench_cpu_s();
        mesorig_material_evaluate(m, (size_t)p->n, p->uv, p->view, p->light, NULL, p->rgb);
        single[i] = p->n / (half - begun);
        batch[i] = p->n / (bench_cpu_s() - half);
    }
    return (struct rates){bench_time_quantile(single, REPEATS, 0.5),
                          bench_time_quantile(batch, REPEATS, 0.5)};
}

static void put(const char *folder, const char *name, gconstpointer data, gsize bytes) {
    g_autofree char *path = g_build_filename(folder, name, NULL);
    g_autoptr(GError) error = NULL;
    g_file_set_contents(path, data, (gssize)bytes, &error);
    bench_check(error);
}

/* Up to four directions of each point, index and weight; the set has its pole. */
static void put_directions(const char *folder, const char *of, const struct direction_list *list,
                           const float *at, int n, gboolean fade) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Directions) directions =
        directions_new(list->theta_deg, list->phi_deg, (int)list->n, &error);
    bench_check(error);
    g_autofree struct direction_weights *all = g_new(struct direction_weights, n);
    for (int k = 0; k < n; k++) {
        const struct vec3 d = vec3(at[3 * k], at[3 * k + 1], at[3 * k + 2]);
        const double fall = directions_fade_weights(directions, d, &all[k]);
        for (int i = 0; fade && i < 4; i++)
            all[k].weight[i] *= (float)fall;
    }
    put(folder, of, all, sizeof *all * (gsize)n);
}

/* Runs NumPy over the first n points. FALSE: there is no NumPy. */
static gboolean measure_numpy(const char *folder, const char *path, const struct points *p, int n,
                              struct rates *ret) {
    g_autoptr(GError) error = NULL;
    struct lpca *lpca = lpca_read(path, &error);
    bench_check(error);
    const gsize texels = btf_layout_texels(&lpca->layout);
    g_autofree char *sizes = g_strdup_printf(
        "%d %zu %zu %zu %zu %d %d", n, lpca->layout.width, lpca->layout.height,
        lpca->layout.views.n, lpca->layout.lights.n, lpca->n_clusters, lpca->n_components);
    put(folder, "sizes", sizes, strlen(sizes));
    put(folder, "clusters", lpca->clusters, sizeof(int) * texels);
    put(folder, "weights", lpca->weights, sizeof(float) * texels * (gsize)lpca->n_components);
    put(folder, "brdfs", lpca->brdfs,
        sizeof(float) * (gsize)lpca->n_clusters * (gsize)(lpca->n_components + 1) *
            btf_layout_values(&lpca->layout));
    put(folder, "uv", p->uv, sizeof(float) * 2 * (gsize)n);
    put(folder, "rgb", p->rgb, sizeof(float) * 3 * (gsize)n);
    put_directions(folder, "views", &lpca->layout.views, p->view, n, FALSE);
    put_directions(folder, "lights", &lpca->layout.lights, p->light, n, TRUE);
    lpca_free(lpca);
    const char *const argv[] = {"/usr/bin/python3",
                                SOURCE_DIR "/tests/bench/peers/eigenbrdfs_numpy.py", folder, NULL};
    char *out = NULL, *err = NULL;
    const int status = process_run_in(NULL, argv, &out, &err);
    const gboolean there = status != 3;
    if (there && (status != 0 || sscanf(out, "%lf %lf", &ret->single, &ret->batch) != 2))
        bench_fail(1, "%s%s", out, err);
    g_free(out);
    g_free(err);
    return there;
}

int main(int argc, char **argv) {
    int texels = 48, rings = 4, n = 50000;
    const GOptionEntry entries[] = {
        {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Texels each way, default 48", "N"},
        {"rings", 0, 0, G_OPTION_ARG_INT, &rings, "Rings of views and lights, default 4: 61 each",
         "N"},
        {"points", 0, 0, G_OPTION_ARG_INT, &n, "Points, default 50000", "N"},
        {NULL}};
    bench_parse(&argc, &argv, entries, NULL);
    if (texels < 1 || texels > 512 || rings < 1 || rings > 8 || n < 1000 || argc > 1)
        bench_fail(2, "bad arguments");
    g_autofree char *folder = g_dir_make_tmp("bench-material-XXXXXX", NULL);
    g_autoptr(BtfMatrix) btf = material_fixture_sized(texels, texels, rings, TRUE);
    struct points p = make_points(n);
    struct rates numpy = {0};
    bench_begin(NULL);
    bench_put("%d{texels} %zu{views} %zu{lights}", texels, btf->layout.views.n,
              btf->layout.lights.n);
    bench_begin("codecs"); /* evaluations a second */
    for (gsize i = 0; codecs[i]; i++) {
        g_autofree char *path = g_strdup_printf("%s/%s.exr", folder, codecs[i]->name);
        struct mesorig_error error = {0};
        material_fixture_write(path, codecs[i], btf, "");
        mesorig_material *m = mesorig_material_open(path, NULL, &error);
        if (!m)
            bench_fail(1, "%s", error.text);
        const struct rates rates = measure(m, &p);
        mesorig_material_close(m);
        if (i == 0 && !measure_numpy(folder, path, &p, 1000, &numpy))
            g_printerr("bench_material: no NumPy to compare with: install python3-numpy\n");
        bench_row(codecs[i]->name, "%.0f{single} %.0f{batch}", rates.single, rates.batch);
    }
    bench_end();
    bench_row("numpy", "%.0f{single} %.0f{batch}", numpy.single, numpy.batch);
    bench_end();
    g_free(p.uv);
    g_free(p.view);
    g_free(p.light);
    g_free(p.rgb);
    remove_tree(folder);
    return 0;
}
