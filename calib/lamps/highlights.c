/* Highlights are connected regions above a share of their peak. The lamp is the highlight with the
 * largest energy Σ (I − background)². Its position is the centroid of the light above that share.
 *
 * The share is EDGE. A larger share is used if the region would otherwise be too large or reach the
 * border of the circle. This happens if glare, or the ring in which the ball mirrors a plate, is
 * brighter than a fifth of the lamp. */
#include "highlights.h"

#include "geometry/fit.h"

#include <math.h>
#include <stdlib.h>

#define EDGE 0.2 /* share of the peak that bounds a spot, the first of shares[] */
/* smallest height of a peak, in robust standard deviations of the darker half */
#define ABOVE_NOISE 12.0
/* smallest peak, in heights of the brightest tenth of the other pixels */
#define ABOVE_REST 4.0
/* smallest peak of a spot as small as a speck, in heights of the brightest tenth */
#define FAR_ABOVE   10.0
#define FLAT        0.998 /* share of the maximum that counts as equal to it */
#define FLAT_PIXELS 7     /* number of equal pixels from which a spot counts as saturated */
#define SIGHT_PX    0.03  /* standard deviation of the centroid of a spot */
/* standard deviation of the centroid of a saturated spot, which is located only by its border */
#define CLIPPED_PX 0.1
/* values from which photographs, whose white is 1, count as clipped */
#define WHITE 0.98
/* standard deviation of the centroid of a small spot, times the number of its pixels */
#define SMALL_PX 0.25
/* standard deviation of the centroid of a small saturated spot, times the number of its pixels */
#define SMALL_CLIPPED_PX 2.0
/* A spot with fewer pixels must be FAR_ABOVE times as high as the rest, because it may be dust or a
 * hot pixel. */
#define SPECK      4
#define MIN_PIXELS 2   /* smaller spots are always dust or hot pixels */
#define STREAK     4.0 /* aspect ratio from which a spot is a hair or a scratch */
/* share of the peak above which the spot of a brushed ball is round and thus no streak */
#define CORE 0.8
/* share of the best spot's energy from which another may be the lamp */
#define COMPARABLE 0.3
/* a spot cannot be the lamp if both its energy and its height are below this share of the best
 * spot's */
#define LOWER     0.67
#define MAX_SPOTS 256 /* number of spots that are examined, brightest first */
/* smallest cosine of the normal; below it, a highlight is too near the rim */
#define SLANT 0.3
/* largest area of a spot, relative to the area of the ball in the picture */
#define SPOT_SHARE 0.2

/* A spot is not the lamp if the other pictures are on average more than this share as bright there
 * as this picture. The comparison uses square roots of light. */
#define STAYS 0.5

#define NOWHERE 0 /* label of pixels without a spot */

static const double shares[] = {EDGE, 0.35, 0.5, 0.7}; /* shares that may bound a spot */

struct window {
    const struct picture *picture;
    int left, top, width, height;
    float *values;   /* −G_MAXFLOAT outside the circle */
    guint16 *labels; /* label of each pixel's spot */
    int *members;    /* pixels of the spots, spot by spot */
    int n_members;
    /* background, and smallest height of a peak above it */
    float level, floor;
    float *sorted; /* values within the circle, in ascending order */
    int n_sorted;
};

struct spot {
    guint16 label;
    int first, pixels; /* range in members */
    float height;      /* peak above the background */
    /* sum of squares above the background; both brightness and size increase it */
    double energy;
    struct highlight light; /* x_px, y_px are relative to the window */
    double share;           /* share of the peak above which pixels belong to the light */
    /*   streak  the aspect ratio is at least STREAK
     *   halo    the spot touches a brighter spot
     *   cut     the spot reaches the border of the circle
     *   stays   other photographs also show the spot */
    gboolean streak, halo, cut, stays;
    gboolean large; /* too large to be a lamp's mirror image */
};

