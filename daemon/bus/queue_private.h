/* The list (queue.c) and its file (queue_file.c). */
#pragma once

#include "queue.h"

struct Queue {
    char *path, *folder, *name; /* folder and name are the parts of path */
    int lock;                   /* file descriptor of FILE.lock, which is locked */
    guint next_id;
    char *paused;     /* reason why the queue is paused; NULL if it is not */
    GPtrArray *items; /* of struct queue_item, in the order of the queue */
};

/* Reads the file. A file that does not exist is an empty queue. Returns FALSE with an error if the
 * file cannot be used; items, next_id and paused may then hold a part of it. */
gboolean queue_file_read(Queue *queue, GError **error);
/* Replaces the file by a new one, which is synced. Returns FALSE with an error if the file cannot
 * be written or would exceed QUEUE_MAX_BYTES. The file then keeps its old contents. */
gboolean queue_file_write(const Queue *queue, GError **error);
