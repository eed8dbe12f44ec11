#include "bus_errors.h"
#include "bus_private.h"

#include <string.h>

/* The most calls of one client, and of all clients, that may wait for the main loop. The loop
 * handles all waiting calls in one turn, and a SafeState that arrives meanwhile waits until they
 * are done. */
#define MAX_OF_CLIENT 32
#define MAX_WAITING   128

/* SafeState looks every LOOK_MS, for ANSWER_US at most, whether the devices have answered. The
 * drivers of lasers and lamps have shorter deadlines. */
#define LOOK_MS   2
#define ANSWER_US (3 * G_USEC_PER_SEC)

struct waiting_call { /* a SafeState */
    GDBusConnection *connection;
    GDBusMessage *message;
};

/* The filter runs in GDBus's thread; all else in the main loop's. */
struct bus_queue {
    GMainContext *context;
    Bus *bus; /* main loop only; NULL: gone */
    GMutex lock;
    GHashTable *of_client; /* client to how many of its calls wait */
    int n_waiting;
    GQueue safe_calls; /* of struct waiting_call */
};

struct securing { /* devices that were commanded safe, and calls that wait for their answers */
    struct bus_queue *queue;
    GQueue calls; /* of struct waiting_call */
    gint64 until_us;
};

struct ticket { /* of a call that waits */
    struct bus_queue *queue;
    char *client;
};

static void call_free(gpointer data) {
    struct waiting_call *call = data;
    g_object_unref(call->connection);
    g_object_unref(call->message);
    g_free(call);
}

static void queue_clear(gpointer data) {
    struct bus_queue *queue = data;
    g_queue_clear_full(&queue->safe_calls, call_free);
    g_hash_table_unref(queue->of_client);
    g_mutex_clear(&queue->lock);
    g_main_context_unref(queue->context);
}

static void queue_unref(gpointer queue) {
    g_atomic_rc_box_release_full(queue, queue_clear);
}

static void ticket_free(gpointer data) {
    struct ticket *ticket = data;
    queue_unref(ticket->queue);
    g_free(ticket->client);
    g_free(ticket);
}

struct bus_queue *bus_queue_new(Bus *bus) {
    struct bus_queue *queue = g_atomic_rc_box_new0(struct bus_queue);
    queue->context = g_main_context_ref_thread_default();
    queue->bus = bus;
    queue->of_client = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_mutex_init(&queue->lock);
    g_queue_init(&queue->safe_calls);
    return queue;
}

void bus_queue_close(struct bus_queue *queue) {
    queue->bus = NULL;
    queue_unref(queue);
}

static void run_soon(struct bus_queue *queue, int priority, GSourceFunc func, gpointer data,
                     GDestroyNotify free_data) {
    g_autoptr(GSource) source = g_idle_source_new();
    g_source_set_priority(source, priority);
    g_source_set_callback(source, func, data, free_data);
    g_source_attach(source, queue->context);
}

/* body: floating, or NULL. Takes the error. */
static void reply(GDBusConnection *connection, GDBusMessage *message, GVariant *body,
                  GError *error) {
    g_autoptr(GDBusMessage) answer = NULL;
    if (error) {
        error = bus_errors_wrap(error);
        g_autofree char *name = g_dbus_error_encode_gerror(error);
        answer = g_dbus_message_new_method_error_literal(message, name, error->message);
        g_error_free(error);
    } else {
        answer = g_dbus_message_new_method_reply(message);
        if (body)
            g_dbus_message_set_body(answer, body);
    }
    if (!(g_dbus_message_get_flags(message) & G_DBUS_MESSAGE_FLAGS_NO_REPLY_EXPECTED))
        g_dbus_connection_send_message(connection, answer, G_DBUS_SEND_MESSAGE_FLAGS_NONE, NULL,
                                       NULL);
}

/* body: floating, or NULL. */
static void securing_answer(struct securing *securing, GVariant *body, const GError *error) {
    g_autoptr(GVariant) owned = body ? g_variant_ref_sink(body) : NULL;
    for (struct waiting_call *call; (call = g_queue_pop_head(&securing->calls)); call_free(call))
        reply(call->connection, call->message, owned, error ? g_error_copy(error) : NULL);
}

static void securing_free(gpointer data) {
    struct securing *securing = data;
    g_queue_clear_full(&securing->calls, call_free);
    queue_unref(securing->queue);
    g_free(securing);
}

static gboolean securing_look(gpointer data) {
    struct securing *securing = data;
    const Bus *bus = securing->queue->bus;
    enum device_safety safety;
    if (!bus || !bus->devices) {
        g_autoptr(GError) error = g_error_new_literal(
            BUS_ERROR, BUS_ERROR_CANCELLED,
            "the rig was closed before all devices had answered that they are safe: look at them");
        securing_answer(securing, NULL, error);
        return G_SOURCE_REMOVE;
    }
    g_autoptr(GVariant) devices = g_variant_ref_sink(devices_safety(bus->devices, &safety));
    if (safety == DEVICE_TOLD && g_get_monotonic_time() < securing->until_us)
        return G_SOURCE_CONTINUE;
    securing_answer(securing, g_variant_new("(b@a(sss))", safety == DEVICE_SAFE, devices), NULL);
    return G_SOURCE_REMOVE;
}