/* Copies the pixels of a circle. Returns FALSE if the circle is not completely in the picture. */
static gboolean highlights_cut(struct window *w, double x, double y, double r) {
    w->left = (int)ceil(x - r);
    w->top = (int)ceil(y - r);
    w->width = (int)floor(x + r) - w->left + 1;
    w->height = (int)floor(y + r) - w->top + 1;
    if (w->left < 0 || w->top < 0 || w->width < 5 || w->height < 5 ||
        w->left + w->width > w->picture->width || w->top + w->height > w->picture->height)
        return FALSE;
    w->values = g_new(float, (gsize)w->width *(gsize)w->height);
    w->labels = g_new0(guint16, (gsize)w->width * (gsize)w->height);
    w->members = g_new(int, (gsize)w->width *(gsize)w->height);
    for (int j = 0; j < w->height; j++)
        for (int i = 0; i < w->width; i++) {
            float value = w->picture->values[(w->top + j) * w->picture->width + w->left + i];
            gboolean inside = hypot(w->left + i - x, w->top + j - y) <= r && isfinite(value);
            w->values[j * w->width + i] = inside ? value : -G_MAXFLOAT;
        }
    return TRUE;
}

/* Computes the background level, which is the median, and the smallest height of a peak. This
 * height is at least 5 % of the level. 1.4826 · (median − lower quartile) is the robust standard
 * deviation of the darker half. A bright plate does not increase it. */
static void background(struct window *w) {
    int n = 0, all = w->width * w->height;
    w->sorted = g_new(float, all);
    for (int i = 0; i < all; i++)
        if (w->values[i] > -G_MAXFLOAT)
            w->sorted[n++] = w->values[i];
    qsort(w->sorted, (gsize)n, sizeof *w->sorted, fit_compare_floats);
    w->n_sorted = n;
    w->level = w->sorted[n / 2];
    w->floor =
        MAX((float)ABOVE_NOISE * 1.4826f * (w->level - w->sorted[n / 4]), 0.05f * fabsf(w->level));
}

/* Returns the height of the brightest tenth of the pixels outside the spot. The spot's pixels are
 * the brightest of all. */
static float height_of_rest(const struct window *w, const struct spot *spot) {
    return w->sorted[(int)(0.9 * MAX(w->n_sorted - 1 - spot->pixels, 0))] - w->level;
}

/* Returns the brightest pixel that belongs to no spot, or −1. */
static int brightest(const struct window *w) {
    int best = -1;
    for (int i = 0; i < w->width * w->height; i++)
        if (w->labels[i] == NOWHERE && (best < 0 || w->values[i] > w->values[best]))
            best = i;
    return best;
}

/* Labels the region connected with the peak whose values are above a share of the peak (flood
 * fill). Sets halo if the region touches another spot. Sets cut if the region reaches the border of
 * the circle. */
static void grow(struct window *w, int peak, double share, struct spot *spot) {
    const float least = w->level + (float)share * spot->height;
    spot->first = w->n_members;
    spot->pixels = 0;
    spot->halo = spot->cut = FALSE;
    w->members[w->n_members++] = peak;
    w->labels[peak] = spot->label;
    while (spot->first + spot->pixels < w->n_members) {
        int at = w->members[spot->first + spot->pixels++], x = at % w->width, y = at / w->width;
        for (int k = 0; k < 9; k++) {
            int i = x + k % 3 - 1, j = y + k / 3 - 1, next = j * w->width + i;
            if (i < 0 || j < 0 || i >= w->width || j >= w->height || w->values[next] < least) {
                spot->cut |= i < 0 || j < 0 || i >= w->width || j >= w->height ||
                             !(w->values[next] > -G_MAXFLOAT);
                continue;
            }
            spot->halo |= w->labels[next] != NOWHERE && w->labels[next] != spot->label;
            if (w->labels[next] == NOWHERE) {
                w->labels[next] = spot->label;
                w->members[w->n_members++] = next;
            }
        }
    }
}

/* Grows a spot above the smallest share of its peak at which it is not too large and does not reach
 * the border of the circle. If there is no such share, grows it above EDGE. */
