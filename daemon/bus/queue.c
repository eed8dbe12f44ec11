#include "queue_private.h"

#include <errno.h>
#include <gio/gio.h>
#include <stdio.h>
#include <string.h>

#include "base/file_lock.h"

/* Maximum number of ended sessions in the list. If there are more when a session is added, the
 * oldest are removed. */
#define MAX_ENDED 100

const char *const queue_state_names[QUEUE_STATES] = {
    [QUEUE_WAITING] = "waiting", [QUEUE_HANDS] = "hands", [QUEUE_TRYING] = "trying",
    [QUEUE_BEGUN] = "begun",     [QUEUE_DONE] = "done",   [QUEUE_STOPPED] = "stopped",
};

static gboolean has_ended(const struct queue_item *item) {
    return item->state >= QUEUE_DONE;
}

struct queue_item *queue_item_new(void) {
    struct queue_item *item = g_new0(struct queue_item, 1);
    char **const strings[] = {
        &item->name,   &item->session_path, &item->session_text,     &item->directory,
        &item->rig,    &item->calibration,  &item->calibration_text, &item->prompt,
        &item->chosen, &item->message};
    for (gsize i = 0; i < G_N_ELEMENTS(strings); i++)
        *strings[i] = g_strdup("");
    item->groups = g_array_new(FALSE, FALSE, sizeof(guint32));
    return item;
}

void queue_item_free(struct queue_item *item) {
    if (!item)
        return;
    char *const strings[] = {
        item->name,   item->session_path, item->session_text,     item->directory,
        item->rig,    item->calibration,  item->calibration_text, item->prompt,
        item->chosen, item->message};
    for (gsize i = 0; i < G_N_ELEMENTS(strings); i++)
        g_free(strings[i]);
    g_array_unref(item->groups);
    g_free(item);
}

/* Renames the file, which cannot be used, so that a user can examine it. Empties the list and
 * pauses the queue. */
static void set_aside(Queue *queue, const GError *why) {
    g_autofree char *damaged = g_strconcat(queue->path, ".damaged", NULL);
    const gboolean kept = rename(queue->path, damaged) == 0;
    g_ptr_array_set_size(queue->items, 0);
    g_free(queue->paused);
    queue->paused =
        kept
            ? g_strdup_printf("the queue's file could not be used, and was renamed to %s: %s; add "
                              "its sessions again, then mesorig queue resume",
                              damaged, why->message)
            : g_strdup_printf("the queue's file cannot be used, and could not be renamed (%s): %s; "
                              "move the file away, add its sessions again, then mesorig queue "
                              "resume",
                              g_strerror(errno), why->message);
}

Queue *queue_open(const char *path, GError **error) {
    g_autofree char *lock_path = NULL;
    g_autoptr(GError) why = NULL;
    const int lock = file_lock_take_output(path, &lock_path, error);
    if (lock < 0)
        return NULL;
    Queue *queue = g_new0(Queue, 1);
    queue->path = g_strdup(path);
    queue->folder = g_path_get_dirname(path);
    queue->name = g_path_get_basename(path);
    queue->lock = lock;
    queue->next_id = 1;
    queue->items = g_ptr_array_new_with_free_func((GDestroyNotify)queue_item_free);
    if (!queue_file_read(queue, &why))
        set_aside(queue, why);
    return queue;
}

void queue_free(Queue *queue) {
    if (!queue)
        return;
    g_autofree char *lock_path = g_strconcat(queue->path, ".lock", NULL);
    file_lock_give(queue->lock, lock_path);
    g_ptr_array_unref(queue->items);
    g_free(queue->paused);
    g_free(queue->path);
    g_free(queue->folder);
    g_free(queue->name);
    g_free(queue);
}

const GPtrArray *queue_items(const Queue *queue) {
    return queue->items;
}

struct queue_item *queue_find(const Queue *queue, guint id, GError **error) {
    for (guint i = 0; i < queue->items->len; i++) {
        struct queue_item *item = queue->items->pdata[i];
        if (item->id == id)
            return item;
    }
    g_set_error(
        error, G_IO_ERROR, G_IO_ERROR_NOT_FOUND,
        "the queue has no session %u: “mesorig queue list” shows the numbers of its sessions", id);
    return NULL;
}

struct queue_item *queue_next(const Queue *queue) {
    for (guint i = 0; i < queue->items->len; i++) {
        struct queue_item *item = queue->items->pdata[i];
        if (!has_ended(item))
            return item;
    }
    return NULL;
}

const char *queue_paused(const Queue *queue) {
    return queue->paused;
}

