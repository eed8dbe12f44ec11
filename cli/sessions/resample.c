/* resample: converts a BTF to directions that are the same for all texels. */
#include "base/plural.h"
#include "common/cli.h"
#include "common/work.h"
#include "pipeline/along_surface.h"
#include "pipeline/near_field_correction.h"
#include "plan/report.h"
#include "sessions.h"

#include <string.h>

/* maximum memory for the values with --along-surface */
#define MEMORY (G_GINT64_CONSTANT(2) << 30)

static char *output, *directions;
static gboolean along_surface;
static int threads;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The session to make", "DIR"},
    {"directions", 'd', 0, G_OPTION_ARG_FILENAME, &directions,
     "own: the planned directions (default); 81: the directions of the papers; or a file with a "
     "table of directions",
     "own|81|FILE"},
    {"along-surface", 0, 0, G_OPTION_ARG_NONE, &along_surface,
     "Move the views along the surface of the MDF before mixing them. For materials with relief "
     "whose views are far apart",
     NULL},
    {"threads", 0, 0, G_OPTION_ARG_INT, &threads, "Number of threads (one per processor)", "N"},
    {NULL},
};

struct job {
    const char *session;
    struct btf_directions *to; /* NULL for the session's own */
    struct near_field_correction_result result;
    struct along_surface_result along;
};

static gboolean cli_resample_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    struct work threaded = *work;
    threaded.n_threads = threads;
    if (along_surface)
        return along_surface_predict(job->session, output, job->to, MEMORY, &threaded, &job->along,
                                     error);
    return near_field_correct(job->session, output, job->to, &threaded, &job->result, error);
}

static void add_left_out(Record *to, const struct near_field_correction_band *band) {
    record_double(to, "left_out_view", band->left_out_view);
    record_double(to, "left_out_light", band->left_out_light);
    record_double(to, "back", band->back);
}

static void add_moved(Record *to, const struct near_field_correction_band *band) {
    record_double(to, "moved_deg", band->moved_deg);
    record_double(to, "most_moved_deg", band->max_moved_deg);
    record_double(to, "held", band->held);
    if (band->nominal >= 0)
        record_double(to, "nominal", band->nominal);
}

static void add_sizes(Record *to, int from_views, int from_lights,
                      const struct import_result *made) {
    record_int(to, "from_views", from_views);
    record_int(to, "from_lights", from_lights);
    record_int(to, "views", made->n_views);
    record_int(to, "lights", made->n_lights);
    record_int(to, "width", made->width);
    record_int(to, "height", made->height);
}

static void add_values(Record *to, const struct near_field_correction_result *result) {
    record_string(to, "session", output);
    record_boolean(to, "exact", result->exact);
    record_boolean(to, "mdf", result->mdf);
    add_sizes(to, result->n_views, result->n_lights, &result->made);
    record_int(to, "holes", result->holes);
    record_int(to, "bounds", result->bounds);
    record_int(to, "predicted", result->predicted);
    record_int(to, "left_out_texels", result->sampled);
    record_double(to, "light_moved_deg", result->light_moved_deg);
    record_double(to, "light_most_moved_deg", result->light_most_moved_deg);
    add_left_out(to, &result->all);
    add_moved(to, &result->all);
}

/* Returns the width in bytes for names with a character of two bytes. */
static int padded(const char *name, int width) {
    return width + (int)strlen(name) - (int)g_utf8_strlen(name, -1);
}

static void say_from(Record *to, const char *name, const struct near_field_correction_band *band) {
    record_say(to, "%-*s %11.2f %% %16.2f %% %14.2f %%\n", padded(name, 13), name,
               100 * band->left_out_view, 100 * band->left_out_light, 100 * band->back);
}

static void say_to(Record *to, const char *name, const struct near_field_correction_band *band) {
    record_say(to, "%-*s %6.2f° %10.2f° %12.1f %%", padded(name, 13), name, band->moved_deg,
               band->max_moved_deg, 100 * band->held);
    if (band->nominal >= 0)
        record_say(to, " %14.2f %%", 100 * band->nominal);
    record_say(to, "\n");
}

/* Adds a table of all bands, and the values of all bands together. */
static void tell_bands(Record *to, const char *key, const GArray *bands,
                       const struct near_field_correction_band *all,
                       void (*add)(Record *, const struct near_field_correction_band *),
                       void (*say)(Record *, const char *,
                                   const struct near_field_correction_band *)) {
    record_begin_list(to, key);
    for (guint i = 0; i < bands->len; i++) {
        const struct near_field_correction_band *band =
            &g_array_index(bands, struct near_field_correction_band, i);
        g_autofree char *name = g_strdup_printf("%.3g°", band->theta_deg);
        record_begin(to, NULL);
        record_double(to, "theta_deg", band->theta_deg);
        record_int(to, "views", band->n_views);
        add(to, band);
        record_end(to);
        say(to, name, band);
    }
    record_end(to);
    say(to, "all", all);
}

