#include "bus_queue.h"

#include "bus_errors.h"
#include "bus_reply.h"

#include <string.h>

/* Maximum number of waiting calls of one client, and of all clients together. They are limited
 * because the main loop handles all waiting calls in one iteration. If SafeState arrives during
 * this iteration, the devices are commanded only at its end. */
#define MAX_OF_CLIENT 32
#define MAX_WAITING   128

/* The lock guards of_client and n_waiting, because filter() and enter() run in GDBus's thread. All
 * other functions run in the main loop's thread. */
struct bus_queue {
    GMainContext *context;
    struct bus_latch *latch;
    GMutex lock;
    GHashTable *of_client; /* maps a client to the number of its waiting calls */
    int n_waiting;
};

struct ticket { /* a call that waits */
    struct bus_queue *queue;
    char *client;
};

static void queue_clear(gpointer data) {
    struct bus_queue *queue = data;
    bus_latch_unref(queue->latch);
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

struct bus_queue *bus_queue_new(struct bus_latch *latch) {
    struct bus_queue *queue = g_atomic_rc_box_new0(struct bus_queue);
    queue->context = g_main_context_ref_thread_default();
    queue->latch = bus_latch_ref(latch);
    queue->of_client = g_hash_table_new_full(g_str_hash, g_str_equal, g_free, NULL);
    g_mutex_init(&queue->lock);
    return queue;
}

void bus_queue_close(struct bus_queue *queue) {
    queue_unref(queue);
}

static void run_soon(struct bus_queue *queue, int priority, GSourceFunc func, gpointer data,
                     GDestroyNotify free_data) {
    g_autoptr(GSource) source = g_idle_source_new();
    g_source_set_priority(source, priority);
    g_source_set_callback(source, func, data, free_data);
    g_source_attach(source, queue->context);
}

/* Counts a call that arrives, if neither its client nor the queue has too many waiting calls.
 * Returns the number of earlier waiting calls of the client. If this number is MAX_OF_CLIENT, or if
 * the result is −1 because the whole queue is full, the call is not counted and must be refused. */
static int enter(struct bus_queue *queue, const char *client) {
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

static gboolean leave(gpointer data) {
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

/* Filters the messages of a connection. SafeState is passed to the latch. A call beyond the limits
 * above is refused. Any other call is counted until the main loop handles it.
 *
 * GDBus passes a call to the main loop by an idle source of the default priority. The source of
 * leave() has the same priority and is attached just before it. leave() therefore runs just before
 * the call is handled. */
static GDBusMessage *filter(GDBusConnection *connection, GDBusMessage *message, gboolean incoming,
                            gpointer data) {
    struct bus_queue *queue = data;
    if (!incoming || g_dbus_message_get_message_type(message) != G_DBUS_MESSAGE_TYPE_METHOD_CALL)
        return message;
    if (bus_latch_take(queue->latch, connection, message))
        return NULL;
    /* On a message bus, a client is identified by its unique bus name. On a peer-to-peer connection
     * there is no such name, and the client is identified by the connection. */
    const char *sender = g_dbus_message_get_sender(message);
    g_autofree char *client =
        sender ? g_strdup(sender) : g_strdup_printf("%p", (gpointer)connection);
    const int n = enter(queue, client);
    if (n < 0 || n >= MAX_OF_CLIENT) {
        bus_reply(
            connection, message, NULL,
            n < 0
                ? g_error_new(
                      BUS_ERROR, BUS_ERROR_LIMIT,
                      "%d calls of all clients are waiting, which is the maximum: try again",
                      MAX_WAITING)
                : g_error_new(
                      BUS_ERROR, BUS_ERROR_LIMIT,
                      "%d of your calls are waiting, which is the maximum: wait for their answers",
                      MAX_OF_CLIENT));
        g_object_unref(message);
        return NULL;
    }
    struct ticket *ticket = g_new(struct ticket, 1);
    *ticket = (struct ticket){g_atomic_rc_box_acquire(queue), g_steal_pointer(&client)};
    run_soon(queue, G_PRIORITY_DEFAULT, leave, ticket, ticket_free);
    return message;
}

void bus_queue_guard(struct bus_queue *queue, GDBusConnection *connection) {
    g_dbus_connection_add_filter(connection, filter, g_atomic_rc_box_acquire(queue), queue_unref);
}
