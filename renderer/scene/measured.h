/* Compares a drawing method with the measurement. A rectified picture of the session is shown next
 * to the picture that the method draws for the same view and light. */
#pragma once

#include "reference.h"

struct measured {
    int view, light; /* indices into reference_info() */
    float view_theta_deg, view_phi_deg, light_theta_deg, light_phi_deg;
    int width, height; /* of the picture */
    /* three panels side by side: the measured picture, the drawn picture, and four times their
     * difference around grey */
    guint8 *rgb;
    double error; /* ‖drawn − measured‖ / ‖measured‖ of linear reflectances; 0 if the measured
                     picture is black */
};

/* Compares the picture of a measured view and light with the picture that the viewer draws of one
 * flat tile. The view is the measured view that is nearest to the direction of the camera. The
 * light is the measured light that is nearest to the direction of the first lamp. Both directions
 * are taken as those of a horizontal sample, whatever the mesh.
 *
 * Sets *ret to the result. Each texel becomes n × n pixels of a panel. n is the largest number for
 * which the three panels fit into width, but at least 1. */
gboolean measured_compare(const Reference *reference, Viewer *viewer,
                          const struct viewer_settings *settings, int width, struct measured *ret,
                          GError **error);
void measured_clear(struct measured *measured);
