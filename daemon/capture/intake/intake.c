#include "intake.h"

#include <gio/gio.h>
#include <math.h>
#include <sys/resource.h>

#include "intake_darks.h"
#include "intake_write.h"
#include "radiance.h"
#include "radiometry/fiducials.h"

#define FULL_BYTES ((gsize)512 << 20)
/* Frames of a sweep are given to a worker in batches of this number, because waking a worker costs
 * more than its work on one frame. */
#define BATCH 8
/* After a sweep, the laser counts as still lit in two cases:
 * - LASER_PIXELS pixels are above the threshold.
 * - At least half of the pixels that the line lit in the middle of the sweep, and at least
 *   MIN_LASER_PIXELS of them, are above half the threshold. */
#define LASER_PIXELS     4
#define MIN_LASER_PIXELS 2
/* Nice values of the threads. The main loop has the highest priority (0), because it moves axes and
 * triggers cameras. Next come the workers that take frames, and last the threads that write
 * sweeps. */
#define TAKE_NICE   5
#define FINISH_NICE 10

struct job {
    guint generation;
    /* A frame of the lane's camera. The camera may be another stop on the arm than lane->camera.
     * The job owns the frame. */
    struct taken_frame taken;
};

/* A sweep whose frames were all taken. */
struct complete_sweep {
    guint generation;
    struct taken_frame last; /* the last frame of the sweep; owned */
    Sweep *sweep, *short_sweep;
    double dark_dn;
    gboolean laser_seen;
    GError *error;
    gsize bytes; /* size of the sweeps; counts as waiting bytes */
};

/* The worker of a camera, which also serves all stops of that camera on the arm. The main loop uses
 * only `batch`. The other fields belong to the thread of the worker.
 *
 * A second thread (finisher) evaluates and writes the sweeps. This takes seconds for eight sweeps
 * of 1024 × 768 that end at the same time, and frames that arrive meanwhile must be accepted. */
struct lane {
    Intake *intake;
    int camera;
    GThread *thread;
    GAsyncQueue *queue; /* arrays (GPtrArray) of struct job; an empty array ends the thread */
    GPtrArray *batch;
    GThreadPool *finisher; /* the second thread, which finishes sweeps (struct complete_sweep) */
    GMutex mutex;
    GCond finished;
    int n_complete; /* number of sweeps that are not finished yet; guarded by `mutex` */

    guint generation;
    const struct session_shot *shot; /* the shot that is being collected */
    int n_frames;
    Frame *bracket[PLAN_MAX_BRACKET];
    guint32 *sums;
    Sweep *sweep, *short_sweep;
    Frame *sweep_first, *sweep_middle[2]; /* frames with the longer exposure, for is_laser_seen() */
    gboolean laser_seen;
    GError *error; /* the first error of writing a raw frame of `shot` */
    struct intake_darks darks;
};

struct finished {
    guint generation;
    struct intake_result result;
};

struct Intake {
    struct intake_setup setup;
    struct intake_hooks hooks;
    GPtrArray *lanes;
    int lane_of[RIG_MAX_CAMERAS];
    GAsyncQueue *finished;
    GSource *wake;
    /* Number of intake_discard() calls. A worker drops work that has an earlier number. */
    guint generation;
    gsize bytes;    /* bytes of frames and sweeps that wait for a worker; atomic */
    int full;       /* see intake_is_full(); workers read it */
    int steps_over; /* number of end_step() calls that release_steps() has not handled yet */
};

static void job_free(gpointer data) {
    struct job *job = data;
    frame_unref(job->taken.frame);
    g_free(job);
}

static void finished_free(gpointer data) {
    struct finished *finished = data;
    g_free(finished->result.frame.path);
    g_free(finished->result.frame.sha256);
    g_clear_error(&finished->result.error);
    if (finished->result.marks)
        g_array_unref((GArray *)finished->result.marks);
    g_free(finished);
}

