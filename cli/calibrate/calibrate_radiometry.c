/* calibrate radiometry: calibrates cameras, lamps and marks from a captured white tile. */
#include "base/residual.h"
#include "calibrate.h"
#include "targets/tile_session.h"

#include <string.h>

#define MAX_GLARE   0.02 /* A warning is given if the glare exceeds this part of the mean light. */
#define MAX_FLICKER 0.005
#define OUTLINE     16 /* number of marks on each side of the tile on the page of --found */
/* Errors that the exponent and the aim of a lamp in a rig file are expected to have. */
#define EXPONENT_ERROR 1.0
#define AIM_ERROR_RAD  (5 * G_PI / 180)

static char *reflectance_option, *tile_option;
static const GOptionEntry entries[] = {
    {"reflectance", 'r', 0, G_OPTION_ARG_STRING, &reflectance_option,
     "Reflectance of the tile, as its maker states it: one number, or three for red, green and "
     "blue",
     "R[;G;B]"},
    {"tile", 0, 0, G_OPTION_ARG_STRING, &tile_option,
     "The tile's size in mm, if it is not that of the session's sample", "WxH"},
    CALIBRATE_OUTPUT("Write the calibration here"),
    CALIBRATE_FROM("Start from this calibration, and use its geometry. Default: the output file if "
                   "it exists, otherwise the calibration of the session"),
    CALIBRATE_INCOMPLETE,
    CALIBRATE_FOUND,
    {NULL},
};

struct job {
    struct calibrate_job base;
    struct tile_options options;
    struct tile_result result;
};

/* Adds warnings about the rig that follow from the result. */
static void warn(const struct calibrate_job *base, const struct tile_result *r) {
    const struct calibration *calibration = base->calibration;
    GPtrArray *ret = base->warnings;
    const struct residual tile = {"the tile", 100 * r->residual, 100 * r->expected, "%",
                                  "a tile that is not even or not clean, other light in the room, "
                                  "lamps that are not where the calibration says, light that is "
                                  "scattered in the lens, a sensor of uneven gain"};
    calibrate_warn_residual(base, &tile);
    /* The RMS of three errors: those of the exponent and of the two tilts of the aim. Each is
     * divided by its expected error. */
    const double off =
        hypot(r->exponent_off / EXPONENT_ERROR, r->aim_off_rad / AIM_ERROR_RAD) / sqrt(3);
    if (off > RESIDUAL_LIMIT)
        g_ptr_array_add(
            ret,
            g_strdup_printf("the light of the lamps on the tile differs from the rig file: the "
                            "exponents differ by %.1f and the aims by %.0f°, which is %.1f times "
                            "the usual difference; possible causes: pictures that are not linear "
                            "(sRGB taken for linear, or linear for sRGB), a black level left in "
                            "the pictures, scattered light, lamps that are not where the "
                            "calibration says, wrong exponents in the rig file",
                            r->exponent_off, r->aim_off_rad * 180 / G_PI, off));
    for (int c = 0; c < calibration->rig.n_cameras; c++) {
        const struct radiometry_camera *camera = &calibration->camera_radiometry[c];
        if (camera->known && camera->glare > MAX_GLARE)
            g_ptr_array_add(
                ret, g_strdup_printf("camera %s scatters %.2f ± %.2f %% of a picture's mean light "
                                     "over the whole picture; it is subtracted. Clean the lens, "
                                     "take its filter off, and keep light from outside the "
                                     "picture away from it",
                                     calibration->rig.cameras[c].name, 100 * camera->glare,
                                     100 * camera->glare_error));
    }
    for (int l = 0; l < calibration->rig.n_lamps; l++) {
        const struct radiometry_lamp *lamp = &calibration->lamp_radiometry[l];
        const double flicker = hypot(lamp->flicker, lamp->frame_flicker);
        if (lamp->known && flicker > MAX_FLICKER)
            g_ptr_array_add(
                ret, g_strdup_printf("lamp %s flickers by %.2f %% from picture to picture; the "
                                     "error bars include it. Use a better power supply, or "
                                     "exposures of whole mains periods",
                                     calibration->rig.lamps[l].name, 100 * flicker));
    }
    for (int c = 0; c < calibration->rig.n_cameras; c++) {
        const struct transfer *t = &calibration->noise[c].transfer;
        if (calibration->noise[c].known && t->linearity > CALIBRATE_LINEAR)
            g_ptr_array_add(
                ret,
                g_strdup_printf("camera %s is not linear: its signal deviates from the "
                                "exposure by up to %.1f %%. Switch off its gamma and all other "
                                "functions that change its values",
                                calibration->rig.cameras[c].name, 100 * t->linearity));
    }
}

static void tell(Record *to, const struct calibrate_job *base) {
    const struct calibration *calibration = base->calibration;
    const struct calibration_part *part = &calibration->parts[CALIBRATION_RADIOMETRY];
    const struct tile_result *r = &((const struct job *)base)->result;
    record_say(to, "%d{pictures} pictures of the tile, %.2f{residual:%%} RMS", r->pictures,
               r->residual);
    record_strings(to, "rejected", part->rejected);
    if (part->rejected->len)
        record_say(to, "; %u pictures could not be used", part->rejected->len);
    record_add(to, "%d{cells} %g{residual_expected} %g{quality}", r->cells, r->expected,
               r->quality);
    record_say(to,
               "\nlamps drifted by %.2f{drift:%%} meanwhile; %d{marks} of %d marks and the noise "
               "of %d{sensors} of %d cameras are calibrated as well\nmesorig calibrate show %s "
               "tells more\n",
               r->drift, r->marks, calibration->rig.n_fiducials, r->transfers,
               calibration->rig.n_cameras, calibrate_output);
    record_double(to, "real_s", base->seconds);
    int no_glare = 0;
    for (int c = 0; c < calibration->rig.n_cameras; c++) {
        const struct radiometry_camera *camera = &calibration->camera_radiometry[c];
        no_glare += camera->known && camera->glare_error == 0;
    }
    if (no_glare > 0)
        record_say(to,
                   "for %d of %d cameras, the light that the lens scatters is not known and not "
                   "included in the error bars: put something matt and black around the tile, in "
                   "their view\n",
                   no_glare, calibration->rig.n_cameras);
    warn(base, r);
}

