/* Views are tasks of a thread pool, which write their files. The calling thread owns the session,
 * distributes tasks, and writes the rows of finished products. */
#include "pipeline.h"

#include <errno.h>
#include <gio/gio.h>
#include <malloc.h>
#include <math.h>
#include <string.h>
#include <sys/resource.h>
#include <time.h>

#include "base/data_error.h"
#include "base/file_lock.h"
#include "base/new_file.h"
#include "catalogue.h"
#include "causes.h"
#include "course.h"
#include "eigenmaps_product.h"
#include "mdf_product.h"
#include "prediction_product.h"
#include "session/made_with.h"

#define POLL_US (G_USEC_PER_SEC / 2)
/* minimum time between two writes of the MDF while a capture is followed */
#define MDF_WRITE_US (30 * G_USEC_PER_SEC)

enum stage { STAGE_BTF = TIME_LEFT_BTF, STAGE_MDF = TIME_LEFT_MDF, N_STAGES = TIME_LEFT_STAGES };
static const char *const stage_names[] = {"btf", "mdf"};

/* A task of the thread pool: one view of one stage. */
struct task {
    struct run *run;
    enum stage stage;
    int view;
    char *path; /* path of the product */
    struct btf_view *btf;
    struct mdf_job *mdf;
    struct mdf_result *result;
    int number; /* index of the task in course_set_tasks() */
    GError *error;
};

struct run {
    Session *session;
    const struct pipeline_options *options;
    struct catalogue *catalogue;
    int n_views;
    gboolean *made[N_STAGES]; /* whether the product of each view of a stage is made */
    GHashTable *whole;        /* relative paths of intact products */
    /* number of products that were damaged or missing, of the kinds that the pipeline makes */
    int n_damaged;
    char *lock_path;         /* path of the lock file */
    int lock;                /* lock file, held while products are made */
    char **btf_inputs;       /* hash of the inputs of each view that is made */
    int *missing;            /* number of missing lights of each view in the BTF */
    struct mdf_result **mdf; /* MDF of each view that is made; NULL for other views */
    gboolean mdf_dirty;      /* whether the file of the MDF must be written */
    gint64 mdf_written_us, started_us;
    int made_now[N_STAGES];
    int settled; /* number of views of the MDF whose D and P are set from all views */
    gboolean eigenmaps_made;
    Course *course;
    GCancellable *cancellable; /* cancelled by the user or on the first error */
    GAsyncQueue *finished;     /* of struct task: tasks that have ended and are not stored yet */
};

static char *btf_relative(int view) {
    return g_strdup_printf("products/btf/view_%04d.exr", view);
}

static void task_free(struct task *task) {
    g_free(task->path);
    btf_view_free(task->btf);
    mdf_job_free(task->mdf);
    mdf_result_free(task->result);
    g_clear_error(&task->error);
    g_free(task);
}

static void pipeline_work(gpointer data, gpointer unused) {
    struct task *task = data;
    struct run *run = task->run;
    course_task_begin(run->course, task->number);
    if (g_cancellable_set_error_if_cancelled(run->cancellable, &task->error)) {
        /* returned unchanged */
    } else if (task->stage == STAGE_BTF)
        btf_make_view(task->btf, task->path, run->cancellable, &task->error);
    else
        task->result =
            mdf_make_view(task->mdf, &run->catalogue->grid, run->cancellable, &task->error);
    course_task_end(run->course, task->number);
    g_async_queue_push(run->finished, task);
}

static void report(struct run *run, const char *name, int done, int total, double left_s) {
    struct work_progress progress = {name, done, total, left_s};
    if (run->options->work.progress)
        run->options->work.progress(&progress, run->options->work.data);
}

static int count_made(const struct run *run, enum stage stage) {
    int n = 0;
    for (int i = 0; i < run->n_views; i++)
        n += run->made[stage][i];
    return n;
}

