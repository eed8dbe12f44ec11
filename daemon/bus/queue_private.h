/* The list (queue.c) and its file (queue_file.c). */
#pragma once

#include "queue.h"

struct Queue {
    char *path, *folder, *name; /* path of the file; folder and name are its parts */
    int lock;                   /* file descriptor of FILE.lock, which this process has locked */
    guint next_id;
    char *paused;     /* reason why the queue is paused; NULL if it is not */
    GPtrArray *items; /* of struct queue_item, in the order of the queue */
};

/* Reads the file. If the file does not exist, the queue is empty. Returns FALSE with an error if
 * the file cannot be used. items, next_id and paused may then have a part of the contents. */
gboolean queue_file_read(Queue *queue, GError **error);
/* Replaces the file by a new one and syncs it. Returns FALSE with an error if the file cannot be
 * written or would exceed QUEUE_MAX_BYTES. The file then keeps its old contents. */
gboolean queue_file_write(const Queue *queue, GError **error);