/* Parses --reflectance. Returns the mistake in it, or NULL if there is none; g_free(). */
static char *parse_reflectance(double ret[3]) {
    if (!reflectance_option)
        return g_strdup("no reflectance of the tile is given: give --reflectance, a number from "
                        "0.05 to 1.2 such as 0.98, or three separated by ';'");
    if (!calibrate_parse(reflectance_option, ";", 3, ret)) {
        if (!calibrate_parse(reflectance_option, ";", 1, ret))
            return g_strdup_printf("--reflectance=%s: give one number, such as 0.98, or three "
                                   "separated by ';'",
                                   reflectance_option);
        ret[1] = ret[2] = ret[0];
    }
    for (int i = 0; i < 3; i++)
        if (!(ret[i] >= 0.05 && ret[i] <= 1.2))
            return ret[i] >= 5 && ret[i] <= 120
                       ? g_strdup_printf("--reflectance: %g is out of range: 0.05 to 1.2; for %g "
                                         "%% write %g",
                                         ret[i], ret[i], ret[i] / 100)
                       : g_strdup_printf("--reflectance: %g is out of range: 0.05 to 1.2", ret[i]);
    return NULL;
}

/* Marks the outline of the tile in the pictures of the session. */
static gboolean mark_tile(struct job *job, Session *session, GError **error) {
    const struct rig *rig = &job->base.calibration->rig;
    const double half[2] = {job->options.width_mm / 2, job->options.height_mm / 2};
    struct session_grid grid;
    GPtrArray *frames = calibrate_frames(session, SHOT_LAMP, error);
    if (!frames || !session_grid(session, &grid, error)) {
        g_clear_pointer(&frames, g_ptr_array_unref);
        return FALSE;
    }
    g_ptr_array_unref(job->base.frames);
    job->base.frames = frames;
    for (guint i = 0; i < frames->len; i++) {
        const struct calibrate_frame *frame = frames->pdata[i];
        for (int k = 0; k < 4 * OUTLINE; k++) {
            /* The position along the side, −1 to 1, and the side k / OUTLINE. */
            const double along = 2.0 * (k % OUTLINE) / OUTLINE - 1;
            const double u[] = {along, 1, -along, -1}, v[] = {-1, along, 1, -along};
            const int side = k / OUTLINE;
            const struct vec3 point =
                vec3(u[side] * (half[0] > 0 ? half[0] : grid.width_mm / 2),
                     v[side] * (half[1] > 0 ? half[1] : grid.height_mm / 2), grid.reference_mm);
            struct found_mark mark = {.frame = (int)i};
            if (frame->camera < rig->n_cameras &&
                rig_project(&rig->cameras[frame->camera],
                            rig_sample_point(rig, frame->turntable_deg * G_PI / 180, point),
                            &mark.x_px, &mark.y_px))
                calibrate_found_add(&job->base, &mark);
        }
    }
    return TRUE;
}

static gboolean find(struct calibrate_job *base, GError **error) {
    struct job *job = (struct job *)base;
    g_autoptr(Session) session = calibrate_open(base, 0, error);
    g_autofree char *text = session ? session_text(session, "calibration.conf", error) : NULL;
    struct rig own;
    if (!text || !rig_from_text(&own, text, session_path(session), error))
        return FALSE;
    /* Uses the marks of the rig file if the calibration was made before the rig file had marks. */
    struct rig *rig = &base->calibration->rig;
    if (rig->n_fiducials == 0) {
        memcpy(rig->fiducials, own.fiducials, sizeof rig->fiducials);
        rig->n_fiducials = own.n_fiducials;
    }
    base->is_outline = TRUE;
    base->marks_say = "The circles are where the edge of the tile must be. The tile must fill "
                      "this outline and be evenly bright.";
    if (base->found && !mark_tile(job, session, error))
        return FALSE;
    job->options.work = base->work;
    return tile_session(session, base->calibration, &job->options, &job->result, error);
}

static int run(const struct call *call, GError **error) {
    static const struct calibrate_method method = {find, tell, .adds = TRUE};
    struct job job = {0};
    double size_mm[2];
    g_autofree char *wrong = parse_reflectance(job.options.reflectance);
    if (wrong)
        return cli_usage(call->command, "%s", wrong);
    if (tile_option) {
        if (!calibrate_parse(tile_option, "x", 2, size_mm) ||
            !(MIN(size_mm[0], size_mm[1]) > 5 && MAX(size_mm[0], size_mm[1]) < 1e5))
            return cli_usage(
                call->command,
                "--tile=%s: give the width and height of the tile in mm, such as 50x50",
                tile_option);
        job.options.width_mm = size_mm[0];
        job.options.height_mm = size_mm[1];
    }
    return calibrate_run(call, &method, &job.base, error);
}

const struct command calibrate_radiometry = {
    .name = "calibrate radiometry",
    .arguments = "SESSION --reflectance R -o FILE",
    .examples = "  mesorig calibrate radiometry tile.session -r 0.96 -c rig.calibration -o "
                "rig.calibration\n",
    .help = "Calibrate the response of the cameras and the intensity of the lamps, from a session "
            "of a white tile.",
    .options = entries,
    .writes = TRUE,
    .min = 1,
    .max = 1,
    .run = run};
