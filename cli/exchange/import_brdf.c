/* import bsdf, merl, utia: make sessions of measured BRDFs. All texels have the same values. */
#include "formats/reflectance/import_brdf.h"
#include "common/work.h"
#include "exchange.h"

#include <string.h>

#define MAX_TEXELS 1024

static char *output, *directions, *coding;
static double texel_mm, divide = 1, scale = 1;
static int texels = 1;

#define SHARED_ENTRIES                                                                             \
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Session directory to make", "DIR"},        \
        {"directions",                                                                             \
         'd',                                                                                      \
         0,                                                                                        \
         G_OPTION_ARG_FILENAME,                                                                    \
         &directions,                                                                              \
         "Table of views and lights (the 81 directions of the papers; for UTIA its own 241)",      \
         "FILE"},                                                                                  \
        {"texels", 0,                                                                              \
         0,        G_OPTION_ARG_INT,                                                               \
         &texels,  "Number of texels in each direction; all have the same values (1)",             \
         "N"},                                                                                     \
    {                                                                                              \
        "texel-mm", 0, 0, G_OPTION_ARG_DOUBLE, &texel_mm, "Width of a texel (1)", "MM"             \
    }

static const GOptionEntry entries[] = {SHARED_ENTRIES, {NULL}};

static const GOptionEntry utia_entries[] = {
    SHARED_ENTRIES,
    {"coding", 0, 0, G_OPTION_ARG_STRING, &coding, "Tone curve of the numbers in the file (linear)",
     "linear|srgb"},
    {"divide", 0, 0, G_OPTION_ARG_DOUBLE, &divide,
     "Divide the numbers by this before the tone curve is undone (1)", "N"},
    {"scale", 0, 0, G_OPTION_ARG_DOUBLE, &scale,
     "Multiply the values by this after the tone curve is undone (1)", "N"},
    {NULL},
};

struct brdf_import {
    const char *source;
    struct import_brdf_wish wish;
    struct import_result result;
};

static gboolean work_brdf(const struct work *work, gpointer data, GError **error) {
    struct brdf_import *import = data;
    return import_brdf(output, import->source, &import->wish, work, &import->result, error);
}

static int run(const struct call *call, enum brdf_kind kind, GError **error) {
    const struct command *command = call->command;
    struct brdf_import import = {
        .source = call->arguments[0],
        .wish = {.kind = kind,
                 .coding = {divide, scale, coding && strcmp(coding, "srgb") == 0},
                 .texels = texels,
                 .texel_mm = texel_mm,
                 .directions = directions}};
    double seconds = 0;
    if (!output)
        return cli_usage(command, "no session directory is given: give -o DIR.session");
    if (texels < 1 || texels > MAX_TEXELS)
        return cli_usage(command, "--texels=%d is out of range: 1 to %d", texels, MAX_TEXELS);
    if (!(texel_mm >= 0 && texel_mm <= 1000))
        return cli_usage(command, "--texel-mm=%g is out of range: 0 to 1000 mm", texel_mm);
    if (coding && strcmp(coding, "linear") != 0 && strcmp(coding, "srgb") != 0)
        return cli_usage(command, "there is no --coding=%s; choose from: linear, srgb", coding);
    if (!(divide > 0 && divide < 1e9))
        return cli_usage(command, "--divide=%g is out of range: above 0, below 1e9", divide);
    if (!(scale > 0 && scale < 1e9))
        return cli_usage(command, "--scale=%g is out of range: above 0, below 1e9", scale);
    if (!cli_work_run(work_brdf, &import, &seconds, error))
        return CLI_FAILED;
    exchange_tell_import(call->record, output, &import.result, seconds);
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
    .help = "Import a BRDF of the RGL material database.",
    .options = entries,
    .min = 1,
    .max = 1,
    .run = bsdf_run};
const struct command exchange_import_merl = {
    .name = "import merl",
    .arguments = "FILE.binary -o DIR",
    .examples = "  mesorig import merl gold.binary -o gold.session\n",
    .help = "Import a BRDF of the MERL database.",
    .options = entries,
    .min = 1,
    .max = 1,
    .run = merl_run};
const struct command exchange_import_utia = {
    .name = "import utia",
    .arguments = "FILE -o DIR",
    .examples = "  mesorig import utia m003_carpet.bin -o carpet.session\n",
    .help = "Import a BRDF of the UTIA database (.bin, .exr).",
    .options = utia_entries,
    .min = 1,
    .max = 1,
    .run = utia_run};
