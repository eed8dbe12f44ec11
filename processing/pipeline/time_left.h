/*
 * How long processing will still take, over all of its stages. Costs are CPU time, which other
 * programs do not change; how fast the processor gives it is measured beside it. Pure functions,
 * but for those of rates.
 */
#pragma once

#include <glib.h>

/* Kinds of work. The first two make views, in a pool of threads; the others follow after all views,
 * in one thread. */
enum time_left_work {
    TIME_LEFT_BTF,      /* a unit: a million pixels of frames */
    TIME_LEFT_MDF,      /* the same, of sweeps */
    TIME_LEFT_SETTLE,   /* a million texels, times the number of views squared */
    TIME_LEFT_MDF_FILE, /* a million texels, times views */
    TIME_LEFT_COLUMNS,  /* a million texels, times views and lights: reading a BTF for eigen-maps */
    TIME_LEFT_FACTORS,  /* the same: factoring it and writing them */
    TIME_LEFT_CAUSES,   /* a view of the BTF: why little was measured, if anything */
    TIME_LEFT_WORKS,
};
#define TIME_LEFT_STAGES TIME_LEFT_SETTLE

/* CPU time of a unit, s. */
struct time_left_rates {
    double unit_s[TIME_LEFT_WORKS];
};

/* Reads the rates of this user's earlier runs on this machine from a file in the user's cache.
 * FALSE: there is none; the rates are then those of one processor, which may be off by a factor of
 * two or three. */
gboolean time_left_rates_load(struct time_left_rates *ret);
/* Writes the rates that are above 0. Ignores failures, since the file is useful but not
 * necessary. */
void time_left_rates_save(const struct time_left_rates *rates);

struct time_left_made { /* of one kind of work, in a run */
    double cpu_s, units;
};
/* Learns from what a run has measured. A rate that differs from the measured one by less than a
 * factor of 1.5, as between runs of the same session, moves halfway to it; one that differs more is
 * replaced. A run of less than 10 s of CPU time counts less, since a small session says little
 * about a large one. All kinds of work of a run count alike, so that a wrongly measured rate is
 * right again after the next run. */
void time_left_rates_learn(struct time_left_rates *rates,
                           const struct time_left_made made[TIME_LEFT_WORKS]);

/* A view of a stage, in the order in which threads take them. */
struct time_left_task {
    enum time_left_work stage;
    double theta_deg; /* views of one elevation take similarly long */
    double units;
    enum { TIME_LEFT_WAITS, TIME_LEFT_RUNS, TIME_LEFT_MADE } state;
    double cpu_s; /* what it took (made), or has taken (runs) */
};

/* How long n_threads that have a processor each will need for all tasks that are not made, s. The
 * time of a view is estimated from the views that are made, of which nearer elevations count more,
 * and from the rate, which counts as a fifth of a view. */
double time_left_views_s(const struct time_left_task *tasks, int n, int n_threads,
                         const struct time_left_rates *rates);

/* How fast the process has been lately; zeroed at first. */
struct time_left_speed {
    /* Decaying sums of CPU time, of the time for which threads had work, and of real time. */
    double cpu_s, thread_s, wall_s;
};
/* n_busy threads had work for wall_s, and used cpu_s together. elapsed_s: since the beginning. A
 * measurement at the time t counts t / elapsed_s times as much as one made now (within the first 3
 * s its weight falls by a factor e in 3 s). Other programs come and go, so that the next minutes
 * resemble the mean of all minutes before more than the last one. */
void time_left_speed_add(struct time_left_speed *speed, double wall_s, double cpu_s, int n_busy,
                         double elapsed_s);
/* The CPU seconds per second that each of n threads will get, at most 1, if the process as a whole
 * gets as much as it did lately. How many threads had work then does not matter, because schedulers
 * divide processors among sessions and services, not among threads. 1: nothing was measured. */
double time_left_speed_of(const struct time_left_speed *speed, int n);

/* The k-th of n views in an order that spreads the views of a ring, which take similarly long: the
 * first ones then tell how long all will take. Each view comes once. */
int time_left_view(int k, int n);
