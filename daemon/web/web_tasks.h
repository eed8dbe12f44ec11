/*
 * The requests of clients that are more than to look at the rig: session files and session
 * directories in one folder, files that are made of them, calibrations, the queue, lights by hand,
 * and pictures on request. A request is a path below /api/v1/, such as "files/weave/plan", with a
 * query such as "session=weave2". All functions belong to the main loop's thread.
 */
#pragma once

#include "web_task.h"

struct web_task_path {
    const char *before, *after; /* the path is before, name, after; without name if after is NULL */
    gboolean acts;              /* needs POST and the token; otherwise GET without a token */
    void (*run)(const struct web_task *task);
};

/* Returns the entry of the table for a path, or NULL if there is none. *ret_name is the name in the
 * path; g_free(). */
const struct web_task_path *web_tasks_find(const char *path, char **ret_name);
