/* synthesize: makes an index map from a small sample. With an index map, a material of any size is
 * drawn. */
#include "materials.h"

#include <stdio.h>

#include "base/plural.h"
#include "common/work.h"
#include "session/session.h"
#include "synthesis/synthesis.h"

/* Memory for the BTF. A larger BTF is kept in a temporary file. */
#define MEMORY ((gint64)1 << 30)

static char *output, *size, *method;
static gboolean tileable;
static int seed;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "File to write (products/index.exr of the session)", "FILE.exr"},
    {"size", 0, 0, G_OPTION_ARG_STRING, &size, "Size of the map in texels (512x512)", "WxH"},
    {"method", 'm', 0, G_OPTION_ARG_STRING, &method,
     "Method of synthesis; auto takes textons, unless quilting keeps order clearly better (auto)",
     "auto|textons|quilting"},
    {"tileable", 0, 0, G_OPTION_ARG_NONE, &tileable,
     "Find a part of the sample that can be repeated without seams", NULL},
    {"seed", 0, 0, G_OPTION_ARG_INT, &seed, "Another seed gives another arrangement (0)", "N"},
    {NULL},
};

struct synthesis {
    const char *session;
    char *written;
    struct synthesis_options options;
    struct synthesis_result result;
    struct index_map *map;
    OutputFile *to; /* the file that is written */
};

/* Returns the name of the output file: the value of -o, or index.exr among the products of the
 * session. In the second case, returns NULL with an error if the session cannot be opened, or if
 * another process is making products.
 *
 * The session is only opened for this check, so that the user learns of the problem early. Other
 * commands may use the session during the work, and the file has a lock of its own. */
static char *output_path(const char *session, GError **error) {
    if (output)
        return g_strdup(output);
    g_autofree char *directory = btf_matrix_session(session);
    g_autoptr(Session) opened = session_open(directory, SESSION_PRODUCTS, error);
    return opened ? g_build_filename(directory, "products", "index.exr", NULL) : NULL;
}

static gboolean write_map(struct synthesis *synthesis, const struct work *work, GError **error) {
    const struct synthesis_options *o = &synthesis->options;
    g_autofree char *made_by =
        g_strdup_printf("synthesize --size %dx%d --method %s --seed %u", o->width, o->height,
                        synthesis_names[o->method], o->seed);
    synthesis->map =
        synthesis_of_session(synthesis->session, MEMORY, o, work, &synthesis->result, error);
    const char *path = synthesis->map ? output_file_path(synthesis->to, error) : NULL;
    return path &&
           output_file_end(synthesis->to, index_map_write(path, synthesis->map, error), error) &&
           session_add_product_file(
               synthesis->written,
               o->method == SYNTHESIS_TILEABLE ? "synthesize --tileable" : made_by, error);
}

static gboolean work_synthesis(const struct work *work, gpointer data, GError **error) {
    struct synthesis *synthesis = data;
    synthesis->written = output_path(synthesis->session, error);
    if (!synthesis->written)
        return FALSE;
    synthesis->to =
        (output ? cli_output_locked : cli_output_product)(synthesis->written, "index", error);
    return synthesis->to && write_map(synthesis, work, error);
}

static void tell(Record *to, const struct synthesis *synthesis, double seconds) {
    const struct synthesis_result *result = &synthesis->result;
    const struct index_map *map = synthesis->map;
    const struct order_seams *seams = &result->seams;
    record_say(to,
               "%s{file}: by %s{method}, %d{width} × %d{height} texels in %d{levels} %s, of "
               "%d{sample_width} × %d{sample_height}, %" G_GINT64_FORMAT "{bytes:size}, in "
               "%g{:time}\n",
               synthesis->written, synthesis_names[result->method], map->width, map->height,
               PLURAL(map->n_levels, "mip level"), map->sample_width, map->sample_height,
               index_map_bytes(map), seconds);
    record_add(to, "%d{components} %g{explained} %g{relief}", result->n_features, result->explained,
               result->relief);
    record_int(to, "seams", seams->seams);
    record_say_if(to, seams->seams > 0,
                  "%.1f{seam_share:%%} of neighbouring texels are at a seam; they differ "
                  "%.2f{seam_error} times as much as neighbours in the sample\n",
                  (double)seams->seams / seams->pairs,
                  seams->inside > 0 ? seams->seam / seams->inside : 0);
    for (int k = SYNTHESIS_TEXTONS; k <= SYNTHESIS_QUILTING; k++)
        if (result->order[k] >= 0) {
            g_autofree char *key = g_strdup_printf("order_%s", synthesis_names[k]);
            record_double(to, key, result->order[k]);
            record_say(to, "%s: autocorrelation off by %.3f\n", synthesis_names[k],
                       result->order[k]);
        }
    record_double(to, "real_s", seconds);
    cli_tell_output(to, synthesis->to);
}

/* Reads the options of the command into *o. If the command must end now, returns FALSE and sets
 * *ret_code to its exit code. */
static gboolean ask(const struct call *call, struct synthesis_options *o, int *ret_code) {
    char rest;
    *o = (struct synthesis_options){.width = 512, .height = 512};
    *ret_code = CLI_USAGE;
    if (tileable && (size || method || seed)) {
        cli_usage(call->command, "--tileable cannot be used with --size, --method or --seed");
        return FALSE;
    }
    if (size && sscanf(size, "%5dx%5d%c", &o->width, &o->height, &rest) != 2) {
        cli_usage(call->command, "--size=%s: give WIDTHxHEIGHT in texels", size);
        return FALSE;
    }
    if (seed < 0) {
        cli_usage(call->command, "--seed=%d is out of range: 0 or more", seed);
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
    struct synthesis synthesis = {.session = call->arguments[0]};
    double seconds = 0;
    int code;
    if (!ask(call, &synthesis.options, &code))
        return code;
    code = cli_work_run(work_synthesis, &synthesis, &seconds, error) ? CLI_DONE : CLI_FAILED;
    if (code == CLI_DONE)
        tell(call->record, &synthesis, seconds);
    index_map_free(synthesis.map);
    g_free(synthesis.written);
    output_file_free(synthesis.to);
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
