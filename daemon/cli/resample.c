/* resample: a BTF in directions that are the same for all texels. */
#include "cli.h"
#include "pipeline/near_field_correction.h"
#include "plan/report.h"
#include "work.h"

#include <math.h>
#include <string.h>

static char *output, *directions;
static int threads;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The session to make", "DIR"},
    {"directions", 'd', 0, G_OPTION_ARG_FILENAME, &directions,
     "own: those planned (default); 81: the papers'; or a table of directions", "own|81|FILE"},
    {"threads", 't', 0, G_OPTION_ARG_INT, &threads, "How many at a time (one a processor)", "N"},
    {NULL},
};

struct job {
    const char *session;
    struct btf_directions *to; /* NULL: its own */
    struct near_field_correction_result result;
};

static gboolean cli_resample_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    struct work threaded = *work;
    threaded.n_threads = threads;
    return near_field_correct(job->session, output, job->to, &threaded, &job->result, error);
}

static void cli_resample_add_double(GVariantBuilder *builder, const char *name, double value) {
    g_variant_builder_add(builder, "{sv}", name, g_variant_new_double(value));
}

static void add_from(GVariantBuilder *builder, const struct near_field_correction_band *band) {
    cli_resample_add_double(builder, "left_out_view", band->left_out_view);
    cli_resample_add_double(builder, "left_out_light", band->left_out_light);
    cli_resample_add_double(builder, "back", band->back);
}

static void add_to(GVariantBuilder *builder, const struct near_field_correction_band *band) {
    cli_resample_add_double(builder, "moved_deg", band->moved_deg);
    cli_resample_add_double(builder, "most_moved_deg", band->most_moved_deg);
    cli_resample_add_double(builder, "held", band->held);
    if (band->nominal >= 0)
        cli_resample_add_double(builder, "nominal", band->nominal);
}

static GVariant *bands_variant(const GArray *bands,
                               void (*add)(GVariantBuilder *,
                                           const struct near_field_correction_band *)) {
    GVariantBuilder list;
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; i < bands->len; i++) {
        const struct near_field_correction_band *band =
            &g_array_index(bands, struct near_field_correction_band, i);
        GVariantBuilder one;
        g_variant_builder_init(&one, G_VARIANT_TYPE_VARDICT);
        cli_resample_add_double(&one, "theta_deg", band->theta_deg);
        g_variant_builder_add(&one, "{sv}", "views", g_variant_new_int32(band->n_views));
        add(&one, band);
        g_variant_builder_add_value(&list, g_variant_builder_end(&one));
    }
    return g_variant_builder_end(&list);
}

static void cli_resample_tell_json(const struct job *job, double seconds) {
    const struct near_field_correction_result *result = &job->result;
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "session", g_variant_new_string(output));
    g_variant_builder_add(&builder, "{sv}", "exact", g_variant_new_boolean(result->exact));
    g_variant_builder_add(&builder, "{sv}", "mdf", g_variant_new_boolean(result->mdf));
    g_variant_builder_add(&builder, "{sv}", "from_views", g_variant_new_int32(result->n_views));
    g_variant_builder_add(&builder, "{sv}", "from_lights", g_variant_new_int32(result->n_lights));
    g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->made.n_views));
    g_variant_builder_add(&builder, "{sv}", "lights", g_variant_new_int32(result->made.n_lights));
    g_variant_builder_add(&builder, "{sv}", "width", g_variant_new_int32(result->made.width));
    g_variant_builder_add(&builder, "{sv}", "height", g_variant_new_int32(result->made.height));
    g_variant_builder_add(&builder, "{sv}", "holes", g_variant_new_int64(result->holes));
    g_variant_builder_add(&builder, "{sv}", "bounds", g_variant_new_int64(result->bounds));
    g_variant_builder_add(&builder, "{sv}", "predicted", g_variant_new_int64(result->predicted));
    g_variant_builder_add(&builder, "{sv}", "left_out_texels",
                          g_variant_new_int32(result->sampled));
    cli_resample_add_double(&builder, "light_moved_deg", result->light_moved_deg);
    cli_resample_add_double(&builder, "light_most_moved_deg", result->light_most_moved_deg);
    add_from(&builder, &result->all);
    add_to(&builder, &result->all);
    g_variant_builder_add(&builder, "{sv}", "by_view", bands_variant(result->from, add_from));
    g_variant_builder_add(&builder, "{sv}", "by_view_made", bands_variant(result->to, add_to));
    cli_resample_add_double(&builder, "eigenmaps_error", result->made.eigenmaps_error);
    cli_resample_add_double(&builder, "real_s", seconds);
    cli_print_json(g_variant_builder_end(&builder));
}

