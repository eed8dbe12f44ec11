#include "bus.h"

#include "address.h"
#include "line.h"

#include <string.h>

/* Time that a recovery of the line may take in addition to the limit of the job. */
#define EXTRA_WAIT_US (6 * G_USEC_PER_SEC)

struct task {
    gint ref_count;
    struct modbus_job job;
    int unit;
    enum modbus_turn turn;
    gint64 limit_us; /* time limit, counted from the moment when the line is free for the task */
    gint cancelled;  /* atomic */
    GError *error;
    ModbusFunc func; /* used only by the main loop's thread; NULL after it was cancelled */
    gpointer data;
    gboolean waited, done; /* for modbus_bus_do(); guarded by the mutex of the bus */
};

#define MAX_UNIT 247

struct ModbusBus {
    int ref_count;
    struct modbus_link link; /* a copy */
    char *key;               /* as modbus_address_name() returns it */
    /* TCP only: maps the number of a unit to its locks. They are kept until all sections on the
     * line are closed. */
    GHashTable *units;
    GThread *thread;
    GMutex mutex; /* guards the fields down to source */
    GCond work, finished;
    GQueue queues[3], results; /* of struct task; there is one queue for each enum modbus_turn */
    gint n_urgent;             /* atomic: the length of the queue of urgent tasks */
    gboolean quit;
    struct modbus_counts counts;
    GSource *source;
    GList *waiting;              /* used only by the main loop's thread: tasks with a callback */
    struct modbus_line *line;    /* line and dead are used only by the line's thread */
    gboolean dead[MAX_UNIT + 1]; /* units that have not answered their last task */
};

struct bus_source {
    GSource base;
    ModbusBus *bus;
};

static GHashTable *buses; /* maps a key to a ModbusBus */

static void task_unref(gpointer data) {
    struct task *task = data;
    if (!g_atomic_int_dec_and_test(&task->ref_count))
        return;
    g_clear_error(&task->error);
    g_free(task);
}

static struct task *next_task(ModbusBus *bus) {
    struct task *task = g_queue_pop_head(&bus->queues[MODBUS_URGENT]);
    if (task)
        g_atomic_int_add(&bus->n_urgent, -1);
    else if (!(task = g_queue_pop_head(&bus->queues[MODBUS_COMMAND])))
        task = g_queue_pop_head(&bus->queues[MODBUS_POLL]);
    return task;
}

static gboolean is_silence(const GError *error) {
    return g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_TIMEOUT) ||
           g_error_matches(error, DEVICE_ERROR, DEVICE_ERROR_DISCONNECTED);
}

/* Carries out a task. Returns FALSE for a poll that was interrupted by an urgent task and has to be
 * repeated. */
static gboolean carry_out(ModbusBus *bus, struct task *task) {
    const struct modbus_job job = task->job;
    const gint64 deadline_us = g_get_monotonic_time() + task->limit_us;
    const gboolean yields = task->turn == MODBUS_POLL;
    const gboolean once = task->turn == MODBUS_URGENT && bus->dead[task->unit] && !task->waited;
    modbus_line_set_effort(bus->line,
                           once     ? MODBUS_ONCE
                           : yields ? MODBUS_YIELD
                                    : MODBUS_REPEAT,
                           yields ? &bus->n_urgent : NULL);
    for (int i = 0; i < task->job.n && !task->error; i++)
        modbus_line_do(bus->line, task->unit, &task->job.requests[i], deadline_us, &task->error);
    bus->dead[task->unit] = is_silence(task->error);
    if (!yields || !task->error || g_atomic_int_get(&bus->n_urgent) == 0 ||
        g_get_monotonic_time() >= deadline_us)
        return TRUE;
    g_clear_error(&task->error);
    task->job = job;
    return FALSE;
}

static gpointer bus_run(gpointer data) {
    ModbusBus *bus = data;
    g_mutex_lock(&bus->mutex);
    for (;;) {
        struct task *task = next_task(bus);
        if (!task && bus->quit)
            break;
        if (!task) {
            g_cond_wait(&bus->work, &bus->mutex);
            continue;
        }
        g_mutex_unlock(&bus->mutex);
        const gboolean ended = g_atomic_int_get(&task->cancelled) || carry_out(bus, task);
        g_mutex_lock(&bus->mutex);
        modbus_line_counts(bus->line, &bus->counts);
        if (!ended) {
            g_queue_push_head(&bus->queues[MODBUS_POLL], task);
            continue;
        }
        task->done = TRUE;
        if (task->waited) {
            g_cond_broadcast(&bus->finished);
            task_unref(task);
            continue;
        }
        g_queue_push_tail(&bus->results, task);
        g_source_set_ready_time(bus->source, 0);
    }
    g_mutex_unlock(&bus->mutex);
    return NULL;
}

/* Delivers one result in each iteration of the main loop. A source is always dispatched in the main
 * loop's thread. g_main_context_invoke() from another thread does not guarantee that. */
