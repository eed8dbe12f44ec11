/* calibrate show: prints the contents of a calibration file. */
#include "calibrate.h"

static const char *const titles[CALIBRATION_PARTS] = {"cameras and turntable", "lamps and arc",
                                                      "laser sheets", "radiometry"};

static gboolean all_option;
static const GOptionEntry entries[] = {
    {"all", 0, 0, G_OPTION_ARG_NONE, &all_option,
     "Also list every picture, sight or sweep that was left out, and why", NULL},
    {NULL},
};

static void show_part(Record *to, const struct calibration *calibration,
                      enum calibration_kind kind) {
    const struct calibration_part *part = &calibration->parts[kind];

    if (!part->done) {
        record_say(to, "%s: not calibrated, nominal\n", titles[kind]);
        return;
    }
    record_begin(to, calibration_part_name(kind));
    record_say(to,
               "%s: %s{date}, %s{method}\n  %d{pictures} pictures, %u %s left out, residual RMS "
               "%.3g{residual_rms} %s{residual_unit}, %d{degrees_of_freedom} degrees of freedom\n",
               titles[kind], part->date, part->method, part->pictures, part->rejected->len,
               calibrate_left_out(kind), part->residual_rms, part->residual_unit,
               part->degrees_of_freedom);
    record_string(to, "checksum", part->checksum);
    record_strings(to, "rejected", part->rejected);
    record_end(to);
    g_auto(GStrv) lacking = calibrate_lacking(calibration, calibration_part_name(kind));
    for (int i = 0; lacking && lacking[i]; i++)
        record_say(to, "  incomplete: %s\n", lacking[i]);
}

/* Lists the observations that were left out, if the user asks for them. Otherwise tells how to ask.
 * The list comes last, because it may have hundreds of lines. */
static void show_left_out(Record *to, const struct calibration *calibration, const char *path) {
    guint n = 0;
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        const struct calibration_part *part = &calibration->parts[i];
        n += part->rejected->len;
        for (guint k = 0; all_option && k < part->rejected->len; k++)
            record_say(to, "left out of %s: %s\n", titles[i],
                       (const char *)part->rejected->pdata[k]);
    }
    if (n > 0 && !all_option)
        record_say(to, "mesorig calibrate show --all %s lists what was left out\n", path);
}

static double error_of(const struct calibration_camera *camera, int parameter) {
    return sqrt(camera->covariance[parameter][parameter]);
}

static void show_camera(Record *to, const struct rig_camera *camera,
                        const struct calibration_camera *errors) {
    const struct vec3 at = rig_camera_centre_mm(camera);

    record_say(to, "  %s: %.3f %.3f %.3f mm, focal length %.2f %.2f px, centre %.2f %.2f px",
               camera->name, at.x, at.y, at.z, camera->fx_px, camera->fy_px, camera->cx_px,
               camera->cy_px);
    record_say(to, ", %s lens", rig_lens_name((enum rig_lens)camera->lens));
    g_autofree char *expected = errors->expected_px > 0
                                    ? g_strdup_printf(" (%.3f px by noise)", errors->expected_px)
                                    : NULL;
    if (errors->known)
        record_say(
            to, "; ± %.2f px focal, %.4f° turn, RMS %.3f px of %d corners%s",
            error_of(errors, CALIBRATION_FX),
            hypot(error_of(errors, CALIBRATION_TURN_X), error_of(errors, CALIBRATION_TURN_Y)) *
                180 / G_PI,
            errors->residual_rms_px, errors->points, expected ? expected : "");
    if (camera->lateral_colour[0] != 0)
        record_say(to, "; red is drawn %+.5f and blue %+.5f larger than green, ± %.5f",
                   camera->lateral_colour[0] - camera->lateral_colour[1],
                   camera->lateral_colour[2] - camera->lateral_colour[1],
                   errors->lateral_colour[0]);
    record_say(to, "\n");
}

static void show_lamp(Record *to, const struct rig *rig, int i,
                      const struct calibration_lamp *errors) {
    const struct vec3 at = rig_lamp_position_mm(&rig->arc, &rig->lamps[i], 0);
    const double(*c)[3] = errors->position_covariance_mm2;

    record_say(to, "  %s: %.2f %.2f %.2f mm with the arc at 0", rig->lamps[i].name, at.x, at.y,
               at.z);
    if (errors->known)
        record_say(to, "; ± %.2f %.2f %.2f mm", sqrt(c[0][0]), sqrt(c[1][1]), sqrt(c[2][2]));
    record_say(to, "\n");
}

