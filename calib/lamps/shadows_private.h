/* Declarations that shadows.c, shadows_locate.c and shadows_shape.c share. */
#pragma once

#include "shadows.h"

struct shot {
    int index, lamp;
    double arc_rad;
    char *name;
    float *values; /* relative to the lit plate; NaN outside the plate */
};

struct pattern { /* statistics of one pixel over the pictures */
    float sum;   /* sum of the values in the pictures in which the pixel is lit */
    int n;       /* number of those pictures */
    float least; /* least value that counts as lit */
};

struct ShadowView {
    struct rig *rig; /* in the frame of the plate; see rig_at() */
    const struct plate_map *map;
    struct plate_map *own_map; /* map for this angle if the turntable wobbles; otherwise NULL */
    struct lamp_target target; /* only its plate and the height of its plane are used */
    int camera;
    double turntable_rad;
    GArray *shots;           /* struct shot */
    struct pattern *pattern; /* pattern of the plate itself; NULL until needed */
};

/* Estimates the plate's pattern on the first call, from all pictures added so far. */
void shadow_find_pattern(ShadowView *view);
/* Returns the value of a pixel relative to the lit plate, or NaN outside the plate. */
double shadow_value(const ShadowView *view, const struct shot *shot, gsize pixel);

/* The convex hull of two discs in the plane of the plate, in the rig frame. */
struct streak {
    struct vec3 from, to;
    double from_mm, to_mm; /* radii of the discs */
};

/* Returns the signed distance from the edge of the hull, negative inside. The discs must have
 * similar radii. */
double shadow_outside_mm(const struct streak *streak, double x_mm, double y_mm);

/* Computes the shadow of a post from a source, which is a lamp or the centre of a camera. Returns
 * FALSE if the source is not above the post. */
gboolean shadow_streak(const struct lamp_target *target, int mark, double turntable_rad,
                       struct vec3 source_mm, struct streak *ret);

struct pixel {
    double x, y, value; /* x, y: mm on the plate; value: as from shadow_value() */
};

struct window { /* around the end of one shadow */
    const ShadowView *view;
    const struct shot *shot;
    const struct lamp_target *target;
    int mark;
    struct streak streak;
    struct streak others[2 * LAMP_MAX_MARKS]; /* posts and shadows that may overlap the end */
    int n_others;
    double slope[4]; /* mm on the plate per pixel: ∂x/∂column, ∂x/∂row, ∂y/∂column, ∂y/∂row */
    double pixel_mm, long_mm; /* size of a pixel on the plate: RMS, and along its longer side */
    GArray *pixels;           /* struct pixel */
    /* near_end: number of pixels near the end. hidden: number of those that something else
     * hides. */
    int hidden, near_end;
    /* the window is around the top of the post itself, not around its shadow's end */
    gboolean body;
    /* TRUE: the position of the post's foot is known accurately, so the fit moves only the end of
     * the shadow. FALSE: the fit moves the foot together with the end. */
    gboolean near;
};

#define SHADOW_SHAPE 5
struct shape_fit {
    double p[SHADOW_SHAPE]; /* end x, y; lit and dark level; variance of the lens's blur, px² */
    /* RMS residual, in the unit of the levels */
    double rms;
    /* variances of the end's x and y, mm² */
    double variance[2];
};

/* Fits the end of the shadow, the two levels and the blur to the window's pixels, from the start
 * fit->p. blur_mm is an additional blur that extends the range of convergence. Returns FALSE if it
 * does not converge. */
gboolean shadow_fit_shape(const struct window *window, double blur_mm, struct shape_fit *fit);
