#include "material_sampler.h"

#include "base/direction.h"

#include <math.h>
#include <string.h>

#define CELLS    MATERIAL_SAMPLER_CELLS
#define CLUSTERS 8
#define PAIRS    48  /* number of pairs of view and light by which texels are compared */
#define ROUNDS   8   /* number of rounds of k-means */
#define COSINE   0.1 /* C of material_sampler.h; EVEN is U */
#define EVEN     0.05
/* maximum size of the grid of texels that are examined, in each dimension */
#define MOST 64
/* maximum number of pairs of texel, view and light that are examined */
#define BUDGET ((gsize)64 << 20)
/* number of points of a cell that are examined, in each dimension */
#define INSIDE 2
#define PICKED 4 /* number of texels that represent a cluster if a model has a formula */

/* A distribution over cells, as cumulative sums from 0 to 1: rows over the rows, and cells[r] over
 * the cells of row r. */
struct table {
    float rows[CELLS + 1], cells[CELLS][CELLS + 1];
};

struct MaterialSampler {
    int width, height; /* size of the grid of texels that were examined */
    guint8 *cluster;   /* cluster of each texel of the grid */
    int n_clusters;    /* the table of all texels comes after the tables of the clusters */
    /* number of measured views; the mean of the views around the pole has the index n_views */
    int n_views;
    int n_grid; /* as in struct material_sampler_source */
    const Directions *views;
    struct table *tables; /* (clusters + 1) × (views + 1) */
};

/* The data that are only needed while a sampler is made. */
struct making {
    const struct material_sampler_source *source;
    MaterialSampler *sampler;
    int step; /* step between the texels of the grid */
    gsize n_views, n_lights;
    float *texel;  /* one reconstructed texel */
    double *sums;  /* (clusters + 1) × (views + 1) × lights: sums of luminance */
    float *shapes; /* for each texel of the grid, PAIRS luminances (sampler_take_shape()) */
    /* Texels that represent each cluster. The last element represents all texels together. */
    int n_picked[CLUSTERS + 1], picked[CLUSTERS + 1][PICKED];
};

/* Maps [0, 1]² to the unit disc; areas are multiplied by π (Shirley & Chiu 1997). */
static void sampler_to_disc(double u, double v, double ret[2]) {
    const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
    const gboolean wide = fabs(a) > fabs(b);
    const double r = wide ? a : b;
    double turn = 0.0;
    if (r != 0.0)
        turn = wide ? G_PI_4 * b / a : G_PI_2 - G_PI_4 * a / b;
    ret[0] = r * cos(turn);
    ret[1] = r * sin(turn);
}

/* Gives the cell of the point of [0, 1]² that sampler_to_disc() maps to (x, y). */
static void sampler_cell(double x, double y, int *ret_row, int *ret_cell) {
    const double r = hypot(x, y);
    double turn = atan2(y, x), a, b;
    if (turn < -G_PI_4)
        turn += 2.0 * G_PI;
    if (turn < G_PI_4) {
        a = r;
        b = turn * a / G_PI_4;
    } else if (turn < 3.0 * G_PI_4) {
        b = r;
        a = -(turn - G_PI_2) * b / G_PI_4;
    } else if (turn < 5.0 * G_PI_4) {
        a = -r;
        b = (turn - G_PI) * a / G_PI_4;
    } else {
        b = -r;
        a = -(turn - 3.0 * G_PI_2) * b / G_PI_4;
    }
    *ret_row = CLAMP((int)((b + 1.0) / 2.0 * CELLS), 0, CELLS - 1);
    *ret_cell = CLAMP((int)((a + 1.0) / 2.0 * CELLS), 0, CELLS - 1);
}

/* Returns the density g of a cell (material_sampler.h). The mean of g over all cells is 1. */
static double table_density(const struct table *t, int row, int cell) {
    return (double)(t->rows[row + 1] - t->rows[row]) *
           (double)(t->cells[row][cell + 1] - t->cells[row][cell]) * CELLS * CELLS;
}

/* Computes cumulative sums of n numbers, scaled to 1. If all numbers are 0, the sums are uniform.
 * Returns the sum of the numbers. */
static double sampler_cumulate(const double *values, float ret[CELLS + 1]) {
    double sum = 0.0, so_far = 0.0;
    for (int k = 0; k < CELLS; k++)
        sum += values[k];
    for (int k = 0; k < CELLS; k++) {
        ret[k] = (float)(sum > 0.0 ? so_far / sum : (double)k / CELLS);
        so_far += values[k];
    }
    ret[CELLS] = 1.0F;
    return sum;
}

