/* import bsdf, merl, utia: measured BRDFs, made into sessions whose texels are all alike. */
#include "formats/reflectance/import_brdf.h"
#include "common/work.h"
#include "exchange.h"

#include <string.h>

#define MAX_TEXELS 1024

static char *output, *directions, *coding;
static double texel_mm, divide = 1, scale = 1;
static int texels = 1;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The session to make", "DIR"},
    {"directions", 'd', 0, G_OPTION_ARG_FILENAME, &directions,
     "Views and lights: a text table (the papers' 81; of UTIA's files, their own 241)", "FILE"},
    {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Texels across and down, all alike (1)", "N"},
    {"texel", 0, 0, G_OPTION_ARG_DOUBLE, &texel_mm, "How wide a texel is, in mm", "MM"},
    {NULL},
};

static const GOptionEntry utia_entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The session to make", "DIR"},
    {"directions", 'd', 0, G_OPTION_ARG_FILENAME, &directions,
     "Views and lights: a text table (the papers' 81; of UTIA's files, their own 241)", "FILE"},
    {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Texels across and down, all alike (1)", "N"},
    {"texel", 0, 0, G_OPTION_ARG_DOUBLE, &texel_mm, "How wide a texel is, in mm", "MM"},
    {"coding", 0, 0, G_OPTION_ARG_STRING, &coding, "What the numbers are (linear)", "linear|srgb"},
    {"divide", 0, 0, G_OPTION_ARG_DOUBLE, &divide, "What numbers are divided by before that (1)",
     "N"},
    {"scale", 0, 0, G_OPTION_ARG_DOUBLE, &scale, "What they are multiplied by after that (1)", "N"},
    {NULL},
};

struct job {
    const char *source;
    struct import_brdf_wish wish;
    struct import_result result;
};

static gboolean import_brdf_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return import_brdf(output, job->source, &job->wish, work, &job->result, error);
}

static int run(const struct call *call, enum brdf_kind kind, GError **error) {
    const struct command *command = call->command;
    struct job job = {.source = call->arguments[0],
                      .wish = {.kind = kind,
                               .coding = {divide, scale, coding && strcmp(coding, "srgb") == 0},
                               .texels = texels,
                               .texel_mm = texel_mm,
                               .directions = directions}};
    double seconds = 0;
    if (!output)
        return cli_usage(command, "no session to make is given: give -o DIR.session");
    if (texels < 1 || texels > MAX_TEXELS)
        return cli_usage(command, "--texels=%d is out of range: 1 to %d", texels, MAX_TEXELS);
    if (!(texel_mm >= 0 && texel_mm <= 1000))
        return cli_usage(command, "--texel=%g is out of range: 0 to 1000 mm", texel_mm);
    if (coding && strcmp(coding, "linear") != 0 && strcmp(coding, "srgb") != 0)
        return cli_usage(command, "there is no --coding=%s; choose from: linear, srgb", coding);
    if (!(divide > 0 && divide < 1e9) || !(scale > 0 && scale < 1e9))
        return cli_usage(command, "--divide and --scale are numbers above 0");
    if (!cli_work_run(import_brdf_work, &job, &seconds, error))
        return CLI_FAILED;
    exchange_tell_import(call->record, output, &job.result, seconds);
    return CLI_DONE;
}

static int bsdf_run(const struct call *call, GError **error) {
    return run(call, BRDF_RGL, error);
}
static int merl_run(const struct call *call, GError **error) {
    return run(call, BRDF_MERL, error);
}
static int utia_run(const struct call *call, GError **error) {
    return run(call, BRDF_UTIA, error);
}

const struct command exchange_import_bsdf = {
    .name = "import bsdf",
    .arguments = "FILE.bsdf -o DIR",
    .examples = "  mesorig import bsdf satin_rgb.bsdf -o satin.session\n",
    .help = "Make a session of a BRDF of RGL's material database.",
    .options = entries,
    .min = 1,
    .max = 1,
    .run = bsdf_run};
const struct command exchange_import_merl = {
    .name = "import merl",
    .arguments = "FILE.binary -o DIR",
    .examples = "  mesorig import merl gold.binary -o gold.session\n",
    .help = "Make a session of a BRDF of MERL's database.",
    .options = entries,
    .min = 1,
    .max = 1,
    .run = merl_run};
const struct command exchange_import_utia = {
    .name = "import utia",
    .arguments = "FILE -o DIR",
    .examples = "  mesorig import utia m003_carpet.bin -o carpet.session\n",
    .help = "Make a session of a BRDF of UTIA's database (.bin, .exr).",
    .options = utia_entries,
    .min = 1,
    .max = 1,
    .run = utia_run};
