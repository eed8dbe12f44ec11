#include "bus_latch.h"

#include "bus_errors.h"
#include "bus_names.h"
#include "bus_reply.h"

#include <string.h>

/* The main loop checks every LOOK_MS whether the devices have answered a SafeState, for at most
 * ANSWER_US. Then it answers the call. If the main loop has not answered after LATE_US, the thread
 * of the latch does. */
#define LOOK_MS   2
#define ANSWER_US (150 * 1000)
#define LATE_US   (200 * 1000)

#define GENERATION "mesorig-generation"

struct safe_call {
    GDBusConnection *connection;
    GDBusMessage *message;
    gint64 arrived_us;
};

struct bus_latch {
    GMainContext *context;
    /* Used only by the main loop; rig is NULL after bus_latch_close(). */
    struct bus_rig *rig;
    void (*make_safe)(gpointer data);
    gpointer data;
    /* Used only by the main loop: a SafeState has commanded the devices off, and no Release has
     * come since. */
    gboolean told;
    /* Used only by the main loop: timer that checks whether the devices have answered; NULL if no
     * call waits. */
    GSource *look;
    GThread *thread; /* answers calls that are late */
    GMutex lock;     /* guards the fields below */
    GCond changed;
    GQueue calls;     /* of struct safe_call, oldest first */
    guint generation; /* number of SafeState calls so far */
    gboolean is_set, ends;
};

static void safe_call_free(gpointer data) {
    struct safe_call *call = data;
    g_object_unref(call->connection);
    g_object_unref(call->message);
    g_free(call);
}

static void latch_clear(gpointer data) {
    struct bus_latch *latch = data;
    g_queue_clear_full(&latch->calls, safe_call_free);
    g_mutex_clear(&latch->lock);
    g_cond_clear(&latch->changed);
    g_main_context_unref(latch->context);
}

struct bus_latch *bus_latch_ref(struct bus_latch *latch) {
    return g_atomic_rc_box_acquire(latch);
}

void bus_latch_unref(gpointer latch) {
    g_atomic_rc_box_release_full(latch, latch_clear);
}

/* Answers the SafeState calls that arrived at until_us or earlier. The answer is error if it is not
 * NULL, otherwise body, which is owned by the caller and may be NULL. */
static void answer_calls(struct bus_latch *latch, gint64 until_us, GVariant *body,
                         const GError *error) {
    for (;;) {
        g_mutex_lock(&latch->lock);
        struct safe_call *call = g_queue_peek_head(&latch->calls);
        call = call && call->arrived_us <= until_us ? g_queue_pop_head(&latch->calls) : NULL;
        g_mutex_unlock(&latch->lock);
        if (!call)
            return;
        bus_reply(call->connection, call->message, body, error ? g_error_copy(error) : NULL);
        safe_call_free(call);
    }
}

/* Answers the SafeState calls that arrived at until_us or earlier, while the main loop is busy, for
 * instance because it opens a rig. The answer says that the rig is not yet safe. No light is
 * switched on meanwhile, because the latch is set. The main loop commands the devices as soon as it
 * can. */
static void answer_late(struct bus_latch *latch, gint64 until_us) {
    GVariantBuilder devices;
    g_variant_builder_init(&devices, G_VARIANT_TYPE("a(sss)"));
    g_variant_builder_add(&devices, "(sss)", "daemon", "mesorigd",
                          "busy: it commands the devices as soon as it can");
    g_autoptr(GVariant) body = g_variant_ref_sink(g_variant_new("(ba(sss))", FALSE, &devices));
    answer_calls(latch, until_us, body, NULL);
}

static gpointer run_late(gpointer data) {
    struct bus_latch *latch = data;
    g_mutex_lock(&latch->lock);
    while (!latch->ends) {
        const struct safe_call *oldest = g_queue_peek_head(&latch->calls);
        const gint64 now_us = g_get_monotonic_time();
        if (!oldest) {
            g_cond_wait(&latch->changed, &latch->lock);
        } else if (oldest->arrived_us + LATE_US > now_us) {
            g_cond_wait_until(&latch->changed, &latch->lock, oldest->arrived_us + LATE_US);
        } else {
            g_mutex_unlock(&latch->lock);
            answer_late(latch, now_us - LATE_US);
            g_mutex_lock(&latch->lock);
        }
    }
    g_mutex_unlock(&latch->lock);
    return NULL;
}

