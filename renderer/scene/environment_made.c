#include "environment_made.h"

#include "base/direction.h"

#include <math.h>

#define WIDTH   512
#define HEIGHT  256
#define SAMPLES 4 /* samples per pixel in each direction, because boxes have sharp edges */

const char *const environment_names[] = {"studio", "overcast", NULL};

/* The boxes are a key light on the left of the default camera (φ = −90°), a dim fill light on the
 * right, a strip above the shape and a strip behind it. */
const struct environment_box environment_studio[ENVIRONMENT_BOXES] = {
    {48.0, 215.0, 0.45, 0.45, 3.2, {1.0F, 0.97F, 0.92F}},
    {65.0, -35.0, 0.50, 0.60, 0.7, {0.93F, 0.96F, 1.0F}},
    {12.0, 80.0, 0.45, 0.15, 2.6, {1.0F, 1.0F, 1.0F}},
    {68.0, 75.0, 0.15, 0.60, 2.4, {0.96F, 0.98F, 1.0F}},
};

static double dot(const float a[3], const float b[3]) {
    return (double)a[0] * b[0] + (double)a[1] * b[1] + (double)a[2] * b[2];
}

/* Unit vectors of a box: towards its centre, along the meridian upwards, and across. */
struct box_axes {
    float centre[3], along[3], across[3];
};

static void studio(const struct box_axes *axes, const float towards[3], float ret_rgb[3]) {
    for (int c = 0; c < 3; c++)
        ret_rgb[c] = (float)(ENVIRONMENT_ROOM * (1.0 + towards[2]));
    for (int k = 0; k < ENVIRONMENT_BOXES; k++) {
        const struct environment_box *box = &environment_studio[k];
        const double out = dot(towards, axes[k].centre);
        if (out > 0.0 && fabs(dot(towards, axes[k].across)) <= box->half_width * out &&
            fabs(dot(towards, axes[k].along)) <= box->half_height * out)
            for (int c = 0; c < 3; c++)
                ret_rgb[c] = (float)box->radiance * box->rgb[c];
    }
}

static void overcast(const struct box_axes *axes, const float towards[3], float ret_rgb[3]) {
    const double zenith = 9.0 / 7.0, up = towards[2];
    for (int c = 0; c < 3; c++)
        ret_rgb[c] = (float)(up > 0.0 ? zenith * (1.0 + 2.0 * up) / 3.0 : ENVIRONMENT_FLOOR);
}

struct environment *environment_make(const char *name) {
    static void (*const makers[])(const struct box_axes *axes, const float towards[3],
                                  float ret_rgb[3]) = {studio, overcast};
    struct box_axes axes[ENVIRONMENT_BOXES];
    int which = 0;
    while (environment_names[which] != NULL && !g_str_equal(environment_names[which], name))
        which++;
    if (environment_names[which] == NULL)
        return NULL;
    for (int k = 0; k < ENVIRONMENT_BOXES; k++) {
        const struct environment_box *box = &environment_studio[k];
        direction_from_deg(box->theta_deg, box->phi_deg, axes[k].centre);
        direction_from_deg(box->theta_deg - 90.0, box->phi_deg, axes[k].along);
        direction_from_deg(90.0, box->phi_deg + 90.0, axes[k].across);
    }
    struct environment *e = g_new(struct environment, 1);
    *e = (struct environment){WIDTH, HEIGHT, g_new0(float, 3 * (gsize)WIDTH * HEIGHT)};
    const double step = G_PI / (HEIGHT * SAMPLES);
    for (int y = 0; y < HEIGHT * SAMPLES; y++) {
        const int row = y / SAMPLES;
        /* The weight of a sample in its pixel is its share of the solid angle. */
        const double share = (cos(y * step) - cos((y + 1) * step)) /
                             (cos(row * SAMPLES * step) - cos((row + 1) * SAMPLES * step)) /
                             SAMPLES;
        for (int x = 0; x < WIDTH * SAMPLES; x++) {
            float *to = e->rgb + 3 * ((gsize)row * WIDTH + x / SAMPLES), towards[3], rgb[3];
            direction_from_deg(180.0 * (y + 0.5) / (HEIGHT * SAMPLES),
                               180.0 - 360.0 * (x + 0.5) / (WIDTH * SAMPLES), towards);
            makers[which](axes, towards, rgb);
            for (int c = 0; c < 3; c++)
                to[c] += rgb[c] * (float)share;
        }
    }
    return e;
}

struct environment *environment_open(const char *name, GError **error) {
    struct environment *made = environment_make(name);
    return made != NULL ? made : environment_read(name, error);
}
