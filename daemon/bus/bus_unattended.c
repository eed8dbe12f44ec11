#include "bus_unattended.h"

#include <string.h>

#include "bus_errors.h"
#include "bus_hands.h"
#include "bus_latch.h"
#include "bus_safety.h"
#include "bus_trial.h"
#include "queue.h"

/* How often a session is continued after this program has ended unexpectedly. */
#define MAX_STARTS 3
/* Number of sessions in a row that have stopped, after which a fault of the rig is assumed. */
#define MAX_STOPPED 2

/* The moment of a capture that was last reported to clients. */
enum moment { MOMENT_NONE, MOMENT_RUNS, MOMENT_PAUSED, MOMENT_HANDS, MOMENT_FAULT, MOMENT_ENDED };

struct unattended {
    Bus *bus;
    Queue *queue;            /* NULL if this daemon keeps no queue */
    struct queue_item *item; /* the present item: hands, trying or begun; NULL if there is none */
    struct bus_trial *trial;
    guint step_id;
    guint stopped_in_row;
    gboolean has_worked; /* a session has run since the axes were last parked */
    guint n_parking;     /* number of axes that are being parked */
    /* State of the rig when the queue became empty, or the reason why there is none, or NULL. */
    char *rest;
    GString *not_parked;    /* axes that could not be parked, and the reasons */
    gboolean held_by_fault; /* the queue is paused because its session is paused by a fault */
    enum moment told;
};

static gint64 now_s(void) {
    return g_get_real_time() / G_USEC_PER_SEC;
}

static guint count_waiting(const struct unattended *at) {
    const GPtrArray *items = queue_items(at->queue);
    guint n = 0;
    for (guint i = 0; i < items->len; i++)
        n += ((const struct queue_item *)items->pdata[i])->state < QUEUE_BEGUN;
    return n;
}

static const char *state_of(const struct unattended *at) {
    if (!at->queue)
        return "none";
    if (queue_paused(at->queue))
        return "paused";
    if (at->item)
        return at->item->state == QUEUE_HANDS ? "hands" : "working";
    return queue_next(at->queue) ? "waiting" : "empty";
}

static GVariant *show_item(const struct queue_item *item) {
    GVariantBuilder to;
    const struct {
        const char *key, *text;
    } texts[] = {{"state", queue_state_names[item->state]},
                 {"name", item->name},
                 {"session_path", item->session_path},
                 {"directory", item->directory},
                 {"prompt", item->prompt},
                 {"message", item->message}};
    g_variant_builder_init(&to, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&to, "{sv}", "number", g_variant_new_uint32(item->id));
    for (gsize i = 0; i < G_N_ELEMENTS(texts); i++)
        g_variant_builder_add(&to, "{sv}", texts[i].key, g_variant_new_string(texts[i].text));
    g_variant_builder_add(&to, "{sv}", "predicted_s", g_variant_new_double(item->predicted_s));
    g_variant_builder_add(&to, "{sv}", "bytes", g_variant_new_uint64(item->bytes));
    g_variant_builder_add(&to, "{sv}", "process", g_variant_new_boolean(item->process));
    g_variant_builder_add(&to, "{sv}", "yes", g_variant_new_boolean(item->yes));
    g_variant_builder_add(&to, "{sv}", "begun_at", g_variant_new_int64(item->begun_at_s));
    g_variant_builder_add(&to, "{sv}", "ended_at", g_variant_new_int64(item->ended_at_s));
    return g_variant_builder_end(&to);
}

static void show_queue(struct unattended *at) {
    GVariantBuilder list;
    const char *state = state_of(at);
    const char *paused = at->queue ? queue_paused(at->queue) : NULL;
    const gboolean rests = !at->queue || strcmp(state, "empty") == 0;
    const char *reason = paused ? paused : rests ? at->rest : NULL;
    g_variant_builder_init(&list, G_VARIANT_TYPE("aa{sv}"));
    for (guint i = 0; at->queue && i < queue_items(at->queue)->len; i++)
        g_variant_builder_add_value(&list, show_item(queue_items(at->queue)->pdata[i]));
    g_object_set(at->bus->object, "queue", g_variant_builder_end(&list), "queue-state", state,
                 "queue-reason", reason ? reason : "", NULL);
    if (!at->bus->capture)
        bus_rig1_set_prompt(at->bus->object,
                            at->item && at->item->state == QUEUE_HANDS ? at->item->prompt : "");
}

