/* calibrate show: what a calibration file says. */
#include "calibrate.h"

static const char *const titles[CALIBRATION_PARTS] = {"cameras and turntable", "lamps and arc",
                                                      "laser sheets", "radiometry"};

static void show_part(const struct calibration *calibration, enum calibration_kind kind) {
    const struct calibration_part *part = &calibration->parts[kind];

    if (!part->done) {
        g_print("%s: not calibrated, nominal\n", titles[kind]);
        return;
    }
    g_print("%s: %s, %s\n  %d pictures, %u rejected, residual RMS %.3g %s, %d degrees of freedom\n",
            titles[kind], part->date, part->method, part->pictures, part->rejected->len,
            part->residual_rms, part->residual_unit, part->degrees_of_freedom);
    for (guint i = 0; i < part->rejected->len; i++)
        g_print("  rejected: %s\n", (const char *)part->rejected->pdata[i]);
}

static double error_of(const struct calibration_camera *camera, int parameter) {
    return sqrt(camera->covariance[parameter][parameter]);
}

static void show_camera(const struct rig_camera *camera, const struct calibration_camera *errors) {
    const struct vec3 at = rig_camera_centre_mm(camera);

    g_print("  %s: %.3f %.3f %.3f mm, focal length %.2f %.2f px, centre %.2f %.2f px", camera->name,
            at.x, at.y, at.z, camera->fx_px, camera->fy_px, camera->cx_px, camera->cy_px);
    if (errors->known)
        g_print("; ± %.2f px focal, %.4f° turn, RMS %.3f px of %d corners",
                error_of(errors, CALIBRATION_FX),
                hypot(error_of(errors, CALIBRATION_TURN_X), error_of(errors, CALIBRATION_TURN_Y)) *
                    180 / G_PI,
                errors->residual_rms_px, errors->points);
    g_print("\n");
}

static void show_lamp(const struct rig *rig, int i, const struct calibration_lamp *errors) {
    const struct vec3 at = rig_lamp_position_mm(&rig->arc, &rig->lamps[i], 0);
    const double(*c)[3] = errors->position_covariance_mm2;

    g_print("  %s: %.2f %.2f %.2f mm with the arc at 0", rig->lamps[i].name, at.x, at.y, at.z);
    if (errors->known)
        g_print("; ± %.2f %.2f %.2f mm", sqrt(c[0][0]), sqrt(c[1][1]), sqrt(c[2][2]));
    g_print("\n");
}

static void show_arc(const struct rig_arc *arc, const struct calibration_arc *errors) {
    const double deg = 180 / G_PI;

    g_print("  arc: zero %+.4f°, axis leans %.4f° and stands at %+.3f %+.3f mm",
            arc->zero_rad * deg, hypot(arc->tilt_rad[0], arc->tilt_rad[1]) * deg, arc->centre_mm[0],
            arc->centre_mm[1]);
    if (errors->known)
        g_print("; ± %.4f°, %.4f°, %.3f mm", errors->zero_rad * deg,
                hypot(errors->tilt_rad[0], errors->tilt_rad[1]) * deg,
                hypot(errors->centre_mm[0], errors->centre_mm[1]));
    g_print("\n");
}

static void show_laser(const struct rig_laser *laser, const struct calibration_laser *errors) {
    const struct vec3 at = laser->position_mm;

    g_print("  %s: %.2f %.2f %.2f mm, sweeps %+.3f %%", laser->name, at.x, at.y, at.z,
            100 * laser->stretch);
    if (errors->known)
        g_print("; ± %.2f mm across its axis, zero %.4f°, RMS %.3f mm", errors->position_mm[0],
                errors->normal_rad * 180 / G_PI, errors->residual_rms_mm);
    g_print("\n");
}

static void show_lights(const struct calibration *calibration) {
    for (int i = 0; i < calibration->rig.n_lamps; i++)
        show_lamp(&calibration->rig, i, &calibration->lamps[i]);
    show_arc(&calibration->rig.arc, &calibration->arc);
}

static void show_sensor(const char *name, const struct transfer *t) {
    g_print(
        "  %s: black %.2f ± %.2f DN, dark current %.2f ± %.2f DN/s, %.4f ± %.4f DN an electron, "
        "read noise %.2f ± %.2f electrons, %.2f %% off linear\n",
        name, t->black_dn, t->black_error_dn, t->dark_dn_s, t->dark_error_dn_s, t->gain_dn_e,
        t->gain_error_dn_e, t->read_noise_e, t->read_noise_error_e, 100 * t->linearity);
}

