/* export web: writes a material as a page for browsers, or as the file that three.js loads. */
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"
#include "webgl/webgl_export.h"

static char *output, *mdf, *size;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output,
     "File to write: a page, or with .mesoweb a material for three.js", "FILE.html"},
    {"mdf", 0, 0, G_OPTION_ARG_FILENAME, &mdf,
     "Distances for silhouettes (mdf.exr in the folder of the material)", "FILE.exr"},
    {"size", 0, 0, G_OPTION_ARG_STRING, &size, "Maximum size of the file (20MB)", "20MB"},
    {NULL},
};

struct web {
    struct webgl_export asked;
    struct webgl_export_result result;
};

static gboolean write_web(const char *path, const struct work *work, gpointer data,
                          GError **error) {
    struct web *web = data;
    web->asked.output = path;
    return webgl_export(&web->asked, work, &web->result, error);
}

static OutputFile *open_output(const char *name, GError **error) {
    g_autofree char *lower = name ? g_ascii_strdown(name, -1) : NULL;
    const gboolean page = !lower || !g_str_has_suffix(lower, ".mesoweb");
    const struct exchange_format format = {"pages", "HTML and materials for three.js as .mesoweb",
                                           page ? ".html" : NULL, page ? "material" : NULL};
    return exchange_output(name, &format, error);
}

static int run(const struct call *call, GError **error) {
    struct web web = {.asked = {.path = call->arguments[0], .mdf = mdf, .size = WEBGL_EXPORT_SIZE}};
    const struct webgl_export_result *result = &web.result;
    Record *to = call->record;
    double seconds = 0;
    if (!exchange_parse_bytes(call->command, "size", size, &web.asked.size))
        return CLI_USAGE;
    g_autoptr(OutputFile) file = open_output(output, error);
    if (!file || !cli_work_write(file, write_web, &web, &seconds, error))
        return CLI_FAILED;
    record_say(to, "%s{file}: %d{width} × %d{height} texels, ", output, result->width,
               result->height);
    if (result->channels > 0)
        record_say(to, "neural planes of %d{channels} channels, ", result->channels);
    else
        record_say(to,
                   "%d{clusters} %s of %d{components} %s in %d{levels} %s on a grid of %d{grid}, ",
                   PLURAL(result->clusters, "cluster"), PLURAL(result->components, "component"),
                   PLURAL(result->levels, "level"), result->grid);
    record_boolean(to, "silhouettes", result->shell);
    record_boolean(to, "compressed", result->compressed);
    record_say(to, "%" G_GINT64_FORMAT "{bytes:size}, in %g{real_s:time}\n", result->bytes,
               seconds);
    if (!result->shell)
        record_say(to, "There is no mdf.exr: the page shows no silhouettes of the structure.\n");
    cli_tell_output(to, file);
    return CLI_DONE;
}

const struct command exchange_web = {
    .name = "export web",
    .arguments = "DIR|FILE -o FILE.html",
    .examples = "  mesorig export web weave.session -o weave.html\n",
    .help = "Export a material as a web page for browsers with WebGL 2; it needs no server.",
    .options = entries,
    .min = 1,
    .max = 1,
    .writes = TRUE,
    .run = run};