/* Reports a milestone. item is a session of the queue, or NULL for the capture under way, if there
 * is one. */
static void tell(struct unattended *at, const char *what, const struct queue_item *item,
                 const char *message) {
    Bus *bus = at->bus;
    GVariantBuilder details;
    g_autofree char *valid = g_utf8_make_valid(message ? message : "", -1);
    const char *directory = item ? item->directory : bus->capture ? bus->directory : "";
    g_autofree char *base = *directory ? g_path_get_basename(directory) : g_strdup("");
    if (g_str_has_suffix(base, ".session"))
        base[strlen(base) - strlen(".session")] = '\0';
    g_variant_builder_init(&details, G_VARIANT_TYPE_VARDICT);
    g_variant_builder_add(&details, "{sv}", "session", g_variant_new_string(directory));
    g_variant_builder_add(&details, "{sv}", "name", g_variant_new_string(item ? item->name : base));
    g_variant_builder_add(&details, "{sv}", "message", g_variant_new_string(valid));
    g_variant_builder_add(&details, "{sv}", "number", g_variant_new_uint32(item ? item->id : 0));
    g_variant_builder_add(&details, "{sv}", "waiting",
                          g_variant_new_uint32(at->queue ? count_waiting(at) : 0));
    bus_rig1_emit_milestone(bus->object, what, g_variant_builder_end(&details));
}

static void set_item(struct unattended *at, struct queue_item *item, enum queue_state state,
                     const char *message) {
    g_autoptr(GError) error = NULL;
    if (state == QUEUE_DONE || state == QUEUE_STOPPED)
        item->ended_at_s = now_s();
    if (!queue_set(at->queue, item, state, message, &error))
        bus_report(at->bus, "warning", "queue", error->message);
}

static void pause_queue(struct unattended *at, const char *why) {
    g_autoptr(GError) error = NULL;
    if (queue_paused(at->queue))
        return;
    if (!queue_pause(at->queue, why, &error))
        bus_report(at->bus, "warning", "queue", error->message);
    bus_report(at->bus, "warning", "queue", why);
    tell(at, "queue-paused", NULL, why);
}

/* Returns a session that has not begun to its place in the queue, where it waits again. */
static void put_back(struct unattended *at) {
    g_clear_pointer(&at->trial, bus_trial_free);
    if (at->item && at->item->state != QUEUE_BEGUN) {
        set_item(at, at->item, QUEUE_WAITING, NULL);
        at->item = NULL;
    }
}

/* Ends the present item, which has stopped before its last shot. rig says that the rig has a fault,
 * so that the next item would also stop. */
static void stop_item(struct unattended *at, const char *message, gboolean rig) {
    struct queue_item *item = g_steal_pointer(&at->item);
    set_item(at, item, QUEUE_STOPPED, message);
    bus_report(at->bus, "error", "queue", message);
    tell(at, "fault", item, message);
    at->stopped_in_row++;
    if (rig) {
        pause_queue(at, message);
    } else if (at->stopped_in_row >= MAX_STOPPED) {
        g_autofree char *why =
            g_strdup_printf("%u sessions in a row have stopped, the last one, number %u, because "
                            "%s: look at the rig, then mesorig queue resume",
                            at->stopped_in_row, item->id, message);
        pause_queue(at, why);
    }
    show_queue(at);
    bus_unattended_poke(at->bus);
}

static gboolean is_interlocked(const Bus *bus) {
    for (int i = 0; i < bus->devices->n_interlocks; i++)
        if (!interlock_is_closed(bus->devices->interlocks[i]))
            return TRUE;
    return FALSE;
}