/* Returns the index k with c[k] ≤ x < c[k + 1]. *x becomes the position within this interval, 0 …
 * 1. */
static int sampler_find(const float c[CELLS + 1], double *x) {
    int low = 0, high = CELLS;
    while (high - low > 1) {
        const int middle = (low + high) / 2;
        if ((double)c[middle] <= *x)
            low = middle;
        else
            high = middle;
    }
    const double wide = (double)c[low + 1] - (double)c[low];
    *x = wide > 0.0 ? CLAMP((*x - (double)c[low]) / wide, 0.0, 1.0) : 0.5;
    return low;
}

/* Gives the weights of the measured views or lights in a direction. */
static void sampler_weigh(const Directions *directions, int n_grid, const float d[3],
                          struct direction_weights *ret) {
    if (n_grid > 0)
        direction_grid_weights(n_grid, d, ret->index, ret->weight);
    else
        directions_weights(directions, vec3((double)d[0], (double)d[1], (double)d[2]), ret);
}

static struct table *sampler_table(const MaterialSampler *s, int cluster, int view) {
    return &s->tables[(gsize)cluster * (gsize)(s->n_views + 1) + (gsize)view];
}

static int grid_texel(const struct making *m, int at) {
    const int width = MAX(m->sampler->width, 1);
    const int x = at % width * m->step, y = at / width * m->step;
    return y * (int)m->source->layout->width + x;
}

static double luminance_at(const struct making *m, gsize view, gsize light) {
    const float *rgb = m->texel + 3 * (view * m->n_lights + light);
    const double value = (double)rgb_luminance(rgb);
    return value > 0.0 ? value : 0.0; /* also where it is not a number */
}

/* Gives the luminances of fixed pairs of view and light, divided by their sum, because the
 * brightness of a texel does not matter. */
static void sampler_take_shape(const struct making *m, float *ret) {
    const gsize n = m->n_views * m->n_lights;
    double sum = 1e-12;
    for (gsize k = 0; k < PAIRS; k++) {
        /* Multiples of the golden ratio are evenly distributed. */
        const gsize at = (gsize)(fmod((double)k * 0.6180339887498949, 1.0) * (double)n);
        ret[k] = (float)luminance_at(m, at / m->n_lights, at % m->n_lights);
        sum += (double)ret[k];
    }
    for (gsize k = 0; k < PAIRS; k++)
        ret[k] /= (float)sum;
}

static double shape_distance(const float *a, const float *b) {
    double sum = 0.0;
    for (int k = 0; k < PAIRS; k++)
        sum += (double)((a[k] - b[k]) * (a[k] - b[k]));
    return sum;
}

/* Chooses as each centre the texel that is farthest from the previous centres, so that no random
 * numbers are needed. */
static void sampler_choose_centres(const struct making *m, int n, float (*centres)[PAIRS]) {
    g_autofree double *far = g_new(double, (gsize)n);
    memcpy(centres[0], m->shapes, sizeof centres[0]);
    for (int i = 0; i < n; i++)
        far[i] = G_MAXDOUBLE;
    for (int c = 1; c < m->sampler->n_clusters; c++) {
        int farthest = 0;
        for (int i = 0; i < n; i++) {
            far[i] = fmin(far[i], shape_distance(m->shapes + (gsize)i * PAIRS, centres[c - 1]));
            if (far[i] > far[farthest])
                farthest = i;
        }
        memcpy(centres[c], m->shapes + (gsize)farthest * PAIRS, sizeof centres[c]);
    }
}

/* Sets the cluster of each texel of the grid by k-means. */
static void sampler_group(const struct making *m) {
    MaterialSampler *s = m->sampler;
    const int n = s->width * s->height;
    float centres[CLUSTERS][PAIRS];
    sampler_choose_centres(m, n, centres);
    for (int round = 0; round < ROUNDS; round++) {
        double sums[CLUSTERS][PAIRS] = {{0.0}};
        int counts[CLUSTERS] = {0};
        for (int i = 0; i < n; i++) {
            const float *shape = m->shapes + (gsize)i * PAIRS;
            int nearest = 0;
            double least = G_MAXDOUBLE;
            for (int c = 0; c < s->n_clusters; c++) {
                const double distance = shape_distance(shape, centres[c]);
                if (distance < least) {
                    least = distance;
                    nearest = c;
                }
            }
            s->cluster[i] = (guint8)nearest;
            counts[nearest]++;
            for (int k = 0; k < PAIRS; k++)
                sums[nearest][k] += (double)shape[k];
        }
        for (int c = 0; c < s->n_clusters; c++)
            for (int k = 0; k < PAIRS && counts[c] > 0; k++)
                centres[c][k] = (float)(sums[c][k] / counts[c]);
    }
}

