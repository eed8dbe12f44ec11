#include "highlights.h"

#include <math.h>
#include <stdlib.h>

#define EDGE        0.2   /* of the peak: the spot's border, up to where its light is weighed */
#define ABOVE_NOISE 12.0  /* the peak, in units of what the surroundings vary by */
#define FLAT        0.998 /* of the brightest: as bright as it */
#define FLAT_PIXELS 7     /* so many are as bright only where the spot is cut off */
#define SIGHT_PX    0.03  /* standard deviation of a middle */
#define SLANT       0.3   /* cosine at which a highlight is too near to the ball's rim */
#define SPOT_SHARE  0.2   /* of a ball's picture, that a spot may take up */

struct spot {
    const struct picture *picture;
    int left, top, width, height; /* of the window */
    float *values;                /* above the background; −1: not in the circle */
    guint8 *in;
};

static int compare(gconstpointer a, gconstpointer b) {
    float x = *(const float *)a, y = *(const float *)b;
    return x < y ? -1 : x > y;
}

static gboolean cut(struct spot *s, double x, double y, double r) {
    s->left = (int)ceil(x - r);
    s->top = (int)ceil(y - r);
    s->width = (int)floor(x + r) - s->left + 1;
    s->height = (int)floor(y + r) - s->top + 1;
    if (s->left < 0 || s->top < 0 || s->width < 5 || s->height < 5 ||
        s->left + s->width > s->picture->width || s->top + s->height > s->picture->height)
        return FALSE;
    s->values = g_new(float, (gsize)s->width *(gsize)s->height);
    s->in = g_new0(guint8, (gsize)s->width * (gsize)s->height);
    for (int j = 0; j < s->height; j++)
        for (int i = 0; i < s->width; i++) {
            float value = s->picture->values[(s->top + j) * s->picture->width + s->left + i];
            gboolean inside = hypot(s->left + i - x, s->top + j - y) <= r && isfinite(value);
            s->values[j * s->width + i] = inside ? value : -G_MAXFLOAT;
        }
    return TRUE;
}

/* Median, and how far values usually are from it: 1.4826 times the median of distances is σ. */
static void background(const struct spot *s, float *ret_level, float *ret_noise) {
    int n = 0, all = s->width * s->height;
    g_autofree float *sorted = g_new(float, all);
    for (int i = 0; i < all; i++)
        if (s->values[i] > -G_MAXFLOAT)
            sorted[n++] = s->values[i];
    qsort(sorted, (gsize)n, sizeof *sorted, compare);
    *ret_level = sorted[n / 2];
    for (int i = 0; i < n; i++)
        sorted[i] = fabsf(sorted[i] - *ret_level);
    qsort(sorted, (gsize)n, sizeof *sorted, compare);
    *ret_noise = 1.4826f * sorted[n / 2];
}

static int brightest(const struct spot *s) {
    int best = 0;
    for (int i = 1; i < s->width * s->height; i++)
        if (s->values[i] > s->values[best])
            best = i;
    return best;
}

/* Marks what hangs together with the peak; returns how many pixels. */
static int grow(struct spot *s, int peak, float least) {
    g_autofree int *stack = g_new(int, s->width * s->height);
    int n = 0, count = 0;
    stack[n++] = peak;
    s->in[peak] = 1;
    while (n > 0) {
        int at = stack[--n], x = at % s->width, y = at / s->width;
        count++;
        for (int k = 0; k < 9; k++) {
            int i = x + k % 3 - 1, j = y + k / 3 - 1;
            if (i < 0 || j < 0 || i >= s->width || j >= s->height)
                continue;
            int next = j * s->width + i;
            if (!s->in[next] && s->values[next] >= least) {
                s->in[next] = 1;
                stack[n++] = next;
            }
        }
    }
    return count;
}

/* Pixels of the spot that are as bright as the brightest of their phase of a colour filter, each of
 * which may be cut off at a value of its own. */
static int flat_pixels(const struct spot *s) {
    float most[4] = {0};
    int count = 0;
    for (int pass = 0; pass < 2; pass++)
        for (int i = 0; i < s->width * s->height; i++) {
            int phase = 2 * (i / s->width & 1) + (i % s->width & 1);
            if (s->in[i] && pass == 0)
                most[phase] = fmaxf(most[phase], s->values[i]);
            else if (s->in[i])
                count += s->values[i] >= (float)FLAT * most[phase];
        }
    return count;
}

static const char *centroid(struct spot *s, double most_px, double *ret_x, double *ret_y) {
    float level, noise;
    background(s, &level, &noise);
    int peak = brightest(s);
    float height = s->values[peak] - level, least = level + (float)EDGE * height;
    if (!(height > (float)ABOVE_NOISE * noise) || !(height > 0.05f * fabsf(level)))
        return "shows no lamp: nothing in it is brighter than the rest";
    int count = grow(s, peak, least);
    double sum = 0, x = 0, y = 0;
    for (int i = 0; i < s->width * s->height; i++) {
        if (!s->in[i])
            continue;
        double weight = (double)(s->values[i] - least);
        sum += weight;
        int column = i % s->width, row = i / s->width;
        x += weight * column;
        y += weight * row;
    }
    if (flat_pixels(s) >= FLAT_PIXELS)
        return "is saturated where it shows the lamp; expose less";
    if (count > most_px)
        return "shows a spot too large to be a lamp; is the ball glossy, the lamp far enough?";
    *ret_x = s->left + x / sum;
    *ret_y = s->top + y / sum;
    return NULL;
}

