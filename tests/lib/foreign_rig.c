#include "foreign_rig.h"

#include <png.h>
#include <stdio.h>

#define WHITE_DN 4095
#define RESPONSE 6000

#define AMBIENT 0.002 /* light of a frame of a sweep outside the line, as a share of white */
#define SIGMAS  4.0   /* standard deviations beyond which a sheet gives no light */

/* The point that a ray meets. */
struct foreign_hit {
    double t; /* distance along the ray; 0 if the ray meets nothing */
    double normal[3];
    double reflectance[3];
};

static inline double foreign_dot(const double *a, const double *b) {
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

static void foreign_along(const double *p, const double *d, double t, double *ret) {
    for (int i = 0; i < 3; i++)
        ret[i] = p[i] + t * d[i];
}

static void foreign_between(const double *from, const double *to, double *ret) {
    for (int i = 0; i < 3; i++)
        ret[i] = to[i] - from[i];
}

/* Normalises a vector. Returns its former length. */
static double foreign_unit(double *a) {
    const double length = sqrt(foreign_dot(a, a));
    for (int i = 0; i < 3; i++)
        a[i] /= length;
    return length;
}

/* Returns whether t is above least and below the distance of the hit found so far. */
static gboolean foreign_nearer(const struct foreign_hit *hit, double t, double least) {
    return t > least && (hit->t == 0 || t < hit->t);
}

static void foreign_meet_plate(const struct foreign_plate *plate, const double *p, const double *d,
                               double least, struct foreign_hit *hit) {
    const double *r = plate->right, *u = plate->up;
    double n[3] = {r[1] * u[2] - r[2] * u[1], r[2] * u[0] - r[0] * u[2], r[0] * u[1] - r[1] * u[0]};
    double way[3], at[3];
    foreign_between(p, plate->middle_mm, way);
    const double across = foreign_dot(n, d), t = foreign_dot(n, way) / across;
    if (across == 0 || !foreign_nearer(hit, t, least))
        return;
    foreign_along(p, d, t, at);
    foreign_between(plate->middle_mm, at, way);
    const double x = foreign_dot(way, r), y = foreign_dot(way, u);
    if (fabs(x) > plate->half_mm[0] || fabs(y) > plate->half_mm[1])
        return;
    *hit = (struct foreign_hit){.t = t};
    for (int i = 0; i < 3; i++) {
        hit->normal[i] = across < 0 ? n[i] : -n[i];
        hit->reflectance[i] = plate->print(x, y, i);
    }
}

static void foreign_meet_sphere(const struct foreign_sphere *s, const double *p, const double *d,
                                double least, struct foreign_hit *hit) {
    double o[3], at[3];
    foreign_between(s->centre_mm, p, o);
    const double b = foreign_dot(o, d);
    const double q = b * b - foreign_dot(o, o) + s->radius_mm * s->radius_mm;
    if (b >= 0 || q <= 0)
        return;
    const double t = -b - sqrt(q);
    if (!foreign_nearer(hit, t, least))
        return;
    *hit = (struct foreign_hit){.t = t};
    foreign_along(p, d, t, at);
    foreign_between(s->centre_mm, at, hit->normal);
    foreign_unit(hit->normal);
    memcpy(hit->reflectance, s->reflectance, sizeof hit->reflectance);
}

/* Tests the side of the tube where the ray enters, and the two ends. */
static void foreign_meet_tube(const struct foreign_tube *tube, const double *p, const double *d,
                              double least, struct foreign_hit *hit) {
    const double *a = tube->along, r2 = tube->radius_mm * tube->radius_mm;
    double o[3], at[3], n[3];
    foreign_between(tube->from_mm, p, o);
    const double da = foreign_dot(d, a), oa = foreign_dot(o, a);
    const double dd = 1 - da * da, od = foreign_dot(o, d) - oa * da;
    const double q = od * od - dd * (foreign_dot(o, o) - oa * oa - r2);
    if (q <= 0)
        return;
    const double ts[3] = {(-od - sqrt(q)) / dd, -oa / da, (tube->length_mm - oa) / da};
    for (int k = 0; k < 3; k++) {
        if (!isfinite(ts[k]) || !foreign_nearer(hit, ts[k], least))
            continue;
        foreign_along(p, d, ts[k], at);
        foreign_between(tube->from_mm, at, n);
        const double along = foreign_dot(n, a);
        for (int i = 0; i < 3; i++)
            n[i] -= along * a[i];
        if (k == 0 ? along < 0 || along > tube->length_mm : foreign_dot(n, n) > r2)
            continue;
        *hit = (struct foreign_hit){.t = ts[k]};
        for (int i = 0; i < 3; i++)
            hit->normal[i] = k == 0 ? n[i] / tube->radius_mm : k == 1 ? -a[i] : a[i];
        memcpy(hit->reflectance, tube->reflectance, sizeof hit->reflectance);
    }
}

/* Returns the nearest point of the scene along the ray p + t·d with t > least. */
static struct foreign_hit foreign_meet(const struct foreign_scene *scene, const double *p,
                                       const double *d, double least) {
    struct foreign_hit hit = {0};
    double at[3];
    const double t = d[2] != 0 ? (scene->plane_mm - p[2]) / d[2] : 0;
    if (t > least) {
        hit = (struct foreign_hit){.t = t, .normal = {0, 0, 1}};
        foreign_along(p, d, t, at);
        for (int c = 0; c < 3; c++)
            hit.reflectance[c] = scene->print(at[0], at[1], c);
    }
    for (int i = 0; i < scene->n_plates; i++)
        foreign_meet_plate(&scene->plates[i], p, d, least, &hit);
    for (int i = 0; i < scene->n_spheres; i++)
        foreign_meet_sphere(&scene->spheres[i], p, d, least, &hit);
    for (int i = 0; i < scene->n_tubes; i++)
        foreign_meet_tube(&scene->tubes[i], p, d, least, &hit);
    return hit;
}

/* Returns the distance between two points, or 0 if something is between them. ret_way is the unit
 * vector from the first to the second point. */
static double foreign_sees(const struct foreign_scene *scene, const double *from, const double *to,
                           double *ret_way) {
    foreign_between(from, to, ret_way);
    const double length = foreign_unit(ret_way);
    const struct foreign_hit hit = foreign_meet(scene, from, ret_way, 1e-6);
    return hit.t > 0 && hit.t < length ? 0 : length;
}

/* Returns I·cosⁿ of the angle to the lamp's aim, which is the origin. l is the unit vector from the
 * point to the lamp. */
static double foreign_intensity(const struct arc_lamp *lamp, const double *lamp_mm,
                                const double *l) {
    if (lamp->exponent == 0)
        return lamp->intensity;
    const double cosine = foreign_dot(lamp_mm, l) / lamp->distance_mm;
    return cosine > 0 ? lamp->intensity * pow(cosine, lamp->exponent) : 0;
}

/* Adds the radiance L_c = ρ_c/π · I·max(0, n·l)/r² of the point that a ray meets; 0 in shadow. All
 * vectors are in the sample frame. */
static void foreign_radiance(const struct foreign_scene *scene, const double *eye, const double *d,
                             const struct arc_lamp *lamp, const double *lamp_mm, double *add) {
    const struct foreign_hit hit = foreign_meet(scene, eye, d, 0);
    double p[3], l[3];
    if (hit.t == 0)
        return;
    foreign_along(eye, d, hit.t, p);
    const double r = foreign_sees(scene, p, lamp_mm, l);
    const double cosine = foreign_dot(hit.normal, l);
    if (r == 0 || cosine <= 0)
        return;
    const double e = foreign_intensity(lamp, lamp_mm, l) / (r * r * 1e-6);
    for (int c = 0; c < 3; c++) /* W·sr⁻¹·m⁻² */
        add[c] += hit.reflectance[c] / G_PI * cosine * e;
}

/* Computes the positions of camera and lamp in the sample frame. */
static void foreign_places(const struct foreign_shot *shot, double *eye, double *lamp) {
    lamp[0] = shot->lamp->distance_mm * sin(shot->lamp->theta);
    lamp[1] = 0;
    lamp[2] = shot->lamp->distance_mm * cos(shot->lamp->theta);
    pinhole_eye(shot->camera, eye);
    analytic_turn(eye, -shot->turntable, eye);
    analytic_turn(lamp, shot->arc - shot->turntable, lamp);
}

gboolean foreign_clear(const struct foreign_scene *scene, const struct foreign_shot *shot,
                       double x_mm, double y_mm) {
    const double p[3] = {x_mm, y_mm, scene->plane_mm};
    double to[2][3], way[3];
    foreign_places(shot, to[0], to[1]);
    return foreign_sees(scene, p, to[0], way) > 0 && foreign_sees(scene, p, to[1], way) > 0;
}

gboolean foreign_distance_mm(const struct foreign_scene *scene, const struct pinhole *camera,
                             double turntable, const double point_mm[3], double *ret_mm) {
    double eye[3], d[3];
    pinhole_eye(camera, eye);
    analytic_turn(eye, -turntable, eye);
    foreign_between(eye, point_mm, d);
    const double length = foreign_unit(d);
    const struct foreign_hit hit = foreign_meet(scene, eye, d, 0);
    *ret_mm = hit.t - length;
    return hit.t > 0;
}

void foreign_seen(const struct foreign_scene *scene, const struct foreign_shot *shot,
                  const double point_mm[3], double ret[3]) {
    double eye[3], lamp[3], d[3];
    foreign_places(shot, eye, lamp);
    foreign_between(eye, point_mm, d);
    foreign_unit(d);
    ret[0] = ret[1] = ret[2] = 0;
    foreign_radiance(scene, eye, d, shot->lamp, lamp, ret);
}

/* Returns the camera's rays through the corners of its pixels, in the sample frame: (width + 1) ×
 * (height + 1) × 3; g_free(). Within a pixel, the distortion of the lens is negligible. */
static double *foreign_corners(const struct pinhole *camera, double turntable) {
    const int columns = camera->width + 1, n = columns * (camera->height + 1);
    double *rays = g_new(double, 3 * n);
    for (int i = 0; i < n; i++) {
        pinhole_ray(camera, i % columns - 0.5, (int)(i / columns) - 0.5, rays + 3 * i);
        analytic_turn(rays + 3 * i, -turntable, rays + 3 * i);
    }
    return rays;
}

/* Computes the ray of sample i of the k × k samples of a pixel. */
static void foreign_ray(const struct pinhole *camera, const double *corners, int pixel, int i,
                        int k, double *ret) {
    const int down = camera->width + 1;
    const double *at = corners + 3 * (pixel / camera->width * down + pixel % camera->width);
    const double u = (i % k + 0.5) / k, v = ((int)(i / k) + 0.5) / k;
    for (int c = 0; c < 3; c++)
        ret[c] = (1 - v) * ((1 - u) * at[c] + u * at[3 + c]) +
                 v * ((1 - u) * at[3 * down + c] + u * at[3 * down + 3 + c]);
    foreign_unit(ret);
}

/* Returns the number of samples of a pixel in each direction: 1 if it shows the print far from the
 * axis. */
static int foreign_samples(const struct foreign_scene *scene, const double *eye, const double *d,
                           int samples, double fine_mm) {
    double p[3];
    foreign_along(eye, d, (scene->plane_mm - eye[2]) / d[2], p);
    return fine_mm > 0 && hypot(p[0], p[1]) > fine_mm ? 1 : samples;
}

float *foreign_render(const struct foreign_scene *scene, const struct foreign_shot *shot) {
    const struct pinhole *camera = shot->camera;
    const int n = camera->width * camera->height;
    float *planes = g_new(float, 3 * n);
    g_autofree double *corners = foreign_corners(camera, shot->turntable);
    double eye[3], lamp[3], d[3];
    foreign_places(shot, eye, lamp);
    for (int pixel = 0; pixel < n; pixel++) {
        foreign_ray(camera, corners, pixel, 0, 1, d);
        const int k = foreign_samples(scene, eye, d, shot->samples, shot->fine_mm);
        const double scale = RESPONSE * shot->exposure_ms / 1000 / WHITE_DN / (k * k);
        double sum[3] = {0};
        for (int i = 0; i < k * k; i++) {
            foreign_ray(camera, corners, pixel, i, k, d);
            foreign_radiance(scene, eye, d, shot->lamp, lamp, sum);
        }
        for (int c = 0; c < 3; c++)
            planes[c * n + pixel] = (float)(sum[c] * scale);
    }
    return planes;
}

/* Adds the light that a ray receives during a sweep to one pixel of its frames, which are n floats
 * apart. */
static void foreign_add_line(const struct foreign_scene *scene, const struct foreign_sweep *sweep,
                             const double *eye, const double *d, const double *laser, double share,
                             gsize n, float *pixel) {
    double p[3], l[3];
    const struct foreign_hit hit = foreign_meet(scene, eye, d, 0);
    if (hit.t == 0)
        return;
    foreign_along(eye, d, hit.t, p);
    const double r = foreign_sees(scene, p, laser, l), cosine = foreign_dot(hit.normal, l);
    if (r == 0 || cosine <= 0)
        return;
    const double sheet = line_laser_sweep(sweep->laser, sweep->arc - sweep->turntable, p);
    const double at = (sheet - sweep->from_rad) / sweep->step_rad;
    const double reach = SIGMAS * sweep->sigma_rad / fabs(sweep->step_rad);
    const double light = sweep->peak * hit.reflectance[1] * cosine * share;
    for (int f = (int)MAX(ceil(at - reach), 0); f <= MIN(at + reach, sweep->steps - 1); f++) {
        const double off = (f - at) * sweep->step_rad / sweep->sigma_rad;
        pixel[(gsize)f * n] += (float)(light * exp(-off * off / 2));
    }
}

float *foreign_render_sweep(const struct foreign_scene *scene, const struct foreign_sweep *sweep) {
    const struct pinhole *camera = sweep->camera;
    const gsize n = (gsize)camera->width * (gsize)camera->height;
    float *frames = g_new(float, (gsize)sweep->steps *n);
    g_autofree double *corners = foreign_corners(camera, sweep->turntable);
    double eye[3], laser[3], d[3];
    pinhole_eye(camera, eye);
    analytic_turn(eye, -sweep->turntable, eye);
    line_laser_position(sweep->laser, sweep->arc - sweep->turntable, laser);
    for (gsize i = 0; i < (gsize)sweep->steps * n; i++)
        frames[i] = (float)AMBIENT;
    for (gsize pixel = 0; pixel < n; pixel++) {
        foreign_ray(camera, corners, (int)pixel, 0, 1, d);
        const int k = foreign_samples(scene, eye, d, sweep->samples, sweep->fine_mm);
        for (int i = 0; i < k * k; i++) {
            foreign_ray(camera, corners, (int)pixel, i, k, d);
            foreign_add_line(scene, sweep, eye, d, laser, 1.0 / (k * k), n, frames + pixel);
        }
    }
    return frames;
}

/* Returns an approximately normal number with mean 0 and variance 1: the sum of the four parts of a
 * random number of 64 bits, by xorshift64* (Vigna 2016). */
static double foreign_normal(guint64 *state) {
    *state ^= *state >> 12;
    *state ^= *state << 25;
    *state ^= *state >> 27;
    const guint64 bits = *state * G_GUINT64_CONSTANT(0x2545F4914F6CDD1D);
    const double sum = (double)(bits & 0xFFFF) + (double)(bits >> 16 & 0xFFFF) +
                       (double)(bits >> 32 & 0xFFFF) + (double)(bits >> 48);
    return (sum - 2 * 65535) / (65536 * sqrt(4 / 12.0));
}

void foreign_expose(struct foreign_sensor *sensor, float *values, gsize n) {
    const double read = sensor->read_noise_e * sensor->read_noise_e;
    for (gsize i = 0; i < n; i++) {
        const double electrons = (double)values[i] * sensor->full_well_e;
        const double noisy =
            electrons + sqrt(MAX(electrons, 0) + read) * foreign_normal(&sensor->state);
        values[i] = (float)MIN(noisy / sensor->full_well_e, 1);
    }
}

void foreign_write_png(const char *path, const guint16 *codes, int width, int height, int channels,
                       int bits) {
    FILE *file = fopen(path, "wb");
    png_structp png = png_create_write_struct(PNG_LIBPNG_VER_STRING, NULL, NULL, NULL);
    png_infop info = png ? png_create_info_struct(png) : NULL;
    g_assert_true(file && info);
    if (setjmp(png_jmpbuf(png)))
        g_error("%s: libpng cannot write it", path);
    png_init_io(png, file);
    png_set_IHDR(png, info, (guint32)width, (guint32)height, bits,
                 channels == 1 ? PNG_COLOR_TYPE_GRAY : PNG_COLOR_TYPE_RGB, PNG_INTERLACE_NONE,
                 PNG_COMPRESSION_TYPE_DEFAULT, PNG_FILTER_TYPE_DEFAULT);
    png_set_compression_level(png, 1);
    png_set_filter(png, 0, PNG_FILTER_NONE);
    png_write_info(png, info);
    const int n = width * channels;
    g_autofree guint8 *row = g_new(guint8, 2 * n);
    for (int y = 0; y < height; y++) {
        for (int x = 0; x < n; x++) {
            const guint16 code = codes[y * n + x];
            if (bits == 16) {
                row[2 * x] = (guint8)(code >> 8);
                row[2 * x + 1] = (guint8)(code & 255);
            } else {
                row[x] = (guint8)code;
            }
        }
        png_write_row(png, row);
    }
    png_write_end(png, NULL);
    png_destroy_write_struct(&png, &info);
    g_assert_cmpint(fclose(file), ==, 0);
}
