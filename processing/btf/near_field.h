/*
 * The true directions in which each texel of a BTF was seen and lit, and the fall-off of the light.
 * Nominal directions are the same for all texels. For cameras and lamps half a metre away, the true
 * directions of a texel at the edge of a sample differ from the nominal ones by degrees. For lamps
 * a few sample widths away they differ by tens of degrees, and the irradiance by a factor. The
 * positions of cameras and lamps are read from the files of the BTF (view.centre_mm,
 * light.position_mm, light.aim and light.exponent of pipeline.h) and are as calibrated. Plain data,
 * immutable once read. Any thread.
 */
#pragma once

#include "base/vec.h"
#include "btf_layout.h"
#include "exr/exr.h"
#include "session/session.h"

struct near_field {
    struct session_grid grid;
    struct direction_list views, lights; /* nominal directions */
    /* Positions in the sample frame: n_views of cameras, and n_views × n_lights of lamps, because
     * lamps move in this frame with the turntable. If the turntable turned during a view's
     * pictures, the position of the camera is the mean over these pictures.
     *
     * camera_mm or lamp_mm is NULL if the files lack the positions of cameras or lamps. All texels
     * are then seen from, or lit from, the nominal directions. */
    struct vec3 *camera_mm, *lamp_mm;
    /* Unit vectors of the lamps' aims in the sample frame, and exponents n of the fall-off cos^n
     * away from the aim. An exponent is 0 if the file does not state it. Both arrays have the
     * length of lamp_mm, and are NULL if lamp_mm is NULL. */
    struct vec3 *lamp_aim;
    double *lamp_exponent;
};

/* Reads the headers of a session's BTF. The files are checked by session_check_products() first.
 * The error is DATA_ERROR_INCOMPLETE if no view has a file. It is DATA_ERROR_INVALID if
 * - views differ in the number or the directions of their lights
 * - an angle is missing or not finite
 * - a position is not finite or not above the reference plane
 * - only some parts have positions
 * - an aim is not a direction, or an exponent is not from 0 to 1000. */
struct near_field *near_field_read(const char *session, GError **error);
void near_field_free(struct near_field *near_field); /* NULL is ignored */

/* Return the unit vectors from a texel's centre to a camera and to a lamp. Texels are numbered row
 * by row, and row 0 is at +y. */
struct vec3 near_field_view(const struct near_field *near_field, int view, int texel);
struct vec3 near_field_light(const struct near_field *near_field, int view, int light, int texel);

/* Returns the irradiance of a texel relative to the irradiance of the centre of the sample, both on
 * planes that face the lamp:
 *   (r₀ / r)² (cos α / cos α₀)^n
 *   r, r₀   distance from the lamp to the texel, and to the centre
 *   α, α₀   angle at the lamp between its aim and the texel, and the centre
 *   n       exponent of the lamp
 * Returns 1 if there are no positions, and 0 if the lamp does not light the centre. The picture
 * that the lamp makes, relative to a white diffuser in the centre, is ρ times this factor. */
double near_field_fall_off(const struct near_field *near_field, int view, int light, int texel);

/* Returns the centre of a texel on the reference plane, in the sample frame. */
struct vec3 near_field_texel_mm(const struct near_field *near_field, int texel);

/* Return the unit vectors from the centre of the sample to a camera and to a lamp. */
struct vec3 near_field_view_centre(const struct near_field *near_field, int view);
struct vec3 near_field_light_centre(const struct near_field *near_field, int view, int light);
