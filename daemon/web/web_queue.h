/* The tasks of the queue of sessions (web_task.h). The name of a task is the session's number in
 * the queue. */
#pragma once

#include "web_task.h"

void web_queue_pause(const struct web_task *task);
void web_queue_resume(const struct web_task *task);
void web_queue_remove(const struct web_task *task);
/* The query has the new place among the sessions that wait, from 1: place=2. */
void web_queue_move(const struct web_task *task);
