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

/* Reads the file. A file that does not exist is an empty queue. Returns FALSE if the file cannot be
 * read; items, next_id and paused may then hold a part of it. */
gboolean queue_file_read(Queue *queue, GError **error);
gboolean queue_file_write(const Queue *queue, GError **error);
