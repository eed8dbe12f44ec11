/* import btf, pictures, rti, relight, ptm: make sessions of finished BTFs. */
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"
#include "formats/reflectance/import_brdf.h"

#include <stdio.h>

static char *output, *region, *directions, *transfer;
static double texel_mm, lamp_mm;

#define SHARED_ENTRIES                                                                             \
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Session directory to make", "DIR"},        \
        {"texel-mm", 0,                                                                            \
         0,          G_OPTION_ARG_DOUBLE,                                                          \
         &texel_mm,  "Width of a texel (as the file says, otherwise 1)",                           \
         "MM"},                                                                                    \
    {                                                                                              \
        "region", 0, 0, G_OPTION_ARG_STRING, &region, "Import only these texels",                  \
            "X,Y,WIDTH,HEIGHT"                                                                     \
    }

static const GOptionEntry entries[] = {SHARED_ENTRIES, {NULL}};

static const GOptionEntry picture_entries[] = {
    SHARED_ENTRIES,
    {"transfer", 0, 0, G_OPTION_ARG_STRING, &transfer, EXCHANGE_TRANSFER_HELP, "linear|srgb"},
    {NULL},
};

static const GOptionEntry rti_entries[] = {
    SHARED_ENTRIES,
    {"transfer", 0, 0, G_OPTION_ARG_STRING, &transfer, EXCHANGE_TRANSFER_HELP, "linear|srgb"},
    {"lamp-mm", 0, 0, G_OPTION_ARG_DOUBLE, &lamp_mm,
     "Distance of near lamps from the middle of the texels (lamps far away)", "MM"},
    {NULL},
};

static const GOptionEntry ptm_entries[] = {
    SHARED_ENTRIES,
    {"directions", 'd', 0, G_OPTION_ARG_FILENAME, &directions,
     "Table of lights (the 81 directions of the papers)", "FILE"},
    {NULL},
};

typedef gboolean (*Import)(const char *path, const char *source, const struct import_wish *wish,
                           const struct work *work, struct import_result *ret, GError **error);

struct finished_import {
    Import import;
    const char *source;
    struct import_wish wish;
    struct import_result result;
};

static gboolean work_finished(const struct work *work, gpointer data, GError **error) {
    struct finished_import *finished = data;
    return finished->import(output, finished->source, &finished->wish, work, &finished->result,
                            error);
}

void exchange_tell_import(Record *to, const char *session, const struct import_result *result,
                          double seconds) {
    record_say(to,
               "%s{session}: %d{views} %s × %d{lights} %s of %d{width} × %d{height} texels in "
               "%g{:time}; eigen-maps with an error of %.2f{:%%} at the measured directions\n",
               session, PLURAL(result->n_views, "view"), PLURAL(result->n_lights, "light"),
               result->width, result->height, seconds, result->eigenmaps_error);
    record_say_if(to, result->holes > 0,
                  "%" G_GINT64_FORMAT
                  "{holes} texels of its pictures are missing or not numbers; they are set to 0\n",
                  result->holes);
    record_add(to, "%g{eigenmaps_error} %g{real_s}", result->eigenmaps_error, seconds);
}

gboolean exchange_parse_transfer(const char *text, enum picture_tones *ret) {
    *ret = !text                         ? PICTURE_TONES_UNSAID
           : g_str_equal(text, "linear") ? PICTURE_TONES_LINEAR
                                         : PICTURE_TONES_SRGB;
    return !text || g_str_equal(text, "linear") || g_str_equal(text, "srgb");
}

gboolean exchange_parse_region(const char *text, struct import_region *ret) {
    char more;
    return sscanf(text, "%d,%d,%d,%d%c", &ret->x, &ret->y, &ret->width, &ret->height, &more) == 4 &&
           ret->x >= 0 && ret->y >= 0 && ret->width > 0 && ret->height > 0;
}