/* Keeps an item that did not begin because of the rig and not because of its session. It is tried
 * again later. */
static void keep_for_later(struct unattended *at, const char *why) {
    struct queue_item *item = g_steal_pointer(&at->item);
    g_autofree char *text = g_strdup_printf("session %u could not begin: %s", item->id, why);
    set_item(at, item, QUEUE_WAITING, NULL);
    pause_queue(at, text);
    show_queue(at);
}

static void on_begun(Bus *bus, const GError *error) {
    struct unattended *at = bus->unattended;
    if (!error || !at->item)
        return; /* bus_unattended_begun() has handled it */
    at->item->starts--;
    if (g_error_matches(error, BUS_ERROR, BUS_ERROR_CANCELLED))
        keep_for_later(at, error->message);
    else
        stop_item(at, error->message, FALSE);
}

static gboolean has_begun(const struct queue_item *item) {
    g_autofree char *database = g_build_filename(item->directory, "session.db", NULL);
    return item->begun_at_s > 0 && g_file_test(database, G_FILE_TEST_EXISTS);
}

/* Makes the session, or resumes it. The state "begun" is on disk before the capture begins. */
static void begin_item(struct unattended *at) {
    struct queue_item *item = at->item;
    const gboolean resumes = has_begun(item);
    g_autoptr(GError) error = NULL;
    if (item->starts >= MAX_STARTS) {
        g_autofree char *why =
            g_strdup_printf("mesorigd has ended unexpectedly %d times while it captured this "
                            "session: see journalctl -u mesorigd, then mesorig resume %s",
                            item->starts, item->directory);
        stop_item(at, why, FALSE);
        return;
    }
    item->starts++;
    item->begun_at_s = item->begun_at_s ? item->begun_at_s : now_s();
    if (!queue_set(at->queue, item, QUEUE_BEGUN, NULL, &error)) {
        item->starts--;
        item->begun_at_s = resumes ? item->begun_at_s : 0;
        keep_for_later(at, error->message);
        return;
    }
    show_queue(at);
    bus_start_queued(at->bus, item, resumes, on_begun);
}

static void on_trial(Bus *bus, char *chosen, char *said, enum bus_trial_end end) {
    struct unattended *at = bus->unattended;
    struct queue_item *item = at->item;
    g_clear_pointer(&at->trial, bus_trial_free);
    if (end == BUS_TRIAL_DONE) {
        if (*said)
            bus_report(bus, "warning", "queue", said);
        g_free(item->chosen);
        item->chosen = g_strdup(chosen);
        begin_item(at);
    } else if (end == BUS_TRIAL_RIG || is_interlocked(bus)) {
        keep_for_later(at, said);
    } else {
        stop_item(at, said, FALSE);
    }
}

static void try_item(struct unattended *at) {
    g_autoptr(GError) error = NULL;
    if (has_begun(at->item)) {
        begin_item(at);
        return;
    }
    at->trial = bus_trial_start(at->bus, at->item, on_trial, &error);
    if (!at->trial) {
        keep_for_later(at, error->message);
        return;
    }
    set_item(at, at->item, QUEUE_TRYING, NULL);
    show_queue(at);
}

static void rest_now(struct unattended *at) {
    enum device_safety safety;
    g_variant_unref(g_variant_ref_sink(devices_safety(at->bus->devices, &safety)));
    const gboolean safe = safety == DEVICE_SAFE;
    g_free(at->rest);
    at->rest =
        g_strdup_printf("%s%s%s",
                        safe ? "lamps and lasers are off"
                             : "NOT every lamp and laser has confirmed that it is off: look "
                               "at the rig",
                        at->not_parked->len ? "; " : ", the axes are parked", at->not_parked->str);
    bus_report(at->bus, safe && !at->not_parked->len ? "info" : "warning", "queue", at->rest);
    tell(at, "queue-empty", NULL, at->rest);
    show_queue(at);
}