static void lane_reset(struct lane *lane) {
    for (int i = 0; i < PLAN_MAX_BRACKET; i++)
        g_clear_pointer(&lane->bracket[i], frame_unref);
    g_clear_pointer(&lane->sums, g_free);
    g_clear_pointer(&lane->sweep, sweep_free);
    g_clear_pointer(&lane->short_sweep, sweep_free);
    g_clear_pointer(&lane->sweep_first, frame_unref);
    for (int i = 0; i < 2; i++)
        g_clear_pointer(&lane->sweep_middle[i], frame_unref);
    g_clear_error(&lane->error);
    lane->laser_seen = FALSE;
    lane->n_frames = 0;
    lane->shot = NULL;
}

static void describe(struct lane *lane, const struct taken_frame *taken, struct intake_file *file) {
    const struct intake_setup *setup = &lane->intake->setup;
    const struct rig *rig = &setup->devices->geometry;
    *file = (struct intake_file){
        .directory = setup->directory,
        .shot = taken->shot,
        .camera = taken->row.camera,
        .camera_name = rig->cameras[taken->row.camera].name,
        .rig = rig,
        .conf = setup->conf,
        .last = taken->frame,
        .turntable_deg = session_frame_turntable_deg(&taken->row, taken->shot),
        .turned = taken->row.turned,
    };
    if (taken->shot->kind == SHOT_LAMP)
        file->source_name = rig->lamps[taken->shot->device].name;
    if (taken->shot->kind == SHOT_SWEEP)
        file->source_name = rig->lasers[taken->shot->device].name;
}

/* Returns a camera's part of a shot to the main loop. Takes ownership of what result owns. */
static void return_result(struct lane *lane, guint generation, const struct intake_result *result) {
    struct finished *finished = g_new(struct finished, 1);
    *finished = (struct finished){generation, *result};
    g_async_queue_push(lane->intake->finished, finished);
    g_source_set_ready_time(lane->intake->wake, 0);
}

static void keep_raw(struct lane *lane, const struct taken_frame *taken) {
    struct intake_file file;
    describe(lane, taken, &file);
    if (!lane->error)
        intake_write_raw(&file, taken->sub, &lane->error);
}

static void take_dark(struct lane *lane, const struct taken_frame *taken) {
    const struct session_conf *conf = lane->intake->setup.conf;
    gsize n = (gsize)taken->frame->width * taken->frame->height;
    if (taken->sub % conf->dark_frames == 0) {
        g_free(lane->sums);
        lane->sums = g_new0(guint32, n);
    }
    radiance_add(taken->frame, lane->sums);
    if ((taken->sub + 1) % conf->dark_frames != 0)
        return;
    float *pixels = g_new(float, n);
    double mean = radiance_mean(lane->sums, conf->dark_frames, n, pixels);
    intake_darks_set(&lane->darks, taken->sub / conf->dark_frames, taken->frame->exposure_us,
                     pixels, mean);
}

static void finish_dark(struct lane *lane, const struct taken_frame *taken) {
    gint64 exposures[SHOT_MAX_DARKS];
    int n = shot_dark_exposures(lane->intake->setup.conf, exposures);
    struct intake_file file;
    describe(lane, taken, &file);
    struct intake_result result = {.shot = taken->shot, .frame = taken->row};
    const float *pixels[SHOT_MAX_DARKS];
    for (int i = 0; i < n; i++) {
        pixels[i] = lane->darks.levels[i].pixels;
        result.dark_dn = MAX(result.dark_dn, lane->darks.levels[i].mean_dn);
    }
    file.dark_dn = result.dark_dn;
    result.error = g_steal_pointer(&lane->error);
    if (!result.error)
        intake_write_dark(&file, exposures, pixels, n, &result.frame, &result.error);
    return_result(lane, lane->generation, &result);
}

/* Measures the marks on the turntable in a picture under a lamp. Returns an array of struct
 * fiducial_seen. Returns NULL if there is no calibration, or if the calibration has no marks or not
 * this lamp. */
static GArray *measure_marks(const struct lane *lane, const struct taken_frame *taken,
                             const float *mosaic) {
    const struct calibration *calibration = lane->intake->setup.calibration;
    const struct session_shot *shot = taken->shot;
    if (!calibration || calibration->rig.n_fiducials == 0 ||
        shot->device >= calibration->rig.n_lamps)
        return NULL;
    struct fiducial_scene scene = {
        .rig = &calibration->rig,
        .camera = taken->row.camera,
        .lamp = shot->device,
        .turntable_rad = session_frame_turntable_deg(&taken->row, shot) * G_PI / 180,
        .arc_rad = shot->arc_deg * G_PI / 180,
        .radiometry = &calibration->camera_radiometry[taken->row.camera],
        .lamp_radiometry = &calibration->lamp_radiometry[shot->device],
    };
    GArray *marks = g_array_new(FALSE, FALSE, sizeof(struct fiducial_seen));
    fiducials_measure(&scene, cfa_name(taken->frame->cfa), mosaic, marks);
    return marks;
}

