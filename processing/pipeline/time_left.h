/* The remaining time of processing, over all of its stages. Costs are CPU time, which does not
 * depend on other programs. The speed at which the process gets CPU time is measured separately.
 * Pure functions, except the functions that load and save rates. */
#pragma once

#include <glib.h>

/* Kinds of work. The first two make views, in a pool of threads. The others follow after all views,
 * in one thread. */
enum time_left_work {
    TIME_LEFT_BTF,      /* unit: a million pixels of frames */
    TIME_LEFT_MDF,      /* unit: a million pixels of sweeps */
    TIME_LEFT_SETTLE,   /* unit: a million texels, times the number of views squared */
    TIME_LEFT_MDF_FILE, /* unit: a million texels, times the number of views */
    /* reading a BTF for eigen-maps; unit: a million texels, times the numbers of views and
     * lights */
    TIME_LEFT_COLUMNS,
    /* factoring the BTF and writing the eigen-maps; unit: that of TIME_LEFT_COLUMNS */
    TIME_LEFT_FACTORS,
    TIME_LEFT_CAUSES, /* finding out why little was measured; unit: a view of the BTF */
    TIME_LEFT_WORKS,
};
#define TIME_LEFT_STAGES TIME_LEFT_SETTLE

/* CPU time in seconds of a unit of each kind of work (enum time_left_work). */
struct time_left_rates {
    double unit_s[TIME_LEFT_WORKS];
};

/* Reads the rates of this user's earlier runs on this machine from a file in the user's cache. If
 * there is no such file, returns FALSE and gives the rates of one particular processor, which may
 * be wrong by a factor of two or three. */
gboolean time_left_rates_load(struct time_left_rates *ret);
/* Writes the rates that are above 0. Ignores failures, because the file is not necessary. */
void time_left_rates_save(const struct time_left_rates *rates);

struct time_left_made { /* measured work of one kind in a run */
    double cpu_s, units;
};
/* Updates the rates from the measurements of a run. A stored rate moves halfway to the measured one
 * if they differ by a factor of less than 1.5, as between runs of the same session. If they differ
 * by more, the stored rate is replaced.
 *
 * A run of less than 10 s of CPU time counts less, because a small session says little about a
 * large one. All kinds of work of a run count equally, so that a wrongly measured rate is corrected
 * by the next run. */
void time_left_rates_learn(struct time_left_rates *rates,
                           const struct time_left_made made[TIME_LEFT_WORKS]);

/* The work of one stage for one view. */
struct time_left_task {
    enum time_left_work stage;
    double theta_deg; /* views at one polar angle take a similar time */
    double units;
    enum { TIME_LEFT_WAITS, TIME_LEFT_RUNS, TIME_LEFT_MADE } state;
    double cpu_s; /* CPU time that the task took if it is made, or has taken so far if it runs */
};

/* Returns the seconds that n_threads, with a processor each, will need for all tasks that are not
 * made. tasks is in the order in which the threads take them. The time of a view is estimated from
 * the views that are made and from the rate. Views of similar elevations count more than others.
 * The rate has a fifth of the weight of a view at the same elevation. */
double time_left_views_s(const struct time_left_task *tasks, int n, int n_threads,
                         const struct time_left_rates *rates);

/* The recent speed of the process. All members must be 0 before use. */
struct time_left_speed {
    /* Decaying sums of CPU time, of the time for which threads had work (summed over the threads),
     * and of real time. */
    double cpu_s, thread_s, wall_s;
};
/* Adds a measurement: n_busy threads had work for wall_s, and used cpu_s together. elapsed_s is the
 * time since the beginning. A measurement that was made at the time t counts t / elapsed_s times as
 * much as one made now. In the first 3 s, the weight of a measurement falls by a factor of e in 3 s
 * instead. The weights fall slowly because other programs start and end: the next minutes resemble
 * the mean of all earlier minutes more than the last one. */
void time_left_speed_add(struct time_left_speed *speed, double wall_s, double cpu_s, int n_busy,
                         double elapsed_s);
/* Returns the CPU seconds per second that each of n threads will get, at most 1. It is assumed that
 * the process as a whole gets as much as recently. The number of threads that had work recently
 * does not matter, because schedulers divide processors among sessions and services, not among
 * threads. Returns 1 if nothing was measured. */
double time_left_speed_of(const struct time_left_speed *speed, int n);

/* Returns the k-th of n views in an order that spreads the views of a ring. Views of a ring take a
 * similar time, so that the first views predict the time of all. Each view occurs once. */
int time_left_view(int k, int n);