static void note_not_parked(struct unattended *at, const GError *error) {
    g_string_append_printf(at->not_parked, "%s%s",
                           at->not_parked->len ? "; " : "not parked: ", error->message);
}

static void on_parked(Bus *bus, const GError *error) {
    struct unattended *at = bus->unattended;
    if (error)
        note_not_parked(at, error);
    if (--at->n_parking == 0)
        rest_now(at);
}

/* Parks the rig when the queue is empty: switches lights off and moves the axes to their parking
 * positions. */
static void park(struct unattended *at) {
    Bus *bus = at->bus;
    g_autoptr(GError) error = NULL;
    at->has_worked = FALSE;
    g_string_truncate(at->not_parked, 0);
    if (!devices_make_safe(bus->devices, &error))
        bus_report(bus, "error", "queue", error->message);
    at->n_parking = 1; /* counts one until all axes have started */
    for (int i = 0; i < DEVICES_POSITIONERS; i++) {
        Axis *axis = devices_positioner(bus->devices, i);
        g_autoptr(GError) why = NULL;
        if (axis && bus_hands_park(bus, axis, on_parked, &why))
            at->n_parking++;
        else if (axis)
            note_not_parked(at, why);
    }
    if (--at->n_parking == 0)
        rest_now(at);
}

static gboolean is_free(const Bus *bus) {
    return bus->devices && !bus->ending && !bus->capture && bus->hands->len == 0 &&
           !bus_latch_is_set(bus->latch);
}

/* Returns whether the open rig can capture the session. If not, the queue is paused. */
static gboolean check_rig(struct unattended *at, const struct queue_item *item) {
    g_autofree char *why = NULL;
    g_autoptr(GError) error = NULL;
    if (strcmp(item->rig, at->bus->rig_path) != 0)
        why = g_strdup_printf("session %u was added for the rig %s, but %s is open", item->id,
                              item->rig, at->bus->rig_path);
    else if (!bus_need_safe(at->bus, &error))
        why = g_strdup_printf("%s; then mesorig queue resume", error->message);
    if (why)
        pause_queue(at, why);
    return !why;
}

static gboolean step(gpointer data) {
    struct unattended *at = data;
    Bus *bus = at->bus;
    at->step_id = 0;
    show_queue(at);
    if (!is_free(bus) || bus_jobs_beginning(bus) || at->item || at->n_parking ||
        queue_paused(at->queue))
        return G_SOURCE_REMOVE;
    struct queue_item *item = queue_next(at->queue);
    if (!item) {
        if (at->has_worked)
            park(at);
        return G_SOURCE_REMOVE;
    }
    if (!check_rig(at, item)) {
        show_queue(at);
        return G_SOURCE_REMOVE;
    }
    at->item = item;
    if (*item->prompt && !has_begun(item)) {
        set_item(at, item, QUEUE_HANDS, NULL);
        tell(at, "hands", item, item->prompt);
        bus_report(bus, "info", "queue", item->prompt);
        show_queue(at);
    } else {
        try_item(at);
    }
    return G_SOURCE_REMOVE;
}

void bus_unattended_poke(Bus *bus) {
    struct unattended *at = bus->unattended;
    if (at && at->queue && !at->step_id)
        at->step_id = g_idle_add(step, at);
}

void bus_unattended_begun(Bus *bus) {
    struct unattended *at = bus->unattended;
    const gboolean ours = at->item && at->item->state == QUEUE_BEGUN;
    at->told = MOMENT_RUNS;
    at->has_worked |= ours;
    at->held_by_fault = FALSE;
    if (at->queue)
        g_clear_pointer(&at->rest, g_free);
    tell(at, "begun", ours ? at->item : NULL, "");
}

