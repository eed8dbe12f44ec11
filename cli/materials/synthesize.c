/* synthesize: makes an index map, with which a material of any size is drawn from a small
 * sample. */
#include "materials.h"

#include <stdio.h>

#include "common/work.h"
#include "plan/report.h"
#include "session/session.h"
#include "synthesis/synthesis.h"

#define MEMORY ((gint64)1 << 30) /* memory for the BTF; a larger one is kept in a scratch file */

static char *output, *size, *method;
static gboolean tileable;
static int seed, block;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "Write this file instead of products/index.exr of the session", "FILE.exr"},
    {"size", 0, 0, G_OPTION_ARG_STRING, &size, "Texels (512x512)", "WxH"},
    {"method", 'm', 0, G_OPTION_ARG_STRING, &method, "How it is made (auto)",
     "auto|textons|quilting"},
    {"tileable", 0, 0, G_OPTION_ARG_NONE, &tileable,
     "A part of the sample itself that can be repeated", NULL},
    {"seed", 0, 0, G_OPTION_ARG_INT, &seed, "Another seed gives another picture (0)", "N"},
    {"block", 0, 0, G_OPTION_ARG_INT, &block, "Side of quilting's blocks in texels", "N"},
    {NULL},
};

struct job {
    const char *session;
    char *written;
    struct synthesis_options options;
    struct synthesis_result result;
    struct index_map *map;
    OutputFile *to; /* written */
};

/* Returns the file to write. If it is one of the session's products, the session's lock is
 * taken. */
static char *synthesize_output(const char *session, GError **error) {
    if (output)
        return g_strdup(output);
    g_autofree char *directory = btf_matrix_session(session);
    g_autoptr(Session) opened = session_open(directory, SESSION_PRODUCTS, error);
    return opened ? g_build_filename(directory, "products", "index.exr", NULL) : NULL;
}

static gboolean synthesize_write(struct job *job, const struct work *work, GError **error) {
    const struct synthesis_options *o = &job->options;
    g_autofree char *made_by =
        g_strdup_printf("synthesize --size %dx%d --method %s --seed %u", o->width, o->height,
                        synthesis_names[o->method], o->seed);
    job->map = synthesis_of_session(job->session, MEMORY, o, work, &job->result, error);
    const char *path = job->map ? output_file_path(job->to, error) : NULL;
    return path && output_file_end(job->to, index_map_write(path, job->map, error), error) &&
           session_add_product_file(
               job->written, o->method == SYNTHESIS_TILEABLE ? "synthesize --tileable" : made_by,
               error);
}

static gboolean synthesize_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    job->written = synthesize_output(job->session, error);
    if (!job->written)
        return FALSE;
    job->to = (output ? cli_output_locked : cli_output_product)(job->written, "index", error);
    return job->to && synthesize_write(job, work, error);
}

static void tell(Record *to, const struct job *job, double seconds) {
    const struct synthesis_result *result = &job->result;
    const struct index_map *map = job->map;
    const struct order_seams *seams = &result->seams;
    g_autofree char *time = report_duration(seconds);
    g_autofree char *bytes = g_format_size((guint64)index_map_bytes(map));
    record_string(to, "file", job->written);
    record_string(to, "method", synthesis_names[result->method]);
    record_int(to, "width", map->width);
    record_int(to, "height", map->height);
    record_int(to, "levels", map->n_levels);
    record_int(to, "sample_width", map->sample_width);
    record_int(to, "sample_height", map->sample_height);
    record_int(to, "bytes", index_map_bytes(map));
    record_int(to, "components", result->n_features);
    record_double(to, "explained", result->explained);
    record_double(to, "relief", result->relief);
    record_int(to, "seams", seams->seams);
    record_double(to, "seam_share", (double)seams->seams / seams->pairs);
    record_double(to, "seam_error", seams->inside > 0 ? seams->seam / seams->inside : 0);
    record_say(to, "%s: %d × %d texels of %d × %d in %s, by %s, %s\n", job->written, map->width,
               map->height, map->sample_width, map->sample_height, time,
               synthesis_names[result->method], bytes);
    for (int k = SYNTHESIS_TEXTONS; k <= SYNTHESIS_QUILTING; k++)
        if (result->order[k] >= 0) {
            g_autofree char *key = g_strdup_printf("order_%s", synthesis_names[k]);
            record_double(to, key, result->order[k]);
            record_say(to, "%s: autocorrelation off by %.3f\n", synthesis_names[k],
                       result->order[k]);
        }
    if (seams->seams > 0)
        record_say(
            to,
            "%.1f %% of neighbouring texels are at a seam; they differ %.2f times as much as "
            "neighbours in the sample\n",
            100.0 * seams->seams / seams->pairs, seams->seam / seams->inside);
    record_double(to, "real_s", seconds);
    cli_tell_output(to, job->to);
}

/* Returns FALSE with *ret_code set if the command must end. */
static gboolean ask(const struct call *call, struct synthesis_options *o, int *ret_code) {
    char rest;
    *o = (struct synthesis_options){.width = 512, .height = 512, .block = block};
    *ret_code = CLI_USAGE;
    if (tileable && (size || method || block || seed)) {
        cli_usage(call->command,
                  "--tileable cannot be used with --size, --method, --block or --seed");
        return FALSE;
    }
    if (size && sscanf(size, "%5dx%5d%c", &o->width, &o->height, &rest) != 2) {
        cli_usage(call->command, "--size=%s: WIDTHxHEIGHT in texels is expected", size);
        return FALSE;
    }
    if (seed < 0 || block < 0) {
        cli_usage(call->command, "--seed and --block are not negative");
        return FALSE;
    }
    o->seed = (guint32)seed;
    for (int k = 0; method && k < SYNTHESIS_TILEABLE; k++)
        if (g_str_equal(method, synthesis_names[k])) {
            o->method = (enum synthesis_method)k;
            return TRUE;
        }
    if (method) {
        cli_usage(call->command, "there is no --method=%s; choose from: auto, textons, quilting",
                  method);
        return FALSE;
    }
    o->method = tileable ? SYNTHESIS_TILEABLE : SYNTHESIS_AUTO;
    return TRUE;
}

static int run(const struct call *call, GError **error) {
    struct job job = {.session = call->arguments[0]};
    double seconds = 0;
    int code;
    if (!ask(call, &job.options, &code))
        return code;
    code = cli_work_run(synthesize_work, &job, &seconds, error) ? CLI_DONE : CLI_FAILED;
    if (code == CLI_DONE)
        tell(call->record, &job, seconds);
    index_map_free(job.map);
    g_free(job.written);
    output_file_free(job.to);
    return code;
}

const struct command textures_synthesize = {
    .name = "synthesize",
    .arguments = "DIR",
    .examples = "  mesorig synthesize weave.session --size 1024x512\n"
                "  mesorig synthesize weave.session --tileable -o tile.exr\n",
    .help = "Make a larger material from a sample, as a map of its texels.",
    .options = entries,
    .writes = TRUE,
    .streams = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
