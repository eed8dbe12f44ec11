/* Compares a drawing method with the measurement: one rectified picture of the session beside the
 * picture that the method draws for the same directions of view and light. */
#pragma once

#include "reference.h"

struct measured {
    int view, light; /* of reference_info() */
    float view_theta_deg, view_phi_deg, light_theta_deg, light_phi_deg;
    int width, height; /* of the picture */
    guint8 *rgb;       /* measured, drawn, four times the difference around grey, side by side */
    double error;      /* ‖drawn − measured‖ / ‖measured‖ of linear reflectances */
};

/* Finds the measured frame nearest to the directions of camera and light over a horizontal plane
 * and draws the comparison; a texel is drawn as the largest whole number of pixels (at least 1)
 * that fits into width. */
gboolean measured_compare(const Reference *reference, Viewer *viewer,
                          const struct viewer_settings *settings, int width, struct measured *ret,
                          GError **error);
void measured_clear(struct measured *measured);