gboolean queue_pause(Queue *queue, const char *why, GError **error) {
    g_autofree char *before = queue->paused;
    queue->paused = g_strdup(why);
    if (queue_file_write(queue, error))
        return TRUE;
    if (why)
        return FALSE; /* although this failed, the queue is paused until this program ends */
    g_free(queue->paused);
    queue->paused = g_steal_pointer(&before);
    return FALSE;
}

gboolean queue_add(Queue *queue, struct queue_item *item, GError **error) {
    g_autoptr(QueueItem) taken = item;
    guint n_ended = 0;
    for (guint i = 0; i < queue->items->len; i++) {
        const struct queue_item *other = queue->items->pdata[i];
        n_ended += has_ended(other);
        if (has_ended(other) || strcmp(other->directory, item->directory) != 0)
            continue;
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_EXISTS,
                    "session %u of the queue has the directory %s: choose another directory",
                    other->id, item->directory);
        return FALSE;
    }
    if (queue->items->len - n_ended >= QUEUE_MAX - MAX_ENDED) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_NO_SPACE,
                    "%d sessions wait in the queue, which is the maximum: wait until one has "
                    "ended, or remove one",
                    QUEUE_MAX - MAX_ENDED);
        return FALSE;
    }
    item->id = queue->next_id++;
    g_ptr_array_add(queue->items, g_steal_pointer(&taken));
    if (queue_file_write(queue, error)) {
        while (n_ended-- > MAX_ENDED)
            g_ptr_array_remove_index(queue->items,
                                     0); /* the next change also writes this removal */
        return TRUE;
    }
    queue->next_id--;
    g_ptr_array_set_size(queue->items, (int)queue->items->len - 1);
    return FALSE;
}

/* Returns TRUE if a session may be removed or moved, because it waits or has ended. Returns FALSE
 * with an error if the session is being captured, or if its test shots are being taken. `what` is
 * the refused action for the message: "removed" or "moved". */
static gboolean is_still(const struct queue_item *item, const char *what, GError **error) {
    if (item->state == QUEUE_WAITING || item->state == QUEUE_HANDS || has_ended(item))
        return TRUE;
    g_set_error(error, G_IO_ERROR, G_IO_ERROR_BUSY,
                "session %u cannot be %s, because it %s: end it first with “mesorig abort”",
                item->id, what,
                item->state == QUEUE_BEGUN ? "is being captured" : "is about to begin");
    return FALSE;
}

gboolean queue_remove(Queue *queue, guint id, GError **error) {
    struct queue_item *item = queue_find(queue, id, error);
    guint place;
    if (!item || !is_still(item, "removed", error) || !g_ptr_array_find(queue->items, item, &place))
        return FALSE;
    g_autoptr(QueueItem) removed = g_ptr_array_steal_index(queue->items, place);
    if (queue_file_write(queue, error))
        return TRUE;
    g_ptr_array_insert(queue->items, (int)place, g_steal_pointer(&removed));
    return FALSE;
}

gboolean queue_move(Queue *queue, guint id, guint place, GError **error) {
    struct queue_item *item = queue_find(queue, id, error);
    guint from, to = 0;
    if (!item || !is_still(item, "moved", error) || !g_ptr_array_find(queue->items, item, &from))
        return FALSE;
    if (has_ended(item) || place < 1) {
        g_set_error(error, G_IO_ERROR, G_IO_ERROR_INVALID_ARGUMENT,
                    has_ended(item)
                        ? "session %u cannot be moved, because it has ended: add it again"
                        : "session %u cannot be moved to place 0: places begin with 1",
                    id);
        return FALSE;
    }
    g_ptr_array_steal_index(queue->items, from);
    for (; to < queue->items->len; to++) {
        const struct queue_item *other = queue->items->pdata[to];
        const gboolean waits = other->state == QUEUE_WAITING || other->state == QUEUE_HANDS;
        if (waits && --place == 0)
            break;
    }
    g_ptr_array_insert(queue->items, (int)to, item);
    if (queue_file_write(queue, error))
        return TRUE;
    g_ptr_array_steal_index(queue->items, to);
    g_ptr_array_insert(queue->items, (int)from, item);
    return FALSE;
}

gboolean queue_set(Queue *queue, struct queue_item *item, enum queue_state state,
                   const char *message, GError **error) {
    char *before = item->message;
    item->message = g_strdup(message ? message : "");
    g_free(before);
    item->state = state;
    if (has_ended(item)) {
        /* The session is put behind the sessions that have ended before it, and in front of those
         * that wait. */
        guint from, to = 0;
        g_ptr_array_find(queue->items, item, &from);
        g_ptr_array_steal_index(queue->items, from);
        while (to < queue->items->len && has_ended(queue->items->pdata[to]))
            to++;
        g_ptr_array_insert(queue->items, (int)to, item);
    }
    return queue_file_write(queue, error);
}