static void grow_least(struct window *w, int peak, double max_px, struct spot *spot) {
    const int tries = (int)G_N_ELEMENTS(shares);
    for (int i = 0; i <= tries; i++) {
        spot->share = shares[i % tries];
        grow(w, peak, spot->share, spot);
        spot->large = spot->pixels > max_px;
        if ((!spot->large && !spot->cut) || i == tries)
            return;
        for (; w->n_members > spot->first; w->n_members--)
            w->labels[w->members[w->n_members - 1]] = NOWHERE;
    }
}

/* Computes centroid and second moments of the spot's light above a share of its peak. */
static void weigh(const struct window *w, const struct spot *spot, double share,
                  struct highlight *ret) {
    const float least = w->level + (float)share * spot->height;
    double sum = 0, x = 0, y = 0, xx = 0, xy = 0, yy = 0;
    for (int k = 0; k < spot->pixels; k++) {
        const int i = w->members[spot->first + k];
        if (!(w->values[i] > least))
            continue;
        const double weight = (double)(w->values[i] - least);
        const int column = i % w->width, row = i / w->width;
        sum += weight;
        x += weight * column;
        y += weight * row;
        xx += weight * column * column;
        xy += weight * column * row;
        yy += weight * row * row;
    }
    ret->x_px = x / sum;
    ret->y_px = y / sum;
    ret->xx_px2 = MAX(0, xx / sum - ret->x_px * ret->x_px);
    ret->xy_px2 = xy / sum - ret->x_px * ret->y_px;
    ret->yy_px2 = MAX(0, yy / sum - ret->y_px * ret->y_px);
}

/* Returns √(λ₁ / λ₂) of the second moments of the spot's pixels above a share of its peak. Each
 * pixel is a square with the variance 1/12. Returns infinity if fewer than SPECK pixels are above
 * that share. */
static double aspect(const struct window *w, const struct spot *spot, double share) {
    const float least = w->level + (float)share * spot->height;
    double x = 0, y = 0, xx = 0, yy = 0, xy = 0;
    int n = 0;
    for (int k = 0; k < spot->pixels; k++) {
        const int i = w->members[spot->first + k], column = i % w->width, row = i / w->width;
        if (w->values[i] < least)
            continue;
        n++;
        x += column, y += row;
        xx += column * column, yy += row * row, xy += column * row;
    }
    if (n < SPECK)
        return INFINITY;
    x /= n, y /= n;
    xx = xx / n - x * x + 1.0 / 12;
    yy = yy / n - y * y + 1.0 / 12;
    xy = xy / n - x * y;
    double mean = (xx + yy) / 2, apart = hypot((xx - yy) / 2, xy);
    return sqrt((mean + apart) / (mean - apart));
}

static double root_of(float light) {
    return sqrt(MAX((double)light, 0));
}

/* Returns whether the other photographs also show the spot: their brightness there is on average
 * more than STAYS times that of this photograph. Returns FALSE if there are fewer than three
 * photographs. The comparison uses square roots of light above the background. The mean of the
 * others is (n m − s) / (n − 1), where m is the mean of all n photographs and s this one. */
static gboolean highlights_stays(const struct window *w, const struct spot *spot,
                                 const struct highlight_mean *mean) {
    const double level = root_of(w->level);
    double own = 0, others = 0;
    if (!mean || mean->n < 3)
        return FALSE;
    for (int k = 0; k < spot->pixels; k++) {
        const int i = w->members[spot->first + k];
        const int x = w->left + i % w->width, y = w->top + (int)(i / w->width);
        const double root = root_of(w->values[i]);
        own += root - level;
        others += (mean->n * (double)mean->root->values[y * mean->root->width + x] - root) /
                      (mean->n - 1) -
                  level;
    }
    return others > STAYS * own;
}

/* Finds the spots, brightest first. A region that touches a brighter spot is the halo of that spot
 * and is dropped. A region that is not ABOVE_REST times as high as the brightest tenth of the other
 * pixels is dropped too. */