static gboolean bus_dispatch(GSource *source, GSourceFunc unused, gpointer unused_data) {
    ModbusBus *bus = ((struct bus_source *)source)->bus;
    g_mutex_lock(&bus->mutex);
    struct task *task = g_queue_pop_head(&bus->results);
    if (!task)
        g_source_set_ready_time(source, -1);
    g_mutex_unlock(&bus->mutex);
    if (!task)
        return G_SOURCE_CONTINUE;
    bus->waiting = g_list_remove(bus->waiting, task);
    if (task->func) /* func may free the bus */
        task->func(&task->job, task->error, task->data);
    task_unref(task);
    return G_SOURCE_CONTINUE;
}

static GSourceFuncs source_funcs = {.dispatch = bus_dispatch};

static void modbus_bus_free(ModbusBus *bus) {
    struct task *task;
    while ((task = g_queue_pop_head(&bus->results)))
        task_unref(task);
    g_list_free(bus->waiting);
    modbus_line_free(bus->line);
    g_hash_table_unref(bus->units);
    g_mutex_clear(&bus->mutex);
    g_cond_clear(&bus->work);
    g_cond_clear(&bus->finished);
    g_free(bus->link.bus);
    g_free(bus->key);
    g_free(bus);
}

/* Takes the locks of a unit if the bus is TCP and does not hold them yet. Sections with the same
 * unit share them. Returns FALSE with an error if that fails. */
static gboolean lock_unit(ModbusBus *bus, int unit, GError **error) {
    if (!modbus_is_tcp(bus->link.bus) || g_hash_table_contains(bus->units, GINT_TO_POINTER(unit)))
        return TRUE;
    GPtrArray *locks = modbus_address_lock_unit(bus->link.bus, unit, error);
    if (locks)
        g_hash_table_insert(bus->units, GINT_TO_POINTER(unit), locks);
    return locks != NULL;
}

static void free_locks(gpointer locks) {
    g_ptr_array_unref(locks);
}

static ModbusBus *modbus_bus_new(const struct modbus_link *link, const char *key, GError **error) {
    ModbusBus *bus = g_new0(ModbusBus, 1);
    bus->ref_count = 1;
    bus->key = g_strdup(key);
    bus->link = *link;
    bus->link.bus = g_strdup(link->bus);
    bus->units = g_hash_table_new_full(NULL, NULL, NULL, free_locks);
    g_mutex_init(&bus->mutex);
    g_cond_init(&bus->work);
    g_cond_init(&bus->finished);
    bus->line = modbus_line_new(link, error);
    gint64 deadline = g_get_monotonic_time() + (gint64)(link->timeout_ms * 1000);
    /* Lock the unit first, so that this program does not connect to a board that another daemon
     * has. */
    if (!bus->line || !lock_unit(bus, link->unit, error) ||
        !modbus_line_connect(bus->line, deadline, error)) {
        modbus_bus_free(bus);
        return NULL;
    }
    bus->source = g_source_new(&source_funcs, sizeof(struct bus_source));
    ((struct bus_source *)bus->source)->bus = bus;
    g_source_set_name(bus->source, "mesorig modbus");
    g_source_set_can_recurse(bus->source, TRUE);
    g_source_attach(bus->source, NULL);
    bus->thread = g_thread_new("modbus", bus_run, bus);
    g_hash_table_insert(buses, bus->key, bus);
    return bus;
}

ModbusBus *modbus_bus_get(const struct modbus_link *link, const struct device *device,
                          GError **error) {
    const struct config_section *section = device->section;
    if (!device_check_real_clock(device, error))
        return NULL;
    if (!buses)
        buses = g_hash_table_new(g_str_hash, g_str_equal);
    g_autofree char *key = modbus_address_name(link->bus);
    ModbusBus *bus = g_hash_table_lookup(buses, key);
    if (bus && !modbus_link_is_same(&bus->link, link)) {
        config_set_error(error, CONFIG_ERROR_VALUE, section, "bus",
                         "another section opens %s with other settings; make baud, parity, "
                         "stop_bits, timeout_ms, late_ms and retries the same",
                         link->bus);
        return NULL;
    }
    if (bus && lock_unit(bus, link->unit, error)) {
        bus->ref_count++;
        return bus;
    }
    bus = bus ? NULL : modbus_bus_new(link, key, error);
    if (!bus) {
        int line;
        config_value(section, "bus", &line);
        g_autofree char *where = g_strdup_printf("[%s] bus", section->group);
        error_details_add_place(error, config_path(section->config), line, where);
    }
    return bus;
}