struct bus_latch *bus_latch_new(struct bus_rig *rig, void (*make_safe)(gpointer data),
                                gpointer data) {
    struct bus_latch *latch = g_atomic_rc_box_new0(struct bus_latch);
    latch->context = g_main_context_ref_thread_default();
    latch->rig = rig;
    latch->make_safe = make_safe;
    latch->data = data;
    g_mutex_init(&latch->lock);
    g_cond_init(&latch->changed);
    g_queue_init(&latch->calls);
    latch->thread = g_thread_new("safe state", run_late, latch);
    return latch;
}

static void stop_looking(struct bus_latch *latch) {
    if (!latch->look)
        return;
    g_source_destroy(latch->look);
    g_clear_pointer(&latch->look, g_source_unref);
}

void bus_latch_close(struct bus_latch *latch) {
    g_autoptr(GError) error = g_error_new_literal(
        BUS_ERROR, BUS_ERROR_CANCELLED,
        "mesorigd is ending: look at the rig, and see the messages of mesorigd");
    latch->rig = NULL;
    stop_looking(latch);
    g_mutex_lock(&latch->lock);
    latch->ends = TRUE;
    g_cond_broadcast(&latch->changed);
    g_mutex_unlock(&latch->lock);
    g_thread_join(latch->thread);
    answer_calls(latch, G_MAXINT64, NULL, error);
    bus_latch_unref(latch);
}

/* Answers every waiting call if all devices have answered. Otherwise answers only the calls that
 * have waited for ANSWER_US. */
static gboolean on_look(gpointer data) {
    struct bus_latch *latch = data;
    enum device_safety safety;
    if (!latch->rig->devices) {
        g_autoptr(GError) error =
            g_error_new_literal(BUS_ERROR, BUS_ERROR_CANCELLED,
                                "the rig was closed before all devices had confirmed that they are "
                                "safe: look at the rig");
        answer_calls(latch, G_MAXINT64, NULL, error);
    } else {
        g_autoptr(GVariant) devices =
            g_variant_ref_sink(devices_safety(latch->rig->devices, &safety));
        g_autoptr(GVariant) body =
            g_variant_ref_sink(g_variant_new("(b@a(sss))", safety == DEVICE_SAFE, devices));
        answer_calls(latch, safety == DEVICE_TOLD ? g_get_monotonic_time() - ANSWER_US : G_MAXINT64,
                     body, NULL);
    }
    g_mutex_lock(&latch->lock);
    const gboolean waits = !g_queue_is_empty(&latch->calls);
    g_mutex_unlock(&latch->lock);
    if (!waits)
        stop_looking(latch);
    return waits ? G_SOURCE_CONTINUE : G_SOURCE_REMOVE;
}

static void start_looking(struct bus_latch *latch) {
    if (latch->look)
        return;
    latch->look = g_timeout_source_new(LOOK_MS);
    g_source_set_priority(latch->look, G_PRIORITY_HIGH);
    g_source_set_callback(latch->look, on_look, latch, NULL);
    g_source_attach(latch->look, latch->context);
    on_look(latch);
}

/* Answers all waiting SafeState calls with an error, because without a rig there is nothing to make
 * safe. Sets the latch back to its state before these calls. */
static void refuse_without_rig(struct bus_latch *latch, const GError *error) {
    g_mutex_lock(&latch->lock);
    latch->is_set = latch->told;
    g_mutex_unlock(&latch->lock);
    answer_calls(latch, G_MAXINT64, NULL, error);
}

/* Returns whether a device has not yet answered an earlier SafeState. If so, a further SafeState
 * does not command the devices again. */
static gboolean is_under_way(struct bus_latch *latch) {
    enum device_safety safety = DEVICE_SAFE;
    if (latch->told && latch->rig->devices)
        g_variant_unref(g_variant_ref_sink(devices_safety(latch->rig->devices, &safety)));
    return safety == DEVICE_TOLD;
}

