#include "calibrate_tables.h"

#include "calibrate.h"

#include <math.h>

#define DEG(rad) ((rad) * (180 / G_PI))

static void add_name(GString *to, const char *name) {
    g_autofree char *text = g_markup_escape_text(name, -1);
    g_string_append_printf(to, "<tr><td>%s</td>", text);
}

/* Returns the standard error of a position along a unit direction. */
static double along(const double covariance[3][3], struct vec3 d) {
    const double v[3] = {d.x, d.y, d.z};
    double sum = 0;
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++)
            sum += v[i] * covariance[i][j] * v[j];
    return sqrt(MAX(sum, 0));
}

void calibrate_table_lamps(GString *to, const struct calibration *calibration) {
    const struct rig_arc *arc = &calibration->rig.arc;
    const struct calibration_arc *e = &calibration->arc;
    if (!calibration->parts[CALIBRATION_LIGHTS].done)
        return;
    g_string_append_printf(
        to, "<h2>Lamps and arc</h2>\n<div class=\"wide\"><table><tr><th>lamp</th><th>distance "
            "(mm)</th><th>angle from "
            "the zenith, azimuth on the arc (°)</th></tr>\n");
    for (int i = 0; i < calibration->rig.n_lamps; i++) {
        const struct rig_lamp *lamp = &calibration->rig.lamps[i];
        const struct calibration_lamp *l = &calibration->lamps[i];
        const struct vec3 at = lamp->position_mm;
        double theta, phi;
        if (!l->known)
            continue;
        rig_angles(at, &theta, &phi);
        phi = phi > G_PI ? phi - 2 * G_PI : phi;
        add_name(to, lamp->name);
        g_string_append_printf(to, "<td>%.2f ± %.2f</td><td>%.3f, %.3f</td></tr>\n",
                               vec3_length(at), along(l->position_covariance_mm2, vec3_unit(at)),
                               DEG(theta), DEG(phi));
    }
    if (calibration->rig.arc_radius_mm == 0) {
        g_string_append(to, "</table></div>\n");
        return;
    }
    g_string_append_printf(
        to,
        "</table></div>\n<p>The arc's zero is at %+.4f° ± %.4f°; its axis leans by %.4f° towards x "
        "and "
        "%.4f° towards y and goes through (%+.3f, %+.3f) mm of the turntable.</p>\n",
        DEG(arc->zero_rad), DEG(e->zero_rad), DEG(arc->tilt_rad[1]), -DEG(arc->tilt_rad[0]),
        arc->centre_mm[0], arc->centre_mm[1]);
}

void calibrate_table_lasers(GString *to, const struct calibration *calibration) {
    if (!calibration->parts[CALIBRATION_LASER].done)
        return;
    g_string_append_printf(
        to,
        "<h2>Laser sheets</h2>\n<div class=\"wide\"><table><tr><th>laser</th><th>x, z "
        "(mm)</th><th>sheet at the middle (mm)</th><th>across its axis "
        "(mm)</th><th>zero of the sweep (°)</th><th>turns further by (%%)</th><th>bent by, at "
        "%g mm (mm)</th><th>RMS (mm)</th><th>noise explains (mm)</th></tr>\n",
        CALIBRATE_BEND_AT_MM);
    gboolean priors = FALSE;
    for (int i = 0; i < calibration->rig.n_lasers; i++) {
        const struct rig_laser *laser = &calibration->rig.lasers[i];
        const struct calibration_laser *e = &calibration->lasers[i];
        if (!e->known)
            continue;
        add_name(to, laser->name);
        g_string_append_printf(
            to,
            "<td>%.2f, %.2f</td><td>± %.4f</td><td>± %.2f%s</td><td>± %.4f%s</td><td>%+.3f ± "
            "%.3f</td><td>%+.4f ± %.4f</td><td>%.4f</td><td>%.4f</td></tr>\n",
            laser->position_mm.x, laser->position_mm.z,
            sqrt(e->sheet.covariance[RIG_SHEET_OFFSET][RIG_SHEET_OFFSET]), e->position_mm[0],
            e->from_prior[CALIBRATION_LASER_POSITION] ? " *" : "", DEG(e->normal_rad),
            e->from_prior[CALIBRATION_LASER_NORMAL] ? " *" : "", 100 * laser->stretch,
            100 * e->stretch, calibrate_bend_mm(laser, laser->bend_rad),
            calibrate_bend_mm(laser, e->bend_rad), e->residual_rms_mm, e->expected_rms_mm);
        priors |=
            e->from_prior[CALIBRATION_LASER_POSITION] || e->from_prior[CALIBRATION_LASER_NORMAL];
    }
    g_string_append_printf(to, "</table></div>\n");
    if (priors)
        g_string_append(to, "<p>* not measured: known only as well as the arc's axis was before. "
                            "The sheets do not depend on it.</p>\n");
}

static void add_camera_light(GString *to, const struct calibration *calibration, int i) {
    const struct rig_camera *camera = &calibration->rig.cameras[i];
    const struct radiometry_camera *r = &calibration->camera_radiometry[i];
    const struct transfer *t = &calibration->noise[i].transfer;
    if (!r->known)
        return;
    add_name(to, camera->name);
    g_string_append_printf(to, "<td>%.1f ± %.3f %%</td><td>%.4f %.4f %.4f</td><td>%.1f</td>",
                           camera->response, 100 * r->response_error, r->colour[0], r->colour[1],
                           r->colour[2], 100 * (1 - radiometry_flat(camera, r, 0, 0)));
    if (calibration->noise[i].known)
        g_string_append_printf(to, "<td>%.2f</td><td>%.2f ± %.2f</td><td>%.2f</td></tr>\n",
                               t->black_dn, t->read_noise_e, t->read_noise_error_e,
                               100 * t->linearity);
    else
        g_string_append(to, "<td></td><td></td><td></td></tr>\n");
}

void calibrate_table_light(GString *to, const struct calibration *calibration) {
    const struct rig *rig = &calibration->rig;
    if (!calibration->parts[CALIBRATION_RADIOMETRY].done)
        return;
    g_string_append_printf(
        to,
        "<h2>Light</h2>\n<div class=\"wide\"><table><tr><th>camera</th><th>response</th><th>red, "
        "green, blue</th>"
        "<th>corner darker by (%%)</th><th>black (DN)</th><th>read noise (e⁻)</th><th>off linear "
        "(%%)</th></tr>\n");
    for (int i = 0; i < rig->n_cameras; i++)
        add_camera_light(to, calibration, i);
    g_string_append_printf(
        to, "</table></div>\n<div class=\"wide\"><table><tr><th>lamp</th><th>intensity "
            "(W/sr)</th><th>exponent</th>"
            "<th>red, green, blue</th></tr>\n");
    for (int i = 0; i < rig->n_lamps; i++) {
        const struct radiometry_lamp *r = &calibration->lamp_radiometry[i];
        if (!r->known)
            continue;
        add_name(to, rig->lamps[i].name);
        g_string_append_printf(
            to, "<td>%.3f ± %.3f %%</td><td>%.2f ± %.2f</td><td>%.4f %.4f %.4f</td></tr>\n",
            rig->lamps[i].intensity, 100 * r->intensity_error, rig->lamps[i].exponent,
            r->exponent_error, r->colour[0], r->colour[1], r->colour[2]);
    }
    g_string_append_printf(to, "</table></div>\n");
}
