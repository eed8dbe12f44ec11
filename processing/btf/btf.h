/*
 * One view of the BTF: the frames of all lights, rectified and divided by what a white diffuser
 * would have shown; see pipeline.h for the file. Any thread.
 */
#pragma once

#include "frames/rectify.h"
#include "session/inputs.h"

/* Counts up whenever the same frames give other numbers: what older ones made is made again. */
#define BTF_METHOD 6

/* What a texel's pixels were: bits of a part's channel "mark", which is there if any is not 0. */
enum btf_mark {
    BTF_MARK_SHORTER = 1, /* too bright for the longest exposure: shorter ones tell, noisier */
    BTF_MARK_BOUND = 2,   /* too bright for all of them: the value is a lower bound */
    BTF_MARK_HOLE = 4, /* no numbers, or outside of the picture: the value is 0 and says nothing */
    BTF_MARK_PREDICTED = 8, /* there is no picture: made of those of the lights around it */
};

/* A view with more of its lights missing is not made. */
#define BTF_MOST_MISSING 0.1

struct btf_light {
    int index; /* of the light */
    double theta_deg, phi_deg;
    const struct rig_arc *arc; /* borrowed, as the lamp */
    const struct rig_lamp *lamp;
    const struct radiometry_lamp *radiometry; /* may be not known */
    double arc_rad;
    double output;    /* of the lamp in this shot, of what it was calibrated at */
    gboolean missing; /* the plan left it out; input is empty */
    struct input input;
};

struct btf_view {
    int index; /* of the view */
    double theta_deg, phi_deg;
    const struct rig_camera *camera;            /* borrowed, as the next */
    const struct radiometry_camera *radiometry; /* may be not known */
    double turntable_rad;
    struct session_grid grid;
    GArray *lights; /* of struct btf_light, in order of index */
    int n_missing;  /* of them; at most BTF_MOST_MISSING of all */
    char *inputs;   /* hash of all of the above */
};

void btf_view_free(struct btf_view *view); /* NULL is ignored */

/* Writes the file. Attributes of its parts beside those of pipeline.h: mesorig.inputs (string);
 * mesorig.holes, mesorig.bounds, mesorig.shorter, mesorig.predicted (int): texels with each mark.
 * A light that is missing has, over cos θ_l, the value of the plane that fits the nearest lights'
 * best over (sin θ cos φ, sin θ sin φ). */
gboolean btf_make_view(const struct btf_view *view, const char *path, GCancellable *cancellable,
                       GError **error);

/* Of one part or many. */
struct btf_marks {
    gint64 texels, holes, bounds, shorter, predicted;
};
void btf_add_marks(const struct exr_part *part, struct btf_marks *sums); /* headers suffice */

/* Whether the file is there and was made of these inputs. */
gboolean btf_is_made(const struct btf_view *view, const char *path);

/* Reads a view back: n_lights × height × width × 3, R G B. */
gboolean btf_read_view(const char *path, const int *lights, int n_lights,
                       const struct session_grid *grid, float *ret_rgb, GError **error);

/* The direction that a part of the file says of its "view" or "light"; FALSE if one of its angles
 * is missing or not finite. */
gboolean btf_direction(const struct exr_part *part, const char *of, float *ret_theta_deg,
                       float *ret_phi_deg);
