#include "world_private.h"

#include <string.h>

/* While the turntable turns, one exposure is computed in several poses of the turntable, at most
 * MAX_POSES. If so many poses are enough, the sample's edge moves by at most POSE_STEP_PX pixels
 * from one pose to the next. */
#define MAX_POSES    32
#define POSE_STEP_PX 0.125

static GMutex registry_lock;
static GHashTable *registry; /* maps a path to a World, without a reference to the World */

static void free_world(World *world) {
    cache_free(world->cache);
    bleeding_free(world->bleeding);
    scene_clear(&world->scene);
    sample_free(world->mesh);
    for (int i = 0; i < WORLD_MAX_CAMERAS; i++) {
        g_free(world->camera_names[i]);
        g_free(world->camera_serials[i]);
    }
    for (int i = 0; i < WORLD_MAX_LAMPS; i++)
        g_free(world->lamp_names[i]);
    for (int i = 0; i < WORLD_MAX_LASERS; i++)
        g_free(world->laser_names[i]);
    g_mutex_clear(&world->lock);
    g_free(world->key);
    g_free(world);
}

World *world_get(const char *path, GError **error) {
    g_autofree char *key = g_canonicalize_filename(path, NULL);
    char *real = realpath(key, NULL);
    if (real) {
        g_free(key);
        key = g_strdup(real);
        free(real);
    }
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&registry_lock);
    if (!registry)
        registry = g_hash_table_new(g_str_hash, g_str_equal);
    World *world = g_hash_table_lookup(registry, key);
    if (world) {
        world->ref_count++;
        return world;
    }
    world = g_new0(World, 1);
    world->ref_count = world->n_turns = 1;
    world->key = g_steal_pointer(&key);
    g_mutex_init(&world->lock);
    for (int i = 0; i < WORLD_MAX_LAMPS; i++)
        world->power[i].on_us = G_MAXINT64; /* the lamp has never been on */
    if (world_load(world, world->key, error))
        g_hash_table_insert(registry, world->key, world);
    else
        g_clear_pointer(&world, free_world);
    return world;
}

World *world_ref(World *world) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&registry_lock);
    world->ref_count++;
    return world;
}

void world_unref(World *world) {
    if (!world)
        return;
    g_mutex_lock(&registry_lock);
    gboolean last = --world->ref_count == 0;
    if (last)
        g_hash_table_remove(registry, world->key);
    if (last && g_hash_table_size(registry) == 0)
        g_clear_pointer(&registry, g_hash_table_unref);
    g_mutex_unlock(&registry_lock);
    if (last)
        free_world(world);
}

static int find(char *const *names, int n, const char *name) {
    for (int i = 0; i < n; i++)
        if (g_str_equal(names[i], name))
            return i;
    return -1;
}

int world_find_camera(const World *world, const char *name) {
    return find(world->camera_names, world->n_cameras, name);
}

int world_find_lamp(const World *world, const char *name) {
    return find(world->lamp_names, world->n_lamps, name);
}

int world_find_laser(const World *world, const char *name) {
    return find(world->laser_names, world->n_lasers, name);
}

void world_sensor(const World *world, int camera, struct world_sensor *ret) {
    g_return_if_fail(camera >= 0 && camera < world->n_cameras);
    const struct optics_camera *from = &world->cameras[camera];
    *ret = (struct world_sensor){from->width, from->height,      from->bits,
                                 from->cfa,   from->black_level, world->camera_serials[camera]};
}

void world_set_turntable(World *world, double deg) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->turns[0] = (struct turn){.deg = deg};
    world->n_turns = 1;
}

void world_turn_turntable(World *world, double deg, double deg_s, gint64 at_us) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->turns[world->n_turns++ % WORLD_TURNS] = (struct turn){at_us, deg, deg_s};
}

/* Returns the position of the turntable at a time. If the time is before the oldest turn that is
 * kept, the position is that of the oldest turn, extended backwards. */
static double turntable_at(const World *world, gint64 at_us) {
    const guint oldest = world->n_turns > WORLD_TURNS ? world->n_turns - WORLD_TURNS : 0;
    guint i = world->n_turns - 1;
    while (i > oldest && world->turns[i % WORLD_TURNS].from_us > at_us)
        i--;
    const struct turn *turn = &world->turns[i % WORLD_TURNS];
    return turn->deg + turn->deg_s * 1e-6 * (double)(at_us - turn->from_us);
}

static void note_turntable(const World *world, gint64 start_us, gint64 exposure_us,
                           struct world_state *state) {
    const double from = turntable_at(world, start_us);
    state->turning_deg[0] = from;
    for (int i = 1; i < WORLD_INSTANTS; i++) {
        const double at = turntable_at(world, start_us + exposure_us * i / (WORLD_INSTANTS - 1));
        state->turning_deg[i] = at == from ? at : from + remainder(at - from, 360);
    }
    state->turntable_deg = state->turning_deg[WORLD_INSTANTS / 2];
}