static GArray *find_spots(struct window *w, const struct highlight_mean *mean, double max_px) {
    GArray *spots = g_array_new(FALSE, FALSE, sizeof(struct spot));
    guint16 label = NOWHERE + 1;
    int peak;
    while (label <= MAX_SPOTS && (peak = brightest(w)) >= 0) {
        struct spot spot = {.label = label++, .height = w->values[peak] - w->level};
        if (!(spot.height > w->floor))
            break;
        grow_least(w, peak, max_px, &spot);
        if (spot.halo || !(spot.height > (float)ABOVE_REST * height_of_rest(w, &spot)))
            continue;
        for (int k = 0; k < spot.pixels; k++)
            spot.energy += pow((double)(w->values[w->members[spot.first + k]] - w->level), 2);
        spot.streak = spot.pixels >= SPECK && aspect(w, &spot, spot.share) >= STREAK;
        if (spot.streak && aspect(w, &spot, CORE) < STREAK) {
            spot.share = CORE;
            spot.streak = FALSE;
        }
        spot.stays = highlights_stays(w, &spot, mean);
        weigh(w, &spot, spot.share, &spot.light);
        g_array_append_val(spots, spot);
    }
    return spots;
}

static gboolean any_stays(const GArray *spots) {
    for (guint i = 0; i < spots->len; i++)
        if (g_array_index(spots, struct spot, i).stays)
            return TRUE;
    return FALSE;
}

/* Returns whether a spot may be a lamp's mirror image. A spot with fewer than SPECK pixels may be
 * dust or a hot pixel. It must be far brighter than the rest. There must also be at least three
 * photographs, because they show whether the spot is only in this one. */
static gboolean may_be_lamp(const struct window *w, const struct spot *spot,
                            const struct highlight_mean *mean) {
    if (spot->streak || spot->stays || spot->large || spot->pixels < MIN_PIXELS)
        return FALSE;
    return spot->pixels >= SPECK ||
           (mean && mean->n >= 3 &&
            spot->height > (float)FAR_ABOVE * MAX(height_of_rest(w, spot), fabsf(w->level)));
}

/* Returns whether two spots are too similar in energy and height to decide which is the lamp. */
static gboolean alike(const struct spot *best, const struct spot *other) {
    return other->energy > COMPARABLE * best->energy &&
           !(other->energy < LOWER * best->energy && other->height < (float)LOWER * best->height);
}

/* Returns the reason to refuse the best spot, or NULL. `best` is NULL if no spot may be the lamp.
 * `other` is the next best spot, or NULL. */
static char *reason_against(const struct window *w, const GArray *spots, const struct spot *best,
                            const struct spot *other) {
    const struct spot *brightest_large = NULL;
    for (guint i = 0; i < spots->len && !brightest_large; i++) {
        const struct spot *spot = &g_array_index(spots, struct spot, i);
        if (spot->large && !spot->stays)
            brightest_large = spot;
    }
    if (brightest_large && (!best || best->height * (float)LOWER < brightest_large->height))
        return g_strdup(
            "shows a spot too large to be a lamp; use a glossy ball, or put the lamp farther away");
    if (!best)
        return g_strdup(
            spots->len == 0 ? "shows no lamp: no spot on it is much brighter than the rest; check "
                              "the lamp, the exposure and the given position of the ball"
            : any_stays(spots)
                ? "shows no lamp: its bright spots are specks or streaks, or other "
                  "photographs also show them; light each photograph from another direction"
                : "shows no lamp: its bright spots are specks or streaks; clean the ball, and "
                  "check the lamp");
    const double x = w->left + best->light.x_px, y = w->top + best->light.y_px;
    if (best->cut)
        return g_strdup_printf("shows the lamp at the edge of the searched area, at %.1f, %.1f px; "
                               "check the given position of the ball",
                               x, y);
    if (other && alike(best, other))
        return g_strdup_printf("shows two highlights, at %.1f, %.1f and at %.1f, %.1f px, either "
                               "of which may be the lamp; cover other lights and shiny things",
                               x, y, w->left + other->light.x_px, w->top + other->light.y_px);
    return NULL;
}

