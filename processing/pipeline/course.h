/*
 * How far a run of the pipeline has come, and how long it will still take: it measures the CPU time
 * of views and of what follows them, and how much of it the process gets. One thread uses it, but
 * for course_task_begin() and course_task_end().
 */
#pragma once

#include "time_left.h"

typedef struct Course Course;

/* n_threads make views. */
Course *course_new(int n_threads);
/* What this run has measured is kept for the next ones (time_left_rates_save()). NULL is ignored.
 */
void course_free(Course *course);

/* The views to be made from now on, in the order in which threads take them; copied. Those of
 * before still count as measured. */
void course_set_tasks(Course *course, const struct time_left_task *tasks, int n);
/* In the thread that makes the task: its number in that order. */
void course_task_begin(Course *course, int task);
void course_task_end(Course *course, int task);

/* What is to follow the views in one thread, and how much of it; 0 units: nothing. */
void course_expect(Course *course, enum time_left_work work, double units);
/* What share of the work under way after the views is done, 0 … 1: then its own pace counts, too.
 */
void course_advance(Course *course, double share);
/* It begins, and has ended: then no more of it is expected. whole: it was not cut short, so that it
 * says how long such work takes. */
void course_begin(Course *course, enum time_left_work work);
void course_end(Course *course, enum time_left_work work, gboolean whole);

/* Of everything, s, with the share of the processors that the process got lately. −1: not known
 * yet, since neither this run nor an earlier one has measured what is left. With
 * MESORIG_TIME_LEFT=idle in the environment, as if each thread had a processor for itself: that can
 * be held against CPU time where other programs are at work, too (tests/bench/time_left). */
double course_left_s(Course *course);