/* For names with a sign of two bytes. */
static int padded(const char *name, int width) {
    return width + (int)strlen(name) - (int)g_utf8_strlen(name, -1);
}

static void print_from(const char *name, const struct near_field_correction_band *band) {
    g_print("%-*s %11.2f %% %16.2f %% %14.2f %%\n", padded(name, 13), name,
            100 * band->left_out_view, 100 * band->left_out_light, 100 * band->back);
}

static void print_to(const char *name, const struct near_field_correction_band *band) {
    g_print("%-*s %6.2f° %10.2f° %12.1f %%", padded(name, 13), name, band->moved_deg,
            band->most_moved_deg, 100 * band->held);
    if (band->nominal >= 0)
        g_print(" %14.2f %%", 100 * band->nominal);
    g_print("\n");
}

static void print_table(const GArray *bands, const struct near_field_correction_band *all,
                        void (*print)(const char *, const struct near_field_correction_band *)) {
    for (guint i = 0; i < bands->len; i++) {
        const struct near_field_correction_band *band =
            &g_array_index(bands, struct near_field_correction_band, i);
        g_autofree char *name = g_strdup_printf("%.3g°", band->theta_deg);
        print(name, band);
    }
    print("all", all);
}

static void cli_resample_tell_marks(const struct near_field_correction_result *result) {
    if (result->holes > 0)
        g_print("%" G_GINT64_FORMAT " holes were filled from the texels around them\n",
                result->holes);
    if (result->bounds > 0)
        g_print("%" G_GINT64_FORMAT " values were lower bounds\n", result->bounds);
    if (result->predicted > 0)
        g_print("%" G_GINT64_FORMAT " values were made of the pictures of other lights\n",
                result->predicted);
}

static void cli_resample_tell(const struct job *job, double seconds) {
    const struct near_field_correction_result *result = &job->result;
    g_autofree char *time = report_duration(seconds);
    if (cli_json) {
        cli_resample_tell_json(job, seconds);
        return;
    }
    g_print("%s: %d × %d texels, %d views × %d lights from %d × %d in %s\n", output,
            result->made.width, result->made.height, result->made.n_views, result->made.n_lights,
            result->n_views, result->n_lights, time);
    if (!result->exact)
        g_print("where cameras and lamps were is not known: all texels had the same directions\n");
    if (result->mdf)
        g_print("its MDF is the measured one as it was, with the views it was measured from\n");
    g_print("\nmeasured from  left out: view            light   there and back\n");
    print_table(result->from, &result->all, print_from);
    g_print("\nmade for         moved     at most   too far out%s\n",
            result->all.nominal >= 0 ? "   read as planned" : "");
    print_table(result->to, &result->all, print_to);
    g_print("lights        %6.2f° %10.2f°\n", result->light_moved_deg,
            result->light_most_moved_deg);
    cli_resample_tell_marks(result);
}

static gboolean cli_resample_read_directions(struct job *job, GError **error) {
    if (!directions || strcmp(directions, "own") == 0)
        return TRUE;
    job->to = strcmp(directions, "81") == 0 ? btf_directions_81()
                                            : btf_directions_read(directions, error);
    return job->to != NULL;
}

static int cli_resample_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    struct job job = {0};
    double seconds = 0;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    if (!output)
        return cli_usage(command, "where to? Give -o DIR.session");
    if (threads < 0 || threads > 1024)
        return cli_usage(command, "--threads is 1 to 1024");
    job.session = argv[1];
    if (!cli_resample_read_directions(&job, &error))
        return cli_fail(error);
    const gboolean ok = cli_work_run(cli_resample_work, &job, &seconds, &error);
    btf_directions_free(job.to);
    if (!ok)
        return cli_fail(error);
    cli_resample_tell(&job, seconds);
    near_field_correction_result_clear(&job.result);
    return CLI_DONE;
}

const struct command cli_resample = {.name = "resample",
                                     .arguments = "DIR -o DIR",
                                     .help = "Make a session whose BTF has the same directions for "
                                             "all texels, and say how far to believe "
                                             "it.",
                                     .run_arguments = cli_resample_run};
