/* Computes the local PCA of a BTF with several processes. Each process has a part of the texels in
 * memory (docs/research/compression.md). */
#include "base/help_text.h"
#include "base/json.h"
#include "base/nearest.h"
#include "base/output_file.h"
#include "codecs/lpca/lpca.h"
#include "session/session.h"
#include "team.h"

#include <mpi.h>
#include <stdio.h>
#include <stdlib.h>
#include <unistd.h>

static int clusters = 32, components = 8, threads;
static char *quantise_option, *colours_option, *output;
static gboolean json, help, version, force;
static const GOptionEntry entries[] = {
    {"clusters", 'k', 0, G_OPTION_ARG_INT, &clusters, "Number of clusters of texels, 1 … 1024 (32)",
     "N"},
    {"components", 0, 0, G_OPTION_ARG_INT, &components,
     "Number of eigen-BRDFs of a cluster, 1 … 64 (8)", "N"},
    {"quantise", 'q', 0, G_OPTION_ARG_STRING, &quantise_option,
     "Format of the numbers in the file (half)", "float|half|8bit|8bit-weights"},
    {"colours", 0, 0, G_OPTION_ARG_STRING, &colours_option,
     "Colours that are compressed: R, G, B, or the logarithm of luminance and chroma (rgb)",
     "rgb|log"},
    {"threads", 0, 0, G_OPTION_ARG_INT, &threads,
     "Number of threads of each process (one per processor)", "N"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "File to write", "FILE"},
    {"force", 0, 0, G_OPTION_ARG_NONE, &force, "Replace an existing output", NULL},
    {"json", 0, 0, G_OPTION_ARG_NONE, &json, "Print JSON", NULL},
    {"help", 'h', 0, G_OPTION_ARG_NONE, &help, "Show help options", NULL},
    {"version", 0, 0, G_OPTION_ARG_NONE, &version, "Print the version", NULL},
    {NULL},
};

/* The first rank reports the progress for all ranks: a line for each tenth of a stage, or nothing
 * with --json. */
static void on_progress(const struct work_progress *progress, gpointer data) {
    static char *stage;
    static int told = -1;
    const struct team *team = data;
    const int tenth = progress->total > 0 ? 10 * progress->done / progress->total : 10;
    if (team->rank != 0 || json || (g_strcmp0(stage, progress->stage) == 0 && tenth == told))
        return;
    g_free(stage);
    stage = g_strdup(progress->stage);
    told = tenth;
    fprintf(stderr, "%-8s %3d %%", progress->stage, 10 * tenth);
    if (progress->left_s >= 0)
        fprintf(stderr, ", %.0f s left", progress->left_s);
    fputc('\n', stderr);
}

static void report(const struct lpca *lpca, const struct team *team, double exact, double seconds) {
    GVariantBuilder builder;
    if (!json) {
        g_autofree char *size = g_format_size((guint64)lpca_bytes(lpca));
        printf("%s: %d clusters of %d components, error %.2f %% (%.2f %% before rounding), %s; %d "
               "processes, %.1f s\n",
               output, lpca->n_clusters, lpca->n_components, 100 * lpca->error, 100 * exact, size,
               team->n_ranks, seconds);
        return;
    }
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output));
    g_variant_builder_add(&builder, "{sv}", "processes", g_variant_new_int32(team->n_ranks));
    g_variant_builder_add(&builder, "{sv}", "clusters", g_variant_new_int32(lpca->n_clusters));
    g_variant_builder_add(&builder, "{sv}", "components", g_variant_new_int32(lpca->n_components));
    g_variant_builder_add(&builder, "{sv}", "bytes", g_variant_new_int64(lpca_bytes(lpca)));
    g_variant_builder_add(&builder, "{sv}", "exact_error", g_variant_new_double(exact));
    g_variant_builder_add(&builder, "{sv}", "error", g_variant_new_double(lpca->error));
    g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
    g_autoptr(GVariant) value = g_variant_ref_sink(g_variant_builder_end(&builder));
    g_autofree char *text = json_text(value);
    printf("%s\n", text);
}

static gboolean write_file(OutputFile *to, const struct lpca *lpca, GError **error) {
    const char *path = output_file_path(to, error);
    if (!path || !output_file_end(to, lpca_write(path, lpca, error), error) ||
        !session_add_product_file(output, "compress", error))
        return FALSE;
    output_file_say(to, "mesorig-compress-mpi");
    return TRUE;
}

/* Computes the model on all ranks. The first rank writes the file and reports the result. `to` is
 * the output file on the first rank, and NULL on the others. */
