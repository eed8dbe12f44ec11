/* calibrate radiometry: cameras, lamps and marks from a captured white tile. */
#include "calibrate.h"
#include "targets/tile_session.h"
#include "work.h"

#include <string.h>

static char *reflectance_option, *tile_option, *output_option, *calibration_option;
static const GOptionEntry entries[] = {
    {"reflectance", 'r', 0, G_OPTION_ARG_STRING, &reflectance_option,
     "Of the tile, as its maker says: one number, or three for red, green and blue", "R[;G;B]"},
    {"tile", 't', 0, G_OPTION_ARG_STRING, &tile_option,
     "Its size in mm, if it is not that of the session's sample", "WxH"},
    {"output", 'o', 0, G_OPTION_ARG_FILENAME, &output_option, "Write the calibration here", "FILE"},
    {"calibration", 'c', 0, G_OPTION_ARG_FILENAME, &calibration_option,
     "Start from this calibration: of its geometry the light follows. Default: the file that is "
     "written, if it is there; else that of the session",
     "FILE"},
    {NULL},
};

struct job {
    Session *session;
    struct calibration *calibration;
    struct tile_options options;
    struct tile_result result;
};

static gboolean cli_calibrate_radiometry_work(const struct work *work, gpointer data,
                                              GError **error) {
    struct job *job = data;
    job->options.work = work;
    return tile_session(job->session, job->calibration, &job->options, &job->result, error) &&
           calibration_write(job->calibration, output_option, error);
}

static void cli_calibrate_radiometry_tell_json(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_RADIOMETRY];
    const struct tile_result *r = &job->result;
    GVariantBuilder builder;
    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "file", g_variant_new_string(output_option));
    g_variant_builder_add(&builder, "{sv}", "pictures", g_variant_new_int32(r->pictures));
    g_variant_builder_add(&builder, "{sv}", "rejected",
                          g_variant_new_strv((const char *const *)part->rejected->pdata,
                                             (gssize)part->rejected->len));
    g_variant_builder_add(&builder, "{sv}", "cells", g_variant_new_int32(r->cells));
    g_variant_builder_add(&builder, "{sv}", "residual", g_variant_new_double(r->residual));
    g_variant_builder_add(&builder, "{sv}", "quality", g_variant_new_double(r->quality));
    g_variant_builder_add(&builder, "{sv}", "drift", g_variant_new_double(r->drift));
    g_variant_builder_add(&builder, "{sv}", "marks", g_variant_new_int32(r->marks));
    g_variant_builder_add(&builder, "{sv}", "sensors", g_variant_new_int32(r->transfers));
    g_variant_builder_add(&builder, "{sv}", "real_s", g_variant_new_double(seconds));
    cli_print_json(g_variant_builder_end(&builder));
}

/* What the user should know of a sensor that is not as it should be. */
static void warn_of_sensors(const struct calibration *calibration) {
    for (int c = 0; c < calibration->rig.n_cameras; c++) {
        const struct transfer *t = &calibration->noise[c].transfer;
        if (calibration->noise[c].known && t->linearity > 0.01)
            g_printerr("camera %s is not linear: an exposure's signal is up to %.1f %% off. Switch "
                       "off its gamma and whatever else changes its values\n",
                       calibration->rig.cameras[c].name, 100 * t->linearity);
    }
}

static void cli_calibrate_radiometry_tell(const struct job *job, double seconds) {
    const struct calibration_part *part = &job->calibration->parts[CALIBRATION_RADIOMETRY];
    const struct tile_result *r = &job->result;
    if (cli_json) {
        cli_calibrate_radiometry_tell_json(job, seconds);
        return;
    }
    g_print("%s: %d pictures of the tile, %.2f %% RMS", output_option, r->pictures,
            100 * r->residual);
    if (part->rejected->len)
        g_print("; %u pictures are of no use", part->rejected->len);
    g_print(
        "\nlamps drifted by %.2f %% meanwhile; %d of %d marks and the noise of %d of %d cameras "
        "are calibrated as well\nmesorig calibrate show %s tells more\n",
        100 * r->drift, r->marks, job->calibration->rig.n_marks, r->transfers,
        job->calibration->rig.n_cameras, output_option);
    warn_of_sensors(job->calibration);
}

