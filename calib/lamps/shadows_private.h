/* Shared by shadows*.c. */
#pragma once

#include "shadows.h"

struct shot {
    int index, lamp;
    double arc_rad;
    char *name;
    float *values; /* relative to the lit plate; NaN: not on the plate */
};

struct pattern { /* statistics of one pixel over the pictures */
    float sum;   /* sum of the values in the pictures in which it is lit */
    int n;       /* number of those pictures */
    float least; /* least value that counts as lit */
};

struct ShadowView {
    struct rig *rig; /* as the plate sees it: rig_at() */
    const struct plate_map *map;
    struct plate_map *own_map; /* of this angle, if the turntable wobbles; else NULL */
    struct lamp_target target; /* its plate and the height of its plane are used */
    int camera;
    double turntable_rad;
    GArray *shots;           /* struct shot */
    struct pattern *pattern; /* pattern of the plate itself; NULL until needed */
};

/* Estimates the plate's pattern on the first call, from all pictures added so far. */
void shadow_find_pattern(ShadowView *view);
/* Value of a pixel relative to the lit plate; NaN: not on the plate. */
double shadow_value(const ShadowView *view, const struct shot *shot, gsize pixel);

/* The hull of two discs, in the plate's plane; rig frame. */
struct streak {
    struct vec3 from, to;
    double from_mm, to_mm; /* radii */
};

/* Signed distance from the hull's edge, negative inside, for discs of similar radii. */
double shadow_outside_mm(const struct streak *streak, double x_mm, double y_mm);

/* The shadow of a post from a source (a light or a camera centre). */
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
    struct streak others[2 * LAMP_MAX_MARKS]; /* bodies and shadows that may overlap it */
    int n_others;
    double slope[4]; /* mm on the plate a pixel: ∂x/∂column, ∂x/∂row, ∂y/∂column, ∂y/∂row */
    double pixel_mm, long_mm; /* size of a pixel on the plate: RMS, largest */
    GArray *pixels;           /* struct pixel */
    int hidden, near_end;
    gboolean body; /* the post itself, not its shadow */
    gboolean near; /* the foot's position is accurate; else it moves with the end */
};

#define SHADOW_SHAPE 5
struct shape_fit {
    double p[SHADOW_SHAPE]; /* end x, y; lit and dark level; variance of the lens's blur, px² */
    double rms;
    double variance[2];
};

/* Fits the end of the shadow, the two levels and the blur to the window's pixels, starting at
 * fit->p. blur_mm: additional blur, to extend the range of convergence. FALSE: no convergence. */
gboolean shadow_fit_shape(const struct window *window, double blur_mm, struct shape_fit *fit);
