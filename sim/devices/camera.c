#include "devices.h"
#include "part.h"
#include "world/world.h"

#include <string.h>
#include <time.h>

enum stale_kind { STALE_OLD, STALE_RELABELLED };

struct picture;

struct sim_camera {
    char *world_path, *part_name;
    double readout_ms, trigger_ms, jitter_ms, min_exposure_us, max_exposure_us;
    double fault_stale, fault_lost, fault_slow_ms, fault_reconnect_s;
    int fault_stale_kind, fault_disconnect_after, fault_seed;

    World *world;
    int camera;
    GRand *faults;
    struct camera_settings settings;
    guint64 last_id;
    int n_triggers;
    gboolean gone;
    gint64 back_at_us;
    guint timer;
    /* the picture that is being exposed or read out; NULL if there is none */
    struct picture *picture;
    Frame *last; /* the last frame delivered without a fault; repeated by the fault `stale` */
    int n_rendered;
    gint64 rendering_us; /* CPU time in µs that the rendering took */
};

/* A struct picture is one exposure. Another thread renders it. The picture is delivered when it is
 * rendered and its time has come. It exists until the thread has finished, even if the camera was
 * closed. */
struct picture {
    Camera *camera; /* NULL after the camera was closed or disarmed */
    World *world;
    int index;
    struct world_state state;
    double gain_db;
    guint64 shot;
    gint64 start_us;
    Frame *frame;
    gint64 rendering_us;
    gboolean started, rendered, due, holds;
    gboolean lost, stale;
    Clock *clock;
};

#define FIELD(name) G_STRUCT_OFFSET(struct sim_camera, name)

static const char *const stale_kinds[] = {"old", "relabelled", NULL};

static const struct option options[] = {
    {"world", OPTION_PATH, NULL, 0, 0, NULL, NULL, FIELD(world_path),
     "World file whose camera this is"},
    {"part", OPTION_STRING, NULL, 0, 0, "", NULL, FIELD(part_name),
     "The camera's name in the world file; default: the section's own name"},
    {"readout_ms", OPTION_DOUBLE, "ms", 0, 60000, "30", NULL, FIELD(readout_ms),
     "Time from the end of the exposure to the arrival of the frame"},
    {"trigger_ms", OPTION_DOUBLE, "ms", 0, 60000, "1", NULL, FIELD(trigger_ms),
     "Time from the trigger to the start of the exposure"},
    {"fault_jitter_ms", OPTION_DOUBLE, "ms", 0, 60000, "0", NULL, FIELD(jitter_ms),
     "Fault: largest further delay of the exposure; its time stamp includes the delay, which is a "
     "function of the shot"},
    {"min_exposure_us", OPTION_DOUBLE, "µs", 1, 1e9, "10", NULL, FIELD(min_exposure_us),
     "Shortest exposure"},
    {"max_exposure_us", OPTION_DOUBLE, "µs", 1, 1e9, "60000000", NULL, FIELD(max_exposure_us),
     "Longest exposure"},
    {"fault_stale", OPTION_DOUBLE, NULL, 0, 1, "0", NULL, FIELD(fault_stale),
     "Fault: probability that the previous frame is delivered instead"},
    {"fault_stale_kind", OPTION_CHOICE, NULL, 0, 0, "old", stale_kinds, FIELD(fault_stale_kind),
     "Whether a stale frame has its old id and time stamp, or fresh ones"},
    {"fault_lost", OPTION_DOUBLE, NULL, 0, 1, "0", NULL, FIELD(fault_lost),
     "Fault: probability that a frame never arrives"},
    {"fault_slow_ms", OPTION_DOUBLE, "ms", 0, 600000, "0", NULL, FIELD(fault_slow_ms),
     "Fault: time by which frames arrive later than readout_ms"},
    {"fault_disconnect_after", OPTION_INT, NULL, 0, G_MAXINT, "0", NULL,
     FIELD(fault_disconnect_after),
     "Fault: number of triggers after which the camera is disconnected once; 0: never"},
    {"fault_reconnect_s", OPTION_DOUBLE, "s", 0, 1e9, "5", NULL, FIELD(fault_reconnect_s),
     "Time for which the camera stays disconnected before it can be armed again"},
    {"fault_seed", OPTION_INT, NULL, 0, G_MAXINT, "1", NULL, FIELD(fault_seed),
     "Seed that determines which frames fail; the frames themselves do not depend on it"},
    {NULL},
};

static void sim_camera_picture_free(struct picture *picture) {
    if (picture->holds)
        clock_release(picture->clock);
    clock_unref(picture->clock);
    world_unref(picture->world);
    frame_unref(picture->frame);
    g_free(picture);
}

/* Detaches a picture from its camera and frees it. If a thread is still rendering the picture,
 * on_rendered() frees it when the thread has finished. */
static void picture_drop(struct picture *picture) {
    if (!picture)
        return;
    picture->camera = NULL;
    if (picture->holds)
        clock_release(picture->clock);
    picture->holds = FALSE;
    if (!picture->started || picture->rendered)
        sim_camera_picture_free(picture);
}

