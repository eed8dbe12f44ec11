/* The honest check: one measured frame, as it was rectified, beside what a method makes of the same
 * pair of directions. */
#pragma once

#include "reference.h"

struct measured {
    int view, light; /* of reference_info() */
    float view_theta_deg, view_phi_deg, light_theta_deg, light_phi_deg;
    int width, height; /* of the picture */
    guint8 *rgb;       /* measured, drawn, four times the difference around grey, side by side */
    double error;      /* ‖drawn − measured‖ / ‖measured‖ of linear reflectances */
};

/* Which measured frame is nearest to camera and light of a plane that lies flat, and, of a texel as
 * many pixels as fit into width (a multiple, 1 at least), the picture. */
gboolean measured_compare(const Reference *reference, Viewer *viewer,
                          const struct viewer_settings *settings, int width, struct measured *ret,
                          GError **error);
void measured_clear(struct measured *measured);