/* Returns bend_per_dn for radiance_merge(). Returns 0 if the calibration does not know the
 * curvature of the sensor's response, or if the curvature is less than three times its standard
 * error. */
static double bend_of(const struct lane *lane, const struct taken_frame *taken,
                      const Frame *frame) {
    const struct calibration *calibration = lane->intake->setup.calibration;
    if (!calibration || !calibration->noise[taken->row.camera].known)
        return 0;
    const struct transfer *t = &calibration->noise[taken->row.camera].transfer;
    if (fabs(t->curvature) <= 3 * t->curvature_error)
        return 0;
    return t->curvature / ((1 << frame->bits) - 1 - t->black_dn);
}

static void finish_lamp(struct lane *lane, const struct taken_frame *taken) {
    const struct session_conf *conf = lane->intake->setup.conf;
    const float *darks[PLAN_MAX_BRACKET];
    struct intake_file file;
    describe(lane, taken, &file);
    for (int i = 0; i < conf->n_exposures; i++) {
        const struct intake_dark *dark = intake_darks_at(&lane->darks, i, lane->bracket[i]);
        darks[i] = dark->pixels;
        file.dark_dn = dark->mean_dn;
    }
    file.bracket = (const Frame *const *)lane->bracket;
    g_autofree float *merged = g_new(float, (gsize)taken->frame->width * taken->frame->height);
    struct radiance_stats stats;
    radiance_merge((const Frame *const *)lane->bracket, darks, conf->n_exposures, conf->gain_db,
                   bend_of(lane, taken, taken->frame), merged, &stats);
    file.saturated = stats.saturated;
    const Frame *longest = lane->bracket[conf->n_exposures - 1];
    if (conf->n_exposures > 1)
        file.shorter_from = radiance_ceiling(longest->bits, longest->exposure_us, file.dark_dn,
                                             conf->gain_db, bend_of(lane, taken, taken->frame));
    struct intake_result result = {.shot = taken->shot,
                                   .frame = taken->row,
                                   .signal_dn = stats.signal_dn,
                                   .saturated = stats.saturated};
    result.error = g_steal_pointer(&lane->error);
    result.uneven = radiance_disagrees(file.bracket, darks, conf->n_exposures);
    result.marks = measure_marks(lane, taken, merged);
    if (!result.error && !result.uneven)
        intake_write_lamp(&file, merged, &result.frame, &result.error);
    return_result(lane, lane->generation, &result);
}

/* In lockstep (clock_is_lockstep()) the simulated clock stands while a worker has work: from
 * begin_step(), when the work is given to the worker, until the main loop has taken the result. The
 * main loop, and not the worker, lets the clock run again. Otherwise time could pass before the
 * main loop has taken the result. */
static void begin_step(Intake *intake) {
    if (clock_is_lockstep(intake->setup.devices->clock))
        clock_hold(intake->setup.devices->clock);
}

static void end_step(Intake *intake) {
    if (!clock_is_lockstep(intake->setup.devices->clock))
        return;
    g_atomic_int_inc(&intake->steps_over);
    g_source_set_ready_time(intake->wake, 0);
}

static void release_steps(Intake *intake, int n) {
    g_atomic_int_add(&intake->steps_over, -n);
    for (int i = 0; i < n; i++)
        clock_release(intake->setup.devices->clock);
}

static gboolean is_current(const Intake *intake, guint generation) {
    return generation == (guint)g_atomic_int_get(&intake->generation);
}

static void add_bytes(Intake *intake, gssize bytes) {
    const gsize before = (gsize)g_atomic_pointer_add(&intake->bytes, bytes);
    if (bytes < 0 && g_atomic_int_get(&intake->full) &&
        before + (gsize)bytes <= intake->setup.full_bytes / 2)
        g_source_set_ready_time(intake->wake, 0);
}