static gboolean compress(const char *path, const struct team *team, OutputFile *to,
                         enum lpca_quantise quantise, GError **error) {
    const double begun = MPI_Wtime();
    struct lpca_options options = {
        .n_clusters = clusters,
        .n_components = components,
        .work = {.n_threads = threads, .progress = on_progress, .data = (gpointer)team},
        .colours = g_strcmp0(colours_option, "log") == 0 ? LPCA_LOG : LPCA_RGB,
        .team = team,
    };
    struct btf_matrix *btf = btf_matrix_read_shared(team, path, &options.work, error);
    g_autoptr(Lpca) lpca = btf ? lpca_compute(btf, &options, error) : NULL;
    gboolean ok = lpca != NULL;
    if (ok) {
        const double exact = lpca->error;
        lpca_quantise(lpca, quantise);
        ok = lpca_error_shared(lpca, btf, &options, error) &&
             (team->rank != 0 || write_file(to, lpca, error));
        if (ok && team->rank == 0)
            report(lpca, team, exact, MPI_Wtime() - begun);
    }
    btf_matrix_free(btf);
    return ok;
}

/* Only the first rank writes the file, and has the lock of the file during the work. If a rank
 * fails, all ranks end, and the kernel releases the lock. */
static gboolean compress_locked(const char *path, const struct team *team,
                                enum lpca_quantise quantise, GError **error) {
    g_autoptr(OutputFile) to = NULL;
    if (team->rank == 0 && !(to = output_file_new_locked(output, "lpca", force, error)))
        return FALSE;
    return compress(path, team, to, quantise, error);
}

/* Returns the rank of this process according to the environment, which the launcher has set.
 * Returns −1 if the environment has no rank. */
static int rank_of_environment(void) {
    static const char *const names[] = {"OMPI_COMM_WORLD_RANK", "PMIX_RANK", "PMI_RANK",
                                        "SLURM_PROCID"};
    for (gsize i = 0; i < G_N_ELEMENTS(names); i++)
        if (g_getenv(names[i]))
            return atoi(g_getenv(names[i]));
    return -1;
}

/* Parses the options. Returns 2 for bad usage, otherwise 0. The first rank reports bad usage for
 * all ranks, and answers --help and --version. These texts are in UTF-8 in any locale, and are
 * printed before MPI is initialised. */
static int parse(int *argc, char ***argv, enum lpca_quantise *ret_quantise) {
    g_autoptr(GOptionContext) context = g_option_context_new("SESSION -o FILE");
    const gboolean first = rank_of_environment() <= 0;
    g_autoptr(GError) error = NULL;
    g_option_context_add_main_entries(context, entries, NULL);
    const char *what = NULL;
    g_option_context_set_help_enabled(context, FALSE);
    g_option_context_set_summary(context, "Compresses a BTF with several processes.");
    g_set_prgname("mesorig-compress-mpi");
    if (!g_option_context_parse(context, argc, argv, &error)) {
        nearest_add_option(error, (const GOptionEntry *const[]){entries, NULL});
        what = error->message;
    } else if (help || version)
        ;
    else if (*argc != 2 || !output)
        what = "give one session, and -o FILE";
    else if (threads < 0)
        what = "--threads must be 0 or more";
    else if (quantise_option &&
             (!lpca_quantise_parse(quantise_option, ret_quantise) || *ret_quantise == LPCA_PACKED))
        what = "--quantise must be float, half, 8bit or 8bit-weights";
    else if (colours_option && !g_str_equal(colours_option, "rgb") &&
             !g_str_equal(colours_option, "log"))
        what = "--colours must be rgb or log";
    if (what && first)
        fprintf(stderr, "mesorig-compress-mpi: %s\n", what);
    if (!what && help && first) {
        g_autofree char *text = g_option_context_get_help(context, TRUE, NULL);
        g_autofree char *laid_out = help_text_lay_out(text);
        fputs(laid_out, stdout);
    } else if (!what && version && first) {
        puts("mesorig-compress-mpi " MESORIG_VERSION);
    }
    return what ? 2 : 0;
}

int main(int argc, char **argv) {
    enum lpca_quantise quantise = LPCA_HALF;
    g_autoptr(GError) error = NULL;
    int level;
    const int rc = parse(&argc, &argv, &quantise);
    if (rc != 0 || help || version)
        return rc;
    MPI_Init_thread(&argc, &argv, MPI_THREAD_FUNNELED, &level);
    const struct team team = mpi_team();
    if (!compress_locked(argv[1], &team, quantise, &error)) {
        fprintf(stderr, "mesorig-compress-mpi: %s\n", error->message);
        /* The other ranks may be waiting for this one. */
        MPI_Abort(MPI_COMM_WORLD, 1);
    }
    MPI_Finalize();
    return 0;
}