/* Stores a finished task. Runs in the calling thread, which owns the session. */
static gboolean pipeline_accept(struct run *run, struct task *task, GError **error) {
    if (task->error) {
        g_propagate_error(error, g_steal_pointer(&task->error));
        return FALSE;
    }
    run->made[task->stage][task->view] = TRUE;
    run->made_now[task->stage]++;
    if (task->stage == STAGE_MDF) {
        mdf_result_free(run->mdf[task->view]);
        run->mdf[task->view] = g_steal_pointer(&task->result);
        run->mdf_dirty = TRUE;
        return TRUE;
    }
    g_autofree char *relative = btf_relative(task->btf->index);
    run->btf_inputs[task->view] = g_strdup(task->btf->inputs);
    return session_add_product(run->session, relative, task->btf->inputs, error);
}

/* Returns whether the product exists, is intact and was made from these inputs. */
static gboolean is_made(struct run *run, const struct task *task) {
    if (task->stage == STAGE_MDF)
        return run->mdf[task->view] && strcmp(run->mdf[task->view]->inputs, task->mdf->inputs) == 0;
    // NOLINTNEXTLINE(clang-analyzer-core.NullDereference): a task is of one stage or the other
    g_autofree char *relative = btf_relative(task->btf->index);
    if (!g_hash_table_contains(run->whole, relative) || !btf_is_made(task->btf, task->path))
        return FALSE;
    run->btf_inputs[task->view] = g_strdup(task->btf->inputs);
    return TRUE;
}

/* Returns the task of a view, or NULL if the view is not ready or its product is made. To know
 * this, compares the hash of the view's inputs with that of the product. */
static struct task *next_task(struct run *run, enum stage stage, int view) {
    if (run->made[stage][view])
        return NULL;
    struct task *task = g_new0(struct task, 1);
    *task = (struct task){.run = run, .stage = stage, .view = view};
    enum catalogue_state state = stage == STAGE_BTF
                                     ? catalogue_btf(run->catalogue, view, &task->btf)
                                     : catalogue_mdf(run->catalogue, view, &task->mdf);
    if (task->btf) {
        g_autofree char *relative = btf_relative(task->btf->index);
        task->path = session_file(run->session, relative);
        run->missing[view] = task->btf->n_missing;
    }
    if (state == CATALOGUE_READY && !is_made(run, task))
        return task;
    run->made[stage][view] = state == CATALOGUE_READY;
    task_free(task);
    return NULL;
}

/* Cancels all tasks that still run. If several tasks fail, keeps the error of the first stage and
 * view, and frees the others. The errors of cancelled tasks are ignored. */
static void note_error(struct run *run, const struct task *task, GError *found, int *worst,
                       GError **first) {
    gboolean cancelled = g_error_matches(found, G_IO_ERROR, G_IO_ERROR_CANCELLED);
    const int order = task->stage * run->n_views + task->view;
    if (*first && (cancelled || order > *worst)) {
        g_error_free(found);
        return;
    }
    g_clear_error(first);
    *first = found;
    *worst = cancelled ? G_MAXINT : order;
    g_cancellable_cancel(run->cancellable);
}

static enum catalogue_state pipeline_state(const struct run *run, enum stage stage, int view) {
    return stage == STAGE_BTF ? catalogue_btf(run->catalogue, view, NULL)
                              : catalogue_mdf(run->catalogue, view, NULL);
}

/* Counts the views that a stage can make. Views whose frames the plan leaves out are not counted.
 * After the capture has ended, views whose frames are missing are not counted either. */
static int count_possible(const struct run *run, enum stage stage, gboolean ended) {
    int n = 0;
    for (int view = 0; view < run->n_views; view++) {
        const enum catalogue_state state = pipeline_state(run, stage, view);
        n += state == CATALOGUE_READY || (state == CATALOGUE_WAITING && !ended);
    }
    return n;
}

static int threads(const struct run *run) {
    return run->options->work.n_threads > 0 ? run->options->work.n_threads
                                            : (int)g_get_num_processors();
}

static double megatexels(const struct run *run) {
    return (double)run->catalogue->grid.width * run->catalogue->grid.height / 1e6;
}

/* Returns the cost of a view, from which the time left is computed. The unit is a million pixels of
 * the view's frames or sweeps. */