static void show_turntable(Record *to, const struct calibration *calibration) {
    if (calibration->turntable.known)
        record_say(to, "  turntable: its axis wobbles by up to %.4f° ± %.4f°\n",
                   rig_wobble_most_rad(&calibration->rig.wobble) * 180 / G_PI,
                   calibration->turntable.wobble_rad * 180 / G_PI);
}

static void show_arc(Record *to, gboolean has_arc, const struct rig_arc *arc,
                     const struct calibration_arc *errors) {
    const double deg = 180 / G_PI;

    if (!has_arc)
        return;
    record_say(to, "  arc: zero %+.4f°, axis leans %.4f° and stands at %+.3f %+.3f mm",
               arc->zero_rad * deg, hypot(arc->tilt_rad[0], arc->tilt_rad[1]) * deg,
               arc->centre_mm[0], arc->centre_mm[1]);
    if (errors->known)
        record_say(to, "; ± %.4f°, %.4f°, %.3f mm", errors->zero_rad * deg,
                   hypot(errors->tilt_rad[0], errors->tilt_rad[1]) * deg,
                   hypot(errors->centre_mm[0], errors->centre_mm[1]));
    record_say(to, "\n");
}

static void show_laser(Record *to, const struct rig_laser *laser,
                       const struct calibration_laser *errors) {
    const struct vec3 at = laser->position_mm;
    const double sheet_mm = sqrt(errors->sheet.covariance[RIG_SHEET_OFFSET][RIG_SHEET_OFFSET]);

    record_say(to, "  %s: %.2f %.2f %.2f mm, sweeps %+.3f %%, bent by %+.4f mm at %g mm",
               laser->name, at.x, at.y, at.z, 100 * laser->stretch,
               calibrate_bend_mm(laser, laser->bend_rad), CALIBRATE_BEND_AT_MM);
    if (errors->known && sheet_mm > 0)
        record_say(to, "; sheet ± %.4f mm at the middle", sheet_mm);
    if (errors->known)
        record_say(to, "; ± %.2f mm across its axis%s, zero %.4f°%s, RMS %.4f mm",
                   errors->position_mm[0],
                   errors->from_prior[CALIBRATION_LASER_POSITION] ? " (not measured)" : "",
                   errors->normal_rad * 180 / G_PI,
                   errors->from_prior[CALIBRATION_LASER_NORMAL] ? " (not measured)" : "",
                   errors->residual_rms_mm);
    if (errors->expected_rms_mm > 0)
        record_say(to, ", noise explains %.4f mm", errors->expected_rms_mm);
    record_say(to, "\n");
}

