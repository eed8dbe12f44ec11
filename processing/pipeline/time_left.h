/* How long processing will still take, over all of its stages. Pure functions. */
#pragma once

enum time_left_stage { TIME_LEFT_BTF, TIME_LEFT_MDF, TIME_LEFT_STAGES };

struct time_left {
    int n_threads;
    int left[TIME_LEFT_STAGES];      /* views that are not made */
    int made[TIME_LEFT_STAGES];      /* by this run */
    double task_s[TIME_LEFT_STAGES]; /* that those took, each in its thread, in all */
    double after_s;                  /* of what follows the views, in one thread */
};

/* Views that are left take as long as those made did, on average. What threads have done of views
 * under way makes up for those that idle at the end. −1: of a stage that has views left none has
 * been made. With many threads, a twentieth of the views or more, the views that are made first are
 * the quick ones, and less is known at the beginning and the end. */
double time_left_s(const struct time_left *now);

/* The k-th of n views in an order in which the views of a ring, which take similarly long, lie
 * spread: then the first ones tell how long all will take. Each view comes once. */
int time_left_view(int k, int n);
