/*
 * In which direction each texel of a BTF was truly seen and lit. Nominal directions are the same
 * for all texels; cameras and lamps half a metre away stand, for a texel at the edge of a sample,
 * degrees beside them. Where they stood is in the BTF's own files (view.centre_mm and
 * light.position_mm of pipeline.h: as calibrated). Plain data, not changed once read: any thread.
 */
#pragma once

#include "base/vec.h"
#include "exr/exr.h"
#include "session/session.h"

struct near_field {
    struct session_grid grid;
    int n_views, n_lights;
    float *view_theta_deg, *view_phi_deg;   /* n_views: nominal */
    float *light_theta_deg, *light_phi_deg; /* n_lights: nominal */
    /* Sample frame; n_views, and n_views × n_lights: a light arc may turn about an axis of its own,
     * so that for each turntable angle lamps stand a little elsewhere. NULL, both: the files do not
     * say; all texels have the nominal directions. */
    struct vec3 *camera_mm, *lamp_mm;
};

/* Of a session with a BTF, from its files' headers alone. DATA_ERROR_INVALID: they do not fit each
 * other, or a place is not finite or not above the reference plane; some say where, some do not. */
struct near_field *near_field_read(const char *session, GError **error);
void near_field_free(struct near_field *near_field); /* NULL is ignored */

/* Unit vectors from a texel's centre outwards; texels row by row, row 0 at +y. */
struct vec3 near_field_view(const struct near_field *near_field, int view, int texel);
struct vec3 near_field_light(const struct near_field *near_field, int view, int light, int texel);

/* The same as seen from the middle of the sample. */
struct vec3 near_field_view_centre(const struct near_field *near_field, int view);
struct vec3 near_field_light_centre(const struct near_field *near_field, int view, int light);