static void sim_camera_deliver(Camera *camera) {
    struct sim_camera *sim = camera->device.priv;
    struct picture *picture = g_steal_pointer(&sim->picture);
    g_autoptr(Frame) stale = NULL;
    gboolean lost = picture->lost;
    sim->n_rendered++;
    sim->rendering_us += picture->rendering_us;
    if (picture->stale && sim->last) {
        stale = frame_new(sim->last->width, sim->last->height);
        guint16 *pixels = stale->pixels;
        gsize n = (gsize)stale->width * (gsize)stale->height;
        *stale = sim->fault_stale_kind == STALE_RELABELLED ? *picture->frame : *sim->last;
        stale->ref_count = 1;
        stale->shot = picture->shot;
        stale->pixels = memcpy(pixels, sim->last->pixels, n * sizeof *pixels);
    }
    Frame *frame = frame_ref(stale ? stale : picture->frame);
    if (!stale && !lost) {
        frame_unref(sim->last);
        sim->last = frame_ref(frame);
    }
    picture_drop(picture);
    if (lost)
        frame_unref(frame);
    else
        camera_report_frame(camera, frame);
}

static gboolean on_rendered(gpointer data) {
    struct picture *picture = data;
    picture->rendered = TRUE;
    if (!picture->camera)
        sim_camera_picture_free(picture);
    else if (picture->due)
        sim_camera_deliver(picture->camera);
    return G_SOURCE_REMOVE;
}

/* Returns the CPU time in µs that the calling thread has used. */
static gint64 processor_us(void) {
    struct timespec now;
    clock_gettime(CLOCK_THREAD_CPUTIME_ID, &now);
    return now.tv_sec * G_USEC_PER_SEC + now.tv_nsec / 1000;
}

static void sim_camera_render(gpointer data, gpointer unused) {
    struct picture *picture = data;
    const gint64 begun_us = processor_us();
    world_expose(picture->world, picture->index, &picture->state, picture->frame->exposure_us,
                 picture->gain_db, picture->shot, picture->frame->pixels);
    picture->rendering_us = processor_us() - begun_us;
    /* g_main_context_invoke() is not used here, because it would call on_rendered() in this thread
     * while no main loop iteration owns the context. */
    g_idle_add_full(G_PRIORITY_DEFAULT, on_rendered, picture, NULL);
}

static void on_due(gpointer data) {
    Camera *camera = data;
    struct sim_camera *sim = camera->device.priv;
    struct picture *picture = sim->picture;
    sim->timer = 0;
    picture->due = TRUE;
    if (picture->rendered) {
        sim_camera_deliver(camera);
        return;
    }
    /* The clock is held only from here on, so that all cameras of a shot render at the same
     * time. */
    picture->holds = TRUE;
    clock_hold(picture->clock);
}

static void sim_camera_on_exposed(gpointer data) {
    static GThreadPool *pool;
    Camera *camera = data;
    struct sim_camera *sim = camera->device.priv;
    struct picture *picture = sim->picture;
    world_snapshot(sim->world, picture->start_us, sim->settings.exposure_us, &picture->state);
    picture->started = TRUE;
    if (!pool)
        pool = g_thread_pool_new(sim_camera_render, NULL, (int)g_get_num_processors(), FALSE, NULL);
    g_thread_pool_push(pool, picture, NULL);
    sim->timer =
        clock_call_in(camera->device.clock, (gint64)((sim->readout_ms + sim->fault_slow_ms) * 1000),
                      on_due, camera);
    camera_report_exposed(camera);
}

static gboolean refuse_gone(const Camera *camera, GError **error) {
    return device_error_set(error, DEVICE_ERROR_DISCONNECTED, camera->device.who,
                            "the camera is disconnected" ERROR_ADVICE "check the camera's cable");
}

static void sim_camera_on_gone(gpointer data) {
    Camera *camera = data;
    struct sim_camera *sim = camera->device.priv;
    g_autoptr(GError) error = NULL;
    sim->timer = 0;
    refuse_gone(camera, &error);
    camera_report_fault(camera, g_steal_pointer(&error));
}

/* Returns the random delay of a shot in µs, at most jitter_ms. The delay depends only on the number
 * of the shot. The hash uses integer arithmetic, so the delay is the same on every machine. */
static gint64 jitter_us(const struct sim_camera *sim, guint64 shot) {
    guint64 x = (shot + 1) * 0x9e3779b97f4a7c15u;
    x = (x ^ (x >> 30)) * 0xbf58476d1ce4e5b9u;
    return (gint64)((double)(x >> 11) * 0x1p-53 * sim->jitter_ms * 1000);
}