static int run(const struct call *call, Import import, GError **error) {
    const struct command *command = call->command;
    g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
    struct finished_import finished = {
        .import = import,
        .source = call->arguments[0],
        .wish = {
            .texel_mm = texel_mm, .directions = directions, .lamp_mm = lamp_mm, .notes = notes}};
    double seconds = 0;
    if (!output)
        return cli_usage(command, "no session directory is given: give -o DIR.session");
    if (!(texel_mm >= 0 && texel_mm <= 1000))
        return cli_usage(command, "--texel-mm=%g is out of range: 0 to 1000 mm", texel_mm);
    if (!(lamp_mm >= 0 && lamp_mm <= 1e6))
        return cli_usage(command, "--lamp-mm=%g is out of range: 0 to 1000000 mm", lamp_mm);
    if (region && !exchange_parse_region(region, &finished.wish.region))
        return cli_usage(command, "--region=%s: give X,Y,WIDTH,HEIGHT in texels", region);
    if (!exchange_parse_transfer(transfer, &finished.wish.transfer))
        return cli_usage(command, EXCHANGE_TRANSFER_WRONG, transfer);
    if (!cli_work_run(work_finished, &finished, &seconds, error))
        return CLI_FAILED;
    exchange_tell_import(call->record, output, &finished.result, seconds);
    record_say_strings(call->record, "notes", "", notes);
    return CLI_DONE;
}

static gboolean ptm_with(const char *path, const char *source, const struct import_wish *wish,
                         const struct work *work, struct import_result *ret, GError **error) {
    return import_ptm(path, source, directions, wish, work, ret, error);
}

static int btf_run(const struct call *call, GError **error) {
    return run(call, import_bonn, error);
}
static int pictures_run(const struct call *call, GError **error) {
    return run(call, import_pictures, error);
}
static int rti_run(const struct call *call, GError **error) {
    return run(call, import_rti, error);
}
static int relight_run(const struct call *call, GError **error) {
    return run(call, import_relight, error);
}
static int ptm_run(const struct call *call, GError **error) {
    return run(call, ptm_with, error);
}

const struct command exchange_import_btf = {.name = "import btf",
                                            .arguments = "FILE.btf -o DIR",
                                            .examples =
                                                "  mesorig import btf wool.btf -o wool.session\n",
                                            .help = "Import a file of the BTF database of Bonn.",
                                            .options = entries,
                                            .min = 1,
                                            .max = 1,
                                            .run = btf_run};
const struct command exchange_import_pictures = {
    .name = "import pictures",
    .arguments = "DIR -o DIR",
    .examples = "  mesorig import pictures wool -o wool.session\n",
    .help = "Import a folder of pictures whose names give the directions (tl… pl… tv… pv…).",
    .options = picture_entries,
    .min = 1,
    .max = 1,
    .run = pictures_run};
const struct command exchange_import_rti = {
    .name = "import rti",
    .arguments = "FILE -o DIR",
    .examples = "  mesorig import rti coin.lp -o coin.session\n"
                "  mesorig import rti dome.csv --texel-mm 0.03 -o coin.session\n",
    .help = "Import a list of lights with its pictures (RTI).",
    .options = rti_entries,
    .min = 1,
    .max = 1,
    .run = rti_run};
const struct command exchange_import_relight = {
    .name = "import relight",
    .arguments = "FOLDER|FILE.json -o DIR",
    .examples = "  mesorig import relight coin -o coin.session\n"
                "  mesorig import relight coin/info.json -o coin.session\n",
    .help = "Import a folder that Relight has written: info.json and its planes.",
    .options = ptm_entries,
    .min = 1,
    .max = 1,
    .run = relight_run};
const struct command exchange_import_ptm = {
    .name = "import ptm",
    .arguments = "FILE -o DIR",
    .examples = "  mesorig import ptm coin.ptm -o coin.session\n",
    .help = "Import a PTM, or an RTI file with hemispherical harmonics (HSH).",
    .options = ptm_entries,
    .min = 1,
    .max = 1,
    .run = ptm_run};