/* Evaluates and writes a sweep in the second thread of a lane. On Linux, setpriority() applies only
 * to the calling thread. */
static void finish_sweep(gpointer data, gpointer lane_data) {
    struct complete_sweep *complete = data;
    struct lane *lane = lane_data;
    const struct session_conf *conf = lane->intake->setup.conf;
    setpriority(PRIO_PROCESS, 0, FINISH_NICE);
    if (is_current(lane->intake, complete->generation)) {
        struct intake_file file;
        describe(lane, &complete->last, &file);
        file.dark_dn = complete->dark_dn;
        if (complete->short_sweep)
            sweep_set_shorter(complete->sweep, complete->short_sweep,
                              conf->laser_exposure_us / conf->laser_short_us);
        struct intake_result result = {.shot = complete->last.shot,
                                       .frame = complete->last.row,
                                       .laser_seen = complete->laser_seen,
                                       .error = g_steal_pointer(&complete->error)};
        if (!result.error && !result.laser_seen)
            intake_write_sweep(&file, complete->sweep, &result.frame, &result.error);
        return_result(lane, complete->generation, &result);
    }
    frame_unref(complete->last.frame);
    sweep_free(complete->sweep);
    sweep_free(complete->short_sweep);
    g_clear_error(&complete->error);
    add_bytes(lane->intake, -(gssize)complete->bytes);
    end_step(lane->intake);
    g_free(complete);
    g_mutex_lock(&lane->mutex);
    lane->n_complete--;
    g_cond_signal(&lane->finished);
    g_mutex_unlock(&lane->mutex);
}

static void queue_sweep(struct lane *lane, const struct taken_frame *last) {
    struct complete_sweep *complete = g_new0(struct complete_sweep, 1);
    complete->generation = lane->generation;
    complete->last = *last;
    complete->last.frame = frame_ref(last->frame);
    complete->sweep = g_steal_pointer(&lane->sweep);
    complete->short_sweep = g_steal_pointer(&lane->short_sweep);
    complete->dark_dn = intake_darks_at(&lane->darks, 0, last->frame)->mean_dn;
    complete->laser_seen = lane->laser_seen;
    complete->error = g_steal_pointer(&lane->error);
    complete->bytes = sweep_bytes(complete->sweep) +
                      (complete->short_sweep ? sweep_bytes(complete->short_sweep) : 0);
    add_bytes(lane->intake, (gssize)complete->bytes);
    g_mutex_lock(&lane->mutex);
    lane->n_complete++;
    g_mutex_unlock(&lane->mutex);
    begin_step(lane->intake);
    g_thread_pool_push(lane->finisher, complete, NULL);
}

/* Adds frames to a sweep: those with the shorter exposure if shorter is TRUE, otherwise those with
 * the longer one. If *sweep is NULL and there are such frames, makes the sweep. */
static void absorb(Sweep **sweep, struct job *const *jobs, int n, const struct session_conf *conf,
                   gboolean shorter) {
    const struct taken_frame *first = &jobs[0]->taken;
    const Frame *frame = first->frame;
    const guint16 *pixels[BATCH];
    int count = 0;
    for (int i = 0; i < n; i++)
        if (shot_is_short(conf, first->shot, jobs[i]->taken.sub) == shorter)
            pixels[count++] = jobs[i]->taken.frame->pixels;
    if (count > 0 && !*sweep)
        *sweep = sweep_new(frame->width, frame->height, first->shot->sweep_steps,
                           radiance_saturation(frame->bits));
    if (count > 0)
        sweep_add_some(*sweep, pixels, count);
}

/* Keeps the first frame of a sweep and the one or two frames in its middle for is_laser_seen(). */
static void keep_for_end(struct lane *lane, const struct taken_frame *taken) {
    const struct session_conf *conf = lane->intake->setup.conf;
    const int n = taken->shot->sweep_steps, step = shot_sweep_step(conf, taken->shot, taken->sub);
    if (shot_is_short(conf, taken->shot, taken->sub))
        return;
    if (step == 0)
        lane->sweep_first = frame_ref(taken->frame);
    else if (step == (n - 1) / 2)
        lane->sweep_middle[0] = frame_ref(taken->frame);
    else if (step == n / 2)
        lane->sweep_middle[1] = frame_ref(taken->frame);
}