static gboolean on_asked(gpointer data) {
    struct bus_latch *latch = data;
    g_autoptr(GError) error = NULL;
    if (!latch->rig)
        return G_SOURCE_REMOVE;
    if (!latch->rig->devices) {
        bus_rig_need_open(latch->rig, &error);
        latch->make_safe(latch->data);
        refuse_without_rig(latch, error);
        return G_SOURCE_REMOVE;
    }
    if (!is_under_way(latch)) {
        const gboolean again = latch->told;
        latch->told = TRUE;
        if (!latch->rig->ending) /* a rig that is being closed is already being made safe */
            latch->make_safe(latch->data);
        bus_rig1_set_latched(latch->rig->object, TRUE);
        if (!again)
            bus_rig_report(latch->rig, "warning", "safe state",
                           "SafeState was called: lights are switched off, axes are stopped, and "
                           "nothing may switch on or move until “mesorig release”");
    }
    start_looking(latch);
    return G_SOURCE_REMOVE;
}

static gboolean is_safe_state(GDBusMessage *message) {
    const char *interface = g_dbus_message_get_interface(message);
    return g_strcmp0(g_dbus_message_get_member(message), "SafeState") == 0 &&
           g_strcmp0(g_dbus_message_get_path(message), BUS_PATH) == 0 &&
           (!interface || g_str_equal(interface, BUS_NAME)) &&
           !*g_dbus_message_get_signature(message);
}

gboolean bus_latch_take(struct bus_latch *latch, GDBusConnection *connection,
                        GDBusMessage *message) {
    const gboolean taken = is_safe_state(message);
    g_mutex_lock(&latch->lock);
    if (taken) {
        struct safe_call *call = g_new(struct safe_call, 1);
        *call = (struct safe_call){g_object_ref(connection), message, g_get_monotonic_time()};
        latch->generation++;
        latch->is_set = TRUE;
        g_queue_push_tail(&latch->calls, call);
        g_cond_broadcast(&latch->changed);
    } else {
        g_object_set_data(G_OBJECT(message), GENERATION, GUINT_TO_POINTER(latch->generation));
    }
    g_mutex_unlock(&latch->lock);
    if (taken) {
        g_autoptr(GSource) source = g_idle_source_new();
        g_source_set_priority(source, G_PRIORITY_HIGH);
        g_source_set_callback(source, on_asked, bus_latch_ref(latch), bus_latch_unref);
        g_source_attach(source, latch->context);
    }
    return taken;
}

gboolean bus_latch_is_set(struct bus_latch *latch) {
    g_mutex_lock(&latch->lock);
    const gboolean is_set = latch->is_set;
    g_mutex_unlock(&latch->lock);
    return is_set;
}

gboolean bus_latch_need_released(struct bus_latch *latch, GError **error) {
    const gboolean is_set = bus_latch_is_set(latch);
    if (is_set)
        g_set_error_literal(error, BUS_ERROR, BUS_ERROR_LATCHED,
                            "the rig is held in its safe state, because SafeState was called: look "
                            "at the rig, then call “mesorig release”");
    return !is_set;
}

static guint arrived_in(GDBusMethodInvocation *invocation) {
    GDBusMessage *message = g_dbus_method_invocation_get_message(invocation);
    return GPOINTER_TO_UINT(g_object_get_data(G_OBJECT(message), GENERATION));
}

gboolean bus_latch_allows(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                          GError **error) {
    if (!bus_latch_need_released(latch, error))
        return FALSE;
    g_mutex_lock(&latch->lock);
    const gboolean is_last = arrived_in(invocation) == latch->generation;
    g_mutex_unlock(&latch->lock);
    if (!is_last)
        g_set_error(error, BUS_ERROR, BUS_ERROR_CANCELLED,
                    "%s was not carried out, because SafeState was called after it: call %s again",
                    g_dbus_method_invocation_get_method_name(invocation),
                    g_dbus_method_invocation_get_method_name(invocation));
    return is_last;
}

gboolean bus_latch_release(struct bus_latch *latch, GDBusMethodInvocation *invocation,
                           GError **error) {
    g_mutex_lock(&latch->lock);
    const gboolean is_last = arrived_in(invocation) == latch->generation;
    const gboolean was_set = latch->is_set;
    if (is_last)
        latch->is_set = FALSE;
    g_mutex_unlock(&latch->lock);
    if (!is_last) {
        g_set_error_literal(error, BUS_ERROR, BUS_ERROR_LATCHED,
                            "SafeState was called after this Release, so the rig stays in its safe "
                            "state: look at the rig, then call “mesorig release” again");
        return FALSE;
    }
    latch->told = FALSE;
    bus_rig1_set_latched(latch->rig->object, FALSE);
    if (was_set)
        bus_rig_report(latch->rig, "info", "safe state", "released");
    return TRUE;
}
