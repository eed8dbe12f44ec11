#include "run_shots.h"

void run_shots_begin(struct run_shots *run) {
    g_clear_pointer(&run->list, g_ptr_array_unref);
    run->list = g_ptr_array_new();
    run->n_committed = run->n_held = 0;
}

void run_shots_clear(struct run_shots *run) {
    g_clear_pointer(&run->list, g_ptr_array_unref);
    g_clear_pointer(&run->leg, g_ptr_array_unref);
}

void run_shots_set_leg(struct run_shots *run, guint n) {
    g_clear_pointer(&run->leg, g_ptr_array_unref);
    run->leg = g_ptr_array_sized_new(n);
    for (guint i = 0; i < n; i++)
        g_ptr_array_add(run->leg, run->list->pdata[i]);
}

const struct session_shot *const *run_shots_left(const struct run_shots *run, guint *ret_n) {
    *ret_n = run->list->len - run->n_committed;
    return (const struct session_shot *const *)run->list->pdata + run->n_committed;
}

guint run_shots_n_together(const struct run_shots *run) {
    return run->n_committed < run->n_held ? run->n_held - run->n_committed : 1;
}