static gboolean is_brighter(const Frame *frame, const Frame *than, double margin_dn, gsize p) {
    return frame && frame->pixels[p] - than->pixels[p] > margin_dn;
}

/* Returns whether the last frame of a sweep shows the laser. For this frame, the laser is off and
 * points to the middle of the sweep. The laser counts as seen if:
 * - LASER_PIXELS pixels are brighter than their dark level,
 * - LASER_PIXELS pixels are brighter than in the first frame, because the laser may also have lit
 *   the dark frames,
 * - at least half of the pixels that the line lit in the middle of the sweep are still bright, and
 *   at least MIN_LASER_PIXELS of them. */
static gboolean is_laser_seen(const struct lane *lane, const Frame *last, const float *dark) {
    const double threshold_dn = lane->intake->setup.conf->laser_threshold_dn;
    const Frame *first = lane->sweep_first;
    const gsize n = (gsize)last->width * last->height;
    gint64 n_lit = 0, n_line = 0, n_still = 0;
    if (radiance_lit(last, dark, threshold_dn) >= LASER_PIXELS)
        return TRUE;
    for (gsize p = 0; p < n; p++) {
        const gboolean of_line = is_brighter(lane->sweep_middle[0], first, threshold_dn / 2, p) ||
                                 is_brighter(lane->sweep_middle[1], first, threshold_dn / 2, p);
        n_lit += is_brighter(last, first, threshold_dn, p);
        n_line += of_line;
        n_still += of_line && is_brighter(last, first, threshold_dn / 2, p);
    }
    return n_lit >= LASER_PIXELS || (n_still >= MIN_LASER_PIXELS && 2 * n_still >= n_line);
}

/* Takes n consecutive frames of a sweep. The last frame of a sweep, which is taken with the laser
 * off, is taken alone. */
static void take_sweep(struct lane *lane, struct job *const *jobs, int n) {
    const struct session_conf *conf = lane->intake->setup.conf;
    const struct taken_frame *first = &jobs[0]->taken;
    if (shot_sweep_step(conf, first->shot, first->sub) == first->shot->sweep_steps) {
        const struct intake_dark *dark = intake_darks_at(&lane->darks, 0, first->frame);
        lane->laser_seen = is_laser_seen(lane, first->frame, dark->pixels);
        return;
    }
    absorb(&lane->sweep, jobs, n, conf, FALSE);
    absorb(&lane->short_sweep, jobs, n, conf, TRUE);
    for (int i = 0; i < n; i++) {
        keep_for_end(lane, &jobs[i]->taken);
        if (conf->keep_laser_frames)
            keep_raw(lane, &jobs[i]->taken);
    }
}

/* Takes n consecutive frames of a sweep, or one frame of another shot. */
static void take(struct lane *lane, struct job *const *jobs, int n) {
    const struct session_conf *conf = lane->intake->setup.conf;
    const struct job *job = jobs[n - 1];
    const struct taken_frame *taken = &job->taken;
    if (lane->shot != taken->shot || lane->generation != job->generation)
        lane_reset(lane);
    lane->shot = taken->shot;
    lane->generation = job->generation;
    /* Frames must come in order, because the position of a frame in the shot is all that identifies
     * it. */
    g_return_if_fail(taken->sub == lane->n_frames + n - 1);
    lane->n_frames += n;
    gboolean last = lane->n_frames == shot_n_frames(conf, taken->shot);
    if (last && taken->shot->kind != SHOT_SWEEP) {
        /* Wait for the second thread, because the results of a camera must be returned in the order
         * of its shots. */
        g_mutex_lock(&lane->mutex);
        while (lane->n_complete > 0)
            g_cond_wait(&lane->finished, &lane->mutex);
        g_mutex_unlock(&lane->mutex);
    }
    if (conf->keep_exposures && taken->shot->kind != SHOT_SWEEP)
        keep_raw(lane, taken);
    switch (taken->shot->kind) {
    case SHOT_DARK:
        take_dark(lane, taken);
        if (last)
            finish_dark(lane, taken);
        break;
    case SHOT_LAMP:
        lane->bracket[taken->sub] = frame_ref(taken->frame);
        if (last)
            finish_lamp(lane, taken);
        break;
    case SHOT_SWEEP:
        take_sweep(lane, jobs, n);
        if (last)
            queue_sweep(lane, taken);
        break;
    }
    if (last)
        lane_reset(lane);
}