const char *highlight_find(const struct picture *picture, double x_px, double y_px,
                           double radius_px, double most_px, double *ret_x, double *ret_y) {
    struct spot spot = {.picture = picture};
    if (!cut(&spot, x_px, y_px, radius_px))
        return "is not wholly in the picture";
    const char *why = centroid(&spot, most_px, ret_x, ret_y);
    g_free(spot.values);
    g_free(spot.in);
    return why;
}

struct outline {
    double x, y, radius_px;
};

static gboolean outline_of(const struct rig_camera *camera, struct vec3 centre, double radius_mm,
                           struct outline *ret) {
    double range = vec3_length(vec3_sub(rig_camera_centre_mm(camera), centre));
    ret->radius_px = MAX(camera->fx_px, camera->fy_px) * radius_mm / range;
    return rig_project(camera, centre, &ret->x, &ret->y) && ret->radius_px < camera->width &&
           ret->x > -camera->width && ret->x < 2 * camera->width && ret->y > -camera->height &&
           ret->y < 2 * camera->height;
}

/* Another ball before it, or between it and the lamp, may hide what it shows. */
static gboolean is_free(const struct lamp_target *target, int mark, double turntable_rad,
                        struct vec3 towards) {
    struct vec3 at = lamp_mark_mm(target, mark, turntable_rad);
    struct vec3 way = vec3_unit(vec3_sub(towards, at));
    for (int i = 0; i < target->n; i++) {
        struct vec3 other = vec3_sub(lamp_mark_mm(target, i, turntable_rad), at);
        double along = vec3_dot(other, way);
        if (i != mark && along > 0 &&
            vec3_length(vec3_sub(other, vec3_scale(way, along))) <
                target->marks[i].size_mm + target->marks[mark].size_mm)
            return FALSE;
    }
    return TRUE;
}

static void measure_ball(const struct rig *rig, const struct lamp_target *target,
                         const struct highlight_picture *from, int mark, double reach_mm,
                         GArray *sights, GPtrArray *rejected) {
    const struct rig_camera *camera = &rig->cameras[from->camera];
    struct vec3 centre = lamp_mark_mm(target, mark, from->turntable_rad);
    struct vec3 eye = vec3_unit(vec3_sub(rig_camera_centre_mm(camera), centre));
    struct vec3 lamp_mm = rig_lamp_position_mm(&rig->arc, &rig->lamps[from->lamp], from->arc_rad);
    struct vec3 lamp = vec3_unit(vec3_sub(lamp_mm, centre));
    double radius = target->marks[mark].size_mm, x, y, at_x, at_y;
    struct outline ball, reach;
    if (sqrt(MAX(0, (1 + vec3_dot(eye, lamp)) / 2)) < SLANT ||
        !is_free(target, mark, from->turntable_rad, lamp_mm) ||
        !is_free(target, mark, from->turntable_rad, rig_camera_centre_mm(camera)) ||
        !outline_of(camera, centre, radius, &ball) ||
        !outline_of(camera, centre, MIN(reach_mm, radius) + 0.25 * radius, &reach) ||
        !lamp_highlight_px(camera, centre, radius, lamp_mm, &x, &y))
        return;
    double most_px = MAX(SPOT_SHARE * G_PI * ball.radius_px * ball.radius_px, 9);
    const char *why = highlight_find(from->picture, x, y, reach.radius_px, most_px, &at_x, &at_y);
    if (why) {
        g_ptr_array_add(rejected,
                        g_strdup_printf("%s: ball %d %s", from->picture->name, mark + 1, why));
        return;
    }
    struct lamp_sight sight = {
        from->index,   from->lamp, from->camera, mark,    from->turntable_rad,
        from->arc_rad, at_x,       at_y,         SIGHT_PX};
    g_array_append_val(sights, sight);
}

gboolean highlights_measure(const struct rig *rig, const struct lamp_target *target,
                            const struct highlight_picture *from, double reach_mm, GArray *sights,
                            GPtrArray *rejected, GError **error) {
    const struct rig_camera *camera = &rig->cameras[from->camera];
    if (from->picture->width != camera->width || from->picture->height != camera->height) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s: has %d × %d pixels, and camera %s %d × %d", from->picture->name,
                    from->picture->width, from->picture->height, camera->name, camera->width,
                    camera->height);
        return FALSE;
    }
    for (int mark = 0; mark < target->n; mark++)
        measure_ball(rig, target, from, mark, reach_mm, sights, rejected);
    return TRUE;
}