static void cli_resample_tell(Record *to, const struct near_field_correction_result *result,
                              double seconds) {
    g_autofree char *time = report_duration(seconds);
    add_values(to, result);
    record_say(to, "%s: %d × %d texels, %d %s × %d %s from %d × %d in %s\n", output,
               result->made.width, result->made.height, PLURAL(result->made.n_views, "view"),
               PLURAL(result->made.n_lights, "light"), result->n_views, result->n_lights, time);
    if (!result->exact)
        record_say(to, "the positions of cameras and lamps are not known: all texels had the same "
                       "directions\n");
    if (result->mdf)
        record_say(to, "its MDF is copied unchanged, with the views from which it was measured\n");
    record_say(to, "\nmeasured from  left out: view            light   there and back\n");
    tell_bands(to, "by_view", result->from, &result->all, add_left_out, say_from);
    record_say(to, "\nmade for         moved     at most   too far out%s\n",
               result->all.nominal >= 0 ? "   read as planned" : "");
    tell_bands(to, "by_view_made", result->to, &result->all, add_moved, say_to);
    record_double(to, "eigenmaps_error", result->made.eigenmaps_error);
    record_double(to, "real_s", seconds);
    record_say(to, "lights        %6.2f° %10.2f°\n", result->light_moved_deg,
               result->light_most_moved_deg);
    if (result->holes > 0)
        record_say(to, "%" G_GINT64_FORMAT " holes were filled from the texels around them\n",
                   result->holes);
    if (result->bounds > 0)
        record_say(to, "%" G_GINT64_FORMAT " values were lower bounds\n", result->bounds);
    if (result->predicted > 0)
        record_say(to,
                   "%" G_GINT64_FORMAT " values were predicted from the pictures of other lights\n",
                   result->predicted);
}

static void tell_along(Record *to, const struct along_surface_result *result, double seconds) {
    g_autofree char *time = report_duration(seconds);
    const double unseen = (double)result->unseen / (double)MAX(result->texels, 1);
    record_string(to, "session", output);
    record_boolean(to, "along_surface", TRUE);
    add_sizes(to, result->n_views, result->n_lights, &result->made);
    record_double(to, "unseen", unseen);
    record_double(to, "eigenmaps_error", result->made.eigenmaps_error);
    record_double(to, "real_s", seconds);
    record_say(to, "%s: %d × %d texels, %d %s × %d %s from %d × %d, along the surface, in %s\n",
               output, result->made.width, result->made.height,
               PLURAL(result->made.n_views, "view"), PLURAL(result->made.n_lights, "light"),
               result->n_views, result->n_lights, time);
    record_say(to,
               "its MDF is predicted as well; no view sees the surface at %.3f %% of its texels\n",
               100 * unseen);
}

static int cli_resample_run(const struct call *call, GError **error) {
    struct job job = {.session = call->arguments[0]};
    double seconds = 0;
    if (!output)
        return cli_usage(call->command, "no session to make is given: give -o DIR.session");
    if (threads < 0 || threads > 1024)
        return cli_usage(call->command, "--threads=%d is out of range: 1 to 1024", threads);
    if (directions && strcmp(directions, "own") != 0) {
        job.to = strcmp(directions, "81") == 0 ? btf_directions_81()
                                               : btf_directions_read(directions, error);
        if (!job.to)
            return CLI_FAILED;
    }
    const gboolean ok = cli_work_run(cli_resample_work, &job, &seconds, error);
    btf_directions_free(job.to);
    if (!ok)
        return CLI_FAILED;
    if (along_surface)
        tell_along(call->record, &job.along, seconds);
    else
        cli_resample_tell(call->record, &job.result, seconds);
    near_field_correction_result_clear(&job.result);
    return CLI_DONE;
}

const struct command cli_resample = {.name = "resample",
                                     .arguments = "DIR -o DIR",
                                     .examples =
                                         "  mesorig resample weave.session -o same.session\n"
                                         "  mesorig resample weave.session -o same.session -d 81\n"
                                         "  mesorig resample weave.session -o dense.session -d 81 "
                                         "--along-surface\n",
                                     .help = "Make a session whose BTF has the same directions for "
                                             "all texels, and report its accuracy.",
                                     .options = entries,
                                     .min = 1,
                                     .max = 1,
                                     .run = cli_resample_run};