static struct time_left_task pipeline_cost(const struct run *run, enum stage stage, int view) {
    const struct catalogue *catalogue = run->catalogue;
    const struct session_direction *direction = g_ptr_array_index(catalogue->views, view);
    const struct rig_camera *camera = &catalogue->rig.cameras[direction->device];
    const guint frames = stage == STAGE_BTF ? catalogue->lights->len : catalogue->lasers->len;
    return (struct time_left_task){.stage = (enum time_left_work)stage,
                                   .theta_deg = direction->theta_deg,
                                   .units = (double)camera->width * camera->height * frames / 1e6};
}

/* Appends the tasks of all views that are ready to `ready`, with their costs. Views whose frames
 * are not taken yet are also included in the time left. */
static void list_views(struct run *run, const int *possible, gboolean ended, GQueue *ready) {
    g_autoptr(GArray) costs = g_array_new(FALSE, FALSE, sizeof(struct time_left_task));
    const double n[N_STAGES] = {possible[STAGE_BTF], possible[STAGE_MDF]};
    gboolean any[N_STAGES] = {FALSE, FALSE};
    for (int k = 0; k < run->n_views; k++)
        for (int stage = 0; stage < N_STAGES; stage++) {
            const int view = time_left_view(k, run->n_views);
            const struct time_left_task cost = pipeline_cost(run, stage, view);
            struct task *task = next_task(run, stage, view);
            if (task) {
                task->number = (int)costs->len;
                any[stage] = TRUE;
                g_queue_push_tail(ready, task);
            }
            if (task || (!ended && pipeline_state(run, stage, view) == CATALOGUE_WAITING))
                g_array_append_val(costs, cost);
        }
    course_set_tasks(run->course, (gpointer)costs->data, (int)costs->len);
    if (any[STAGE_MDF]) {
        course_expect(run->course, TIME_LEFT_SETTLE, megatexels(run) * n[STAGE_MDF] * n[STAGE_MDF]);
        course_expect(run->course, TIME_LEFT_MDF_FILE, megatexels(run) * n[STAGE_MDF]);
    }
    if (any[STAGE_BTF] && run->options->n_eigenmaps > 0) {
        const double units = megatexels(run) * n[STAGE_BTF] * run->catalogue->lights->len;
        course_expect(run->course, TIME_LEFT_COLUMNS, units);
        course_expect(run->course, TIME_LEFT_FACTORS, units);
    }
    if (run->options->causes)
        course_expect(run->course, TIME_LEFT_CAUSES, n[STAGE_BTF]);
}

/* Reports one stage after the other, because this is easier to read than both at a time. told has
 * the number of views of each stage at its last report. */
static void tell_stages(struct run *run, const int *possible, int *told) {
    const double left_s = course_left_s(run->course);
    for (int stage = 0; stage < N_STAGES; stage++) {
        const int done = count_made(run, stage);
        const gboolean whole = done == possible[stage];
        if (possible[stage] > 0 && (!whole || told[stage] != done))
            report(run, stage_names[stage], done, possible[stage], left_s);
        told[stage] = done;
        if (!whole)
            break;
    }
}

/* Makes all views that are ready. Tasks of BTF and MDF alternate, so that the first ones show how
 * long both stages will take. ended means that no further frames will come. */
static gboolean run_stages(struct run *run, gboolean ended, GError **error) {
    GThreadPool *pool = g_thread_pool_new(pipeline_work, NULL, threads(run), FALSE, error);
    if (!pool)
        return FALSE;
    int possible[N_STAGES], told[N_STAGES];
    for (int stage = 0; stage < N_STAGES; stage++) {
        possible[stage] = count_possible(run, stage, ended);
        told[stage] = -1;
    }
    int worst = G_MAXINT;
    GError *first = NULL;
    GQueue ready = G_QUEUE_INIT;
    list_views(run, possible, ended, &ready);
    /* With one thread, a view is begun only after the row of the previous view was written. Files
     * and rows are then always written in the same order. */
    const guint most = threads(run) == 1 ? 1 : ready.length;
    guint under_way = 0;
    while (under_way + ready.length > 0) {
        for (; under_way < most && ready.length > 0; under_way++)
            g_thread_pool_push(pool, g_queue_pop_head(&ready), NULL);
        struct task *task = g_async_queue_timeout_pop(run->finished, POLL_US);
        GError *found = NULL;
        if (task) {
            under_way--;
            if (!pipeline_accept(run, task, &found))
                note_error(run, task, found, &worst, &first);
            task_free(task);
        }
        tell_stages(run, possible, told);
    }
    g_thread_pool_free(pool, FALSE, TRUE);
    if (first)
        g_propagate_error(error, first);
    return first == NULL;
}

