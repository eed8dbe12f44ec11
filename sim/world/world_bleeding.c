#include "world_private.h"

#define CELLS_PER_SCALE 3
#define MAX_CELLS       2048 /* largest number of cells in one direction */
#define REACH_SCALES    5 /* distance beyond which no light comes out, in multiples of scale_mm */
/* There is no light beyond this number of standard deviations of the laser's profile. */
#define REACH_SIGMA  4
#define KERNEL_STEPS 64 /* steps of the kernel's table per scale */

enum cached { /* keys of the cache; must differ from those of world_light.c and world_laser.c */
              CACHED_BLEEDING_CELLS = 48,
              CACHED_BLEEDING,
};

struct bleeding {
    int nx, ny;
    double pitch_mm, x_mm, y_mm; /* (x_mm, y_mm) is the middle of the first cell */
    /* surface of each cell, ny × nx; it is the turntable where there is no sample */
    struct surface *cells;
    int reach;      /* reach of the kernel, in cells */
    float per_step; /* steps of the kernel's table per mm */
    /* Table of the kernel. Its sum over the cells of a level surface is 1. */
    float kernel[REACH_SCALES * KERNEL_STEPS + 2];
};

struct bleeding *bleeding_new(const struct scene *scene, double scale_mm) {
    struct bleeding *bleeding = g_new0(struct bleeding, 1);
    const double width = (double)scene->high[0] - (double)scene->low[0];
    const double height = (double)scene->high[1] - (double)scene->low[1];
    const double pitch = MAX(scale_mm / CELLS_PER_SCALE, MAX(width, height) / MAX_CELLS);
    bleeding->nx = MAX(1, (int)ceil(width / pitch));
    bleeding->ny = MAX(1, (int)ceil(height / pitch));
    bleeding->pitch_mm = pitch;
    bleeding->x_mm =
        ((double)scene->low[0] + (double)scene->high[0] - (bleeding->nx - 1) * pitch) / 2;
    bleeding->y_mm =
        ((double)scene->low[1] + (double)scene->high[1] - (bleeding->ny - 1) * pitch) / 2;
    bleeding->cells = g_new(struct surface, (gsize)bleeding->nx * (gsize)bleeding->ny);
    g_autofree struct v3 *starts = g_new0(struct v3, bleeding->nx);
    g_autofree struct v3 *down = g_new0(struct v3, bleeding->nx);
    g_autofree gboolean *hit = g_new(gboolean, bleeding->nx);
    for (int j = 0; j < bleeding->ny; j++) {
        struct surface *row = bleeding->cells + (gsize)j * (gsize)bleeding->nx;
        for (int i = 0; i < bleeding->nx; i++) {
            starts[i] = v3(bleeding->x_mm + i * pitch, bleeding->y_mm + j * pitch,
                           (double)scene->high[2] + 1);
            down[i] = v3(0, 0, -1);
        }
        scene_trace(scene, starts[0], starts, down, bleeding->nx, row, hit);
        for (int i = 0; i < bleeding->nx; i++)
            if (!hit[i])
                row[i].triangle = NO_TRIANGLE;
    }
    bleeding->reach = (int)floor(REACH_SCALES * scale_mm / pitch);
    bleeding->per_step = (float)(KERNEL_STEPS / scale_mm);
    double sum = 0;
    for (int j = -bleeding->reach; j <= bleeding->reach; j++)
        for (int i = -bleeding->reach; i <= bleeding->reach; i++) {
            const double r = hypot(i, j) * pitch / scale_mm;
            sum += r < REACH_SCALES ? exp(-r) : 0;
        }
    for (int i = 0; i < REACH_SCALES * KERNEL_STEPS; i++)
        bleeding->kernel[i] = (float)(exp(-(double)i / KERNEL_STEPS) / sum);
    return bleeding;
}

void bleeding_free(struct bleeding *bleeding) {
    if (bleeding)
        g_free(bleeding->cells);
    g_free(bleeding);
}

struct bleeding_job {
    World *world;
    int laser;
    struct light_pose pose;
    double sweep;
};

/* sweep angle at which a cell is lit, and the irradiance of the cell at that angle */
struct lit_cell {
    float angle, irradiance;
};

static gpointer make_cells(const struct cache_key *key, gconstpointer data, gsize *ret_bytes) {
    const struct bleeding_job *job = data;
    const struct bleeding *bleeding = job->world->bleeding;
    const struct optics_laser laser = world_laser_at(job->world, job->laser, job->pose);
    const int n = bleeding->nx * bleeding->ny;
    *ret_bytes = (gsize)n * sizeof(struct lit_cell);
    struct lit_cell *lit = g_malloc0(*ret_bytes);
    guint8 blocked[SCENE_BATCH];
    for (int first = 0; first < n; first += SCENE_BATCH) {
        const int here = MIN(SCENE_BATCH, n - first);
        scene_shadow(&job->world->scene, laser.position_mm, bleeding->cells + first, here, blocked);
        for (int i = 0; i < here; i++) {
            struct surface matt = bleeding->cells[first + i];
            if (blocked[i] || matt.triangle == NO_TRIANGLE)
                continue;
            matt.albedo[CFA_GREEN] = (float)G_PI; /* scene_reflect() then returns n·l */
            matt.gloss = 0;
            const struct v3 p = v3(matt.p[0], matt.p[1], matt.p[2]);
            lit[first + i].angle = (float)optics_laser_angle(&laser, p);
            lit[first + i].irradiance =
                (float)optics_laser_peak(&laser, p) *
                scene_reflect(&matt, laser.position_mm, laser.position_mm, CFA_GREEN);
        }
    }
    return lit;
}

