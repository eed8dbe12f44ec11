/* The surfaces of other views are triangulated between neighbouring texels, projected into this
 * view and rasterised with a depth buffer. Open texels take the nearest prediction on which
 * enough views agree. */
#include "mdf_views_private.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

/* in texels; if the distances of neighbours differ by more, they lie on different surfaces */
#define STEP 0.75
/* In texels. A distance agrees with a prediction that is at most this far away. Predictions agree
 * with each other within twice this range. */
#define AGREE 0.25
#define LEAST 2 /* minimum number of views that must agree on a prediction */
/* a prediction is accepted if at least this many views confirm it for each view that sees through
 * it */
#define DENIES  4
#define GOES_ON 0.5 /* in texels; maximum step between a surface and its continuation */
/* If at least this many laser positions saw a surface, the surface is taken to be lit beyond its
 * last texel as well. */
#define LIT    4
#define AROUND 2 /* minimum number of neighbours for would_be_seen() */

/* A point of another view in the texel coordinates of this view. */
struct seen {
    float column, row, mm; /* mm: distance behind the reference plane along this view's ray; < 0 if
                              not visible */
};

struct settling {
    const struct mdf_eye *views;
    int n, view;
    const struct mdf_plane *plane;
    gboolean *open; /* for each texel, whether the view's own measurement is missing or refuted */
    /* n_texels distances for each asked view (mdf_views_asked()); INFINITY if there is no
     * prediction */
    float *predicted;
    struct seen *seen;
    float *front; /* n_texels, mm: depth buffer of predict(); INFINITY where nothing is drawn */
};

/* Rasterises a triangle into the depth buffer; v and w are the barycentric weights of b and c. */
static void draw(const struct settling *s, const struct seen *a, const struct seen *b,
                 const struct seen *c) {
    const int width = s->plane->width, height = s->plane->height;
    const float area =
        (b->column - a->column) * (c->row - a->row) - (c->column - a->column) * (b->row - a->row);
    const int first = MAX(0, (int)ceilf(MIN(a->column, MIN(b->column, c->column))));
    const int last = MIN(width - 1, (int)floorf(MAX(a->column, MAX(b->column, c->column))));
    const int top = MAX(0, (int)ceilf(MIN(a->row, MIN(b->row, c->row))));
    const int bottom = MIN(height - 1, (int)floorf(MAX(a->row, MAX(b->row, c->row))));
    if (!(fabsf(area) > 1e-6F))
        return;
    for (int row = top; row <= bottom; row++)
        for (int column = first; column <= last; column++) {
            const float x = (float)column - a->column, y = (float)row - a->row;
            const float v = (x * (c->row - a->row) - y * (c->column - a->column)) / area;
            const float w = (y * (b->column - a->column) - x * (b->row - a->row)) / area;
            float *front = &s->front[row * width + column];
            if (v >= 0 && w >= 0 && v + w <= 1)
                *front = MIN(*front, a->mm + v * (b->mm - a->mm) + w * (c->mm - a->mm));
        }
}

/* Renders the surface of the asked view into the view that is completed. A triangle joins
 * neighbouring texels if all three points are visible and their depths differ by at most a step,
 * which grows with the slant of the asked view. */
static void predict(const struct settling *s, int asked) {
    const struct mdf_eye *to = &s->views[s->view];
    const struct mdf_eye *from = &s->views[mdf_views_other(s->n, s->view, asked)];
    const int width = s->plane->width, n = width * s->plane->height;
    const double *c = from->centre_mm, up = c[2] - s->plane->reference_mm;
    const double slant = up / sqrt(c[0] * c[0] + c[1] * c[1] + up * up);
    const float step = (float)(STEP * s->plane->texel_mm / MAX(slant, 0.1));
    for (int i = 0; i < n; i++) {
        double column, row, mm;
        s->seen[i].mm = -1;
        s->front[i] = INFINITY;
        if (!(from->distance[i] >= 0))
            continue;
        const struct vec3 p = mdf_views_point(from, s->plane, i, from->distance[i]);
        mdf_views_look_up(to, s->plane, p, &column, &row, &mm);
        /* Far outside of the texels, numbers may be too large for integers. */
        if (fabs(column) < 1e5 && fabs(row) < 1e5 && mm >= 0)
            s->seen[i] = (struct seen){(float)column, (float)row, (float)mm};
    }
    for (int i = 0; i + width + 1 < n; i++) {
        const int corners[2][3] = {{i, i + 1, i + width}, {i + width + 1, i + width, i + 1}};
        for (int k = 0; k < 2 && i % width < width - 1; k++) {
            const int *at = corners[k];
            const float *d = from->distance;
            const float low = MIN(d[at[0]], MIN(d[at[1]], d[at[2]]));
            const float high = MAX(d[at[0]], MAX(d[at[1]], d[at[2]]));
            if (s->seen[at[0]].mm >= 0 && s->seen[at[1]].mm >= 0 && s->seen[at[2]].mm >= 0 &&
                high - low <= step)
                draw(s, &s->seen[at[0]], &s->seen[at[1]], &s->seen[at[2]]);
        }
    }
    memcpy(s->predicted + (gsize)asked * (gsize)n, s->front, sizeof(float) * (gsize)n);
}

