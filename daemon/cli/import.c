/* import: other people's measurements, made into a session. */
#include "cli.h"
#include "formats/import_poses.h"
#include "plan/report.h"
#include "work.h"

#include <stdio.h>
#include <string.h>

#define LARGEST_MM 10000

static char *output, *region, *calibration, *sample, *cfa, *edge;
static double texel_mm, reference_mm, depth_mm, threshold_dn = 40;
static int texels = 64;

static const GOptionEntry entries[] = {
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output, "The session to make", "DIR"},
    {"texel", 't', 0, G_OPTION_ARG_DOUBLE, &texel_mm, "How wide a texel is, in mm", "MM"},
    {"region", 'r', 0, G_OPTION_ARG_STRING, &region, "Only these texels", "X,Y,WIDTH,HEIGHT"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration, "poses: the rig's", "FILE"},
    {"sample", 's', 0, G_OPTION_ARG_STRING, &sample, "poses: the sample's size in mm",
     "WIDTHxHEIGHT"},
    {"texels", 'n', 0, G_OPTION_ARG_INT, &texels, "poses: texels across (64)", "N"},
    {"reference", 0, 0, G_OPTION_ARG_DOUBLE, &reference_mm,
     "poses: how high the reference plane lies (0)", "MM"},
    {"depth", 0, 0, G_OPTION_ARG_DOUBLE, &depth_mm, "poses: how deep the structure is (0)", "MM"},
    {"cfa", 0, 0, G_OPTION_ARG_STRING, &cfa, "poses: the colour filter of grey pictures (mono)",
     "mono|rggb|bggr|grbg|gbrg"},
    {"edge", 0, 0, G_OPTION_ARG_STRING, &edge, "poses: what sweeps show (line)",
     "line|darkens|lightens"},
    {"threshold", 0, 0, G_OPTION_ARG_DOUBLE, &threshold_dn,
     "poses: the least peak of a sweep, of 4095 (40)", "DN"},
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
};

struct job {
    const struct kind *kind;
    const char *source;
    struct import_wish wish;
    struct import_result result;
};

static gboolean cli_import_work(const struct work *work, gpointer data, GError **error) {
    struct job *job = data;
    return job->kind->import(output, job->source, &job->wish, work, &job->result, error);
}

static void cli_import_tell(const struct job *job, double seconds) {
    const struct import_result *result = &job->result;
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "session", g_variant_new_string(output));
        g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->n_views));
        g_variant_builder_add(&builder, "{sv}", "lights", g_variant_new_int32(result->n_lights));
        g_variant_builder_add(&builder, "{sv}", "width", g_variant_new_int32(result->width));
        g_variant_builder_add(&builder, "{sv}", "height", g_variant_new_int32(result->height));
        g_variant_builder_add(&builder, "{sv}", "holes", g_variant_new_int64(result->holes));
        g_variant_builder_add(&builder, "{sv}", "eigenmaps_error",
                              g_variant_new_double(result->eigenmaps_error));
        g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
        cli_print_json(g_variant_builder_end(&builder));
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_print("%s: %d × %d texels, %d views × %d lights in %s; eigen-maps with an error of %.2f %%\n",
            output, result->width, result->height, result->n_views, result->n_lights, time,
            100 * result->eigenmaps_error);
    if (result->holes > 0)
        g_print("%" G_GINT64_FORMAT
                " texels of its pictures are missing or no numbers, and are 0\n",
                result->holes);
}

static gboolean parse_region(const char *text, struct import_region *ret) {
    char more;
    return sscanf(text, "%d,%d,%d,%d%c", &ret->x, &ret->y, &ret->width, &ret->height, &more) == 4 &&
           ret->x >= 0 && ret->y >= 0 && ret->width > 0 && ret->height > 0;
}

struct poses_job {
    struct import_poses poses;
    struct import_poses_result result;
};

static gboolean work_poses(const struct work *work, gpointer data, GError **error) {
    struct poses_job *job = data;
    return import_poses(output, &job->poses, work, &job->result, error);
}

