#include "environment.h"

#include "drawing/gl/gpu.h"
#include "exr/exr.h"

#include <math.h>
#include <string.h>

#define MAX_RADIANCE                                                                               \
    1e30f /* the light of a whole sphere of this radiance is still finite as a float */

struct part { /* part of the picture: columns and rows; the ends are not included */
    int x0, x1, y0, y1;
    double light;
};

struct map {
    const float *rgb;
    int width, height;
};

static double solid_angle(const struct map *map, int y) {
    return 2.0 * G_PI / map->width *
           (cos(G_PI * y / map->height) - cos(G_PI * (y + 1) / map->height));
}

static double light_at(const struct map *map, int x, int y) {
    const float *p = map->rgb + 3 * ((gsize)y * map->width + x);
    return (0.2126 * p[0] + 0.7152 * p[1] + 0.0722 * p[2]) * solid_angle(map, y);
}

static double light_of(const struct map *map, const struct part *part) {
    double sum = 0.0;
    for (int y = part->y0; y < part->y1; y++)
        for (int x = part->x0; x < part->x1; x++)
            sum += light_at(map, x, y);
    return sum;
}

/* Cuts a part into two parts of about equal light (Debevec 2005). *part becomes one of them, and
 * *ret_rest the other. The cut divides the longer side. The width is measured as the angle at the
 * middle row of the part. Returns FALSE for a single pixel, which cannot be cut. */
static gboolean cut(const struct map *map, struct part *part, struct part *ret_rest) {
    const double middle = G_PI * (part->y0 + part->y1) / 2.0 / map->height;
    const double wide = 2.0 * (part->x1 - part->x0) * sin(middle) / map->width;
    const double high = (double)(part->y1 - part->y0) / map->height;
    const gboolean across = part->y1 - part->y0 == 1 || (wide > high && part->x1 - part->x0 > 1);
    const int from = across ? part->x0 : part->y0, to = across ? part->x1 : part->y1;
    if (to - from < 2)
        return FALSE;
    double sum = 0.0;
    int at = from;
    while (at < to - 1 && (at == from || sum < part->light / 2.0)) {
        struct part line = *part;
        *(across ? &line.x0 : &line.y0) = at;
        *(across ? &line.x1 : &line.y1) = at + 1;
        sum += light_of(map, &line);
        at++;
    }
    *ret_rest = *part;
    *(across ? &part->x1 : &part->y1) = at;
    *(across ? &ret_rest->x0 : &ret_rest->y0) = at;
    part->light = light_of(map, part);
    ret_rest->light = light_of(map, ret_rest);
    return TRUE;
}

/* Returns the lamp of a part. Its direction is the mean of the directions of the pixels, weighted
 * by light. Its colour is ∫ L dω / π. */
static struct viewer_lamp lamp_of(const struct map *map, const struct part *part) {
    double sum[3] = {0.0}, towards[3] = {0.0};
    for (int y = part->y0; y < part->y1; y++)
        for (int x = part->x0; x < part->x1; x++) {
            const float *p = map->rgb + 3 * ((gsize)y * map->width + x);
            const double theta = G_PI * (y + 0.5) / map->height, light = light_at(map, x, y);
            const double phi = G_PI - 2.0 * G_PI * (x + 0.5) / map->width;
            towards[0] += light * sin(theta) * cos(phi);
            towards[1] += light * sin(theta) * sin(phi);
            towards[2] += light * cos(theta);
            for (int c = 0; c < 3; c++)
                sum[c] += p[c] * solid_angle(map, y) / G_PI;
        }
    const double flat = hypot(towards[0], towards[1]), deg = 180.0 / G_PI;
    return (struct viewer_lamp){.theta_deg = atan2(flat, towards[2]) * deg,
                                .phi_deg = atan2(towards[1], towards[0]) * deg,
                                .rgb = {(float)sum[0], (float)sum[1], (float)sum[2]}};
}