void modbus_bus_unref(ModbusBus *bus) {
    if (!bus || --bus->ref_count > 0)
        return;
    g_hash_table_remove(buses, bus->key);
    if (g_hash_table_size(buses) == 0)
        g_clear_pointer(&buses, g_hash_table_unref);
    g_mutex_lock(&bus->mutex);
    bus->quit = TRUE;
    g_cond_signal(&bus->work);
    g_mutex_unlock(&bus->mutex);
    g_thread_join(bus->thread);
    g_source_destroy(bus->source);
    g_source_unref(bus->source);
    modbus_bus_free(bus);
}

struct modbus_request *modbus_job_add(struct modbus_job *job, enum modbus_kind kind, int address,
                                      int n) {
    g_return_val_if_fail(job->n < MODBUS_MAX_REQUESTS && n > 0 && n <= MODBUS_MAX_VALUES, NULL);
    struct modbus_request *request = &job->requests[job->n++];
    *request = (struct modbus_request){.kind = kind, .address = address, .n = n};
    return request;
}

static struct task *task_new(const struct modbus_link *link, const struct modbus_job *job,
                             enum modbus_turn turn, double deadline_ms) {
    struct task *task = g_new0(struct task, 1);
    task->ref_count = 1;
    task->job = *job;
    task->unit = link->unit;
    task->turn = turn;
    task->limit_us = (gint64)(deadline_ms * 1000);
    return task;
}

static void enqueue(ModbusBus *bus, struct task *task) {
    g_mutex_lock(&bus->mutex);
    g_queue_push_tail(&bus->queues[task->turn], task);
    if (task->turn == MODBUS_URGENT)
        g_atomic_int_inc(&bus->n_urgent);
    g_cond_signal(&bus->work);
    g_mutex_unlock(&bus->mutex);
}

void modbus_bus_start(ModbusBus *bus, const struct modbus_link *link, const struct modbus_job *job,
                      enum modbus_turn turn, double deadline_ms, ModbusFunc func, gpointer data) {
    struct task *task = task_new(link, job, turn, deadline_ms);
    task->func = func;
    task->data = data;
    bus->waiting = g_list_prepend(bus->waiting, task);
    enqueue(bus, task);
}

void modbus_bus_skip(ModbusBus *bus, gpointer data, int tag) {
    static const enum modbus_turn turns[] = {MODBUS_COMMAND, MODBUS_POLL};
    g_mutex_lock(&bus->mutex);
    for (gsize i = 0; i < G_N_ELEMENTS(turns); i++) {
        GQueue *queue = &bus->queues[turns[i]];
        for (GList *item = queue->head, *next; item; item = next) {
            struct task *task = item->data;
            next = item->next;
            if (task->data != data || task->waited || (tag >= 0 && task->job.tag != tag))
                continue;
            task->job.skipped = TRUE;
            device_error_set(&task->error, DEVICE_ERROR_BUSY, NULL,
                             "%s unit %d: the command was not sent, because an \"off\" or a stop "
                             "came first",
                             bus->key, task->unit);
            g_queue_delete_link(queue, item);
            g_queue_push_tail(&bus->results, task);
            g_source_set_ready_time(bus->source, 0);
        }
    }
    g_mutex_unlock(&bus->mutex);
}

gboolean modbus_bus_do(ModbusBus *bus, const struct modbus_link *link, struct modbus_job *job,
                       double deadline_ms, GError **error) {
    struct task *task = task_new(link, job, MODBUS_URGENT, deadline_ms);
    task->ref_count = 2; /* references of the line's thread and of this function */
    gint64 until_us = g_get_monotonic_time() + task->limit_us + EXTRA_WAIT_US;
    gboolean in_time = TRUE;
    task->waited = TRUE;
    enqueue(bus, task);
    g_mutex_lock(&bus->mutex);
    while (!task->done && in_time)
        in_time = g_cond_wait_until(&bus->finished, &bus->mutex, until_us);
    gboolean done = task->done;
    g_mutex_unlock(&bus->mutex);
    if (!done) {
        g_atomic_int_set(&task->cancelled, TRUE);
        device_error_set(
            error, DEVICE_ERROR_TIMEOUT, NULL,
            "%s unit %d: the line was busy for more than %.1f s" ERROR_ADVICE "check its cable",
            bus->link.bus, link->unit, (double)(task->limit_us + EXTRA_WAIT_US) * 1e-6);
    } else if (task->error) {
        g_propagate_error(error, g_steal_pointer(&task->error));
        done = FALSE;
    } else {
        *job = task->job;
    }
    task_unref(task);
    return done;
}

void modbus_bus_cancel(ModbusBus *bus, gpointer data) {
    for (GList *item = bus->waiting; item; item = item->next) {
        struct task *task = item->data;
        if (task->data == data) {
            task->func = NULL;
            g_atomic_int_set(&task->cancelled, TRUE);
        }
    }
}

void modbus_bus_counts(ModbusBus *bus, struct modbus_counts *ret) {
    g_mutex_lock(&bus->mutex);
    *ret = bus->counts;
    g_mutex_unlock(&bus->mutex);
}
