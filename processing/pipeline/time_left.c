#include "time_left.h"

#include <gio/gio.h>
#include <math.h>

/* In an estimate for a view, the weight of a view that is made is exp(−(Δ / NEAR_DEG)²), where Δ is
 * the difference of the elevations in degrees, but at least FAR_WEIGHT. */
#define NEAR_DEG   10.0
#define FAR_WEIGHT 0.02 /* minimum of this weight */
/* a task that is overdue is expected to take this factor of the time that it has run */
#define OVERDUE  1.25
#define ENOUGH_S 10.0 /* minimum CPU time of a run whose rates count fully */
/* weight of the stored rate; a view that is made, at the same elevation, has the weight 1 */
#define RATE_WEIGHT 0.2
/* If a task has run for longer than estimated, this share of the estimate is still assumed to be
 * left. */
#define MIN_LEFT   0.05
#define SCATTER    1.5 /* maximum factor between the rates of two runs of the same session */
#define MIN_SPEED  0.01
#define SHORTEST_S 3.0
#define DEGREES    91
#define FULL_SPEED 0.95 /* speed above which no other program is assumed to need a processor */
#define GROUP      "CPU seconds"

static const char *const keys[TIME_LEFT_WORKS] = {
    [TIME_LEFT_BTF] = "btf_megapixel",         [TIME_LEFT_MDF] = "mdf_megapixel",
    [TIME_LEFT_SETTLE] = "settle_megatexel",   [TIME_LEFT_MDF_FILE] = "mdf_file_megatexel",
    [TIME_LEFT_COLUMNS] = "columns_megatexel", [TIME_LEFT_FACTORS] = "factors_megatexel",
    [TIME_LEFT_CAUSES] = "causes_view"};

static char *rates_path(void) {
    return g_build_filename(g_get_user_cache_dir(), "mesorig", "processing-rates", NULL);
}

gboolean time_left_rates_load(struct time_left_rates *ret) {
    /* Rates of one core of an AMD EPYC whose neighbouring cores had other work, for the demo's
     * session. They were printed by the first run of tests/bench/time_left --cpu. Only their ratios
     * matter, because the first views of a run show how much faster or slower its processor is. */
    *ret = (struct time_left_rates){.unit_s = {[TIME_LEFT_BTF] = 0.09,
                                               [TIME_LEFT_MDF] = 0.174,
                                               [TIME_LEFT_SETTLE] = 0.018,
                                               [TIME_LEFT_MDF_FILE] = 0.66,
                                               [TIME_LEFT_COLUMNS] = 0.016,
                                               [TIME_LEFT_FACTORS] = 0.036,
                                               [TIME_LEFT_CAUSES] = 0.0018}};
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autofree char *path = rates_path();
    if (!g_key_file_load_from_file(file, path, G_KEY_FILE_NONE, NULL))
        return FALSE;
    for (int i = 0; i < TIME_LEFT_WORKS; i++) {
        const double said = g_key_file_get_double(file, GROUP, keys[i], NULL);
        if (isfinite(said) && said > 0)
            ret->unit_s[i] = said;
    }
    return TRUE;
}

void time_left_rates_save(const struct time_left_rates *rates) {
    g_autoptr(GKeyFile) file = g_key_file_new();
    g_autofree char *path = rates_path();
    g_autofree char *folder = g_path_get_dirname(path);
    g_key_file_load_from_file(file, path, G_KEY_FILE_NONE, NULL);
    for (int i = 0; i < TIME_LEFT_WORKS; i++)
        if (isfinite(rates->unit_s[i]) && rates->unit_s[i] > 0)
            g_key_file_set_double(file, GROUP, keys[i], rates->unit_s[i]);
    if (g_mkdir_with_parents(folder, 0700) == 0)
        g_key_file_save_to_file(file, path, NULL);
}

void time_left_rates_learn(struct time_left_rates *rates,
                           const struct time_left_made made[TIME_LEFT_WORKS]) {
    double cpu_s = 0;
    for (int work = 0; work < TIME_LEFT_WORKS; work++)
        cpu_s += made[work].cpu_s;
    const double weight = MIN(cpu_s / ENOUGH_S, 1);
    for (int work = 0; work < TIME_LEFT_WORKS; work++) {
        if (made[work].units <= 0 || made[work].cpu_s <= 0)
            continue;
        const double unit_s = made[work].cpu_s / made[work].units, old_s = rates->unit_s[work];
        const gboolean is_near = MAX(unit_s, old_s) < SCATTER * MIN(unit_s, old_s);
        rates->unit_s[work] += (is_near ? weight / 2 : weight) * (unit_s - old_s);
    }
}