static void show_radiometry(Record *to, const struct calibration *calibration) {
    const struct rig *rig = &calibration->rig;

    for (int c = 0; c < rig->n_cameras; c++) {
        const struct rig_camera *camera = &rig->cameras[c];
        const struct radiometry_camera *r = &calibration->camera_radiometry[c];
        if (r->known)
            record_say(
                to,
                "  %s: response %.1f ± %.3f %%, colours %.4f %.4f %.4f, corners %.1f %% darker\n",
                camera->name, camera->response, 100 * r->response_error, r->colour[0], r->colour[1],
                r->colour[2], 100 * (1 - radiometry_flat(camera, r, 0, 0)));
        g_autofree char *glare = r->glare_error > 0
                                     ? g_strdup_printf("glare %.3f ± %.3f %% of the mean light",
                                                       100 * r->glare, 100 * r->glare_error)
                                     : g_strdup("glare not known: nothing dark around the tile");
        if (r->known)
            record_say(to, "  %s: right half %+.3f %%, lower half %+.3f %%; %s\n", camera->name,
                       100 * r->flat[RADIOMETRY_SMOOTH], 100 * r->flat[RADIOMETRY_SMOOTH + 1],
                       glare);
        const struct transfer *t = &calibration->noise[c].transfer;
        if (calibration->noise[c].known)
            record_say(to,
                       "  %s: black %.2f ± %.2f DN, dark current %.2f ± %.2f DN/s, %.4f ± %.4f DN "
                       "an electron, read noise %.2f ± %.2f electrons, %.2f %% off linear\n",
                       camera->name, t->black_dn, t->black_error_dn, t->dark_dn_s,
                       t->dark_error_dn_s, t->gain_dn_e, t->gain_error_dn_e, t->read_noise_e,
                       t->read_noise_error_e, 100 * t->linearity);
    }
    for (int l = 0; l < rig->n_lamps; l++) {
        const struct radiometry_lamp *r = &calibration->lamp_radiometry[l];
        if (r->known)
            record_say(to,
                       "  %s: %.3f W/sr ± %.3f %%, exponent %.2f ± %.2f, colours %.4f %.4f %.4f; "
                       "flicker %.2f %% between shots, %.2f %% within\n",
                       rig->lamps[l].name, rig->lamps[l].intensity, 100 * r->intensity_error,
                       rig->lamps[l].exponent, r->exponent_error, r->colour[0], r->colour[1],
                       r->colour[2], 100 * r->flicker, 100 * r->frame_flicker);
    }
    for (int m = 0; m < rig->n_fiducials; m++)
        if (calibration->fiducials[m].known)
            record_say(to, "  mark %s: %.3f %.3f %.3f mm, reflectance %.4f ± %.4f\n",
                       rig->fiducials[m].name, rig->fiducials[m].centre_mm.x,
                       rig->fiducials[m].centre_mm.y, rig->fiducials[m].centre_mm.z,
                       rig->fiducials[m].reflectance[1], calibration->fiducials[m].reflectance[1]);
    const struct colour_matrix *colour = &calibration->colour;
    for (int i = 0; colour->known && i < 9; i += 3)
        record_say(to, "  colour: %c = %+.4f R %+.4f G %+.4f B\n", "XYZ"[i / 3],
                   colour -> matrix[i], colour -> matrix[i + 1], colour -> matrix[i + 2]);
    if (colour->known)
        record_say(to, "  colour: %d patches, %.2f ΔE*ab RMS\n", colour->patches, colour->residual);
}

static int run(const struct call *call, GError **error) {
    Record *to = call->record;
    g_autoptr(Calibration) calibration = calibration_read(call->arguments[0], error);
    if (!calibration)
        return CLI_FAILED;
    record_say(to, "%s: rig %s{rig}\n", call->arguments[0], calibration->rig.id);
    const struct rig *rig = &calibration->rig;
    show_part(to, calibration, CALIBRATION_CAMERAS);
    for (int i = 0; i < rig->n_cameras; i++)
        show_camera(to, &rig->cameras[i], &calibration->cameras[i]);
    if (vec3_length(rig->arm.axis) > 0) {
        double theta_rad, phi_rad;
        rig_angles(rig->arm.axis, &theta_rad, &phi_rad);
        record_say(to, "  arm: axis towards theta %.3f° phi %.3f°, through %.2f %.2f %.2f mm\n",
                   theta_rad * 180 / G_PI, phi_rad * 180 / G_PI, rig->arm.centre_mm.x,
                   rig->arm.centre_mm.y, rig->arm.centre_mm.z);
    }
    show_part(to, calibration, CALIBRATION_LIGHTS);
    for (int i = 0; i < rig->n_lamps; i++)
        show_lamp(to, rig, i, &calibration->lamps[i]);
    show_turntable(to, calibration);
    show_arc(to, rig->arc_radius_mm > 0, &rig->arc, &calibration->arc);
    show_part(to, calibration, CALIBRATION_LASER);
    for (int i = 0; i < rig->n_lasers; i++)
        show_laser(to, &rig->lasers[i], &calibration->lasers[i]);
    show_part(to, calibration, CALIBRATION_RADIOMETRY);
    show_radiometry(to, calibration);
    show_left_out(to, calibration, call->arguments[0]);
    return CLI_DONE;
}

const struct command calibrate_show = {.name = "calibrate show",
                                       .arguments = "FILE",
                                       .examples = "  mesorig calibrate show rig.calibration\n",
                                       .help = "Print the contents of a calibration file.",
                                       .options = entries,
                                       .min = 1,
                                       .max = 1,
                                       .run = run};