static gboolean write_mdf(struct run *run, GError **error) {
    g_autofree char *path = session_file(run->session, "products/mdf.exr");
    if (!mdf_write(path, run->mdf, run->n_views, &run->catalogue->grid, error) ||
        !session_add_product(run->session, "products/mdf.exr", "sweeps", error))
        return FALSE;
    run->mdf_dirty = FALSE;
    run->mdf_written_us = g_get_monotonic_time();
    return TRUE;
}

static void on_settled(gpointer data) {
    struct run *run = data;
    const int done = count_made(run, STAGE_MDF);
    course_advance(run->course, (double)++run->settled / MAX(done, 1));
    report(run, stage_names[STAGE_MDF], done, done, course_left_s(run->course));
}

static gboolean settle(struct run *run, GError **error) {
    course_begin(run->course, TIME_LEFT_SETTLE);
    run->mdf_dirty |= mdf_settle(run->mdf, run->n_views, &run->catalogue->grid, run->cancellable,
                                 on_settled, run);
    course_end(run->course, TIME_LEFT_SETTLE, !g_cancellable_is_cancelled(run->cancellable));
    course_begin(run->course, TIME_LEFT_MDF_FILE);
    const gboolean ok = !run->mdf_dirty || write_mdf(run, error);
    course_end(run->course, TIME_LEFT_MDF_FILE, ok);
    return ok;
}

static int count_waiting(const struct run *run) {
    int n = 0;
    for (int view = 0; view < run->n_views; view++)
        n += pipeline_state(run, STAGE_BTF, view) == CATALOGUE_WAITING ||
             pipeline_state(run, STAGE_MDF, view) == CATALOGUE_WAITING;
    return n;
}

/* Makes ready views until no more frames will come. In each round, the state of the capture is read
 * before the frames are looked up. If it were read afterwards, the last frames could be missed. */
static gboolean make_views(struct run *run, GError **error) {
    for (;;) {
        g_autofree char *state = session_value(run->session, "state");
        gboolean ended = !run->options->follow || g_strcmp0(state, "done") == 0 ||
                         g_strcmp0(state, "aborted") == 0;
        if (!catalogue_refresh(run->catalogue, run->session, error) ||
            !run_stages(run, ended, error))
            return FALSE;
        ended |= count_waiting(run) == 0;
        /* Views of an earlier run whose frames no longer exist are dropped. */
        for (int view = 0; view < run->n_views; view++)
            if (run->mdf[view] && !run->made[STAGE_MDF][view]) {
                g_clear_pointer(&run->mdf[view], mdf_result_free);
                run->mdf_dirty = TRUE;
            }
        gint64 since_us = g_get_monotonic_time() - run->mdf_written_us;
        if (ended)
            return settle(run, error);
        if (run->mdf_dirty && since_us > MDF_WRITE_US && !write_mdf(run, error))
            return FALSE;
        for (int i = 0; i < 10; i++) {
            if (g_cancellable_set_error_if_cancelled(run->cancellable, error))
                return FALSE;
            g_usleep(POLL_US / 10);
        }
    }
}

struct columns {
    struct run *run;
    int *views; /* indices into catalogue->views of the views whose BTF is made */
    int n_views;
    int *lights; /* index of each light of the session */
    int n_lights;
    /* Numbers of calls of get_column().
     * asked: calls so far
     * to_ask: calls in total; an estimate if there are several passes */
    int asked, to_ask;
};

