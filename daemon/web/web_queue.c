#include "web_queue.h"

#include <libsoup/soup.h>

void web_queue_pause(const struct web_task *task) {
    web_task_call(task, "QueuePause", NULL, NULL);
}

void web_queue_resume(const struct web_task *task) {
    web_task_call(task, "QueueResume", NULL, NULL);
}

/* Reads a number of at least 1. If the text is not such a number, answers the task and returns
 * FALSE. */
static gboolean read_number(const struct web_task *task, const char *text, guint status,
                            const char *why, guint *ret) {
    guint64 number;
    const gboolean ok = text && g_ascii_string_to_unsigned(text, 10, 1, G_MAXUINT, &number, NULL);
    if (ok)
        *ret = (guint)number;
    else
        web_task_refuse(task, status, why);
    return ok;
}

static gboolean read_session(const struct web_task *task, guint *ret) {
    return read_number(task, task->name, SOUP_STATUS_NOT_FOUND,
                       "a session of the queue has a number from 1 on: /api/v1/state lists them",
                       ret);
}

void web_queue_remove(const struct web_task *task) {
    guint number;
    if (read_session(task, &number))
        web_task_call(task, "QueueRemove", g_variant_new("(u)", number), NULL);
}

void web_queue_move(const struct web_task *task) {
    guint number, place;
    if (read_session(task, &number) &&
        read_number(task, web_task_value(task, "place"), SOUP_STATUS_BAD_REQUEST,
                    "the query needs the place among the sessions that wait, such as ?place=1",
                    &place))
        web_task_call(task, "QueueMove", g_variant_new("(uu)", number, place), NULL);
}