/* Handles a fault that has paused a session of the queue. */
static void take_fault(struct unattended *at, const struct capture_status *status) {
    if (status->fault == CAPTURE_FAULT_RIG) {
        /* The rig keeps its state. The user who repairs it continues the session. */
        g_autofree char *why =
            g_strdup_printf("session %u is paused by a fault: %s", at->item->id, status->reason);
        tell(at, "fault", at->item, status->reason);
        at->held_by_fault = !queue_paused(at->queue);
        pause_queue(at, why);
        show_queue(at);
        return;
    }
    g_autofree char *reason = g_strdup_printf("%s To continue it: mesorig resume %s",
                                              status->reason, at->item->directory);
    stop_item(at, reason, FALSE);
    capture_abort(at->bus->capture);
}

static void take_end(struct unattended *at, gboolean done) {
    struct queue_item *item = g_steal_pointer(&at->item);
    if (done) {
        at->stopped_in_row = 0;
        set_item(at, item, QUEUE_DONE, NULL);
        tell(at, "done", item, "");
    } else {
        g_autofree char *message = g_strdup_printf(
            "it was aborted; the frames that were taken are kept: mesorig resume %s",
            item->directory);
        g_autofree char *why = g_strdup_printf("session %u was aborted", item->id);
        set_item(at, item, QUEUE_STOPPED, message);
        tell(at, "aborted", item, message);
        pause_queue(at, why);
    }
    show_queue(at);
}

static enum moment moment_of(const struct capture_status *status) {
    if (status->state == CAPTURE_DONE || status->state == CAPTURE_ABORTED)
        return MOMENT_ENDED;
    if (status->state != CAPTURE_PAUSED)
        return MOMENT_RUNS;
    if (status->fault != CAPTURE_FAULT_NONE)
        return MOMENT_FAULT;
    return status->prompt ? MOMENT_HANDS : MOMENT_PAUSED;
}

void bus_unattended_changed(Bus *bus, const struct capture_status *status) {
    struct unattended *at = bus->unattended;
    const enum moment moment = moment_of(status);
    const gboolean ours = at->item && at->item->state == QUEUE_BEGUN;
    if (moment == at->told)
        return;
    at->told = moment;
    if (moment == MOMENT_HANDS)
        tell(at, "hands", ours ? at->item : NULL, status->prompt);
    if (moment == MOMENT_RUNS && at->held_by_fault) {
        at->held_by_fault = FALSE;
        if (!queue_pause(at->queue, NULL, NULL))
            bus_report(bus, "warning", "queue",
                       "the queue stays paused, because its file cannot be written");
        show_queue(at);
    }
    if (ours && moment == MOMENT_FAULT)
        take_fault(at, status);
    else if (ours && moment == MOMENT_ENDED)
        take_end(at, status->state == CAPTURE_DONE);
    else if (moment == MOMENT_FAULT)
        tell(at, "fault", NULL, status->reason);
    else if (moment == MOMENT_ENDED)
        tell(at, status->state == CAPTURE_DONE ? "done" : "aborted", NULL, "");
}

void bus_unattended_stop(Bus *bus, const char *why) {
    struct unattended *at = bus->unattended;
    if (!at->queue)
        return;
    put_back(at);
    if (why && (at->item || queue_next(at->queue)))
        pause_queue(at, why);
    if (!why && at->item) {
        /* The capture is closed in an orderly way and can be resumed. */
        at->item->starts = 0;
        set_item(at, at->item, QUEUE_WAITING, NULL);
        at->item = NULL;
    }
    show_queue(at);
}

gboolean bus_unattended_is_beginning(const Bus *bus) {
    const struct unattended *at = bus->unattended;
    return at->item && at->item->state == QUEUE_TRYING;
}

gboolean bus_unattended_need_free(Bus *bus, GError **error) {
    const struct unattended *at = bus->unattended;
    if (!bus_unattended_is_beginning(bus))
        return TRUE;
    g_set_error(error, BUS_ERROR, BUS_ERROR_BUSY,
                "session %u of the queue is about to begin: mesorig queue pause prevents that",
                at->item->id);
    return FALSE;
}