static void show_radiometry(const struct calibration *calibration) {
    const struct rig *rig = &calibration->rig;

    for (int c = 0; c < rig->n_cameras; c++) {
        const struct rig_camera *camera = &rig->cameras[c];
        const struct radiometry_camera *r = &calibration->camera_radiometry[c];
        if (r->known)
            g_print(
                "  %s: response %.1f ± %.3f %%, colours %.4f %.4f %.4f, corners %.1f %% darker\n",
                camera->name, camera->response, 100 * r->response_error, r->colour[0], r->colour[1],
                r->colour[2], 100 * (1 - radiometry_flat(camera, r, 0, 0)));
        if (calibration->noise[c].known)
            show_sensor(camera->name, &calibration->noise[c].transfer);
    }
    for (int l = 0; l < rig->n_lamps; l++) {
        const struct radiometry_lamp *r = &calibration->lamp_radiometry[l];
        if (r->known)
            g_print("  %s: %.3f W/sr ± %.3f %%, exponent %.2f ± %.2f, colours %.4f %.4f %.4f\n",
                    rig->lamps[l].name, rig->lamps[l].intensity, 100 * r->intensity_error,
                    rig->lamps[l].exponent, r->exponent_error, r->colour[0], r->colour[1],
                    r->colour[2]);
    }
    for (int m = 0; m < rig->n_marks; m++)
        if (calibration->marks[m].known)
            g_print("  mark %s: %.3f %.3f %.3f mm, reflectance %.4f ± %.4f\n", rig->marks[m].name,
                    rig->marks[m].centre_mm.x, rig->marks[m].centre_mm.y, rig->marks[m].centre_mm.z,
                    rig->marks[m].reflectance[1], calibration->marks[m].reflectance[1]);
}

static void show_colour(const struct colour_matrix *colour) {
    for (int i = 0; colour->known && i < 9; i += 3)
        g_print("  colour: %c = %+.4f R %+.4f G %+.4f B\n", "XYZ"[i / 3], colour -> matrix[i],
                colour -> matrix[i + 1], colour -> matrix[i + 2]);
    if (colour->known)
        g_print("  colour: %d patches, %.2f ΔE*ab RMS\n", colour->patches, colour->residual);
}

static GVariant *part_variant(const struct calibration_part *part) {
    GVariantBuilder builder;

    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "date", g_variant_new_string(part->date));
    g_variant_builder_add(&builder, "{sv}", "method", g_variant_new_string(part->method));
    g_variant_builder_add(&builder, "{sv}", "residual_rms",
                          g_variant_new_double(part->residual_rms));
    g_variant_builder_add(&builder, "{sv}", "residual_unit",
                          g_variant_new_string(part->residual_unit));
    g_variant_builder_add(&builder, "{sv}", "degrees_of_freedom",
                          g_variant_new_int32(part->degrees_of_freedom));
    g_variant_builder_add(&builder, "{sv}", "pictures", g_variant_new_int32(part->pictures));
    g_variant_builder_add(&builder, "{sv}", "checksum", g_variant_new_string(part->checksum));
    g_variant_builder_add(&builder, "{sv}", "rejected",
                          g_variant_new_strv((const char *const *)part->rejected->pdata,
                                             (gssize)part->rejected->len));
    return g_variant_builder_end(&builder);
}

static void show_json(const struct calibration *calibration) {
    GVariantBuilder builder;

    g_variant_builder_init(&builder, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&builder, "{sv}", "rig", g_variant_new_string(calibration->rig.id));
    for (int i = 0; i < CALIBRATION_PARTS; i++)
        if (calibration->parts[i].done)
            g_variant_builder_add(&builder, "{sv}", calibration_part_name((enum calibration_kind)i),
                                  part_variant(&calibration->parts[i]));
    cli_print_json(g_variant_builder_end(&builder));
}

static int cli_calibrate_show_run(const struct command *command, int argc, char **argv) {
    g_autoptr(GError) error = NULL;

    if (!cli_parse(command, NULL, FALSE, &argc, &argv, 1, 1))
        return CLI_USAGE;
    g_autoptr(Calibration) calibration = calibration_read(argv[1], &error);
    if (!calibration)
        return cli_fail(error);
    if (cli_json) {
        show_json(calibration);
        return CLI_DONE;
    }
    g_print("%s: rig %s\n", argv[1], calibration->rig.id);
    for (int i = 0; i < CALIBRATION_PARTS; i++) {
        show_part(calibration, (enum calibration_kind)i);
        for (int c = 0; i == CALIBRATION_CAMERAS && c < calibration->rig.n_cameras; c++)
            show_camera(&calibration->rig.cameras[c], &calibration->cameras[c]);
        if (i == CALIBRATION_LIGHTS)
            show_lights(calibration);
        if (i == CALIBRATION_RADIOMETRY) {
            show_radiometry(calibration);
            show_colour(&calibration->colour);
        }
        for (int k = 0; i == CALIBRATION_LASER && k < calibration->rig.n_lasers; k++)
            show_laser(&calibration->rig.lasers[k], &calibration->lasers[k]);
    }
    return CLI_DONE;
}

const struct command calibrate_show = {.name = "calibrate show",
                                       .arguments = "FILE",
                                       .help = "Print what a calibration file says.",
                                       .run_arguments = cli_calibrate_show_run};
