/*
 * Threads that read frames next to the capture. In lockstep (drivers/clock.h) the main loop waits
 * for each of them, so that nothing overlaps, neither readers with each other nor with what the
 * main loop writes: their calls to the disk come in the same order in each run.
 */
#pragma once

#include "drivers/clock.h"

typedef struct Readers Readers;

Readers *readers_new(Clock *clock);
void readers_free(Readers *readers); /* jobs that have not begun are dropped; NULL is ignored */

/* Main loop's thread. Calls read (job) in a thread, and then, when it has been read or is not
 * wanted any more, drop (job). A job that fails changes nothing, and is kept. frame: what it reads;
 * copied. */
typedef gboolean (*ReadersRead)(gpointer job, GError **error);
void readers_push(Readers *readers, ReadersRead read, GDestroyNotify drop, gpointer job,
                  const char *frame);

/* In another thread: waits until all jobs are done. FALSE: jobs have failed; the first of the
 * errors. */
gboolean readers_wait(Readers *readers, GError **error);

/* Main loop's thread: the jobs that have failed are read once more. */
void readers_retry(Readers *readers);
/* Main loop's thread, while nothing is read: calls each for every job that has failed. */
void readers_each_failed(Readers *readers,
                         void (*each)(const char *frame, const GError *error, gpointer data),
                         gpointer data);

gboolean readers_stopped(const Readers *readers); /* by readers_stop(); any thread */
void readers_stop(Readers *readers);              /* jobs that have not begun are dropped */