/* Adds the luminances of the reconstructed texel to the sums of its cluster, and to the sums of all
 * texels. */
static void sampler_add(const struct making *m, int at) {
    const int into[2] = {m->sampler->cluster[at], m->sampler->n_clusters};
    const gsize size = (m->n_views + 1) * m->n_lights;
    for (gsize view = 0; view < m->n_views; view++)
        for (gsize light = 0; light < m->n_lights; light++) {
            const double value = luminance_at(m, view, light);
            for (int k = 0; k < 2; k++)
                m->sums[(gsize)into[k] * size + view * m->n_lights + light] += value;
        }
}

/* A point of a cell, by the measured lights between which values are interpolated there. factor is
 * directions_fade() of the point, divided by its z. For a grid of directions, factor is 1 / z. */
struct cell_point {
    struct direction_weights lights;
    double factor;
};

static double sampler_value(const struct making *m, const double *sums,
                            const struct cell_point *point) {
    double value = 0.0;
    for (int k = 0; k < 4; k++) {
        const int light = point->lights.index[k];
        if (light < (int)m->n_lights) {
            value += (double)point->lights.weight[k] * sums[light];
            continue;
        }
        int n_pole;
        const int *pole = directions_pole(m->source->lights, &n_pole);
        for (int i = 0; i < n_pole; i++)
            value += (double)point->lights.weight[k] * sums[pole[i]] / n_pole;
    }
    return value * point->factor;
}

/* Picks some texels of each cluster, evenly spread among them. */
static void sampler_pick(struct making *m) {
    const MaterialSampler *s = m->sampler;
    const int n = s->width * s->height;
    int counts[CLUSTERS + 1] = {0}, seen[CLUSTERS + 1] = {0};
    for (int at = 0; at < n; at++) {
        counts[s->cluster[at]]++;
        counts[s->n_clusters]++;
    }
    for (int at = 0; at < n; at++) {
        const int of[2] = {s->cluster[at], s->n_clusters};
        for (int k = 0; k < 2; k++) {
            const int c = of[k], step = MAX(counts[c] / PICKED, 1);
            if (seen[c]++ % step == step / 2 && m->n_picked[c] < PICKED)
                m->picked[c][m->n_picked[c]++] = grid_texel(m, at);
        }
    }
}

/* Returns ∫ value dω over a cell, except for a constant factor. It is computed from the values of
 * the cluster's picked texels at the cell's centre. view is a measured view. */
static double sampler_formula(const struct making *m, int cluster, int view, int row, int cell) {
    double disc[2], sum = 0.0;
    sampler_to_disc((cell + 0.5) / CELLS, (row + 0.5) / CELLS, disc);
    const double z = sqrt(fmax(1.0 - disc[0] * disc[0] - disc[1] * disc[1], 1e-9));
    const float light[3] = {(float)disc[0], (float)disc[1], (float)z};
    for (int k = 0; k < m->n_picked[cluster]; k++) {
        float rgb[3] = {0.0F, 0.0F, 0.0F};
        m->source->evaluate(m->source->context, view, m->picked[cluster][k], light, rgb);
        const double value = (double)rgb_luminance(rgb);
        sum += value > 0.0 ? value / z : 0.0;
    }
    return sum;
}

static void table_evaluate(const struct making *m, int cluster, int view, struct table *ret) {
    double rows[CELLS], cells[CELLS];
    int n_pole = 0;
    const int *pole = view == (int)m->n_views && m->source->n_grid == 0
                          ? directions_pole(m->source->views, &n_pole)
                          : NULL;
    for (int row = 0; row < CELLS; row++) {
        for (int cell = 0; cell < CELLS; cell++) {
            cells[cell] = 0.0;
            for (int k = 0; k < n_pole; k++)
                cells[cell] += sampler_formula(m, cluster, pole[k], row, cell);
            if (view < (int)m->n_views)
                cells[cell] = sampler_formula(m, cluster, view, row, cell);
        }
        rows[row] = sampler_cumulate(cells, ret->cells[row]);
    }
    sampler_cumulate(rows, ret->rows);
}

