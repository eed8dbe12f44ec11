#include "world_private.h"

#define RAD(deg) ((deg) * (G_PI / 180))
#define REACH    4 /* there is no light beyond this number of standard deviations of the profile */

enum cached { /* keys of the cache; must differ from those of world_light.c */
              CACHED_LASER_VERTICES = 32,
              CACHED_LASER_LIST,
};

/* A contribution of a laser's light to a pixel. At the angle `sweep`, it is amplitude · exp(−x²/2),
 * with x = (sweep − angle)/σ. σ is the standard deviation of the profile. */
struct share {
    float angle; /* in units of σ, relative to `first` of the list */
    float amplitude;
    guint32 pixel;
};

/* Contributions, sorted by their angles into cells that are one σ wide. */
struct laser_list {
    double first; /* first angle, rad */
    guint n_cells;
    /* index of the first contribution of each cell; n_cells + 1 elements, stored after `shares` */
    const guint32 *starts;
    struct share shares[];
};

struct laser_job {
    World *world;
    int camera, laser;
    double arm_deg, turntable_deg;
    struct light_pose pose;
};

/* sweep angle at which a vertex is lit, and the irradiance of the vertex at that angle */
struct lit_vertex {
    float angle, irradiance;
};

static gpointer make_vertices(const struct cache_key *key, gconstpointer data, gsize *ret_bytes) {
    const struct laser_job *job = data;
    const struct scene *scene = &job->world->scene;
    struct optics_laser laser = world_laser_at(job->world, job->laser, job->pose);
    *ret_bytes = scene->n_vertices * sizeof(struct lit_vertex);
    struct lit_vertex *lit = g_malloc(*ret_bytes);
    struct surface surfaces[SCENE_BATCH];
    guint8 blocked[SCENE_BATCH];
    for (guint first = 0; first < scene->n_vertices; first += SCENE_BATCH) {
        int n = scene_light_vertices(scene, first, laser.position_mm, surfaces, blocked);
        for (int i = 0; i < n; i++) {
            struct v3 p = v3(surfaces[i].p[0], surfaces[i].p[1], surfaces[i].p[2]);
            double e = blocked[i] ? 0 : optics_laser_peak(&laser, p);
            lit[first + (guint)i] =
                (struct lit_vertex){(float)optics_laser_angle(&laser, p),
                                    (float)e * scene_reflect(&surfaces[i], laser.position_mm,
                                                             laser.position_mm, CFA_GREEN)};
        }
    }
    return lit;
}

struct laser_light { /* the input of a list */
    const World *world;
    const struct optics_camera *camera;
    struct optics_laser laser;
    struct v3 eye_mm;
    const struct lit_vertex *vertices;
    GArray *shares; /* of struct share; the angles are in rad before they are sorted */
};

static void add_share(struct laser_light *light, double angle, double amplitude, guint32 pixel) {
    struct share share = {(float)angle, (float)amplitude, pixel};
    if (share.amplitude > 0)
        g_array_append_val(light->shares, share);
}

/* Adds the laser's light after one bounce. This light is smooth, so it is computed only once for
 * each pixel: at the vertex that is nearest to the pixel's first sample. */
static void add_bounces(struct laser_light *light, const struct view *view) {
    const struct scene *scene = &light->world->scene;
    guint i = 0;
    while (i < view->n && scene->n_gather > 0) {
        const struct point *first = NULL;
        float weight = 0;
        guint32 pixel = view->points[i].pixel;
        for (; i < view->n && view->points[i].pixel == pixel; i++) {
            if (view->points[i].triangle == NO_TRIANGLE)
                continue;
            first = first ? first : &view->points[i];
            weight += view->weights[pixel];
        }
        if (!first)
            continue;
        struct surface s;
        world_unpack(first, &s);
        guint32 vertex = scene_nearest_vertex(scene, s.triangle, s.u, s.v);
        enum cfa_colour colour = world_pixel_colour(light->camera, pixel);
        double factor =
            s.albedo[colour] * M_1_PI * weight * light->laser.colour[colour] / scene->n_gather;
        const guint32 *gather = scene->gather + (gsize)vertex * (gsize)scene->n_gather;
        for (int k = 0; k < scene->n_gather; k++) {
            if (gather[k] == NO_TRIANGLE)
                continue;
            const struct lit_vertex *from = &light->vertices[gather[k]];
            double albedo = scene->vertices[gather[k]].albedo[colour];
            add_share(light, from->angle, factor * from->irradiance * albedo, pixel);
        }
    }
}

/* Sorts contributions into cells of one σ. Their order within a cell is kept, so that sums always
 * have the same rounding errors. */
static struct laser_list *sort_shares(const GArray *from, double sigma, gsize *ret_bytes) {
    const struct share *shares = (const struct share *)(gpointer)from->data;
    double first = 0, last = 0;
    for (guint i = 0; i < from->len; i++) {
        first = i && first < shares[i].angle ? first : shares[i].angle;
        last = i && last > shares[i].angle ? last : shares[i].angle;
    }
    guint n_cells = (guint)((last - first) / sigma) + 1;
    gsize list_bytes = sizeof(struct laser_list) + from->len * sizeof(struct share);
    *ret_bytes = list_bytes + (n_cells + 1) * sizeof(guint32);
    struct laser_list *list = g_malloc(*ret_bytes);
    guint32 *starts = (guint32 *)(gpointer)((char *)list + list_bytes);
    memset(starts, 0, (n_cells + 1) * sizeof(guint32));
    g_autofree guint32 *fill = g_new0(guint32, n_cells + 1);
    list->first = first;
    list->n_cells = n_cells;
    list->starts = starts;
    for (guint i = 0; i < from->len; i++)
        starts[MIN((guint)((shares[i].angle - first) / sigma), n_cells - 1) + 1]++;
    for (guint i = 0; i < n_cells; i++)
        fill[i + 1] = starts[i + 1] += starts[i];
    for (guint i = 0; i < from->len; i++) {
        double angle = (shares[i].angle - first) / sigma;
        list->shares[fill[MIN((guint)angle, n_cells - 1)]++] =
            (struct share){(float)angle, shares[i].amplitude, shares[i].pixel};
    }
    return list;
}