void world_set_arc(World *world, double deg) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->arc_deg = deg;
}

void world_set_arm(World *world, double deg) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->arm_deg = deg;
}

void world_set_probe(World *world, double deg) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->probe_deg = deg;
}

void world_set_sweep(World *world, int laser, double deg) {
    g_return_if_fail(laser >= 0 && laser < world->n_lasers);
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->sweep_deg[laser] = deg;
}

void world_mount_laser(World *world, int laser, int place) {
    g_return_if_fail(laser >= 0 && laser < world->n_lasers);
    g_return_if_fail(place >= 0 && place < world->n_lasers);
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->laser_place[laser] = place;
}

void world_set_lamp(World *world, int lamp, gboolean on, gint64 at_us) {
    g_return_if_fail(lamp >= 0 && lamp < world->n_lamps);
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    struct lamp_power *power = &world->power[lamp];
    if (on && !power->on)
        power->on_us = at_us;
    if (!on && power->on)
        power->off_us = at_us;
    power->on = on;
}

void world_set_lamp_dead(World *world, int lamp, gboolean dead) {
    g_return_if_fail(lamp >= 0 && lamp < world->n_lamps);
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->power[lamp].dead = dead;
}

double world_lamp_warm_up_s(const World *world) {
    return world->warm_up_s;
}

void world_set_laser(World *world, int laser, gboolean on) {
    g_return_if_fail(laser >= 0 && laser < world->n_lasers);
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    world->laser_on[laser] = on;
}

/* Returns the integral in seconds of the warm-up curve, from 0 to t ≤ w. The curve is 1 − (1 −
 * start)(1 − t/w)², with w = warm_up_s. */
static double warming(const World *world, double t) {
    double w = world->warm_up_s, rest = 1 - t / w;
    return t - (1 - world->warm_up_start) * w / 3 * (1 - rest * rest * rest);
}

static double lamp_output(const World *world, int lamp, gint64 start_us, gint64 exposure_us) {
    const struct lamp_power *power = &world->power[lamp];
    gint64 end_us = start_us + MAX(exposure_us, 1);
    gint64 from_us = MAX(start_us, power->on_us);
    gint64 to_us = power->on ? end_us : MIN(end_us, power->off_us);
    if (power->dead || to_us <= from_us)
        return 0;
    double from_s = (double)(from_us - power->on_us) * 1e-6;
    double to_s = (double)(to_us - power->on_us) * 1e-6;
    gint64 warm_us = (gint64)llrint(world->warm_up_s * 1e6);
    gboolean full = from_us == start_us && to_us == end_us && from_us - power->on_us >= warm_us;
    double output = 1;
    if (!full) {
        double w = world->warm_up_s, lit_s = MAX(0, to_s - MAX(from_s, w));
        if (from_s < w)
            lit_s += warming(world, MIN(to_s, w)) - warming(world, from_s);
        output = lit_s / ((double)(end_us - start_us) * 1e-6);
    }
    if (world->drift != 0) {
        double middle_s = ((double)start_us + (double)exposure_us / 2) * 1e-6;
        output *= 1 + world->drift * sin(2 * G_PI * middle_s / world->drift_period_s);
    }
    if (world->flicker > 0) {
        struct sample_random random = {sample_hash(world->noise_seed + (guint64)lamp) ^
                                       sample_hash((guint64)start_us)};
        output *= MAX(0, 1 + world->flicker * sample_deviate(&random));
    }
    return output;
}

void world_snapshot(World *world, gint64 start_us, gint64 exposure_us, struct world_state *ret) {
    g_autoptr(GMutexLocker) locker = g_mutex_locker_new(&world->lock);
    *ret = (struct world_state){.arc_deg = world->arc_deg,
                                .arm_deg = world->arm_deg,
                                .probe_deg = world->probe_deg,
                                .time_us = start_us};
    note_turntable(world, start_us, exposure_us, ret);
    for (int i = 0; i < world->n_lasers; i++) {
        int place = world->laser_place[i];
        if (ret->laser_on[place])
            /* a dark laser does not count, because a lit laser may be at the same place */
            continue;
        ret->sweep_deg[place] = world->sweep_deg[i];
        ret->laser_on[place] = world->laser_on[i];
    }
    for (int i = 0; i < world->n_lamps; i++)
        ret->lamp_output[i] = (float)lamp_output(world, i, start_us, exposure_us);
}

/* Memory for the light of an exposure. A thread keeps it for its next exposure. To allocate it for
 * each exposure would take a tenth of the time of a laser sweep. */
