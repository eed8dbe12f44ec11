/* export btf: writes the BTF of a session in Bonn's format. */
#include "base/plural.h"
#include "codecs/lpca/lpca.h"
#include "common/work.h"
#include "exchange.h"
#include "formats/export.h"

#define COMPONENTS 24

static char *output, *format;
static int components;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "File to write", "FILE.btf"},
    {"format", 0, 0, G_OPTION_ARG_STRING, &format, "Form in which the values are stored (bdi)",
     "bdi|fmf|dfmf"},
    {"components", 0, 0, G_OPTION_ARG_INT, &components, "Number of components of fmf and dfmf (24)",
     "N"},
    {NULL},
};

struct btf_export {
    const char *session;
    enum bonn_kind kind;
    struct export_bonn_result result;
};

static gboolean write_btf(const char *path, const struct work *work, gpointer data,
                          GError **error) {
    struct btf_export *export = data;
    return export_bonn(export->session, path, export->kind, components ? components : COMPONENTS,
                       work, &export->result, error);
}

static int run(const struct call *call, GError **error) {
    struct btf_export export = {.session = call->arguments[0], .kind = BONN_BDI};
    const struct export_bonn_result *result = &export.result;
    Record *to = call->record;
    double seconds = 0;
    if (format && (!bonn_kind_parse(format, &export.kind) || export.kind == BONN_BDI_SPARSE))
        return cli_usage(call->command, "there is no --format=%s; choose from: bdi, fmf, dfmf",
                         format);
    if (components < 0 || components > LPCA_MAX_COMPONENTS)
        return cli_usage(call->command, "--components=%d is out of range: 1 to %d", components,
                         LPCA_MAX_COMPONENTS);
    static const struct exchange_format file_format = {"BTFs", "Bonn's format", ".btf", NULL};
    g_autoptr(OutputFile) file = exchange_output(output, &file_format, error);
    if (!file || !cli_work_write(file, write_btf, &export, &seconds, error))
        return CLI_FAILED;
    record_say(to,
               "%s{file}: %d{views} %s × %d{lights} %s of %d{width} × %d{height} texels as %s in "
               "%g{:time}",
               output, PLURAL(result->n_views, "view"), PLURAL(result->n_lights, "light"),
               result->width, result->height, bonn_kind_name(export.kind), seconds);
    record_say_if(to, result->error > 0, ", with an error of %.2f{error:%%}", result->error);
    record_double(to, "real_s", seconds);
    record_say(to, "\n");
    cli_tell_output(to, file);
    return CLI_DONE;
}

const struct command exchange_btf = {.name = "export btf",
                                     .arguments = "DIR -o FILE.btf",
                                     .examples =
                                         "  mesorig export btf weave.session -o weave.btf\n",
                                     .help = "Export the BTF of a session in the format of Bonn.",
                                     .options = entries,
                                     .min = 1,
                                     .max = 1,
                                     .writes = TRUE,
                                     .run = run};