/* Returns the view of a camera (world_view()) in the light of a laser. For all pixels, the
 * magnification is that of the laser's colour. */
static struct cache_entry *laser_view(const struct laser_job *job) {
    const struct optics_camera *camera = &job->world->cameras[job->camera];
    const double magnification =
        camera->lateral_colour != 0
            ? optics_magnification(camera, job->world->lasers[job->laser].colour)
            : 0;
    return world_view(job->world, job->camera, job->arm_deg, job->turntable_deg, magnification);
}

static gpointer make_list(const struct cache_key *key, gconstpointer data, gsize *ret_bytes) {
    const struct laser_job *job = data;
    World *world = job->world;
    struct cache_key vertices_key = {{CACHED_LASER_VERTICES, (guint64)job->laser,
                                      world_bits(job->pose.relative_rad),
                                      world_bits(job->pose.turntable_rad)}};
    struct cache_entry *vertices = cache_get(world->cache, &vertices_key, make_vertices, job);
    struct cache_entry *entry = laser_view(job);
    const struct view *view = entry->value;
    g_autoptr(GArray) shares = g_array_sized_new(FALSE, FALSE, sizeof(struct share), view->n * 4);
    struct laser_light light = {
        .world = world,
        .camera = &world->cameras[job->camera],
        .laser = world_laser_at(world, job->laser, job->pose),
        .eye_mm = view->eye_mm,
        .vertices = vertices->value,
        .shares = shares,
    };
    struct v3 source = light.laser.position_mm;
    struct surface surfaces[SCENE_BATCH];
    guint8 blocked[SCENE_BATCH];
    for (guint at = 0; at < view->n; at += SCENE_BATCH) {
        int n = world_light_points(world, view, at, source, surfaces, blocked);
        for (int i = 0; i < n; i++) {
            if (blocked[i])
                continue;
            struct surface *s = &surfaces[i];
            for (int k = 0; k < 3 && s->triangle != NO_TRIANGLE; k++)
                s->albedo[k] *= (float)(1 - world->bleeding_share);
            struct v3 p = v3(s->p[0], s->p[1], s->p[2]);
            guint32 pixel = view->points[at + (guint)i].pixel;
            enum cfa_colour colour = world_pixel_colour(light.camera, pixel);
            double e = optics_laser_peak(&light.laser, p) * light.laser.colour[colour];
            float f = scene_reflect(s, source, light.eye_mm, colour);
            add_share(&light, optics_laser_angle(&light.laser, p), e * f * view->weights[pixel],
                      pixel);
        }
    }
    add_bounces(&light, view);
    cache_release(world->cache, entry);
    cache_release(world->cache, vertices);
    return sort_shares(shares, light.laser.sigma, ret_bytes);
}

/* The profile exp(−x²/2) is interpolated linearly in a table over x². The errors are below 2e-5. */
#define PROFILE_STEPS 64
static float profile_table[REACH * REACH * PROFILE_STEPS + 2];

static void add_cells(const struct laser_list *list, double at, float *rate) {
    double low = MAX(0, floor(at - REACH)), high = MIN(list->n_cells, floor(at + REACH) + 1);
    if (!(low < high))
        return;
    const struct share *share = list->shares + list->starts[(guint)low];
    const struct share *end = list->shares + list->starts[(guint)high];
    float middle = (float)at;
    for (; share < end; share++) {
        float x = share->angle - middle, x2 = x * x * PROFILE_STEPS;
        if (x2 >= REACH * REACH * PROFILE_STEPS)
            continue;
        int i = (int)x2;
        float a = profile_table[i], b = profile_table[i + 1];
        rate[share->pixel] += share->amplitude * (a + (b - a) * (x2 - (float)i));
    }
}

void world_add_laser(World *world, int camera, int laser, const struct world_state *state,
                     float *rate) {
    static gsize filled;
    if (g_once_init_enter(&filled)) {
        for (gsize i = 0; i < G_N_ELEMENTS(profile_table); i++)
            profile_table[i] = (float)exp(-(double)i / PROFILE_STEPS / 2);
        g_once_init_leave(&filled, 1);
    }
    struct laser_job job = {
        world,
        camera,
        laser,
        state->arm_deg,
        state->turntable_deg,
        world_light_pose(world, world->laser_fixed[laser], state->arc_deg, state->turntable_deg)};
    double turntable_rad = world_relative_rad(state->turntable_deg, 0);
    struct cache_key key = {{CACHED_LASER_LIST | (guint64)camera << 8 | (guint64)laser << 16,
                             world_bits(turntable_rad), world_bits(job.pose.relative_rad),
                             world_carried_bits(world->camera_on_arm[camera], state->arm_deg)}};
    struct cache_entry *entry = cache_get(world->cache, &key, make_list, &job);
    const struct laser_list *list = entry->value;
    double sigma = world->lasers[laser].sigma, sweep = RAD(state->sweep_deg[laser]);
    add_cells(list, (sweep - list->first) / sigma, rate);
    cache_release(world->cache, entry);
    if (world->bleeding) {
        entry = laser_view(&job);
        world_add_bleeding(world, camera, laser, job.pose, sweep, entry->value, rate);
        cache_release(world->cache, entry);
    }
}