int environment_lamps(const float *rgb, int width, int height, int n,
                      struct viewer_lamp ret[VIEWER_MAX_LAMPS]) {
    const struct map map = {rgb, width, height};
    struct part parts[VIEWER_MAX_LAMPS] = {{0, width, 0, height, 0.0}};
    int n_parts = 1, n_lamps = 0;
    parts[0].light = light_of(&map, &parts[0]);
    while (n_parts < MIN(n, VIEWER_MAX_LAMPS)) {
        int most = 0;
        for (int k = 1; k < n_parts; k++)
            most = parts[k].light > parts[most].light ? k : most;
        if (!(parts[most].light > 0.0) || !cut(&map, &parts[most], &parts[n_parts]))
            break;
        n_parts++;
    }
    for (int k = 0; k < n_parts; k++)
        if (parts[k].light > 0.0)
            ret[n_lamps++] = lamp_of(&map, &parts[k]);
    return n_lamps;
}

static gboolean refuse(const char *path, const char *why, GError **error) {
    g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                "%s is not an environment map: %s; use an EXR with R, G and B of radiance that is "
                "twice as wide as high",
                path, why);
    return FALSE;
}

/* Returns interleaved R, G, B, or NULL with an error. */
static float *read_rgb(const struct exr_part *part, const char *path, GError **error) {
    const gsize n = (gsize)part->width * part->height;
    const float *planes[3] = {exr_part_plane(part, "R"), exr_part_plane(part, "G"),
                              exr_part_plane(part, "B")};
    g_autofree float *rgb = g_new0(float, 3 * n);
    if (!planes[0] || !planes[1] || !planes[2]) {
        g_autofree char *missing = g_strdup_printf("channel %s is missing", !planes[0]   ? "R"
                                                                            : !planes[1] ? "G"
                                                                                         : "B");
        refuse(path, missing, error);
        return NULL;
    }
    for (gsize k = 0; k < 3 * n; k++) {
        rgb[k] = planes[k % 3][k / 3];
        if (!(rgb[k] >= 0.0f && rgb[k] <= MAX_RADIANCE)) {
            g_autofree char *bad =
                g_strdup_printf("the radiance of pixel (%zu, %zu) is %g, not within 0 … 1e30",
                                k / 3 % part->width, k / 3 / part->width, (double)rgb[k]);
            refuse(path, bad, error);
            return NULL;
        }
    }
    return g_steal_pointer(&rgb);
}

struct environment *environment_read(const char *path, GError **error) {
    g_autoptr(ExrPart) part = exr_read_picture(path, error);
    struct environment *ret = NULL;
    if (part == NULL)
        return NULL;
    float *rgb = NULL;
    g_autofree char *size = g_strdup_printf("it has %d × %d pixels", part->width, part->height);
    if (part->width != 2 * part->height)
        refuse(path, size, error);
    else if (part->outside > 0)
        refuse(path,
               "it is cropped: its data window is smaller than its display window; "
               "save the whole picture",
               error);
    else if ((rgb = read_rgb(part, path, error)) != NULL) {
        ret = g_new(struct environment, 1);
        *ret = (struct environment){part->width, part->height, rgb};
    }
    return ret;
}

void environment_free(struct environment *environment) {
    if (environment == NULL)
        return;
    g_free(environment->rgb);
    g_free(environment);
}

gboolean environment_light(const struct environment *e, struct viewer_settings *settings,
                           GError **error) {
    struct viewer_lamp *lamps = settings->lamps + settings->n_lamps;
    const int most = VIEWER_MAX_LAMPS - (settings->light_distance > 0.0); /* see lamp_settings() */
    if (settings->n_lamps >= most) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "the environment needs at least one lamp, but all %d lamps that are possible "
                    "in addition to the first are in use; give fewer lamps",
                    most);
        return FALSE;
    }
    const int room = most - settings->n_lamps;
    const int n = environment_lamps(e->rgb, e->width, e->height,
                                    MIN(room, settings->environment_lamps), lamps);
    if (n == 0) {
        g_set_error(error, GPU_ERROR, GPU_ERROR_FAILED,
                    "the environment map is black everywhere; choose another environment map");
        return FALSE;
    }
    for (int k = 0; k < n; k++)
        lamps[k].phi_deg += settings->environment_turn_deg;
    settings->n_lamps += n;
    return TRUE;
}
