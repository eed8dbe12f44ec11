/* calibrate colour: a colour matrix from a captured and processed colour chart. */
#include "base/input_file.h"
#include "calibrate.h"
#include "targets/chart_session.h"

#define MAX_CHART_BYTES (1 << 20)

static char *chart_option, *output_option, *calibration_option;
static const GOptionEntry entries[] = {
    {"chart", 0, 0, G_OPTION_ARG_FILENAME, &chart_option,
     "What is known of its patches: lines x_mm,y_mm,radius_mm,X,Y,Z with Y = 1 for white", "FILE"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option, "Write the calibration here", "FILE"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration_option,
     "Add to this calibration. Default: the file that is written, if it is there; else that of the "
     "session",
     "FILE"},
    {NULL},
};

static void cli_calibrate_colour_tell(const struct colour_matrix *colour) {
    GVariantBuilder builder;
    if (!cli_json) {
        g_print("%s: %d patches, %.2f ΔE*ab RMS\n", output_option, colour->patches,
                colour->residual);
        for (int i = 0; i < 9; i += 3)
            g_print("  %c = %+.4f R %+.4f G %+.4f B   ± %.4f %.4f %.4f\n", "XYZ"[i / 3],
                    colour -> matrix[i], colour -> matrix[i + 1], colour -> matrix[i + 2],
                    colour -> error[i], colour -> error[i + 1], colour -> error[i + 2]);
        return;
    }
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output_option));
    g_variant_builder_add(&builder, "{sv}", "patches", g_variant_new_int32(colour->patches));
    g_variant_builder_add(&builder, "{sv}", "delta_e", g_variant_new_double(colour->residual));
    g_variant_builder_add(
        &builder, "{sv}", "matrix",
        g_variant_new_fixed_array(G_VARIANT_TYPE_DOUBLE, colour->matrix, 9, sizeof(double)));
    cli_print_json(g_variant_builder_end(&builder));
}

static gboolean cli_calibrate_colour_calibrate(const char *path, GError **error) {
    const char *from = calibration_option ? calibration_option : output_option;
    g_autofree char *text = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, error);
    g_autoptr(Calibration) calibration = session ? calibrate_begin(from, session, error) : NULL;
    if (!calibration || !(text = input_file_read_text(chart_option, MAX_CHART_BYTES, error)))
        return FALSE;
    g_autoptr(GArray) fields = chart_parse(text, chart_option, error);
    if (!fields)
        return FALSE;
    g_autofree struct colour_patch *patches = g_new0(struct colour_patch, fields->len + 1);
    if (!chart_session(session, fields, patches, error) ||
        !colour_fit(patches, (int)fields->len, &calibration->colour, error) ||
        !calibration_write(calibration, output_option, error))
        return FALSE;
    cli_calibrate_colour_tell(&calibration->colour);
    return TRUE;
}

static int cli_calibrate_colour_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    if (!chart_option)
        return cli_usage(command, "which chart? Give --chart FILE");
    if (!output_option)
        return cli_usage(command, "where to? Give -o FILE");
    return cli_calibrate_colour_calibrate(argv[1], &error) ? CLI_DONE : cli_fail(error);
}

const struct command calibrate_colour = {
    .name = "calibrate colour",
    .arguments = "SESSION --chart FILE -o FILE",
    .help = "Find the colour matrix of the cameras, from a captured and processed colour chart.",
    .run_arguments = cli_calibrate_colour_run};