/* Returns whether a spot is better than the best spot so far. If only one of the two reaches the
 * border of the circle, the one at the border is better only if it is clearly higher. If both or
 * neither reach the border, the spot with more energy is better. */
static gboolean is_better(const struct spot *spot, const struct spot *best) {
    if (best && spot->cut != best->cut)
        return spot->cut ? spot->height * (float)LOWER > best->height
                         : best->height * (float)LOWER <= spot->height;
    return !best || spot->energy > best->energy;
}

static const struct spot *choose(const struct window *w, const GArray *spots,
                                 const struct highlight_mean *mean, char **ret_why) {
    const struct spot *best = NULL, *other = NULL;
    for (guint i = 0; i < spots->len; i++) {
        const struct spot *spot = &g_array_index(spots, struct spot, i);
        if (may_be_lamp(w, spot, mean) && is_better(spot, best))
            best = spot;
    }
    for (guint i = 0; i < spots->len; i++) {
        const struct spot *spot = &g_array_index(spots, struct spot, i);
        if (spot != best && may_be_lamp(w, spot, mean) && !(best && spot->cut && !best->cut) &&
            (!other || spot->energy > other->energy))
            other = spot;
    }
    *ret_why = reason_against(w, spots, best, other);
    return *ret_why ? NULL : best;
}

