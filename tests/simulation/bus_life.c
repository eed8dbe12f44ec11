#include "bus_life.h"

#include <string.h>
#include <unistd.h>

#include "bus/preparer.h"
#include "bus_clients.h"
#include "bus_owners.h"
#include "capture/capture.h"
#include "held_time.h"
#include "plan/report.h"

#define HANG_S    60 /* of a life, really: SIGALRM ends it */
#define MAX_TURNS 200000

/* After the last step until leases have ended and devices have been asked again; at the end, once
 * more, with all clients gone. */
#define REST_US  (12 * G_USEC_PER_SEC)
#define ALONE_US (8 * G_USEC_PER_SEC)

/* With ./run coverage, what this process has run is counted. */
void __gcov_dump(void) __attribute__((weak));

struct serving {
    struct scene *scene;
    const struct bus_schedule *schedule;
    Bus *bus;
    struct bus_clients *clients;
    struct bus_owners *owners;
    int turns;
};

static const struct bus_schedule *checks; /* of this process */

static G_NORETURN void serving_over(void) {
    if (__gcov_dump)
        __gcov_dump();
    _exit(0);
}

/* What the child of the daemon does (preparer.h), in the daemon's own process after a time: the
 * child is a program of its own, of whose disk and time the simulation knows nothing. */
struct checking {
    struct preparer_request request;
    char *session_path, *session_text, *directory, *calibration, *chosen;
};

static void checking_free(gpointer data) {
    struct checking *checking = data;
    g_free(checking->session_path);
    g_free(checking->session_text);
    g_free(checking->directory);
    g_free(checking->calibration);
    g_free(checking->chosen);
    g_free(checking);
}

static GVariant *checking_work(const struct checking *checking, GError **error) {
    const struct preparer_request *request = &checking->request;
    g_auto(SessionConf) conf = {0};
    if (request->task == PREPARER_EXAMINE) {
        g_autofree char *warning = NULL;
        if (!capture_examine(request->devices, checking->directory, &warning, error))
            return NULL;
        return g_variant_new_string(warning ? warning : "");
    }
    if (!(checking->session_text
              ? session_conf_parse(&conf, checking->session_text, checking->session_path, error)
              : session_conf_load(&conf, checking->session_path, error)) ||
        !session_conf_choose(&conf, checking->chosen, error) ||
        !capture_create(request->devices, &conf, checking->directory, error))
        return NULL;
    return g_variant_new_string("");
}

static gboolean on_checked(gpointer data) {
    GTask *task = data;
    GError *error = NULL;
    if (g_task_return_error_if_cancelled(task))
        return G_SOURCE_REMOVE; /* the devices may be closed */
    GVariant *result = checking_work(g_task_get_task_data(task), &error);
    if (result)
        g_task_return_pointer(task, g_variant_ref_sink(result), (GDestroyNotify)g_variant_unref);
    else
        g_task_return_error(task, error);
    return G_SOURCE_REMOVE;
}

void __wrap_preparer_run(const struct preparer_request *request, GCancellable *cancellable,
                         GAsyncReadyCallback callback, gpointer data);
GVariant *__wrap_preparer_finish(GAsyncResult *result, GError **error);

void __wrap_preparer_run(const struct preparer_request *request, GCancellable *cancellable,
                         GAsyncReadyCallback callback, gpointer data) {
    g_autoptr(GTask) task = g_task_new(NULL, cancellable, callback, data);
    struct checking *checking = g_new0(struct checking, 1);
    checking->request = *request;
    checking->session_path = g_strdup(request->session_path);
    checking->session_text = g_strdup(request->session_text);
    checking->directory = g_strdup(request->directory);
    checking->calibration = g_strdup(request->calibration);
    checking->chosen = g_strdup(request->chosen);
    g_task_set_task_data(task, checking, checking_free);
    g_autoptr(GSource) source = g_timeout_source_new((guint)(checks->check_us / 1000));
    g_task_attach_source(task, source, on_checked);
}

GVariant *__wrap_preparer_finish(GAsyncResult *result, GError **error) {
    return g_task_propagate_pointer(G_TASK(result), error);
}

static GLogWriterOutput say_log(GLogLevelFlags level, const GLogField *fields, gsize n,
                                gpointer data) {
    struct scene *scene = data;
    for (gsize i = 0; i < n; i++)
        if (strcmp(fields[i].key, "MESSAGE") == 0) {
            if (level & (G_LOG_LEVEL_CRITICAL | G_LOG_LEVEL_ERROR))
                scene_break(scene, "does not crash", "%s", (const char *)fields[i].value);
            else if (level & (G_LOG_LEVEL_WARNING | G_LOG_LEVEL_MESSAGE))
                disk_say(&scene->disk, "log: %s", (const char *)fields[i].value);
        }
    return G_LOG_WRITER_HANDLED;
}

static void serving_turn(struct serving *serving, gboolean sleeps) {
    g_main_context_iteration(NULL, sleeps);
    bus_clients_read(serving->clients);
    bus_owners_look(serving->owners);
    if (++serving->turns > MAX_TURNS)
        scene_break(serving->scene, "ends", "the daemon does not come to rest");
    if (*serving->scene->violation)
        serving_over();
}

/* Until a time, and then until nothing is left to do at that time. */
static void serving_run(struct serving *serving, gint64 until_us) {
    const struct disk *disk = &serving->scene->disk;
    held_time_set_limit(until_us);
    while (disk->ended_us < until_us)
        serving_turn(serving, TRUE);
}

static void serving_step(struct serving *serving, const struct bus_step *step) {
    const struct disk *disk = &serving->scene->disk;
    if (step->after_us > 0)
        serving_run(serving, disk->ended_us + step->after_us);
    for (int i = 0; step->after_us == 0 && i < step->turns; i++)
        serving_turn(serving, FALSE);
    bus_clients_step(serving->clients, step);
}

/* As mesorigd ends. */
static void serving_end(struct serving *serving) {
    struct scene *scene = serving->scene;
    g_autoptr(GError) error = NULL;
    held_time_set_limit(scene->disk.ended_us + 100 * G_USEC_PER_SEC);
    if (!bus_end(serving->bus, &error))
        disk_say(&scene->disk, "not safe: %s", error->message);
    bus_free(serving->bus);
}

void bus_life(struct scene *scene, const struct bus_schedule *schedule) {
    struct serving serving = {.scene = scene, .schedule = schedule};
    g_autofree char *address = g_strdup_printf("unix:path=%s/bus", scene->folder);
    g_autofree char *rig = g_build_filename(scene->folder, "rig.conf", NULL);
    g_autoptr(GError) error = NULL;
    alarm(HANG_S);
    g_log_set_writer_func(say_log, scene, NULL);
    checks = schedule;
    serving.bus = bus_new(address);
    disk_use(&scene->disk);
    scene->disk.active = TRUE;
    held_time_begin(&scene->disk);
    serving.clients = bus_clients_new(scene, serving.bus);
    serving.owners = bus_owners_new(scene, schedule, serving.bus, serving.clients);
    if (!bus_open_rig(serving.bus, rig, &error))
        g_error("simulate: %s", error->message);
    for (int i = 0; i < schedule->n_steps; i++)
        serving_step(&serving, &schedule->steps[i]);
    serving_run(&serving, scene->disk.ended_us + REST_US);
    bus_clients_close_all(serving.clients);
    serving_run(&serving, scene->disk.ended_us + ALONE_US);
    serving_end(&serving);
    disk_say(&scene->disk, "ends after %d turns", serving.turns);
    serving_over();
}
