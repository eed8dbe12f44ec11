#include "trace_sky.h"

#include "trace_choice.h"

#include "base/direction.h"

struct TraceSky {
    int width, height;
    float *rgb;
    double turn_rad;
    struct trace_choice choice; /* chooses a pixel by its light; pixels are numbered by rows */
};

static double row_z(const TraceSky *sky, int y) {
    return cos(G_PI * y / sky->height);
}

static double sky_solid_angle(const TraceSky *sky, int y) {
    return 2.0 * G_PI / sky->width * (row_z(sky, y) - row_z(sky, y + 1));
}

TraceSky *trace_sky_new(const struct environment *e, double turn_deg) {
    const gsize n = (gsize)e->width * (gsize)e->height;
    g_autoptr(TraceSky) sky = g_new0(TraceSky, 1);
    g_autofree double *light = g_new(double, n);
    sky->width = e->width;
    sky->height = e->height;
    sky->turn_rad = turn_deg * G_PI / 180.0;
    sky->rgb = g_memdup2(e->rgb, 3 * n * sizeof(float));
    for (gsize k = 0; k < n; k++)
        light[k] = (double)rgb_luminance(e->rgb + 3 * k) *
                   sky_solid_angle(sky, (int)(k / (gsize)e->width));
    return trace_choice_init(&sky->choice, light, n) ? g_steal_pointer(&sky) : NULL;
}

void trace_sky_free(TraceSky *sky) {
    if (sky == NULL)
        return;
    trace_choice_clear(&sky->choice);
    g_free(sky->rgb);
    g_free(sky);
}

static gsize sky_pixel(const TraceSky *sky, struct vec3 d) {
    const double theta = acos(CLAMP(d.z, -1.0, 1.0));
    const double turn = (G_PI - (atan2(d.y, d.x) - sky->turn_rad)) / (2.0 * G_PI);
    const int y = CLAMP((int)(theta / G_PI * sky->height), 0, sky->height - 1);
    const int x = (int)((turn - floor(turn)) * sky->width);
    return (gsize)y * (gsize)sky->width + (gsize)CLAMP(x, 0, sky->width - 1);
}

static void sky_take(const TraceSky *sky, gsize pixel, double ret_rgb[3]) {
    for (int c = 0; c < 3; c++)
        ret_rgb[c] = (double)sky->rgb[3 * pixel + (gsize)c];
}

static double sky_pixel_density(const TraceSky *sky, gsize pixel) {
    return trace_choice_share(&sky->choice, pixel) /
           sky_solid_angle(sky, (int)(pixel / (gsize)sky->width));
}

void trace_sky_radiance(const TraceSky *sky, struct vec3 towards, double ret_rgb[3]) {
    sky_take(sky, sky_pixel(sky, towards), ret_rgb);
}

double trace_sky_density(const TraceSky *sky, struct vec3 towards) {
    return sky_pixel_density(sky, sky_pixel(sky, towards));
}

double trace_sky_draw(const TraceSky *sky, const double random[2], struct vec3 *ret_towards,
                      double ret_rgb[3]) {
    const gsize pixel = trace_choice_draw(&sky->choice, random[0]);
    const double share = trace_choice_share(&sky->choice, pixel);
    const int y = (int)(pixel / (gsize)sky->width), x = (int)(pixel % (gsize)sky->width);
    /* Within the interval of the chosen pixel, the first random number gives the position across
     * the pixel. */
    const double across =
        share > 0.0 ? CLAMP((random[0] - sky->choice.sums[pixel]) / share, 0.0, 1.0) : 0.5;
    const double z = row_z(sky, y) + random[1] * (row_z(sky, y + 1) - row_z(sky, y));
    const double phi = G_PI - 2.0 * G_PI * (x + across) / sky->width + sky->turn_rad;
    const double flat = sqrt(fmax(1.0 - z * z, 0.0));
    *ret_towards = vec3(flat * cos(phi), flat * sin(phi), z);
    sky_take(sky, pixel, ret_rgb);
    return sky_pixel_density(sky, pixel);
}