static gsize frame_bytes(const Frame *frame) {
    return (gsize)frame->width * frame->height * sizeof(guint16);
}

/* Returns the number of jobs at the front that are processed together because they are frames of
 * one sweep. Otherwise returns 1. */
static guint count_together(const struct lane *lane, struct job *const *jobs, guint most) {
    const struct session_conf *conf = lane->intake->setup.conf;
    const struct taken_frame *first = &jobs[0]->taken;
    guint n = 0;
    if (first->shot->kind == SHOT_SWEEP)
        while (n < most && n < BATCH && jobs[n]->taken.shot == first->shot &&
               jobs[n]->generation == jobs[0]->generation &&
               jobs[n]->taken.sub == first->sub + (int)n &&
               shot_sweep_step(conf, first->shot, jobs[n]->taken.sub) < first->shot->sweep_steps)
            n++;
    return MAX(n, 1);
}

static gpointer lane_run(gpointer data) {
    struct lane *lane = data;
    Intake *intake = lane->intake;
    setpriority(PRIO_PROCESS, 0, TAKE_NICE);
    gboolean running = TRUE;
    while (running) {
        g_autoptr(GPtrArray) batch = g_async_queue_pop(lane->queue);
        running = batch->len > 0;
        for (guint i = 0, n = 0; i < batch->len; i += n) {
            struct job *const *jobs = (struct job *const *)&batch->pdata[i];
            n = count_together(lane, jobs, batch->len - i);
            if (is_current(intake, jobs[0]->generation))
                take(lane, jobs, (int)n);
            for (guint k = 0; k < n; k++)
                add_bytes(intake, -(gssize)frame_bytes(jobs[k]->taken.frame));
        }
        if (running)
            end_step(intake);
    }
    lane_reset(lane);
    return NULL;
}

static void set_full(Intake *intake, gboolean full) {
    if (full == intake->full)
        return;
    g_atomic_int_set(&intake->full, full);
    if (full)
        clock_hold(intake->setup.devices->clock);
    else
        clock_release(intake->setup.devices->clock);
}

static gsize queued_bytes(Intake *intake) {
    return (gsize)g_atomic_pointer_get(&intake->bytes);
}

static gboolean dispatch(GSource *source, GSourceFunc func, gpointer data) {
    return func(data);
}

static gboolean on_wake(gpointer data) {
    Intake *intake = data;
    g_source_set_ready_time(intake->wake, -1);
    const int steps = g_atomic_int_get(&intake->steps_over);
    struct finished *finished;
    while ((finished = g_async_queue_try_pop(intake->finished))) {
        if (finished->generation == intake->generation)
            intake->hooks.result(&finished->result, intake->hooks.data);
        finished_free(finished);
    }
    if (intake->full && queued_bytes(intake) <= intake->setup.full_bytes / 2) {
        set_full(intake, FALSE);
        intake->hooks.room(intake->hooks.data);
    }
    release_steps(intake, steps);
    return G_SOURCE_CONTINUE;
}

static struct lane *lane_new(Intake *intake, int camera) {
    struct lane *lane = g_new0(struct lane, 1);
    lane->intake = intake;
    lane->camera = camera;
    lane->queue = g_async_queue_new();
    lane->batch = g_ptr_array_new_with_free_func(job_free);
    g_mutex_init(&lane->mutex);
    g_cond_init(&lane->finished);
    lane->finisher = g_thread_pool_new(finish_sweep, lane, 1, TRUE, NULL);
    lane->thread =
        g_thread_new(intake->setup.devices->geometry.cameras[camera].name, lane_run, lane);
    return lane;
}

static void lane_free(gpointer data) {
    struct lane *lane = data;
    g_async_queue_push(lane->queue, g_ptr_array_new());
    g_thread_join(lane->thread);
    g_thread_pool_free(lane->finisher, FALSE, TRUE);
    g_mutex_clear(&lane->mutex);
    g_cond_clear(&lane->finished);
    g_async_queue_unref(lane->queue);
    g_ptr_array_unref(lane->batch);
    intake_darks_clear(&lane->darks);
    g_free(lane);
}