char *highlight_find(const struct picture *picture, const struct highlight_mean *mean, double x_px,
                     double y_px, double radius_px, double max_px, struct highlight *ret) {
    struct window window = {.picture = picture};
    if (!highlights_cut(&window, x_px, y_px, radius_px))
        return g_strdup("is not wholly in the picture");
    background(&window);
    g_autoptr(GArray) spots = find_spots(&window, mean, max_px);
    char *why;
    const struct spot *spot = choose(&window, spots, mean, &why);
    if (spot) {
        /* Counts the pixels of the spot that equal the maximum of their colour filter phase. Each
         * phase may saturate at a different value. */
        float most[4] = {0};
        int count = 0;
        for (int pass = 0; pass < 2; pass++)
            for (int k = 0; k < spot->pixels; k++) {
                const int i = window.members[spot->first + k];
                int phase = 2 * (i / window.width & 1) + (i % window.width & 1);
                if (pass == 0)
                    most[phase] = fmaxf(most[phase], window.values[i]);
                else
                    count += window.values[i] >= (float)FLAT * most[phase];
            }
        const gboolean saturated = count >= FLAT_PIXELS;
        *ret = spot->light;
        ret->x_px += window.left;
        ret->y_px += window.top;
        /* The displacement of the centroid for higher thresholds is part of its error. Glare and
         * lamps that are not round increase it. */
        static const double higher[] = {0.35, 0.5, 0.7, 0.9};
        double sum = 0;
        int n = 0;
        for (gsize i = 0; i < G_N_ELEMENTS(higher); i++) {
            struct highlight of;
            if (higher[i] <= spot->share)
                continue;
            weigh(&window, spot, higher[i], &of);
            sum += (pow(of.x_px - spot->light.x_px, 2) + pow(of.y_px - spot->light.y_px, 2)) / 2;
            n++;
        }
        const gboolean white = (double)(window.level + spot->height) >= WHITE;
        const double small = (white ? SMALL_CLIPPED_PX : SMALL_PX) / spot->pixels;
        ret->sigma_px =
            hypot(hypot(saturated ? CLIPPED_PX : SIGHT_PX, small), sqrt(sum / MAX(n, 1)));
        ret->energy = spot->energy;
        ret->saturated = saturated;
    }
    g_free(window.values);
    g_free(window.labels);
    g_free(window.members);
    g_free(window.sorted);
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

/* Returns whether other balls leave the way from a ball towards a point free: a cylinder with the
 * radius of the ball around this way must meet no other ball. */
static gboolean is_free(const struct lamp_target *target, int mark, double turntable_rad,
                        struct vec3 towards) {
    struct vec3 at = lamp_mark_mm(target, mark, turntable_rad);
    struct vec3 direction = vec3_unit(vec3_sub(towards, at));
    for (int i = 0; i < target->n; i++) {
        struct vec3 other = vec3_sub(lamp_mark_mm(target, i, turntable_rad), at);
        double along = vec3_dot(other, direction);
        if (i != mark && along > 0 &&
            vec3_length(vec3_sub(other, vec3_scale(direction, along))) <
                target->marks[i].size_mm + target->marks[mark].size_mm)
            return FALSE;
    }
    return TRUE;
}

/* Measures one ball in one picture if the geometry says that it shows the lamp. Appends a sight to
 * sights. If the measurement fails, appends a reason to rejected instead. */
static void measure_ball(const struct rig *rig, const struct lamp_target *target,
                         const struct highlight_picture *from, int mark, double reach_mm,
                         GArray *sights, GPtrArray *rejected) {
    const struct rig_camera *camera = &rig->cameras[from->camera];
    struct vec3 centre = lamp_mark_mm(target, mark, from->turntable_rad);
    struct vec3 eye = vec3_unit(vec3_sub(rig_camera_centre_mm(camera), centre));
    struct vec3 lamp_mm = rig_lamp_position_mm(&rig->arc, &rig->lamps[from->lamp], from->arc_rad);
    struct vec3 lamp = vec3_unit(vec3_sub(lamp_mm, centre));
    double radius = target->marks[mark].size_mm, x, y;
    struct highlight found;
    struct outline ball, reach;
    if (sqrt(MAX(0, (1 + vec3_dot(eye, lamp)) / 2)) < SLANT ||
        !is_free(target, mark, from->turntable_rad, lamp_mm) ||
        !is_free(target, mark, from->turntable_rad, rig_camera_centre_mm(camera)) ||
        !outline_of(camera, centre, radius, &ball) ||
        !outline_of(camera, centre, MIN(reach_mm, radius) + 0.25 * radius, &reach) ||
        !lamp_highlight_px(camera, centre, radius, lamp_mm, &x, &y))
        return;
    double max_px = MAX(SPOT_SHARE * G_PI * ball.radius_px * ball.radius_px, 9);
    g_autofree char *why =
        highlight_find(from->picture, NULL, x, y, reach.radius_px, max_px, &found);
    if (!why && found.saturated) /* only on a rig can pictures be taken again with less exposure */
        why = g_strdup("is saturated where it shows the lamp; expose less");
    if (why) {
        g_ptr_array_add(rejected,
                        g_strdup_printf("%s: ball %d %s", from->picture->name, mark + 1, why));
        return;
    }
    struct lamp_sight sight = {from->index, from->lamp,          from->camera,
                               mark,        from->turntable_rad, from->arc_rad,
                               found.x_px,  found.y_px,          SIGHT_PX};
    g_array_append_val(sights, sight);
}

gboolean highlights_measure(const struct rig *rig, const struct lamp_target *target,
                            const struct highlight_picture *from, double reach_mm, GArray *sights,
                            GPtrArray *rejected, GError **error) {
    const struct rig_camera *camera = &rig->cameras[from->camera];
    if (from->picture->width != camera->width || from->picture->height != camera->height) {
        g_set_error(error, LAMPS_ERROR, LAMPS_ERROR_PICTURES,
                    "%s has %d × %d pixels, but camera %s has %d × %d: use pictures of this camera "
                    "that are neither cropped nor scaled",
                    from->picture->name, from->picture->width, from->picture->height, camera->name,
                    camera->width, camera->height);
        return FALSE;
    }
    for (int mark = 0; mark < target->n; mark++)
        measure_ball(rig, target, from, mark, reach_mm, sights, rejected);
    return TRUE;
}
