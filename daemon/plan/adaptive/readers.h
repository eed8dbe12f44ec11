/*
 * Threads that read frames during a capture. In lockstep (drivers/clock.h) the main loop waits for
 * each job. Jobs then overlap neither each other nor the writing of the main loop, and calls to the
 * disk come in the same order in each run.
 */
#pragma once

#include "drivers/clock.h"

typedef struct Readers Readers;

Readers *readers_new(Clock *clock);
/* drops jobs that have not begun, and waits for the others; NULL is ignored */
void readers_free(Readers *readers);

/* Calls read(job) in a thread, and drop(job) when the job has succeeded or was dropped. A job that
 * fails must change nothing, because it is kept for readers_retry(). frame is the name of the file
 * that the job reads, and is copied. To be called in the main loop's thread. */
typedef gboolean (*ReadersRead)(gpointer job, GError **error);
void readers_push(Readers *readers, ReadersRead read, GDestroyNotify drop, gpointer job,
                  const char *frame);

/* Waits until all jobs are done. Returns FALSE with the first error if jobs have failed. */
gboolean readers_wait(Readers *readers, GError **error);

/* Waits until no job is running, and starts the failed jobs again. To be called in the main loop's
 * thread. */
void readers_retry(Readers *readers);
/* Calls the function `each` once for every job that has failed. No job may be running. To be called
 * in the main loop's thread. */
void readers_each_failed(Readers *readers,
                         void (*each)(const char *frame, const GError *error, gpointer data),
                         gpointer data);

void readers_stop(Readers *readers); /* drops jobs that have not begun */
/* Returns whether readers_stop() was called. Any thread may call this function. */
gboolean readers_stopped(const Readers *readers);