static gboolean get_column(int view, float *ret_column, gpointer data, GError **error) {
    struct columns *columns = data;
    struct run *run = columns->run;
    if (g_cancellable_set_error_if_cancelled(run->cancellable, error))
        return FALSE;
    const struct session_direction *direction =
        g_ptr_array_index(run->catalogue->views, columns->views[view]);
    g_autofree char *relative = btf_relative(direction->index);
    g_autofree char *path = session_file(run->session, relative);
    course_advance(run->course, (double)columns->asked / columns->to_ask);
    columns->asked++;
    report(run, "eigenmaps", MIN(columns->asked, columns->n_views), columns->n_views,
           course_left_s(run->course));
    const gboolean ok =
        btf_read_view(path, columns->lights, columns->n_lights, &run->catalogue->grid,
                      run->options->work.n_threads, ret_column, error);
    if (columns->asked == columns->to_ask) {
        course_end(run->course, TIME_LEFT_COLUMNS, ok);
        course_begin(run->course, TIME_LEFT_FACTORS);
    }
    return ok;
}

static gboolean set_number(Session *session, const char *key, double value, GError **error) {
    char text[G_ASCII_DTOSTR_BUF_SIZE];
    return session_set_value(session, key, g_ascii_dtostr(text, sizeof text, value), error);
}

static gboolean make_eigenmaps(struct columns *columns, double *ret_error, GError **error) {
    const struct run *run = columns->run;
    Session *session = run->session;
    g_autofree char *path = session_file(session, "products/eigenmaps.exr");
    g_autoptr(GChecksum) sum = catalogue_checksum(run->catalogue, "eigenmaps");
    input_hash(sum, "%d %s", run->options->n_eigenmaps, session_name(session));
    for (int i = 0; i < columns->n_views; i++)
        input_hash(sum, "%s", run->btf_inputs[columns->views[i]]);
    const char *inputs = g_checksum_get_string(sum);
    g_autofree char *before = session_value(session, "eigenmaps_inputs");
    g_autofree char *error_before = session_value(session, "eigenmaps_error");
    const gboolean whole = g_hash_table_contains(columns->run->whole, "products/eigenmaps.exr");
    if (whole && before && error_before && strcmp(before, inputs) == 0) {
        *ret_error = g_ascii_strtod(error_before, NULL);
        return TRUE;
    }
    columns->run->eigenmaps_made = TRUE;
    g_autofree char *lock_path = g_strconcat(path, ".lock", NULL);
    const int lock =
        /* "mesorig compress -o" may write the same file at the same time */
        file_lock_take(lock_path, path, error);
    if (lock < 0)
        return FALSE;
    new_file_remove_left(session_path(session), "products", "eigenmaps.exr.");
    struct eigenmaps *maps =
        eigenmaps_product_new(session_name(session), run->catalogue, columns->views,
                              columns->n_views, MIN(run->options->n_eigenmaps, columns->n_views));
    course_begin(columns->run->course, TIME_LEFT_COLUMNS);
    gboolean ok = eigenmaps_compute(maps, get_column, columns, ret_error, error);
    if (ok)
        *ret_error = eigenmaps_rounded_error(maps, *ret_error);
    ok = ok && eigenmaps_write(path, maps, error) &&
         session_add_product(session, "products/eigenmaps.exr", inputs, error) &&
         set_number(session, "eigenmaps_error", *ret_error, error) &&
         session_set_value(session, "eigenmaps_inputs", inputs, error);
    if (columns->asked < columns->to_ask) /* there were fewer passes than expected */
        course_end(columns->run->course, TIME_LEFT_COLUMNS, FALSE);
    course_end(columns->run->course, TIME_LEFT_FACTORS, ok && columns->asked >= columns->to_ask);
    eigenmaps_free(maps);
    file_lock_give(lock, lock_path);
    return ok;
}

/* Predicts the pictures that were left out on purpose. The prediction uses the captured pictures of
 * all views. */
