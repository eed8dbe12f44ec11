#include "cameras_private.h"

#include "geometry/swing.h"

#include <string.h>

#define RAD(deg)     ((deg) * (G_PI / 180))
#define MAX_OFF_DEG  1  /* largest RMS deviation of the stops from a rotation about one axis */
#define MAX_LEAN_DEG 20 /* largest angle between the axis and the axis in the rig file */

/* Returns the calibrated stop (in the set known) of the same camera whose arm angle is nearest, or
 * −1. */
static int nearest_stop(const struct rig *rig, struct camera_set known, int camera) {
    int nearest = -1;
    double best_deg = G_MAXDOUBLE;
    for (int c = 0; c < rig->n_cameras; c++) {
        const double apart_deg = fabs(rig->cameras[c].arm_deg - rig->cameras[camera].arm_deg);
        if (rig_camera_unit(rig, c) != rig_camera_unit(rig, camera) || !camera_set_has(known, c) ||
            apart_deg >= best_deg)
            continue;
        nearest = c;
        best_deg = apart_deg;
    }
    return nearest;
}

/* Predicts the stop `camera` by turning the calibrated stop `from` about the axis. The squared RMS
 * deviations of the calibrated stops from the axis are added to the variances of its rotation and
 * translation. */
static void predict(struct calibration *calibration, int camera, int from,
                    const struct rig_swing_fit *arm) {
    struct rig_camera *to = &calibration->rig.cameras[camera];
    struct calibration_camera *errors = &calibration->cameras[camera];
    const struct rig_camera own = *to;
    *to = calibration->rig.cameras[from];
    *errors = calibration->cameras[from];
    memcpy(to->name, own.name, sizeof to->name);
    to->arm_deg = own.arm_deg;
    to->stop = own.stop;
    to->vignetting = own.vignetting;
    to->response = own.response;
    rig_swing_camera(&arm->swing, RAD(own.arm_deg - calibration->rig.cameras[from].arm_deg), to);
    for (int i = CALIBRATION_TURN_X; i <= CALIBRATION_TURN_Z; i++)
        errors->covariance[i][i] += arm->angle_rms_rad * arm->angle_rms_rad;
    for (int i = CALIBRATION_SHIFT_X; i <= CALIBRATION_SHIFT_Z; i++)
        errors->covariance[i][i] += arm->position_rms_mm * arm->position_rms_mm;
    errors->points = 0;
    errors->residual_rms_px = 0;
}

/* Returns the cameras that have pictures. */
static struct camera_set calibrated(const struct cameras_work *work) {
    struct camera_set set = {{0}};
    for (int c = 0; c < work->nominal.n_cameras; c++)
        if (cameras_pictures_of(work, c) > 0)
            camera_set_add(&set, c);
    return set;
}

gboolean cameras_fit_arm(const struct cameras_work *work, gboolean *ret_known,
                         struct rig_swing_fit *ret, GError **error) {
    g_autofree struct rig *rig = g_memdup2(&work->nominal, sizeof work->nominal);
    const struct camera_set known = calibrated(work);
    for (int c = 0; c < rig->n_cameras; c++)
        cameras_take_camera(&rig->cameras[c], &work->bundle.cameras[c]);
    *ret_known = rig_swing_fit(rig, known, &work->nominal, ret);
    if (!*ret_known)
        return TRUE;
    if (ret->angle_rms_rad > RAD(MAX_OFF_DEG))
        return cameras_refuse(
            error, CAMERAS_ERROR_FIT,
            "the camera's poses at the stops of the camera arm deviate by %.2g° (RMS) from turns "
            "about one axis by the angles in the rig file, and at most %d° is allowed: check that "
            "the arm moves, and steps_per_deg or units_per_deg of [axis arm], and capture again",
            ret->angle_rms_rad * 180 / G_PI, MAX_OFF_DEG);
    const double off_deg =
        acos(CLAMP(vec3_dot(ret->swing.axis, work->nominal.arm.axis), -1, 1)) * 180 / G_PI;
    return off_deg < MAX_LEAN_DEG ||
           cameras_refuse(error, CAMERAS_ERROR_FIT,
                          "the camera arm turns about an axis that is %.0f° from the axis in the "
                          "rig file: check [rig] arm_axis_theta_deg and arm_axis_phi_deg, and the "
                          "sign of steps_per_deg or units_per_deg of [axis arm], and capture again",
                          off_deg);
}

void cameras_place_stops(const struct cameras_work *work, struct calibration *calibration,
                         struct cameras_result *result) {
    struct rig *rig = &calibration->rig;
    const struct camera_set known = calibrated(work);
    rig->arm = result->arm.swing;
    for (int c = 0; c < rig->n_cameras; c++) {
        const int from = camera_set_has(known, c) ? -1 : nearest_stop(rig, known, c);
        if (from < 0 || !rig->cameras[c].on_arm)
            continue;
        predict(calibration, c, from, &result->arm);
        camera_set_add(&result->predicted, c);
    }
}
