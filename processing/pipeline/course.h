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
/* Keeps what this run has measured for the next ones (time_left_rates_save()). NULL is ignored. */
void course_free(Course *course);

/* Sets the views to be made from now on, in the order in which threads take them; copied. Views
 * made earlier still count as measured. */
void course_set_tasks(Course *course, const struct time_left_task *tasks, int n);
/* To be called in the thread that makes the task. task: its number in that order. */
void course_task_begin(Course *course, int task);
void course_task_end(Course *course, int task);

/* Announces work that is to follow the views in one thread; 0 units: none of this kind. */
void course_expect(Course *course, enum time_left_work work, double units);
/* share, 0 … 1: how much of the work now under way after the views is done. From then on the pace
 * of this work counts, too. */
void course_advance(Course *course, double share);
/* Work after the views begins, or has ended; no more of this kind is expected then. whole: it was
 * not cut short, so that its time says how long such work takes. */
void course_begin(Course *course, enum time_left_work work);
void course_end(Course *course, enum time_left_work work, gboolean whole);

/* The seconds that all the remaining work will take, with the share of the processors that the
 * process got lately. −1: not known yet, since neither this run nor an earlier one has measured
 * such work. With MESORIG_TIME_LEFT=idle in the environment, the time if each thread had a
 * processor for itself, which can be compared with CPU time on a busy machine
 * (tests/bench/time_left). */
double course_left_s(Course *course);