static gboolean predict(struct run *run, struct pipeline_result *ret, GError **error) {
    struct work work = run->options->work;
    struct prediction_product product;
    g_autofree int *views = g_new(int, run->n_views);
    int n = 0;
    work.cancellable = run->cancellable;
    ret->prediction_error = NAN;
    for (int view = 0; view < run->n_views; view++)
        if (run->made[STAGE_BTF][view])
            views[n++] = view;
    if (!prediction_product_make(run->session, run->catalogue, views, n, &work, &product, error)) {
        prediction_product_clear(&product);
        return FALSE;
    }
    ret->n_left_out = product.n_left_out;
    ret->n_used = product.n_used;
    if (product.inputs) {
        struct prediction_known known;
        prediction_product_read(run->session, &known);
        ret->prediction_error = known.error;
    }
    for (int k = 0; product.inputs && k < n; k++) {
        char **inputs = &run->btf_inputs[views[k]];
        char *both = g_strconcat(*inputs, " ", product.inputs, NULL);
        g_free(*inputs);
        *inputs = both;
    }
    prediction_product_clear(&product);
    return TRUE;
}

static gboolean run_eigenmaps(struct run *run, struct pipeline_result *ret, GError **error) {
    int n_lights = (int)run->catalogue->lights->len;
    ret->n_views = count_made(run, STAGE_BTF);
    ret->n_lights = ret->n_views > 0 ? n_lights : 0;
    ret->n_predicted = 0;
    for (int view = 0; view < run->n_views; view++)
        ret->n_predicted += run->missing[view];
    int waiting = 0; /* number of views that still lack pictures which the plan has */
    for (int view = 0; view < run->n_views; view++)
        waiting += pipeline_state(run, STAGE_BTF, view) == CATALOGUE_WAITING;
    if (n_lights > 0 && ret->n_views == 0 && waiting > 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: the capture ended before any view had its pictures under all lights; "
                    "`mesorig resume %s` takes the rest",
                    session_path(run->session), session_path(run->session));
        return FALSE;
    }
    if (n_lights > 0 && ret->n_views == 0) {
        g_set_error(error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
                    "%s: the plan leaves out more than %g %% of each view's pictures under the %d "
                    "lights, so that no BTF can be made; plan a capture with more pictures",
                    session_path(run->session), 100 * BTF_MAX_MISSING, n_lights);
        return FALSE;
    }
    if (!predict(run, ret, error))
        return FALSE;
    if (ret->n_views == 0 || run->options->n_eigenmaps < 1)
        return TRUE;
    /* without this call, memory that the threads freed would stay in their arenas */
    malloc_trim(0);
    g_autofree int *views = g_new(int, ret->n_views), *lights = g_new(int, n_lights);
    struct columns columns = {.run = run, .views = views, .lights = lights, .n_lights = n_lights};
    for (int view = 0; view < run->n_views; view++)
        if (run->made[STAGE_BTF][view])
            views[columns.n_views++] = view;
    const gsize bytes = (gsize)columns.n_views * (gsize)n_lights *
                        (gsize)run->catalogue->grid.width * (gsize)run->catalogue->grid.height * 3 *
                        sizeof(float);
    columns.to_ask = columns.n_views * (bytes <= EIGENMAPS_MEMORY ? 1 : 2);
    for (int i = 0; i < n_lights; i++)
        lights[i] =
            ((const struct session_direction *)g_ptr_array_index(run->catalogue->lights, i))->index;
    return make_eigenmaps(&columns, &ret->eigenmaps_error, error);
}