static gboolean parse_reflectance(double ret[3]) {
    g_auto(GStrv) words = g_strsplit(reflectance_option, ";", 4);
    guint n = g_strv_length(words);
    for (guint i = 0; i < 3 && (n == 1 || n == 3); i++) {
        const char *word = words[n == 3 ? i : 0];
        char *end = NULL;
        ret[i] = g_ascii_strtod(word, &end);
        if (end == word || *end != '\0' || !(ret[i] >= 0.05 && ret[i] <= 1.2))
            return FALSE;
    }
    return n == 1 || n == 3;
}

static gboolean parse_tile(struct tile_options *ret) {
    char *end = NULL;
    if (!tile_option)
        return TRUE;
    ret->width_mm = g_ascii_strtod(tile_option, &end);
    if (*end != 'x')
        return FALSE;
    ret->height_mm = g_ascii_strtod(end + 1, &end);
    return *end == '\0' && ret->width_mm > 5 && ret->height_mm > 5 && ret->width_mm < 1e5 &&
           ret->height_mm < 1e5;
}

/* Marks that the rig file knows of, where the calibration is older than they are. */
static gboolean cli_calibrate_radiometry_begin(struct job *job, GError **error) {
    const char *from = calibration_option ? calibration_option : output_option;
    g_autofree char *text = session_text(job->session, "calibration.conf", error);
    struct rig own;
    if (calibration_option && !g_file_test(calibration_option, G_FILE_TEST_EXISTS)) {
        g_set_error(error, G_FILE_ERROR, G_FILE_ERROR_NOENT, "%s: no such file",
                    calibration_option);
        return FALSE;
    }
    if (!text || !rig_from_text(&own, text, session_path(job->session), error) ||
        !(job->calibration = calibrate_begin(from, job->session, error)))
        return FALSE;
    struct rig *rig = &job->calibration->rig;
    if (rig->n_marks == 0) {
        memcpy(rig->marks, own.marks, sizeof rig->marks);
        rig->n_marks = own.n_marks;
    }
    return TRUE;
}

static int cli_calibrate_radiometry_run_job(const char *path) {
    g_autoptr(GError) error = NULL;
    struct job job = {0};
    double seconds = 0;
    parse_reflectance(job.options.reflectance);
    parse_tile(&job.options);
    job.session = session_open(path, SESSION_READ, &error);
    const gboolean ok = job.session && cli_calibrate_radiometry_begin(&job, &error) &&
                        cli_work_run(cli_calibrate_radiometry_work, &job, &seconds, &error);
    if (ok)
        cli_calibrate_radiometry_tell(&job, seconds);
    session_close(job.session);
    calibration_free(job.calibration);
    return ok ? CLI_DONE : cli_fail(error);
}

static int cli_calibrate_radiometry_run(const struct command *command, int argc, char **argv) {
    double reflectance[3];
    struct tile_options tile = {0};
    if (!cli_parse(command, entries, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    if (!reflectance_option || !parse_reflectance(reflectance))
        return cli_usage(command, "how much does the tile reflect? Give --reflectance, a number "
                                  "such as 0.98, or three separated by ';'");
    if (!parse_tile(&tile))
        return cli_usage(command, "how large is the tile? Give --tile as 50x50, in mm");
    if (!output_option)
        return cli_usage(command, "where to? Give -o FILE");
    return cli_calibrate_radiometry_run_job(argv[1]);
}

const struct command calibrate_radiometry = {
    .name = "calibrate radiometry",
    .arguments = "SESSION --reflectance R -o FILE",
    .help = "Find out how bright cameras see and lamps shine, from a session of a white tile.",
    .run_arguments = cli_calibrate_radiometry_run};