struct light {
    gsize n;     /* number of pixels */
    float *rate; /* of all lamps and lasers */
    float *own;  /* of one laser */
};

static void light_free(gpointer data) {
    struct light *light = data;
    g_free(light->rate);
    g_free(light->own);
    g_free(light);
}

/* Returns the memory of this thread for pictures of n pixels. */
static struct light *light_get(gsize n) {
    static GPrivate of_thread = G_PRIVATE_INIT(light_free);
    struct light *light = g_private_get(&of_thread);
    if (light && light->n >= n)
        return light;
    light = g_new(struct light, 1);
    *light = (struct light){n, g_new(float, n), g_new(float, n)};
    g_private_replace(&of_thread, light);
    return light;
}

/* Adds the light of all lamps and lasers in one pose of the turntable to light->rate, in DN·s⁻¹,
 * multiplied by share. */
static void add_light(World *world, int camera, const struct world_state *state, float share,
                      struct light *light) {
    float *rate = light->rate;
    const gsize n = (gsize)world->cameras[camera].width * (gsize)world->cameras[camera].height;
    for (int i = 0; i < world->n_lamps; i++) {
        const float output = share * state->lamp_output[i];
        if (!(output > 0))
            continue;
        struct cache_entry *entry = world_lamp_picture(world, camera, i, state);
        const float *picture = entry->value;
        for (gsize k = 0; k < n; k++)
            rate[k] += output * picture[k];
        cache_release(world->cache, entry);
    }
    for (int i = 0; i < world->n_lasers; i++) {
        if (!state->laser_on[i])
            continue;
        float *own = share < 1 || world->speckle_contrast > 0 ? light->own : NULL;
        if (own)
            memset(own, 0, n * sizeof *own);
        world_add_laser(world, camera, i, state, own ? own : rate);
        if (world->speckle_contrast > 0)
            world_speckle(world, camera, i, state, own);
        for (gsize k = 0; own && k < n; k++)
            rate[k] += share * own[k];
    }
}

/* Returns the number of poses of the turntable in which an exposure is computed. It is 1 if the
 * turntable stood still. */
static int world_n_poses(const World *world, int camera, const struct world_state *state) {
    const struct optics_camera *sensor = &world->cameras[camera];
    const float *low = world->scene.low, *high = world->scene.high;
    const double x = (double)MAX(-low[0], high[0]), y = (double)MAX(-low[1], high[1]);
    const double turned = fabs(state->turning_deg[WORLD_INSTANTS - 1] - state->turning_deg[0]);
    const double px = turned * G_PI / 180 * hypot(x, y) * sensor->focal_px /
                      sqrt(v3_dot(sensor->centre_mm, sensor->centre_mm));
    return CLAMP((int)ceil(px / POSE_STEP_PX), 1, MAX_POSES);
}

/* Returns the light of an exposure in DN·s⁻¹. The memory belongs to the thread (light_get()). */
static const float *exposure_light(World *world, int camera, const struct world_state *state) {
    const struct optics_camera *sensor = &world->cameras[camera];
    const gsize n = (gsize)sensor->width * (gsize)sensor->height;
    const int n_poses = world_n_poses(world, camera, state);
    struct light *light = light_get(n);
    memset(light->rate, 0, n * sizeof *light->rate);
    for (int i = 0; i < n_poses; i++) {
        struct world_state pose = *state;
        const double at = (i + 0.5) / n_poses * (WORLD_INSTANTS - 1);
        const int before = (int)at;
        if (n_poses > 1)
            pose.turntable_deg =
                state->turning_deg[before] +
                (at - before) * (state->turning_deg[before + 1] - state->turning_deg[before]);
        add_light(world, camera, &pose, 1.0f / (float)n_poses, light);
    }
    optics_add_glare(sensor, light->rate);
    return light->rate;
}

void world_expose(World *world, int camera, const struct world_state *state, gint64 exposure_us,
                  double gain_db, guint64 noise_key, guint16 *ret_pixels) {
    g_return_if_fail(camera >= 0 && camera < world->n_cameras);
    gboolean lit = FALSE;
    for (int i = 0; i < world->n_lamps; i++)
        lit |= state->lamp_output[i] > 0;
    for (int i = 0; i < world->n_lasers; i++)
        lit |= state->laser_on[i];
    const float *rate = lit ? exposure_light(world, camera, state) : NULL;
    guint64 key = sample_hash(noise_key * 0x9e3779b97f4a7c15u + (guint64)camera + 1);
    optics_sense(&world->cameras[camera], rate, (double)exposure_us * 1e-6, gain_db, world->noise,
                 sample_hash(key ^ world->noise_seed), ret_pixels);
}
