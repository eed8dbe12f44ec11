#include "foreign_rig.h"

#include <png.h>
#include <stdio.h>

#define WHITE_DN 4095
#define RESPONSE 6000

/* The nearest point of the scene along a ray p + t·d, t > least; 0: none. ret_sphere: −1, the
 * plane.
 */
static double foreign_hit(const struct foreign_scene *scene, const double *p, const double *d,
                          double least, int *ret_sphere) {
    double nearest = d[2] != 0 ? (scene->plane_mm - p[2]) / d[2] : 0;
    *ret_sphere = -1;
    if (nearest <= least)
        nearest = 0;
    for (int i = 0; i < scene->n_spheres; i++) {
        const struct foreign_sphere *s = &scene->spheres[i];
        const double o[3] = {p[0] - s->centre_mm[0], p[1] - s->centre_mm[1],
                             p[2] - s->centre_mm[2]};
        const double b = analytic_dot(o, d);
        const double q = b * b - analytic_dot(o, o) + s->radius_mm * s->radius_mm;
        const double t = q > 0 ? -b - sqrt(q) : 0;
        if (t > least && (nearest == 0 || t < nearest)) {
            nearest = t;
            *ret_sphere = i;
        }
    }
    return nearest;
}

/* Radiance L_c = ρ_c/π · I·max(0, n·l)/r², 0 in shadow, of what a ray meets; sample frame. */
static void foreign_radiance(const struct foreign_scene *scene, const double *eye, const double *d,
                             const double *lamp_mm, double intensity, double *add) {
    int sphere, other;
    const double t = foreign_hit(scene, eye, d, 0, &sphere);
    if (t == 0)
        return;
    const double p[3] = {eye[0] + t * d[0], eye[1] + t * d[1], eye[2] + t * d[2]};
    double n[3] = {0, 0, 1}, l[3];
    for (int i = 0; i < 3; i++) {
        l[i] = lamp_mm[i] - p[i];
        if (sphere >= 0)
            n[i] = (p[i] - scene->spheres[sphere].centre_mm[i]) / scene->spheres[sphere].radius_mm;
    }
    const double r = sqrt(analytic_dot(l, l));
    for (int i = 0; i < 3; i++)
        l[i] /= r;
    const double cosine = analytic_dot(n, l);
    const double blocked = foreign_hit(scene, p, l, 1e-6, &other);
    if (cosine <= 0 || (blocked > 0 && blocked < r))
        return;
    for (int c = 0; c < 3; c++) {
        const double rho =
            sphere >= 0 ? scene->spheres[sphere].reflectance[c] : scene->print(p[0], p[1], c);
        add[c] += rho / G_PI * intensity * cosine / (r * r * 1e-6); /* W·sr⁻¹·m⁻² */
    }
}

/* Positions of camera and lamp in the sample frame. */
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
    double to[2][3];
    foreign_places(shot, to[0], to[1]);
    for (int k = 0; k < 2; k++) {
        int sphere;
        for (int i = 0; i < 3; i++)
            to[k][i] -= p[i];
        const double length = sqrt(analytic_dot(to[k], to[k]));
        for (int i = 0; i < 3; i++)
            to[k][i] /= length;
        if (foreign_hit(scene, p, to[k], 1e-6, &sphere) > 0)
            return FALSE;
    }
    return TRUE;
}

float *foreign_render(const struct foreign_scene *scene, const struct foreign_shot *shot) {
    const struct pinhole *camera = shot->camera;
    const int n = camera->width * camera->height, k = shot->samples;
    const double scale = RESPONSE * shot->exposure_ms / 1000 / WHITE_DN / (k * k);
    float *planes = g_new(float, 3 * n);
    double eye[3], lamp[3];
    foreign_places(shot, eye, lamp);
    for (int pixel = 0; pixel < n; pixel++) {
        const int column = pixel % camera->width, row = pixel / camera->width;
        double sum[3] = {0};
        for (int i = 0; i < k * k; i++) {
            const int across = i % k, down = i / k;
            double d[3];
            pinhole_ray(camera, column - 0.5 + (across + 0.5) / k, row - 0.5 + (down + 0.5) / k, d);
            analytic_turn(d, -shot->turntable, d);
            foreign_radiance(scene, eye, d, lamp, shot->lamp->intensity, sum);
        }
        for (int c = 0; c < 3; c++)
            planes[c * n + pixel] = (float)(sum[c] * scale);
    }
    return planes;
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
