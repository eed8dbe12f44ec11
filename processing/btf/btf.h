/*
 * One view of the BTF: the frames of all lights, rectified and divided by the radiance of a white
 * diffuser: ρ(x, v, l) = π L(x, v, l) / E(x, l). See pipeline.h for the file. Any thread.
 *
 * Each frame is rectified in its own pose, which differs a little from the view's while the
 * turntable turns. Directions are nominal; the positions of camera and lamp in a part
 * (view.centre_mm, light.position_mm) are those of its frame.
 */
#pragma once

#include "frames/rectify.h"
#include "radiometry/photon_transfer.h"
#include "session/inputs.h"

/* Version of the method. It increases when the same frames give other values; older products are
 * then remade. */
#define BTF_METHOD 6

/* Flags of a texel: bits of a part's channel "mark". The channel exists if any texel has a flag. */
enum btf_flag {
    /* saturated in the longest exposure; taken from shorter exposures, with more noise */
    BTF_FLAG_SHORTER = 1,
    BTF_FLAG_BOUND = 2, /* saturated in all exposures: the value is a lower bound */
    /* no finite value, or outside of the picture; the value is 0 and has no meaning */
    BTF_FLAG_HOLE = 4,
    BTF_FLAG_PREDICTED = 8, /* not captured: predicted from the lights around it */
};

/* A view is not made if more than this share of its lights is missing. Lights that were left out
 * because they can be predicted (pipeline/prediction_product.h) do not count as missing here. */
#define BTF_MAX_MISSING 0.1

struct btf_light {
    int index; /* index of the light */
    double theta_deg, phi_deg;
    const struct rig_arc *arc; /* borrowed, like the lamp */
    const struct rig_lamp *lamp;
    const struct radiometry_lamp *radiometry; /* may be unknown */
    double arc_rad;
    double turntable_rad; /* angle in the middle of the exposure; for a missing light, the angle of
                             the view */
    double output;        /* output of the lamp in this shot, relative to its calibration */
    double output_error;  /* standard error of output; 0 if output was not measured in this shot */
    gboolean missing;     /* the light was not captured; input is empty */
    gboolean left_out;    /* missing because it can be predicted; not counted in BTF_MAX_MISSING */
    struct input input;
};

struct btf_view {
    int index; /* index of the view */
    double theta_deg, phi_deg;
    const struct rig_camera *camera;            /* borrowed, like radiometry and noise */
    const struct radiometry_camera *radiometry; /* may be unknown */
    /* noise of the camera; NULL if it is unknown, and then errors of values are unknown as well */
    const struct transfer *noise;
    /* RMS distance in the picture between true points and the calibrated camera's points */
    double misregistration_px;
    double turntable_rad;
    struct session_grid grid;
    GArray *lights; /* of struct btf_light, in order of index */
    /* missing lights, including lights that were left out; the other missing lights are at most
     * BTF_MAX_MISSING of all */
    int n_missing;
    char *inputs; /* hash of all members above */
};

void btf_view_free(struct btf_view *view); /* NULL is ignored */

/* Writes the file. Besides the attributes of pipeline.h, its parts have mesorig.inputs (string),
 * the numbers of texels with each flag, mesorig.holes, mesorig.bounds, mesorig.shorter and
 * mesorig.predicted (int), and error bars (btf_sigma.h).
 * The picture of a missing light is predicted. For each texel, a plane over (sin θ cos φ, sin θ
 * sin φ) is fitted to ρ / cos θ_l of the nearest lights. The prediction is the value of the
 * plane at the missing light times that light's cos θ_l. */
gboolean btf_make_view(const struct btf_view *view, const char *path, GCancellable *cancellable,
                       GError **error);

/* Numbers of texels, and of those with each flag, summed over parts. */
struct btf_flag_counts {
    gint64 texels, holes, bounds, shorter, predicted;
};
/* Sets the numbers of a part from the flags of its n texels. */
void btf_set_flag_counts(struct exr_part *part, const guint8 *flags, gsize n);
/* Adds the numbers of a part to sums. Only the headers of the part are needed. */
void btf_count_flags(const struct exr_part *part, struct btf_flag_counts *sums);

/* Returns whether the file exists and was made from the inputs of the view. */
gboolean btf_is_made(const struct btf_view *view, const char *path);

/* Reads a view back. ret_rgb: n_lights × height × width × 3 (R, G, B). */
gboolean btf_read_view(const char *path, const int *lights, int n_lights,
                       const struct session_grid *grid, float *ret_rgb, GError **error);

/* Reads the attributes OF.theta_deg and OF.phi_deg, where of is "view" or "light". Returns FALSE
 * if one is missing or not finite. */
gboolean btf_direction(const struct exr_part *part, const char *of, float *ret_theta_deg,
                       float *ret_phi_deg);
