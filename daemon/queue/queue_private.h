/* The list (queue.c) and its file (queue_file.c). */
#pragma once

#include "queue.h"

struct Queue {
    char *path, *folder, *name; /* of the file */
    int lock;
    guint next_id;
    char *paused;
    GPtrArray *items;
};

/* FALSE: it cannot be read; items, next_id and paused may then hold a part of it. No file is an
 * empty queue. */
gboolean queue_file_read(Queue *queue, GError **error);
gboolean queue_file_write(const Queue *queue, GError **error);