static gboolean sim_camera_trigger(Camera *camera, guint64 shot, GError **error) {
    struct sim_camera *sim = camera->device.priv;
    gint64 now = clock_now_us(camera->device.clock);
    if (sim->gone)
        return refuse_gone(camera, error);
    if (sim->fault_disconnect_after > 0 && sim->n_triggers++ == sim->fault_disconnect_after) {
        sim->gone = TRUE;
        sim->back_at_us = now + (gint64)(sim->fault_reconnect_s * 1e6);
        sim->timer = clock_call_in(camera->device.clock, 0, sim_camera_on_gone, camera);
        return TRUE;
    }
    struct picture *picture = g_new0(struct picture, 1);
    picture->camera = camera;
    picture->world = world_ref(sim->world);
    picture->clock = clock_ref(camera->device.clock);
    picture->index = sim->camera;
    picture->gain_db = sim->settings.gain_db;
    picture->shot = shot;
    picture->start_us = now + (gint64)(sim->trigger_ms * 1000) + jitter_us(sim, shot);
    Frame *frame = picture->frame = frame_new(camera->format.width, camera->format.height);
    frame->shot = shot;
    frame->id = ++sim->last_id;
    frame->exposure_us = sim->settings.exposure_us;
    frame->exposure_start_us = picture->start_us;
    frame->exposure_end_us = picture->start_us + frame->exposure_us;
    frame->cfa = camera->format.cfa;
    frame->bits = camera->format.bits;
    frame->black_level = camera->format.black_level;
    /* Both random numbers are drawn for every picture, so that the settings of one fault do not
     * change the pictures with the other fault. */
    picture->stale = g_rand_double(sim->faults) < sim->fault_stale;
    picture->lost = g_rand_double(sim->faults) < sim->fault_lost;
    sim->picture = picture;
    sim->timer =
        clock_call_at(camera->device.clock, frame->exposure_end_us, sim_camera_on_exposed, camera);
    return TRUE;
}

static gboolean sim_camera_configure(Camera *camera, const struct camera_settings *settings,
                                     GError **error) {
    struct sim_camera *sim = camera->device.priv;
    sim->settings = *settings;
    return TRUE;
}

static gboolean sim_camera_arm(Camera *camera, GError **error) {
    struct sim_camera *sim = camera->device.priv;
    if (sim->gone && clock_now_us(camera->device.clock) < sim->back_at_us)
        return refuse_gone(camera, error);
    sim->gone = FALSE;
    return TRUE;
}

static void sim_camera_disarm(Camera *camera) {
    struct sim_camera *sim = camera->device.priv;
    clock_cancel(camera->device.clock, &sim->timer);
    picture_drop(g_steal_pointer(&sim->picture));
}

static void sim_camera_check(gconstpointer given, const struct config_section *section,
                             Mistakes *mistakes) {
    const struct sim_camera *sim = given;
    sim_part_check(section, sim->world_path, "part", sim->part_name, "camera", NULL, mistakes);
}

static gboolean sim_camera_open_camera(Camera *camera, GError **error) {
    struct sim_camera *sim = camera->device.priv;
    const char *name = *sim->part_name ? sim->part_name : camera->device.name;
    struct world_sensor sensor;
    sim->world = world_get(sim->world_path, error);
    if (!sim->world)
        return FALSE;
    sim->camera = world_find_camera(sim->world, name);
    if (sim->camera < 0) {
        g_set_error(error, CONFIG_ERROR, CONFIG_ERROR_UNKNOWN,
                    "camera %s: part: the world file %s has no camera \"%s\": give the name of one "
                    "of its cameras",
                    camera->device.name, sim->world_path, name);
        g_clear_pointer(&sim->world, world_unref);
        return FALSE;
    }
    sim->faults = g_rand_new_with_seed((guint32)sim->fault_seed);
    world_sensor(sim->world, sim->camera, &sensor);
    device_set_identity(&camera->device, "simulated camera", sensor.serial, NULL);
    camera->format = (struct camera_format){
        .width = sensor.width,
        .height = sensor.height,
        .cfa = sensor.cfa,
        .bits = sensor.bits,
        .black_level = sensor.black_level,
        .min_exposure_us = (gint64)sim->min_exposure_us,
        .max_exposure_us = (gint64)sim->max_exposure_us,
        .trigger_us = (gint64)(sim->trigger_ms * 1000),
        .readout_us = (gint64)(sim->readout_ms * 1000),
    };
    return TRUE;
}

static void sim_camera_close_camera(Camera *camera) {
    struct sim_camera *sim = camera->device.priv;
    sim_camera_disarm(camera);
    if (sim->n_rendered > 0)
        g_info("%s: %d frames took %.1f s of processor time to simulate", camera->device.name,
               sim->n_rendered, (double)sim->rendering_us / G_USEC_PER_SEC);
    g_clear_pointer(&sim->last, frame_unref);
    g_clear_pointer(&sim->faults, g_rand_free);
    g_clear_pointer(&sim->world, world_unref);
}

const struct camera_driver sim_camera_driver = {
    .info = {"camera", "sim-camera", "A camera that looks at the simulated world", options,
             sizeof(struct sim_camera), sim_camera_check},
    .open = sim_camera_open_camera,
    .close = sim_camera_close_camera,
    .configure = sim_camera_configure,
    .arm = sim_camera_arm,
    .disarm = sim_camera_disarm,
    .trigger = sim_camera_trigger,
};
