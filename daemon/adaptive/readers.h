/*
 * Threads that read frames beside the capture. In lockstep (drivers/clock.h) the main loop waits
 * for each of them, so that nothing overlaps, neither readers with each other nor with what the
 * main loop writes: their calls to the disk come in the same order in each run.
 */
#pragma once

#include "drivers/clock.h"

typedef struct Readers Readers;

Readers *readers_new(Clock *clock);
void readers_free(Readers *readers); /* jobs that have not begun are dropped; NULL is ignored */

/* Main loop's thread. Calls read (job) in a thread, and then, read or not, drop (job). */
typedef gboolean (*ReadersRead)(gpointer job, GError **error);
void readers_push(Readers *readers, ReadersRead read, GDestroyNotify drop, gpointer job);

/* In another thread: waits until all jobs are done. FALSE: a job failed since the last call; the
 * first of the errors. */
gboolean readers_wait(Readers *readers, GError **error);

gboolean readers_stopped(const Readers *readers); /* by readers_stop(); any thread */
void readers_stop(Readers *readers);              /* jobs that have not begun are dropped */
