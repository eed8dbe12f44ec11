/* import poses: makes a session of pictures from any rig, with a table of their poses. */
#include "formats/import_poses.h"
#include "base/plural.h"
#include "common/work.h"
#include "exchange.h"
#include "formats/nominal.h"

#include <stdio.h>
#include <string.h>

#define LARGEST_MM 10000

static char *output, *calibration, *sample, *cfa, *edge, *transfer;
static double reference_mm, depth_mm, threshold_dn = 40, same_light_deg;
static gboolean target, template;
static int texels = 64;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "Session directory to make", "DIR"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration,
     "Calibration of the rig, or a file of its nominal values", "FILE"},
    {"sample", 's', 0, G_OPTION_ARG_STRING, &sample, "Size of the sample in mm", "WIDTHxHEIGHT"},
    {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "Number of texels across the sample (64)", "N"},
    {"reference", 0, 0, G_OPTION_ARG_DOUBLE, &reference_mm,
     "Height of the reference plane above the turntable in mm (0)", "MM"},
    {"depth", 0, 0, G_OPTION_ARG_DOUBLE, &depth_mm,
     "Depth of the structure below the reference plane in mm (0)", "MM"},
    {"cfa", 0, 0, G_OPTION_ARG_STRING, &cfa, "Colour filter of grey pictures (mono)",
     "mono|rggb|bggr|grbg|gbrg"},
    {"transfer", 0, 0, G_OPTION_ARG_STRING, &transfer, EXCHANGE_TRANSFER_HELP, "linear|srgb"},
    {"edge", 0, 0, G_OPTION_ARG_STRING, &edge,
     "What sweeps show: a line, or an edge behind which pixels are darker or lighter (line)",
     "line|darkens|lightens"},
    {"threshold", 0, 0, G_OPTION_ARG_DOUBLE, &threshold_dn,
     "Minimum height of the peaks of a sweep above the background, in DN of 0 to 4095 (40)", "DN"},
    {"same-light", 0, 0, G_OPTION_ARG_DOUBLE, &same_light_deg,
     "Lamps whose directions differ by at most this angle are one light (0)", "DEG"},
    {"target", 0, 0, G_OPTION_ARG_NONE, &target,
     "The pictures show a calibration target: views need not have every light", NULL},
    {"template", 0, 0, G_OPTION_ARG_NONE, &template,
     "Import nothing, but write to the file of -o nominal values to fill in, for -c", NULL},
    {NULL},
};

struct poses_import {
    struct import_poses poses;
    struct import_poses_result result;
};

static gboolean work_poses(const struct work *work, gpointer data, GError **error) {
    struct poses_import *import = data;
    return import_poses(output, &import->poses, work, &import->result, error);
}

static void tell_poses(Record *to, const struct import_poses_result *result, double seconds) {
    record_say(to,
               "%s{session}: %d{views} %s, %d{lights} %s, %d{lasers} laser %s, %d{frames} %s in "
               "%g{:time}; “mesorig process” makes BTF and MDF\n",
               output, PLURAL(result->n_views, "view"), PLURAL(result->n_lights, "light"),
               PLURAL(result->n_lasers, "position"), PLURAL(result->n_frames, "frame"), seconds);
    record_say_if(to, result->n_missing > 0,
                  "%d{missing} pictures of sweeps are missing; the surface that only they show is "
                  "not measured\n",
                  result->n_missing);
    record_say_if(to, result->not_numbers > 0,
                  "%" G_GINT64_FORMAT "{not_numbers} pixels are not numbers; they are left out\n",
                  result->not_numbers);
    record_double(to, "real_s", seconds);
}

