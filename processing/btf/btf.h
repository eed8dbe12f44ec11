/*
 * One view of the BTF: the pictures of all lights, rectified and divided by the radiance of a white
 * diffuser: ρ(x, v, l) = π L(x, v, l) / E(x, l). pipeline.h describes the file. Any thread.
 *
 * Each picture is rectified in its own pose, which differs a little from the view's pose if the
 * turntable turned during the pictures. The directions of view and light in a part are the nominal
 * ones. The positions of camera and lamp in a part (view.centre_mm, light.position_mm) are those in
 * the pose of the part's picture.
 */
#pragma once

#include "frames/rectify.h"
#include "radiometry/photon_transfer.h"
#include "session/inputs.h"

/* Version of the method. It increases when the same pictures give other values. Products of an
 * older version are remade. */
#define BTF_METHOD 6

/* Flags of a texel: bits of a part's channel "mark". The channel exists if any texel has a flag. */
enum btf_flag {
    /* saturated in the longest exposure: the value comes from shorter exposures, with more noise */
    BTF_FLAG_SHORTER = 1,
    BTF_FLAG_BOUND = 2, /* saturated in all exposures: the value is a lower bound */
    /* a pixel of the texel is not finite, or the texel lies outside of the picture: the value is 0
       and has no meaning */
    BTF_FLAG_HOLE = 4,
    BTF_FLAG_PREDICTED = 8, /* not captured: predicted from other pictures */
};

/* A view is not made if more than this share of its lights is missing. Lights that were left out
 * because they can be predicted (pipeline/prediction_product.h) do not count as missing here. */
#define BTF_MAX_MISSING 0.1

/* end of an error that says that the file of a view is damaged */
#define BTF_AGAIN "; delete the file and process again, or import again"

struct btf_light {
    int index; /* position in the session's list of lights, from 0 */
    double theta_deg, phi_deg;
    const struct rig_arc *arc; /* arc and lamp are borrowed */
    const struct rig_lamp *lamp;
    /* NULL for a missing light; its member `known` is FALSE if the lamp is not calibrated */
    const struct radiometry_lamp *radiometry;
    double arc_rad;
    double turntable_rad; /* angle in the middle of the exposure; for a missing light, the angle of
                             the view */
    double output;        /* output of the lamp in this shot, relative to its calibration */
    double output_error;  /* standard error of output; 0 if it was not measured in this shot */
    gboolean missing;     /* the light was not captured; input is empty */
    gboolean left_out;    /* missing on purpose, because it can be predicted (BTF_MAX_MISSING) */
    struct input input;
};

struct btf_view {
    int index; /* position in the session's list of views, from 0 */
    double theta_deg, phi_deg;
    const struct rig_camera *camera; /* camera, radiometry and noise are borrowed */
    /* If the camera is not calibrated, radiometry is NULL, or its member `known` is FALSE. */
    const struct radiometry_camera *radiometry;
    /* noise of the camera; NULL if it is unknown, so that the errors of all values are unknown */
    const struct transfer *noise;
    /* RMS reprojection error of the camera's calibration; 0 if the camera is not calibrated */
    double misregistration_px;
    double turntable_rad;
    struct session_grid grid;
    GArray *lights; /* of struct btf_light, in order of index */
    /* Number of missing lights, including lights that were left out. The number of missing lights
     * that were not left out is at most BTF_MAX_MISSING times the number of all lights. */
    int n_missing;
    /* Hash of all that the file is made from: versions of program and method, calibration, grid,
     * view, and the frames and outputs of the lights. See btf_is_made(). */
    char *inputs;
};

void btf_view_free(struct btf_view *view); /* NULL is ignored */

/* Writes the file of the view. Its parts have the attributes of pipeline.h, mesorig.inputs
 * (string), and error bars (btf_sigma.h). The attributes mesorig.holes, mesorig.bounds,
 * mesorig.shorter and mesorig.predicted (int) are the numbers of texels with each flag.
 *
 * The picture of a missing light is predicted. For each texel, a plane over (sin θ cos φ, sin θ sin
 * φ) is fitted to ρ / cos θ_l of the nearest lights. The prediction is the value of the plane at
 * the missing light times that light's cos θ_l. The part of a light that was left out has the
 * attribute mesorig.left_out (int, 1). A missing light has no part if no light of the view was
 * captured.
 *
 * Fails if
 * - a picture cannot be read or belongs to another shot
 * - pictures differ in their colour filter
 * - more than half of a picture's texels are holes
 * - the work is cancelled
 * - the file cannot be written. */
gboolean btf_make_view(const struct btf_view *view, const char *path, GCancellable *cancellable,
                       GError **error);

/* Returns the compression of the file of a view with as many texels as the grid. */
enum exr_compression btf_compression(const struct session_grid *grid);

/* Number of texels, and number of texels with each flag, summed over parts. */
struct btf_flag_counts {
    gint64 texels, holes, bounds, shorter, predicted;
};
/* Sets the attributes mesorig.holes and so on of a part, which count the flags of its n texels. */
void btf_set_flag_counts(struct exr_part *part, const guint8 *flags, gsize n);
/* Adds a part's number of texels and its attributes mesorig.holes and so on to sums. A missing
 * attribute counts as 0. Only the headers of the part are needed. */
void btf_count_flags(const struct exr_part *part, struct btf_flag_counts *sums);

/* Returns whether the file exists, has a part for each light of the view, and was made from the
 * inputs of the view. Reads only headers. */
gboolean btf_is_made(const struct btf_view *view, const char *path);

/* Reads from a view's file the pictures of the lights whose indices are in `lights` (n_lights). The
 * indices must differ from each other. ret_rgb: n_lights × height × width × 3 (R, G, B). n_threads
 * threads decode the pictures; 0 means one per processor. Fails if the file cannot be read, if a
 * light has no part, or if a part lacks a colour or differs from the grid in size. */
gboolean btf_read_view(const char *path, const int *lights, int n_lights,
                       const struct session_grid *grid, int n_threads, float *ret_rgb,
                       GError **error);

/* Reads the attributes OF.theta_deg and OF.phi_deg, where OF is the text `of`: "view" or "light".
 * Returns FALSE if an attribute is missing or not finite. The result for that attribute is then not
 * finite. */
gboolean btf_direction(const struct exr_part *part, const char *of, float *ret_theta_deg,
                       float *ret_phi_deg);