/* s[stage][θ] is the CPU time in seconds of one unit of work of the stage, in a view at θ. θ is in
 * whole degrees, rounded. */
struct unit_costs {
    double s[TIME_LEFT_STAGES][DEGREES];
};

static int degree(const struct time_left_task *task) {
    return CLAMP((int)lround(task->theta_deg), 0, DEGREES - 1);
}

struct unit_sums {
    double made, unit_s;
};

static void spread(struct unit_sums of[TIME_LEFT_STAGES][DEGREES],
                   const struct time_left_rates *rates, struct unit_costs *ret) {
    for (int stage = 0; stage < TIME_LEFT_STAGES; stage++)
        for (int at = 0; at < DEGREES; at++) {
            double weights = RATE_WEIGHT, sum = RATE_WEIGHT * rates->unit_s[stage];
            for (int k = 0; k < DEGREES; k++) {
                if (of[stage][k].made == 0)
                    continue;
                const double off = (k - at) / NEAR_DEG;
                const double weight = MAX(exp(-off * off), FAR_WEIGHT);
                weights += weight * of[stage][k].made;
                sum += weight * of[stage][k].unit_s;
            }
            ret->s[stage][at] = sum / weights;
        }
}

/* Estimates the costs from the tasks that are made. Then adds those running tasks that have already
 * run longer than this estimate, and estimates again. Each of these tasks is expected to take a
 * quarter longer than it has run so far. */
static void time_left_costs(const struct time_left_task *tasks, int n,
                            const struct time_left_rates *rates, struct unit_costs *ret) {
    struct unit_sums of[TIME_LEFT_STAGES][DEGREES] = {0};
    for (int pass = TIME_LEFT_MADE; pass >= TIME_LEFT_RUNS; pass--) {
        for (int i = 0; i < n; i++) {
            const int stage = (int)tasks[i].stage, at = degree(&tasks[i]);
            if ((int)tasks[i].state != pass || tasks[i].units <= 0)
                continue;
            const double unit_s = tasks[i].cpu_s / tasks[i].units;
            if (pass == TIME_LEFT_RUNS && unit_s <= ret->s[stage][at])
                continue;
            of[stage][at].made++;
            of[stage][at].unit_s += pass == TIME_LEFT_RUNS ? OVERDUE * unit_s : unit_s;
        }
        spread(of, rates, ret);
    }
}

/* Simulates the pool: each task goes to the thread that is free first. The result is the time at
 * which the last thread is free. */
double time_left_views_s(const struct time_left_task *tasks, int n, int n_threads,
                         const struct time_left_rates *rates) {
    struct unit_costs costs;
    g_autofree double *free_s = g_new0(double, MAX(n_threads, 1));
    double last_s = 0;
    time_left_costs(tasks, n, rates, &costs);
    for (int pass = TIME_LEFT_RUNS; pass >= TIME_LEFT_WAITS; pass--)
        for (int i = 0; i < n; i++) {
            if ((int)tasks[i].state != pass)
                continue;
            const double all_s = costs.s[tasks[i].stage][degree(&tasks[i])] * tasks[i].units;
            const double done_s = pass == TIME_LEFT_RUNS ? tasks[i].cpu_s : 0;
            int thread = 0;
            for (int t = 1; t < n_threads; t++)
                thread = free_s[t] < free_s[thread] ? t : thread;
            free_s[thread] += MAX(all_s - done_s, MIN_LEFT * all_s);
            last_s = MAX(last_s, free_s[thread]);
        }
    return last_s;
}

void time_left_speed_add(struct time_left_speed *speed, double wall_s, double cpu_s, int n_busy,
                         double elapsed_s) {
    const double kept = exp(-wall_s / MAX(elapsed_s, SHORTEST_S));
    speed->cpu_s = speed->cpu_s * kept + cpu_s;
    speed->thread_s = speed->thread_s * kept + wall_s * n_busy;
    speed->wall_s = speed->wall_s * kept + wall_s;
}

double time_left_speed_of(const struct time_left_speed *speed, int n) {
    if (speed->thread_s <= 0 || speed->wall_s <= 0)
        return 1;
    if (speed->cpu_s / speed->thread_s >= FULL_SPEED)
        return 1;
    return CLAMP(speed->cpu_s / speed->wall_s / n, MIN_SPEED, 1);
}

int time_left_view(int k, int n) {
    /* a step near the golden section places the k-th view into a gap between the earlier views */
    int step = MAX((int)(n * 0.618), 1);
    for (;; step++) {
        int a = step, b = n;
        while (b > 0) {
            const int rest = a % b;
            a = b;
            b = rest;
        }
        if (a == 1) /* no divisor in common */
            return (int)((gint64)k * step % n);
    }
}