static gboolean finish(struct run *run, struct pipeline_result *ret, GError **error) {
    struct mdf_lines all = {.worst_position = -1};
    for (int i = 0; i < run->n_views; i++)
        if (run->mdf[i])
            mdf_lines_add(&all, &run->mdf[i]->lines);
    ret->line_sweeps = all.sweeps;
    ret->lines_found = all.found;
    ret->lines_disagree = all.disagree;
    ret->line_worst_position = all.worst_position;
    ret->lines_worst_deg = all.worst_deg;
    ret->lines_rms_deg = sqrt(all.squares_deg2 / MAX(all.found, 1));
    ret->line_width = all.width;
    ret->line_scatter = all.scatter;
    ret->n_damaged = run->n_damaged;
    ret->n_mdf_views = count_made(run, STAGE_MDF);
    ret->mdf_coverage =
        mdf_coverage(run->mdf, run->n_views,
                     run->catalogue->grid.width * run->catalogue->grid.height, &ret->mdf_predicted);
    if (!set_number(run->session, "mdf_coverage", ret->mdf_coverage, error) ||
        !made_with_end(run->session, error))
        return FALSE;
    if (!run->made_now[STAGE_BTF] && !run->made_now[STAGE_MDF] && !run->eigenmaps_made)
        return TRUE; /* nothing was made, so the costs of the earlier run stay stored */
    struct rusage usage;
    getrusage(RUSAGE_SELF, &usage);
    double spent_s = (double)(g_get_monotonic_time() - run->started_us) / 1e6;
    return set_number(run->session, "processing_s", spent_s, error) &&
           set_number(run->session, "processing_peak_memory_mib", (double)usage.ru_maxrss / 1024,
                      error);
}

static gboolean make_folders(struct run *run, GError **error) {
    const char *directory = session_path(run->session);
    g_autofree char *path = session_file(run->session, "products/btf");
    run->lock_path = session_file(run->session, SESSION_PROCESS_LOCK);
    if (g_mkdir_with_parents(path, 0777) != 0) {
        int code = errno;
        g_set_error(
            error, G_IO_ERROR, (gint)g_io_error_from_errno(code),
            "%s: the folder cannot be made: %s; make the session writable or free some space", path,
            g_strerror(code));
        return FALSE;
    }
    run->lock = file_lock_take(run->lock_path, "the products of this session", error);
    if (run->lock < 0)
        return FALSE;
    new_file_remove_left(directory, "products/btf", "");
    new_file_remove_left(directory, "products", "mdf.exr.");
    return TRUE;
}

/* Finds the products of an earlier run that are unchanged (run->whole). Other products of that run
 * are not used. */
static gboolean find_whole(struct run *run, GError **error) {
    struct work work = run->options->work;
    work.cancellable = run->cancellable;
    run->whole = session_products(run->session, error);
    g_autoptr(GPtrArray) damages =
        run->whole
            ? session_find_damage(run->session, SESSION_PRODUCTS_MADE, "", &work, NULL, error)
            : NULL;
    for (guint i = 0; damages && i < damages->len; i++) {
        const struct session_damage *damage = g_ptr_array_index(damages, i);
        run->n_damaged += g_str_has_prefix(damage->path, "products/btf/") ||
                          g_str_equal(damage->path, "products/mdf.exr") ||
                          g_str_equal(damage->path, "products/eigenmaps.exr");
        g_hash_table_remove(run->whole, damage->path);
    }
    return damages != NULL;
}

static gboolean begin(struct run *run, GError **error) {
    run->catalogue = catalogue_load(run->session, run->options->calibration, error);
    if (!run->catalogue)
        return FALSE;
    run->catalogue->lines_in_pictures = run->options->lines_in_pictures;
    run->catalogue->plain_merge = run->options->plain_merge;
    run->n_views = (int)run->catalogue->views->len;
    for (int stage = 0; stage < N_STAGES; stage++)
        run->made[stage] = g_new0(gboolean, run->n_views);
    run->btf_inputs = g_new0(char *, run->n_views + 1);
    run->missing = g_new0(int, run->n_views);
    run->mdf = g_new0(struct mdf_result *, run->n_views);
    /* Without --follow, missing frames are an error. Only those that the plan leaves out may be
     * missing. */
    const int waiting = run->options->follow ? 0 : count_waiting(run);
    if (waiting > 0) {
        g_set_error(
            error, DATA_ERROR, DATA_ERROR_INCOMPLETE,
            "%s: %d of %d views lack some of their frames, because %d of %u shots are still "
            "to be taken; `mesorig resume %s` takes them. With --follow, processing waits "
            "for these shots or, if the capture was aborted, leaves these views out",
            session_path(run->session), waiting, run->n_views, catalogue_planned(run->catalogue),
            run->catalogue->shots->len, session_path(run->session));
        return FALSE;
    }
    if (!make_folders(run, error) || !find_whole(run, error) ||
        !made_with_begin(run->session, run->options->calibration_path, run->options->calibration,
                         error))
        return FALSE;
    g_autofree char *path = session_file(run->session, "products/mdf.exr");
    if (g_hash_table_contains(run->whole, "products/mdf.exr"))
        run->mdf_dirty = mdf_read(path, run->catalogue, run->mdf);
    run->mdf_written_us = g_get_monotonic_time();
    return TRUE;
}

