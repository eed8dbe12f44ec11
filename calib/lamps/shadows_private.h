/* The inside of measuring shadows, for shadows*.c. */
#pragma once

#include "shadows.h"

struct shot {
    int index, lamp;
    double arc_rad;
    char *name;
    float *values; /* relative to the lit plate; NaN: not on the plate */
};

struct pattern { /* of a pixel */
    float sum;   /* of the values in those pictures in which it is lit, */
    int n;       /* which are so many, and */
    float least; /* at least so bright */
};

struct ShadowView {
    const struct rig *rig;
    const struct plate_map *map;
    struct lamp_target target; /* for plate and plane */
    int camera;
    double turntable_rad;
    GArray *shots;           /* struct shot */
    struct pattern *pattern; /* the plate's own; NULL until it is needed */
};

/* The plate's own pattern is found when it is first needed, of all pictures there are by then. */
void shadow_find_pattern(ShadowView *view);
/* How bright the plate is at a pixel, of how bright it is where it is lit; NaN: not the plate. */
double shadow_value(const ShadowView *view, const struct shot *shot, gsize pixel);

/* The hull of two discs, in the plate's plane; rig frame. */
struct streak {
    struct vec3 from, to;
    double from_mm, to_mm; /* radii */
};

/* Distance from the hull's edge, negative inside. The discs differ little. */
double shadow_outside_mm(const struct streak *streak, double x_mm, double y_mm);

/* What a light, or an eye, at a point makes of a post. */
gboolean shadow_streak(const struct lamp_target *target, int mark, double turntable_rad,
                       struct vec3 source_mm, struct streak *ret);

struct pixel {
    double x, y, value; /* mm on the plate */
};

struct window { /* around the end of one shadow */
    const ShadowView *view;
    const struct shot *shot;
    const struct lamp_target *target;
    int mark;
    struct streak streak;
    struct streak others[2 * LAMP_MAX_MARKS]; /* that may lie over it: bodies and shadows */
    int n_others;
    double slope[4]; /* mm on the plate a pixel: ∂x/∂column, ∂x/∂row, ∂y/∂column, ∂y/∂row */
    double pixel_mm, long_mm; /* a pixel's side on the plate: usual, longest */
    GArray *pixels;           /* struct pixel */
    int hidden, near_end;
    gboolean body; /* the post itself, not its shadow */
    gboolean near; /* the foot is where it is said to be; else it is off as the end is */
};

#define SHADOW_SHAPE 5
struct shape_fit {
    double p[SHADOW_SHAPE]; /* end x, y; lit and dark level; variance of the lens's blur, px² */
    double rms;
    double variance[2];
};

/* Fits the end of the window's streak, the levels and the blur to its pixels; starts at fit->p.
 * blur_mm: on top of the pixels' own, to reach further. FALSE: it does not converge. */
gboolean shadow_fit_shape(const struct window *window, double blur_mm, struct shape_fit *fit);
