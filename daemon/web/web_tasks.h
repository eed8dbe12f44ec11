/*
 * The requests of clients that do more than show the state of the rig: session files and session
 * directories in one folder, files that are made of them, calibrations, the queue, lights by hand,
 * and pictures on request. A request is a path below /api/v1/, such as "files/weave/plan", with a
 * query such as "session=weave2". All functions belong to the main loop's thread.
 */
#pragma once

#include "web_task.h"

struct web_task_path {
    /* The path is the text `before`, then the name of the task, then the text `after`. If `after`
     * is NULL, the path is only `before`, and there is no name. */
    const char *before, *after;
    gboolean acts; /* TRUE: needs POST and the token; FALSE: GET without a token */
    void (*run)(const struct web_task *task);
};

/* Returns the entry of the table for a path, or NULL if there is none. *ret_name is the name in the
 * path; g_free(). */
const struct web_task_path *web_tasks_find(const char *path, char **ret_name);
