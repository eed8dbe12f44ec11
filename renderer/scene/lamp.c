#include "lamp.h"

#include "base/direction.h"

#include <math.h>
#include <string.h>

/* Smallest difference of the cosines of a cone's two angles, as in KHR_lights_punctual. */
#define MIN_EDGE 1e-3

struct viewer_settings lamp_settings(const struct viewer_settings *s) {
    struct viewer_settings ret = *s;
    if (s->light_distance == 0.0 || s->lamp == 0.0 || s->n_lamps >= VIEWER_MAX_LAMPS)
        return ret;
    memcpy(ret.lamps + 1, s->lamps, (gsize)s->n_lamps * sizeof *s->lamps);
    ret.n_lamps = s->n_lamps + 1;
    ret.lamps[0] = (struct viewer_lamp){.theta_deg = s->light_theta_deg,
                                        .phi_deg = s->light_phi_deg,
                                        .rgb = {(float)s->lamp, (float)s->lamp, (float)s->lamp},
                                        .distance = s->light_distance,
                                        .cone_deg = s->light_cone_deg,
                                        .inner_deg = s->light_inner_deg};
    ret.lamp = 0.0;
    return ret;
}

gboolean lamp_any_near(const struct viewer_settings *s) {
    for (int k = 0; k < s->n_lamps; k++)
        if (s->lamps[k].distance > 0.0)
            return TRUE;
    return FALSE;
}

struct shadow_lamp lamp_placed(const struct viewer_lamp *lamp, double radius) {
    struct shadow_lamp ret = {.place = {0.0F}};
    double axis[3], length = 0.0;
    direction_from_deg(lamp->theta_deg, lamp->phi_deg, ret.place);
    if (lamp->distance == 0.0)
        return ret;
    ret.place[3] = 1.0F;
    for (int k = 0; k < 3; k++) {
        ret.place[k] *= (float)(lamp->distance * radius);
        axis[k] = lamp->aim[k] * radius - (double)ret.place[k];
        length = hypot(length, axis[k]);
    }
    if (lamp->cone_deg == 0.0 || length == 0.0)
        return ret;
    for (int k = 0; k < 3; k++)
        ret.axis[k] = (float)(axis[k] / length);
    ret.cone_rad = (float)(lamp->cone_deg * G_PI / 180.0);
    return ret;
}

void lamp_cone(const struct shadow_lamp *placed, double inner_deg, float ret[4]) {
    const double outer = cos((double)placed->cone_rad);
    const double edge = fmax(cos(inner_deg * G_PI / 180.0) - outer, MIN_EDGE);
    if (placed->cone_rad == 0.0F) {
        memcpy(ret, (const float[4]){0.0F, 0.0F, 0.0F, 1.0F}, 4 * sizeof *ret);
        return;
    }
    for (int k = 0; k < 3; k++)
        ret[k] = (float)((double)placed->axis[k] / edge);
    ret[3] = (float)(-outer / edge);
}