static float height_of(const struct surface *cell) {
    return cell->p[2];
}

/* Spreads the light of a cell to the cells around it. */
static void bleeding_spread(const struct bleeding *bleeding, int i, int j, float light,
                            float *spread) {
    const float z = height_of(&bleeding->cells[j * bleeding->nx + i]);
    const float pitch = (float)bleeding->pitch_mm;
    for (int v = MAX(0, j - bleeding->reach); v <= MIN(bleeding->ny - 1, j + bleeding->reach); v++)
        for (int u = MAX(0, i - bleeding->reach); u <= MIN(bleeding->nx - 1, i + bleeding->reach);
             u++) {
            const struct surface *to = &bleeding->cells[v * bleeding->nx + u];
            const float x = pitch * (float)(u - i), y = pitch * (float)(v - j);
            const float up = height_of(to) - z;
            const float step = sqrtf(x * x + y * y + up * up) * bleeding->per_step;
            if (to->triangle == NO_TRIANGLE || step >= REACH_SCALES * KERNEL_STEPS)
                continue;
            const int at = (int)step;
            const float a = bleeding->kernel[at], b = bleeding->kernel[at + 1];
            spread[v * bleeding->nx + u] += light * (a + (b - a) * (step - (float)at));
        }
}

static gpointer make_bleeding(const struct cache_key *key, gconstpointer data, gsize *ret_bytes) {
    const struct bleeding_job *job = data;
    const struct bleeding *bleeding = job->world->bleeding;
    const float sigma = (float)job->world->lasers[job->laser].sigma, sweep = (float)job->sweep;
    struct cache_key cells_key = {{CACHED_BLEEDING_CELLS, (guint64)job->laser,
                                   world_bits(job->pose.relative_rad),
                                   world_bits(job->pose.turntable_rad)}};
    struct cache_entry *entry = cache_get(job->world->cache, &cells_key, make_cells, job);
    const struct lit_cell *lit = entry->value;
    *ret_bytes = (gsize)bleeding->nx * (gsize)bleeding->ny * sizeof(float);
    float *spread = g_malloc0(*ret_bytes);
    for (int j = 0; j < bleeding->ny; j++)
        for (int i = 0; i < bleeding->nx; i++) {
            const struct lit_cell *from = &lit[j * bleeding->nx + i];
            const float x = (from->angle - sweep) / sigma;
            if (from->irradiance > 0 && fabsf(x) < REACH_SIGMA)
                bleeding_spread(bleeding, i, j, from->irradiance * expf(-x * x / 2), spread);
        }
    cache_release(job->world->cache, entry);
    return spread;
}

/* Returns the irradiance that has spread to a place. It is interpolated linearly between the
 * middles of cells. */
static float bleeding_at(const struct bleeding *bleeding, const float *spread, const float p[3]) {
    const double x = ((double)p[0] - bleeding->x_mm) / bleeding->pitch_mm;
    const double y = ((double)p[1] - bleeding->y_mm) / bleeding->pitch_mm;
    const int i = CLAMP((int)floor(x), 0, MAX(bleeding->nx - 2, 0));
    const int j = CLAMP((int)floor(y), 0, MAX(bleeding->ny - 2, 0));
    const float right = (float)CLAMP(x - i, 0, 1), down = (float)CLAMP(y - j, 0, 1);
    const float *row = spread + j * bleeding->nx + i;
    const float *below = row + (j + 1 < bleeding->ny ? bleeding->nx : 0);
    const int next = i + 1 < bleeding->nx;
    const float a = row[0] + (row[next] - row[0]) * right;
    const float b = below[0] + (below[next] - below[0]) * right;
    return a + (b - a) * down;
}

void world_add_bleeding(World *world, int camera, int laser, struct light_pose pose, double sweep,
                        const struct view *view, float *rate) {
    const struct optics_camera *sensor = &world->cameras[camera];
    const double *colour = world->lasers[laser].colour;
    struct bleeding_job job = {world, laser, pose, sweep};
    struct cache_key key = {{CACHED_BLEEDING | (guint64)laser << 16, world_bits(pose.relative_rad),
                             world_bits(pose.turntable_rad), world_bits(sweep)}};
    struct cache_entry *entry = cache_get(world->cache, &key, make_bleeding, &job);
    const float share = (float)(world->bleeding_share * M_1_PI);
    for (guint i = 0; i < view->n; i++) {
        const struct point *point = &view->points[i];
        if (point->triangle == NO_TRIANGLE)
            continue;
        const float out = bleeding_at(world->bleeding, entry->value, point->p);
        if (!(out > 0))
            continue;
        struct surface s;
        world_unpack(point, &s);
        const enum cfa_colour filter = world_pixel_colour(sensor, point->pixel);
        rate[point->pixel] +=
            view->weights[point->pixel] * share * s.albedo[filter] * (float)colour[filter] * out;
    }
    cache_release(world->cache, entry);
}