static int by_size(const void *a, const void *b) {
    const float x = *(const float *)a, y = *(const float *)b;
    return (x > y) - (x < y);
}

/* Gives the number of views that confirm (yes) and that deny (no) a distance of a texel. */
static void poll(const struct settling *s, int texel, float mm, guint16 *yes, guint16 *no) {
    const struct vec3 p = mdf_views_point(&s->views[s->view], s->plane, texel, mm);
    mdf_views_poll(s->views, s->n, s->view, s->plane, p, yes, no);
}

/* Returns the nearest distance on which at least LEAST of the n sorted predictions agree. At least
 * LEAST views must also confirm this distance, and for each view that denies it, DENIES views must
 * confirm it. Returns −1 if there is no such distance. */
static float nearest(const struct settling *s, int texel, const float *predicted, int n) {
    const float agree = (float)(AGREE * s->plane->texel_mm);
    for (int i = 0; i < n; i++) {
        int together = 1;
        while (i + together < n && predicted[i + together] - predicted[i] <= 2 * agree)
            together++;
        if (together < LEAST)
            continue;
        const float mm = predicted[i + together / 2];
        guint16 yes, no;
        poll(s, texel, mm, &yes, &no);
        if (yes >= LEAST && no * DENIES <= yes)
            return mm;
    }
    return -1;
}

/* Returns whether a prediction continues the surface of at least AROUND neighbours that at least
 * LIT laser positions saw. The lasers would then have reached the predicted point as well, and the
 * view would have measured it. Because the view measured nothing there, it does not see that
 * surface, but looks into a gap that is too narrow for the lasers. */
static gboolean would_be_seen(const struct settling *s, int texel, float mm) {
    const struct mdf_eye *own = &s->views[s->view];
    const int width = s->plane->width, row = texel / width, column = texel % width;
    const float agree = (float)(GOES_ON * s->plane->texel_mm);
    int alike = 0;
    for (int k = 0; k < 9 && own->lasers; k++) {
        const int x = column + k % 3 - 1, y = row + k / 3 - 1;
        if (k == 4 || x < 0 || y < 0 || x >= width || y >= s->plane->height)
            continue;
        const int i = y * width + x;
        alike +=
            own->distance[i] >= 0 && fabsf(own->distance[i] - mm) <= agree && own->lasers[i] >= LIT;
    }
    return alike >= AROUND;
}

/* Gives the distance of an open texel in ret_mm, or −1, and returns where the distance is from. The
 * view's second distance is preferred to the prediction of other views, see mdf_views_settle(). */
static enum mdf_distance_source settle_texel(const struct settling *s, int texel, float *ret_mm) {
    const struct mdf_eye *own = &s->views[s->view];
    const gsize texels = (gsize)s->plane->width * (gsize)s->plane->height;
    const float agree = (float)(AGREE * s->plane->texel_mm),
                other = own->other ? own->other[texel] : -1;
    float predicted[MDF_MAX_ASKED];
    gboolean surface = FALSE;
    int n = 0;
    for (int k = 0; k < mdf_views_asked(s->n); k++) {
        predicted[n] = s->predicted[(gsize)k * texels + (gsize)texel];
        surface |= fabsf(predicted[n] - other) <= agree;
        n += isfinite(predicted[n]);
    }
    if (other >= 0 && surface) {
        guint16 yes, no;
        poll(s, texel, other, &yes, &no);
        *ret_mm = other;
        if (no == 0)
            return MDF_OTHER;
    }
    qsort(predicted, (gsize)n, sizeof *predicted, by_size);
    *ret_mm = nearest(s, texel, predicted, n);
    if (!(own->distance[texel] >= 0) && *ret_mm >= 0 && would_be_seen(s, texel, *ret_mm))
        *ret_mm = -1;
    return *ret_mm >= 0 ? MDF_PREDICTED : MDF_UNSEEN;
}

void mdf_views_settle(const struct mdf_eye *views, int n, int view, const struct mdf_plane *plane,
                      float *ret_distance, guint8 *ret_source) {
    const gsize texels = (gsize)plane->width * (gsize)plane->height;
    const float *own = views[view].distance;
    struct settling s = {views, n, view, plane, g_new0(gboolean, texels), NULL, NULL, NULL};
    int open = 0;
    for (int i = 0; i < (int)texels; i++) {
        guint16 yes = 0, no = 0;
        if (own[i] >= 0)
            poll(&s, i, own[i], &yes, &no);
        s.open[i] = !(own[i] >= 0) || mdf_views_refuted(yes, no);
        open += s.open[i];
    }
    const int asked = mdf_views_asked(n);
    s.predicted = g_new0(float, texels *(gsize)MAX(asked, 1));
    s.seen = g_new0(struct seen, texels);
    s.front = g_new0(float, texels);
    for (int k = 0; k < asked && open > 0; k++)
        predict(&s, k);
    for (int i = 0; i < (int)texels; i++) {
        ret_distance[i] = own[i];
        ret_source[i] = (guint8)(s.open[i] ? settle_texel(&s, i, &ret_distance[i]) : MDF_MEASURED);
    }
    g_free(s.open);
    g_free(s.predicted);
    g_free(s.seen);
    g_free(s.front);
}
