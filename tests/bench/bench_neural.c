/*
 * Neural planes of a session: times of training and evaluation, and errors at the directions that
 * mesorig compare leaves out, after trainings of several lengths and with several numbers of
 * channels.
 */
#include "bench.h"
#include "codecs/codec/held_out.h"
#include "codecs/neural/neural_codec.h"
#include "codecs/neural/neural_private.h"

#include <math.h>
#include <string.h>

#define COLOURS (1 << 17) /* number of colours that are evaluated for a time */

static char **lengths, **channels;
static int threads;
static gboolean flat;
static char *folder;

static const GOptionEntry entries[] = {
    {"samples", 0, 0, G_OPTION_ARG_STRING_ARRAY, &lengths,
     "Samples per texel of the training (3000); may be given several times", "N"},
    {"channels", 0, 0, G_OPTION_ARG_STRING_ARRAY, &channels,
     "Channels of each texel (12); may be given several times", "N"},
    {"threads", 0, 0, G_OPTION_ARG_INT, &threads, "Threads of the training (one per core)", "N"},
    {"flat", 0, 0, G_OPTION_ARG_NONE, &flat, "Leave out the points of the MDF", NULL},
    {"write", 0, 0, G_OPTION_ARG_FILENAME, &folder,
     "Write the models into this folder, as neural_CHANNELS_SAMPLES.exr", "FOLDER"},
    {NULL},
};

static void draw_direction(GRand *random, float ret[3]) {
    const double z = g_rand_double_range(random, 0.25, 1), phi = g_rand_double_range(random, -4, 4);
    ret[0] = (float)(sqrt(1 - z * z) * cos(phi));
    ret[1] = (float)(sqrt(1 - z * z) * sin(phi));
    ret[2] = (float)z;
}

/* Returns the time in ns of a colour of texels or points on one thread. `shared` colours have the
 * same place and view one after another. */
static double time_evaluation(const struct neural *neural, gboolean points, int shared) {
    struct neural_sample *samples = g_new0(struct neural_sample, COLOURS);
    g_autofree float *colours = g_new(float, (gsize)3 * COLOURS);
    GRand *random = g_rand_new_with_seed(1);
    double best = INFINITY;
    for (int i = 0; i < COLOURS; i++) {
        struct neural_sample *sample = &samples[i];
        sample->x = (float)g_rand_double_range(random, 0, (double)neural->layout.width);
        sample->y = (float)g_rand_double_range(random, 0, (double)neural->layout.height);
        draw_direction(random, sample->view);
        if (i % shared > 0)
            memcpy(sample, sample - 1, offsetof(struct neural_sample, light));
        draw_direction(random, sample->light);
    }
    for (int round = 0; round < 5; round++) {
        const double begun_s = bench_cpu_s();
        (points ? neural_evaluate_points : neural_evaluate)(neural, samples, COLOURS, colours);
        best = MIN(best, 1e9 * (bench_cpu_s() - begun_s) / COLOURS);
    }
    g_rand_free(random);
    g_free(samples);
    return best;
}

struct bench {
    struct btf_matrix *btf, *rest;
    struct held_out held;
    struct codec_geometry *rest_geometry;
};

static void measure(const struct bench *bench, int n_channels, double per_texel) {
    const struct neural_options options = {.n_channels = n_channels,
                                           .per_texel = per_texel,
                                           .seed = 1,
                                           .work.n_threads = threads,
                                           .geometry = bench->rest_geometry};
    g_autoptr(GError) error = NULL;
    const double begun_s = bench_now_s(), cpu_s = bench_cpu_s();
    struct neural *neural = neural_compute(bench->rest, &options, &error);
    const double wall_s = bench_now_s() - begun_s, spent_s = bench_cpu_s() - cpu_s;
    bench_check(error);
    g_autoptr(Material) material = material_borrow("neural", &neural_codec, neural);
    struct comparison *found = held_out_compare(bench->btf, &bench->held, material, NULL, &error);
    bench_check(error);
    const double bytes = (double)neural_bytes(neural) / (double)btf_layout_texels(&neural->layout);
    bench_row(NULL,
              "%d{channels} %.0f{samples} %.1f{bytes_per_texel} %.2f{error_pct} %.2f{seen_pct} "
              "%.2f{psnr_db} %.4f{flip} %.1f{cpu_s} %.1f{wall_s} %.0f{ns} %.0f{ns_shared} "
              "%.0f{ns_point}",
              n_channels, per_texel, bytes, 100 * found->all.error, 100 * neural->error,
              found->all.psnr_db, found->flip, spent_s, wall_s, time_evaluation(neural, FALSE, 1),
              time_evaluation(neural, FALSE, 64), time_evaluation(neural, TRUE, 1));
    if (folder) {
        g_autofree char *name = g_strdup_printf("neural_%d_%.0f.exr", n_channels, per_texel);
        g_autofree char *path = g_build_filename(folder, name, NULL);
        neural_write(path, &neural, 1, &error);
        bench_check(error);
    }
    comparison_free(found);
    neural_free(neural);
}

int main(int argc, char **argv) {
    static char *default_lengths[] = {"3000", NULL}, *default_channels[] = {"12", NULL};
    g_autoptr(GError) error = NULL;
    struct bench bench = {0};
    bench_parse(&argc, &argv, entries, "DIR");
    if (argc != 2)
        bench_fail(2, "give the directory of one session");
    bench.btf = btf_matrix_read(argv[1], NULL, &error);
    bench_check(error);
    const struct btf_layout *layout = &bench.btf->layout;
    struct codec_geometry *geometry = codec_geometry_read(bench.btf, &error);
    bench_check(error);
    held_out_draw(layout, held_out_default(layout->views.n), held_out_default(layout->lights.n), 1,
                  &bench.held, &error);
    bench_check(error);
    bench.held.geometry = geometry;
    bench.rest = held_out_rest(bench.btf, &bench.held);
    bench.rest_geometry = held_out_rest_geometry(geometry, &bench.held);
    if (flat)
        bench.rest_geometry->n_points = 0;
    bench_begin(NULL);
    bench_begin_list("trainings");
    for (char **c = channels ? channels : default_channels; *c; c++)
        for (char **n = lengths ? lengths : default_lengths; *n; n++)
            measure(&bench, atoi(*c), g_ascii_strtod(*n, NULL));
    bench_end();
    bench_end();
    btf_matrix_free(bench.rest);
    btf_matrix_free(bench.btf);
    codec_geometry_free(geometry);
    codec_geometry_free(bench.rest_geometry);
    held_out_clear(&bench.held);
    return 0;
}
