/* import: other people's measurements, made into a session. */
#include "command/work.h"
#include "exchange.h"
#include "formats/import_poses.h"
#include "formats/nominal.h"
#include "plan/report.h"

#include <stdio.h>
#include <string.h>

#define LARGEST_MM 10000

static char *output, *region, *calibration, *sample, *cfa, *edge;
static double texel_mm, reference_mm, depth_mm, threshold_dn = 40, same_light_deg;
static gboolean target, template;
static int texels = 64;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The session to make", "DIR"},
    {"texel", 0, 0, G_OPTION_ARG_DOUBLE, &texel_mm, "How wide a texel is, in mm", "MM"},
    {"region", 0, 0, G_OPTION_ARG_STRING, &region, "Only these texels", "X,Y,WIDTH,HEIGHT"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration,
     "poses: of the rig, or its nominal values", "FILE"},
    {"sample", 's', 0, G_OPTION_ARG_STRING, &sample, "poses: the sample's size in mm",
     "WIDTHxHEIGHT"},
    {"texels", 0, 0, G_OPTION_ARG_INT, &texels, "poses: texels across (64)", "N"},
    {"reference", 0, 0, G_OPTION_ARG_DOUBLE, &reference_mm,
     "poses: how high the reference plane lies (0)", "MM"},
    {"depth", 0, 0, G_OPTION_ARG_DOUBLE, &depth_mm, "poses: how deep the structure is (0)", "MM"},
    {"cfa", 0, 0, G_OPTION_ARG_STRING, &cfa, "poses: the colour filter of grey pictures (mono)",
     "mono|rggb|bggr|grbg|gbrg"},
    {"edge", 0, 0, G_OPTION_ARG_STRING, &edge,
     "poses: what sweeps show: line, darkens or lightens (line)", "line|darkens|lightens"},
    {"threshold", 0, 0, G_OPTION_ARG_DOUBLE, &threshold_dn,
     "poses: the least peak of a sweep, of 4095 (40)", "DN"},
    {"same-light", 0, 0, G_OPTION_ARG_DOUBLE, &same_light_deg,
     "poses: lamps whose directions differ by at most this angle are one light (0: none)", "DEG"},
    {"target", 0, 0, G_OPTION_ARG_NONE, &target,
     "poses: pictures of a calibration target, whose views need not have every light", NULL},
    {"template", 0, 0, G_OPTION_ARG_NONE, &template,
     "poses: write a file of nominal values to fill in, for -c, and import nothing", NULL},
    {NULL},
};

typedef gboolean (*Import)(const char *path, const char *source, const struct import_wish *wish,
                           const struct work *work, struct import_result *ret, GError **error);

static const struct kind {
    const char *name;
    Import import;
} kinds[] = {
    {"btf", import_bonn},
    {"pictures", import_pictures},
    {"rti", import_rti},
    {"relight", import_relight},
};

struct job {
    const struct kind *kind;
    const char *source;
    struct import_wish wish;
    struct import_result result;
};

static gboolean import_command_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return job->kind->import(output, job->source, &job->wish, work, &job->result, error);
}

static void import_command_tell(Record *to, const struct import_result *result, double seconds) {
    g_autofree char *time = report_duration(seconds);
    record_string(to, "session", output);
    record_int(to, "views", result->n_views);
    record_int(to, "lights", result->n_lights);
    record_int(to, "width", result->width);
    record_int(to, "height", result->height);
    record_int(to, "holes", result->holes);
    record_double(to, "eigenmaps_error", result->eigenmaps_error);
    record_double(to, "real_s", seconds);
    record_say(to,
               "%s: %d × %d texels, %d views × %d lights in %s; eigen-maps with an error of %.2f "
               "%%\n",
               output, result->width, result->height, result->n_views, result->n_lights, time,
               100 * result->eigenmaps_error);
    if (result->holes > 0)
        record_say(to,
                   "%" G_GINT64_FORMAT
                   " texels of its pictures are missing or not numbers; they are set to 0\n",
                   result->holes);
}

struct poses_job {
    struct import_poses poses;
    struct import_poses_result result;
};

static gboolean work_poses(const struct work *work, gpointer data, GError **error) {
    struct poses_job *job = data;
    return import_poses(output, &job->poses, work, &job->result, error);
}

static void tell_poses(Record *to, const struct import_poses_result *result, double seconds) {
    g_autofree char *time = report_duration(seconds);
    record_string(to, "session", output);
    record_int(to, "views", result->n_views);
    record_int(to, "lights", result->n_lights);
    record_int(to, "lasers", result->n_lasers);
    record_int(to, "frames", result->n_frames);
    record_int(to, "missing", result->n_missing);
    record_int(to, "not_numbers", result->not_numbers);
    record_double(to, "real_s", seconds);
    record_say(to,
               "%s: %d views, %d lights, %d laser positions, %d frames in %s; “mesorig process” "
               "makes BTF and MDF\n",
               output, result->n_views, result->n_lights, result->n_lasers, result->n_frames, time);
    if (result->n_missing > 0)
        record_say(
            to,
            "%d pictures of sweeps are missing; the surface that only they show is not measured\n",
            result->n_missing);
    if (result->not_numbers > 0)
        record_say(to, "%" G_GINT64_FORMAT " pixels are not numbers\n", result->not_numbers);
}

