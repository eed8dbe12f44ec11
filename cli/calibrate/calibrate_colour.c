/* calibrate colour: finds a colour matrix from a captured and processed colour chart. */
#include "base/input_file.h"
#include "calibrate.h"
#include "targets/chart_session.h"

#include <math.h>

#define MAX_CHART_BYTES (1 << 20)
/* A relative difference from the brightness of the chart's values that exceeds this is reported. */
#define BRIGHTNESS 0.2

static char *chart_option;
static const GOptionEntry entries[] = {
    {"chart", 0, 0, G_OPTION_ARG_FILENAME, &chart_option,
     "The chart's patches: lines x_mm,y_mm,radius_mm,X,Y,Z with Y = 1 for white", "FILE"},
    CALIBRATE_OUTPUT("Write the calibration here"),
    CALIBRATE_FROM("Add to this calibration. Default: the output file if it exists, otherwise the "
                   "calibration of the session"),
    CALIBRATE_INCOMPLETE,
    {NULL},
};

static gboolean find(struct calibrate_job *job, GError **error) {
    g_autoptr(Session) session = calibrate_open(job, 0, error);
    g_autofree char *text =
        session ? input_file_read_text(chart_option, MAX_CHART_BYTES, error) : NULL;
    g_autoptr(GArray) fields = text ? chart_parse(text, chart_option, error) : NULL;
    if (!fields)
        return FALSE;
    g_autofree struct colour_patch *patches = g_new0(struct colour_patch, fields->len + 1);
    return chart_session(session, fields, patches, error) &&
           colour_fit(patches, (int)fields->len, &job->calibration->colour, error);
}

static void tell(Record *to, const struct calibrate_job *job) {
    const struct colour_matrix *colour = &job->calibration->colour;
    const double white = colour->matrix[3] + colour->matrix[4] + colour->matrix[5];
    record_say(to, "%d{patches} patches, %.2f{delta_e} ΔE*ab RMS\n", colour->patches,
               colour->residual);
    record_double(to, "white", white);
    record_doubles(to, "matrix", colour->matrix, 9);
    for (int i = 0; i < 9; i += 3)
        record_say(to, "  %c = %+.4f R %+.4f G %+.4f B   ± %.4f %.4f %.4f\n", "XYZ"[i / 3],
                   colour -> matrix[i], colour -> matrix[i + 1], colour -> matrix[i + 2],
                   colour -> error[i], colour -> error[i + 1], colour -> error[i + 2]);
    if (!(fabs(log(white)) < log(1 + BRIGHTNESS)))
        record_say(to,
                   "  suspect: the pictures show the chart %.3g times as bright as its values say, "
                   "and the matrix corrects that for every material; calibrate radiometry with the "
                   "white tile first, and see whether Y is 1 for white in the chart's file\n",
                   1 / white);
}

static int run(const struct call *call, GError **error) {
    static const struct calibrate_method method = {find, tell, .adds = TRUE};
    struct calibrate_job job = {0};
    if (!chart_option)
        return cli_usage(call->command, "no chart is given: give --chart FILE");
    return calibrate_run(call, &method, &job, error);
}

const struct command calibrate_colour = {
    .name = "calibrate colour",
    .arguments = "SESSION --chart FILE -o FILE",
    .examples = "  mesorig calibrate colour chart.session --chart chart.csv -c rig.calibration -o "
                "rig.calibration\n",
    .help = "Find the colour matrix of the cameras, from a captured and processed colour chart.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
