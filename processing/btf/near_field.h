/*
 * The true directions in which each texel of a BTF was seen and lit. Nominal directions are the
 * same for all texels; for cameras and lamps half a metre away, those of a texel at the edge of a
 * sample differ by degrees. The positions are in the BTF's own files (view.centre_mm and
 * light.position_mm of pipeline.h: as calibrated). Plain data, immutable once read: any thread.
 */
#pragma once

#include "base/vec.h"
#include "btf_layout.h"
#include "exr/exr.h"
#include "session/session.h"

struct near_field {
    struct session_grid grid;
    struct direction_list views, lights; /* nominal */
    /* Sample frame; n_views, and n_views × n_lights, since lamps may move in this frame with the
     * turntable's angle. If it turned during a view's pictures, the camera's is the mean over them.
     * Both NULL: the files have no positions, and all texels have the nominal directions. */
    struct vec3 *camera_mm, *lamp_mm;
};

/* Reads the headers of a session's BTF. DATA_ERROR_INVALID: the files contradict each other, a
 * position is not finite or not above the reference plane, or only some files have positions. */
struct near_field *near_field_read(const char *session, GError **error);
void near_field_free(struct near_field *near_field); /* NULL is ignored */

/* Unit vectors from a texel's centre to camera and lamp; texels row by row, row 0 at +y. */
struct vec3 near_field_view(const struct near_field *near_field, int view, int texel);
struct vec3 near_field_light(const struct near_field *near_field, int view, int light, int texel);

/* The same from the centre of the sample. */
struct vec3 near_field_view_centre(const struct near_field *near_field, int view);
struct vec3 near_field_light_centre(const struct near_field *near_field, int view, int light);
