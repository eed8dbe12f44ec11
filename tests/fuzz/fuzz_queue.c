/* The file of the queue of sessions. A queue that was read is written and read again, and is the
 * same. */
#include "fuzz.h"

#include "bus/queue.h"

#include <glib/gstdio.h>
#include <sys/stat.h>

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    const char *path = fuzz_file_in_folder("queue", data, size);
    GError *error = NULL;
    Queue *queue = queue_open(path, &error);
    fuzz_check(queue != NULL, &error);
    if (!queue)
        return 0;
    const guint n = queue_items(queue)->len;
    queue_next(queue);
    if (n > 0) {
        const gboolean paused = queue_paused(queue) != NULL;
        g_assert_true(queue_pause(queue, paused ? NULL : "fuzz", &error));
        queue_free(queue);
        queue = queue_open(path, &error);
        g_assert_no_error(error);
        g_assert_cmpuint(queue_items(queue)->len, ==, n);
        g_assert_true(paused == (queue_paused(queue) == NULL));
    }
    queue_free(queue);
    g_autofree char *kept = g_strconcat(path, ".damaged", NULL);
    g_unlink(kept);
    return 0;
}
