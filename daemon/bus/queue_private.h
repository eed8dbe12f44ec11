/* The list (queue.c) and its file (queue_file.c). */
#pragma once

#include "queue.h"

struct Queue {
    char *path, *folder, *name; /* path of the file, its folder and its name in the folder */
    int lock;
    guint next_id;
    char *paused;
    GPtrArray *items;
};

/* Reads the file. A file that does not exist is an empty queue. Returns FALSE with an error if the
 * file cannot be used; items, next_id and paused may then hold a part of it. */
gboolean queue_file_read(Queue *queue, GError **error);
gboolean queue_file_write(const Queue *queue, GError **error);