gboolean bus_unattended_need_queue(Bus *bus, GError **error) {
    const struct unattended *at = bus->unattended;
    if (!at->queue)
        g_set_error(error, BUS_ERROR, BUS_ERROR_FAILED, "this mesorigd keeps no queue: %s",
                    at->rest ? at->rest : "start it with --queue FILE");
    return at->queue != NULL;
}

guint bus_unattended_add(Bus *bus, struct queue_item *item, GError **error) {
    struct unattended *at = bus->unattended;
    if (!queue_add(at->queue, item, error))
        return 0;
    g_clear_pointer(&at->rest, g_free);
    show_queue(at);
    bus_unattended_poke(bus);
    return item->id;
}

gboolean bus_unattended_remove(Bus *bus, guint number, GError **error) {
    struct unattended *at = bus->unattended;
    if (!bus_unattended_need_queue(bus, error))
        return FALSE;
    struct queue_item *item = queue_find(at->queue, number, error);
    if (!item || !queue_remove(at->queue, number, error))
        return FALSE;
    if (at->item == item)
        at->item = NULL;
    show_queue(at);
    bus_unattended_poke(bus);
    return TRUE;
}

gboolean bus_unattended_move(Bus *bus, guint number, guint place, GError **error) {
    struct unattended *at = bus->unattended;
    if (!bus_unattended_need_queue(bus, error) || !queue_move(at->queue, number, place, error))
        return FALSE;
    if (at->item && at->item->state == QUEUE_HANDS && queue_next(at->queue) != at->item)
        put_back(at);
    show_queue(at);
    bus_unattended_poke(bus);
    return TRUE;
}

gboolean bus_unattended_pause(Bus *bus, GError **error) {
    struct unattended *at = bus->unattended;
    if (!bus_unattended_need_queue(bus, error) ||
        (!queue_paused(at->queue) && !queue_pause(at->queue, "paused by hand", error)))
        return FALSE;
    put_back(at);
    show_queue(at);
    return TRUE;
}

gboolean bus_unattended_resume(Bus *bus, GError **error) {
    struct unattended *at = bus->unattended;
    struct capture_status status;
    if (!bus_unattended_need_queue(bus, error))
        return FALSE;
    if (bus->capture && at->item) {
        capture_get_status(bus->capture, &status);
        if (status.state == CAPTURE_PAUSED && !status.prompt) {
            if (!capture_continue(bus->capture, error))
                return FALSE;
            g_hash_table_remove_all(bus->faults);
        }
    }
    if (queue_paused(at->queue) && !queue_pause(at->queue, NULL, error))
        return FALSE;
    at->stopped_in_row = 0;
    show_queue(at);
    bus_unattended_poke(bus);
    return TRUE;
}

gboolean bus_unattended_answer(Bus *bus) {
    struct unattended *at = bus->unattended;
    if (!at->item || at->item->state != QUEUE_HANDS || !is_free(bus))
        return FALSE;
    try_item(at);
    return TRUE;
}

void bus_keep_queue(Bus *bus, const char *path) {
    struct unattended *at = bus->unattended;
    g_autoptr(GError) error = NULL;
    at->queue = queue_open(path, &error);
    if (error) {
        at->rest = g_strdup(error->message);
        g_warning("there is no queue of sessions: %s", error->message);
    } else if (queue_paused(at->queue)) {
        g_message("the queue is paused: %s", queue_paused(at->queue));
    }
    show_queue(at);
    bus_unattended_poke(bus);
}

struct unattended *bus_unattended_new(Bus *bus) {
    struct unattended *at = g_new0(struct unattended, 1);
    at->bus = bus;
    at->not_parked = g_string_new(NULL);
    bus->unattended = at;
    show_queue(at);
    return at;
}

void bus_unattended_free(struct unattended *at) {
    g_clear_handle_id(&at->step_id, g_source_remove);
    g_clear_pointer(&at->trial, bus_trial_free);
    queue_free(at->queue);
    g_string_free(at->not_parked, TRUE);
    g_free(at->rest);
    at->bus->unattended = NULL;
    g_free(at);
}