static gboolean parse_grid(struct session_grid *ret) {
    char more;
    *ret =
        (struct session_grid){.width = texels, .reference_mm = reference_mm, .depth_mm = depth_mm};
    if (!sample || sscanf(sample, "%lfx%lf%c", &ret->width_mm, &ret->height_mm, &more) != 2 ||
        !(ret->width_mm > 0 && ret->width_mm <= LARGEST_MM) ||
        !(ret->height_mm > 0 && ret->height_mm <= LARGEST_MM) || texels < 1 || texels > 8192 ||
        !(depth_mm >= 0))
        return FALSE;
    ret->height = (int)(ret->height_mm / ret->width_mm * texels + 0.5);
    return ret->height >= 1 && ret->height <= 8192;
}

/* Writes the file of nominal values that -o names, which must not exist. */
static int write_template(const struct call *call, GError **error) {
    g_autofree char *text = nominal_template(call->arguments[1], error);
    if (!text)
        return CLI_FAILED;
    if (g_file_test(output, G_FILE_TEST_EXISTS)) {
        g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_EXIST,
                    "%s: exists already; take another name", output);
        return CLI_FAILED;
    }
    if (!g_file_set_contents(output, text, -1, error))
        return CLI_FAILED;
    record_string(call->record, "file", output);
    record_say(call->record,
               "%s: replace each ? by its value, and give the file to import poses with -c\n",
               output);
    return CLI_DONE;
}

static int run_poses(const struct call *call, GError **error) {
    static const char *const filters[] = {"mono", "rggb", "bggr", "grbg", "gbrg", NULL};
    static const char *const edges[] = {"line", "darkens", "lightens", NULL}; /* enum import_edge */
    const struct command *command = call->command;
    struct poses_job job = {.poses = {.table = call->arguments[1],
                                      .calibration = calibration,
                                      .cfa = cfa ? cfa : "mono",
                                      .threshold_dn = threshold_dn,
                                      .same_light_deg = same_light_deg,
                                      .target = target}};
    double seconds = 0;
    if (template)
        return write_template(call, error);
    if (!calibration)
        return cli_usage(command,
                         "no calibration of cameras and lamps is given: give --calibration FILE, "
                         "which --template writes to be filled in");
    if (!parse_grid(&job.poses.grid))
        return cli_usage(command, "--sample needs WIDTHxHEIGHT in mm, --texels 1 to 8192, --depth "
                                  "millimetres");
    if (!(same_light_deg >= 0 && same_light_deg <= 45))
        return cli_usage(command, "--same-light=%g is out of range: 0 to 45 degrees",
                         same_light_deg);
    if (!g_strv_contains(filters, job.poses.cfa))
        return cli_usage(command, "there is no --cfa=%s; choose from: mono, rggb, bggr, grbg, gbrg",
                         cfa);
    while (edge && edges[job.poses.edge] && strcmp(edge, edges[job.poses.edge]) != 0)
        job.poses.edge++;
    if (!edges[job.poses.edge])
        return cli_usage(command, "there is no --edge=%s; choose from: line, darkens, lightens",
                         edge);
    if (!cli_work_run(work_poses, &job, &seconds, error))
        return CLI_FAILED;
    tell_poses(call->record, &job.result, seconds);
    return CLI_DONE;
}

static int import_command_run(const struct call *call, GError **error) {
    const struct command *command = call->command;
    const char *kind = call->arguments[0];
    struct job job = {.source = call->arguments[1], .wish.texel_mm = texel_mm};
    struct import_region *wish = &job.wish.region;
    double seconds = 0;
    char more;
    if (!output)
        return cli_usage(command, "no session to make is given: give -o DIR.session");
    if (strcmp(kind, "poses") == 0)
        return run_poses(call, error);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (strcmp(kind, kinds[i].name) == 0)
            job.kind = &kinds[i];
    if (!job.kind)
        return cli_usage(command,
                         "there is no KIND “%s”; choose from: btf, pictures, rti, "
                         "relight, poses",
                         kind);
    if (texel_mm < 0 || texel_mm > 1000)
        return cli_usage(command, "--texel=%g is out of range: 0 to 1000 mm", texel_mm);
    if (region && (sscanf(region, "%d,%d,%d,%d%c", &wish->x, &wish->y, &wish->width, &wish->height,
                          &more) != 4 ||
                   wish->x < 0 || wish->y < 0 || wish->width <= 0 || wish->height <= 0))
        return cli_usage(command, "--region=%s: give X,Y,WIDTH,HEIGHT in texels", region);
    if (!cli_work_run(import_command_work, &job, &seconds, error))
        return CLI_FAILED;
    import_command_tell(call->record, &job.result, seconds);
    return CLI_DONE;
}

static const char *const kind_words[] = {"btf", "pictures", "rti", "relight", "poses", NULL};

const struct command exchange_import = {
    .words = kind_words,
    .name = "import",
    .arguments = "KIND SOURCE -o DIR",
    .examples = "  mesorig import btf wool.btf -o wool.session\n"
                "  mesorig import poses poses.csv -c nominal.conf -s 36x36 -o print.session\n",
    .help = "Make a session of data that others have measured. KIND: btf (a file "
            "of Bonn's), pictures (a folder, "
            "names with tl… pl… tv… pv…), rti (a list of lights), "
            "relight (an info.json with its planes), "
            "poses (a table of pictures and poses).",
    .options = entries,
    .min = 2,
    .max = 2,
    .run = import_command_run};
