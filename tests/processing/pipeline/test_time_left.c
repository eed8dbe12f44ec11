/* The time that processing will still take is told within a quarter, from a tenth of it on, though
 * views from above take several times as long as grazing ones, and surfaces longer than pictures.
 */
#include <glib.h>
#include <math.h>

#include "pipeline/time_left.h"

#define MOST_VIEWS 120

/* A computation of its own: tasks in the order they are queued, each to the thread that is free
 * first. */
struct course {
    int n_views, n_threads;
    double cost_s[TIME_LEFT_STAGES][MOST_VIEWS];
    double after_s;
};

/* The largest error from a tenth to 19 twentieths of the time. */
static double worst_error(const struct course *course, gboolean spread, double after_said_s) {
    struct {
        int stage;
        double end_s, cost_s;
    } tasks[TIME_LEFT_STAGES * MOST_VIEWS];
    double free_s[16] = {0}, views_s = 0, worst = 0;
    int n = 0;
    for (int k = 0; k < course->n_views; k++)
        for (int stage = 0; stage < TIME_LEFT_STAGES; stage++) {
            const int view = spread ? time_left_view(k, course->n_views) : k;
            const double cost_s = course->cost_s[stage][view];
            int thread = 0;
            if (cost_s == 0)
                continue;
            for (int t = 1; t < course->n_threads; t++)
                thread = free_s[t] < free_s[thread] ? t : thread;
            free_s[thread] += cost_s;
            tasks[n].stage = stage;
            tasks[n].cost_s = cost_s;
            tasks[n++].end_s = free_s[thread];
            views_s = MAX(views_s, free_s[thread]);
        }
    const double total_s = views_s + course->after_s;
    for (int i = 0; i < n; i++) {
        const double now_s = tasks[i].end_s;
        struct time_left state = {.n_threads = course->n_threads, .after_s = after_said_s};
        for (int j = 0; j < n; j++) {
            const gboolean made = tasks[j].end_s <= now_s;
            state.made[tasks[j].stage] += made;
            state.left[tasks[j].stage] += !made;
            state.task_s[tasks[j].stage] += made ? tasks[j].cost_s : 0;
        }
        const double left_s = time_left_s(&state);
        if (now_s < 0.1 * total_s || now_s > 0.95 * total_s)
            continue;
        g_assert_cmpfloat(left_s, >=, 0);
        worst = MAX(worst, fabs(left_s / (total_s - now_s) - 1));
    }
    return worst;
}

/* Five rings of twelve views, as the demo has. */
static struct course rings_of(double btf_s, double mdf_s, int n_threads, GRand *rand) {
    struct course course = {.n_views = 60, .n_threads = n_threads};
    for (int view = 0; view < course.n_views; view++) {
        const double above = cos((15 + 15 * (view / 12)) * G_PI / 180);
        course.cost_s[TIME_LEFT_BTF][view] =
            btf_s * (0.5 + above) * g_rand_double_range(rand, 0.8, 1.2);
        course.cost_s[TIME_LEFT_MDF][view] = mdf_s * above * g_rand_double_range(rand, 0.8, 1.2);
    }
    course.after_s = 0.05 * 60 * (btf_s + mdf_s) / n_threads;
    return course;
}

static void test_error(void) {
    static const double costs_s[][2] = {{0.4, 0.9}, {0.4, 0.05}, {0.4, 0}, {0, 0.9}};
    static const int threads[] = {1, 2}; /* of more, see time_left.h */
    g_autoptr(GRand) rand = g_rand_new_with_seed(5);
    double sorted = 0;
    for (gsize i = 0; i < G_N_ELEMENTS(costs_s); i++)
        for (gsize t = 0; t < G_N_ELEMENTS(threads); t++) {
            const struct course course = rings_of(costs_s[i][0], costs_s[i][1], threads[t], rand);
            const double error = worst_error(&course, TRUE, 0.8 * course.after_s);
            sorted = MAX(sorted, worst_error(&course, FALSE, 0.8 * course.after_s));
            g_test_message("%g and %g s a view, %d threads: %.0f %%", costs_s[i][0], costs_s[i][1],
                           threads[t], 100 * error);
            g_assert_cmpfloat(error, <, 0.25);
        }
    g_test_message("ring after ring it would be %.0f %%", 100 * sorted);
    g_assert_cmpfloat(sorted, >, 0.25);
}

static void test_order(void) {
    for (int n = 1; n < 200; n++) {
        g_autofree int *seen = g_new0(int, n);
        for (int k = 0; k < n; k++)
            seen[time_left_view(k, n)]++;
        for (int view = 0; view < n; view++)
            g_assert_cmpint(seen[view], ==, 1);
    }
}

static void test_unknown(void) {
    struct time_left now = {.n_threads = 2, .left = {1, 3}, .made = {1, 0}, .task_s = {1, 0}};
    g_assert_cmpfloat(time_left_s(&now), ==, -1);
    now.left[TIME_LEFT_MDF] = 0;
    g_assert_cmpfloat(time_left_s(&now), ==, 0.5);
    now.left[TIME_LEFT_BTF] = 0;
    now.after_s = 4;
    g_assert_cmpfloat(time_left_s(&now), ==, 4);
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    g_test_add_func("/time-left/error", test_error);
    g_test_add_func("/time-left/order", test_order);
    g_test_add_func("/time-left/unknown", test_unknown);
    return g_test_run();
}
