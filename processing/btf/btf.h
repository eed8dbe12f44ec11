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

/* Version of the method: rises if the same frames give other values; older products are remade. */
#define BTF_METHOD 6

/* Flags of a texel: bits of a part's channel "mark", which exists if any texel has one. */
enum btf_flag {
    BTF_FLAG_SHORTER = 1,   /* saturated in the longest exposure: from shorter ones, noisier */
    BTF_FLAG_BOUND = 2,     /* saturated in all exposures: the value is a lower bound */
    BTF_FLAG_HOLE = 4,      /* no finite value, or outside of the picture: 0, which means nothing */
    BTF_FLAG_PREDICTED = 8, /* not captured: predicted from the lights around it */
};

/* A view is not made if more than this share of its lights is missing, not counting those that were
 * left out since they can be predicted (pipeline/prediction_product.h). */
#define BTF_MAX_MISSING 0.1

struct btf_light {
    int index; /* of the light */
    double theta_deg, phi_deg;
    const struct rig_arc *arc; /* borrowed, like the lamp */
    const struct rig_lamp *lamp;
    const struct radiometry_lamp *radiometry; /* may be not known */
    double arc_rad;
    double turntable_rad; /* of the exposure, or of the view */
    double output;        /* of the lamp in this shot, relative to its calibration */
    double output_error;  /* 0: it was not measured in this shot */
    gboolean missing;     /* the plan left it out; input is empty */
    gboolean left_out;    /* missing since predictable: not counted in BTF_MAX_MISSING */
    struct input input;
};

struct btf_view {
    int index; /* of the view */
    double theta_deg, phi_deg;
    const struct rig_camera *camera;            /* borrowed, as the next */
    const struct radiometry_camera *radiometry; /* may be not known */
    const struct transfer *noise; /* of the camera; NULL: not known, and so are errors of values */
    double misregistration_px;    /* of the calibrated camera, RMS distance in the picture */
    double turntable_rad;
    struct session_grid grid;
    GArray *lights; /* of struct btf_light, in order of index */
    int n_missing;  /* missing lights with those left out; without them ≤ BTF_MAX_MISSING */
    char *inputs;   /* hash of all of the above */
};

void btf_view_free(struct btf_view *view); /* NULL is ignored */

/* Writes the file. Its parts have, besides the attributes of pipeline.h, mesorig.inputs (string)
 * and mesorig.holes, mesorig.bounds, mesorig.shorter, mesorig.predicted (int): number of texels
 * with each flag; and error bars (btf_sigma.h). A missing light is predicted: the plane over (sin θ
 * cos φ, sin θ sin φ) that fits ρ / cos θ_l of the nearest lights best, times its own cos θ_l. */
gboolean btf_make_view(const struct btf_view *view, const char *path, GCancellable *cancellable,
                       GError **error);

/* Numbers of texels, and of those with each flag, summed over parts. */
struct btf_flag_counts {
    gint64 texels, holes, bounds, shorter, predicted;
};
/* Adds a part, of which only the headers need be read. */
void btf_count_flags(const struct exr_part *part, struct btf_flag_counts *sums);

/* Whether the file exists and was made from these inputs. */
gboolean btf_is_made(const struct btf_view *view, const char *path);

/* Reads a view back. ret_rgb: n_lights × height × width × 3 (R, G, B). */
gboolean btf_read_view(const char *path, const int *lights, int n_lights,
                       const struct session_grid *grid, float *ret_rgb, GError **error);

/* Attributes OF.theta_deg and OF.phi_deg, of: "view" or "light"; FALSE: missing or not finite. */
gboolean btf_direction(const struct exr_part *part, const char *of, float *ret_theta_deg,
                       float *ret_phi_deg);