Intake *intake_new(const struct intake_setup *setup, const struct intake_hooks *hooks) {
    static GSourceFuncs funcs = {.dispatch = dispatch};
    Intake *intake = g_new0(Intake, 1);
    intake->setup = *setup;
    if (setup->full_bytes == 0)
        intake->setup.full_bytes = FULL_BYTES;
    intake->hooks = *hooks;
    intake->finished = g_async_queue_new_full(finished_free);
    intake->wake = g_source_new(&funcs, sizeof(GSource));
    g_source_set_callback(intake->wake, on_wake, intake, NULL);
    g_source_attach(intake->wake, NULL);
    intake->lanes = g_ptr_array_new_with_free_func(lane_free);
    const struct rig *rig = &setup->devices->geometry;
    for (int c = 0; c < rig->n_cameras; c++)
        if (devices_is_unit(rig, c)) {
            g_ptr_array_add(intake->lanes, lane_new(intake, c));
            for (int k = c; k < rig->n_cameras && rig_camera_unit(rig, k) == c; k++)
                intake->lane_of[k] = (int)intake->lanes->len - 1;
        }
    return intake;
}

void intake_free(Intake *intake) {
    if (!intake)
        return;
    intake_discard(intake);
    g_ptr_array_unref(intake->lanes);
    g_source_destroy(intake->wake);
    g_source_unref(intake->wake);
    set_full(intake, FALSE);
    release_steps(intake, g_atomic_int_get(&intake->steps_over));
    g_async_queue_unref(intake->finished);
    g_free(intake);
}

static void flush(struct lane *lane) {
    if (lane->batch->len == 0)
        return;
    begin_step(lane->intake);
    g_async_queue_push(lane->queue, lane->batch);
    lane->batch = g_ptr_array_new_with_free_func(job_free);
}

void intake_take(Intake *intake, const struct taken_frame *taken) {
    struct lane *lane = intake->lanes->pdata[intake->lane_of[taken->row.camera]];
    struct job *job = g_new(struct job, 1);
    *job = (struct job){intake->generation, *taken};
    frame_ref(taken->frame);
    add_bytes(intake, (gssize)frame_bytes(taken->frame));
    g_ptr_array_add(lane->batch, job);
    gboolean last = taken->sub + 1 == shot_n_frames(intake->setup.conf, taken->shot);
    if (last || lane->batch->len >= BATCH)
        flush(lane);
    if (queued_bytes(intake) < intake->setup.full_bytes)
        return;
    /* While the intake is full, no frames come, and an incomplete batch would stay incomplete. All
     * batches are therefore given to the workers now. */
    for (guint i = 0; i < intake->lanes->len; i++)
        flush(intake->lanes->pdata[i]);
    set_full(intake, TRUE);
    g_source_set_ready_time(intake->wake, 0);
}

gboolean intake_is_full(const Intake *intake) {
    return intake->full;
}

void intake_discard(Intake *intake) {
    g_atomic_int_inc(&intake->generation);
    for (guint i = 0; i < intake->lanes->len; i++)
        flush(intake->lanes->pdata[i]);
}

gboolean intake_load_dark(Intake *intake, const struct session_shot *shot, int camera,
                          GError **error) {
    struct lane *lane = intake->lanes->pdata[intake->lane_of[camera]];
    const struct camera_format *format = &intake->setup.devices->cameras[camera]->format;
    const char *name = intake->setup.devices->geometry.cameras[camera].name;
    gint64 exposures[SHOT_MAX_DARKS];
    int n = shot_dark_exposures(intake->setup.conf, exposures);
    gsize n_pixels = (gsize)format->width * format->height;
    for (int i = 0; i < n; i++) {
        g_autofree float *pixels =
            intake_read_dark(intake->setup.directory, shot, name, format, exposures[i], error);
        if (!pixels)
            return FALSE;
        double sum = 0;
        for (gsize p = 0; p < n_pixels; p++)
            sum += pixels[p];
        intake_darks_set(&lane->darks, i, exposures[i], g_steal_pointer(&pixels), sum / n_pixels);
    }
    return TRUE;
}
