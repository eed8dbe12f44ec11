#include "cameras_private.h"

#include "geometry/swing.h"

#include <string.h>

#define RAD(deg) ((deg) * (G_PI / 180))

/* The calibrated stop of the same camera whose angle is nearest; −1: there is none. */
static int nearest_stop(const struct rig *rig, guint32 known, int camera) {
    int nearest = -1;
    double best_deg = G_MAXDOUBLE;
    for (int c = 0; c < rig->n_cameras; c++) {
        const double apart_deg = fabs(rig->cameras[c].arm_deg - rig->cameras[camera].arm_deg);
        if (rig_camera_unit(rig, c) != rig_camera_unit(rig, camera) || !(known >> c & 1) ||
            apart_deg >= best_deg)
            continue;
        nearest = c;
        best_deg = apart_deg;
    }
    return nearest;
}

/* A stop from the nearest calibrated one, turned about the axis. Its centre may be off by what the
 * calibrated stops are: that adds to the variances of its translation and rotation. */
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

void cameras_fit_arm(const struct cameras_work *work, struct calibration *calibration,
                     struct cameras_result *result) {
    struct rig *rig = &calibration->rig;
    guint32 known = 0;
    for (int c = 0; c < rig->n_cameras; c++)
        known |= calibration->cameras[c].points > 0 ? 1u << c : 0;
    result->arm_known = rig_swing_fit(rig, known, &work->nominal, &result->arm);
    if (!result->arm_known)
        return;
    rig->arm = result->arm.swing;
    for (int c = 0; c < rig->n_cameras; c++) {
        const int from = known >> c & 1 ? -1 : nearest_stop(rig, known, c);
        if (from < 0 || !rig->cameras[c].on_arm)
            continue;
        predict(calibration, c, from, &result->arm);
        result->predicted |= 1u << c;
    }
}
