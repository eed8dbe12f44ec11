#include "course.h"

#include <pthread.h>
#include <sys/resource.h>
#include <time.h>

/* If some work takes longer than estimated, this share of the estimate is still assumed to be
 * left. */
#define MIN_LEFT 0.05
/* CPU time of work after the views; the speed of work that took less is not reliable */
#define LITTLE_S 0.5

struct course_task {
    struct time_left_task known;
    /* TIME_LEFT_WAITS, _RUNS or _MADE; written last by the thread that makes the task */
    gint state;
    clockid_t clock;
    double begun_s; /* CPU time of the thread when the task began */
};

struct Course {
    int n_threads;
    gboolean rates_known, idle; /* idle: whether MESORIG_TIME_LEFT is “idle” */
    struct time_left_rates rates;
    struct course_task *tasks;
    int n_tasks;
    /* work that this run has finished, not counting the elements of tasks */
    struct time_left_made made[TIME_LEFT_WORKS];
    double expected[TIME_LEFT_WORKS];
    int working; /* present work after the views, of enum time_left_work; −1 if there is none */
    double worked_s; /* CPU time of the process when the present work began */
    double share;    /* share of the present work that is done; 0 if unknown */
    struct time_left_speed speed;
    int n_busy; /* number of busy threads since the last measurement */
    gint64 begun_us, looked_us;
    double looked_cpu_s;
};