/* One safe state answers all who have asked for it meanwhile. */
static gboolean bus_queue_make_safe(gpointer data) {
    struct bus_queue *queue = data;
    struct securing *securing = g_new0(struct securing, 1);
    g_autoptr(GError) error = NULL;
    securing->queue = g_atomic_rc_box_acquire(queue);
    securing->until_us = g_get_monotonic_time() + ANSWER_US;
    g_mutex_lock(&queue->lock);
    securing->calls = queue->safe_calls;
    g_queue_init(&queue->safe_calls);
    g_mutex_unlock(&queue->lock);
    if (queue->bus)
        bus_make_safe(queue->bus, &error);
    else
        g_set_error_literal(&error, BUS_ERROR, BUS_ERROR_CANCELLED, "mesorigd ends");
    if (error)
        securing_answer(securing, NULL, error);
    if (error || !securing_look(securing)) {
        securing_free(securing);
        return G_SOURCE_REMOVE;
    }
    g_autoptr(GSource) source = g_timeout_source_new(LOOK_MS);
    g_source_set_priority(source, G_PRIORITY_HIGH);
    g_source_set_callback(source, securing_look, securing, securing_free);
    g_source_attach(source, queue->context);
    return G_SOURCE_REMOVE;
}

static void ask_for_safety(struct bus_queue *queue, GDBusConnection *connection,
                           GDBusMessage *message) {
    struct waiting_call *call = g_new(struct waiting_call, 1);
    *call = (struct waiting_call){g_object_ref(connection), message};
    g_mutex_lock(&queue->lock);
    const gboolean asked = !g_queue_is_empty(&queue->safe_calls);
    g_queue_push_tail(&queue->safe_calls, call);
    g_mutex_unlock(&queue->lock);
    if (!asked)
        run_soon(queue, G_PRIORITY_HIGH, bus_queue_make_safe, g_atomic_rc_box_acquire(queue),
                 queue_unref);
}

static gboolean is_safe_state(GDBusMessage *message) {
    const char *interface = g_dbus_message_get_interface(message);
    return g_strcmp0(g_dbus_message_get_member(message), "SafeState") == 0 &&
           g_strcmp0(g_dbus_message_get_path(message), BUS_PATH) == 0 &&
           (!interface || g_str_equal(interface, BUS_NAME)) &&
           !*g_dbus_message_get_signature(message);
}

/* How many calls of a client wait already, without this one; −1: the queue is full. */
static int bus_queue_enter(struct bus_queue *queue, const char *client) {
    g_mutex_lock(&queue->lock);
    int n = GPOINTER_TO_INT(g_hash_table_lookup(queue->of_client, client));
    if (queue->n_waiting >= MAX_WAITING) {
        n = -1;
    } else if (n < MAX_OF_CLIENT) {
        queue->n_waiting++;
        g_hash_table_insert(queue->of_client, g_strdup(client), GINT_TO_POINTER(n + 1));
    }
    g_mutex_unlock(&queue->lock);
    return n;
}

static gboolean bus_queue_leave(gpointer data) {
    const struct ticket *ticket = data;
    struct bus_queue *queue = ticket->queue;
    g_mutex_lock(&queue->lock);
    const int n = GPOINTER_TO_INT(g_hash_table_lookup(queue->of_client, ticket->client));
    queue->n_waiting--;
    if (n > 1)
        g_hash_table_insert(queue->of_client, g_strdup(ticket->client), GINT_TO_POINTER(n - 1));
    else
        g_hash_table_remove(queue->of_client, ticket->client);
    g_mutex_unlock(&queue->lock);
    return G_SOURCE_REMOVE;
}

/* Counts a call until the main loop takes it. GDBus passes each call to the main loop by an idle
 * source of the default priority; bus_queue_leave() is queued just before, at the same priority,
 * and so runs just before the call. */
static GDBusMessage *filter(GDBusConnection *connection, GDBusMessage *message, gboolean incoming,
                            gpointer data) {
    struct bus_queue *queue = data;
    if (!incoming || g_dbus_message_get_message_type(message) != G_DBUS_MESSAGE_TYPE_METHOD_CALL)
        return message;
    if (is_safe_state(message)) {
        ask_for_safety(queue, connection, message);
        return NULL;
    }
    /* The client by its unique bus name; a peer-to-peer client has none, so by its connection. */
    const char *sender = g_dbus_message_get_sender(message);
    g_autofree char *client =
        sender ? g_strdup(sender) : g_strdup_printf("%p", (gpointer)connection);
    const int n = bus_queue_enter(queue, client);
    if (n < 0 || n >= MAX_OF_CLIENT) {
        reply(connection, message, NULL,
              n < 0
                  ? g_error_new(BUS_ERROR, BUS_ERROR_LIMIT,
                                "%d calls of all clients are waiting, which is the most: try again",
                                MAX_WAITING)
                  : g_error_new(BUS_ERROR, BUS_ERROR_LIMIT,
                                "%d of your calls are waiting, which is the most: wait for their "
                                "answers",
                                MAX_OF_CLIENT));
        g_object_unref(message);
        return NULL;
    }
    struct ticket *ticket = g_new(struct ticket, 1);
    *ticket = (struct ticket){g_atomic_rc_box_acquire(queue), g_steal_pointer(&client)};
    run_soon(queue, G_PRIORITY_DEFAULT, bus_queue_leave, ticket, ticket_free);
    return message;
}

void bus_queue_guard(struct bus_queue *queue, GDBusConnection *connection) {
    g_dbus_connection_add_filter(connection, filter, g_atomic_rc_box_acquire(queue), queue_unref);
}
