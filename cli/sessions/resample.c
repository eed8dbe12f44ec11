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

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Session directory to make", "DIR"},
    {"directions", 'd', 0, G_OPTION_ARG_FILENAME, &directions,
     "Directions of the new session: own, those of the plan; 81, those of the papers; or a table "
     "in a file (own)",
     "own|81|FILE"},
    {"along-surface", 0, 0, G_OPTION_ARG_NONE, &along_surface,
     "Move the views along the surface of the MDF before they are mixed; for materials with relief "
     "and views that are far apart",
     NULL},
    {NULL},
};

struct resampling {
    const char *session;
    struct btf_directions *to; /* NULL for the session's own */
    struct near_field_correction_result result;
    struct along_surface_result along;
};

static gboolean work_resample(const struct work *work, gpointer data, GError **error) {
    struct resampling *resampling = data;
    if (along_surface)
        return along_surface_predict(resampling->session, output, resampling->to, MEMORY, work,
                                     &resampling->along, error);
    return near_field_correct(resampling->session, output, resampling->to, work,
                              &resampling->result, error);
}

static void add_left_out(Record *to, const struct near_field_correction_band *band) {
    record_add(to, "%g{left_out_view} %g{left_out_light} %g{back}", band->left_out_view,
               band->left_out_light, band->back);
}

static void add_moved(Record *to, const struct near_field_correction_band *band) {
    record_add(to, "%g{moved_deg} %g{most_moved_deg} %g{held}", band->moved_deg,
               band->max_moved_deg, band->held);
    if (band->nominal >= 0)
        record_double(to, "nominal", band->nominal);
}

static void add_sizes(Record *to, int from_views, int from_lights,
                      const struct import_result *made) {
    record_add(to, "%d{from_views} %d{from_lights} %d{views} %d{lights} %d{width} %d{height}",
               from_views, from_lights, made->n_views, made->n_lights, made->width, made->height);
}

static void say_from(Record *to, const char *name, const struct near_field_correction_band *band) {
    record_say(to, "%-13s %11.2f{:%%} %16.2f{:%%} %14.2f{:%%}\n", name, band->left_out_view,
               band->left_out_light, band->back);
}

static void say_to(Record *to, const char *name, const struct near_field_correction_band *band) {
    record_say(to, "%-13s %6.2f° %10.2f° %12.1f{:%%}", name, band->moved_deg, band->max_moved_deg,
               band->held);
    record_say_if(to, band->nominal >= 0, " %14.2f{:%%}", band->nominal);
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
        record_add(to, "%g{theta_deg} %d{views}", band->theta_deg, band->n_views);
        add(to, band);
        record_end(to);
        say(to, name, band);
    }
    record_end(to);
    say(to, "all", all);
}

static void tell_near_field(Record *to, const struct near_field_correction_result *result,
                            double seconds) {
    record_string(to, "session", output);
    record_boolean(to, "exact", result->exact);
    record_boolean(to, "mdf", result->mdf);
    add_sizes(to, result->n_views, result->n_lights, &result->made);
    record_say(to, "%s: %d × %d texels, %d %s × %d %s from %d × %d in %g{:time}\n", output,
               result->made.width, result->made.height, PLURAL(result->made.n_views, "view"),
               PLURAL(result->made.n_lights, "light"), result->n_views, result->n_lights, seconds);
    if (!result->exact)
        record_say(to, "the positions of cameras and lamps are not known: all texels had the same "
                       "directions\n");
    if (result->mdf)
        record_say(to, "its MDF is copied unchanged, with the views from which it was measured\n");
    record_say_if(to, result->holes > 0,
                  "%" G_GINT64_FORMAT "{holes} holes were filled from the texels around them\n",
                  result->holes);
    record_say_if(to, result->bounds > 0, "%" G_GINT64_FORMAT "{bounds} values were lower bounds\n",
                  result->bounds);
    record_say_if(to, result->predicted > 0,
                  "%" G_GINT64_FORMAT
                  "{predicted} values were predicted from the pictures of other lights\n",
                  result->predicted);
    record_add(to, "%d{left_out_texels} %g{light_moved_deg} %g{light_most_moved_deg}",
               result->sampled, result->light_moved_deg, result->light_most_moved_deg);
    add_left_out(to, &result->all);
    add_moved(to, &result->all);
    record_say(to, "\nmeasured from  left out: view            light   there and back\n");
    tell_bands(to, "by_view", result->from, &result->all, add_left_out, say_from);
    record_say(to, "\nmade for         moved     at most   too far out%s\n",
               result->all.nominal >= 0 ? "   read as planned" : "");
    tell_bands(to, "by_view_made", result->to, &result->all, add_moved, say_to);
    record_say(to, "lights        %6.2f° %10.2f°\n", result->light_moved_deg,
               result->light_most_moved_deg);
    record_add(to, "%g{eigenmaps_error} %g{real_s}", result->made.eigenmaps_error, seconds);
}

static void tell_along(Record *to, const struct along_surface_result *result, double seconds) {
    record_string(to, "session", output);
    record_boolean(to, "along_surface", TRUE);
    add_sizes(to, result->n_views, result->n_lights, &result->made);
    record_say(
        to, "%s: %d × %d texels, %d %s × %d %s from %d × %d, along the surface, in %g{:time}\n",
        output, result->made.width, result->made.height, PLURAL(result->made.n_views, "view"),
        PLURAL(result->made.n_lights, "light"), result->n_views, result->n_lights, seconds);
    record_say(to,
               "its MDF is predicted as well; no view sees the surface at %.3f{unseen:%%} of its "
               "texels\n",
               (double)result->unseen / (double)MAX(result->texels, 1));
    record_add(to, "%g{eigenmaps_error} %g{real_s}", result->made.eigenmaps_error, seconds);
}

static int run(const struct call *call, GError **error) {
    struct resampling resampling = {.session = call->arguments[0]};
    double seconds = 0;
    if (!output)
        return cli_usage(call->command, "no session directory is given: give -o DIR.session");
    if (directions && strcmp(directions, "own") != 0) {
        resampling.to = strcmp(directions, "81") == 0 ? btf_directions_81()
                                                      : btf_directions_read(directions, error);
        if (!resampling.to)
            return CLI_FAILED;
    }
    const gboolean ok = cli_work_run(work_resample, &resampling, &seconds, error);
    btf_directions_free(resampling.to);
    if (!ok)
        return CLI_FAILED;
    if (along_surface)
        tell_along(call->record, &resampling.along, seconds);
    else
        tell_near_field(call->record, &resampling.result, seconds);
    near_field_correction_result_clear(&resampling.result);
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
                                             "all texels. Estimates the accuracy of the result.",
                                     .options = entries,
                                     .min = 1,
                                     .max = 1,
                                     .run = run};