static void table_make(const struct making *m, const double *sums, const struct cell_point *points,
                       struct table *ret) {
    double rows[CELLS], cells[CELLS];
    for (int row = 0; row < CELLS; row++) {
        for (int cell = 0; cell < CELLS; cell++) {
            cells[cell] = 0.0;
            for (int k = 0; k < INSIDE * INSIDE; k++)
                cells[cell] +=
                    sampler_value(m, sums, points + (row * CELLS + cell) * INSIDE * INSIDE + k);
        }
        rows[row] = sampler_cumulate(cells, ret->cells[row]);
    }
    sampler_cumulate(rows, ret->rows);
}

static struct cell_point *sampler_points(const struct material_sampler_source *source) {
    const int side = CELLS * INSIDE;
    struct cell_point *points = g_new(struct cell_point, (gsize)side * (gsize)side);
    for (int y = 0; y < side; y++)
        for (int x = 0; x < side; x++) {
            struct cell_point *to =
                points + ((gsize)(y / INSIDE) * CELLS + (gsize)(x / INSIDE)) * INSIDE * INSIDE +
                (y % INSIDE) * INSIDE + x % INSIDE;
            double disc[2];
            sampler_to_disc((x + 0.5) / side, (y + 0.5) / side, disc);
            const double z = sqrt(fmax(1.0 - disc[0] * disc[0] - disc[1] * disc[1], 1e-9));
            const float light[3] = {(float)disc[0], (float)disc[1], (float)z};
            sampler_weigh(source->lights, source->n_grid, light, &to->lights);
            /* The samples of a grid extend to the horizon, so values need not fade there. */
            to->factor = source->n_grid > 0
                             ? 1.0 / z
                             : directions_fade(source->lights, vec3(disc[0], disc[1], z)) / z;
        }
    return points;
}

/* Sums the views around the pole, as the view with the index n_views. */
static void sampler_add_pole(const struct making *m) {
    int n_pole = 0;
    const int *pole = m->source->n_grid > 0 ? NULL : directions_pole(m->source->views, &n_pole);
    for (int cluster = 0; cluster <= m->sampler->n_clusters; cluster++) {
        double *sums = m->sums + (gsize)cluster * (m->n_views + 1) * m->n_lights;
        for (int k = 0; k < n_pole; k++)
            for (gsize light = 0; light < m->n_lights; light++)
                sums[m->n_views * m->n_lights + light] +=
                    sums[(gsize)pole[k] * m->n_lights + light];
    }
}

static void sampler_make_tables(const struct making *m) {
    MaterialSampler *s = m->sampler;
    g_autofree struct cell_point *points = sampler_points(m->source);
    for (int cluster = 0; cluster <= s->n_clusters; cluster++)
        for (int view = 0; view <= s->n_views; view++)
            if (m->source->evaluate != NULL)
                table_evaluate(m, cluster, view, sampler_table(s, cluster, view));
            else
                table_make(
                    m, m->sums + ((gsize)cluster * (m->n_views + 1) + (gsize)view) * m->n_lights,
                    points, sampler_table(s, cluster, view));
}

MaterialSampler *material_sampler_new(const struct material_sampler_source *source) {
    const struct btf_layout *layout = source->layout;
    const int width = (int)layout->width, height = (int)layout->height;
    struct making m = {.source = source,
                       .sampler = g_new0(MaterialSampler, 1),
                       .step = 1,
                       .n_views = layout->views.n,
                       .n_lights = layout->lights.n};
    MaterialSampler *s = m.sampler;
    const gsize values = m.n_views * m.n_lights;
    while (MAX(width, height) / m.step > MOST ||
           (m.step < MAX(width, height) &&
            (gsize)(width / m.step) * (gsize)(height / m.step) * values > BUDGET))
        m.step++;
    s->width = (width + m.step - 1) / m.step;
    s->height = (height + m.step - 1) / m.step;
    s->views = source->views;
    s->n_grid = source->n_grid;
    s->n_views = (int)m.n_views;
    const int n = s->width * s->height;
    s->n_clusters = MIN(CLUSTERS, n);
    s->cluster = g_new0(guint8, (gsize)n);
    s->tables = g_new(struct table, (gsize)(s->n_clusters + 1) * (m.n_views + 1));
    m.texel = g_new(float, 3 * values);
    m.sums = g_new0(double, (gsize)(s->n_clusters + 1) * (m.n_views + 1) * m.n_lights);
    m.shapes = g_new(float, (gsize)n *PAIRS);
    for (int at = 0; at < n; at++) {
        source->reconstruct(source->model, grid_texel(&m, at), m.texel);
        sampler_take_shape(&m, m.shapes + (gsize)at * PAIRS);
    }
    sampler_group(&m);
    for (int at = 0; at < n; at++) {
        source->reconstruct(source->model, grid_texel(&m, at), m.texel);
        sampler_add(&m, at);
    }
    sampler_add_pole(&m);
    sampler_pick(&m);
    sampler_make_tables(&m);
    g_free(m.texel);
    g_free(m.sums);
    g_free(m.shapes);
    return s;
}