/* Fills *ret from the options. Returns NULL, or a text that says what is wrong with the options. */
static const char *parse_grid(struct session_grid *ret) {
    char more;
    *ret =
        (struct session_grid){.width = texels, .reference_mm = reference_mm, .depth_mm = depth_mm};
    if (!sample)
        return "no size of the sample is given: give --sample WIDTHxHEIGHT in mm";
    if (sscanf(sample, "%lfx%lf%c", &ret->width_mm, &ret->height_mm, &more) != 2 ||
        !(ret->width_mm > 0 && ret->width_mm <= LARGEST_MM) ||
        !(ret->height_mm > 0 && ret->height_mm <= LARGEST_MM))
        return "--sample is not WIDTHxHEIGHT in mm, each above 0 and at most 10000";
    if (texels < 1 || texels > 8192)
        return "--texels is out of range: 1 to 8192";
    if (!(depth_mm >= 0))
        return "--depth is out of range: 0 mm or more";
    ret->height = (int)(ret->height_mm / ret->width_mm * texels + 0.5);
    return ret->height >= 1 && ret->height <= 8192 ? NULL
                                                   : "--sample is not 1 to 8192 texels high with "
                                                     "the width of --texels: change --texels";
}

/* Writes the file of nominal values to -o. The user fills in this file. Returns an exit code. */
static int write_template(const struct call *call, GError **error) {
    /* An existing file is replaced only with --force, because somebody may have filled in its
     * values. */
    g_autoptr(OutputFile) to = cli_output(output, NULL, error);
    g_autofree char *text = to ? nominal_template(call->arguments[0], error) : NULL;
    if (!text || !output_file_put(to, text, strlen(text), error))
        return CLI_FAILED;
    record_say(call->record,
               "%s{file}: replace each ? by its value, and give the file to import poses with -c\n",
               output);
    return CLI_DONE;
}

static int run(const struct call *call, GError **error) {
    static const char *const filters[] = {"mono", "rggb", "bggr", "grbg", "gbrg", NULL};
    static const char *const edges[] = {"line", "darkens", "lightens", NULL}; /* enum import_edge */
    const struct command *command = call->command;
    g_autoptr(GPtrArray) notes = g_ptr_array_new_with_free_func(g_free);
    struct poses_import import = {.poses = {.table = call->arguments[0],
                                            .calibration = calibration,
                                            .cfa = cfa ? cfa : "mono",
                                            .threshold_dn = threshold_dn,
                                            .same_light_deg = same_light_deg,
                                            .notes = notes,
                                            .target = target}};
    double seconds = 0;
    if (!output)
        return cli_usage(command, template ? "no file to write is given: give -o FILE"
                                           : "no session directory is given: give -o DIR.session");
    if (template)
        return write_template(call, error);
    if (!calibration)
        return cli_usage(command,
                         "no calibration of cameras and lamps is given: give --calibration FILE; "
                         "--template writes such a file to fill in");
    const char *wrong = parse_grid(&import.poses.grid);
    if (wrong)
        return cli_usage(command, "%s", wrong);
    if (!(same_light_deg >= 0 && same_light_deg <= 45))
        return cli_usage(command, "--same-light=%g is out of range: 0 to 45 degrees",
                         same_light_deg);
    if (!g_strv_contains(filters, import.poses.cfa))
        return cli_usage(command, "there is no --cfa=%s; choose from: mono, rggb, bggr, grbg, gbrg",
                         cfa);
    while (edge && edges[import.poses.edge] && strcmp(edge, edges[import.poses.edge]) != 0)
        import.poses.edge++;
    if (!edges[import.poses.edge])
        return cli_usage(command, "there is no --edge=%s; choose from: line, darkens, lightens",
                         edge);
    if (!exchange_parse_transfer(transfer, &import.poses.transfer))
        return cli_usage(command, EXCHANGE_TRANSFER_WRONG, transfer);
    if (!cli_work_run(work_poses, &import, &seconds, error))
        return CLI_FAILED;
    tell_poses(call->record, &import.result, seconds);
    record_say_strings(call->record, "notes", "", notes);
    return CLI_DONE;
}

const struct command exchange_import_poses = {
    .name = "import poses",
    .arguments = "TABLE -o DIR",
    .examples = "  mesorig import poses poses.csv -c nominal.conf -s 36x36 -o print.session\n",
    .help = "Import pictures from any rig, with a table of poses.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