static double process_cpu_s(void) {
    struct rusage used;
    getrusage(RUSAGE_SELF, &used);
    return (double)(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
           (double)(used.ru_utime.tv_usec + used.ru_stime.tv_usec) / G_USEC_PER_SEC;
}

/* Returns the time of a thread's clock, or 0 if the thread has ended. */
static double clock_s(clockid_t clock) {
    struct timespec now;
    return clock_gettime(clock, &now) == 0 ? (double)now.tv_sec + (double)now.tv_nsec / 1e9 : 0;
}

Course *course_new(int n_threads) {
    Course *course = g_new0(Course, 1);
    course->n_threads = n_threads;
    course->rates_known = time_left_rates_load(&course->rates);
    course->idle = g_strcmp0(g_getenv("MESORIG_TIME_LEFT"), "idle") == 0;
    course->working = -1;
    course->n_busy = 1;
    course->begun_us = course->looked_us = g_get_monotonic_time();
    course->looked_cpu_s = process_cpu_s();
    return course;
}

/* Adds the times of the tasks to the measurements, and frees the tasks. */
static void drop_tasks(Course *course) {
    for (int i = 0; i < course->n_tasks; i++) {
        const struct course_task *task = &course->tasks[i];
        if (g_atomic_int_get(&task->state) != TIME_LEFT_MADE)
            continue;
        course->made[task->known.stage].cpu_s += task->known.cpu_s;
        course->made[task->known.stage].units += task->known.units;
    }
    g_clear_pointer(&course->tasks, g_free);
    course->n_tasks = 0;
}

void course_free(Course *course) {
    if (!course)
        return;
    drop_tasks(course);
    time_left_rates_learn(&course->rates, course->made);
    gboolean any = FALSE;
    for (int work = 0; work < TIME_LEFT_WORKS; work++)
        any |= course->made[work].units > 0;
    if (any)
        time_left_rates_save(&course->rates);
    g_free(course);
}

void course_set_tasks(Course *course, const struct time_left_task *tasks, int n) {
    drop_tasks(course);
    /* The speed before the first view is not typical, because files were searched for, often on a
     * disk. */
    if (course->speed.wall_s <= 0) {
        course->begun_us = course->looked_us = g_get_monotonic_time();
        course->looked_cpu_s = process_cpu_s();
        course->n_busy = CLAMP(n, 1, course->n_threads);
    }
    course->tasks = g_new0(struct course_task, n);
    course->n_tasks = n;
    for (int i = 0; i < n; i++)
        course->tasks[i].known = tasks[i];
}

void course_task_begin(Course *course, int task) {
    struct course_task *begun = &course->tasks[task];
    if (pthread_getcpuclockid(pthread_self(), &begun->clock) != 0)
        begun->clock = CLOCK_THREAD_CPUTIME_ID;
    begun->begun_s = clock_s(CLOCK_THREAD_CPUTIME_ID);
    g_atomic_int_set(&begun->state, TIME_LEFT_RUNS);
}

void course_task_end(Course *course, int task) {
    struct course_task *ended = &course->tasks[task];
    ended->known.cpu_s = clock_s(CLOCK_THREAD_CPUTIME_ID) - ended->begun_s;
    g_atomic_int_set(&ended->state, TIME_LEFT_MADE);
}

void course_expect(Course *course, enum time_left_work work, double units) {
    course->expected[work] = units;
}

void course_begin(Course *course, enum time_left_work work) {
    course->working = (int)work;
    course->share = 0;
    course->worked_s = process_cpu_s();
}

void course_advance(Course *course, double share) {
    course->share = CLAMP(share, 0, 1);
}

void course_end(Course *course, enum time_left_work work, gboolean whole) {
    if (whole && course->expected[work] > 0) {
        course->made[work].cpu_s += process_cpu_s() - course->worked_s;
        course->made[work].units += course->expected[work];
    }
    course->expected[work] = 0;
    course->working = -1;
}

/* Adds the CPU time that the process got since the last call to the measurement of the speed. In
 * this time course->n_busy threads were busy. n_busy is the number of busy threads from now on. */
static void look(Course *course, int n_busy) {
    const gint64 now_us = g_get_monotonic_time();
    const double wall_s = (double)(now_us - course->looked_us) / G_USEC_PER_SEC;
    const double elapsed_s = (double)(now_us - course->begun_us) / G_USEC_PER_SEC;
    const double cpu_s = process_cpu_s();
    time_left_speed_add(&course->speed, wall_s, cpu_s - course->looked_cpu_s, course->n_busy,
                        elapsed_s);
    course->looked_us = now_us;
    course->looked_cpu_s = cpu_s;
    course->n_busy = n_busy;
}

/* The CPU time that some work took, and the CPU time that the rates predict for this work. */
struct course_pace {
    double cpu_s, said_s;
};

static void pace_add(struct course_pace *pace, const Course *course, int work, double cpu_s,
                     double units) {
    pace->cpu_s += cpu_s;
    pace->said_s += units * course->rates.unit_s[work];
}

static double course_slower(const struct course_pace *pace) {
    return pace->said_s > 0 ? pace->cpu_s / pace->said_s : 1;
}

/* Returns the pace of views: the CPU time that they took, relative to the prediction of the rates.
 * The pace is not always 1, because processors differ, and because a processor that shares its
 * caches and units with other work is slower. Work of which nothing is measured yet is assumed to
 * have the pace of views. */
static struct course_pace views_pace(const Course *course, const struct time_left_task *tasks) {
    struct course_pace pace = {0};
    for (int stage = 0; stage < TIME_LEFT_STAGES; stage++)
        pace_add(&pace, course, stage, course->made[stage].cpu_s, course->made[stage].units);
    for (int i = 0; i < course->n_tasks; i++)
        if (tasks[i].state == TIME_LEFT_MADE)
            pace_add(&pace, course, (int)tasks[i].stage, tasks[i].cpu_s, tasks[i].units);
    return pace;
}

/* Returns the CPU time that the remaining work after the views will take. Once some of this work is
 * done, it has a pace of its own, because its single thread does not share a processor with a
 * second one. */
static double course_after_s(const Course *course, const struct course_pace *views) {
    struct course_pace pace = {0};
    const double slower = course_slower(views);
    /* The first part of this work may be slower or faster than the last, because the views of one
     * elevation are read one after the other. The present work therefore counts little while its
     * share is small. */
    const double weight = course->share * course->share;
    double done_s = 0, after_s = 0;
    for (int work = TIME_LEFT_STAGES; work < TIME_LEFT_WORKS; work++)
        pace_add(&pace, course, work, course->made[work].cpu_s, course->made[work].units);
    if (course->working >= 0) {
        done_s = process_cpu_s() - course->worked_s;
        pace_add(&pace, course, course->working, weight * done_s,
                 weight * course->share * course->expected[course->working]);
    }
    /* Adds LITTLE_S of work at the pace of views. Without it, a short measurement could change the
     * pace too much. */
    pace.cpu_s += LITTLE_S * slower;
    pace.said_s += LITTLE_S;
    for (int work = TIME_LEFT_STAGES; work < TIME_LEFT_WORKS; work++) {
        const double all_s =
            course_slower(&pace) * course->rates.unit_s[work] * course->expected[work];
        if (work != course->working)
            after_s += all_s;
        /* the more of the present work is done, the more its own pace counts */
        else if (course->share > 0)
            after_s +=
                (1 - course->share) * (weight * done_s / course->share + (1 - weight) * all_s);
        else
            after_s += MAX(all_s - done_s, MIN_LEFT * all_s);
    }
    return after_s;
}

double course_left_s(Course *course) {
    g_autofree struct time_left_task *tasks = g_new0(struct time_left_task, course->n_tasks + 1);
    int left[TIME_LEFT_STAGES] = {0}, made[TIME_LEFT_STAGES] = {0}, running = 0, waiting = 0;
    for (int i = 0; i < course->n_tasks; i++) {
        const struct course_task *task = &course->tasks[i];
        const int state = g_atomic_int_get(&task->state);
        tasks[i].stage = task->known.stage;
        tasks[i].theta_deg = task->known.theta_deg;
        tasks[i].units = task->known.units;
        tasks[i].state = state;
        tasks[i].cpu_s = state == TIME_LEFT_MADE ? task->known.cpu_s : 0;
        if (state == TIME_LEFT_RUNS)
            tasks[i].cpu_s = MAX(clock_s(task->clock) - task->begun_s, 0);
        (state == TIME_LEFT_MADE ? made : left)[task->known.stage]++;
        running += state == TIME_LEFT_RUNS;
        waiting += state == TIME_LEFT_WAITS;
    }
    /* A thread that has just finished a view and has not yet taken the next one also counts as
     * busy. */
    const int n = CLAMP(running + waiting, 1, course->n_threads);
    look(course, n);
    for (int stage = 0; stage < TIME_LEFT_STAGES; stage++)
        if (left[stage] > 0 && made[stage] == 0 && course->made[stage].units == 0 &&
            !course->rates_known)
            return -1;
    const struct course_pace pace = views_pace(course, tasks);
    struct time_left_rates rates = course->rates;
    for (int stage = 0; stage < TIME_LEFT_STAGES; stage++)
        rates.unit_s[stage] *= course_slower(&pace);
    const double after_s = course_after_s(course, &pace);
    const double views_s = time_left_views_s(tasks, course->n_tasks, course->n_threads, &rates);
    if (course->idle)
        return views_s + after_s;
    return views_s / time_left_speed_of(&course->speed, n) +
           after_s / time_left_speed_of(&course->speed, 1);
}