/* Finds causes in all products of the session, including products of an earlier run. */
static gboolean find_causes(struct run *run, const struct pipeline_result *result, GError **error) {
    const struct pipeline_options *options = run->options;
    if (!options->causes)
        return TRUE;
    course_begin(run->course, TIME_LEFT_CAUSES);
    const gboolean ok =
        causes_find(session_path(run->session), options->calibration, result->n_views > 0,
                    result->n_mdf_views > 0 ? result->mdf_coverage : 1, options->causes, error);
    course_end(run->course, TIME_LEFT_CAUSES, ok);
    return ok;
}

static void end(struct run *run) {
    for (int i = 0; i < run->n_views; i++) {
        g_free(run->btf_inputs[i]);
        mdf_result_free(run->mdf[i]);
    }
    for (int stage = 0; stage < N_STAGES; stage++)
        g_free(run->made[stage]);
    g_free(run->btf_inputs);
    g_free(run->missing);
    g_clear_pointer(&run->whole, g_hash_table_unref);
    file_lock_give(run->lock, run->lock_path);
    g_free(run->lock_path);
    g_free(run->mdf);
    catalogue_free(run->catalogue);
    session_close(run->session);
    g_async_queue_unref(run->finished);
    course_free(run->course);
    g_object_unref(run->cancellable);
}

static void forward_cancel(GCancellable *user, gpointer own) {
    g_cancellable_cancel(own);
}

/* Makes the views of BTF and MDF, then D and P of the MDF, the predicted pictures and the
 * eigen-maps. */
gboolean pipeline_run(const char *session_path, const struct pipeline_options *options,
                      struct pipeline_result *ret, GError **error) {
    g_autoptr(GError) found = NULL;
    *ret = (struct pipeline_result){0};
    struct run run = {.options = options, .started_us = g_get_monotonic_time(), .lock = -1};
    run.session = session_open(session_path, SESSION_PRODUCTS, error);
    if (!run.session)
        return FALSE;
    run.cancellable = g_cancellable_new();
    run.course = course_new(threads(&run));
    run.finished = g_async_queue_new();
    gulong forward = 0;
    if (options->work.cancellable)
        forward = g_cancellable_connect(options->work.cancellable, G_CALLBACK(forward_cancel),
                                        run.cancellable, NULL);
    gboolean ok = begin(&run, &found) && make_views(&run, &found) &&
                  run_eigenmaps(&run, ret, &found) && finish(&run, ret, &found) &&
                  find_causes(&run, ret, &found);
    /* A damaged frame may have been the cause of an error. All damaged frames are recorded, so that
     * one resume takes all of them again. The first error is reported, not those that occur
     * here. */
    g_autoptr(GPtrArray) damages =
        g_error_matches(found, DATA_ERROR, DATA_ERROR_INVALID)
            ? session_find_damage(run.session, SESSION_FRAMES, "", &options->work, NULL, NULL)
            : NULL;
    for (guint i = 0; damages && i < damages->len; i++) {
        const struct session_damage *damage = g_ptr_array_index(damages, i);
        session_note_damage(run.session, damage->path, damage->what, NULL);
    }
    if (options->work.cancellable)
        g_cancellable_disconnect(options->work.cancellable, forward);
    end(&run);
    if (!ok)
        g_propagate_error(error, g_steal_pointer(&found));
    return ok;
}
