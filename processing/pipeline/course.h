/* The progress of a run of the pipeline, and its remaining time. A course measures the CPU time of
 * views and of the work after the views, and the share of the processors that the process gets. All
 * functions are called by one thread. Only course_task_begin() and course_task_end() are called by
 * the thread that makes the task. */
#pragma once

#include "time_left.h"

typedef struct Course Course;

/* n_threads is the number of threads that make views. */
Course *course_new(int n_threads);
/* Stores the measurements of this run for the next runs (time_left_rates_save()). NULL is
 * ignored. */
void course_free(Course *course);

/* Sets the views to be made from now on, in the order in which threads take them. The array is
 * copied. Views that were made earlier still count as measured. */
void course_set_tasks(Course *course, const struct time_left_task *tasks, int n);
/* course_task_begin() reports that a task begins, and course_task_end() that it has ended. Call
 * them in the thread that makes the task. task is the index of the task in course_set_tasks(). */
void course_task_begin(Course *course, int task);
void course_task_end(Course *course, int task);

/* Announces work of one kind after the views, in one thread. 0 units mean that there is none. */
void course_expect(Course *course, enum time_left_work work, double units);
/* Reports which share, 0 … 1, of the present work after the views is done. From then on, the speed
 * of this work is included in the remaining time. */
void course_advance(Course *course, double share);
/* course_begin() reports that work after the views begins, and course_end() that it has ended.
 * After course_end(), no more work of this kind is expected. `whole` is TRUE if the work was
 * complete, so that its time can be used for predictions. */
void course_begin(Course *course, enum time_left_work work);
void course_end(Course *course, enum time_left_work work, gboolean whole);

/* Returns the seconds that all the remaining work will take, with the share of the processors that
 * the process got recently. Returns −1 if neither this run nor an earlier one has measured such
 * work.
 *
 * If the environment variable MESORIG_TIME_LEFT is "idle", returns the time that the work would
 * take if each thread had a processor for itself. That time can be compared with CPU time on a busy
 * machine (tests/bench/time_left). */
double course_left_s(Course *course);