void material_sampler_free(MaterialSampler *s) {
    if (s == NULL)
        return;
    g_free(s->cluster);
    g_free(s->tables);
    g_free(s);
}

static int sampler_cluster(const MaterialSampler *s, const float uv[2], float footprint) {
    const double u = (double)uv[0] - floor((double)uv[0]);
    const double v = (double)uv[1] - floor((double)uv[1]);
    if ((double)footprint * MAX(s->width, s->height) > 1.5 || !(u < 2.0) || !(v < 2.0))
        return s->n_clusters;
    return s->cluster[MIN((int)(v * s->height), s->height - 1) * s->width +
                      MIN((int)(u * s->width), s->width - 1)];
}

static double sampler_density(const MaterialSampler *s, int cluster,
                              const struct direction_weights *views, const float light[3]) {
    int row, cell;
    double g = 0.0;
    if (!(light[2] > 0.0F))
        return 0.0;
    sampler_cell((double)light[0], (double)light[1], &row, &cell);
    for (int k = 0; k < 4; k++)
        if (views->weight[k] > 0.0F)
            g += (double)views->weight[k] *
                 table_density(sampler_table(s, cluster, views->index[k]), row, cell);
    return (double)light[2] / G_PI * (COSINE + (1.0 - COSINE - EVEN) * g) + EVEN / (2.0 * G_PI);
}

/* Draws a uniform direction of the hemisphere. */
static void sampler_even(double a, double b, float ret[3]) {
    const double flat = sqrt(fmax(1.0 - a * a, 0.0));
    ret[0] = (float)(flat * cos(2.0 * G_PI * b));
    ret[1] = (float)(flat * sin(2.0 * G_PI * b));
    ret[2] = (float)a;
}

float material_sampler_draw(const MaterialSampler *s, const float uv[2], const float view[3],
                            float footprint, const float random[2], float ret_light[3]) {
    struct direction_weights views;
    double a = (double)random[0], b = (double)random[1], disc[2];
    memset(ret_light, 0, 3 * sizeof *ret_light);
    if (!(view[2] > 0.0F))
        return 0.0F;
    const int cluster = sampler_cluster(s, uv, footprint);
    sampler_weigh(s->views, s->n_grid, view, &views);
    if (a < EVEN) {
        sampler_even(1.0 - a / EVEN, b, ret_light);
        return (float)sampler_density(s, cluster, &views, ret_light);
    }
    if (a < EVEN + COSINE) {
        a = (a - EVEN) / COSINE;
    } else {
        int k = 0;
        a = (a - EVEN - COSINE) / (1.0 - EVEN - COSINE);
        while (k < 3 && a >= (double)views.weight[k])
            a -= (double)views.weight[k++];
        a = views.weight[k] > 0.0F ? MIN(a / (double)views.weight[k], 1.0) : 0.5;
        const struct table *table = sampler_table(s, cluster, views.index[k]);
        const int row = sampler_find(table->rows, &a), cell = sampler_find(table->cells[row], &b);
        const double down = a;
        a = (cell + b) / CELLS;
        b = (row + down) / CELLS;
    }
    sampler_to_disc(a, b, disc);
    const double z = sqrt(fmax(1.0 - disc[0] * disc[0] - disc[1] * disc[1], 0.0));
    ret_light[0] = (float)disc[0];
    ret_light[1] = (float)disc[1];
    /* z is above 0 even on the rim of the disc, because the direction must not be below the
     * horizon. */
    ret_light[2] = (float)fmax(z, 1e-7);
    return (float)sampler_density(s, cluster, &views, ret_light);
}

float material_sampler_density(const MaterialSampler *s, const float uv[2], const float view[3],
                               const float light[3], float footprint) {
    struct direction_weights views;
    if (!(view[2] > 0.0F))
        return 0.0F;
    sampler_weigh(s->views, s->n_grid, view, &views);
    return (float)sampler_density(s, sampler_cluster(s, uv, footprint), &views, light);
}