static void tell_poses(const struct import_poses_result *result, double seconds) {
    if (cli_json) {
        GVariantBuilder builder;
        g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
        g_variant_builder_add(&builder, "{sv}", "session", g_variant_new_string(output));
        g_variant_builder_add(&builder, "{sv}", "views", g_variant_new_int32(result->n_views));
        g_variant_builder_add(&builder, "{sv}", "lights", g_variant_new_int32(result->n_lights));
        g_variant_builder_add(&builder, "{sv}", "lasers", g_variant_new_int32(result->n_lasers));
        g_variant_builder_add(&builder, "{sv}", "frames", g_variant_new_int32(result->n_frames));
        g_variant_builder_add(&builder, "{sv}", "missing", g_variant_new_int32(result->n_missing));
        g_variant_builder_add(&builder, "{sv}", "not_numbers",
                              g_variant_new_int64(result->not_numbers));
        g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
        cli_print_json(g_variant_builder_end(&builder));
        return;
    }
    g_autofree char *time = report_duration(seconds);
    g_print("%s: %d views, %d lights, %d laser positions, %d frames in %s; “mesorig process” makes "
            "BTF and MDF\n",
            output, result->n_views, result->n_lights, result->n_lasers, result->n_frames, time);
    if (result->n_missing > 0)
        g_print("%d pictures of sweeps are missing; what they would have shown is not seen\n",
                result->n_missing);
    if (result->not_numbers > 0)
        g_print("%" G_GINT64_FORMAT " pixels are no numbers\n", result->not_numbers);
}

static gboolean parse_edge(const char *text, enum import_edge *ret) {
    static const char *const names[] = {"line", "darkens", "lightens"};
    for (guint i = 0; i < G_N_ELEMENTS(names); i++)
        if (strcmp(text, names[i]) == 0) {
            *ret = (enum import_edge)i;
            return TRUE;
        }
    return FALSE;
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

static int run_poses(const struct command *command, const char *table) {
    static const char *const filters[] = {"mono", "rggb", "bggr", "grbg", "gbrg", NULL};
    g_autoptr(GError) error = NULL;
    struct poses_job job = {.poses = {.table = table,
                                      .calibration = calibration,
                                      .cfa = cfa ? cfa : "mono",
                                      .threshold_dn = threshold_dn}};
    double seconds = 0;
    if (!calibration)
        return cli_usage(command, "where are cameras and lamps? Give --calibration FILE");
    if (!parse_grid(&job.poses.grid))
        return cli_usage(command, "--sample needs WIDTHxHEIGHT in mm, --texels 1 to 8192, --depth "
                                  "millimetres");
    if (!g_strv_contains(filters, job.poses.cfa))
        return cli_usage(command, "--cfa is mono, rggb, bggr, grbg or gbrg");
    if (edge && !parse_edge(edge, &job.poses.edge))
        return cli_usage(command, "--edge is line, darkens or lightens");
    if (!cli_work_run(work_poses, &job, &seconds, &error))
        return cli_fail(error);
    tell_poses(&job.result, seconds);
    return CLI_DONE;
}

static int cli_import_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    struct job job = {0};
    double seconds = 0;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 2, 2))
        return CLI_USAGE;
    if (!output)
        return cli_usage(command, "where to? Give -o DIR.session");
    if (strcmp(argv[1], "poses") == 0)
        return run_poses(command, argv[2]);
    for (gsize i = 0; i < G_N_ELEMENTS(kinds); i++)
        if (strcmp(argv[1], kinds[i].name) == 0)
            job.kind = &kinds[i];
    if (!job.kind)
        return cli_usage(command, "“%s” is none of btf, pictures, rti, poses", argv[1]);
    if (texel_mm < 0 || texel_mm > 1000)
        return cli_usage(command, "--texel needs millimetres");
    if (region && !parse_region(region, &job.wish.region))
        return cli_usage(command, "--region needs X,Y,WIDTH,HEIGHT in texels");
    job.source = argv[2];
    job.wish.texel_mm = texel_mm;
    if (!cli_work_run(cli_import_work, &job, &seconds, &error))
        return cli_fail(error);
    cli_import_tell(&job, seconds);
    return CLI_DONE;
}

const struct command cli_import = {
    .name = "import",
    .arguments = "KIND SOURCE -o DIR",
    .help = "Make a session of what others have measured. KIND: btf (a file "
            "of Bonn's), pictures (a folder, "
            "names with tl… pl… tv… pv…), rti (an .lp list of lights), "
            "poses (a table of pictures and poses).",
    .run_arguments = cli_import_run};
